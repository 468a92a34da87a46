"""Faults of the CTD: a cell that clogs, a thermistor that is slow."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

import numpy as np
from scipy.signal import lfilter

from twin.faults.base import Array, Fault, FaultRun, Readings

NAMES = ("measured_temperature", "measured_conductivity", "measured_pressure")
MILLISIEMENS_PER_CM = 10.0
"""of one S/m, the unit of `gsw`"""


def lagged(values: Array, lag: Array, period: float) -> Array:
    """Response of an instrument that follows `values` with a lag [s], one per sample, shape (n,).

    NaN stay NaN, and where the lag is 0 the values stay as they are. From the sample on at which it
    changes, the instrument follows with the new one from what it showed there.
    """
    known = np.flatnonzero(np.isfinite(values))
    found = values.copy()
    if known.size < 2:
        return found
    step = period * float(np.median(np.diff(known)))
    for stretch in np.split(known, np.flatnonzero(np.diff(lag[known])) + 1):
        tau = float(lag[stretch[0]])
        if tau > 0.0:
            share = 1.0 - np.exp(-step / tau)
            before = known[known < stretch[0]]
            begin = found[before[-1]] if before.size else values[stretch[0]]
            found[stretch], _ = lfilter(
                [share], [1.0, share - 1.0], values[stretch], zi=[begin * (1.0 - share)]
            )
    return found


def derived(signals: Readings, temperature: Array, conductivity: Array) -> dict[str, Array]:
    """What a CTD makes of temperature and conductivity: PSS-78 and TEOS-10, as the sensor does."""
    import gsw

    pressure = signals["measured_pressure"]
    practical = gsw.SP_from_C(conductivity * MILLISIEMENS_PER_CM, temperature, pressure)
    absolute = gsw.SA_from_SP(practical, pressure, -121.8, 36.8)
    return {
        "measured_temperature": temperature,
        "measured_conductivity": conductivity,
        "measured_salinity": practical,
        "measured_density": gsw.rho_t_exact(absolute, temperature, pressure),
    }


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Late(Fault):
    """An instrument of the CTD that is late."""

    size_name: ClassVar[str] = "lag"
    unit: ClassVar[str] = "s"
    most: ClassVar[float] = 10000.0
    late: ClassVar[str] = ""
    """Which of NAMES"""

    def readings(
        self, signals: Readings, size: Array, period: float, rng: np.random.Generator
    ) -> Readings:
        """The late reading, and salinity and density of it; nothing where it has no CTD."""
        if any(name not in signals for name in NAMES):
            return {}
        return self.shown(signals, lagged(signals[self.late], size, period))

    def shown(self, signals: Readings, late: Array) -> Readings:
        """The CTD's readings where one instrument shows `late`."""
        temperature, conductivity = (
            late if name == self.late else signals[name] for name in NAMES[:2]
        )
        return derived(signals, temperature, conductivity)

    def begin(self) -> FaultRun:
        """See `Fault.begin`."""
        return _LateRun(self, np.array([math.nan, 0.0]))


class _LateRun(FaultRun):
    """A late instrument; it carries what it showed last, and how long ago [s] that was."""

    def readings(
        self, signals: Readings, size: Array, period: float, rng: np.random.Generator
    ) -> Readings:
        """See `FaultRun.readings`."""
        fault = self.fault
        assert isinstance(fault, _Late)
        if any(name not in signals for name in NAMES):
            return {}
        found = signals[fault.late].copy()
        for k, lag in enumerate(size):
            self.carried[1] += period
            if not math.isfinite(found[k]):
                continue
            before, since = self.carried
            if lag > 0.0 and math.isfinite(before):
                found[k] = before + (1.0 - math.exp(-since / lag)) * (found[k] - before)
            self.carried[:] = found[k], 0.0
        return fault.shown(signals, found)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CtdClogged(_Late):
    """A conductivity cell through which water hardly flows any more."""

    kind: ClassVar[str] = "ctd_clogged"
    says: ClassVar[str] = "the CTD's cell is clogged"
    late: ClassVar[str] = "measured_conductivity"
    sizes: ClassVar[tuple[float, float]] = (20.0, 120.0)
    source: ClassVar[str] = "ours: from a slow flush to a cell that keeps its water for minutes"
    shows: ClassVar[str] = "salinity that differs between dives and climbs at the same depth"
    otherwise: ClassVar[str] = "a front; thermal lag of the cell, which is smaller"
    find_out: ClassVar[str] = "compare dive and climb of one turn at depth; flush, or switch it off"

    lag: float = 60.0
    """[s] by which its water is late"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ThermistorSlow(_Late):
    """A thermistor behind a film: it follows late."""

    kind: ClassVar[str] = "thermistor_slow"
    says: ClassVar[str] = "the thermistor is slow"
    late: ClassVar[str] = "measured_temperature"
    sizes: ClassVar[tuple[float, float]] = (5.0, 30.0)
    source: ClassVar[str] = "ours: sound ones take half a second"
    shows: ClassVar[str] = "temperature and salinity that differ between dives and climbs"
    otherwise: ClassVar[str] = "a front, internal waves"
    find_out: ClassVar[str] = "compare dive and climb of one turn in the thermocline"

    lag: float = 15.0
    """[s] by which it is late"""
