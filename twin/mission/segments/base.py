"""Base of segments: their class, the table of types, and helpers that make a mission's rows.

Depths are m, positive down; pitch is a magnitude in deg (nose down in a dive, nose up in a
climb); headings are deg true; net mass is a magnitude in kg (heavy in a dive, light in a climb). A
segment ends at the first of its limits.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from twin import seams
from twin.mission import mission_file as g
from twin.numbers import Array
from twin.registry import Registry
from twin.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from twin.mission.way import Way


SURFACED_MARGIN_M = 0.5
"""[m] Margin added to half the hull's length: a vehicle that hangs at the surface by one end counts
as surfaced at any pitch, in spite of waves or a pressure offset of this size."""


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Base of all segments. A new type defines `kind`, `row` and `expected`."""

    kind: ClassVar[str] = ""
    """Name of the type in mission files."""
    limits: ClassVar[tuple[str, ...]] = ()
    """Fields that can end the segment, at least one of which it needs; none: it ends by itself."""

    @property
    def limited(self) -> bool:
        """True if the segment ends by itself."""
        return not self.limits or any(getattr(self, name) is not None for name in self.limits)

    def flown_as(self) -> tuple[Segment, ...]:
        """Segments that guidance flies instead, a row each; by default the segment itself."""
        return (self,)

    def placed(self, latitude: float, longitude: float) -> Segment:
        """Copy of the segment with every target in metres from an origin [degree]."""
        return self

    def begun_at(self, place: tuple[float, float]) -> Segment:
        """Copy of the segment that starts at a position, north and east [m], for `expected`."""
        return self

    def ends_at(self, place: tuple[float, float]) -> tuple[float, float]:
        """Position north and east [m] at which the segment ends: its target, or else `place`."""
        return place

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Row of guidance's table for `vehicle`, made from `blank_row`.

        Raises:
          MissionError: a value exceeds the vehicle's abilities; `label` names the segment.
        """
        raise NotImplementedError

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Upper estimate of the time [s] from `depth` [m], and the depth [m] where it may end.

        Raises:
          MissionError: as for `row`; or the time is unknown.
        """
        raise NotImplementedError

    @classmethod
    def flaw(cls, name: str) -> str:
        """Name what is missing in a type; empty if it is complete."""
        if not dataclasses.is_dataclass(cls):
            return "it lacks `@dataclass(frozen=True, kw_only=True)`: fields are keys of files"
        if cls.row is Segment.row and cls.flown_as is Segment.flown_as:
            return "it lacks the method `row`"
        return "it lacks the method `expected`" if cls.expected is Segment.expected else ""


def surfaced_depth(vehicle: Vehicle) -> float:
    """Depth [m] of the CB above which a vehicle counts as surfaced."""
    return 0.5 * vehicle.hull_length + SURFACED_MARGIN_M


def blank_row(vehicle: Vehicle) -> Array:
    """Row without limits, shape (SEGMENT_COLUMNS + 3 parts,), whose three commands are at rest."""
    row = np.full(g.SEGMENT_COLUMNS, np.nan)
    row[g.ABORT_DEPTH] = np.inf
    row[g.SURFACE_DEPTH] = surfaced_depth(vehicle)
    row[g.TURN_LIMIT] = 0.0
    row[g.DIVE_TURN] = row[g.CLIMB_TURN] = 1.0
    pitching = vehicle.steered("pitch")
    row[g.PITCH_LOW], row[g.PITCH_HIGH] = (
        (0.0, 0.0) if pitching is None else (pitching.low, pitching.high)
    )
    return np.concatenate([row, *[vehicle.rest] * 3])


def write_way(row: Array, which: int, way: Way, vehicle: Vehicle) -> None:
    """Write the horizontal speed of a steady motion into a row, for dead reckoning.

    `which`: DIVE_COMMAND, CLIMB_COMMAND or LEVEL_COMMAND.
    """
    climbs = which == g.CLIMB_COMMAND
    ahead = math.sqrt(max(way.speed**2 - way.vertical_speed**2, 0.0))
    row[g.CLIMB_SPEED if climbs else g.DIVE_SPEED] = ahead
    if vehicle.steered("speed") is None:
        row[g.CLIMB_ATTACK if climbs else g.DIVE_ATTACK] = way.angle_of_attack


def command_of(vehicle: Vehicle, row: Array, which: int) -> Array:
    """One of the row's three commands, shape (parts,), a view to write into."""
    first = g.SEGMENT_COLUMNS + which * len(vehicle.parts)
    return row[first : first + len(vehicle.parts)]


def limit(value: float | None) -> float:
    """Convert a limit to its number in a row: NaN for None."""
    return np.nan if value is None else float(value)


SEGMENTS: Registry[type[Segment]] = seams.SEGMENTS
"""All types of segment, by name."""

register = SEGMENTS.add
"""Register a type of your own; usable as a decorator."""
