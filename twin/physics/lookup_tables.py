"""Tables: the numbers of a scenario that native code reads, gathered before the model is compiled.

The tables travel inside the model (`twin.physics.native.block`), so their sizes must be known when
it is compiled; a fleet gives all its models the size of the largest.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.errors import FloorError
from twin.mission.mission_file import COMPASS_OFFSET
from twin.numbers import Array
from twin.physics.native import block as b

if TYPE_CHECKING:
    from twin.physics.scenario import Scenario


_NONE = np.zeros(0)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Tables:
    """The tables of one run; empty ones are not there."""

    plan: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    """mission table or schedule, shape (rows, columns)"""
    control: float = b.CONTROL_NONE
    """what the plan is: one of the block's CONTROL_*"""
    gains: Array | None = None
    """of a mission, shape (GAINS,)"""
    current: Array = dataclasses.field(default_factory=lambda: _NONE)
    """compiled current, see `Current.compile`"""
    density: Array = dataclasses.field(default_factory=lambda: _NONE)
    """compiled profile, see `DensityProfile.compile`"""
    temperature: Array = dataclasses.field(default_factory=lambda: _NONE)
    """likewise, of hulls that expand; see `DensityProfile.compile_temperature`"""
    floor: Array = dataclasses.field(default_factory=lambda: _NONE)
    """compiled sea floor, see `Floor.compile`"""

    @property
    def words(self) -> int:
        """Numbers of all tables."""
        sizes = (self.plan, self.current, self.density, self.temperature, self.floor)
        return sum(int(table.size) for table in sizes)


Plans = dict[tuple[int, int, Any], tuple[Array, Array]]
"""Compiled plans and gains by mission and believed vehicle (their `id`) and by place"""


def tables_of(scenario: Scenario, duration: float, plans: Plans | None = None) -> Tables:
    """The tables of a scenario that flies for `duration` [s]; reads gridded
    currents and bathymetry.

    Args:
      plans: of other scenarios that are still there; what they share is compiled once.

    Raises:
      MissionError, CurrentError, FloorError: the plan, the current or the sea floor does not do.
    """
    from twin.mission import Mission
    from twin.mission.controller import Schedule

    plan, control, gains = np.zeros((0, 0)), b.CONTROL_NONE, None
    if scenario.navigate is not None:
        pass  # its guidance sees what Python knows on board
    elif isinstance(scenario.mission, Mission):
        plans = {} if plans is None else plans
        believed = scenario.believed_vehicle
        key = id(scenario.mission), id(believed), scenario.place
        if key not in plans:
            plans[key] = scenario.mission_in_metres().compile(believed)
        plan, gains = plans[key]
        gains = gains.copy()
        gains[COMPASS_OFFSET] = scenario.compass_offset
        control = b.CONTROL_MISSION
    elif isinstance(scenario.mission, Schedule):
        scenario.mission.check(scenario.vehicle)
        plan, control = scenario.mission.table(), b.CONTROL_SCHEDULE
    current = density = temperature = _NONE
    if scenario.current is not None:
        current = scenario.current.compile(duration, scenario.place)
    if scenario.density is not None:
        density = scenario.density.compile()
        if scenario.vehicle.hull_thermal_expansion:
            temperature = scenario.density.compile_temperature()
    return Tables(
        plan=plan,
        control=control,
        gains=gains,
        current=current,
        density=density,
        temperature=temperature,
        floor=floor_table(scenario, duration),
    )


def floor_table(scenario: Scenario, duration: float) -> Array:
    """The scenario's sea floor, empty without one.

    Raises:
      FloorError: it cannot be read, or the mission does not begin above it.
    """
    if scenario.floor is None:
        return _NONE
    from twin.water.floor.lookup import floor_depth

    place = scenario.place if scenario.has_place else None
    table = scenario.floor.compile(duration, place)
    start, label = scenario.begin, "the mission starts"
    bottom = float(floor_depth(table, start.north, start.east))
    if bottom <= 0.0:
        other = scenario.floor.other_sense(duration, place)
        way = "depths downward" if other == "positive=down" else "heights upward"
        hint = f" (if the file counts {way}, say {other})" if other else ""
        raise FloorError(f"{label} on land, {-bottom:g} m above the sea: start elsewhere{hint}")
    if start.depth >= bottom:
        raise FloorError(
            f"{label} at a depth of {start.depth:g} m, where the sea floor is at {bottom:g} m: "
            "start higher up or elsewhere"
        )
    for segment in getattr(scenario.mission, "segments", ()):
        above = getattr(segment, "min_altitude_m", None)
        if above is not None and bottom <= segment.min_depth_m + above:
            raise FloorError(
                f"{label} where the sea is {bottom:g} m deep: dives from min_depth_m = "
                f"{segment.min_depth_m:g} m that turn min_altitude_m = {above:g} m above the floor "
                "have no room; start elsewhere, or lower one of the two"
            )
    return table
