"""Dive channels: health channels computed from the logged signals of one dive, NaN where absent."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.health.channels import NAMES, NOISE
from twin import Vehicle
from twin.identify import Calibration, Log, Translation, load_calibration, log_of, motion_of
from twin.numbers import Array
from twin.vehicle import Consumption
from twin.vehicle.laws import FlowFrame
from twin.vehicle.parts import BatteryHinge, Fin, Pump

Mask = NDArray[np.bool_]
CUBIC_CM = 1e-6
"""[m3]"""
PUMPING = 0.15
"""[cm3/s] Rate above which a pump counts as pumping"""
STEEP, LEAST_SAMPLES = 8.0, 20
"""A vehicle dives or climbs with STEEP [degree] of pitch and LEAST_SAMPLES samples or more."""
BIN, STEADY_PITCH = 60.0, 8.0
"""BIN: [s] length of the bins of steady flight. STEADY_PITCH: [degree] smallest pitch of a glide"""
STEADY_CHANGE, STEADY_PUMP = 4.0, 15.0
"""Changes between bins that end steady flight. STEADY_CHANGE: [degree] pitch. STEADY_PUMP: [cm3]"""
SHALLOW = 5.0
"""[m] Depth above which a hull is near the surface"""
AFLOAT, FLOATING, RESTS = 0.5, 0.05, 20.0
"""A vehicle floats within AFLOAT [m] of a dive's smallest depth while it rises or sinks slower than
FLOATING [m/s], for longer than RESTS [s]. A turn below the surface is as slow for less."""
LEVEL_RATE = 0.03
"""[m/s] Smallest vertical velocity of a dive or climb, as in `twin flight`"""
WATER, NEAR = ("measured_density", "measured_temperature"), 120.0
"""WATER: signals that the buoyancy needs. NEAR: [s] longest distance from a sample of them"""
FULL_RATE = 10.0
"""[s] Longest sample period at which lags of a CTD are judged"""
LEAST_BINS = 4
"""Minimum number of bins of a dive or climb from which a channel is computed"""
LEAST_RUN = 8
"""Minimum number of consecutive samples of a descent or ascent whose depth rate is judged. At
satellite rate a yo of 30 m has two or three, and all its depth rates contain a turn. Where samples
are longer than `FINEST` apart, the first and the last of a run are left out too."""
WHOLE, LEAST_WHOLE = 0.7, 3.0
"""WHOLE: fraction of the highest rate above which a pump runs at full rate. LEAST_WHOLE: minimum
number of consecutive samples at full rate that give the rate; the one highest sample of a fast pump
depends on when it was taken."""
FINEST = 20.0
"""[s] Longest sample period at which a pump's strokes can be seen"""
AGREE = 6.0
"""[s] Difference of a lag between the halves of a dive that is accepted, or the lag itself"""
COUNTED = 0.9
"""Least fraction of a dive between its first and its last reading of the charge: pumps take most of
it in a few strokes, and a part of the dive has more or fewer of them"""
LOST = 0.5
"""Largest fraction of lost samples below the surface of a dive whose glide is judged"""
LAYER = 2.0
"""[m] Height of the layers in which the CTD's dives and climbs are compared"""
SEA_LEVEL, ZERO_C = 101_325.0, 273.15
"""SEA_LEVEL: [Pa] pressure of the air. ZERO_C: [K] temperature of 0 degC"""
PHASES = (("dive", 1.0), ("climb", -1.0))
"""Sign of the depth rate in dives and in climbs"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveSignals:
    """Logged signals of one dive, each array (n,)."""

    period: float
    """[s]"""
    signals: Mapping[str, Array]
    """Arrays by the names of the schema"""
    current: tuple[float, float] = (math.nan, math.nan)
    """[m/s] Depth-averaged current to the north and east, by fixes, depth rate and compass"""
    way: tuple[float, float] = (math.nan, math.nan)
    """[m/s] Mean velocity through the water to the north and east, by the compass"""
    echoes: float = math.nan
    """Echoes of the sea floor over those expected from earlier dives at the same heights"""
    powered: bool = False
    """A thruster propelled it, so that glide and power are not comparable"""
    test: bool = False
    """A test dive, much shallower than the others"""

    @functools.cached_property
    def masked(self) -> bool:
        """True where only the hull is judged."""
        return self.powered or self.test or self.lossy

    @property
    def lossy(self) -> bool:
        """True where more than `LOST` of the samples below the surface are lost."""
        depth = self.get("depth")
        if depth is None:
            return False
        deep = depth > SHALLOW
        return bool((deep & ~self.sampled()).sum() > LOST * deep.sum())

    def get(self, name: str) -> Array | None:
        """Return a measured signal, None where it has no finite value."""
        found = self.signals.get(f"measured_{name}")
        return None if found is None or not np.isfinite(found).any() else found

    def sampled(self) -> Mask:
        """True at samples with an original sample of the depth within `FINEST`."""
        time = self.period * np.arange(len(self.signals["measured_depth"]))
        away = np.abs(self.signals.get("measured_depth_time", time) - time)
        return np.asarray(away <= max(FINEST, self.period))

    def original(self) -> DiveSignals:
        """Dive without what the importer interpolated across losses of samples."""
        known = self.sampled()
        signals = {name: np.where(known, one, math.nan) for name, one in self.signals.items()}
        return dataclasses.replace(self, signals=signals)

    def watered(self) -> Mask:
        """True at samples with the log's density and temperature within `NEAR`."""
        count = len(self.signals["measured_depth"])
        known = np.ones(count, bool)
        for name in WATER:
            if name in self.signals:
                at = np.flatnonzero(np.isfinite(self.signals[name]))
                before = np.searchsorted(at, np.arange(count), side="right") - 1
                ends = at[[np.clip(before, 0, None), np.clip(before + 1, None, len(at) - 1)]]
                off = np.abs(ends - np.arange(count)).min(axis=0) if len(at) else np.inf
                known &= off * self.period <= NEAR
        return known

    def settings(self) -> list[float]:
        """Pilot's settings by the log: depth [m] of the lower turn, then pitch [degree] and pumped
        volume [cm3] of the dive, and both of the climb. Nose up is positive; NaN where absent or
        lost."""
        depth, pitch, pump = self.get("depth"), self.get("pitch"), self.get("pump")
        if depth is None or self.lossy:
            return [math.nan] * 5
        found = [float(np.nanmax(depth))]
        for sign in (-1.0, 1.0):
            way = np.zeros(0, bool) if pitch is None else sign * pitch > STEEP
            for values in (pitch, pump):
                told = None if values is None or way.sum() <= LEAST_SAMPLES else values[way]
                found.append(math.nan if told is None else float(np.nanmedian(told)))
        return found


