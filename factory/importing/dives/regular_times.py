"""Regular times: the channels of one dive, brought to a uniform time grid."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import EMPTY, NEAR, Channel, DeploymentLog
from factory.importing.dives.dive_checks import DEEP, floating, running
from factory.importing.dives.positions import put_fixes, put_onboard, put_true_track
from factory.importing.dives.segments import LogSegment, float_at_fixes, phases
from factory.importing.gps_fixes import nearest
from factory.importing.plausibility import DiveRules
from factory.importing.tally import Tally
from twin.geodesy import offset
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ANGLES = frozenset({"measured_heading", "commanded_heading", "true_heading"})
"""Angles [degree] on a circle, interpolated the short way round."""
HELD = frozenset(
    {"commanded_shift", "commanded_rotation", "commanded_pump", "commanded_pitch",
     "commanded_heading", "commanded_segment", "measured_dvl_mode", "measured_pump_power",
     "measured_thruster_power"}
)  # fmt: skip
"""Signals that are set at once and kept: the last value holds."""
KNOWN_FROM = frozenset({"measured_current_north", "measured_current_east"})
"""Signals whose last value holds, unknown before the first."""
SPARSE = frozenset(
    {"true_speed", "true_surge", "true_sway", "true_heave", "true_current_north",
     "true_current_east", "true_current_down", "measured_dvl_surge", "measured_dvl_sway",
     "measured_dvl_heave", "measured_charge", "measured_voltage", "measured_battery_current",
     "measured_vacuum", "measured_altitude",
     *(f"measured_{by}_{axis}_deviation" for by in ("dvl", "camera")
       for axis in ("surge", "sway", "heave")),
     *(f"measured_camera_{axis}" for axis in ("surge", "sway", "heave")),
     *(f"measured_bottom_{axis}" for axis in ("surge", "sway", "heave"))}
)  # fmt: skip
"""Signals that take the nearest original sample, if it lies within half a period."""
WATER = frozenset({"measured_temperature", "measured_salinity", "measured_density"})
"""Signals that are interpolated only near samples of the CTD."""
DEPTHS = ("measured_depth", "measured_pressure")
"""Signals without gaps in a store: gaps are bridged and marked."""
MEASURING = re.compile(r"measured_(pitch|roll|heading|\w+_rate|specific_force_\w)")
"""Signals of sensors that never report on change: unknown without a sample."""
MOST_HOLES = 100_000
"""Maximum number of grid samples of a row that is not checked for gaps: six days at 5 s."""
_MOST_HOLE = 10.0
"""Maximum ratio of grid samples to logged samples in a longer row."""
_GAP_FACTOR = 3.0
"""Shortest gap, in usual sample spacings."""
_TRUTH = ("true_surge", "true_sway", "true_heave")


def not_empty(
    log: DeploymentLog, segments: Sequence[LogSegment], period: float, tally: Tally
) -> list[LogSegment]:
    """Leave out long rows that are almost only a gap, such as years after a wrong fix.

    A row's grid takes memory for its length, whatever it holds, and all rows of a store are as long
    as its longest.
    """
    kept = []
    for segment in segments:
        count, samples = segment.duration / period, 0
        if count > MOST_HOLES:
            inside = [one.within(segment.start, segment.end) for one in log.channels.values()]
            samples = max(map(len, inside), default=0)
        if count <= max(MOST_HOLES, _MOST_HOLE * samples):
            kept.append(segment)
            continue
        day = np.datetime64(int(segment.start), "s").astype("datetime64[D]")
        tally.add(
            "left out", "rows", 1,
            f"{log.deployment}: {segment.duration / 86400.0:.4g} days from {day} with {samples} "
            "samples: a hole, or a clock or a fix that is wrong",
        )  # fmt: skip
    return kept


def on_grid(
    log: DeploymentLog, segment: LogSegment, period: float, rules: DiveRules, tally: Tally
) -> dict[str, Array]:
    """Signals of one row on a uniform grid from its start, the last sample nearest to its end.

    A channel ends where its sensor, or the vehicle's computer, ends: unknown values are NaN. Depth
    and pressure are bridged instead; `measured_gap` marks the gaps.

    Args:
      period: [s] sampling interval.
    """
    count = max(2, round(segment.duration / period) + 1)
    times = np.asarray(segment.start + period * np.arange(count), np.float64)
    signals: dict[str, Array] = {}
    awake = running(log, segment, times)
    for name, channel in log.channels.items():
        values = _on_times(name, channel, log, segment, times, period, awake)
        if values is not None and np.isfinite(values).any():
            signals[name] = values
    for name in ("true_north", "true_east"):
        if name in signals:  # a simulated log has its own origin
            signals[name] = signals[name] - signals[name][0]
    _fill_density(signals, tally)
    put_true_track(log, segment, times, signals)
    gap = _gaps(log, times, period)
    tally.add("interpolated", "attitude or depth", gap, "grid samples within gaps")
    signals["measured_gap"] = gap.astype(np.float64)
    stored, depth = log.channel("phase_stored"), signals.get("measured_depth")
    if len(stored):
        signals["measured_phase"] = _value_near(stored, times, _reach(log, period))
    elif depth is not None:
        found = phases(times - times[0], depth, rules.surface_depth)
        signals["measured_phase"] = float_at_fixes(found, depth, segment, period)
    put_fixes(log, segment, times, period, signals)
    _put_waypoint(log, segment, times, signals)
    _put_times(log, times, period, signals)
    put_onboard(log, segment, times, signals)
    _put_truth(log, times, signals)
    return signals


def cells_on_grid(log: DeploymentLog, segment: LogSegment, period: float) -> Array | None:
    """Cells of a Doppler log in one row, (time, cells, 3): of the ensemble within half a period."""
    count = max(2, round(segment.duration / period) + 1)
    times = np.asarray(segment.start + period * np.arange(count), np.float64)
    return _value_near(log.cells, times, 0.5 * period) if len(log.cells) else None


def _on_times(
    name: str,
    channel: Channel,
    log: DeploymentLog,
    segment: LogSegment,
    times: Array,
    period: float,
    awake: Mask,
) -> Array | None:
    """Put a channel on the times of a row's grid; None without a sample near.

    Args:
      awake: True while the vehicle's computer runs, (time,).
    """
    gaps = name in VARIABLES and VARIABLES[name].gaps
    if log.gridded and (name in WATER or gaps):
        return _value_near(channel, times, _reach(log, period))
    if name in HELD | KNOWN_FROM:
        known = awake & ~_ended(name, channel, times)
        known |= _distance(channel, times) <= period
        if name in KNOWN_FROM:
            known &= times >= channel.time[0]
        return np.where(known & (channel.time[0] <= times[-1]), _held_value(channel, times), np.nan)
    # samples just outside belong to the row's ends, samples of other dives do not
    margin = max(period, _GAP_FACTOR * channel.spacing if len(channel) > 1 else 0.0)
    near = channel.within(times[0] - margin, times[-1] + margin)
    if not len(near):
        return None
    if name in SPARSE:
        return _value_near(near, times, 0.5 * period)
    if name in DEPTHS:
        return _extend_to_fixes(near, segment).at(times)
    if name in log.held:
        values = _held_value(near, times)
    elif name in ANGLES:
        turned = np.degrees(np.unwrap(np.radians(near.values)))
        values = np.mod(np.interp(times, near.time, turned), 360.0)
    else:
        values = near.at(times)
    if name in WATER:
        known = _distance(near, times) <= NEAR
    elif gaps:
        known = _bridged(near, times)
    else:
        known = near.covers(times) | (_distance(near, times) <= period)
        if near.on_change:  # holds only while the computer writes
            known &= awake
        known |= floating(near, log, segment, times)
        reported = name.startswith(("measured_", "commanded_")) and not MEASURING.fullmatch(name)
        if reported:  # may be reported on change: holds while the computer runs
            known |= (times >= channel.time[0]) & ~_ended(name, channel, times) & awake
    return np.where(known, values, np.nan)


def _ended(name: str, channel: Channel, times: Array) -> NDArray[np.bool_]:
    """True once a sensor that reports on change has been silent for longer than ever before."""
    if name in KNOWN_FROM or not name.startswith("measured_"):  # holds until the next value
        return np.zeros(len(times), bool)
    longest = float(np.diff(channel.time).max(initial=0.0))
    return times - channel.time[-1] > max(longest, NEAR)


def _extend_to_fixes(depth: Channel, segment: LogSegment) -> Channel:
    """Add depth 0 at the fix before a record that begins deep, and after one that ends deep."""
    time, values = depth.time, depth.values
    if segment.start_fix is not None and values[0] > DEEP and time[0] - segment.start > NEAR:
        time, values = np.append(segment.start, time), np.append(0.0, values)
    if segment.end_fix is not None and values[-1] > DEEP and segment.end - time[-1] > NEAR:
        time, values = np.append(time, segment.end), np.append(values, 0.0)
    return Channel(time, values)


def _distance(channel: Channel, times: Array) -> Array:
    """[s] Time from each of `times` to the channel's nearest sample."""
    return np.abs(nearest(channel.time, times) - times)


