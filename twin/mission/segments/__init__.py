"""Segments: the pieces of a mission, one file a kind."""

from twin.mission.segments.base import Segment
from twin.mission.segments.hold import Hold
from twin.mission.segments.profile import Profile
from twin.mission.segments.registry import SEGMENTS, register
from twin.mission.segments.saw_tooth import SawTooth
from twin.mission.segments.spiral import Spiral
from twin.mission.segments.surface import Surface

__all__ = ["SEGMENTS", "Hold", "Profile", "SawTooth", "Segment", "Spiral", "Surface", "register"]
