"""CTD: temperature, conductivity, salinity and density of a dive, its thermal lag removed."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.flight.thermal_lag import NUDGE, Cast, ThermalLag, fit_thermal_lag

Array = NDArray[np.float64]

MS_PER_CM = 10.0
"""gsw takes conductivity in mS/cm; 1 S/m is 10 of them."""
LEAST_CAST = 10.0
"""[m] of depth that a way down or up must pass to be compared"""
LEAST_SAMPLES = 10
"""of a cast"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ctd:
    """What the CTD of a dive says, each (time,), NaN where it was silent."""

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

    def corrected(self, lag: ThermalLag | None) -> Ctd:
        """The same with the salinity of the water in the cell; itself without a lag."""
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


def common_lag(ctds: Sequence[Ctd]) -> ThermalLag | None:
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
