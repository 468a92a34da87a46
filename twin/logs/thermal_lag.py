"""Thermal lag: how much warmer or colder than its water a conductivity cell is, fitted.

Conductivity is measured inside a cell whose walls give heat back to the water. Salinity, made of
that conductivity and the temperature outside, then spikes where temperature changes: too fresh one
way through a thermocline, too salty the other way. Morison et al. (1994, J. Atmos. Oceanic
Technol. 11, 1151) filter the temperature to that of the cell with two numbers; Garau et al. (2011,
J. Atmos. Oceanic Technol. 28, 1065) find them from a glider's own dives and climbs, whose
temperature and salinity should lie on one curve.

CTD: temperature, conductivity, salinity and density of a dive, its thermal lag removed.
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
"""Beyond it the filter is no cell's: unpumped cells have up to 0.3 (Garau et al. 2011)."""
SHORTEST, LONGEST = 2.0, 25.0
"""[s] between which cells warm up; published ones take 5 to 25 s."""
FIRST_GUESS = (0.03, 10.0)
"""Of a pumped glider CTD, near Sea-Bird's 0.06 and 10 s for the GPCTD at full rate."""
LEAST_RANGE = 1.0
"""[K] of temperature that a dive and its climb must share: less shows no lag."""
LEAST_PAIRS = 3
"""of a dive and a climb"""
MOST_PAIRS = 80
"""that are compared, evenly chosen: more change nothing"""
LEVELS = 50
"""temperatures at which a dive and its climb are compared"""
LEAST_GAIN = 0.05
"""Part by which the correction must bring dives and climbs together, or none is made."""
NUDGE = 0.01
"""[K] for the derivative of salinity"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ThermalLag:
    """The two numbers of a cell."""

    amplitude: float
    """alpha: part of a step of temperature by which the cell is off at first"""
    time: float
    """[s] tau, in which that dies out"""

    def excess(self, temperature: Array, period: float) -> Array:
        """Temperature outside less that in the cell [K], (time,); Morison et al. (1994), eq. 5-7.

        Args:
          temperature: [degree_Celsius] without holes, (time,).
          period: [s] between samples.
        """
        nyquist = 0.5 / period
        a = 4.0 * nyquist * self.amplitude * self.time / (1.0 + 4.0 * nyquist * self.time)
        b = 1.0 - 2.0 * a / self.amplitude if self.amplitude > 0.0 else 0.0
        steps = np.diff(temperature, prepend=temperature[:1])
        return np.asarray(lfilter([a], [1.0, b], steps))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cast:
    """One way through the water column, down or up; arrays are (time,), without holes."""

    period: float
    """[s]"""
    temperature: Array
    """[degree_Celsius] of the whole dive: the lag remembers what was before"""
    salinity: Array
    """as stored, of the whole dive"""
    slope: Array
    """[1/K] change of salinity where the temperature changes and the conductivity does not"""
    part: slice
    """its samples"""


def fit_thermal_lag(pairs: Sequence[tuple[Cast, Cast]]) -> ThermalLag | None:
    """The lag that brings dives and the climbs beside them together; None where none does.

    Args:
      pairs: a dive and the climb that follows or precedes it.
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
    """Temperatures that both casts passed, off their ends; None where they share too few."""
    a, b = one.temperature[one.part], other.temperature[other.part]
    low, high = max(a.min(), b.min()), min(a.max(), b.max())
    if high - low < LEAST_RANGE:
        return None
    margin = 0.05 * (high - low)
    return np.linspace(low + margin, high - margin, LEVELS)


def _difference(pairs: Sequence[tuple[Cast, Cast]], lag: ThermalLag | None) -> float:
    """Mean distance of the two salinities at one temperature, over all pairs."""
    apart = []
    for pair in pairs:
        levels = _shared(*pair)
        assert levels is not None
        curves = []
        for cast in pair:
            salinity = cast.salinity
            if lag is not None:
                # the cell is at temperature less excess
                salinity = salinity - cast.slope * lag.excess(cast.temperature, cast.period)
            order = np.argsort(cast.temperature[cast.part], kind="stable")
            curves.append(
                np.interp(levels, cast.temperature[cast.part][order], salinity[cast.part][order])
            )
        apart.append(np.abs(curves[0] - curves[1]))
    return float(np.mean(apart))


MS_PER_CM = 10.0
"""gsw takes conductivity in mS/cm; 1 S/m is 10 of them."""
LEAST_CAST = 10.0
"""[m] of depth that a way down or up must pass to be compared"""
LEAST_SAMPLES = 10
"""of a cast"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CtdSeries:
    """Samples of a dive's CTD, each (time,), NaN where it was silent."""

    period: float
    """[s]"""
    depth: Array
    """[m]"""
    pressure: Array
    """[dbar]"""
    temperature: Array
    """[degree_Celsius]"""
    salinity: Array
    """practical"""
    latitude: float
    """[degree]"""
    longitude: float
    """[degree]"""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where it spoke."""
        return np.isfinite(self.temperature) & np.isfinite(self.salinity) & np.isfinite(self.depth)

    @property
    def conductivity(self) -> Array:
        """[S/m] as measured: what salinity and temperature were made of."""
        import gsw

        return np.asarray(gsw.C_from_SP(self.salinity, self.temperature, self.pressure)) / MS_PER_CM

    @property
    def density(self) -> Array:
        """[kg/m3] in situ, TEOS-10."""
        import gsw

        absolute = gsw.SA_from_SP(self.salinity, self.pressure, self.longitude, self.latitude)
        return np.asarray(gsw.rho_t_exact(absolute, self.temperature, self.pressure))

    def corrected(self, lag: ThermalLag | None) -> CtdSeries:
        """A copy with the salinity of the water in the cell; itself without a lag."""
        import gsw

        if lag is None or self.known.sum() < 2:
            return self
        inside = self.temperature - lag.excess(_bridged(self.temperature), self.period)
        conductivity = MS_PER_CM * self.conductivity
        salinity = np.asarray(gsw.SP_from_C(conductivity, inside, self.pressure))
        return dataclasses.replace(self, salinity=np.where(self.known, salinity, self.salinity))

    def casts(self) -> list[tuple[Cast, Cast]]:
        """Each way down or up with the one after it."""
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
    """The thermal lag of the instrument that measured all these dives; None where none shows."""
    return fit_thermal_lag([pair for ctd in ctds for pair in ctd.casts()])


def ways(depth: Array) -> list[slice]:
    """The ways down and up of a depth (time,), in order: between turns of `LEAST_CAST` or more."""
    turns, furthest, way = [0], 0, 0.0
    for k in range(1, len(depth)):
        if way == 0.0:
            if abs(depth[k] - depth[0]) > LEAST_CAST:
                furthest, way = k, float(np.sign(depth[k] - depth[0]))
        elif way * (depth[k] - depth[furthest]) > 0.0:
            furthest = k
        elif way * (depth[furthest] - depth[k]) > LEAST_CAST:
            turns.append(furthest)
            furthest, way = k, -way
    turns.append(len(depth) - 1)
    return [
        slice(first, last + 1)
        for first, last in itertools.pairwise(turns)
        if abs(depth[last] - depth[first]) >= LEAST_CAST
    ]


def _bridged(values: Array) -> Array:
    """Values with holes interpolated in time; at least one must be finite."""
    finite = np.isfinite(values)
    index = np.arange(len(values))
    return np.interp(index, index[finite], values[finite])
