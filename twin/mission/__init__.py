"""Missions: plans for a vehicle as dataclasses or TOML files, checked and compiled for guidance."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.mission.glide_balance import SteadyGlide as SteadyGlide
    from twin.mission.glide_balance import steady_glide as steady_glide
    from twin.mission.plan import Mission as Mission
    from twin.mission.plan import built_for as built_for
    from twin.mission.plan import check_depth as check_depth
    from twin.mission.segments import Circle as Circle
    from twin.mission.segments import Hold as Hold
    from twin.mission.segments import Hover as Hover
    from twin.mission.segments import LawnMower as LawnMower
    from twin.mission.segments import SawTooth as SawTooth
    from twin.mission.segments import Segment as Segment
    from twin.mission.segments import Spiral as Spiral
    from twin.mission.segments import Sticks as Sticks
    from twin.mission.segments import Surface as Surface
    from twin.mission.segments import Transect as Transect
    from twin.mission.segments import Waypoint as Waypoint
    from twin.mission.segments.base import SURFACED_MARGIN_M as SURFACED_MARGIN_M
    from twin.mission.shipped_missions import load_mission as load_mission
    from twin.mission.shipped_missions import load_mission_for as load_mission_for
    from twin.mission.shipped_missions import mission_names as mission_names
    from twin.mission.shipped_missions import shipped_vehicles as shipped_vehicles
    from twin.mission.slocum_behavior import degrees as degrees
    from twin.mission.slocum_mission import read_slocum as read_slocum
    from twin.mission.slocum_writer import degrees_minutes as degrees_minutes
    from twin.mission.slocum_writer import slocum_arguments as slocum_arguments
    from twin.mission.slocum_writer import waypoints_of as waypoints_of
    from twin.mission.way import way as track_to_follow  # noqa: F401

__getattr__, __dir__ = attach(__name__, places(__name__))