def _value_near(channel: Channel, times: Array, reach: float) -> Array:
    """Value of the nearest sample within `reach` [s], else NaN."""
    at = nearest(channel.time, times)
    values = channel.values[np.searchsorted(channel.time, at)]
    return np.where((np.abs(at - times) <= reach).T, values.T, np.nan).T


def _reach(log: DeploymentLog, period: float) -> float:
    """[s] Half of the longer sampling interval: the log's or the store's."""
    return 0.5 * max(period, log.period or 0.0)


def _held_value(channel: Channel, times: Array) -> Array:
    """Value of the last sample at or before each time; of the first sample before that."""
    index = np.searchsorted(channel.time, times, side="right") - 1
    return channel.values[np.maximum(index, 0)]


def _gaps(log: DeploymentLog, times: Array, period: float) -> Mask:
    """True where attitude or depth has no original sample near.

    Near is within half of `_GAP_FACTOR` times the median spacing of the samples around a time. So
    a vehicle that samples every minute at depth has no gap there.
    """
    gap = np.zeros(len(times), bool)
    stored = log.channel("gap_stored")
    if len(stored):
        return _value_near(stored, times, _reach(log, period)) > 0.5
    margin = _LONGEST_REGULAR * _AROUND
    for names in (("measured_pitch",), ("measured_depth", "measured_pressure")):
        channel = _first_of(log, names)
        if len(channel):
            near = channel.within(times[0] - margin, times[-1] + margin)
            if not len(near):
                gap[:] = True
                continue
            usual = np.clip(near.usual_spacing(times), channel.spacing, _LONGEST_REGULAR)
            reach = np.maximum(0.5 * _GAP_FACTOR * np.nan_to_num(usual), period)
            gap |= _distance(near, times) > reach
    return gap


