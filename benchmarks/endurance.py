"""Endurance: predicted days left of simulated deployments, compared with the true ones.

    python -m benchmarks.endurance --deployments 200

The batched engine flies dives of three vehicles to seven depths; deployments are composed of these
dives. In a deployment, electronics, pump and payload differ from the vehicle file's, and the pump
weakens. Dives are shallower than planned and correlated in sequence. The payload is on in
some dives, and half of the deployments change to another depth in the first third. The rival
prediction is the energy left divided by the mean power so far.
"""

from __future__ import annotations

import dataclasses
import json
import sys

import numpy as np

from benchmarks import command
from glider_twin_ops.forecast import MemberFlight, Request, fly_nominal
from twin.logs import EnergyUse, endurance_of
from twin.logs.energy_timeline import DiveCharge
from twin.mission import Mission, Waypoint
from twin.vehicle.consumption import Consumption
from twin.vehicle.vehicle import Vehicle, load_vehicle
from twin.water.current.axes import Origin

VEHICLES = {"slocum-1000": 900.0, "seaglider": 900.0, "slocum-200": 180.0}
"""[m] Deepest dive of each vehicle"""
PARTS = np.linspace(0.25, 1.0, 7)
VOLTAGE = 14.0
READING = 1e-3
"""[A h] Resolution of the counter"""
FLOOR, LIKE = 0.1, 0.95
"""[1] Relative change of depth by sea floor and pilots, and its correlation from dive to dive"""
MOMENTS = {"half time": 0.5, "last fifth": 0.8}


@dataclasses.dataclass(frozen=True)
class Dives:
    """Dives of a vehicle to several depths."""

    vehicle: Vehicle
    depth: np.ndarray
    seconds: np.ndarray
    moves: np.ndarray
    """[J] Energy of moves, without the electronics"""


def dives_of(name: str, deepest: float) -> Dives:
    """Fly the first dive to each depth."""
    vehicle = load_vehicle(name)
    place = Origin(latitude_deg=48.0, longitude_deg=-50.0, time="2026-01-01T00:00:00")
    target = {"latitude": 48.8, "longitude": -50.0}
    ways = [
        Waypoint(
            targets=(target,), max_depth_m=part * deepest, pitch_deg=26.0, surface_after_yos=1.0
        )
        for part in PARTS
    ]
    missions = [Mission(name="goto", segments=(way,)) for way in ways]
    longest = deepest / 0.1 * 2.0 / 3600.0
    request = Request(vehicle=vehicle, mission=missions[-1], place=place, hours=longest)
    flown = fly_nominal(request, missions)
    seconds, energy = np.array(
        [(one.time[0], one.energy[0]) for one in flown if isinstance(one, MemberFlight)]
    ).T
    return Dives(vehicle, PARTS * deepest, seconds,
                 energy - Consumption.of(vehicle).hotel_power * seconds)  # fmt: skip


def deployment(dives: Dives, rng: np.random.Generator) -> list[dict[str, float]]:
    """Simulate a deployment; errors of the prediction at each moment."""
    hotel = Consumption.of(dives.vehicle).hotel_power * rng.lognormal(0.0, 0.3)
    payload, on = hotel * rng.uniform(0.0, 0.5), rng.uniform(0.3, 1.0)
    count = int(rng.integers(60, 300))
    planned = np.full(count, rng.uniform(*dives.depth[[0, -1]]))
    if rng.random() < 0.5:
        planned[: int(rng.integers(1, count // 3))] = rng.uniform(*dives.depth[[0, -1]])
    depth = planned * np.clip(0.9 + FLOOR * _correlated(rng, count), 0.5, 1.0)
    weaker = 1.0 + rng.uniform(0.0, 0.15) * np.linspace(0.0, 1.0, count)
    moves = rng.lognormal(0.0, 0.2) * weaker * np.interp(depth, dives.depth, dives.moves)
    seconds = np.interp(depth, dives.depth, dives.seconds)
    energy = moves + seconds * (hotel + payload * (rng.random(count) < on))
    taken = np.cumsum(energy)
    time = np.cumsum(seconds)
    counter = np.round(np.concatenate([[0.0], taken]) / VOLTAGE / 3600.0 / READING) * READING
    found = []
    for part in MOMENTS.values():
        last = int(np.searchsorted(time, part * time[-1]))
        known = EnergyUse(
            vehicle=dives.vehicle, terms=(), consumption=Consumption.of(dives.vehicle),
            dives=tuple(
                DiveCharge(mission=k, hours=seconds[k] / 3600.0,
                           measured=counter[k + 1] - counter[k], modelled=np.nan)
                for k in range(last + 1)
            ),
            hours=time[last] / 3600.0, charge=counter[last + 1], voltage=VOLTAGE, equations=0,
            resets=0,
        )  # fmt: skip
        left = taken[-1] / 3.6e6 - counter[last + 1] * VOLTAGE / 1e3
        lasts = endurance_of(known, left)
        truth = (time[-1] - time[last]) / 86400.0
        low, high = lasts.interval()
        found.append({
            "error": abs(lasts.days / truth - 1.0),
            "rival": abs(left * 1e3 / known.power / 24.0 / truth - 1.0),
            "inside": float(low <= truth <= high), "width": (high - low) / truth,
        })  # fmt: skip
    return found


def _correlated(rng: np.random.Generator, count: int) -> np.ndarray:
    """Normal numbers with correlated neighbours, (dive,)."""
    found = rng.standard_normal(count)
    for k in range(1, count):
        found[k] = LIKE * found[k - 1] + np.sqrt(1.0 - LIKE**2) * found[k]
    return found


def main(*, deployments: int = 200, seed: int = 0) -> None:
    """Print means over deployments."""
    rng = np.random.default_rng(seed)
    flown = [dives_of(name, deepest) for name, deepest in VEHICLES.items()]
    every = [deployment(flown[k % len(flown)], rng) for k in range(deployments)]
    told = {}
    for k, moment in enumerate(MOMENTS):
        found = {name: 100.0 * np.array([one[k][name] for one in every]) for name in every[0][k]}
        told[moment] = {
            "mean error [%]": found["error"].mean(),
            "worst tenth above [%]": np.quantile(found["error"], 0.9),
            "mean error of the mean power so far [%]": found["rival"].mean(),
            "inside 90 % [%]": found["inside"].mean(),
            "width of 90 % [%]": found["width"].mean(),
        }
    print(json.dumps(told, indent=1))


if __name__ == "__main__":
    sys.exit(command.run(main))
