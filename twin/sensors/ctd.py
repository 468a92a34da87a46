"""CTD: temperature, conductivity, salinity and density, with the instrument's lags.

The thermistor follows the water with a first-order lag. The wall of the conductivity cell keeps
the heat of the water before, so that the cell holds water of another temperature than the
thermistor's and salinity spikes in a thermocline: C(S, T - T_T, p) with the thermal anomaly T_T of
Lueck (1990), in the recursion of Lueck and Picklo (1990). Salinity and density are then computed
from what was measured, pressure by the vehicle's gauge, as the field does: PSS-78 and TEOS-10
through `gsw`.

It measures where the water column has temperature and salinity: a profile of `thermocline`, or a
cast with both. Where a column has only density, such as `constant`, there is no CTD: no signal.

Accuracy and resolution: Sea-Bird Glider Payload CTD (product sheet of the Slocum Glider CTD).
Thermal mass: the SBE-41CP (Johnson, Toole and Larson, 2007), from which that CTD has evolved.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.records.schema import Variable, variables
from twin.sensors.base import NOWHERE, Outset, Sensor, SensorRun, Surroundings
from twin.sensors.checks import (
    Drawn,
    Signals,
    drawn_value,
    require_finite,
    require_non_negative,
    signal,
)

MILLISIEMENS_PER_CM = 10.0
"""of one S/m, the unit of `gsw`"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ctd(Sensor):
    """Errors and lags of a pumped CTD; the zero errors are drawn once per mission."""

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
    """[degree_Celsius] standard deviation: the sheet's +-0.002 read as two sigma"""
    conductivity_offset: float = 0.00015
    """[S/m] standard deviation: the sheet's +-0.0003 read as two sigma"""
    temperature_resolution: float = 0.001
    """[degree_Celsius] a reading is the nearest multiple; 0 is continuous"""
    conductivity_resolution: float = 0.00001
    """[S/m] likewise"""
    temperature_lag: float = 0.5
    """[s] of the thermistor; ours, such thermistors take less than 1 s"""
    thermal_amplitude: float = 0.141
    """[1] of the cell's thermal anomaly; 0: none"""
    thermal_time: float = 6.89
    """[s] in which the anomaly decays"""

    def __post_init__(self) -> None:
        names = [field.name for field in dataclasses.fields(self)]
        require_non_negative(self, *names)
        require_finite(self, *names)

    @classmethod
    def ideal(cls) -> Ctd:
        """The water's own temperature, salinity and density."""
        return cls(**dict.fromkeys((field.name for field in dataclasses.fields(cls)), 0.0))

    def channels(self, signals: Iterable[str]) -> tuple[Variable, ...]:
        """All, where the water has temperature and salinity; else none."""
        return self.writes if set(self.reads_if_there) <= set(signals) else ()

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """The mission's zero errors of temperature [degree_Celsius] and conductivity [S/m]."""
        spread = (self.temperature_offset, self.conductivity_offset)
        return self.draw_normal(rng, spread)

    def measure(
        self,
        signals: Signals,
        *,
        dt: float,
        drawn: Drawn,
        rng: np.random.Generator,
        surroundings: Surroundings = NOWHERE,
    ) -> dict[str, NDArray[Any]]:
        """See `begin`; nothing where the signals have no temperature and salinity."""
        if not self.channels(signals):
            return {}
        return super().measure(signals, dt=dt, drawn=drawn, rng=rng, surroundings=surroundings)

    def begin(self, outset: Outset) -> CtdRun:
        """measured_temperature [degree_Celsius], measured_salinity [1], measured_density [kg m-3],
        measured_conductivity [S m-1].
        """
        from twin.water.density import DensityProfile

        water = outset.surroundings.density or DensityProfile.constant()
        return CtdRun(
            ctd=self,
            dt=outset.dt,
            offsets=tuple(drawn_value(outset.drawn, name) for name in self.draws),
            pressure=water.pressure_integral(outset.surroundings.latitude),
            latitude=outset.surroundings.latitude,
            longitude=outset.surroundings.longitude,
        )


@dataclasses.dataclass
class CtdRun(SensorRun):
    """A CTD in one mission."""

    ctd: Ctd
    dt: float
    offsets: tuple[float, ...]
    """of temperature [degree_Celsius] and conductivity [S/m]"""
    pressure: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    """[dbar] at a depth [m]"""
    latitude: float
    longitude: float
    carried: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.full(3, np.nan))
    """water, thermistor and the cell's anomaly [degree_Celsius]"""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        import gsw

        from twin.sensors.kernels import thermal_kernel

        its, span = self.ctd, slice(first, last)
        temperature, salinity = (signal(signals, name)[span] for name in its.reads_if_there[:2])
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
        absolute = gsw.SA_from_SP(practical, gauge, self.longitude, self.latitude)
        density = gsw.rho_t_exact(absolute, shown, gauge)
        made = (shown, practical, density, conductivity)
        return dict(zip((v.name for v in its.writes), made, strict=True))


def _rounded(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """The nearest multiples of a step; 0 leaves them as they are."""
    return np.rint(values / step) * step if step > 0.0 else values
