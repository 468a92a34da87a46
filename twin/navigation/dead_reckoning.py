"""Dead reckoning: horizontal tracks from surge, sway, attitude and depth.

The equations are (2) and (3) of Saksvik, Alcocer and Hassani (2021, A Deep Learning Approach to
Dead-Reckoning Navigation), "the paper", with two repairs. Heave is solved from the vertical row,
given surge and sway, instead of from the depth rate alone. The east row has its heave term.
Integration is trapezoidal. The result is the track THROUGH THE WATER. Angles are radians here;
`AttitudeSeries.of` converts a store's degrees.

A steady uniform current cannot be observed from sensors that move with the water. A track over
ground is therefore a track through the water plus an assumption about the current:

- `none`: the water stands still;
- `previous`: the depth-averaged current of the previous dive, as gliders use on board;
- `corrected`: the current of the dive itself, known after its end. The misclosure at the first fix
  after the dive is spread linearly in time over the dive (a linear ramp; Tethys' post-processing
  nudges its track to the fixes in the same way).

The depth-averaged current of a dive is its misclosure divided by its duration: fix at the end,
minus fix at the start, minus the track through the water in between (Eriksen et al. 2001).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError, unknown_name
from twin.vehicle.laws.flow_frame import is_flow_frame
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Signals = Mapping[str, Array]
"""Channels (time,) of one mission by schema name; angles in degrees as stored."""

LEAST_COSINE = 0.2
"""[1] cos(pitch) cos(roll) below which the solved heave is damped: the body's z axis is then within
12 degrees of the horizontal, and the depth rate says little about heave."""
SURFACE_DEPTH = 1.0
"""[m] Depth above which a vehicle is afloat: it drifts and has no speed through the water."""
SHALLOW_DEPTH = 3.0
"""[m] Depth above which a vehicle at rest is afloat: pressure gauges are off by a metre or two."""
RESTING_RATE = 0.02
"""[m/s] Averaged depth rate below which the depth is at rest: a tenth of the slowest glide."""
RESTING_WINDOW_S = 10.0
"""[s] Window of that average."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AttitudeSeries:
    """Roll, pitch and heading of one mission, ZYX Euler angles from NED to body FRD."""

    roll: Array
    """[rad], starboard down, (time,)"""
    pitch: Array
    """[rad], nose up, (time,)"""
    heading: Array
    """[rad], from true north over east, (time,)"""

    def __post_init__(self) -> None:
        shapes = {np.shape(self.roll), np.shape(self.pitch), np.shape(self.heading)}
        if len(shapes) != 1:
            raise InputError(f"roll, pitch and heading must be of one shape, got {sorted(shapes)}")

    @classmethod
    def of(
        cls, signals: Signals, source: Literal["measured", "true"] = "measured"
    ) -> AttitudeSeries:
        """Read the measured or the true attitude.

        Raises:
          StoreError: a channel is missing or not finite (named).
        """
        names = {name: f"{source}_{name}" for name in ("roll", "pitch", "heading")}
        return cls(**{k: np.deg2rad(finite_channel(signals, v)) for k, v in names.items()})


def finite_channel(signals: Signals, name: str) -> Array:
    """Read a required channel as float64 (time,), all finite.

    Raises:
      StoreError: the channel is missing, or not finite; the first such sample is named.
    """
    if name not in signals:
        raise StoreError(f"the mission has no channel {name}")
    values = np.asarray(signals[name], np.float64)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise StoreError(
            f"channel {name} is not finite at {bad.size} of {values.size} samples, first at "
            f"sample {bad[0]}; repair or drop the mission"
        )
    return values


