"""Pressure: the gauge, and the depth that the vehicle makes of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.records.schema import variables
from twin.sensors.base import NOWHERE, Sensor, Surroundings
from twin.sensors.checks import Drawn, Signals, drawn_value, require_non_negative, signal
from twin.sensors.noise import normals


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pressure(Sensor):
    """Errors of an OEM transducer (Druck and Keller sheets: 0.1 % of full scale, unverified).

    The true pressure is the integral of the true density profile. The vehicle divides by one
    density and the gravity of the mission's latitude, as gliders do.
    """

    name = "pressure"
    reads = ("true_depth",)
    writes = variables("measured_pressure", "measured_depth")
    draws: ClassVar[Mapping[str, str]] = {"pressure_offset_dbar": "dbar", "pressure_gain": "1"}

    full_scale: float = 1000.0
    """[dbar]; the Sea-Wing is rated to 1000 m"""
    offset: float = 0.0005
    """[1] of full scale, standard deviation per mission"""
    gain: float = 0.0005
    """[1] relative, standard deviation per mission"""
    noise: float = 0.01
    """[dbar] white, per sample: 0.01 m"""
    vehicle_density: float | None = 1025.0
    """[kg/m3] that the vehicle assumes; none: it knows the profile and adds no density error"""

    def __post_init__(self) -> None:
        require_non_negative(self, "full_scale", "offset", "gain", "noise")
        if self.vehicle_density is not None and not 900.0 <= self.vehicle_density <= 1100.0:
            raise InputError(
                f"Pressure.vehicle_density is {self.vehicle_density:g} kg/m3: give 900 to 1100"
            )

    @classmethod
    def ideal(cls) -> Pressure:
        """Exact pressure and exact depth."""
        return cls(offset=0.0, gain=0.0, noise=0.0, vehicle_density=None)

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """The mission's zero offset [dbar] and gain error [1]."""
        unit = rng.standard_normal(2)
        return {
            "pressure_offset_dbar": float(self.offset * self.full_scale * unit[0]),
            "pressure_gain": float(self.gain * unit[1]),
        }

    def measure(
        self,
        signals: Signals,
        *,
        dt: float,
        drawn: Drawn,
        rng: np.random.Generator,
        surroundings: Surroundings = NOWHERE,
    ) -> dict[str, NDArray[Any]]:
        """measured_pressure [dbar] (gauge) and measured_depth [m]."""
        from twin.water.density import PASCAL_PER_DBAR, DensityProfile, gravity

        density, latitude = surroundings.density, surroundings.latitude
        if density is None:
            density = DensityProfile.constant()
        depth = signal(signals, "true_depth")
        pressure = density.pressure(depth, latitude=latitude)
        offset, gain = (
            drawn_value(drawn, "pressure_offset_dbar"),
            drawn_value(drawn, "pressure_gain"),
        )
        if self.noise == 0.0 and offset == 0.0 and gain == 0.0:
            measured = pressure
        else:
            measured = pressure * (1.0 + gain) + offset
            measured += self.noise * normals(rng, depth.shape[0])
        if self.vehicle_density is not None:
            metres = measured * (
                PASCAL_PER_DBAR / (self.vehicle_density * float(gravity(latitude)))
            )
        elif measured is pressure:
            metres = depth
        else:
            weight = density.density(depth) * gravity(latitude, depth)
            metres = depth + (measured - pressure) * PASCAL_PER_DBAR / weight
        return {"measured_pressure": measured, "measured_depth": metres}
