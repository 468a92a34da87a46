"""Segments: the pieces of a mission, one file a kind."""

from twin.mission.segments.base import SEGMENTS, Segment, register
from twin.mission.segments.circle import Circle
from twin.mission.segments.hold import Hold
from twin.mission.segments.hover import Hover
from twin.mission.segments.lawn_mower import LawnMower
from twin.mission.segments.profile import Profile
from twin.mission.segments.saw_tooth import SawTooth
from twin.mission.segments.spiral import Spiral
from twin.mission.segments.surface import Surface
from twin.mission.segments.transect import Transect
from twin.mission.segments.waypoint import Waypoint

__all__ = [
    "SEGMENTS",
    "Circle",
    "Hold",
    "Hover",
    "LawnMower",
    "Profile",
    "SawTooth",
    "Segment",
    "Spiral",
    "Surface",
    "Transect",
    "Waypoint",
    "register",
]
