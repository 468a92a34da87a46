"""Playback: poses of a trajectory at the frames' times, gaps closed, and colours of its track."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.frames import euler_to_quaternion, flip_quaternion, flip_vector
from twin.records.logged import source_of
from twin.records.schema import VARIABLES, variable
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory, actuator_names
from twin.show.render.camera import Array, nice_step

SLIDES, TURNS, SPINS = "m", "degree", "rad s-1"
"""Units of parts. SLIDES: that slide on a rail. TURNS: that turn to an angle. SPINS: that spin"""
DISPLACES = "cm3"  # unit of parts that change the volume
POSITION = ("north", "east", "depth")  # signals without which nothing can be drawn
ATTITUDE = ("roll", "pitch", "heading")
BODY = ("surge", "sway", "heave")
SIGNALS = {
    "speed": (("true_surge", "true_sway", "true_heave"), "speed through water", "m/s"),
    "current": (("true_current_north", "true_current_east"), "current speed", "m/s"),
    "depth": (("true_depth",), "depth", "m"),
}
"""Components whose norm is the value, label and unit, by the name of the colouring quantity"""
LEAST_RANGE = 0.02  # [m/s] least range of a colour scale: a smaller one would show noise


@dataclasses.dataclass(frozen=True, kw_only=True)
class Poses:
    """Poses and readouts of the glider at some times, NED and FRD; angles in degrees."""

    time: Array  # [s], shape (n,)
    position: Array  # north, east, depth [m], shape (n, 3)
    quaternion: Array  # hull to MuJoCo's world (w, x, y, z), shape (n, 4)
    joints: tuple[str, ...]
    """Names of the parts that slide, turn or spin, equal to those of the joints and bodies"""
    parts: Array  # positions of the parts [m], [rad] or [rad/s], shape (n, number of joints)
    angles: Array
    """[rad] Angle through which each part has turned, for a spinning part the integral of its rate,
    0 for a sliding part. Shape (n, number of joints)"""
    roll: Array
    pitch: Array
    heading: Array  # [degree], shape (n,)
    speed: Array  # [m/s] through the water, shape (n,); NaN where unknown
    net_mass: Array  # [kg], positive is heavy, shape (n,); NaN where unknown
    current: Array  # north, east [m/s], shape (n, 2); NaN where unknown
    pumped: Array | None = None
    """[cm3] Pumped volume in a log, whose net mass is unknown, shape (n,); NaN where unknown"""
    bridged: NDArray[np.bool_] | None = None
    """True in a gap of the log, where all values but the time are interpolated, shape (n,)"""
    unknown: frozenset[str] = frozenset()
    """Names among roll, pitch, heading, speed, net_mass and pumped that are never known"""


def poses(trajectory: Trajectory, times: Array) -> Poses:
    """Interpolate a trajectory to `times` [s].

    The pose comes from the recorded MuJoCo states, and equals them to the bit at recorded times. In
    a store without states (real logs) the pose comes from attitude and position signals. Angles
    that a log lacks follow the track's direction, and are listed in `unknown`.

    Raises:
      InputError: a needed signal is missing or never finite.
    """
    recorded = trajectory.time
    if len(recorded) < 2:
        raise InputError("this mission has fewer than 2 samples: nothing to draw")
    unknown = _unknown(trajectory)
    attitude = {
        name: along_track(trajectory, name) if name in unknown else signal(trajectory, name)
        for name in ATTITUDE
    }
    if len(trajectory.states) == len(recorded):
        quaternions = trajectory.states[:, 3:7]
        position = flip_vector(trajectory.states[:, :3])
    else:
        turned = (np.deg2rad(attitude[name]) for name in ATTITUDE)
        quaternions = flip_quaternion(euler_to_quaternion(*turned))
        position = np.stack([signal(trajectory, name) for name in POSITION], axis=-1)
    joints = moving_parts(trajectory)
    parts, angles = part_motion(trajectory, joints, times)
    velocity = [told(trajectory, name) for name in BODY]
    speed = np.sqrt(np.sum(np.square(velocity), axis=0))
    flow = [optional(trajectory, f"current_{n}", np.nan) for n in ("north", "east")]
    heading = np.unwrap(attitude["heading"], period=360.0)
    return Poses(
        time=times,
        position=_interpolate(times, recorded, position),
        quaternion=interpolate_quaternion(times, recorded, quaternions),
        joints=joints,
        parts=parts,
        angles=angles,
        roll=np.interp(times, recorded, attitude["roll"]),
        pitch=np.interp(times, recorded, attitude["pitch"]),
        heading=np.interp(times, recorded, heading),
        speed=np.interp(times, recorded, speed),
        net_mass=np.interp(times, recorded, told(trajectory, "net_mass")),
        current=_interpolate(times, recorded, np.stack(flow, axis=-1)),
        pumped=np.interp(times, recorded, _volume(trajectory)),
        bridged=np.interp(times, recorded, _gaps(trajectory)) > 0.0,
        unknown=unknown,
    )


def _unknown(trajectory: Trajectory) -> frozenset[str]:
    """Names of the readouts that are unknown during the whole mission."""
    names = {name: (name,) for name in (*ATTITUDE, "net_mass")} | {"speed": BODY}
    unknown = {
        name
        for name, needed in names.items()
        if not all(np.isfinite(told(trajectory, one)).any() for one in needed)
    }
    if not np.isfinite(_volume(trajectory)).any():
        unknown.add("pumped")
    return frozenset(unknown)


def _volume(trajectory: Trajectory) -> Array:
    """[cm3] Volume that all pumps together displace, (time,); NaN where unknown."""
    parts = [name for name in actuator_names(VARIABLES) if _unit(name) == DISPLACES]
    moved = [values for name in parts if np.isfinite(values := told(trajectory, name)).any()]
    return np.asarray(np.sum(moved, axis=0)) if moved else np.full(len(trajectory.time), np.nan)


def _gaps(trajectory: Trajectory) -> Array:
    """Flag of gaps, (time,): 1 where the log has no sample and values are interpolated, else 0."""
    gap = trajectory.signals.get("measured_gap", np.zeros(len(trajectory.time)))
    return np.nan_to_num(gap, nan=1.0)  # between two dives that are drawn together


def along_track(trajectory: Trajectory, name: str) -> Array:
    """Roll, pitch or heading [degree] of a vehicle that points along its track, (time,)."""
    if name == "roll":
        return np.zeros(len(trajectory.time))
    north, east, down = (np.gradient(signal(trajectory, n), trajectory.time) for n in POSITION)
    if name == "heading":
        return np.degrees(np.arctan2(east, north)) % 360.0
    return np.degrees(np.arctan2(-down, np.hypot(north, east)))


def moving_parts(signals: Collection[str]) -> tuple[str, ...]:
    """Names of the parts that slide, turn or spin; a log may have only their measured signals.

    Args:
      signals: names of the trajectory's signals.
    """
    logged = (part for part in actuator_names(VARIABLES) if f"measured_{part}" in signals)
    parts = tuple(dict.fromkeys([*actuator_names(signals), *logged]))
    return tuple(part for part in parts if _unit(part) in (SLIDES, TURNS, SPINS))


def part_motion(trajectory: Trajectory, joints: Sequence[str], times: Array) -> tuple[Array, Array]:
    """Positions [m], [rad] or [rad/s] of parts at `times` [s], and angles [rad] through which the
    parts have turned, both of shape (times, joints)."""
    time = trajectory.time
    positions, angles = np.zeros((2, len(times), len(joints)))
    for k, joint in enumerate(joints):
        values = optional(trajectory, joint, 0.0)
        positions[:, k] = np.interp(times, time, values)
        if turns(joint):
            positions[:, k] = angles[:, k] = np.deg2rad(positions[:, k])
        elif spins(joint):
            steps = np.diff(time) * (values[1:] + values[:-1]) / 2
            angles[:, k] = np.interp(times, time, np.concatenate([[0.0], np.cumsum(steps)]))
    return positions, angles


def turns(part: str) -> bool:
    """Return True if the part turns to an angle, as a rudder does."""
    return _unit(part) == TURNS


def spins(part: str) -> bool:
    """Return True if the part's position is a rotation rate, as a propeller's is."""
    return _unit(part) == SPINS


def _unit(part: str) -> str:
    return variable(f"true_{part}").units


def signal(trajectory: Trajectory, name: str) -> Array:
    """True signal `name`, or else the measured one, with gaps closed by interpolation."""
    for prefix in ("true_", "measured_", "measured_onboard_"):
        values = trajectory.signals.get(prefix + name)
        if values is not None and np.isfinite(values).any():
            return closed(trajectory.time, values, circular=name == "heading")
    raise InputError(
        f"this mission cannot be drawn: it has no signal true_{name} or measured_{name}"
    )


def optional(trajectory: Trajectory, name: str, default: float) -> Array:
    """Signal as from `signal`, but `default` everywhere if the trajectory has none."""
    try:
        return signal(trajectory, name)
    except InputError:
        return np.full(len(trajectory.time), default)


def told(trajectory: Trajectory, name: str) -> Array:
    """True signal `name`, or else the measured one, with NaN where unknown."""
    for prefix in ("true_", "measured_"):
        values = trajectory.signals.get(prefix + name)
        if values is not None:
            return values
    return np.full(len(trajectory.time), np.nan)


def closed(time: Array, values: Array, *, circular: bool = False) -> Array:
    """Replace NaN by interpolation; `circular` values [degree] go the short way round."""
    known = np.isfinite(values)
    if known.all():
        return values
    seen = np.unwrap(values[known], period=360.0) if circular else values[known]
    filled = np.interp(time, time[known], seen)
    return np.mod(filled, 360.0) if circular else np.asarray(filled)


def _interpolate(times: Array, recorded: Array, values: Array) -> Array:
    """Interpolate values (samples, k) linearly, shape (times, k)."""
    return np.stack([np.interp(times, recorded, column) for column in values.T], axis=-1)


def interpolate_quaternion(times: Array, recorded: Array, quaternions: Array) -> Array:
    """Interpolate unit quaternions linearly along the shorter arc and normalise, shape (times, 4).

    Samples lie close together (0.5 s), so that the difference from spherical interpolation is
    invisible.
    """
    after = np.clip(np.searchsorted(recorded, times, side="right"), 1, len(recorded) - 1)
    before = after - 1
    weight = (times - recorded[before]) / (recorded[after] - recorded[before])
    weight = np.clip(weight, 0.0, 1.0)[:, None]
    a, b = quaternions[before], quaternions[after]
    nearer = np.where(np.sum(a * b, axis=-1, keepdims=True) < 0.0, -b, b)
    blend = (1.0 - weight) * a + weight * nearer
    blend /= np.linalg.norm(blend, axis=-1, keepdims=True)
    return np.where(weight == 0.0, a, np.where(weight == 1.0, nearer, blend))


class Scale(NamedTuple):
    """Colour scale of the track: label, range, and clipping of values."""

    label: str
    low: float
    high: float
    clipped: tuple[bool, bool] = (False, False)
    """True if values lie below `low`, and above `high`; those get the colours of the ends"""

    @property
    def ends(self) -> tuple[str, str]:
        """Labels of both ends, with a sign where values lie beyond."""
        (below, above), digits = self.clipped, 2 if self.high < 10.0 else 0
        return "≤ " * below + f"{self.low:.{digits}f}", "≥ " * above + f"{self.high:.{digits}f}"


def track_values(
    trajectory: Trajectory,
    colour: str | None,
    shown: NDArray[np.bool_],
    tracks: Sequence[NamedTrack],
) -> tuple[Array, Scale]:
    """Values of the samples `shown`, and their colour scale; `colour` as in `Shot`.

    Values of a log are NaN where unknown.

    Raises:
      InputError: the mission lacks the signal, or `colour` is "error" without tracks.
    """
    if colour == "error":
        return _errors(trajectory, shown, tracks)
    if colour is None:
        colour = "speed" if _known(trajectory, "speed") else "depth"
    names, label, unit = SIGNALS[colour]
    if not _known(trajectory, colour):
        able = ", ".join(name for name in SIGNALS if _known(trajectory, name))
        raise InputError(
            f"cannot colour by {colour}: this mission records no {', '.join(names)}; it can by "
            f"{able}"
        )
    squares = [np.square(trajectory[name]) for name in names]
    values = np.sqrt(np.sum(squares, axis=0))[shown]
    if not np.isfinite(values).any():
        raise InputError(f"cannot colour by {colour}: it is not known in the shown part")
    low, high = (float(v) for v in np.nanpercentile(values, [2.0, 98.0]))
    step = nice_step(max(high - low, LEAST_RANGE) / 4)
    low, high = step * math.floor(low / step + 1e-9), step * math.ceil(high / step - 1e-9)
    if source := source_of(trajectory, names[0], ""):
        label = source if colour == "current" else f"{label}, {source}"
    high = max(high, low + step)
    least = 1e-6 * (high - low)
    clipped = bool(np.nanmin(values) < low - least), bool(np.nanmax(values) > high + least)
    return values, Scale(f"{label} [{unit}]", low, high, clipped)


def _known(trajectory: Trajectory, colour: str) -> bool:
    """Return True if a mission has the signals of a colouring quantity."""
    return all(
        name in trajectory and bool(np.isfinite(trajectory[name]).any())
        for name in SIGNALS[colour][0]
    )


def _errors(
    trajectory: Trajectory, shown: NDArray[np.bool_], tracks: Sequence[NamedTrack]
) -> tuple[Array, Scale]:
    """Distance [m] of the first dead-reckoned track from the true track, and its colour scale."""
    if not tracks:
        raise InputError("colouring by error needs a dead-reckoned track: give --tracks FILE")
    named = f"of {tracks[0].title}"
    track, now = tracks[0].at(trajectory.time[shown]), ("true_north", "true_east")
    values = np.hypot(*(a - trajectory[name][shown] for a, name in zip(track, now, strict=True)))
    high = max(float(np.nanmax(values)) if np.isfinite(values).any() else 0.0, 1.0)
    step = nice_step(high / 4)
    word = source_of(trajectory, "true_north", "")
    label = f"distance {named} from the {word} [m]" if word else f"position error {named} [m]"
    return values, Scale(label, 0.0, step * math.ceil(high / step - 1e-9))
