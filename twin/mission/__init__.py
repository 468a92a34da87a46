"""Missions: what a glider is asked to fly, as dataclasses or TOML, checked and compiled."""

from twin.mission.glide import SteadyGlide, steady_glide
from twin.mission.plan import Mission
from twin.mission.segments import Hold, SawTooth, Segment, Spiral, Surface
from twin.mission.shipped import load_mission, mission_names

__all__ = [
    "Hold",
    "Mission",
    "SawTooth",
    "Segment",
    "Spiral",
    "SteadyGlide",
    "Surface",
    "load_mission",
    "mission_names",
    "steady_glide",
]
