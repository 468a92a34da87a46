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
"""[m] Reversal of the depth that ends a leg; `factory import` has the same limit."""
LEAST_RANGE = 15.0
"""[m] Smallest range of depth of a compared leg: a shorter one is mostly inflection"""
MARGIN, LEAST_MARGIN = 0.1, 3.0
"""Inflection at either end of a leg. MARGIN: fraction of its range. LEAST_MARGIN: [m] at least"""

SMOOTHING = 20.0
"""[s] Window of the depth's filter: shorter than an inflection, longer than pressure noise"""
COURSE = 900.0
"""[s] Window of the running mean that is the heading target of a log without a setpoint: longer
than the periods of heading loops, shorter than most legs"""
TOLERANCE, LEAST_PIECE = 3.0, 5.0
"""Section of a leg. TOLERANCE: [deg] largest range of the heading target in it. LEAST_PIECE: [m]
its smallest depth range"""
PUMP_REST = 20.0
"""[cm3] Distance from a leg's median within which the pump is at rest"""
PUMP_STILL = 6
"""Number of samples around one within which a pump at rest stays within PUMP_REST"""


class HeadingLeg(NamedTuple):
    """A descent or a climb: samples `first` to `last`."""

    first: int
    last: int
    phase: Phase
    top: float
    """[m] Smallest depth"""
    bottom: float
    """[m] Largest depth"""

    @property
    def samples(self) -> slice:
        """Samples of the leg."""
        return slice(self.first, self.last + 1)

    @property
    def band(self) -> tuple[float, float]:
        """Depths [m] between which the leg is away from its inflections."""
        margin = max(MARGIN * (self.bottom - self.top), LEAST_MARGIN)
        return self.top + margin, self.bottom - margin

    @property
    def compared(self) -> bool:
        """True where the leg is long enough to be compared."""
        return self.bottom - self.top >= LEAST_RANGE


def legs_of(depth: Array) -> list[HeadingLeg]:
    """Descents and climbs in their order; `depth` [m], (time,), without NaN."""
    # samples at which the depth turns round by REVERSAL, with both ends of the record
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
"""Signals of real vehicles' parts, as importers name them"""
RUDDER = "measured_fin"
"""Signal of a fin that turns the vehicle"""
USUAL_NAMES = frozenset({RUDDER, *USUAL.values()})
TURNING = (RUDDER, USUAL[BatteryHinge])
"""Signals of parts that turn a vehicle"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Turning:
    """The turning part of the vehicle file, and the signal of the logged vehicle's."""

    part: str
    """Name of the vehicle's part"""
    signal: str | None
    """Signal in the log; None: the log has no position of a turning part"""
    same: bool
    """True where both are parts of the same type, so that their effects can be compared"""
    sense: float
    """Factor on the vehicle's position that gives the log's sign"""


def log_signal(vehicle: Vehicle, part: Part, names: Container[str]) -> str | None:
    """Name of the log's signal of a part, by the part's name or else by its type; None without."""
    turns = vehicle.steering.get("heading") == part.name
    usual = RUDDER if isinstance(part, Fin) and turns else USUAL.get(type(part))
    for name in (f"measured_{part.name}", usual):
        if name is not None and name in names:
            return name
    return None


def turning_of(vehicle: Vehicle, names: Container[str]) -> Turning | None:
    """Turning part with the log's signal; None for a vehicle without a turning part."""
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
    """A section of a leg with one heading target and one position of the pump."""

    last: int
    """Last sample"""
    heading: float | None
    """[deg] True heading; None: the log has no heading"""
    pump: float
    """[cm3] Pumped volume"""


class Target(NamedTuple):
    """Targets of a leg: pitch, pump, turning depth and headings."""

    leg: HeadingLeg
    pitch: float
    """[deg] Mean pitch of the log, nose up: a glider's own loop has a dead band"""
    pump: float
    """[cm3] Pumped volume for most of the leg"""
    turn_depth: float
    """[m] Depth at which the pump left its position for the next leg"""
    pieces: tuple[DivePiece, ...]


class ReplayedDive(NamedTuple):
    """One row of a store of logs; arrays are (time,)."""

    row: int
    period: float
    """[s] Time between samples"""
    depth: Array
    """[m] Filtered depth"""
    pitch: Array
    """[deg] Pitch of the hull"""
    roll: Array | None
    """[deg] Measured roll"""
    heading: Array | None
    """[deg] True heading of the hull, unwrapped"""
    speed: Array | None
    """[m/s] Speed through the water by a Doppler log or profiler, NaN where not measured"""
    water: tuple[Array, ...]
    """In-situ density [kg/m3]; after it temperature [degree_Celsius] and salinity where known"""
    positions: dict[str, Array]
    """Positions of the vehicle's parts by their names, in the units of stores"""
    turning: Array | None
    """[deg] Position of the log's turning part"""
    measured: Mask
    """True where attitude and depth are original samples"""
    targets: tuple[Target, ...]
    heading_target: Array | None
    """[deg] Heading target, (time,), NaN outside legs"""

    @property
    def legs(self) -> list[HeadingLeg]:
        """Descents and climbs of the dive."""
        return [target.leg for target in self.targets]


def read_dive(
    store: LogStore, row: int, hull: Calibration, turning: Turning | None
) -> ReplayedDive | None:
    """One row of a store; None without a leg that has depth, pitch and pump."""
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
    """Heading [deg] without jumps at north, gaps bridged; None without any value."""
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
    """Measured speed through the water [m/s], NaN in gaps; None without any."""
    speed = store.signal("true_speed", row)
    parts = np.stack([store.signal(f"true_{name}", row) for name in VELOCITY])
    speed = np.where(np.isfinite(speed), speed, np.sqrt(np.sum(parts**2, axis=0)))
    return speed if np.isfinite(speed).any() else None


def _heading_target(store: LogStore, row: int, heading: Array | None) -> Array | None:
    """Setpoint [deg] unwrapped near the heading, or the heading's running mean; None without."""
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
    """Commanded volume [cm3] of the pump at each sample of a leg.

    Pumps move in steps: a moving pump counts as at its next rest. Less net buoyancy than at the
    `usual` volume is a pump on its way from the leg before.
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
    """Sections of a leg, up to the depth `turn`, with constant heading target and pump."""
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
    """Heading target at each sample [deg]; NaN outside legs, None without any."""
    out = np.full(count, np.nan)
    for target in targets:
        begin = target.leg.first
        for piece in target.pieces:
            if piece.heading is not None:
                out[begin : piece.last + 1] = piece.heading
            begin = piece.last + 1
    return out if np.isfinite(out).any() else None
