"""Randomiser: vehicle and water of a control task's episode, drawn from the table of parameters.

`table` draws nothing but what it is given; `field` draws what preset `field` does. The parameters
are those of groups vehicle, current and water (`factory distributions`); missions and sensors have
no place in a task.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from factory.sampling.distribution import Distribution, Fixed
from factory.sampling.draw import Parameters
from factory.sampling.mission_water import build_current, build_density
from factory.sampling.parameters import BOTTOM, declared, override, parameter_table
from factory.sampling.vehicle_errors import ballast_of, encoder_zeros, spread_vehicle
from twin.control.conditions import Conditions
from twin.errors import InputError
from twin.vehicle.vehicle import Vehicle
from twin.water.current.axes import Origin

GROUPS = ("vehicle", "current", "water")
"""Groups of the table that conditions are made of"""
CALM: Mapping[str, Distribution] = {
    "current.speed": Fixed(0.0),
    "water.stratified": Fixed(0.0),
}
"""What `table` has in place of preset paper's: still water of the reference density"""


class _Task(Parameters):
    """Parameters of an episode that has no segments."""

    depth = 0.0
    """[m] down to which the task goes"""

    @property
    def deepest_m(self) -> float:
        """The task's depth limit [m]."""
        return self.depth


class TableRandomiser:
    """Draws from distributions by parameter."""

    def __init__(
        self,
        distributions: Mapping[str, Distribution],
        *,
        vehicle: Vehicle,
        depth: float,
        duration: float,
    ):
        """For a vehicle in episodes of `duration` [s] down to `depth` [m]."""
        self.distributions = dict(distributions)
        self._vehicle, self._depth, self._duration = vehicle, depth, duration

    def draw(self, random: np.random.RandomState) -> Conditions:
        """See `twin.control.conditions.Randomiser`."""
        rng = np.random.default_rng(random.randint(2**31))
        values = {name: drawn.draw(rng) for name, drawn in self.distributions.items()}
        parameters = _Task(duration_s=self._duration, values=values, segments=())
        object.__setattr__(parameters, "depth", self._depth)
        return Conditions(
            vehicle=spread_vehicle(self._vehicle, parameters),
            ballast=ballast_of(self._vehicle, parameters),
            encoder_zeros=encoder_zeros(self._vehicle, parameters),
            current=build_current(parameters),
            origin=Origin(
                latitude_deg=parameters.number("water.latitude"),
                longitude_deg=parameters.number("water.longitude"),
            ),
            density=build_density(parameters),
        )


def table(
    changes: Mapping[str, str | float], *, vehicle: Vehicle, depth: float, duration: float
) -> TableRandomiser:
    """What is named is drawn, everything else is as the vehicle file says, in still water.

    Raises:
      InputError: no such parameter, one that tasks do not use, or a bad distribution.
    """
    return _made("paper", CALM, changes, vehicle=vehicle, depth=depth, duration=duration)


def field(
    changes: Mapping[str, str | float], *, vehicle: Vehicle, depth: float, duration: float
) -> TableRandomiser:
    """What preset field draws of vehicle and water, with changes.

    Raises:
      InputError: as `table`.
    """
    return _made("field", {}, changes, vehicle=vehicle, depth=depth, duration=duration)


def _made(
    spread: str,
    base: Mapping[str, Distribution],
    changes: Mapping[str, str | float],
    *,
    vehicle: Vehicle,
    depth: float,
    duration: float,
) -> TableRandomiser:
    rows = parameter_table(vehicle)
    for name in changes:
        if name in rows and name.partition(".")[0] not in GROUPS:
            raise InputError(
                f"{name} belongs to a mission: a task draws only {', '.join(GROUPS)} parameters"
            )
    found = override({**declared(spread, rows), **base}, changes)
    used = {name: d for name, d in found.items() if name.partition(".")[0] in GROUPS}
    used.setdefault(BOTTOM, Fixed(math.nan))  # surveys have a sea floor instead, tasks neither
    return TableRandomiser(used, vehicle=vehicle, depth=depth, duration=duration)
