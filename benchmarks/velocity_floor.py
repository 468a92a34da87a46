"""Velocity floor: surge error of an estimator that knows the error statistics of its sensors.

    python -m benchmarks.velocity_floor STORE [--seed 0] [--json]

Missions of a `field` store are simulated again by the flight model. At every steady sample a
balance of forces gives the depth rate, with constants sampled for the mission. Accelerometers have
sampled errors. `twin.navigation.flight_filter` then estimates the surge with exactly this prior, so
its model is right. The program prints the error of dead reckoning with the true attitude over the
steady samples, in % of their path: with the errors of preset `field`, without one of them at a
time, and for a filter that estimates nothing.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from json import dumps
from typing import Any

import numpy as np

from benchmarks import command
from learn.data.dataset import MissionSequence, Selection
from twin.navigation.flight_filter import (
    CLEAN,
    HULLS,
    TYPICAL_COMPRESSIBILITY,
    FlightFilter,
    FlightSpread,
)
from twin.records.reader import MissionStore
from twin.vehicle.parts.pump import CUBIC_CM
from twin.vehicle.steady_motion import balance
from twin.vehicle.vehicle import Vehicle
from twin.water.density import STANDARD_OCEAN

COEFFICIENT = 0.1
"""[1] Half the width of the uniform distribution of each factor."""
STEADY_RATE = 3e-3
"""[rad/s] Largest pitch rate of a steady sample."""
STEADY_S = 20.0
NEVER = {
    "coefficient": 1e-6, "drag": 1e-6, "pitch": 1e-8, "ballast": 1e-7, "compressibility": 1e-17
}  # fmt: skip
ERRORS = ("drag", "lift slope", "induced drag", "accelerometers", "compressibility")
TRUE = ("depth", "roll", "pitch", "heading", "roll_rate", "pitch_rate", "yaw_rate", "pump")


def constants(rng: np.random.Generator) -> dict[str, Any]:
    """Sample the errors of one mission."""
    spread = FlightSpread()
    factors = rng.uniform(1.0 - COEFFICIENT, 1.0 + COEFFICIENT, 3)
    return {
        **dict(zip(ERRORS[:3], factors, strict=True)),
        "accelerometers": spread.pitch * rng.standard_normal(2),
        "compressibility": spread.compressibility * rng.standard_normal(),
    }


RIGHT: Mapping[str, Any] = {
    **dict.fromkeys(ERRORS[:3], 1.0),
    "accelerometers": np.zeros(2),
    "compressibility": 0.0,
}


def flown(
    mission: MissionSequence, vehicle: Vehicle, off: Mapping[str, Any]
) -> tuple[dict, Any, Any]:
    """Measured signals of a mission flown with these constants, its surge, and its steady
    samples."""
    s = {name: mission.signals[f"true_{name}"] for name in TRUE}
    density, period = mission.signals["true_density"], mission.period
    law = vehicle.flow_frame
    law = dataclasses.replace(
        law,
        drag=(law.drag[0] * off["drag"], law.drag[1] * off["induced drag"]),
        lift=(law.lift[0], law.lift[1] * off["lift slope"]),
    )
    depth = np.maximum(s["depth"], 0.0)
    squeezed = TYPICAL_COMPRESSIBILITY + off["compressibility"]
    volume = vehicle.neutral_volume + CUBIC_CM * s["pump"]
    volume = volume * (1.0 - squeezed * vehicle.reference_density * vehicle.gravity * depth)
    net = vehicle.mass - density * volume
    # The ballast stays the mission's: pilots trim the vehicle to its water.
    diving = depth > 5.0
    net += np.median((mission.signals["true_net_mass"] - net)[diving])
    pitch, roll = np.deg2rad(s["pitch"]), np.deg2rad(s["roll"])
    rates = np.stack([s[f"{name}_rate"] for name in ("roll", "pitch", "yaw")])
    model = dataclasses.replace(vehicle, law=law)
    speed, alpha, beta, gliding = balance(model, net, roll, pitch, rates)
    direction = np.stack([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    down = np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    sink = speed * (direction * down).sum(0)
    true_rate = np.gradient(s["depth"], period)
    steady = gliding & (np.abs(np.gradient(pitch, period)) < STEADY_RATE) & (depth > 5.0)
    width = round(2.0 * STEADY_S / period) + 1
    steady = np.convolve(steady & (sink * true_rate > 0.0), np.ones(width), "same") > width - 0.5
    # The depth's drift is removed at each surface interval.
    rate = np.where(steady, sink, true_rate)
    drift = np.cumsum(rate - true_rate) * period
    last = np.maximum.accumulate(np.where(s["depth"] < 1.5, np.arange(len(drift)), 0))
    standard = STANDARD_OCEAN[0] + STANDARD_OCEAN[1] * depth
    shown = s["depth"] + drift - drift[last]
    shown = shown[0] + np.concatenate([[0.0], np.cumsum(np.diff(shown) * (density / standard)[1:])])
    x, z = off["accelerometers"]
    seen = pitch + x * np.cos(pitch) + z * np.sin(pitch)
    forces = (np.sin(seen), -np.cos(seen) * np.sin(roll), -np.cos(seen) * np.cos(roll))
    signals = {f"measured_{name}": values for name, values in s.items()}
    signals |= {"measured_depth": shown, "measured_pitch": np.rad2deg(seen)}
    signals |= {"measured_density": density}
    signals |= {
        f"measured_specific_force_{axis}": vehicle.gravity * force
        for axis, force in zip("xyz", forces, strict=True)
    }
    return signals, speed * direction[0], steady


def error_percent(
    mission: MissionSequence, vehicle: Vehicle, off: Any, spread: FlightSpread
) -> float:
    """Error of dead reckoning at the end in % of the path, for steady samples only."""
    signals, surge, steady = flown(mission, vehicle, off)
    found = FlightFilter(vehicle, mission.period, spread).run(signals)[:, 0]
    heading = np.deg2rad(mission.signals["true_heading"][steady])
    level = np.cos(np.deg2rad(mission.signals["true_pitch"][steady]))
    towards = np.stack([np.cos(heading), np.sin(heading)])
    miss = (towards * (found - surge)[steady] / level).sum(1)
    return float(100.0 * np.hypot(*miss) / (surge[steady] * level).sum())


def _without(name: str) -> FlightSpread:
    """Prior of a filter that knows that one error is 0; other coefficients keep their prior."""
    known = {
        "accelerometers": ("pitch",), "coefficients": ("coefficient", "drag"),
        "compressibility": ("compressibility",),
    }.get(name, ())  # fmt: skip
    return dataclasses.replace(HULLS[CLEAN], **{field: NEVER[field] for field in known})


def main(store: command.Positional[str], *, seed: int = 0, json: bool = False) -> None:
    """Print mean and 90 % of the errors of each case. store: missions of preset field."""
    with MissionStore(store) as reader:
        vehicle = reader.vehicle
    channels = [*(f"true_{name}" for name in TRUE), "true_density", "true_net_mass"]
    with Selection(store, channels) as selection:
        missions = list(selection.each())
    cases: dict[str, tuple[tuple[str, ...], FlightSpread]] = {
        "nothing learned": ((), dataclasses.replace(HULLS[CLEAN], **NEVER)),
        "learned": ((), HULLS[CLEAN]),
        **{f"learned, no error of {name}": ((name,), _without(name)) for name in ERRORS},
        "learned, no error of any coefficient": (ERRORS[:3], _without("coefficients")),
    }
    for name, (right, spread) in cases.items():
        rng = np.random.default_rng(seed)
        errors = []
        for mission in missions:
            off = constants(rng) | {key: RIGHT[key] for key in right}
            errors.append(error_percent(mission, vehicle, off, spread))
        mean, most = float(np.mean(errors)), float(np.percentile(errors, 90.0))
        if json:
            print(dumps({"case": name, "mean": mean, "p90": most}), flush=True)
        else:
            print(f"{name:40s} {mean:.2f} / {most:.2f} %", flush=True)


if __name__ == "__main__":
    sys.exit(command.run(main))
