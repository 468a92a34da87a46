"""Log figures: means over dives and climbs of a log, or of the twin's simulation of the log.

`Oscillation` is a limit cycle, for example of a badly tuned control loop.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import detrend, savgol_filter

from twin.identify.calibration import Array, Mask
from twin.identify.comparison import rms
from twin.identify.logged_missions import lagging
from twin.identify.replayed_dive import PUMP_REST, Phase, ReplayedDive, Target, Turning
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle

UNDER_WATER = 3.0
"""[m] Depth above which a hull is in the waves or partly out of the water"""
SETTLING = 60.0
"""[s] Time that a vehicle needs to settle after a turn to a new heading target"""
SLOWEST_TURN = 0.1
"""[deg/s] Slowest rate of a turn to a new heading target: a Seaglider's at 0.25 m/s"""
NEW_TARGET = 5.0
"""[deg] Smallest change of the heading target that starts a turn"""
TURN_WINDOW = 40.0
"""[s] Window of the filter that gives the turn rate from noisy compass headings"""
TURN_LAGS = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0)
"""[s] Lags of the turn rate behind the position that are tried. Without a lag, the feedback of the
heading loop would hide the effect of the turning part"""
LEAST_MOVED = 0.2
"""[deg] Smallest standard deviation of a turning part's position for an estimate of its effect"""
LEAST_CORRELATION = 0.3
"""[1] Smallest correlation of turn rate and position; below, other causes turned the vehicle"""
LEAST_SAMPLES = 20
"""Minimum number of samples of a mean"""
LEAST_LEGS = 0.25
"""[1] Smallest fraction of the legs that must show an oscillation for it to be a limit cycle"""
LEAST_AMPLITUDE = {"heading": 1.0, "pitch": 0.5, "roll": 1.0}
"""[deg] Smallest amplitude of an oscillation, by signal"""
CYCLES, SHORTEST = 3.0, 4
"""CYCLES: minimum number of periods in a leg, because fewer may not go on. SHORTEST: minimum number
of samples in a period"""
WIDTH = 0.15
"""[1] Relative change of an oscillation's frequency within a leg, with speed and trim"""
SHARE = 0.5
"""[1] Smallest fraction of a signal's variance in an oscillation: noise has all periods"""
LEAST_GROWTH = 0.7
"""Smallest ratio of amplitudes, second half to first; an oscillation with less decays"""


class FigureSamples(NamedTuple):
    """Samples of one leg of a flight, equally spaced; arrays are (time,)."""

    period: float
    """[s] Time between samples"""
    series: Mapping[str, Array]
    """Known signals: `depth_rate` [m/s], positive down; `speed` [m/s] through the water, NaN where
    unknown; `pitch`, `roll` [deg]; `heading` [deg], unwrapped; `heading_target` [deg];
    `heading_error` [deg], heading minus target, within +-180; `turning` [deg], the position of the
    turning part in the log's sign"""
    positions: Mapping[str, Array]
    """Positions of the parts, in the units of stores"""
    steady: Mask
    """True away from inflections and surface, with the pump at rest and all signals measured"""


def logged_samples(dive: ReplayedDive, phase: Phase, pump: str) -> list[FigureSamples]:
    """Samples of a dive's compared legs in the log; `pump` is the name of the vehicle's pump."""
    names = ("pitch", "roll", "heading", "heading_target", "speed", "turning")
    every = {"depth_rate": np.gradient(dive.depth, dive.period)}
    every |= {n: values for n in names if (values := getattr(dive, n)) is not None}
    depth = np.where(dive.measured, dive.depth, np.nan)
    found = []
    for _, target in _compared(dive, phase):
        part = target.leg.samples
        series = {name: values[part] for name, values in every.items()}
        positions = {name: values[part] for name, values in dive.positions.items()}
        found.append(_samples(target, pump, dive.period, depth[part], series, positions))
    return found


