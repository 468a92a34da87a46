"""Sensors: seeded models that turn a mission's truth into what its devices would have logged.

A sensor of one's own is one file: see docs/reference/sensors.md and `register`.
"""

from twin.sensors.altimeter import Altimeter
from twin.sensors.attitude import Attitude
from twin.sensors.base import SENSORS, Sensor, Surroundings, register
from twin.sensors.compass import COMPASS_PRESETS, Compass
from twin.sensors.ctd import Ctd
from twin.sensors.dvl import Dvl
from twin.sensors.encoders import Encoders
from twin.sensors.gps import Gps
from twin.sensors.imu import IMU_PRESETS, Imu
from twin.sensors.onboard import Onboard, OnboardTrack
from twin.sensors.pressure import Pressure
from twin.sensors.suite import SUITE_PRESETS, SensorSuite

__all__ = [
    "COMPASS_PRESETS",
    "IMU_PRESETS",
    "SENSORS",
    "SUITE_PRESETS",
    "Altimeter",
    "Attitude",
    "Compass",
    "Ctd",
    "Dvl",
    "Encoders",
    "Gps",
    "Imu",
    "Onboard",
    "OnboardTrack",
    "Pressure",
    "Sensor",
    "SensorSuite",
    "Surroundings",
    "register",
]
