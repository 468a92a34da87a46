"""Attempts: one mission from its number to its signals, tried again when it fails.

Flown mission: what is kept of a mission beside its signals.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.sampling.draw import Parameters, sensor_seed
from factory.sampling.fly import FlownSignals, Impossible, fly
from factory.sampling.recipe import Recipe
from twin.errors import (
    CurrentError,
    FloorError,
    InputError,
    MissionError,
    NoSteadyState,
    SimulationUnstable,
    StepTooLong,
    TwinError,
    VehicleError,
)
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
REPLACED = (
    *(MissionError, VehicleError, CurrentError, FloorError, NoSteadyState),
    *(SimulationUnstable, Impossible),
)
"""What a draw can do wrong: the vehicle cannot fly it, cannot exist, or runs away."""


def fly_mission(
    recipe: Recipe, mission: int
) -> tuple[FlownMission, dict[str, NDArray[np.float32]]]:
    """Fly mission number `mission`; failed attempts are recorded and replaced.

    Returns:
      What is kept about it, and its signals, each (samples,), as the store keeps them.

    Raises:
      InputError: no attempt succeeded; names the distributions to narrow.
    """
    failures: list[FailedAttempt] = []
    for attempt in range(MAX_ATTEMPTS):
        try:
            parameters = recipe.parameters(mission, attempt)
            seed = sensor_seed(recipe.seed, mission, attempt)
            flight = fly(
                parameters, recipe.vehicle, recipe.suite, seed, current=recipe.given_current
            )
        except REPLACED as error:
            time_s = getattr(error, "time_s", None)
            failures.append(FailedAttempt(mission, attempt, reason(error), time_s))
            continue
        flown = FlownMission(
            mission=mission,
            attempt=attempt,
            samples=len(flight.trajectory.time),
            parameters=parameters,
            sensors=flight.drawn,
            failures=tuple(failures),
        )
        return flown, rounded_signals(flight)
    raise InputError(
        f"mission {mission} failed {MAX_ATTEMPTS} times, last: {failures[-1].reason}; "
        f"{to_narrow(recipe, failures[-1].reason)}"
    )


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