def flown_samples(
    dive: ReplayedDive,
    trajectory: Trajectory,
    number: Array,
    phase: Phase,
    vehicle: Vehicle,
    turning: Turning | None,
) -> list[FigureSamples]:
    """Samples of a dive's compared legs in the twin's flight; without legs not reached.

    `number` is the index of the leg at each sample, (time,).
    """
    period = float(np.median(np.diff(trajectory.time)))
    found = []
    for k, target in _compared(dive, phase):
        flown = np.flatnonzero(number == k)
        if len(flown) < 2:
            continue
        part = slice(flown[0], flown[-1] + 1)
        depth = trajectory["true_depth"][part]
        positions = {name: trajectory[f"true_{name}"][part] for name in vehicle.part_names}
        series = {
            "depth_rate": np.gradient(depth, period),
            "speed": np.linalg.norm(trajectory.v_rel[part], axis=1),
            "pitch": trajectory["true_pitch"][part],
            "roll": trajectory["true_roll"][part],
            "heading": np.rad2deg(np.unwrap(np.deg2rad(trajectory["true_heading"][part]))),
        }
        if dive.heading_target is not None:
            series["heading_target"] = trajectory["commanded_heading"][part]
        if turning is not None:
            series["turning"] = turning.sense * positions[turning.part]
        pump = vehicle.steering["buoyancy"]
        found.append(_samples(target, pump, period, depth, series, positions))
    return found


def _compared(dive: ReplayedDive, phase: Phase) -> list[tuple[int, Target]]:
    """Indices and targets of the legs of a phase that are long enough to be compared."""
    every = enumerate(dive.targets)
    return [(k, one) for k, one in every if one.leg.phase == phase and one.leg.compared]


def _samples(
    target: Target,
    pump: str,
    period: float,
    depth: Array,
    series: dict[str, Array],
    positions: Mapping[str, Array],
) -> FigureSamples:
    """Samples of a leg, steady in its band with the pump near its target; depth is NaN in gaps."""
    if "heading" in series and "heading_target" in series:
        error = series["heading"] - series["heading_target"]
        series["heading_error"] = (error + 180.0) % 360.0 - 180.0
    shallow, deep = target.leg.band
    steady: Mask = (depth > UNDER_WATER) & (depth >= shallow) & (depth <= deep)
    if pump in positions:
        steady &= np.abs(positions[pump] - target.pump) <= PUMP_REST
    return FigureSamples(period=period, series=series, positions=positions, steady=steady)


def angle_of_attack(
    dive: ReplayedDive, trajectory: Trajectory, number: Array, phase: Phase
) -> float | None:
    """Mean angle of attack [deg] of the twin in the bands of a phase's legs; None without samples.

    Args:
      number: index of the leg at each sample, (time,).
    """
    depth = trajectory["true_depth"]
    found = [np.zeros(0)]
    for k, target in _compared(dive, phase):
        shallow, deep = target.leg.band
        use = (number == k) & (depth >= shallow) & (depth <= deep)
        v_rel = trajectory.v_rel[use]
        found.append(np.rad2deg(np.arctan2(v_rel[:, 2], v_rel[:, 0])))
    angles = np.concatenate(found)
    return float(angles.mean()) if angles.size else None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Oscillation:
    """Oscillation with a steady period."""

    signal: str
    """Name of the signal: heading, pitch or roll"""
    period_s: float
    amplitude_deg: float
    growth: float
    """Amplitude in the second half of a leg, divided by that in the first half"""
    legs: float
    """[1] Fraction of the legs that show the oscillation"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PhaseFigures:
    """Means over the legs of one phase; None if unknown."""

    depth_rate: float
    """[m/s] Depth rate, positive down"""
    speed: float | None
    """[m/s] Speed through the water"""
    pitch: float
    """[deg] Pitch, nose up"""
    turn_per_actuator: float | None
    """[deg/s per deg] Turn rate to starboard per position of the turning part"""
    turning: float | None
    """[deg] Mean position of the turning part, in the log's sign"""
    heading_sd: float | None
    """[deg] RMS distance of the heading from its target"""
    heading_bias: float | None
    """[deg] Mean heading minus its target"""
    parts: Mapping[str, float]
    """Mean positions of the parts, in the units of stores"""
    oscillation: Oscillation | None
    """Oscillation that does not decay"""

    def describe(self) -> dict[str, float | None]:
        """Return the numbers with their units in the names."""
        return {
            "depth_rate_m_s": self.depth_rate,
            "speed_m_s": self.speed,
            "pitch_deg": self.pitch,
            "turn_per_actuator": self.turn_per_actuator,
            "turning_deg": self.turning,
            "heading_sd_deg": self.heading_sd,
            "heading_bias_deg": self.heading_bias,
        }


