"""Choices among a Slocum's sensors: pressure, pump, batteries and thruster.

The least noisy pressure is used, its gaps filled from the others; of two pumps, the moving one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import clean
from factory.importing.deployment_log import EMPTY, Channel
from factory.importing.gps_fixes import nearest
from factory.importing.pressures import pressure_of, to_dbar
from factory.importing.tally import Tally, leave_out
from factory.importing.units import to_cm3

Array = NDArray[np.float64]

INCH_HG = 3386.389
"""[Pa] One inch of mercury at 0 degC (NIST SP 811)."""
PRESSURES = ("sci_water_pressure", "m_water_pressure", "m_pressure")
"""[bar] Pressure sensors; the least noisy is used."""
OWN = PRESSURES[1:]
"""Pressure sensors from which the vehicle computes `m_depth`."""
_COVERED, _COVER_GAP = 0.9, 60.0
"""_COVERED: share of the longest coverage that a chosen sensor needs. _COVER_GAP: [s] longest gap
that counts as covered."""
_MOVING = 8.0
"""[dbar] Smallest pressure at which noise is measured, below the waves."""
_ZERO = 20.0
"""[dbar] Largest zero offset of a sensor at the surface."""
_FLOATING = 1.0
"""[dbar] Largest range of a sensor's lowest tenth if these samples are at the surface. A sensor
that is switched off near the surface passes through them faster."""
_HOLE = 15.0
"""[s] A sensor that is silent for longer, and for three of its spacings, is off."""
_SHALLOW = 20.0
"""[dbar] Sensors are compared in shallower water: gaps are at the surface."""
_RAMP = 60.0
"""[s] Time in which one sensor passes into the other, so that no step looks like a depth rate."""
_RATE, _ENOUGH = 0.05, 10
"""_RATE: [dbar/s] slowest descent or climb. _ENOUGH: minimum number of samples of a median."""
_SAME_ZERO = 2.0
"""[dbar] Sensors that differ by less have one zero: a lag of some seconds, or half a hull's length
at 26 degree of pitch, makes as much."""
_DRIFTED, _CLEARLY = 1.0, 5.0
"""[dbar] A zero counts as moved if it moves by more than `_DRIFTED` and by more than `_CLEARLY`
times the differences between neighbouring gaps."""
_NEIGHBOURS = 5
"""Number of gaps in the running median."""
_AGREE = 25.0
"""[dbar] Sensors of one vehicle that differ by more are not joined; an offset that was never
subtracted is smaller."""


def slocum_pressure(
    native: Mapping[str, Channel], tally: Tally, *, latitude: float = 0.0
) -> dict[str, Channel]:
    """Least noisy pressure [dbar] of the sensors that cover the log, with its gaps filled.

    A CTD is switched off near the surface, and for whole dives; the vehicle's own sensors are not.
    Satellite files often have only the depth, which then replaces the vehicle's own pressure.
    Values that fill a gap are shifted by the difference of the two sensors in shallow water.

    Args:
      native: channels in native units.
      tally: receives the counts.
      latitude: [degree] of the log, for pressure from depth.

    Raises:
      InputError: pressure and depth fit no unit.
    """
    depth = native.get("m_depth", EMPTY)
    found: dict[str, Channel] = {}
    for name in PRESSURES:
        one = native.get(name, EMPTY)
        if len(one) < 2:
            continue
        depths = depth.at(one.time) if len(depth) else None
        dbar = to_dbar(one.values, depths, name, tally, native="bar")
        channel = clean("measured_pressure", one.time, dbar, tally, subject=name)
        if len(channel) > 2:
            found[name] = channel
    if not found:
        return {}
    if not any(name in found for name in OWN) and len(depth) > 2:
        dbar = pressure_of(depth.values, latitude)
        found["m_depth"] = clean("measured_pressure", depth.time, dbar, tally, subject="m_depth")
    cover = {name: _cover(channel) for name, channel in found.items()}
    enough = [n for n in found if cover[n] >= _COVERED * max(cover.values())]
    enough = [n for n in enough if n in PRESSURES] or enough  # prefer sensors to depth
    noise = {n: pressure_noise(found[n]) for n in found}
    best = min(enough, key=lambda n: noise[n])
    pressure = found.pop(best)
    others = ", ".join(f"{n} {noise[n]:.2g}" for n in enough if n != best)
    note = f"from {best}" + (f", noise {noise[best]:.2g} dbar" if np.isfinite(noise[best]) else "")
    note += f" (not {others})" if others else ""
    tally.add("note", "measured_pressure", len(pressure), note)
    for name in sorted(found, key=lambda n: noise[n]):
        pressure, added = filled(pressure, found[name], sparse=name == "m_depth")
        tally.add("note", "measured_pressure", added, f"from {name} where {best} was silent")
        if not added:
            leave_out([name], f"{best} is taken, and has no hole that it fills", tally)
    return {"measured_pressure": pressure}


def _cover(channel: Channel) -> float:
    """[s] Time under water that a sensor covers; a fast sensor has more samples, not more cover.

    Under water is relative to the sensor's own zero, so that an offset does not count.
    """
    gap = np.minimum(np.diff(channel.time), _COVER_GAP)
    low, high = np.percentile(channel.values, [1.0, 10.0])
    floats = high - low < _FLOATING and 0.0 < low < _ZERO
    zero = float(low) if floats else 0.0
    return float(gap[channel.values[1:] > zero + _MOVING].sum())


def filled(pressure: Channel, other: Channel, *, sparse: bool = False) -> tuple[Channel, int]:
    """Fill gaps of a pressure with another sensor's samples; return their number too.

    A gap is longer than `_HOLE` and three spacings, or before the first and after the last sample.
    In a `sparse` log a sample between two gaps does not show the difference of the sensors: a
    sensor that wakes repeats its last value.
    """
    reach = max(_HOLE, 3.0 * pressure.spacing)
    edges = np.concatenate([[-np.inf], pressure.time, [np.inf]])
    at = np.searchsorted(edges, other.time, side="right") - 1
    inside = (edges[at + 1] - edges[at] > reach) & (edges[at] < other.time)
    shift = _zero_difference(pressure, other) if inside.any() else None
    if shift is None:
        return pressure, 0
    at, added = at[inside], other.time[inside]
    low, high = edges[at], edges[at + 1]
    steps = [_edge_difference(pressure, other, shift, edge) for edge in (low, high)]
    if sparse:
        gaps = np.concatenate([[np.inf], np.diff(edges), [np.inf]])
        single = gaps[at] > reach, gaps[at + 2] > reach
        steps = [np.where(lone, np.nan, step) for lone, step in zip(single, steps, strict=True)]
    # a moved zero: the same difference is left at both edges, in descent and climb
    moved = _zero_change(at, 0.5 * (steps[0] + steps[1]))
    shifts = shift + moved
    for edge, step in zip((low, high), steps, strict=True):
        ramp = np.clip(1.0 - np.abs(added - edge) / _RAMP, 0.0, 1.0)
        shifts += np.where(np.isfinite(step), step - moved, 0.0) * ramp
    time = np.concatenate([pressure.time, added])
    values = np.concatenate([pressure.values, other.values[inside] - shifts])
    order = np.argsort(time, kind="stable")
    return Channel(time[order], values[order]), len(added)


def _zero_change(hole: NDArray[np.intp], step: Array) -> Array:
    """[dbar] Change of the difference of the zeros at each added sample.

    The median over neighbouring gaps is used, as the value of a single gap is noise of a turn.

    Args:
      hole: number of a sample's gap, not decreasing. step: NaN where unknown.
    """
    _, first, of = np.unique(hole, return_index=True, return_inverse=True)
    each = step[first]
    known = np.flatnonzero(np.isfinite(each))
    if not known.size:
        return np.zeros(len(step))
    values = each[known]
    reach = [min(_NEIGHBOURS // 2, k, known.size - 1 - k) for k in range(known.size)]
    smooth = np.array([np.median(values[k - near : k + near + 1]) for k, near in enumerate(reach)])
    inner = np.abs(values - smooth)[_NEIGHBOURS // 2 : known.size - _NEIGHBOURS // 2]
    noise = float(np.median(inner)) if inner.size else np.inf
    found = np.interp(np.arange(len(each)), known, smooth)
    if np.abs(found).max() <= max(_DRIFTED, _CLEARLY * noise):
        return np.zeros(len(step))
    return np.asarray(found[of])


def _edge_difference(pressure: Channel, other: Channel, shift: float, edge: Array) -> Array:
    """[dbar] Remaining difference at the edges of gaps; NaN where unknown."""
    there = np.isfinite(edge)
    at = np.where(there, edge, pressure.time[0])
    near = np.abs(nearest(other.time, at) - at) < _HOLE
    left = other.at(at) - pressure.at(at) - shift
    return np.where(there & near & (np.abs(left) < _AGREE), left, np.nan)


def _zero_difference(pressure: Channel, other: Channel) -> float | None:
    """[dbar] Excess of `other` over `pressure`; None if they contradict or never meet.

    A sensor that answers late, or sits further aft, shows more in one direction and less in the
    other. The mean of descent and climb is the difference at rest; a small one counts as 0.
    """
    step = np.searchsorted(pressure.time, other.time)
    left = pressure.time[np.clip(step - 1, 0, len(pressure) - 1)]
    right = pressure.time[np.clip(step, 0, len(pressure) - 1)]
    near = (np.abs(other.time - left) < _HOLE) & (np.abs(right - other.time) < _HOLE)
    below = pressure.at(other.time)
    shallow = near & (below < _SHALLOW)
    near = shallow if shallow.any() else near
    difference = other.values - below
    rate = np.gradient(other.values, other.time)
    directions = [near & (rate > _RATE), near & (rate < -_RATE)]
    if min(int(direction.sum()) for direction in directions) < _ENOUGH:
        directions = [near]
    if not directions[0].any():
        return None
    shift = float(np.mean([np.median(difference[direction]) for direction in directions]))
    if abs(shift) < _SAME_ZERO:
        return 0.0
    return shift if abs(shift) < _AGREE else None


def pressure_noise(channel: Channel) -> float:
    """[dbar] Noise of one sample: its distance from the line between its neighbours."""
    time, values = channel.time, channel.values
    if len(time) < 3:
        return float("inf")
    part = (time[1:-1] - time[:-2]) / np.maximum(time[2:] - time[:-2], 1e-9)
    line = values[:-2] + part * (values[2:] - values[:-2])
    use = (values[1:-1] > _MOVING) & (time[2:] - time[:-2] < 6.0 * channel.spacing)
    if use.sum() < 10:
        return float("inf")
    residual = np.abs((values[1:-1] - line)[use])
    # the mean of the central nine tenths: a median of quantised data is zero
    return float(np.mean(residual[residual <= np.percentile(residual, 90.0)]))


PUMPS = (("m_ballast_pumped", "c_ballast_pumped"), ("m_de_oil_vol", "c_de_oil_vol"))
"""[cm3] Measured and commanded volume, + = lighter: shallow gliders have a ballast pump, deep ones
an oil bladder."""
_MOVES = 1e-6
"""Range below which a pump does not move, in any unit from cm3 to m3."""
_PART = 0.05
"""Fraction of the other pump's range below which a pump is at rest and noisy."""


