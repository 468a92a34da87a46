"""Segments: parts of a mission, such as a saw-tooth, a transect or a stay at the surface."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.mission.segments.base import SEGMENTS as SEGMENTS
    from twin.mission.segments.base import Segment as Segment
    from twin.mission.segments.base import register as register
    from twin.mission.segments.level import Circle as Circle
    from twin.mission.segments.level import LawnMower as LawnMower
    from twin.mission.segments.level import Transect as Transect
    from twin.mission.segments.pose import Mow as Mow
    from twin.mission.segments.pose import Orbit as Orbit
    from twin.mission.segments.pose import Pose as Pose
    from twin.mission.segments.pose import Sticks as Sticks
    from twin.mission.segments.profile import Profile as Profile
    from twin.mission.segments.profile import SawTooth as SawTooth
    from twin.mission.segments.profile import Spiral as Spiral
    from twin.mission.segments.station import Hold as Hold
    from twin.mission.segments.station import Hover as Hover
    from twin.mission.segments.station import Surface as Surface
    from twin.mission.segments.waypoint import Waypoint as Waypoint

__getattr__, __dir__ = attach(__name__, places(__name__))
