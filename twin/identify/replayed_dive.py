"""Replayed dive: one dive of a log on the hull's own axes, its legs and their targets."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Container
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import savgol_filter

from twin.identify.calibration import Array, Calibration, Mask
from twin.identify.logged_missions import filled, unwrapped
from twin.records.logged import LogStore
from twin.records.trajectory import VELOCITY
from twin.vehicle.parts import BatteryHinge, BatterySlide, Fin, Part, Pump
from twin.vehicle.vehicle import Vehicle

Phase = Literal["dive", "climb"]
PHASES: tuple[Phase, ...] = ("dive", "climb")

REVERSAL = 5.0
"""[m] of the other way that end a leg: `factory import` calls a dive what is deeper than this"""
LEAST_RANGE = 15.0
"""[m] of a leg that is compared; a shorter one is an inflection and little else"""
MARGIN, LEAST_MARGIN = 0.1, 3.0
"""Part of a leg's range, and metres at least, that are inflection at either end of it"""

SMOOTHING = 20.0
"""[s] of the depth's filter: shorter than an inflection, longer than pressure noise"""
COURSE = 900.0
"""[s] of the running mean that is the target of a log without a heading setpoint: longer than the
periods of heading loops, shorter than most legs"""
TOLERANCE, LEAST_PIECE = 3.0, 5.0
"""[deg] by which a heading target may wander within one piece of a leg, [m] of its depth"""
PUMP_REST = 20.0
"""[cm3] about a leg's median within which the pump is at rest"""
PUMP_STILL = 6
"""samples around one that a pump at rest stays within as much"""


class HeadingLeg(NamedTuple):
    """A descent or a climb: samples `first` to `last`."""

    first: int
    last: int
    phase: Phase
    top: float
    """[m]"""
    bottom: float
    """[m]"""

    @property
    def samples(self) -> slice:
        """Its samples."""
        return slice(self.first, self.last + 1)

    @property
    def band(self) -> tuple[float, float]:
        """Depths [m] between which it is away from its inflections."""
        margin = max(MARGIN * (self.bottom - self.top), LEAST_MARGIN)
        return self.top + margin, self.bottom - margin

    @property
    def compared(self) -> bool:
        """Whether it is long enough to be compared."""
        return self.bottom - self.top >= LEAST_RANGE


def legs_of(depth: Array) -> list[HeadingLeg]:
    """Descents and climbs in their order; `depth` [m], (time,), without NaN."""
    # where the depth turns round by REVERSAL, with the ends of what moves so far
    turns: list[int] = []
    low = high = way = 0
    for k, z in enumerate(depth):
        low = k if z <= depth[low] else low
        high = k if z >= depth[high] else high
        if way <= 0 and z - depth[low] >= REVERSAL:
            turns.append(low)
            high, way = k, 1
        elif way >= 0 and depth[high] - z >= REVERSAL:
            turns.append(high)
            low, way = k, -1
    if way:
        turns.append(high if way > 0 else low)
    legs = []
    for a, b in itertools.pairwise(turns):
        top, bottom = sorted((float(depth[a]), float(depth[b])))
        phase: Phase = "dive" if depth[b] > depth[a] else "climb"
        legs.append(HeadingLeg(first=a, last=b, phase=phase, top=top, bottom=bottom))
    return legs


USUAL = {
    BatterySlide: "measured_shift",
    BatteryHinge: "measured_rotation",
    Pump: "measured_pump",
}
"""Signals that importers give the parts of real vehicles, whatever a vehicle file calls them."""
RUDDER = "measured_fin"
"""The same, of a fin that turns the vehicle."""
USUAL_NAMES = frozenset({RUDDER, *USUAL.values()})
TURNING = (RUDDER, USUAL[BatteryHinge])
"""Signals of what turns a vehicle."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Turning:
    """The part that turns the vehicle, and the signal of what turned the logged one."""

    part: str
    """name of the vehicle's part"""
    signal: str | None
    """of the log, None: it has no position of what turns it"""
    same: bool
    """whether both are the same kind of part, so that their effects can be compared"""
    sense: float
    """what the vehicle's position is multiplied by to have the log's sign"""


