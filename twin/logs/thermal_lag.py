"""Thermal lag of a conductivity cell: temperature error, its fit, and the corrected CTD data.

Conductivity is measured inside a cell whose walls exchange heat with the water. Salinity comes from
this conductivity and the temperature outside, and so spikes where temperature changes: too fresh
in one direction through a thermocline, too salty in the other. Morison et al. (1994, J. Atmos.
Oceanic Technol. 11, 1151) filter the temperature to that of the cell with two parameters. Garau et
al. (2011, J. Atmos. Oceanic Technol. 28, 1065) fit them to a glider's descents and climbs, whose
temperature and salinity should lie on one curve.

`CtdSeries` holds a dive's CTD and gives conductivity, density and the corrected salinity.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter

Array = NDArray[np.float64]

LARGEST_AMPLITUDE = 0.5
"""[1] Largest alpha of a cell: unpumped cells have up to 0.3 (Garau et al. 2011)."""
SHORTEST, LONGEST = 2.0, 25.0
"""[s] Limits of tau; published values are 5 to 25 s."""
FIRST_GUESS = (0.03, 10.0)
"""Alpha [1] and tau [s] at which the fit starts; Sea-Bird gives 0.06 and 10 s for the GPCTD"""
LEAST_RANGE = 1.0
"""[K] Temperature range that a descent and a climb must share; a smaller range shows no lag."""
LEAST_PAIRS = 3
"""Minimum number of pairs of a descent and a climb for a fit"""
MOST_PAIRS = 80
"""Maximum number of pairs that are compared, evenly chosen; more pairs do not change the result"""
LEVELS = 50
"""Number of temperatures at which a descent and a climb are compared"""
LEAST_GAIN = 0.05
"""[1] Smallest relative reduction of the difference of descents and climbs that accepts a lag."""
NUDGE = 0.01
"""[K] Temperature step for the derivative of salinity"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ThermalLag:
    """Parameters of a cell's thermal lag."""

    amplitude: float
    """[1] alpha: initial error of the cell's temperature, relative to a step of temperature"""
    time: float
    """[s] tau: time constant with which the error decays"""

    def excess(self, temperature: Array, period: float) -> Array:
        """Temperature outside minus that in the cell [K], (time,); Morison et al. (1994), eq. 5-7.

        Args:
          temperature: [degree_Celsius] without gaps, (time,).
          period: [s] between samples.
        """
        nyquist = 0.5 / period
        a = 4.0 * nyquist * self.amplitude * self.time / (1.0 + 4.0 * nyquist * self.time)
        b = 1.0 - 2.0 * a / self.amplitude if self.amplitude > 0.0 else 0.0
        steps = np.diff(temperature, prepend=temperature[:1])
        return np.asarray(lfilter([a], [1.0, b], steps))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cast:
    """One descent or climb through the water column; arrays are (time,), without gaps."""

    period: float
    """[s] Time between samples"""
    temperature: Array
    """[degree_Celsius] Temperature of the whole dive, since the lag depends on earlier samples"""
    salinity: Array
    """Practical salinity of the whole dive, as stored"""
    slope: Array
    """[1/K] Derivative of salinity with respect to temperature at constant conductivity"""
    part: slice
    """Samples of the cast within the dive"""


def fit_thermal_lag(pairs: Sequence[tuple[Cast, Cast]]) -> ThermalLag | None:
    """Fit the lag that minimises the difference of descents and climbs; None if no lag reduces it.

    Args:
      pairs: a descent and the climb before or after it.
    """
    able = [pair for pair in pairs if _shared(*pair) is not None]
    if len(able) < LEAST_PAIRS:
        return None
    chosen = [able[k] for k in np.unique(np.linspace(0, len(able) - 1, MOST_PAIRS).astype(int))]
    before = _difference(chosen, None)
    found = minimize(
        lambda x: _difference(chosen, _lag(x)),
        np.log(FIRST_GUESS),
        method="Nelder-Mead",
        options={"xatol": 0.02, "fatol": 1e-4 * before, "maxfev": 120},
    )
    return _lag(found.x) if found.fun < (1.0 - LEAST_GAIN) * before else None


def _lag(x: Array) -> ThermalLag:
    amplitude, time = np.exp(x)
    return ThermalLag(
        amplitude=float(min(amplitude, LARGEST_AMPLITUDE)),
        time=float(np.clip(time, SHORTEST, LONGEST)),
    )


def _shared(one: Cast, other: Cast) -> Array | None:
    """Temperatures that both casts passed, without the ends; None if they share too few."""
    a, b = one.temperature[one.part], other.temperature[other.part]
    low, high = max(a.min(), b.min()), min(a.max(), b.max())
    if high - low < LEAST_RANGE:
        return None
    margin = 0.05 * (high - low)
    return np.linspace(low + margin, high - margin, LEVELS)


