"""The sea floor: flat, rough, an array of depths, or a bathymetry file about the mission's start.

A floor is met in three ways: the hull collides with it, altimeter and Doppler log see it, and
dives that are given a `min_altitude_m` turn above it.
"""

from __future__ import annotations

from twin.water.floor.base import FlatFloor, Floor
from twin.water.floor.bathymetry import Bathymetry, GridFloor
from twin.water.floor.rough import RoughFloor
from twin.water.floor.spec import floor_from_dict, parse_floor

__all__ = [
    "Bathymetry",
    "FlatFloor",
    "Floor",
    "GridFloor",
    "RoughFloor",
    "floor_from_dict",
    "parse_floor",
]