class Strokes(NamedTuple):
    """Strokes of a pump that pumps out, each (n,)."""

    rate: Array
    """[cm3/s] Rate since the sample before"""
    out: Mask
    """The pump pumps out"""
    inner: Mask
    """Both neighbours belong to the stroke too; samples at its ends hold only a part of one"""


def strokes_of(volume: Array, period: float) -> Strokes:
    """Find the strokes in a pump's volume [cm3], (n,), sampled every `period` [s]."""
    whole = _filled(volume)
    rate = np.diff(whole, prepend=whole[:1]) / period
    out = rate > PUMPING
    inner = out.copy()
    inner[1:] &= out[:-1]
    inner[:-1] &= out[1:]
    return Strokes(rate, out, inner)


def _runs(mask: Mask) -> NDArray[np.int64]:
    """First sample of each run of True, and the one after its last, (runs, 2)."""
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


def _binned(values: Array | None, width: int, count: int) -> Array:
    """Average bins of `width` of `count` samples without NaN; NaN where there is no signal."""
    values = np.full(count, np.nan) if values is None else values
    block = values[: count // width * width].reshape(-1, width)
    known = np.isfinite(block)
    total = np.where(known, block, 0.0).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(total / known.sum(axis=1))


def _filled(values: Array) -> Array:
    """Interpolate linearly across NaN; a signal without any value stays NaN."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) in (0, len(values)):
        return values
    return np.interp(np.arange(len(values)), known, values[known])


def channels_of(dive: DiveSignals, calibration: Calibration | None) -> Array:
    """Compute each channel, (channels,); NaN where the log lacks its signals.

    Args:
      calibration: flight model that depth rates are compared with; None: no such channels.
    """
    found = dict.fromkeys(NAMES, math.nan)
    depth = dive.get("depth")
    if depth is not None and len(depth) >= 10:
        own = dive.original()
        seen = own.signals["measured_depth"]
        if not dive.masked:
            if calibration is not None:
                found |= _flight(dive, depth, calibration)
                found |= _turning(own, seen, calibration.vehicle)
            losses = None if calibration is None else Consumption.of(calibration.vehicle)
            found |= _pump(own, seen, losses)
            found |= _power(own, seen, losses)
            found |= _lags(own, seen)
            found["current_north"], found["current_east"] = dive.current
            found["echoes"] = dive.echoes
        found |= _hull(own, seen)
    return np.array([found[name] for name in NAMES], float)


def _flight(dive: DiveSignals, depth: Array, calibration: Calibration) -> dict[str, float]:
    """Channels of depth rate and trim, by the flight model of `twin flight` and `twin identify`."""
    log = _log_of(dive, calibration)
    if log is None:
        return {}
    motion, vehicle = motion_of(log, calibration), calibration.vehicle
    pitch, moved = calibration.true_pitch(log.pitch), None
    found = _rates(dive, log, calibration, motion)
    if log.shift is not None:
        pump, battery = vehicle.steered("buoyancy"), vehicle.battery
        assert isinstance(pump, Pump)
        constant, slope, _ = vehicle.flow_frame.pitch_moment
        if vehicle.added_mass_coupling:
            slope += vehicle.added_mass[2, 2] - vehicle.added_mass[0, 0]
        water = (constant + slope * motion.angle_of_attack) * motion.speed**2 / vehicle.gravity
        low = vehicle.static_mass * vehicle.static_cg[2] + battery.mass * battery.eccentricity
        pumped = CUBIC_CM * vehicle.reference_density * (log.pump - pump.neutral)
        first = water / np.cos(pitch) - low * np.tan(pitch) + pump.position[0] * pumped
        own = vehicle.static_mass * vehicle.static_cg[0] + battery.mass * battery.neutral_x
        moved = 1e3 * (log.shift - (first - own) / battery.mass)
    width = max(round(BIN / dive.period), 1)
    steady = np.abs(_binned(log.pitch, width, len(depth))) > math.radians(STEADY_PITCH)
    for values, most in ((np.rad2deg(log.pitch), STEADY_CHANGE), (log.pump, STEADY_PUMP)):
        change = np.abs(np.diff(_binned(values, width, len(depth))))
        steady &= np.maximum(np.append(0.0, change), np.append(change, 0.0)) < most
    for word, sign in PHASES:
        if moved is not None and f"rate_{word}" in found:
            phase = log.use & dive.watered() & (sign * log.depth_rate > LEVEL_RATE)
            whole = steady & (_binned(phase.astype(float), width, len(depth)) > 0.9)
            found |= _median(f"trim_{word}", _binned(moved, width, len(depth)), whole)
    return found


def _rates(
    dive: DiveSignals, log: Log, calibration: Calibration, motion: Translation
) -> dict[str, float]:
    """1 less the flight model's depth rate over the log's, of dives and of climbs."""
    sink = log.filtered(motion.sink_rate(log.roll, calibration.true_pitch(log.pitch)))
    used, found = log.use & dive.watered() & np.isfinite(sink), {}
    ends = int(dive.period > FINEST)
    for word, sign in PHASES:
        phase = np.zeros_like(used)
        for first, end in _runs(sign * log.depth_rate > LEVEL_RATE):
            if end - first >= LEAST_RUN:
                inner = slice(first + ends, end - ends)
                phase[inner] = used[inner]
        if phase.sum() * dive.period >= LEAST_BINS * BIN:
            found[f"rate_{word}"] = float(1.0 - sink[phase].sum() / log.depth_rate[phase].sum())
    return found


def imbalance(dive: DiveSignals, calibration: Calibration) -> float:
    """Difference of the rates' channels between a dive and its climb, which drag moves alike and a
    weight apart; NaN where one is lacking."""
    log = None if dive.masked else _log_of(dive, calibration)
    if log is None:
        return math.nan
    found = _rates(dive, log, calibration, motion_of(log, calibration))
    return found.get("rate_dive", math.nan) - found.get("rate_climb", math.nan)


def _log_of(dive: DiveSignals, calibration: Calibration) -> Log | None:
    """Dive as identification reads it; roll and heading count as 0 where the log lacks them."""
    count = len(dive.signals["measured_depth"])
    if dive.get("pitch") is None or dive.get("pump") is None:
        return None
    flat = {f"measured_{name}": np.zeros(count) for name in ("roll", "heading")}
    known = {name: values for name, values in dive.signals.items() if np.isfinite(values).any()}
    water = {name: values for name, values in dive.signals.items() if name in WATER}
    return log_of(0, {**flat, **known, **water}, dive.period, None, False)


def _median(name: str, values: Array | None, phase: Mask) -> dict[str, float]:
    """Median of a phase's bins as a channel; empty where there are fewer than `LEAST_BINS`."""
    used = np.zeros(0) if values is None else values[phase & np.isfinite(values)]
    return {name: float(np.median(used))} if len(used) >= LEAST_BINS else {}


def _turning(dive: DiveSignals, depth: Array, vehicle: Vehicle) -> dict[str, float]:
    """Channels of roll, of the steering drive's position and motion, and of the heading's error."""
    found: dict[str, float] = {}
    part, place = vehicle.steered("heading"), None
    heading, roll = dive.get("heading"), dive.get("roll")
    if isinstance(part, Fin | BatteryHinge):
        place = dive.get("fin" if isinstance(part, Fin) else "rotation")
    width, count = max(round(BIN / dive.period), 1), len(depth)
    z = _binned(depth, width, count)
    rate = np.gradient(z, width * dive.period) if len(z) > 2 else np.zeros(len(z))
    straight = np.ones(len(z), bool)
    if heading is not None and len(z) > 2:
        turned = np.rad2deg(np.unwrap(np.deg2rad(_filled(heading))))
        straight = np.abs(np.gradient(_binned(turned, width, count))) < 6.0
    rolled = None if roll is None else _binned(roll, width, count)
    at = None if place is None else _binned(place, width, count)
    if rolled is not None and isinstance(part, BatteryHinge) and at is not None:
        # roll per turn of a battery that hangs below the axis, linear near the middle
        hung = vehicle.battery.mass * vehicle.battery.eccentricity
        rolled = rolled + hung / max(vehicle.mass * vehicle.metacentric_height, 1e-9) * at
    for word, sign in PHASES:
        phase = straight & (z > SHALLOW) & (sign * rate > 0.02)
        found |= _median(f"roll_{word}", rolled, phase) | _median(f"turn_{word}", at, phase)
    under = depth > SHALLOW
    if at is not None and under.sum() > 20:
        own = at[(z > SHALLOW) & np.isfinite(at)]
        if len(own) > LEAST_BINS:
            way = float(np.abs(np.diff(own)).sum()) / (len(own) * BIN / 3600.0)
            found["turn_moves"] = math.log(max(way, 0.05))
    wanted = dive.signals.get("commanded_heading")
    if heading is not None and wanted is not None:
        off = np.deg2rad(heading - wanted)
        known = np.isfinite(off) & under
        if known.sum() > 20:
            error = np.abs(np.angle(np.exp(1j * off[known])))
            # the median ignores the turn onto a new leg, which is no error
            found["heading_error"] = math.log(max(float(np.rad2deg(np.median(error))), 0.05))
    return found


def _pump(dive: DiveSignals, depth: Array, losses: Consumption | None) -> dict[str, float]:
    """Channels of the pump's rate and of its energy over that of the vehicle's file, or over the
    work against the sea without one."""
    volume = dive.get("pump")
    if volume is None or dive.period > FINEST:
        return {}
    rate, out, inner = strokes_of(volume, dive.period)
    out, inner = (one & np.isfinite(volume) for one in (out, inner))
    found: dict[str, float] = {}
    # a valve passes a little at any time, and short strokes consist of their ends
    if out.sum() >= 5:
        whole = inner & (rate > WHOLE * float(rate[out].max()))
        lasting = np.diff(_runs(whole))
        if whole.any() and float(np.median(lasting)) >= LEAST_WHOLE:
            found["pump_rate"] = math.log(float(np.median(rate[whole])))
    power = dive.get("pump_power")
    if power is not None and out.any():
        against = _pump_energy(dive, depth, rate, out, losses)
        taken = float(np.nansum(power[out | np.roll(out, 1)])) * dive.period
        if against > 100.0 and taken > 0.0:
            found["pump_work"] = math.log(taken / against)
    return found


def _pump_energy(
    dive: DiveSignals, depth: Array, rate: Array, out: Mask, losses: Consumption | None
) -> float:
    """Energy [J] of a pump's strokes by the vehicle's file; without one, work against the sea."""
    vacuum = dive.get("vacuum")
    inside = 3e4 if vacuum is None else float(np.nanmedian(vacuum))
    pressure = (1e4 * np.maximum(depth, 0.0) + inside)[out]
    if losses is not None:
        pressure = pressure / losses.pump_efficiency + losses.pump_loss
    return float(np.nansum(pressure * CUBIC_CM * rate[out])) * dive.period


def _power(dive: DiveSignals, depth: Array, losses: Consumption | None) -> dict[str, float]:
    """Channels of the electronics' power and of the voltage's drop under load.

    Without a current the charge gives the power, less the pump's by the vehicle's file.
    """
    voltage, current, charge = (dive.get(n) for n in ("voltage", "battery_current", "charge"))
    found: dict[str, float] = {}
    if voltage is not None and current is not None:
        known = np.isfinite(voltage) & np.isfinite(current) & (depth > SHALLOW)
        volts, amperes = voltage[known], current[known]
        if known.sum() > 20:
            # drives move in most samples of a slow dive, and only add to the current
            low, rest = np.quantile(amperes, [0.025, 0.2])
            spread = float(rest - low)
            quiet = np.abs(amperes - rest) <= max(3.0 * spread, 1e-3)
            found["hotel"] = float(np.mean(amperes[quiet]) * np.mean(volts[quiet]))
            loaded = amperes > rest + max(0.1, 5.0 * spread)
            if loaded.sum() >= 5:
                drop = float(np.median(volts[quiet])) - volts[loaded]
                more = amperes[loaded] - rest
                slope = float(drop @ more) / float((more**2).sum())
                # a shallow pump draws too little to tell
                off = float(np.std(volts[quiet])) / math.sqrt(float((more**2).sum()))
                if slope > max(1e-4, off / NOISE[NAMES.index("resistance")]):
                    found["resistance"] = math.log(slope)
    elif charge is not None and voltage is not None:
        read = np.flatnonzero(np.isfinite(charge))
        if len(read) > 1 and read[-1] - read[0] > max(10.0, COUNTED * len(charge)):
            seconds = float(read[-1] - read[0]) * dive.period
            taken = 3600.0 * float(charge[read[-1]] - charge[read[0]])
            volume = dive.get("pump")
            if taken > 0.0:
                taken *= float(np.nanmedian(voltage))
                if volume is not None:
                    rate, out, _ = strokes_of(volume, dive.period)
                    taken -= _pump_energy(dive, depth, rate, out, losses)
                found["hotel"] = taken / seconds
    return found


def _hull(dive: DiveSignals, depth: Array) -> dict[str, float]:
    """Channels of air in the hull, depth shown at the surface and the Doppler log's lock."""
    found: dict[str, float] = {}
    vacuum, warmth, mode = (dive.get(name) for name in ("vacuum", "temperature", "dvl_mode"))
    # at the surface the air bladder takes air out of the hull
    under = depth > SHALLOW
    if vacuum is not None and np.isfinite(vacuum[under]).any():
        kelvin = ZERO_C + (10.0 if "measured_temperature" not in dive.signals else math.nan)
        if warmth is not None and np.isfinite(warmth[under]).any():
            kelvin = ZERO_C + float(np.nanmean(warmth[under]))
        found["air"] = math.log((SEA_LEVEL - float(np.nanmean(vacuum[under]))) / kelvin)
    known = depth[np.isfinite(depth)]
    highest = float(known.min(initial=math.inf))
    if highest < 10.0:
        floats = np.abs(np.gradient(_filled(depth), dive.period)) < FLOATING
        afloat = floats & (depth < highest + AFLOAT)
        # a log that ends below the surface has only the sinking begin of the dive there
        up = known[-1] < highest + 3.0 * AFLOAT
        if up and afloat.sum() >= max(2.0, RESTS / dive.period):
            found["surface_depth"] = float(np.median(depth[afloat]))
    if mode is not None:
        found["lock"] = float((mode[np.isfinite(mode)] > 0.0).mean())
    return found


def _lags(dive: DiveSignals, depth: Array) -> dict[str, float]:
    """Channels of the CTD's lags [s]: dives and climbs differ by 2 lag dx/dt."""
    if dive.period > FULL_RATE:
        return {}
    rate = np.gradient(_filled(depth), dive.period)
    warmth, cell, salinity = map(dive.get, ("temperature", "conductivity", "salinity"))
    if cell is None and salinity is not None and warmth is not None:
        import gsw  # the log's salinity was computed from conductivity by PSS-78

        pressure = dive.get("pressure")
        deep = depth if pressure is None else np.where(np.isfinite(pressure), pressure, depth)
        cell = np.asarray(gsw.C_from_SP(salinity, warmth, deep) / 10.0)  # [S/m] from mS/cm
    lag, late_cell = (None if x is None else _lag(x, depth, rate) for x in (warmth, cell))
    if late_cell is not None and lag is not None:
        # internal waves between a dive and its climb shift both sensors alike
        late_cell = late_cell - lag
    # a lag is the same in both halves of a dive; moved water is not
    return {
        name: float(one[0])
        for name, one in (("temperature_lag", lag), ("cell_lag", late_cell))
        if one is not None and abs(one[1] - one[2]) < max(AGREE, abs(one[0]))
    }


def _lag(values: Array, depth: Array, rate: Array) -> Array | None:
    """Lag [s] of a sensor: of the whole dive, its upper and its lower half, (3,)."""
    known = np.isfinite(values) & np.isfinite(depth) & (depth > SHALLOW) & (np.abs(rate) > 0.03)
    place = (np.nan_to_num(depth) / LAYER).astype(int)
    phases = known & (rate > 0.0), known & (rate < 0.0)
    if min(phase.sum() for phase in phases) < 30:
        return None
    size = int(place[known].max()) + 1
    profiles = []
    for phase in phases:
        at, count = place[phase], np.bincount(place[phase], minlength=size)
        with np.errstate(invalid="ignore", divide="ignore"):
            profiles += [np.bincount(at, x[phase], size) / count for x in (values, rate)]
    falling, sinking, rising, climbing = profiles
    slope = np.gradient(0.5 * (falling + rising), LAYER)
    # x(t) = X(z) - lag dX/dz w: the sign of the error differs between dives and climbs
    late = slope * (climbing - sinking)
    both = np.flatnonzero(np.isfinite(late) & np.isfinite(falling) & np.isfinite(rising))
    off, gain = (falling - rising)[both], late[both]
    told = np.cumsum(gain**2)
    if len(both) < 8 or not told[-1] > 0.0:
        return None
    middle = int(np.searchsorted(told, 0.5 * told[-1])) + 1
    parts = slice(None), slice(0, middle), slice(middle, None)
    return np.array([off[k] @ gain[k] / max(gain[k] @ gain[k], 1e-30) for k in parts])


def flight_model(vehicle: Vehicle) -> Calibration | None:
    """Calibration of a vehicle that has a flight model; None for others."""
    glides = isinstance(vehicle.law, FlowFrame) and len(vehicle.masses) == 1
    if not glides or not isinstance(vehicle.steered("buoyancy"), Pump):
        return None
    return load_calibration(vehicle)
