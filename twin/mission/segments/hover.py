"""Hover: no thrust, the pump holds a depth and the battery the pitch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from twin.errors import MissionError
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import Segment, blank_row, command_of, limit
from twin.mission.segments.level import check_place
from twin.mission.way import reject_missing, standing_shift
from twin.numbers import Array
from twin.vehicle.parts import BatterySlide
from twin.vehicle.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class Hover(Segment):
    """Drift with the water at a depth, or at a height above the sea floor."""

    kind: ClassVar[str] = "hover"
    limits = ("duration_s",)

    depth_m: float | None = None
    """Depth to keep [m]; this or `altitude_m`."""
    altitude_m: float | None = None
    """Height above the sea floor to keep [m]; of runs with a sea floor."""
    pitch_deg: float = 0.0
    """Pitch to hold [deg], positive nose up; of vehicles that a battery pitches."""
    duration_s: float | None = None
    """Limit: time [s]."""

    def __post_init__(self) -> None:
        check_place(self.kind, self.depth_m, self.altitude_m)
        most = check.MAX_PITCH_DEG
        check.within(self.kind, "pitch_deg", self.pitch_deg, "deg", -most, most)
        check.optional(check.limit, self.kind, "duration_s", self.duration_s, "s")

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """A row with the pump's loop about neutral and the battery's about its standing shift.

        Raises:
          MissionError: the vehicle has no pump, its file no gains for it, or its battery cannot
            hold the pitch.
        """
        reject_missing(vehicle, label, self)
        if vehicle.steered("buoyancy") is None or vehicle.buoyancy_pid is None:
            lacks = "pump" if vehicle.steered("buoyancy") is None else "numeric 'buoyancy_pid'"
            raise MissionError(
                f"{label}: the file of vehicle {vehicle.name!r} has no {lacks}: nothing holds a "
                "depth without speed"
            )
        pitch = math.radians(self.pitch_deg)
        row = blank_row(vehicle)
        row[g.KIND] = g.HOVER
        row[g.DEPTH], row[g.ALTITUDE] = limit(self.depth_m), limit(self.altitude_m)
        row[g.MIN_DEPTH], row[g.LEVEL_PITCH] = 0.0, pitch
        row[g.DURATION] = limit(self.duration_s)
        slide = next(
            (p for p in map(vehicle.steered, ("trim", "pitch")) if isinstance(p, BatterySlide)),
            None,
        )
        if slide is None:
            if pitch:
                raise MissionError(
                    f"{label}: pitch_deg = {self.pitch_deg:g}: vehicle {vehicle.name!r} has no "
                    "battery that slides: leave pitch_deg out"
                )
            return row
        shift = standing_shift(vehicle, slide, pitch)
        if not slide.low <= shift <= slide.high:
            rule = (
                f"less (it needs the {slide.name} at {slide.text(shift)}, and vehicle "
                f"{vehicle.name!r} moves it from {slide.text(slide.low)} to "
                f"{slide.text(slide.high)})"
            )
            check.fail(label, "pitch_deg", self.pitch_deg, rule)
        command_of(vehicle, row, g.REST_COMMAND)[vehicle.part_names.index(slide.name)] = shift
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Its own clock."""
        assert self.duration_s is not None
        return self.duration_s, depth if self.depth_m is None else self.depth_m
