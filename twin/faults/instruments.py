"""Faults of instruments: compass, pressure gauge, altimeter, CTD and Doppler log."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.random import Generator

from twin.faults.base import Array, Condition, Fault, FaultRun, Readings

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

METRES_PER_DBAR = 0.99
CTD = ("measured_temperature", "measured_conductivity", "measured_pressure")
MILLISIEMENS_PER_CM = 10.0
"""Conductivity of 1 S/m in mS/cm, the unit of `gsw`."""
PLACE = -121.8, 36.8
"""[deg] Longitude and latitude for the composition of the salt: the sensors' defaults."""
DVL = ("measured_dvl_surge", "measured_dvl_sway", "measured_dvl_heave")


@dataclasses.dataclass(frozen=True, kw_only=True)
class CompassIron(Fault):
    """Changed hard iron near the compass: a magnetised battery, a loosened screw."""

    kind = "compass_iron"
    says = "the compass' iron has changed"
    size_name = "degrees"
    unit = "degree"
    sizes = (4.0, 15.0)
    signed = True
    most = 60.0
    source = (
        "OceanGliders' procedure for depth-averaged currents: 1 deg or less calibrated, usually up "
        "to 5 without; more where a battery pack is exchanged"
    )
    shows = "currents that seem to turn with the heading; the gyro's turns"
    otherwise = "a current that turns while it flies that heading"
    find_out = "fly two legs on opposite headings, or a spiral, and compare"

    degrees: float = 8.0
    """[degree] Largest deviation of the compass"""
    toward: float = 0.0
    """[degree] Heading at which the deviation passes 0, from negative to positive"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Add the deviation, a sine of the heading, to guidance's compass."""
        sine, cosine = condition.iron
        most, toward = math.radians(size), math.radians(self.toward)
        iron = (sine + most * math.cos(toward), cosine - most * math.sin(toward))
        return condition.replace(iron=iron)

    def expected(self, way: Array) -> Mapping[str, Array]:
        """Apparent current: the wrong heading turns the velocity through the water."""
        north, east = way.T
        return _apparent(way, np.sin(np.arctan2(east, north) - math.radians(self.toward)))

    def choices(self, vehicle: Vehicle) -> tuple[Mapping[str, Any], ...]:
        """Values of `toward` 45 deg apart, over half a circle because the size has a sign."""
        return tuple({"toward": 45.0 * k} for k in range(4))

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """Add the deviation to the heading; no change without a compass."""
        return _misread(signals, lambda true: size * np.sin(np.deg2rad(true - self.toward)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class CompassTurned(Fault):
    """A compass turned by a constant angle: by its mount, or by another place's declination."""

    kind = "compass_turned"
    says = "the compass is turned as a whole"
    size_name = "degrees"
    unit = "degree"
    sizes = (5.0, 15.0)
    signed = True
    most = 90.0
    source = "ours: a mount turned by a bolt's play, or the declination of a place far away"
    shows = "currents that seem to turn with the heading, on every heading alike"
    otherwise = "a speed through the water that is off, if all legs have one heading"
    find_out = "fly legs on three headings with fixes between them, and compare"

    degrees: float = 8.0
    """[degree] Compass reading minus true heading, equal on every heading"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Turn guidance's compass."""
        return condition.replace(compass_offset=condition.compass_offset + math.radians(size))

    def expected(self, way: Array) -> Mapping[str, Array]:
        """Apparent current: the wrong heading turns the velocity through the water."""
        return _apparent(way, np.ones(len(way)))

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """Turn the heading; no change without a compass."""
        return _misread(signals, lambda _: size)


def _apparent(way: Array, degrees: Array) -> Mapping[str, Array]:
    """Apparent current [m/s] of velocities (n, 2) whose heading reads so many degrees too much."""
    (north, east), off = way.T, math.radians(1.0) * degrees
    return {"current_north": off * east, "current_east": -off * north}


def _misread(signals: Readings, off: Callable[[Array], Array]) -> Readings:
    """Add an error [degree], a function of the heading, to the compass; no change without one."""
    true = signals.get("measured_heading")
    return {} if true is None else {"measured_heading": np.mod(true + off(true), 360.0)}


@dataclasses.dataclass(frozen=True, kw_only=True)
class PressureDrift(Fault):
    """A pressure sensor whose reading grows by the day, equally at every depth."""

    kind = "pressure_drift"
    says = "the pressure sensor drifts"
    size_name = "per_day"
    unit = "dbar d-1"
    sizes = (0.1, 0.6)
    grows = True
    signed = True
    most = 100.0
    source = "ours: strain gauges that fail, above the 0.1 % of full scale of sound"
    shows = "a depth at the surface that is not 0"
    otherwise = "weather: 0.3 dbar between a high and a low"
    find_out = "read it at the surface; compare with the CTD's own"

    per_day: float = 0.3
    """[dbar] Growth of the error per day"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Add the drift to guidance's depth."""
        return condition.replace(depth_offset=condition.depth_offset + METRES_PER_DBAR * size)

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """Add the drift to pressure and depth."""
        added = {"measured_depth": METRES_PER_DBAR * size, "measured_pressure": size}
        return {name: signals[name] + more for name, more in added.items() if name in signals}


@dataclasses.dataclass(frozen=True, kw_only=True)
class AltimeterBlind(Fault):
    """An altimeter that receives no more returns."""

    kind = "altimeter_blind"
    says = "the altimeter is blind"
    size_name = "part"
    sizes = (0.9, 1.0)
    source = "it fails, or its face is overgrown"
    shows = "no echoes where there were some, above a floor within its range"
    otherwise = "deeper water, a soft bottom"
    find_out = "ping at the surface in shallow water; keep it above the charted floor"

    part: float = 1.0
    """Fraction of the altimeter returns that is lost"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Reduce guidance's returns; without a return, guidance uses the last one for a while."""
        heard = (1.0 - condition.echoes_lost) * (1.0 - size)
        return condition.replace(echoes_lost=1.0 - heard)

    def expected(self, way: Array) -> Mapping[str, Array]:
        """Change of the fraction of altimeter returns received, relative to earlier dives."""
        return {"echoes": -np.ones(len(way))}

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """Replace lost returns by NaN; no change without an altimeter."""
        height = signals.get("measured_altitude")
        if height is None:
            return {}
        return {"measured_altitude": np.where(rng.random(len(size)) < size, np.nan, height)}


def lagged(values: Array, lag: Array, period: float) -> Array:
    """Response of an instrument that follows `values` with a lag [s], one per sample, shape (n,).

    NaN stay NaN, and a lag of 0 leaves the values unchanged. When the lag changes, the instrument
    continues from its last reading with the new lag.
    """
    from scipy.signal import lfilter

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Lagged(Fault):
    """A CTD instrument with a lag."""

    size_name = "lag"
    unit = "s"
    most = 10000.0
    late: ClassVar[str]
    """Name of the instrument's signal."""

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """Apply the lag and recompute salinity and density; no change without a CTD."""
        if any(name not in signals for name in CTD):
            return {}
        return self.shown(signals, lagged(signals[self.late], size, period))

    def shown(self, signals: Readings, late: Array) -> Readings:
        """Readings of a CTD whose lagged signal is `late`: PSS-78 and TEOS-10, as in `Ctd`."""
        import gsw

        temperature, conductivity, pressure = ({**signals, self.late: late}[name] for name in CTD)
        practical = gsw.SP_from_C(conductivity * MILLISIEMENS_PER_CM, temperature, pressure)
        absolute = gsw.SA_from_SP(practical, pressure, *PLACE)
        return {
            "measured_temperature": temperature,
            "measured_conductivity": conductivity,
            "measured_salinity": practical,
            "measured_density": gsw.rho_t_exact(absolute, temperature, pressure),
        }

    def begin(self) -> FaultRun:
        """Begin to lag readings; see `Fault.begin`."""
        return _LaggedRun(self, np.array([math.nan, 0.0]))


class _LaggedRun(FaultRun):
    """A lagged instrument in one mission; carries its last reading and the time since then [s]."""

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """Lag the readings of the next stretch; see `FaultRun.readings`."""
        fault = self.fault
        assert isinstance(fault, _Lagged)
        if any(name not in signals for name in CTD):
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
class CtdClogged(_Lagged):
    """A conductivity cell through which hardly any water flows."""

    kind = "ctd_clogged"
    says = "the CTD's cell is clogged"
    late = "measured_conductivity"
    sizes = (20.0, 120.0)
    source = "ours: from a slow flush to a cell that keeps its water for minutes"
    shows = "salinity that differs between dives and climbs at the same depth"
    otherwise = "a front; thermal lag of the cell, which is smaller"
    find_out = "compare dive and climb of one turn at depth; flush, or switch it off"

    lag: float = 60.0
    """[s] Lag of the water in the cell"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ThermistorSlow(_Lagged):
    """A thermistor behind a film, which follows slowly."""

    kind = "thermistor_slow"
    says = "the thermistor is slow"
    late = "measured_temperature"
    sizes = (5.0, 30.0)
    source = "ours: sound ones take half a second"
    shows = "temperature and salinity that differ between dives and climbs"
    otherwise = "a front, internal waves"
    find_out = "compare dive and climb of one turn in the thermocline"

    lag: float = 15.0
    """[s] Lag of the thermistor"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DvlBeam(Fault):
    """A Doppler log with a dead beam, which loses lock when another beam gets no return."""

    kind = "dvl_beam"
    says = "a beam of the Doppler log is dead"
    size_name = "part"
    sizes = (0.3, 0.8)
    source = "ours: how often one of three beams finds nothing"
    shows = "fewer samples with lock"
    otherwise = "a floor out of range, clear water without scatterers"
    find_out = "read the echo of each beam"

    part: float = 0.5
    """Fraction of the samples that lose their lock"""

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """Remove velocities and lock of lost samples; no change without a Doppler log."""
        if "measured_dvl_mode" not in signals:
            return {}
        lost = rng.random(len(size)) < size
        found = {name: np.where(lost, np.nan, signals[name]) for name in DVL}
        return {**found, "measured_dvl_mode": np.where(lost, 0.0, signals["measured_dvl_mode"])}