def values_of(
    sample: Mapping[str, float], names: Iterable[str], readers: str, wrong: str = ""
) -> list[float]:
    """Read values of a sample by name.

    Args:
      readers: text after "the sample has no channel NAME": which method reads which channels.
      wrong: text after "channel NAME" for a value that is not finite; "" accepts such values.

    Raises:
      InputError: a channel is missing, or `wrong` is not "" and a value is not finite.
    """
    try:
        found = {name: float(sample[name]) for name in names}
    except KeyError as lost:
        raise InputError(f"the sample has no channel {lost}{readers}") from None
    if wrong and not math.isfinite(sum(found.values())):
        bad = next(name for name, value in found.items() if not math.isfinite(value))
        raise InputError(f"channel {bad}{wrong}")
    return list(found.values())


def no_glider(vehicle: Vehicle) -> str:
    """Reason why a vehicle does not glide by lift and drag coefficients; empty if it does.

    Methods that assume a glider's balance of forces call this.
    """
    if vehicle.steered("speed") is not None:
        return f"vehicle {vehicle.name!r} has a propeller: it does not glide"
    if vehicle.steered("buoyancy") is None:
        return f"vehicle {vehicle.name!r} has no pump: it does not glide"
    if not is_flow_frame(vehicle.law):
        return (
            f"vehicle {vehicle.name!r} has the hull law {vehicle.law.kind!r}: no lift and drag "
            "coefficients"
        )
    return ""


def afloat(depth: Array, period: float) -> Mask:
    """Samples at which a vehicle with this measured depth [m] is at the surface, (time,)."""
    rate = smooth(depth_rate(depth, period), RESTING_WINDOW_S, period)
    resting = (depth < SHALLOW_DEPTH) & (np.abs(rate) < RESTING_RATE)
    return resting | (depth < SURFACE_DEPTH)


def smooth(values: Array, seconds: float, period: float) -> Array:
    """Centred moving average over about `seconds`, shorter at the ends; (..., time)."""
    half = round(0.5 * seconds / period)
    count = values.shape[-1]
    total = np.zeros((*values.shape[:-1], count + 1))
    np.cumsum(values, axis=-1, out=total[..., 1:])
    index = np.arange(count)
    first = np.maximum(index - half, 0)
    last = np.minimum(index + half + 1, count)
    return np.asarray((total[..., last] - total[..., first]) / (last - first))


def hold(values: Array, valid: Mask, initial: float = 0.0) -> Array:
    """Last valid value at each sample, `initial` before the first; (time,)."""
    last = np.maximum.accumulate(np.where(valid, np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], initial)


def bridge(values: Array, valid: Mask, outside: float = 0.0, *, held: bool = False) -> Array:
    """Values with the invalid samples interpolated; (time,).

    `outside` fills the samples before the first and after the last valid one; all if none is valid.
    With `held`, the last valid value fills the samples after it.
    """
    index = np.arange(len(values))
    if not valid.any():
        return np.full(len(values), outside)
    after = values[valid][-1] if held else outside
    return np.interp(index, index[valid], values[valid], left=outside, right=after)


def sample_times(samples: int, period: float) -> Array:
    """Seconds since the first sample, (time,)."""
    return np.arange(samples, dtype=np.float64) * period


def depth_rate(depth: Array, period: float) -> Array:
    """Depth rate [m/s], by central differences, one-sided at both ends.

    Args:
      depth: [m], (time,), at least two samples.
      period: [s] between samples.
    """
    return np.gradient(depth, period)


def heave_from_depth_rate(
    depth_rate: Array, surge: Array, sway: Array, roll: Array, pitch: Array
) -> Array:
    """Solve the depth rate for heave [m/s], body FRD, (time,).

    Solves the vertical row of the kinematics (paper eq. 2; Fossen 2011, eq. 2.33),

        z' = -u sin(theta) + v cos(theta) sin(phi) + w cos(theta) cos(phi),

    for w. Below `LEAST_COSINE` the quotient is replaced by a damped one that fades to zero. The
    result is the velocity through the water in still water; a vertical current adds to w.
    """
    cosine = np.cos(pitch) * np.cos(roll)
    rest = depth_rate + surge * np.sin(pitch) - sway * np.cos(pitch) * np.sin(roll)
    return rest * cosine / np.maximum(cosine**2, LEAST_COSINE**2)


