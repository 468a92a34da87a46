"""Channels of a dive: made of its signals, each NaN where the log does not tell it."""

from __future__ import annotations

import math

import numpy as np

from glider_twin_ops.health.channels import NAMES
from glider_twin_ops.health.dive_signals import DiveSignals, binned, filled, strokes_of
from twin import Vehicle
from twin.identify import Calibration, balance, load_calibration
from twin.numbers import Array
from twin.vehicle.laws import FlowFrame
from twin.vehicle.parts import BatteryHinge, Fin, Pump

BIN = 60.0
"""[s] of the means that steady flight is judged by"""
STEADY_PITCH = 8.0
"""[degree] flatter than this no glider glides"""
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


def channels_of(dive: DiveSignals, calibration: Calibration | None) -> Array:
    """Value of each channel, (channels,); NaN where the log does not tell it.

    Args:
      calibration: whose flight model depth rates are beside; None: the vehicle has none.
    """
    found = dict.fromkeys(NAMES, math.nan)
    depth = dive.get("depth")
    if depth is None or len(depth) < 10:
        return np.array(list(found.values()))
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
    width = max(round(BIN / dive.period), 1)
    roll = np.zeros(len(depth)) if roll is None else roll
    shift, density = dive.get("shift"), dive.get("density")
    nothing = np.full(len(depth), np.nan)
    z, theta, phi, volume, place, rho = (
        binned(v, width)
        for v in (depth, pitch, roll, pump, nothing if shift is None else shift,
                  nothing if density is None else density)
    )  # fmt: skip
    if len(z) < 3:
        return {}
    # the slope of depth between the middles of the bins around
    span = width * dive.period
    rate = np.gradient(z, span)
    spread = [np.maximum(np.abs(np.diff(v, prepend=v[:1])), np.abs(np.diff(v, append=v[-1:])))
              for v in (theta, volume)]  # fmt: skip
    steady = (spread[0] < STEADY_CHANGE) & (spread[1] < STEADY_PUMP) & (z > SHALLOW)
    steady &= np.abs(theta) > STEADY_PITCH
    rho = np.where(np.isfinite(rho), rho, calibration.sea_density(z))
    pitched = calibration.true_pitch(np.deg2rad(theta))
    net = calibration.net_mass(rho, np.maximum(z, 0.0), volume, np.zeros(len(z)))
    known = np.isfinite(net) & np.isfinite(pitched)
    net, pitched = np.where(known, net, 0.0), np.where(known, pitched, 0.0)
    rates = np.zeros((3, len(z)))
    speed, alpha, _, gliding = balance(
        calibration.vehicle, net, np.deg2rad(np.nan_to_num(phi)), pitched, rates
    )
    model = -speed * np.sin(pitched - alpha)
    found: dict[str, float] = {}
    vehicle = calibration.vehicle
    lever = 1e3 * vehicle.metacentric_height * vehicle.mass / vehicle.battery.mass
    moved = 1e3 * place + lever * np.tan(pitched)
    for word, sign in (("dive", 1.0), ("climb", -1.0)):
        phase = steady & known & (sign * rate > 0.02) & (-sign * theta > 0.0)
        used = phase & gliding & (sign * model > 0.02)
        if used.sum() >= LEAST_BINS:
            found[f"rate_{word}"] = float(1.0 - model[used].sum() / rate[used].sum())
        trimmed = phase & np.isfinite(moved)
        if trimmed.sum() >= LEAST_BINS:
            found[f"trim_{word}"] = float(np.median(moved[trimmed]))
    return found


def _turning(dive: DiveSignals, depth: Array, vehicle: Vehicle) -> dict[str, float]:
    """Roll, the place of what turns it, and how well it holds its heading."""
    found: dict[str, float] = {}
    part = vehicle.steered("heading")
    heading, roll = dive.get("heading"), dive.get("roll")
    place: Array | None = None
    if isinstance(part, Fin):
        place = dive.get("fin")
    elif isinstance(part, BatteryHinge):
        place = dive.get("rotation")
    width = max(round(BIN / dive.period), 1)
    z = binned(depth, width)
    rate = np.gradient(z, width * dive.period) if len(z) > 2 else np.zeros(len(z))
    straight = np.ones(len(z), bool)
    if heading is not None:
        turned = np.rad2deg(np.unwrap(np.deg2rad(filled(heading))))
        ahead = binned(turned, width)
        straight = np.abs(np.gradient(ahead)) < 6.0 if len(ahead) > 2 else straight
    rolled = None if roll is None else binned(roll, width)
    at = None if place is None else binned(place, width)
    if rolled is not None and isinstance(part, BatteryHinge) and at is not None:
        rolled = rolled - _roll_per_turn(vehicle) * at
    for word, sign in (("dive", 1.0), ("climb", -1.0)):
        phase = straight & (z > SHALLOW) & (sign * rate > 0.02)
        for name, values in (("roll", rolled), ("turn", at)):
            if values is not None:
                used = phase & np.isfinite(values)
                if used.sum() >= LEAST_BINS:
                    found[f"{name}_{word}"] = float(np.median(values[used]))
    under = depth > SHALLOW
    if place is not None and under.sum() > 20:
        own = at[(z > SHALLOW) & np.isfinite(at)] if at is not None else np.zeros(0)
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


