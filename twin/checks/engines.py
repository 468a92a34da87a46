"""Engines: MuJoCo and the Fossen model in lanes, compared on many random manoeuvres.

Both use the step of the vehicle's file. The effect of the step is reported as well: the change of
each engine when its step is halved once and twice, and the lanes' error at the vehicle's step.
"""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from twin.checks.agreement import (
    ATTITUDE_LIMIT,
    DURATION,
    POSITION_LIMIT,
    SPEED_LIMIT,
    Difference,
    compare,
    draw_manoeuvre,
)
from twin.errors import SimulationUnstable
from twin.fossen.lane_block import LANES
from twin.physics.scenario import ENGINES
from twin.physics.simulation import simulate_many
from twin.physics.stiffness import file_timestep
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle

LIMITS = {
    "speed_m_s": SPEED_LIMIT,
    "attitude_deg": ATTITUDE_LIMIT,
    "position_percent": POSITION_LIMIT,
}
"""Limits of the numbers of `Difference` for the fraction WITHIN of the manoeuvres. The limit for
every manoeuvre is FARTHEST times as large."""
WITHIN, FARTHEST = 0.99, 5.0
QUANTILES = (0.5, 0.9, WITHIN, 1.0)
STEPPED = 2
"""Manoeuvres of each vehicle that are also flown with shorter steps."""
FINER = 20
"""[1] Factor by which the step is shortened to find the lanes' own error."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Steps:
    """Effect of the time step in STEPPED manoeuvres of one vehicle."""

    timestep_s: float
    """Step of the vehicle file [s]."""
    lanes_error: Difference
    """Lanes at `timestep_s` minus lanes at `timestep_s` / FINER: the largest of each number."""
    falls: dict[str, float]
    """Median ratio by engine: change of RMS speed from the whole to half the step, divided by the
    change from half to a quarter. A ratio of four means order 2."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VehicleAgreement:
    """Manoeuvres of one vehicle by both engines."""

    vehicle: str
    differences: list[Difference]
    unstable: list[int]
    """Seeds of the manoeuvres in which an engine went unstable."""
    steps: Steps | None
    """Effect of the steps; None if no manoeuvre was flown to its end."""

    def beyond(self) -> list[str]:
        """Texts about the numbers beyond the limits."""
        found = [f"{self.vehicle}: manoeuvre {seed} went unstable" for seed in self.unstable]
        for name, values in quantiles(self.differences).items():
            limit = LIMITS[name]
            for share, most in ((WITHIN, limit), (1.0, FARTHEST * limit)):
                percent = f"{100.0 * share:g}"
                value = values.get(percent, 0.0)
                if value > most:
                    found.append(
                        f"{self.vehicle}: {percent} % of the manoeuvres are within {value:.3g} in "
                        f"{name}, asked is {most:g}"
                    )
        return found


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineCheck:
    """Manoeuvres of all vehicles by both engines."""

    vehicles: list[VehicleAgreement]

    @property
    def differences(self) -> list[Difference]:
        """Differences of all vehicles' manoeuvres."""
        return [difference for one in self.vehicles for difference in one.differences]

    def beyond(self) -> list[str]:
        """Texts about the numbers beyond the limits, vehicle by vehicle."""
        return [text for one in self.vehicles for text in one.beyond()]

    def worst(self) -> tuple[str, Difference] | None:
        """Vehicle and difference with the largest number relative to its limit, if any flew."""
        pairs = [(one.vehicle, each) for one in self.vehicles for each in one.differences]

        def size(pair: tuple[str, Difference]) -> float:
            return max(getattr(pair[1], name) / limit for name, limit in LIMITS.items())

        return max(pairs, key=size, default=None)

    def describe(self) -> dict[str, Any]:
        """Describe the check as a dict for JSON."""
        worst = self.worst()
        return {
            "manoeuvres": len(self.differences),
            "duration_s": DURATION,
            "limits": LIMITS,
            "quantiles": quantiles(self.differences),
            "worst": worst and {"vehicle": worst[0], **dataclasses.asdict(worst[1])},
            "vehicles": [
                {
                    "vehicle": one.vehicle,
                    "flown": len(one.differences),
                    "unstable": one.unstable,
                    "quantiles": quantiles(one.differences),
                    "steps": one.steps and dataclasses.asdict(one.steps),
                }
                for one in self.vehicles
            ],
            "ok": not self.beyond(),
        }