def rotate_to_ned(velocity: Array, attitude: AttitudeSeries) -> Array:
    """Rotate FRD velocities (time, 3) to NED (time, 3) by ZYX angles (Fossen 2011, eq. 2.22)."""
    u, v, w = np.moveaxis(velocity, -1, 0)
    s_roll, c_roll = np.sin(attitude.roll), np.cos(attitude.roll)
    s_pitch, c_pitch = np.sin(attitude.pitch), np.cos(attitude.pitch)
    s_head, c_head = np.sin(attitude.heading), np.cos(attitude.heading)
    # Pitch and roll first: forward and starboard in the horizontal plane of the heading.
    forward = u * c_pitch + (v * s_roll + w * c_roll) * s_pitch
    starboard = v * c_roll - w * s_roll
    down = -u * s_pitch + (v * s_roll + w * c_roll) * c_pitch
    north = forward * c_head - starboard * s_head
    east = forward * s_head + starboard * c_head
    return np.stack([north, east, down], axis=-1)


def horizontal_velocity(
    surge: Array, sway: Array, depth_rate: Array, attitude: AttitudeSeries
) -> Array:
    """North, east velocity through the water [m/s], (time, 2), with heave from the depth rate."""
    heave = heave_from_depth_rate(depth_rate, surge, sway, attitude.roll, attitude.pitch)
    return rotate_to_ned(np.stack([surge, sway, heave], axis=-1), attitude)[:, :2]


def integrate(velocity: Array, period: float) -> Array:
    """Trapezoidal integral from zero of (time,) or (time, n), same shape."""
    velocity = np.asarray(velocity, np.float64)
    steps = (velocity[1:] + velocity[:-1]) * (0.5 * period)
    return np.concatenate([np.zeros_like(velocity[:1]), np.cumsum(steps, axis=0)])


def water_track(
    surge: Array, sway: Array, depth: Array, attitude: AttitudeSeries, period: float
) -> Array:
    """Displacement north and east through the water since the start [m], (time, 2).

    Args:
      surge, sway: through the water [m/s], body FRD, (time,).
      depth: measured depth [m], (time,).
      attitude: measured or true.
      period: [s] between samples.
    """
    return integrate(horizontal_velocity(surge, sway, depth_rate(depth, period), attitude), period)


def true_water_track(signals: Signals, period: float) -> Array:
    """True displacement north and east through the water [m], (time, 2).

    It is the track over ground minus the integral of the current at the vehicle.
    """
    current = np.stack([finite_channel(signals, f"true_current_{n}") for n in ("north", "east")], 1)
    return true_ground_track(signals) - integrate(current, period)


def true_ground_track(signals: Signals) -> Array:
    """True displacement north and east over ground since the first sample [m], (time, 2)."""
    track = np.stack([finite_channel(signals, f"true_{n}") for n in ("north", "east")], 1)
    return track - track[0]


def true_water_path(signals: Signals, period: float) -> Array:
    """Length [m] of the horizontal path through the water up to each sample, (time,)."""
    velocity = [
        finite_channel(signals, f"true_velocity_{n}") - finite_channel(signals, f"true_current_{n}")
        for n in ("north", "east")
    ]
    return integrate(np.hypot(*velocity), period)


def horizontal_error(track: Array, truth: Array) -> Array:
    """Distance [m] between two tracks (time, 2) at each sample, (time,)."""
    return np.hypot(*(np.asarray(track) - np.asarray(truth)).T)


CurrentKnowledge = Literal["none", "previous", "corrected"]
KNOWLEDGE: tuple[CurrentKnowledge, ...] = get_args(CurrentKnowledge)

LEAST_DIVE_S = 300.0
"""[s] Shortest time without a fix that counts as a dive, as in the vehicle's own software
(twin.sensors.onboard); shorter gaps are missed fixes at the surface."""


