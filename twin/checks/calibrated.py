"""Calibrated: what a vehicle's file says of the sensors and the hull that made a log."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]


class Calibrated(Protocol):
    """A vehicle and the errors of its sensors, as `twin.identify.Calibration` has them."""

    @property
    def vehicle(self) -> Vehicle:
        """What is flown."""

    @property
    def thermal_expansion(self) -> float:
        """[1/K] of the hull's volume."""

    @property
    def thermal_lag(self) -> float:
        """[s] of the hull's temperature behind the water's."""

    def true_pitch(self, measured: Array) -> Array:
        """Pitch [rad] of the hull, from the sensor's [rad]."""

    def true_heading(self, measured: Array) -> Array:
        """Heading [rad] of the hull, from the compass' [rad]."""

    def sea_density(self, depth: Array) -> Array:
        """In-situ density [kg/m3] at a depth [m] where the log has none."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Uncalibrated:
    """A vehicle whose sensors are taken as exact and whose hull does not swell."""

    vehicle: Vehicle
    thermal_expansion: float = 0.0
    """[1/K]"""
    thermal_lag: float = 1.0
    """[s]"""

    def true_pitch(self, measured: Array) -> Array:
        """As measured."""
        return measured

    def true_heading(self, measured: Array) -> Array:
        """As measured."""
        return measured

    def sea_density(self, depth: Array) -> Array:
        """The reference density of the vehicle's file at every depth."""
        return np.full(np.shape(depth), self.vehicle.reference_density)