def _difference(pairs: Sequence[tuple[Cast, Cast]], lag: ThermalLag | None) -> float:
    """Mean difference of the two salinities at equal temperature, over all pairs."""
    apart = []
    for pair in pairs:
        levels = _shared(*pair)
        assert levels is not None
        curves = []
        for cast in pair:
            salinity = cast.salinity
            if lag is not None:
                # the cell's temperature is that outside minus the excess
                salinity = salinity - cast.slope * lag.excess(cast.temperature, cast.period)
            order = np.argsort(cast.temperature[cast.part], kind="stable")
            curves.append(
                np.interp(levels, cast.temperature[cast.part][order], salinity[cast.part][order])
            )
        apart.append(np.abs(curves[0] - curves[1]))
    return float(np.mean(apart))


MS_PER_CM = 10.0
"""Conductivity of 1 S/m in mS/cm, the unit of gsw"""
LEAST_CAST = 10.0
"""[m] Depth range of a descent or climb that is compared"""
LEAST_SAMPLES = 10
"""Minimum number of samples of a cast"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CtdSeries:
    """CTD samples of a dive, each (time,), NaN where the CTD gave none."""

    period: float
    """[s] Time between samples"""
    depth: Array
    """[m]"""
    pressure: Array
    """[dbar]"""
    temperature: Array
    """[degree_Celsius]"""
    salinity: Array
    """Practical salinity"""
    latitude: float
    """[degree]"""
    longitude: float
    """[degree]"""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Samples at which the CTD measured."""
        return np.isfinite(self.temperature) & np.isfinite(self.salinity) & np.isfinite(self.depth)

    @property
    def conductivity(self) -> Array:
        """[S/m] Measured conductivity, computed back from the stored salinity and temperature."""
        import gsw

        return np.asarray(gsw.C_from_SP(self.salinity, self.temperature, self.pressure)) / MS_PER_CM

    @property
    def density(self) -> Array:
        """[kg/m3] In-situ density, TEOS-10."""
        import gsw

        absolute = gsw.SA_from_SP(self.salinity, self.pressure, self.longitude, self.latitude)
        return np.asarray(gsw.rho_t_exact(absolute, self.temperature, self.pressure))

    def corrected(self, lag: ThermalLag | None) -> CtdSeries:
        """Copy with the salinity at the cell's temperature; unchanged if `lag` is None."""
        import gsw

        if lag is None or self.known.sum() < 2:
            return self
        inside = self.temperature - lag.excess(_bridged(self.temperature), self.period)
        conductivity = MS_PER_CM * self.conductivity
        salinity = np.asarray(gsw.SP_from_C(conductivity, inside, self.pressure))
        return dataclasses.replace(self, salinity=np.where(self.known, salinity, self.salinity))

    def casts(self) -> list[tuple[Cast, Cast]]:
        """Pairs of successive casts: a descent and the climb after it, or the reverse."""
        import gsw

        if self.known.sum() < LEAST_SAMPLES:
            return []
        temperature, salinity = _bridged(self.temperature), _bridged(self.salinity)
        pressure = _bridged(self.pressure)
        conductivity = gsw.C_from_SP(salinity, temperature, pressure)
        slope = (gsw.SP_from_C(conductivity, temperature + NUDGE, pressure) - salinity) / NUDGE
        found = [
            Cast(
                period=self.period,
                temperature=temperature,
                salinity=salinity,
                slope=np.asarray(slope),
                part=part,
            )
            for part in ways(_bridged(self.depth))
            if self.known[part].sum() >= LEAST_SAMPLES
        ]
        return list(itertools.pairwise(found))


def common_lag(ctds: Sequence[CtdSeries]) -> ThermalLag | None:
    """Fit the thermal lag of the instrument that measured all these dives; None if none shows."""
    return fit_thermal_lag([pair for ctd in ctds for pair in ctd.casts()])


def ways(depth: Array) -> list[slice]:
    """Descents and climbs of a depth (time,), in order, between turns of `LEAST_CAST` or more."""
    turns, furthest, direction = [0], 0, 0.0
    for k in range(1, len(depth)):
        if direction == 0.0:
            if abs(depth[k] - depth[0]) > LEAST_CAST:
                furthest, direction = k, float(np.sign(depth[k] - depth[0]))
        elif direction * (depth[k] - depth[furthest]) > 0.0:
            furthest = k
        elif direction * (depth[furthest] - depth[k]) > LEAST_CAST:
            turns.append(furthest)
            furthest, direction = k, -direction
    turns.append(len(depth) - 1)
    return [
        slice(first, last + 1)
        for first, last in itertools.pairwise(turns)
        if abs(depth[last] - depth[first]) >= LEAST_CAST
    ]


def _bridged(values: Array) -> Array:
    """Values with gaps interpolated in time; at least one value must be finite."""
    finite = np.isfinite(values)
    index = np.arange(len(values))
    return np.interp(index, index[finite], values[finite])