class Dive(NamedTuple):
    """Dive between the two fixes that bracket it."""

    start: int
    """Sample of the last fix before the dive."""
    end: int
    """Sample of the first fix after the dive."""
    start_fix: Array
    """[m] north, east of the fix before, (2,)"""
    end_fix: Array
    """[m] north, east of the fix after, (2,)"""

    @property
    def span(self) -> slice:
        """Samples of the dive, both fixes included."""
        return slice(self.start, self.end + 1)

    def seconds(self, period: float) -> float:
        """Duration [s]."""
        return (self.end - self.start) * period


def gps_fixes(signals: Signals) -> tuple[NDArray[np.intp], Array]:
    """Samples with a fix, (n,), and the fixes north, east [m], (n, 2); empty without a GPS."""
    names = ("measured_gps_north", "measured_gps_east")
    if any(name not in signals for name in names):
        return np.zeros(0, np.intp), np.zeros((0, 2))
    fixes = np.stack([np.asarray(signals[name], np.float64) for name in names], axis=1)
    index = np.flatnonzero(np.isfinite(fixes).all(axis=1))
    return index, fixes[index]


def find_dives(signals: Signals, period: float) -> list[Dive]:
    """Find the dives of a mission with a fix before and after, in order of time."""
    index, fixes = gps_fixes(signals)
    gaps = np.flatnonzero(np.diff(index) * period >= LEAST_DIVE_S)
    return [
        Dive(start=int(index[k]), end=int(index[k + 1]), start_fix=fixes[k], end_fix=fixes[k + 1])
        for k in gaps
    ]


def depth_averaged_current(dive: Dive, water_track: Array, period: float) -> Array:
    """Depth-averaged current of one dive, north, east [m/s], (2,).

    Args:
      water_track: estimated track through the water [m], (time, 2), of the whole mission.
    """
    moved = water_track[dive.end] - water_track[dive.start]
    return (dive.end_fix - dive.start_fix - moved) / dive.seconds(period)


def dive_track(dive: Dive, water_track: Array, current: Array, period: float) -> Array:
    """Track over ground [m] of a dive, from its first fix, (samples of the dive, 2).

    Args:
      water_track: estimated track through the water [m], (time, 2), of the whole mission.
      current: north, east [m/s], (2,), constant over the dive.
    """
    time = period * np.arange(dive.end - dive.start + 1)
    moved = water_track[dive.span] - water_track[dive.start]
    return dive.start_fix + moved + time[:, None] * current


def ground_track(
    water_track: Array,
    signals: Signals,
    period: float,
    *,
    knowledge: CurrentKnowledge = "previous",
    start: Array | None = None,
) -> Array:
    """Track over ground [m], (time, 2), re-initialised at every GPS fix.

    Args:
      water_track: estimated track through the water [m], (time, 2).
      knowledge: what is known about the current; see the module's text. With `corrected`, the
        samples after the last dive use that dive's current.
      start: north, east [m] of the first sample, (2,); default the origin.

    Raises:
      InputError: unknown `knowledge`.
    """
    if knowledge not in KNOWLEDGE:
        raise InputError(unknown_name("knowledge of the current", knowledge, KNOWLEDGE))
    samples = len(water_track)
    index, fixes = gps_fixes(signals)
    dives = find_dives(signals, period)
    currents = [depth_averaged_current(dive, water_track, period) for dive in dives]
    known = np.zeros((samples, 2))
    if knowledge != "none":
        for dive, current in zip(dives, currents, strict=True):
            # "previous" has the current from the dive's end on, "corrected" from its start on
            known[dive.end if knowledge == "previous" else dive.start :] = current
    moved = np.array(water_track)
    moved[1:] += np.cumsum(known[:-1] * period, axis=0)  # each current holds to the next sample
    anchors = np.zeros((samples, 2))
    anchors[:] = (np.zeros(2) if start is None else np.asarray(start)) - moved[0]
    for k, (sample, fix) in enumerate(zip(index, fixes, strict=True)):
        last = index[k + 1] if k + 1 < len(index) else samples
        anchors[sample:last] = fix - moved[sample]
    return moved + anchors
