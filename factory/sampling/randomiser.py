"""Randomiser: sample vehicle and water of a control task's episode from the table of parameters.

`table` samples only the given parameters; `field` samples all that preset `field` samples. Tasks
use the groups vehicle, current and water (`factory distributions`), not missions and sensors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from factory.sampling.conditions import (
    ballast_of,
    build_current,
    build_density,
    encoder_zeros,
    spread_vehicle,
)
from factory.sampling.distribution import Distribution, Fixed
from factory.sampling.draw import Parameters
from factory.sampling.parameters import BOTTOM, declared, override, parameter_table
from twin.control.conditions import Conditions
from twin.errors import InputError
from twin.vehicle.vehicle import Vehicle
from twin.water.current.axes import Origin

GROUPS = ("vehicle", "current", "water")
"""Groups of parameters that a task uses"""
CALM = {"current.speed": Fixed(0.0), "water.stratified": Fixed(0.0)}
"""Distributions of `table` that replace preset paper's: still water of the reference density"""


@dataclass(frozen=True, kw_only=True)
class _Task(Parameters):
    """Parameters of an episode, which has no segments."""

    depth: float
    """[m] Depth limit of the task"""

    @property
    def deepest_m(self) -> float:
        """[m] Depth limit of the task."""
        return self.depth


@dataclass(frozen=True, kw_only=True)
class TableRandomiser:
    """Randomiser that samples from distributions by parameter."""

    distributions: Mapping[str, Distribution]
    vehicle: Vehicle
    depth: float
    """[m] Depth limit of the task"""
    duration: float
    """[s] Duration of an episode"""

    def draw(self, random: np.random.RandomState) -> Conditions:
        """Sample conditions; see `twin.control.conditions.Randomiser`."""
        rng = np.random.default_rng(random.randint(2**31))
        values = {name: drawn.draw(rng) for name, drawn in self.distributions.items()}
        task = _Task(duration_s=self.duration, values=values, segments=(), depth=self.depth)
        return Conditions(
            vehicle=spread_vehicle(self.vehicle, task),
            ballast=ballast_of(self.vehicle, task),
            encoder_zeros=encoder_zeros(self.vehicle, task),
            current=build_current(task),
            origin=Origin(
                latitude_deg=task.number("water.latitude"),
                longitude_deg=task.number("water.longitude"),
            ),
            density=build_density(task),
        )


def table(
    changes: Mapping[str, str | float], *, vehicle: Vehicle, depth: float, duration: float
) -> TableRandomiser:
    """Make a randomiser that samples only the parameters in `changes`, otherwise the vehicle of the
    file in still water.

    Args:
      depth: [m] Depth limit of the task.
      duration: [s] Duration of an episode.

    Raises:
      InputError: an unknown parameter, one that tasks do not use, or a bad distribution."""
    used = _distributions("paper", CALM, changes, vehicle)
    return TableRandomiser(distributions=used, vehicle=vehicle, depth=depth, duration=duration)


def field(
    changes: Mapping[str, str | float], *, vehicle: Vehicle, depth: float, duration: float
) -> TableRandomiser:
    """Make a randomiser with preset field's vehicle and water, with changes; see `table`."""
    used = _distributions("field", {}, changes, vehicle)
    return TableRandomiser(distributions=used, vehicle=vehicle, depth=depth, duration=duration)


def _distributions(
    spread: str,
    base: Mapping[str, Distribution],
    changes: Mapping[str, str | float],
    vehicle: Vehicle,
) -> dict[str, Distribution]:
    rows = parameter_table(vehicle)
    for name in changes:
        if name in rows and name.partition(".")[0] not in GROUPS:
            raise InputError(
                f"{name} belongs to a mission: a task draws only {', '.join(GROUPS)} parameters"
            )
    found = override({**declared(spread, rows), **base}, changes)
    used = {name: d for name, d in found.items() if name.partition(".")[0] in GROUPS}
    used.setdefault(BOTTOM, Fixed(math.nan))  # missing for propelled vehicles; tasks have no floor
    return used