def phase_figures(legs: Sequence[FigureSamples]) -> PhaseFigures | None:
    """Compute the numbers of one phase; None if no leg has enough steady samples."""
    legs = [leg for leg in legs if leg.steady.sum() >= 2]
    if sum(int(leg.steady.sum()) for leg in legs) < LEAST_SAMPLES:
        return None

    def steady(name: str) -> Array:
        """Known steady samples of a series, of all legs."""
        found = [leg.series[name][leg.steady] for leg in legs if name in leg.series]
        values = np.concatenate([*found, np.zeros(0)])
        return np.asarray(values[np.isfinite(values)])

    def usual(values: Array) -> float | None:
        return float(values.mean()) if values.size >= LEAST_SAMPLES else None

    errors = [
        one.series["heading_error"][settled(one)] for one in legs if "heading_error" in one.series
    ]
    error = np.concatenate([*errors, np.zeros(0)])
    parts = {
        name: [one.positions[name][one.steady] for one in legs if name in one.positions]
        for name in dict.fromkeys(name for leg in legs for name in leg.positions)
    }
    swings = [{name: _swing(name, leg) for name in ("heading", "pitch", "roll")} for leg in legs]
    return PhaseFigures(
        depth_rate=float(steady("depth_rate").mean()),
        speed=usual(steady("speed")),
        pitch=float(steady("pitch").mean()),
        turn_per_actuator=turn_per_actuator(legs),
        turning=usual(steady("turning")),
        heading_sd=rms(error) if error.size >= LEAST_SAMPLES else None,
        heading_bias=usual(error),
        parts={name: float(np.mean(np.concatenate(held))) for name, held in parts.items()},
        oscillation=limit_cycle(swings, LEAST_LEGS),
    )


def settled(leg: FigureSamples) -> Mask:
    """Mask of steady samples: after each turn the heading has reached its new target, or the
    slowest turn would have, and SETTLING has passed."""
    if "heading_error" not in leg.series:
        return leg.steady
    target, error = leg.series["heading_target"], np.abs(leg.series["heading_error"])
    step = np.abs(np.diff(target, prepend=target[0]))
    step = np.minimum(step, 360.0 - step)
    step[0] = error[0]
    out = leg.steady.copy()
    settling = round(SETTLING / leg.period)
    for k in np.flatnonzero(step > NEW_TARGET):
        latest = k + round(step[k] / SLOWEST_TURN / leg.period)
        there = np.flatnonzero(error[k:latest] < NEW_TARGET)
        out[k : (k + int(there[0]) if there.size else latest) + settling] = False
    return out


