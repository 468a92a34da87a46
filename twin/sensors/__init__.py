"""Sensors: seeded models that compute the readings of a mission's instruments from its truth.

Your own sensor is one file: see docs/reference/sensors.md and `register`.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.sensors.ahrs import COMPASS_PRESETS as COMPASS_PRESETS
    from twin.sensors.ahrs import Attitude as Attitude
    from twin.sensors.ahrs import Compass as Compass
    from twin.sensors.altimeter import Altimeter as Altimeter
    from twin.sensors.base import SENSORS as SENSORS
    from twin.sensors.base import Outset as Outset
    from twin.sensors.base import Sensor as Sensor
    from twin.sensors.base import Surroundings as Surroundings
    from twin.sensors.base import register as register
    from twin.sensors.base import require_non_negative as require_non_negative
    from twin.sensors.base import require_positive as require_positive
    from twin.sensors.ctd import Ctd as Ctd
    from twin.sensors.ctd import Pressure as Pressure
    from twin.sensors.dvl import MODES as DVL_MODES  # noqa: F401
    from twin.sensors.dvl import Dvl as Dvl
    from twin.sensors.encoders import Encoders as Encoders
    from twin.sensors.gps import Gps as Gps
    from twin.sensors.imu import IMU_PRESETS as IMU_PRESETS
    from twin.sensors.imu import Imu as Imu
    from twin.sensors.onboard import Onboard as Onboard
    from twin.sensors.onboard import OnboardTrack as OnboardTrack
    from twin.sensors.suite import SUITE_PRESETS as SUITE_PRESETS
    from twin.sensors.suite import SensorSuite as SensorSuite

__getattr__, __dir__ = attach(__name__, places(__name__))
