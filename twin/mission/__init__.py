"""Missions: what a glider is asked to fly, as dataclasses or TOML, checked and compiled."""

from twin.mission.glide_balance import SteadyGlide, steady_glide
from twin.mission.plan import Mission
from twin.mission.segments import (
    Circle,
    Hold,
    Hover,
    LawnMower,
    SawTooth,
    Segment,
    Spiral,
    Surface,
    Transect,
    Waypoint,
)
from twin.mission.shipped_missions import load_mission, mission_names

__all__ = [
    "Circle",
    "Hold",
    "Hover",
    "LawnMower",
    "Mission",
    "SawTooth",
    "Segment",
    "Spiral",
    "SteadyGlide",
    "Surface",
    "Transect",
    "Waypoint",
    "load_mission",
    "mission_names",
    "steady_glide",
]
