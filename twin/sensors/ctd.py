"""CTD and pressure gauge: pressure, depth from pressure, temperature, salinity and density.

`measured_pressure` is sea pressure with the gauge's errors: the integral of the true density
profile under the gravity of the mission's latitude, which grows with depth (TEOS-10).
`measured_depth` is computed as in the field, from pressure and latitude without density: TEOS-10's
`z_from_p` for a standard ocean of 0 degC and 35 g/kg (McDougall and Barker, 2011). It differs from
the true depth by the water column's dynamic height: in warm or fresh, hence lighter, water the
depth is too small. The vehicle itself flies under the constant gravity of its file.

The CTD's thermistor follows the water with a first-order lag. The wall of the conductivity cell
stores heat, so the cell's water is warmer or colder than the thermistor, which causes false
salinity in a thermocline. The conductivity is C(S, T - T_T, p) with the thermal anomaly T_T of
Lueck (1990), in the recursion of Lueck and Picklo (1990). Salinity and density are computed as in
the field, from the measured values and the gauge's pressure: PSS-78 and TEOS-10 through `gsw`. A
column that has only a density, such as `constant`, gives no CTD signals.

Accuracy and resolution: Sea-Bird Glider Payload CTD (product sheet of the Slocum Glider CTD).
Thermal mass: the SBE-41CP (Johnson, Toole and Larson, 2007), from which that CTD has evolved.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.numbers import Array, number
from twin.records.schema import Variable, variables
from twin.sensors.base import (
    Outset,
    Sensor,
    SensorRun,
    Signals,
    columns,
    drawn_value,
    normals,
    require_finite,
    require_non_negative,
    signal,
)
from twin.sensors.kernels import thermal_kernel

if TYPE_CHECKING:
    from twin.water.density import DensityProfile

STANDARD_OCEAN = "standard ocean"
"""Name of the water of 0 degC and 35 g/kg."""
MILLISIEMENS_PER_CM = 10.0
"""Conductivity of 1 S/m in mS/cm, the unit of `gsw`."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pressure(Sensor):
    """Errors of an OEM transducer (Druck and Keller sheets: 0.1 % of full scale, unverified).

    Both signals contain these errors, since depth follows from the measured pressure.
    """

    name = "pressure"
    reads = ("true_depth",)
    writes = variables("measured_pressure", "measured_depth")
    draws: ClassVar[Mapping[str, str]] = {"pressure_offset_dbar": "dbar", "pressure_gain": "1"}

    full_scale: float = 1000.0
    """[dbar] Full scale; the Sea-Wing is rated to 1000 m"""
    offset: float = 0.0005
    """[1] Standard deviation of the offset per mission, as a fraction of the full scale"""
    gain: float = 0.0005
    """[1] Standard deviation of the relative gain error per mission"""
    noise: float = 0.01
    """[dbar] White noise per sample: 0.01 m"""
    vehicle_density: float | str | None = STANDARD_OCEAN
    """Water for the depth from pressure. "standard ocean": TEOS-10 at the mission's latitude, as in
    OG1.0, basestation and the glider toolboxes. A density [kg/m3]: pressure over density and
    surface gravity. None: the true profile, without an error of density"""

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
        """Make a gauge of exact pressure and exact depth."""
        return cls(offset=0.0, gain=0.0, noise=0.0, vehicle_density=None)

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample the mission's zero offset [dbar] and gain error [1]."""
        return self.draw_normal(rng, (self.offset * self.full_scale, self.gain))

    def begin(self, outset: Outset) -> PressureRun:
        """Begin to measure measured_pressure [dbar] (gauge) and measured_depth [m]."""
        from twin.water.density import DensityProfile

        around = outset.surroundings
        offset, gain = (drawn_value(outset.drawn, name) for name in self.draws)
        exact = self.noise == 0.0 and offset == 0.0 and gain == 0.0
        return PressureRun(
            gauge=self,
            density=DensityProfile.constant() if around.density is None else around.density,
            latitude=around.latitude,
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
    """Standard normals, (n,); None: the gauge is exact."""

    @functools.cached_property
    def _pressure(self) -> Callable[[Array], Array]:
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ctd(Sensor):
    """Errors and lags of a pumped CTD; the offsets are sampled once per mission."""

    name = "ctd"
    reads = ("true_depth", "measured_pressure")
    reads_if_there = ("true_temperature", "true_salinity", "true_density")
    writes = variables(
        "measured_temperature", "measured_salinity", "measured_density", "measured_conductivity"
    )
    draws: ClassVar[Mapping[str, str]] = {
        "ctd_temperature_offset": "degree_Celsius", "ctd_conductivity_offset": "S m-1",
    }  # fmt: skip
    ideal_is_truth = True

    temperature_offset: float = 0.001
    """[degree_Celsius] Standard deviation: the data sheet's +-0.002, taken as two sigma"""
    conductivity_offset: float = 0.00015
    """[S/m] Standard deviation: the data sheet's +-0.0003, taken as two sigma"""
    temperature_resolution: float = 0.001
    """[degree_Celsius] Step of the readings; 0 is continuous"""
    conductivity_resolution: float = 0.00001
    """[S/m] Step of the readings; 0 is continuous"""
    temperature_lag: float = 0.5
    """[s] Lag of the thermistor; our estimate, such thermistors take less than 1 s"""
    thermal_amplitude: float = 0.141
    """[1] Amplitude of the cell's thermal anomaly; 0: none"""
    thermal_time: float = 6.89
    """[s] Time in which the cell's anomaly decays"""

    def __post_init__(self) -> None:
        names = [field.name for field in dataclasses.fields(self)]
        require_non_negative(self, *names)
        require_finite(self, *names)

    @classmethod
    def ideal(cls) -> Ctd:
        """Make a CTD that reads the water's own temperature, salinity and density."""
        return cls(**dict.fromkeys((field.name for field in dataclasses.fields(cls)), 0.0))

    def channels(self, signals: Iterable[str]) -> tuple[Variable, ...]:
        """Variables: all if the water has temperature and salinity, else none."""
        return self.writes if set(self.reads_if_there) <= set(signals) else ()

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample the mission's errors of temperature [degree_Celsius] and conductivity [S/m]."""
        return self.draw_normal(rng, (self.temperature_offset, self.conductivity_offset))

    def begin(self, outset: Outset) -> CtdRun:
        """Begin to measure measured_temperature [degree_Celsius], measured_salinity [1],
        measured_density [kg m-3] and measured_conductivity [S m-1]."""
        from twin.water.density import DensityProfile

        around = outset.surroundings
        return CtdRun(
            ctd=self,
            dt=outset.dt,
            offsets=tuple(drawn_value(outset.drawn, name) for name in self.draws),
            pressure=(around.density or DensityProfile.constant()).pressure_integral(
                around.latitude
            ),
            place=(around.longitude, around.latitude),
        )


@dataclasses.dataclass
class CtdRun(SensorRun):
    """A CTD in one mission."""

    ctd: Ctd
    dt: float
    offsets: tuple[float, ...]
    """Offsets of temperature [degree_Celsius] and conductivity [S/m]."""
    pressure: Callable[[Array], Array]
    """Function of the pressure [dbar] at a depth [m]."""
    place: tuple[float, float]
    """[deg] Longitude and latitude."""
    carried: Array = dataclasses.field(default_factory=lambda: np.full(3, np.nan))
    """[degree_Celsius] Temperatures of water and thermistor, and the cell's anomaly."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        import gsw

        its, span = self.ctd, slice(first, last)
        if not its.channels(signals):
            return {}
        temperature, salinity = columns(signals, its.reads_if_there[:2], span)
        pressure = self.pressure(signal(signals, "true_depth")[span])
        thermistor, cell = np.empty_like(temperature), np.empty_like(temperature)
        thermal_kernel(
            temperature, self.dt, its.temperature_lag, its.thermal_amplitude, its.thermal_time,
            self.carried, thermistor, cell,
        )  # fmt: skip
        thermistor += self.offsets[0]
        conductivity = gsw.C_from_SP(salinity, cell, pressure) / MILLISIEMENS_PER_CM
        conductivity += self.offsets[1]
        shown = _rounded(thermistor, its.temperature_resolution)
        conductivity = _rounded(conductivity, its.conductivity_resolution)
        gauge = signal(signals, "measured_pressure")[span]
        practical = gsw.SP_from_C(conductivity * MILLISIEMENS_PER_CM, shown, gauge)
        absolute = gsw.SA_from_SP(practical, gauge, *self.place)
        density = gsw.rho_t_exact(absolute, shown, gauge)
        made = (shown, practical, density, conductivity)
        return dict(zip((v.name for v in its.writes), made, strict=True))


def _rounded(values: Array, step: float) -> Array:
    """Round to the nearest multiple of a step; 0 leaves the values unchanged."""
    return np.rint(values / step) * step if step > 0.0 else values
