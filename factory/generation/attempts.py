"""Attempts: one mission from its number to its signals, tried again when it fails.

Flown mission: what is kept of a mission beside its signals.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.sampling.draw import Parameters, sensor_seed
from factory.sampling.fly import REPLACED, Draw, FlownSignals, fly_abreast
from factory.sampling.recipe import Recipe
from twin.errors import InputError, SimulationUnstable, StepTooLong, TwinError
from twin.records.schema import VARIABLES
from twin.records.storage.sharded import stored_values
from twin.vehicle.consumption import ENERGY


class FailedAttempt(NamedTuple):
    """An attempt that had to be replaced, as JSON lists and the arrays of a store have it."""

    mission: int
    attempt: int
    reason: str
    time_s: float | None
    """[s] when the simulation left the finite numbers; None: it never started"""

    @classmethod
    def of(cls, mission: Any, attempt: Any, reason: Any, time_s: Any) -> FailedAttempt:
        """Of values of a store's arrays; NaN stands for no time."""
        return cls(
            int(mission), int(attempt), str(reason), float(time_s) if time_s == time_s else None
        )


@dataclass(frozen=True, kw_only=True)
class FlownMission:
    """One mission as it was made."""

    mission: int
    attempt: int
    """the attempt that succeeded, from 0"""
    samples: int
    parameters: Parameters
    sensors: Mapping[str, float]
    """the sensors' constants"""
    failures: tuple[FailedAttempt, ...] = ()


MAX_ATTEMPTS = 20
"""So many failures in a row mean impossible distributions, not bad luck."""


Made = tuple[FlownMission, dict[str, NDArray[np.float32]]]
"""What is kept about a mission, and its signals, each (samples,), as the store keeps them"""


def fly_missions(recipe: Recipe, missions: Sequence[int]) -> list[Made]:
    """Fly missions, together where the recipe's engine can; failed attempts are recorded and
    replaced.

    Raises:
      InputError: no attempt at a mission succeeded; names the distributions to narrow.
    """
    made: dict[int, Made] = {}
    failures: dict[int, list[FailedAttempt]] = {mission: [] for mission in missions}

    def failed(mission: int, error: TwinError) -> None:
        attempt, time_s = len(failures[mission]), getattr(error, "time_s", None)
        failures[mission].append(FailedAttempt(mission, attempt, reason(error), time_s))

    while len(made) < len(missions):
        numbers, draws = [], []
        for mission in missions:
            if mission in made:
                continue
            attempt = len(failures[mission])
            if attempt == MAX_ATTEMPTS:
                last = failures[mission][-1].reason
                raise InputError(
                    f"mission {mission} failed {MAX_ATTEMPTS} times, last: {last}; "
                    f"{to_narrow(recipe, last)}"
                )
            seed = sensor_seed(recipe.seed, mission, attempt)
            try:
                parameters = recipe.parameters(mission, attempt)
            except REPLACED as error:
                failed(mission, error)
                continue
            numbers.append(mission)
            draws.append(Draw(parameters=parameters, sensor_seed=seed))
        for index, flight in fly_abreast(
            draws, recipe.vehicle, recipe.suite, current=recipe.given_current, engine=recipe.engine
        ):
            mission = numbers[index]
            if isinstance(flight, TwinError):
                failed(mission, flight)
                continue
            flown = FlownMission(
                mission=mission,
                attempt=len(failures[mission]),
                samples=len(flight.trajectory.time),
                parameters=draws[index].parameters,
                sensors=flight.drawn,
                failures=tuple(failures[mission]),
            )
            made[mission] = flown, rounded_signals(flight)
    return [made[mission] for mission in missions]


def to_narrow(recipe: Recipe, reason: str) -> str:
    """Which distributions to narrow: those that the reason speaks of, else those replaced."""
    words = set(re.findall(r"\w+", reason))
    named = [name for name in recipe.table if name.partition(".")[2] in words] or [*recipe.changes]
    if not named:
        return f"preset {recipe.preset!r} does not suit vehicle {recipe.vehicle.name!r}"
    now = ", ".join(f"{name} (now {recipe.distributions[name].text()})" for name in named)
    return f"narrow with --set: {now}"


def reason(error: TwinError) -> str:
    """Why an attempt failed, the same words on every replay."""
    if isinstance(error, SimulationUnstable) and not isinstance(error, StepTooLong):
        return f"went unstable at {error.time_s:.1f} s"
    return str(error)


def rounded_signals(flight: FlownSignals) -> dict[str, NDArray[np.float32]]:
    """Every signal as the store keeps it, in the schema's order.

    Energy is left out: it follows from the other signals and the vehicle that the store holds
    (`MissionStore.energy`), and would add a fifteenth to the size of a store.
    """
    signals = {k: v for k, v in flight.signals.items() if not k.startswith(ENERGY)}
    return {
        name: stored_values(signals[name], variable.decimals)
        for name, variable in VARIABLES.items()
        if name in signals
    }
