"""Sensors: seeded models that turn a mission's truth into what its devices would have logged."""

from twin.sensors.attitude import Attitude
from twin.sensors.compass import COMPASS_PRESETS, Compass
from twin.sensors.dvl import Dvl
from twin.sensors.encoders import Encoders
from twin.sensors.gps import Gps
from twin.sensors.imu import IMU_PRESETS, Imu
from twin.sensors.onboard import Onboard, OnboardTrack
from twin.sensors.pressure import Pressure
from twin.sensors.suite import (
    DRAWN_UNITS,
    MEASURED_SIGNALS,
    SUITE_PRESETS,
    TRUTH_SIGNALS,
    SensorSuite,
)

__all__ = [
    "COMPASS_PRESETS",
    "DRAWN_UNITS",
    "IMU_PRESETS",
    "MEASURED_SIGNALS",
    "SUITE_PRESETS",
    "TRUTH_SIGNALS",
    "Attitude",
    "Compass",
    "Dvl",
    "Encoders",
    "Gps",
    "Imu",
    "Onboard",
    "OnboardTrack",
    "Pressure",
    "SensorSuite",
]
