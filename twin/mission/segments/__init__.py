"""Segments: the pieces of a mission, one file a kind."""

from twin.mission.segments.base import SEGMENTS as SEGMENTS
from twin.mission.segments.base import Segment as Segment
from twin.mission.segments.base import register as register
from twin.mission.segments.circle import Circle as Circle
from twin.mission.segments.hold import Hold as Hold
from twin.mission.segments.hover import Hover as Hover
from twin.mission.segments.lawn_mower import LawnMower as LawnMower
from twin.mission.segments.profile import Profile as Profile
from twin.mission.segments.saw_tooth import SawTooth as SawTooth
from twin.mission.segments.spiral import Spiral as Spiral
from twin.mission.segments.surface import Surface as Surface
from twin.mission.segments.transect import Transect as Transect
from twin.mission.segments.waypoint import Waypoint as Waypoint
