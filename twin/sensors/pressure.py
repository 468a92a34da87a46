"""Pressure: the gauge, and the depth that is made of it.

`measured_pressure` is sea pressure: the integral of the true density profile under the gravity of
the mission's latitude, which grows with depth (TEOS-10), and the gauge's errors. `measured_depth`
is the depth that the field makes of it with what is known on board, latitude and no density:
TEOS-10's `z_from_p`, whose water is standard ocean of 0 degC and 35 g/kg (McDougall and Barker,
2011). It differs from the true geometric depth by the water column's dynamic height: warm or fresh
water is lighter, presses less, and looks shallower than it is. The vehicle itself flies under the
one gravity of its file.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.numbers import number
from twin.records.schema import variables
from twin.sensors.base import Outset, Sensor, SensorRun
from twin.sensors.checks import Signals, drawn_value, require_non_negative, signal
from twin.sensors.noise import normals

if TYPE_CHECKING:
    from twin.water.density import DensityProfile

STANDARD_OCEAN = "standard ocean"
"""Of 0 degC and 35 g/kg"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pressure(Sensor):
    """Errors of an OEM transducer (Druck and Keller sheets: 0.1 % of full scale, unverified).

    Both signals have them: depth follows from the measured pressure.
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
    vehicle_density: float | str | None = STANDARD_OCEAN
    """What depth is made with: "standard ocean" by TEOS-10's at the mission's latitude, as OG1.0,
    basestation and the glider toolboxes do it; a density [kg/m3] by pressure over density and
    surface gravity; none by the true profile, without an error of density"""

    def __post_init__(self) -> None:
        require_non_negative(self, "full_scale", "offset", "gain", "noise")
        density = self.vehicle_density
        if isinstance(density, str):
            if density != STANDARD_OCEAN:
                raise InputError(
                    f"Pressure.vehicle_density is {density!r}: give {STANDARD_OCEAN!r}, a density "
                    "in kg/m3, or None"
                )
        elif density is not None:
            value = number(density, "Pressure.vehicle_density [kg/m3]")
            if not 900.0 <= value <= 1100.0:
                raise InputError(f"Pressure.vehicle_density is {value:g} kg/m3: give 900 to 1100")

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

    def begin(self, outset: Outset) -> PressureRun:
        """measured_pressure [dbar] (gauge) and measured_depth [m]."""
        from twin.water.density import DensityProfile

        density = outset.surroundings.density
        offset, gain = (
            drawn_value(outset.drawn, "pressure_offset_dbar"),
            drawn_value(outset.drawn, "pressure_gain"),
        )
        exact = self.noise == 0.0 and offset == 0.0 and gain == 0.0
        return PressureRun(
            gauge=self,
            density=DensityProfile.constant() if density is None else density,
            latitude=outset.surroundings.latitude,
            offset=offset,
            gain=gain,
            white=None if exact else normals(outset.rng, outset.samples),
        )


@dataclasses.dataclass
class PressureRun(SensorRun):
    """A gauge in one mission."""

    gauge: Pressure
    density: DensityProfile
    latitude: float
    offset: float
    gain: float
    white: NDArray[np.float32] | None
    """standard normals, (n,); None: the gauge is exact"""

    @functools.cached_property
    def _pressure(self) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
        return self.density.pressure_integral(self.latitude)

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        from twin.water.density import PASCAL_PER_DBAR, gravity

        depth = signal(signals, "true_depth")[first:last]
        pressure = measured = self._pressure(depth)
        if self.white is not None:
            measured = pressure * (1.0 + self.gain) + self.offset
            measured += self.gauge.noise * self.white[first:last]
        density = self.gauge.vehicle_density
        if isinstance(density, str):
            import gsw

            metres = -gsw.z_from_p(measured, self.latitude)
        elif density is not None:
            metres = measured * (PASCAL_PER_DBAR / (density * float(gravity(self.latitude))))
        elif measured is pressure:
            metres = depth
        else:
            weight = self.density.density(depth) * gravity(self.latitude, depth)
            metres = depth + (measured - pressure) * PASCAL_PER_DBAR / weight
        return {"measured_pressure": measured, "measured_depth": metres}
