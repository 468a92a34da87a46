"""Channels of a dive: made of the signals that a log has of it, NaN where it does not tell one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.health.channels import NAMES
from twin import Vehicle
from twin.identify import Calibration, balance, load_calibration
from twin.numbers import Array
from twin.vehicle.laws import FlowFrame
from twin.vehicle.parts import BatteryHinge, Fin, Pump

Mask = NDArray[np.bool_]
PUMPING = 0.15
"""[cm3/s] from which a pump pumps"""
STEEP, LEAST_SAMPLES = 8.0, 20
"""[degree] and samples from which on a vehicle dives or climbs"""
BIN, STEADY_PITCH = 60.0, 8.0
"""[s] of the means that steady flight is judged by; [degree] flatter than this no glider glides"""
STEADY_CHANGE, STEADY_PUMP = 4.0, 15.0
"""[degree], [cm3] of change from bin to bin that ends a steady flight"""
SHALLOW = 5.0
"""[m] above which a hull is near the surface"""
AFLOAT, FLOATING, RESTS = 0.5, 0.05, 20.0
"""[m] below the highest depth of a dive, and [m/s] of rise and fall there, of what floats: waves;
[s] that it must float: what turns below the surface is as slow for a moment"""
LEAST_BINS = 4
"""of a phase: with fewer it says nothing"""
WHOLE, LEAST_WHOLE = 0.7, 2.0
"""Part of the highest rate from which on a pump pumps as it can, and samples of that, one after the
other, from which on a stroke tells its rate: a fast pump's falls off from sample to sample, and how
high its one highest is depends on when it was sampled"""
FINEST = 20.0
"""[s] between samples beyond which a pump's moves are not seen"""
LAYER = 2.0
"""[m] of the bins in which dives and climbs of a CTD are compared"""
SEA_LEVEL, ZERO_C = 101_325.0, 273.15
"""[Pa], [K]"""
PHASES = (("dive", 1.0), ("climb", -1.0))
"""Sign of the depth rate in each"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveSignals:
    """What a log has of one dive, each array (n,)."""

    period: float
    """[s]"""
    signals: Mapping[str, Array]
    """by the names of the schema"""
    current: tuple[float, float] = (math.nan, math.nan)
    """north, east [m/s] between its fixes by the depth rate and the compass"""
    echoes: float = math.nan
    """of the floor, over those that earlier dives had at its heights"""
    powered: bool = False
    """A thruster drove it: neither its glide nor its power is that of others"""

    def get(self, name: str) -> Array | None:
        """A measured signal with a finite value."""
        found = self.signals.get(f"measured_{name}")
        return None if found is None or not np.isfinite(found).any() else found

    def settings(self) -> list[float]:
        """What a pilot had set, as the log shows it: depth [m] of the lower turn, then of dive and
        climb each the pitch [degree], nose up positive, and the volume [cm3] that is pumped out;
        NaN where the log does not tell."""
        depth, pitch, pump = self.get("depth"), self.get("pitch"), self.get("pump")
        found = [math.nan if depth is None else float(np.nanmax(depth))]
        for sign in (-1.0, 1.0):
            way = np.zeros(0, bool) if pitch is None else sign * pitch > STEEP
            for values in (pitch, pump):
                told = None if values is None or way.sum() <= LEAST_SAMPLES else values[way]
                found.append(math.nan if told is None else float(np.nanmedian(told)))
        return found


class Strokes(NamedTuple):
    """When a pump pumps out, each (n,)."""

    rate: Array
    """[cm3/s] from the sample before"""
    out: Mask
    """it pumps out"""
    inner: Mask
    """both neighbours are of the stroke too: at an end a sample has a part of it alone"""


def strokes_of(volume: Array, period: float) -> Strokes:
    """Strokes of a pump's volume [cm3], (n,), with a period [s] between samples."""
    whole = _filled(volume)
    rate = np.diff(whole, prepend=whole[:1]) / period
    out = rate > PUMPING
    inner = out.copy()
    inner[1:] &= out[:-1]
    inner[:-1] &= out[1:]
    return Strokes(rate, out, inner)