def quantiles(differences: Sequence[Difference]) -> dict[str, dict[str, float]]:
    """Quantiles of each number of LIMITS, by percentage; empty without differences."""
    return {
        name: {
            f"{100.0 * share:g}": float(
                np.quantile([getattr(one, name) for one in differences], share)
            )
            for share in QUANTILES
            if differences
        }
        for name in LIMITS
    }


def check_engines(
    vehicles: Sequence[Vehicle],
    *,
    count: int,
    seed: int = 0,
    threads: int = 1,
    watch: Callable[[int], None] = lambda flown: None,
) -> EngineCheck:
    """Fly `count` manoeuvres by both engines, with the vehicles in turn.

    Args:
      seed: seed of the first manoeuvre; each next manoeuvre has the next seed.
      watch: called with the number of manoeuvres flown since the last call.
    """
    found = []
    for place, vehicle in enumerate(vehicles):
        seeds = range(seed + place, seed + count, len(vehicles))
        if not seeds:
            continue
        differences, unstable = list[Difference](), list[int]()
        for k in range(0, len(seeds), LANES[-1]):
            some = seeds[k : k + LANES[-1]]
            ours, theirs = (_fly(vehicle, some, engine, threads=threads) for engine in ENGINES)
            for number, one, other in zip(some, ours, theirs, strict=True):
                if one is None or other is None:
                    unstable.append(number)
                else:
                    differences.append(compare(one, other, number))
            watch(len(some))
        flown = [one.seed for one in differences[:STEPPED]]
        found.append(
            VehicleAgreement(
                vehicle=vehicle.name,
                differences=differences,
                unstable=unstable,
                steps=_effects(vehicle, flown, threads) if flown else None,
            )
        )
    return EngineCheck(vehicles=found)


def _fly(
    vehicle: Vehicle, seeds: Sequence[int], engine: str, *, threads: int, part: int = 1
) -> list[Trajectory | None]:
    """Fly manoeuvres by an engine at 1 / `part` of the vehicle's step; None if unstable."""
    step = file_timestep(vehicle) / part
    scenarios = [
        draw_manoeuvre(vehicle, seed).scenario(
            vehicle, duration=DURATION, engine=engine, timestep=step
        )
        for seed in seeds
    ]
    found = simulate_many(scenarios, threads=threads)
    return [None if isinstance(one, SimulationUnstable) else one for one in found]


def _effects(vehicle: Vehicle, seeds: Sequence[int], threads: int) -> Steps | None:
    flights = {
        (engine, part): _fly(vehicle, seeds, engine, threads=threads, part=part)
        for engine in ENGINES
        for part in (1, 2, 4)
    }
    flights["lanes", FINER] = _fly(vehicle, seeds, "lanes", threads=threads, part=FINER)

    def between(engine: str, coarse: int, fine: int) -> list[Difference]:
        pairs = zip(seeds, flights[engine, coarse], flights[engine, fine], strict=True)
        return [compare(a, b, seed) for seed, a, b in pairs if a is not None and b is not None]

    errors = between("lanes", 1, FINER)
    if not errors:
        return None
    falls = {}
    for engine in ENGINES:
        once, twice = between(engine, 1, 2), between(engine, 2, 4)
        ratios = [a.speed_m_s / b.speed_m_s for a, b in zip(once, twice, strict=True)]
        falls[engine] = statistics.median(ratios)
    largest = {name: max(getattr(one, name) for one in errors) for name in LIMITS}
    return Steps(
        timestep_s=file_timestep(vehicle),
        lanes_error=dataclasses.replace(errors[0], **largest),
        falls=falls,
    )
