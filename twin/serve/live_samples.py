"""Live samples: a stepped vehicle's state as the topics of ROS are made of it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.geodesy import from_tangent_plane
from twin.numbers import Array
from twin.physics.true_signals import declare_parts
from twin.sensors.imu import Imu
from twin.serve.stepped_vehicle import SteppedVehicle


@dataclasses.dataclass
class LiveSamples:
    """One sample, the `twin.serve.ros_topics.Samples` of now.

    It has the truth alone: what was commanded comes from others, by topics of the same names.
    """

    flown: SteppedVehicle
    start: tuple[float, float]
    """Latitude and longitude [degree] of the flight's start, the origin of `map`"""
    gps_deviation: float | None = None
    imu: Imu | None = None
    logged: bool = False
    count: int = 1

    def __post_init__(self) -> None:
        declare_parts(self.flown.vehicle)
        self.imu_position = self.flown.vehicle.imu_position
        self.period = self.flown.timestep
        self.names: list[str] = []
        self.take(0)

    def take(self, moment: int) -> None:
        """Look at the vehicle.

        Args:
          moment: [ns] unix time of the sample.
        """
        now = self.flown.state()
        self._now = {name: value for name, value in now.items() if name.startswith("true_")}
        self.names = list(self._now)
        self.time: NDArray[np.int64] = np.array([moment])
        north, east = self.signal("true_north"), self.signal("true_east")
        self.latitude, self.longitude = from_tangent_plane(north, east, *self.start)

    def signal(self, name: str) -> Array:
        """A signal in a store's units, (1,)."""
        return np.array([self._now[name]])

    def track(self) -> tuple[Array, Array]:
        """North and east [m] from the start."""
        return self.signal("true_north"), self.signal("true_east")

    def fixes(self) -> tuple[Array, Array]:
        """The places: there are no fixes among truths."""
        return self.latitude, self.longitude