def _first_of(log: DeploymentLog, names: Sequence[str]) -> Channel:
    """First of the named channels that the log has; empty if it has none."""
    return next((one for name in names if len(one := log.channel(name))), EMPTY)


_LONGEST_REGULAR = 300.0
"""[s] Longest usual spacing: rarer samples do not resolve a vehicle's turns."""
_AROUND = 9
"""Number of spacings whose median is the usual one."""


def _bridged(channel: Channel, times: Array) -> Mask:
    """True for times between samples that are near enough to be joined by a line."""
    distance = _distance(channel, times)
    if len(channel) < 2:
        return distance <= NEAR
    at = np.searchsorted(channel.time, times, side="right")
    outside = (at == 0) | (at == len(channel))
    hole = np.diff(channel.time)[np.clip(at - 1, 0, len(channel) - 2)]
    longest = np.maximum(NEAR, _GAP_FACTOR * channel.usual_spacing(times))
    return np.where(outside, distance <= NEAR, (hole <= longest) | (distance < _AT_SAMPLE))


_AT_SAMPLE = 1e-3
"""[s] Distance from a sample within which its value always holds."""


def _fill_density(signals: dict[str, Array], tally: Tally) -> None:
    """Fill density where the CTD was off, from the row's own profile at the same depth."""
    density, depth = signals.get("measured_density"), signals.get("measured_depth")
    if density is None or depth is None:
        return
    there = np.isfinite(density)
    missing = ~there & np.isfinite(depth)
    if not missing.any() or there.sum() < 10:
        return
    known = depth[there]
    missing &= (depth > float(known.min()) - _BEYOND) & (depth < float(known.max()) + _BEYOND)
    order = np.argsort(known)
    profile = np.interp(depth, known[order], density[there][order])
    signals["measured_density"] = np.where(missing, profile, density)
    why = "grid samples without CTD: from the row's own profile at that depth"
    tally.add("interpolated", "measured_density", missing, why)