def log_signal(vehicle: Vehicle, part: Part, names: Container[str]) -> str | None:
    """Name of the log's signal of a part: by the part's own name or by its kind; None without."""
    turns = vehicle.steering.get("heading") == part.name
    usual = RUDDER if isinstance(part, Fin) and turns else USUAL.get(type(part))
    for name in (f"measured_{part.name}", usual):
        if name is not None and name in names:
            return name
    return None


def turning_of(vehicle: Vehicle, names: Container[str]) -> Turning | None:
    """The turning part beside the log's; None of a vehicle without one."""
    part = vehicle.steered("heading")
    if part is None:
        return None
    signal = log_signal(vehicle, part, names)
    other = next((name for name in TURNING if name in names), None)
    return Turning(
        part=part.name,
        signal=signal or other,
        same=signal is not None,
        # a log's rudder is positive to starboard, a file's fin turns about an axis of its own
        sense=part.sense("heading") if isinstance(part, Fin) else 1.0,
    )


class DivePiece(NamedTuple):
    """A part of a leg with one heading target and one position of the pump."""

    last: int
    """sample at which it ends"""
    heading: float | None
    """[deg] true; None: the log has no heading"""
    pump: float
    """[cm3]"""


class Target(NamedTuple):
    """Pitch, pump, turning depth and headings that a leg was flown by."""

    leg: HeadingLeg
    pitch: float
    """[deg], nose up: the mean that the log flew, as a glider's own loop has a dead band"""
    pump: float
    """[cm3] where it was for most of the leg"""
    turn_depth: float
    """[m] at which its end began: where the pump left its position"""
    pieces: tuple[DivePiece, ...]


class ReplayedDive(NamedTuple):
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

    def signal(name: str | None) -> Array | None:
        return None if name is None else filled(store.signal(name, row))

    every = {p.name: signal(log_signal(hull.vehicle, p, store)) for p in hull.vehicle.parts}
    density = signal("measured_density")
    salty = [signal(f"measured_{name}") for name in ("temperature", "salinity")]
    others = [values for values in salty if values is not None]
    if density is None:
        water: tuple[Array, ...] = (hull.sea_density(smooth),)
    else:
        water = (density, *(others if len(others) == len(salty) else ()))
    return ReplayedDive(
        row=row,
        period=store.period,
        depth=smooth,
        pitch=pitch,
        roll=signal("measured_roll"),
        heading=heading,
        speed=_speed(store, row),
        water=water,
        positions={name: values for name, values in every.items() if values is not None},
        turning=None if turning is None else signal(turning.signal),
        measured=known & ~gap,
        targets=targets,
        heading_target=_per_sample(targets, len(smooth)),
    )


def _course(degrees: Array) -> Array | None:
    """Heading [deg] without jumps at north, gaps bridged; None where there is none."""
    return filled(np.rad2deg(unwrapped(degrees)))


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
    """Setpoint near the heading [deg], or its running mean, which the ends of a log shorten."""
    if heading is None:
        return None
    asked = store.signal("commanded_heading", row)
    if np.isfinite(asked).any():
        target = _course(asked)
        assert target is not None
        return target + 360.0 * np.round((heading - target) / 360.0)
    half = (min(round(COURSE / store.period), len(heading)) | 1) // 2
    total = np.concatenate([[0.0], np.cumsum(heading)])
    index = np.arange(len(heading))
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, len(heading))
    return np.asarray((total[last] - total[first]) / (last - first))


def _target(
    leg: HeadingLeg, depth: Array, pitch: Array, pump: Array, wanted: Array | None
) -> Target:
    shallow, deep = leg.band
    inside = leg.first + np.flatnonzero(
        (depth[leg.samples] >= shallow) & (depth[leg.samples] <= deep)
    )
    if not inside.size:  # a leg that is nothing but inflections
        inside = np.arange(leg.first, leg.last + 1)
    usual = float(np.median(pump[inside]))
    levels = pump_levels(leg, pump, usual)
    resting = np.flatnonzero(np.abs(pump[leg.samples] - levels) <= PUMP_REST)
    turn = float(depth[leg.first + resting[-1]]) if resting.size else float(depth[leg.last])
    turn = max(turn, deep) if leg.phase == "dive" else min(turn, shallow)
    return Target(
        leg=leg,
        pitch=float(np.mean(pitch[inside])),
        pump=usual,
        turn_depth=turn,
        pieces=_pieces(leg, depth, wanted, levels, turn),
    )


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