def slocum_pump(
    native: Mapping[str, Channel], tally: Tally, declared: Collection[str] = ()
) -> dict[str, Channel]:
    """Measured and commanded volume [cm3] of the pump that moves; of two, the fuller record.

    The software also writes the sensor of a pump that the vehicle lacks: once at the start, or as 0
    in every cycle. A log with neither gives nothing; the report lists it as missing.

    Args:
      declared: sensors whose unit the files declare, so that it is not guessed from their range.
    """
    weights = {
        pair: _weight(*(native.get(name, EMPTY) for name in pair))
        for pair in PUMPS
        if any(len(native.get(name, ())) for name in pair)
    }
    if not weights:
        return {}
    most = max(moved for moved, _ in weights.values())
    best = max(weights, key=lambda pair: (weights[pair][0] >= _PART * most, weights[pair][1]))
    others = [pair for pair in weights if pair is not best]
    channels: dict[str, Channel] = {}
    for name, target in zip(best, ("measured_pump", "commanded_pump"), strict=True):
        one = native.get(name, EMPTY)
        if len(one):
            volume = one.values if name in declared else to_cm3(one.values, name, tally)
            channels[target] = clean(target, one.time, volume, tally, subject=name)
    for pair in others:
        for name in pair:
            if len(native.get(name, ())):
                why = f"another pump's: {best[0]} has the samples and moves"
                leave_out([name], why, tally, samples=len(native[name]))
        tally.add(
            "note", "measured_pump", len(native.get(best[0], ())),
            f"from {best[0]}, moves by {weights[best][0]:.4g} cm3 (not {pair[0]} "
            f"{len(native.get(pair[0], ()))} samples, {weights[pair][0]:.4g} cm3)",
        )  # fmt: skip
    return channels