def _binned(values: Array | None, width: int, count: int) -> Array:
    """Means of bins of so many of `count` samples, of which NaN are left out; NaN of no signal."""
    values = np.full(count, np.nan) if values is None else values
    block = values[: count // width * width].reshape(-1, width)
    known = np.isfinite(block)
    total = np.where(known, block, 0.0).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(total / known.sum(axis=1))


def _filled(values: Array) -> Array:
    """Straight lines across NaN."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) == len(values):
        return values
    return np.interp(np.arange(len(values)), known, values[known])


def channels_of(dive: DiveSignals, calibration: Calibration | None) -> Array:
    """Value of each channel, (channels,); NaN where the log does not tell it.

    Args:
      calibration: whose flight model depth rates are beside; None: the vehicle has none.
    """
    found = dict.fromkeys(NAMES, math.nan)
    depth = dive.get("depth")
    if depth is not None and len(depth) >= 10:
        if not dive.powered:
            if calibration is not None:
                found |= _flight(dive, depth, calibration)
                found |= _turning(dive, depth, calibration.vehicle)
            found |= _pump(dive, depth)
            found |= _power(dive, depth)
        found |= _hull(dive, depth)
        found |= _lags(dive, depth)
        found["current_north"], found["current_east"] = dive.current
        found["echoes"] = dive.echoes
    return np.array([found[name] for name in NAMES], float)


def _flight(dive: DiveSignals, depth: Array, calibration: Calibration) -> dict[str, float]:
    """Depth rates and trim in steady flight."""
    pitch, pump, roll = dive.get("pitch"), dive.get("pump"), dive.get("roll")
    if pitch is None or pump is None:
        return {}
    width, count = max(round(BIN / dive.period), 1), len(depth)
    roll = np.zeros(count) if roll is None else roll
    z, theta, phi, volume, place, rho = (
        _binned(values, width, count)
        for values in (depth, pitch, roll, pump, dive.get("shift"), dive.get("density"))
    )
    if len(z) < 3:
        return {}
    # the slope of depth between the middles of the bins around
    rate = np.gradient(z, width * dive.period)
    steady = (z > SHALLOW) & (np.abs(theta) > STEADY_PITCH)
    for values, most in ((theta, STEADY_CHANGE), (volume, STEADY_PUMP)):
        change = np.abs(np.diff(values))
        steady &= np.maximum(np.append(0.0, change), np.append(change, 0.0)) < most
    rho = np.where(np.isfinite(rho), rho, calibration.sea_density(z))
    pitched = calibration.true_pitch(np.deg2rad(theta))
    net = calibration.net_mass(rho, np.maximum(z, 0.0), volume, np.zeros(len(z)))
    known = np.isfinite(net) & np.isfinite(pitched)
    net, pitched = np.where(known, net, 0.0), np.where(known, pitched, 0.0)
    vehicle = calibration.vehicle
    rolled = np.deg2rad(np.nan_to_num(phi))
    speed, alpha, _, gliding = balance(vehicle, net, rolled, pitched, np.zeros((3, len(z))))
    model = -speed * np.sin(pitched - alpha)
    lever = 1e3 * vehicle.metacentric_height * vehicle.mass / vehicle.battery.mass
    moved = 1e3 * place + lever * np.tan(pitched)
    found: dict[str, float] = {}
    for word, sign in PHASES:
        phase = steady & known & (sign * rate > 0.02) & (-sign * theta > 0.0)
        used = phase & gliding & (sign * model > 0.02)
        if used.sum() >= LEAST_BINS:
            found[f"rate_{word}"] = float(1.0 - model[used].sum() / rate[used].sum())
        found |= _median(f"trim_{word}", moved, phase)
    return found


def _median(name: str, values: Array | None, phase: Mask) -> dict[str, float]:
    """A channel that is the median of the bins of a phase; nothing where these are few."""
    used = np.zeros(0) if values is None else values[phase & np.isfinite(values)]
    return {name: float(np.median(used))} if len(used) >= LEAST_BINS else {}


def _turning(dive: DiveSignals, depth: Array, vehicle: Vehicle) -> dict[str, float]:
    """Roll, the place of what turns it, and how well it holds its heading."""
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
        # roll over the turn of a battery that hangs below the axis, near the middle
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
            # the median: the turn onto a new leg is no error
            found["heading_error"] = math.log(max(float(np.rad2deg(np.median(error))), 0.05))
    return found


def _pump(dive: DiveSignals, depth: Array) -> dict[str, float]:
    """How fast the pump pumps, and what it takes beside the sea's own work."""
    volume = dive.get("pump")
    if volume is None or dive.period > FINEST:
        return {}
    rate, out, inner = strokes_of(volume, dive.period)
    found: dict[str, float] = {}
    # a valve lets some through, and short strokes have ends alone
    if out.sum() >= 5:
        whole = inner & (rate > WHOLE * float(rate[out].max()))
        lasting = np.diff(np.flatnonzero(np.diff(whole, prepend=False, append=False)))[::2]
        if whole.any() and float(np.median(lasting)) >= LEAST_WHOLE:
            found["pump_rate"] = math.log(float(np.median(rate[whole])))
    power = dive.get("pump_power")
    if power is not None and out.any():
        vacuum = dive.get("vacuum")
        inside = 3e4 if vacuum is None else float(np.nanmedian(vacuum))
        pressure = (1e4 * np.maximum(depth, 0.0) + inside)[out]
        against = float(np.nansum(pressure * 1e-6 * rate[out])) * dive.period
        taken = float(np.nansum(power[out | np.roll(out, 1)])) * dive.period
        if against > 100.0 and taken > 0.0:
            found["pump_work"] = math.log(taken / against)
    return found


def _power(dive: DiveSignals, depth: Array) -> dict[str, float]:
    """Power of the electronics, and the voltage's drop under load."""
    voltage, current, charge = (dive.get(n) for n in ("voltage", "battery_current", "charge"))
    found: dict[str, float] = {}
    if voltage is not None and current is not None:
        known = np.isfinite(voltage) & np.isfinite(current) & (depth > SHALLOW)
        volts, amperes = voltage[known], current[known]
        if known.sum() > 20:
            rest = np.median(amperes)
            spread = 1.4826 * float(np.median(np.abs(amperes - rest)))
            quiet = np.abs(amperes - rest) <= max(3.0 * spread, 1e-3)
            found["hotel"] = float(np.mean(amperes[quiet]) * np.mean(volts[quiet]))
            loaded = amperes > rest + max(0.1, 5.0 * spread)
            if loaded.sum() >= 5:
                drop = float(np.median(volts[quiet])) - volts[loaded]
                more = amperes[loaded] - rest
                slope = float(drop @ more) / float((more**2).sum())
                if slope > 1e-4:
                    found["resistance"] = math.log(slope)
    elif charge is not None and voltage is not None:
        read = np.flatnonzero(np.isfinite(charge))
        if len(read) > 1 and read[-1] - read[0] > 10:
            hours = (read[-1] - read[0]) * dive.period / 3600.0
            taken = float(charge[read[-1]] - charge[read[0]])
            if taken > 0.0:
                found["hotel"] = taken / hours * float(np.nanmedian(voltage))
    return found


def _hull(dive: DiveSignals, depth: Array) -> dict[str, float]:
    """Air in the hull, depth at the surface, the Doppler log's lock."""
    found: dict[str, float] = {}
    vacuum, warmth, mode = (dive.get(name) for name in ("vacuum", "temperature", "dvl_mode"))
    # at the surface a bladder takes air out of the hull
    under = depth > SHALLOW
    if vacuum is not None and np.isfinite(vacuum[under]).any():
        kelvin = ZERO_C + 10.0
        if warmth is not None and np.isfinite(warmth[under]).any():
            kelvin = ZERO_C + float(np.nanmean(warmth[under]))
        found["air"] = math.log((SEA_LEVEL - float(np.nanmean(vacuum[under]))) / kelvin)
    highest = float(np.nanmin(depth))
    if highest < 10.0:
        floats = np.abs(np.gradient(_filled(depth), dive.period)) < FLOATING
        afloat = floats & (depth < highest + AFLOAT)
        # a dive whose log ends below has its begin alone there, which already sinks
        up = depth[np.isfinite(depth)][-1] < highest + 3.0 * AFLOAT
        if up and afloat.sum() >= max(2.0, RESTS / dive.period):
            found["surface_depth"] = float(np.median(depth[afloat]))
    if mode is not None:
        found["lock"] = float((mode[np.isfinite(mode)] > 0.0).mean())
    return found


def _lags(dive: DiveSignals, depth: Array) -> dict[str, float]:
    """By how much temperature and conductivity are late: dives and climbs differ by 2 lag dx/dt."""
    found: dict[str, float] = {}
    rate = np.gradient(_filled(depth), dive.period)
    warmth, cell, salinity = map(dive.get, ("temperature", "conductivity", "salinity"))
    if cell is None and salinity is not None and warmth is not None:
        import gsw  # the salinity that the log was given of it by PSS-78

        pressure = dive.get("pressure")
        deep = depth if pressure is None else np.where(np.isfinite(pressure), pressure, depth)
        cell = np.asarray(gsw.C_from_SP(salinity, warmth, deep) / 10.0)  # [S/m] from mS/cm
    for name, values in (("temperature_lag", warmth), ("cell_lag", cell)):
        if values is None:
            continue
        known = np.isfinite(values) & np.isfinite(depth) & (depth > SHALLOW) & (np.abs(rate) > 0.03)
        place = (depth / LAYER).astype(int)
        phases = known & (rate > 0.0), known & (rate < 0.0)
        if min(phase.sum() for phase in phases) < 30:
            continue
        size = int(place[known].max()) + 1
        profiles = []
        for phase in phases:
            at, count = place[phase], np.bincount(place[phase], minlength=size)
            with np.errstate(invalid="ignore", divide="ignore"):
                profiles += [np.bincount(at, x[phase], size) / count for x in (values, rate)]
        falling, sinking, rising, climbing = profiles
        slope = np.gradient(0.5 * (falling + rising), LAYER)
        # x(t) = X(z) - lag dX/dz w: late in dives by one sign, in climbs by the other
        late = slope * (climbing - sinking)
        both = np.isfinite(late) & np.isfinite(falling) & np.isfinite(rising)
        if both.sum() >= 8 and float((late[both] ** 2).sum()) > 0.0:
            off = (falling - rising)[both]
            found[name] = float(off @ late[both] / (late[both] ** 2).sum())
    # water that waves move between a dive and its climb moves both
    late_cell = found.pop("cell_lag", math.nan) - found.get("temperature_lag", math.nan)
    return found if math.isnan(late_cell) else {**found, "cell_lag": late_cell}


def flight_model(vehicle: Vehicle) -> Calibration | None:
    """Calibration of a vehicle with a flight model; None of others."""
    glides = isinstance(vehicle.law, FlowFrame) and len(vehicle.masses) == 1
    if not glides or not isinstance(vehicle.steered("buoyancy"), Pump):
        return None
    return load_calibration(vehicle)
