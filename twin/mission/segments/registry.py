"""The registry of mission segments, and what a kind must have to be one."""

from __future__ import annotations

import dataclasses

from twin.errors import MissionError
from twin.mission.segments.base import Segment
from twin.registry import Registry, self_named


def _lacks(kind: type[Segment]) -> str:
    """What a kind of segment lacks."""
    if not dataclasses.is_dataclass(kind):
        return "`@dataclass(frozen=True, kw_only=True)`: its fields are the keys of mission files"
    if kind.row is Segment.row and kind.flown_as is Segment.flown_as:
        return "the method `row`"
    if kind.expected is Segment.expected:
        return "the method `expected`"
    return ""


SEGMENTS: Registry[type[Segment]] = Registry(
    "kind of segment",
    group="glider_twin.segments",
    shipped={
        "saw-tooth": "twin.mission.segments.saw_tooth:SawTooth",
        "spiral": "twin.mission.segments.spiral:Spiral",
        "transect": "twin.mission.segments.transect:Transect",
        "circle": "twin.mission.segments.circle:Circle",
        "lawn-mower": "twin.mission.segments.lawn_mower:LawnMower",
        "hover": "twin.mission.segments.hover:Hover",
        "waypoint": "twin.mission.segments.waypoint:Waypoint",
        "surface": "twin.mission.segments.surface:Surface",
        "hold": "twin.mission.segments.hold:Hold",
    },
    check=self_named("kind of segment", Segment, _lacks, MissionError),
    name="kind",
)
"""Every kind of segment, by name."""

register = SEGMENTS.add
"""Add a kind of one's own; usable as a decorator."""