def _weight(measured: Channel, commanded: Channel) -> tuple[float, int]:
    """Range of a pump, 0 at rest, and its number of samples."""
    if not len(measured):
        return 0.0, len(commanded)
    moved = float(np.ptp(np.percentile(measured.values, [1.0, 99.0])))
    return (moved if moved > _MOVES else 0.0), len(measured)


def slocum_batteries(native: Mapping[str, Channel], tally: Tally) -> dict[str, Channel]:
    """Battery and thruster channels from a Slocum's sensors; of two alike, the first is used."""
    found: dict[str, Channel] = {}
    for target, (names, factor) in SLOCUM.items():
        there = [name for name in names if len(native.get(name, ()))]
        if not there:
            continue
        one = native[there[0]]
        found[target] = clean(target, one.time, factor * one.values, tally, subject=there[0])
        leave_out(there[1:], f"{there[0]} says the same", tally)
    return found | _thruster(native, found.get("measured_voltage", EMPTY), tally)


def _thruster(native: Mapping[str, Channel], voltage: Channel, tally: Tally) -> dict[str, Channel]:
    """Power [W] that the thruster takes from the batteries: its current at their voltage.

    `m_thruster_power` is at the motor's own, lower voltage; it is used without the other two.
    """
    current, power = (native.get(name, EMPTY) for name in THRUSTER)
    if len(current) and len(voltage):
        leave_out(THRUSTER[1:], f"{THRUSTER[0]} at the batteries' voltage is taken", tally)
        power = Channel(current.time, current.values * voltage.at(current.time))
    if not power.values.any():
        return {}  # a vehicle without a thruster writes 0 once
    name = "measured_thruster_power"
    return {name: clean(name, power.time, power.values, tally)}


THRUSTER = ("m_thruster_current", "m_thruster_power")
"""Current [A] and power [W] of a Slocum's thruster."""
SLOCUM = {
    "measured_charge": (("m_coulomb_amphr_total", "m_coulomb_amphr"), 1.0),
    "measured_voltage": (("m_battery", "m_battery_inst"), 1.0),
    "measured_battery_current": (("m_coulomb_current",), 1.0),
    "measured_vacuum": (("m_vacuum",), INCH_HG),
}
"""Slocum's sensors by the store's name, the preferred first, and the factor to the store's unit."""
SLOCUM_UNITS = {
    **dict.fromkeys(SLOCUM["measured_charge"][0], "A h"),
    **dict.fromkeys(SLOCUM["measured_voltage"][0], "V"),
    "m_coulomb_current": "A", "m_thruster_current": "A", "m_thruster_power": "W",
    "m_vacuum": "inHg",
}  # fmt: skip
"""Units of these sensors."""
SLOCUM_SENSORS = (*(name for names, _ in SLOCUM.values() for name in names), *THRUSTER)