def _roll_per_turn(vehicle: Vehicle) -> float:
    """Roll over the turn of a battery that hangs below the axis, near the middle."""
    hung = vehicle.battery.mass * vehicle.battery.eccentricity
    return -hung / max(vehicle.mass * vehicle.metacentric_height, 1e-9)


def _pump(dive: DiveSignals, depth: Array) -> dict[str, float]:
    """How fast the pump pumps, and what it takes beside the sea's own work."""
    volume = dive.get("pump")
    if volume is None or dive.period > FINEST:
        return {}
    strokes = strokes_of(volume, dive.period)
    rate, out = strokes.rate, strokes.out
    found: dict[str, float] = {}
    # a valve lets some through, and short strokes have ends alone
    if out.sum() >= 5:
        whole = strokes.inner & (rate > WHOLE * float(rate[out].max()))
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
    voltage, current = dive.get("voltage"), dive.get("battery_current")
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
                slope = float(drop @ (amperes[loaded] - rest))
                slope /= float(((amperes[loaded] - rest) ** 2).sum())
                if slope > 1e-4:
                    found["resistance"] = math.log(slope)
        return found
    charge = dive.get("charge")
    if charge is not None and voltage is not None:
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
    vacuum, warmth = dive.get("vacuum"), dive.get("temperature")
    # at the surface a bladder takes air out of the hull
    under = depth > SHALLOW
    if vacuum is not None and np.isfinite(vacuum[under]).any():
        vacuum, warmth = vacuum[under], None if warmth is None else warmth[under]
        if warmth is not None and not np.isfinite(warmth).any():
            warmth = None
        kelvin = ZERO_C + (10.0 if warmth is None else float(np.nanmean(warmth)))
        found["air"] = math.log((SEA_LEVEL - float(np.nanmean(vacuum))) / kelvin)
    highest = float(np.nanmin(depth))
    if highest < 10.0:
        floats = np.abs(np.gradient(filled(depth), dive.period)) < FLOATING
        afloat = floats & (depth < highest + AFLOAT)
        # a dive whose log ends below has its begin alone there, which already sinks
        up = depth[np.isfinite(depth)][-1] < highest + 3.0 * AFLOAT
        if up and afloat.sum() >= max(2.0, RESTS / dive.period):
            found["surface_depth"] = float(np.median(depth[afloat]))
    mode = dive.get("dvl_mode")
    if mode is not None:
        found["lock"] = float((mode[np.isfinite(mode)] > 0.0).mean())
    return found


def _lags(dive: DiveSignals, depth: Array) -> dict[str, float]:
    """By how much temperature and conductivity are late: dives and climbs differ by 2 lag dx/dt."""
    found: dict[str, float] = {}
    rate = np.gradient(filled(depth), dive.period)
    for name in ("temperature", "conductivity"):
        values = dive.get(name) if name == "temperature" else _conductivity(dive, depth)
        if values is None:
            continue
        known = np.isfinite(values) & np.isfinite(depth) & (depth > SHALLOW) & (np.abs(rate) > 0.03)
        place = (depth / LAYER).astype(int)
        down, up = known & (rate > 0.0), known & (rate < 0.0)
        if down.sum() < 30 or up.sum() < 30:
            continue
        size = int(place[known].max()) + 1
        profiles = []
        for phase in (down, up):
            total = np.bincount(place[phase], values[phase], size)
            count = np.bincount(place[phase], minlength=size)
            moved = np.bincount(place[phase], rate[phase], size)
            with np.errstate(invalid="ignore", divide="ignore"):
                profiles.append((total / count, moved / count))
        (falling, sinking), (rising, climbing) = profiles
        slope = np.gradient(0.5 * (falling + rising), LAYER)
        both = np.isfinite(slope) & np.isfinite(falling) & np.isfinite(rising)
        # x(t) = X(z) - lag dX/dz w: late in dives by one sign, in climbs by the other
        late = slope * (climbing - sinking)
        both &= np.isfinite(late)
        if both.sum() >= 8 and float((late[both] ** 2).sum()) > 0.0:
            off = (falling - rising)[both]
            found[f"{name}_lag"] = float(off @ late[both] / (late[both] ** 2).sum())
    # water that waves move between a dive and its climb moves both
    if len(found) == 2:
        found["cell_lag"] = found["conductivity_lag"] - found["temperature_lag"]
    found.pop("conductivity_lag", None)
    return found


def _conductivity(dive: DiveSignals, depth: Array) -> Array | None:
    """[S/m] as logged, or of the salinity that the log was given of it by PSS-78."""
    salinity, temperature = dive.get("salinity"), dive.get("temperature")
    if (told := dive.get("conductivity")) is not None or salinity is None or temperature is None:
        return told
    import gsw

    pressure = dive.get("pressure")
    deep = depth if pressure is None else np.where(np.isfinite(pressure), pressure, depth)
    made = gsw.C_from_SP(salinity, temperature, deep)
    return np.asarray(made / 10.0)  # from mS/cm


def flight_model(vehicle: Vehicle) -> Calibration | None:
    """The calibration of a vehicle with a flight model; None of others."""
    if not isinstance(vehicle.law, FlowFrame) or len(vehicle.masses) != 1:
        return None
    if not isinstance(vehicle.steered("buoyancy"), Pump):
        return None
    return load_calibration(vehicle)