def turn_per_actuator(legs: Sequence[FigureSamples]) -> float | None:
    """Slope of turn rate [deg/s] on the turning part's position [deg]; None if not determined.

    The position acts through the first-order lag of TURN_LAGS with the largest correlation.
    The mean of each leg is subtracted, since a turn with the part at 0 is no effect of the part.
    """
    rates, positions = [], []
    for leg in legs:
        window = max(round(TURN_WINDOW / leg.period), 5) | 1
        heading, turning = leg.series.get("heading"), leg.series.get("turning")
        if heading is None or turning is None or len(heading) <= window:
            continue
        use = leg.steady
        if use.sum() < LEAST_SAMPLES:
            continue
        rate = savgol_filter(heading, window, 2, deriv=1, delta=leg.period)[use]
        behind = [lagging(turning, lag / leg.period) if lag else turning for lag in TURN_LAGS]
        behind = savgol_filter(np.array(behind), window, 2)[:, use]
        rates.append(rate - rate.mean())
        positions.append(behind - behind.mean(axis=1, keepdims=True))
    if not rates:
        return None
    fits = [_fit(np.concatenate(rates), one) for one in np.concatenate(positions, axis=1)]
    slope, correlation = max(fits, key=lambda fit: abs(fit[1]))
    return slope if abs(correlation) >= LEAST_CORRELATION else None


def _fit(rate: Array, position: Array) -> tuple[float, float]:
    """Slope of rate on position, and their correlation; 0 if the part hardly moved."""
    moved, turned = float(np.mean(position**2)), float(np.mean(rate**2))
    if moved < LEAST_MOVED**2 or turned == 0.0:
        return 0.0, 0.0
    together = float(np.mean(rate * position))
    return together / moved, together / np.sqrt(moved * turned)


def _swing(name: str, leg: FigureSamples) -> Oscillation | None:
    """Oscillation in the longest run of settled samples of a leg, or None."""
    values = leg.series.get("heading_error" if name == "heading" else name)
    if values is None:
        return None
    use = settled(leg)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], use.astype(int), [0]])))
    runs = list(zip(edges[::2], edges[1::2], strict=True))
    if not runs:
        return None
    first, last = max(runs, key=lambda run: run[1] - run[0])
    return oscillation_of(name, values[first:last], leg.period)


def oscillation_of(name: str, values: Array, period: float) -> Oscillation | None:
    """Oscillation of one signal in one leg, or None.

    Args:
      name: name of the signal, a key of LEAST_AMPLITUDE.
      values: signal minus target [deg], equally spaced, (time,).
      period: [s] between samples.
    """
    count = len(values)
    if count < CYCLES * SHORTEST:
        return None
    swing = detrend(values)
    power = np.abs(np.fft.rfft(swing)) ** 2
    total = float(power[1:].sum())
    lowest, highest = int(np.ceil(CYCLES)), count // SHORTEST
    if total == 0.0 or highest < lowest:
        return None
    peak = lowest + int(np.argmax(power[lowest : highest + 1]))
    wide = max(1, round(WIDTH * peak))
    share = float(power[max(peak - wide, 1) : peak + wide + 1].sum()) / total
    half = count // 2
    early, late = (float(np.std(swing[part])) for part in (slice(half), slice(half, None)))
    amplitude = float(np.sqrt(2.0 * share * np.mean(swing**2)))
    growth = late / early if early > 0.0 else float("inf")
    if amplitude < LEAST_AMPLITUDE[name] or share < SHARE or growth < LEAST_GROWTH:
        return None
    return Oscillation(
        signal=name, period_s=count * period / peak, amplitude_deg=amplitude, growth=growth, legs=1
    )


def limit_cycle(
    legs: Sequence[Mapping[str, Oscillation | None]], least: float
) -> Oscillation | None:
    """Select the largest oscillation that enough legs show; its numbers are these legs' medians.

    Args:
      legs: for each leg, the results of `oscillation_of` by signal.
      least: [1] fraction of the legs that must show the oscillation.
    """
    found = []
    for name in LEAST_AMPLITUDE:
        mine = [one for leg in legs if (one := leg.get(name)) is not None]
        if mine and len(mine) >= least * len(legs):
            median = {
                field: float(np.median([getattr(one, field) for one in mine]))
                for field in ("period_s", "amplitude_deg", "growth")
            }
            found.append(Oscillation(signal=name, legs=len(mine) / len(legs), **median))
    return max(found, key=lambda one: one.amplitude_deg / LEAST_AMPLITUDE[one.signal], default=None)
