"""The battery's iron: its field turns with the battery, seen in the compass of a level vehicle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.sensors import Compass
from twin.vehicle.vehicle import load_vehicle

FIELD_DEG = 5.0
"""[deg] strength of the battery's field: the horizontal field times this angle in radians"""


def deviation(axis: str, rotation_deg: float) -> float:
    """[deg] that a level vehicle heading north reads, its battery's field along one axis."""
    truth = {"true_roll": 0.0, "true_pitch": 0.0, "true_heading": 0.0, "true_shift": 0.0}
    truth["true_rotation"] = rotation_deg
    compass = Compass.ideal()
    drawn = dict.fromkeys(compass.draw(np.random.default_rng(0)), 0.0)
    drawn[f"compass_battery_{axis}_deg"] = FIELD_DEG
    out = compass.measure(
        {name: np.full(3, value) for name, value in truth.items()},
        dt=0.5, drawn=drawn, rng=np.random.default_rng(0),
    )  # fmt: skip
    return (out["measured_heading"][0] + 180.0) % 360.0 - 180.0


@pytest.mark.parametrize("rotation", [0.0, 30.0, -30.0, 90.0, -90.0])
def test_the_field_of_the_battery_turns_as_its_mass_does(rotation):
    """A positive rotation carries what was below to port, and what was starboard downwards.

    A field to starboard (y) turns the reading of a vehicle that heads north to the west. It is
    calibrated away at rotation 0, so only its change counts.
    """
    vehicle = load_vehicle("glider")
    below = vehicle.battery.position(0.0, math.radians(rotation))[1:] / vehicle.battery.eccentricity
    to_port, downwards = -below[0], below[1]
    strength = math.radians(FIELD_DEG)
    changes = {"x": 0.0, "y": downwards - 1.0, "z": -to_port}
    for axis, change in changes.items():
        expected = -math.degrees(math.atan(strength * change))
        assert deviation(axis, rotation) == pytest.approx(expected, abs=1e-9), axis
