"""Dive: what a log says of one dive, on the hull's own axes, and the targets that it flew by."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import savgol_filter

from twin.identify.calibration import Calibration
from twin.identify.heading_leg import HeadingLeg, Turning, legs_of, log_signal
from twin.identify.logged_missions import filled, unwrapped
from twin.records.logged import LogStore
from twin.records.trajectory import VELOCITY

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SMOOTHING = 20.0
"""[s] of the depth's filter: shorter than an inflection, longer than pressure noise"""
COURSE = 900.0
"""[s] of the running mean that is the target of a log without a heading setpoint: longer than the
periods of heading loops, shorter than most legs"""
TOLERANCE = 3.0
"""[deg] by which a heading target may wander within one piece of a mission"""
LEAST_PIECE = 5.0
"""[m] of depth of a piece"""
PUMP_REST = 20.0
"""[cm3] about a leg's median within which the pump is at rest"""
PUMP_STILL = 6
"""samples around one that a pump at rest stays within as much"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DivePiece:
    """A part of a leg with one heading target and one position of the pump."""

    last: int
    """sample at which it ends"""
    heading: float | None
    """[deg] true; None: the log has no heading"""
    pump: float
    """[cm3]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Target:
    """What a leg was flown by."""

    leg: HeadingLeg
    pitch: float
    """[deg], nose up: the mean that the log flew, as a glider's own loop has a dead band"""
    pump: float
    """[cm3] where it was for most of the leg"""
    turn_depth: float
    """[m] at which its end began: where the pump left its position"""
    pieces: tuple[DivePiece, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayedDive:
    """One row of a store of logs; arrays are (time,)."""

    row: int
    period: float
    """[s]"""
    depth: Array
    """[m], filtered"""
    pitch: Array
    """[deg] of the hull"""
    roll: Array | None
    """[deg]"""
    heading: Array | None
    """[deg] true, of the hull, unwrapped"""
    speed: Array | None
    """[m/s] through the water by a Doppler log or profiler, NaN where it measured none"""
    water: tuple[Array, ...]
    """in-situ density [kg/m3]; after it temperature [degree_Celsius] and salinity where known"""
    positions: dict[str, Array]
    """of the vehicle's parts, by their names, in the units of stores"""
    turning: Array | None
    """[deg] of what turned the vehicle"""
    measured: Mask
    """where attitude and depth are original samples"""
    targets: tuple[Target, ...]
    heading_target: Array | None
    """[deg], (time,), NaN outside legs"""

    @property
    def legs(self) -> list[HeadingLeg]:
        """Its descents and climbs."""
        return [target.leg for target in self.targets]


def read_dive(
    store: LogStore, row: int, hull: Calibration, turning: Turning | None
) -> ReplayedDive | None:
    """One row of a store; None where it has no leg with depth, pitch and pump."""
    depth = filled(store.signal("measured_depth", row))
    pitch = filled(store.signal("measured_pitch", row))
    pump = filled(_pump(store, row, hull))
    if depth is None or pitch is None or pump is None:
        return None
    window = max(round(SMOOTHING / store.period), 5) | 1
    if len(depth) <= window:
        return None
    smooth = savgol_filter(depth, window, 2)
    legs = legs_of(smooth)
    if not any(leg.compared for leg in legs):
        return None
    pitch = np.rad2deg(hull.true_pitch(np.deg2rad(pitch)))
    heading = _course(store.signal("measured_heading", row))
    if heading is not None:
        heading = np.rad2deg(hull.true_heading(np.deg2rad(heading)))
    wanted = _heading_target(store, row, heading)
    targets = tuple(_target(leg, smooth, pitch, pump, wanted) for leg in legs)
    gap = np.nan_to_num(store.signal("measured_gap", row), nan=0.0) > 0.0
    known = np.isfinite(store.signal("measured_depth", row))
    positions = {}
    for part in hull.vehicle.parts:
        name = log_signal(hull.vehicle, part, store)
        values = None if name is None else filled(store.signal(name, row))
        if values is not None:
            positions[part.name] = values
    turned = None
    if turning is not None and turning.signal is not None:
        turned = filled(store.signal(turning.signal, row))
    return ReplayedDive(
        row=row,
        period=store.period,
        depth=smooth,
        pitch=pitch,
        roll=filled(store.signal("measured_roll", row)),
        heading=heading,
        speed=_speed(store, row),
        water=_water(store, row, hull, smooth),
        positions=positions,
        turning=turned,
        measured=known & ~gap,
        targets=targets,
        heading_target=_per_sample(targets, len(smooth)),
    )


def _course(degrees: Array) -> Array | None:
    """Heading [deg] without jumps at north, gaps bridged; None where there is none."""
    return filled(np.rad2deg(unwrapped(degrees)))


def _water(store: LogStore, row: int, hull: Calibration, depth: Array) -> tuple[Array, ...]:
    """Density [kg/m3], then temperature and salinity where the log has both; (time,) each."""
    density = filled(store.signal("measured_density", row))
    found = [filled(store.signal(f"measured_{name}", row)) for name in ("temperature", "salinity")]
    if density is None:
        return (hull.sea_density(depth),)
    return (density, *_all(found))


def _all(found: list[Array | None]) -> list[Array]:
    """All of them, or none where one is missing."""
    there = [values for values in found if values is not None]
    return there if len(there) == len(found) else []


def _pump(store: LogStore, row: int, hull: Calibration) -> Array:
    """Positions of the pump [cm3], measured or else commanded; NaN without either."""
    part = hull.vehicle.steered("buoyancy")
    assert part is not None
    name = log_signal(hull.vehicle, part, store) or "measured_pump"
    values = store.signal(name, row)
    if not np.isfinite(values).any():
        values = store.signal(name.replace("measured_", "commanded_", 1), row)
    return values


def _speed(store: LogStore, row: int) -> Array | None:
    """Speed through the water [m/s] that was measured, NaN where not; None without any."""
    speed = store.signal("true_speed", row)
    parts = np.stack([store.signal(f"true_{name}", row) for name in VELOCITY])
    speed = np.where(np.isfinite(speed), speed, np.sqrt(np.sum(parts**2, axis=0)))
    return speed if np.isfinite(speed).any() else None


def _heading_target(store: LogStore, row: int, heading: Array | None) -> Array | None:
    """Setpoint, or the course of a log without: the heading's running mean; [deg], near it."""
    if heading is None:
        return None
    asked = store.signal("commanded_heading", row)
    if np.isfinite(asked).any():
        target = _course(asked)
        assert target is not None
        return target + 360.0 * np.round((heading - target) / 360.0)
    width = min(round(COURSE / store.period), len(heading)) | 1
    return _running_mean(heading, width)


def _running_mean(values: Array, width: int) -> Array:
    """Mean over `width` samples, over fewer at the ends."""
    half = width // 2
    total = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(len(values))
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    return np.asarray((total[last] - total[first]) / (last - first))


def _target(
    leg: HeadingLeg, depth: Array, pitch: Array, pump: Array, wanted: Array | None
) -> Target:
    inside = _in_band(leg, depth)
    usual = float(np.median(pump[inside]))
    levels = pump_levels(leg, pump, usual)
    resting = np.flatnonzero(np.abs(pump[leg.samples] - levels) <= PUMP_REST)
    turn = float(depth[leg.first + resting[-1]]) if resting.size else float(depth[leg.last])
    shallow, deep = leg.band
    turn = max(turn, deep) if leg.phase == "dive" else min(turn, shallow)
    return Target(
        leg=leg,
        pitch=float(np.mean(pitch[inside])),
        pump=usual,
        turn_depth=turn,
        pieces=_pieces(leg, depth, wanted, levels, turn),
    )


def _in_band(leg: HeadingLeg, depth: Array) -> NDArray[np.intp]:
    """Samples of a leg away from its inflections; all of a leg that is nothing else."""
    shallow, deep = leg.band
    inside = leg.first + np.flatnonzero(
        (depth[leg.samples] >= shallow) & (depth[leg.samples] <= deep)
    )
    return inside if inside.size else np.arange(leg.first, leg.last + 1)


def pump_levels(leg: HeadingLeg, pump: Array, usual: float) -> Array:
    """Where the pump of a leg was sent [cm3], at each sample of the leg.

    Pumps move in steps: what moves counts as where it rests next. Less drive than `usual`, that of
    most of the leg, is a pump on its way from the leg before.
    """
    values = pump[leg.samples]
    width = PUMP_STILL + 1
    spread = maximum_filter1d(values, width) - minimum_filter1d(values, width)
    still = np.flatnonzero(spread <= PUMP_REST)
    if not still.size:
        return np.full(len(values), usual)
    following = np.minimum(np.searchsorted(still, np.arange(len(values))), still.size - 1)
    levels = values[still[following]]
    return np.asarray(
        np.minimum(levels, usual) if leg.phase == "dive" else np.maximum(levels, usual)
    )


def _pieces(
    leg: HeadingLeg, depth: Array, wanted: Array | None, levels: Array, turn: float
) -> tuple[DivePiece, ...]:
    """Parts of a leg, before it begins to turn at the depth `turn`, within which heading target
    and pump stay where they are."""
    pieces: list[DivePiece] = []
    begin = leg.first

    def piece(last: int) -> DivePiece:
        part = slice(begin, last + 1)
        heading = None if wanted is None else float(np.median(wanted[part])) % 360.0
        pump = float(np.median(levels[begin - leg.first : last + 1 - leg.first]))
        return DivePiece(last=last, heading=heading, pump=pump)

    headings = np.zeros(len(depth)) if wanted is None else wanted
    low = high = headings[begin]
    for k in range(leg.first, leg.last + 1):
        low, high = min(low, headings[k]), max(high, headings[k])
        moved = abs(levels[k - leg.first] - levels[begin - leg.first]) > PUMP_REST
        far = abs(depth[k] - depth[begin]) >= LEAST_PIECE
        left = (turn - depth[k] if leg.phase == "dive" else depth[k] - turn) >= LEAST_PIECE
        if (moved or high - low > TOLERANCE) and far and left:
            pieces.append(piece(k - 1))
            begin, low, high = k, headings[k], headings[k]
    return (*pieces, piece(leg.last))


def _per_sample(targets: tuple[Target, ...], count: int) -> Array | None:
    """The heading target at each sample [deg]; NaN outside legs."""
    out = np.full(count, np.nan)
    for target in targets:
        begin = target.leg.first
        for piece in target.pieces:
            if piece.heading is not None:
                out[begin : piece.last + 1] = piece.heading
            begin = piece.last + 1
    return out if np.isfinite(out).any() else None