_BEYOND = 25.0
"""[m] Distance above and below a profile up to which it is used."""


def _put_waypoint(
    log: DeploymentLog, segment: LogSegment, times: Array, signals: dict[str, Array]
) -> None:
    """Add the waypoint [m] from the row's start, held; NaN before the first one."""
    latitude, longitude = log.channel("waypoint_latitude"), log.channel("waypoint_longitude")
    origin = segment.start_fix or segment.end_fix
    if origin is None or not len(latitude) or latitude.time[0] > times[-1]:
        return
    values = offset(_held_value(latitude, times), _held_value(longitude, times), *origin)
    known = (times >= latitude.time[0]) & running(log, segment, times)
    for axis, one in zip(("north", "east"), values, strict=True):
        signals[f"commanded_waypoint_{axis}"] = np.where(known, one, np.nan)


_ORIGINALS = {
    "measured_depth_time": ("measured_pressure", "measured_depth"),
    "measured_attitude_time": ("measured_pitch", "measured_heading"),
    "measured_ctd_time": ("measured_temperature",),
}
"""Signals of original sample times, and their channels: the first that the log has is used."""


def _put_times(log: DeploymentLog, times: Array, period: float, signals: dict[str, Array]) -> None:
    """Add times [s] from the row's start of the original samples nearest to those of the grid."""
    for name, sources in _ORIGINALS.items():
        kept = log.channel(name.replace("_time", "_original"))
        channel = _first_of(log, sources)
        if len(kept):
            signals[name] = _value_near(kept, times, _reach(log, period)) - times[0]
        elif len(channel):
            signals[name] = nearest(channel.time, times) - times[0]


def _put_truth(log: DeploymentLog, times: Array, signals: dict[str, Array]) -> None:
    """Add true velocity [m/s] through the water in body axes, and current, near truth samples."""

    def near(channel: Channel) -> Mask:
        return _distance(channel, times) <= 0.5 * channel.spacing

    parts = [log.channel(f"velocity_{axis}") for axis in ("north", "east", "down")]
    angles = ("measured_roll", "measured_pitch", "measured_heading")
    if all(map(len, parts)) and set(angles) <= set(signals):
        known = near(parts[0]) & (signals["measured_gap"] < 0.5)
        if known.any():
            ned = np.stack([part.at(times) for part in parts])
            body = to_body(ned, *(np.radians(signals[name]) for name in angles))
            for name, values in zip(_TRUTH, body, strict=True):
                signals[name] = np.where(known, values, np.nan)
            signals["true_speed"] = np.where(known, np.linalg.norm(ned, axis=0), np.nan)
    for axis in ("north", "east"):
        current = log.channel(f"current_{axis}")
        if len(current) and (known := near(current)).any():
            signals[f"true_current_{axis}"] = np.where(known, current.at(times), np.nan)


def to_body(ned: Array, roll: Array, pitch: Array, heading: Array) -> Array:
    """Rotate vectors (3, time) from NED to forward-starboard-down axes; angles in rad, ZYX."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    ch, sh = np.cos(heading), np.sin(heading)
    north, east, down = ned
    return np.stack(
        [
            cp * ch * north + cp * sh * east - sp * down,
            (sr * sp * ch - cr * sh) * north + (sr * sp * sh + cr * ch) * east + sr * cp * down,
            (cr * sp * ch + sr * sh) * north + (cr * sp * sh - sr * ch) * east + cr * cp * down,
        ]
    )
