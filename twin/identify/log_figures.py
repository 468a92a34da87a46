"""Figures: how a vehicle dives or climbs, from its samples; the same for a log and for the twin.

Among them a swing that does not die out, as a badly tuned control loop makes it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend, lfilter, savgol_filter

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLING = 60.0
"""[s] that a vehicle needs besides the turn itself after a change of the heading target"""
SLOWEST_TURN = 0.1
"""[deg/s] of that turn: a Seaglider's at 0.25 m/s"""
NEW_TARGET = 5.0
"""[deg] of a change of the target that counts as one"""
TURN_WINDOW = 40.0
"""[s] of the filter whose slope is the turn rate: compasses of logs are noisy"""
TURN_LAGS = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0)
"""[s] of the turn rate behind the position; a loop that answers the heading hides the effect of its
part where the lag is left out"""
LEAST_MOVED = 0.2
"""[deg] standard deviation of a turning part's position from which its effect can be told"""
LEAST_CORRELATION = 0.3
"""Of turn rate and position; less, and other things turned the vehicle"""
LEAST_SAMPLES = 20
"""of a mean"""
OFTEN = 0.25
"""Part of the legs that must swing for a limit cycle"""
LEAST_AMPLITUDE = {"heading": 1.0, "pitch": 0.5, "roll": 1.0}
"""[deg] of a swing that counts, by the signal"""
CYCLES = 3.0
"""Periods that a leg must hold at least: of fewer nobody knows whether they go on"""
SHORTEST = 4
"""samples of a period"""
WIDTH = 0.15
"""Part of its frequency by which a swing may wander within a leg, as speed and trim do"""
SHARE = 0.5
"""Part of the variance that the swing must be: noise is spread over all periods"""
LASTING = 0.7
"""Amplitude in the second half over that in the first; less, and it dies out"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FigureSamples:
    """One leg of a flight, equally spaced; arrays are (time,)."""

    period: float
    """[s]"""
    depth_rate: Array
    """[m/s], positive down"""
    pitch: Array
    """[deg]"""
    roll: Array | None
    """[deg]"""
    heading: Array | None
    """[deg], unwrapped"""
    heading_error: Array | None
    """[deg] from the target, wrapped to +-180"""
    heading_target: Array | None
    """[deg]"""
    first_error: float
    """[deg] of the heading when the leg began"""
    speed: Array | None
    """[m/s] through the water, NaN where unknown"""
    turning: Array | None
    """[deg] of the turning part, in the log's sign"""
    positions: Mapping[str, Array]
    """of the parts, in the units of stores"""
    steady: Mask
    """away from inflections and the surface, with the pump at rest and all measured"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Oscillation:
    """A swing at a steady period."""

    signal: str
    """heading, pitch or roll"""
    period_s: float
    amplitude_deg: float
    growth: float
    """Amplitude in the second half of a leg over that in the first"""
    legs: float
    """Part of the legs that show it"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PhaseFigures:
    """Means over the legs of one phase; None where the log cannot say."""

    depth_rate: float
    """[m/s], positive down"""
    speed: float | None
    """[m/s] through the water"""
    pitch: float
    """[deg], nose up"""
    turn_per_actuator: float | None
    """[deg/s] of turn rate, to starboard, per deg of the turning part"""
    turning: float | None
    """[deg] mean position of the turning part, in the log's sign"""
    heading_sd: float | None
    """[deg] about the target, what it is off on the mean included"""
    heading_bias: float | None
    """[deg] mean heading less the target"""
    parts: Mapping[str, float]
    """Mean positions of the parts, in the units of stores"""
    oscillation: Oscillation | None
    """A swing that does not die out"""

    def describe(self) -> dict[str, float | None]:
        """The figures with their units in the names."""
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
    """Figures over the legs of one phase; None where none has enough steady samples."""
    legs = [leg for leg in legs if leg.steady.sum() >= 2]
    if sum(int(leg.steady.sum()) for leg in legs) < LEAST_SAMPLES:
        return None

    def mean(values: Sequence[Array]) -> float:
        return float(np.mean(np.concatenate(values)))

    speeds = [leg.speed[leg.steady] for leg in legs if leg.speed is not None]
    known = np.concatenate([*speeds, np.zeros(0)])
    known = known[np.isfinite(known)]
    held = [leg.turning[leg.steady] for leg in legs if leg.turning is not None]
    turned = np.concatenate([*held, np.zeros(0)])
    turned = turned[np.isfinite(turned)]
    errors = [e for leg in legs if (e := settled_error(leg)) is not None]
    error = np.concatenate([*errors, np.zeros(0)])
    names = dict.fromkeys(name for leg in legs for name in leg.positions)
    swings = [{name: _swing(name, leg) for name in ("heading", "pitch", "roll")} for leg in legs]
    return PhaseFigures(
        depth_rate=mean([leg.depth_rate[leg.steady] for leg in legs]),
        speed=float(known.mean()) if known.size >= LEAST_SAMPLES else None,
        pitch=mean([leg.pitch[leg.steady] for leg in legs]),
        turn_per_actuator=turn_per_actuator(legs),
        turning=float(turned.mean()) if turned.size >= LEAST_SAMPLES else None,
        heading_sd=float(np.sqrt(np.mean(error**2))) if error.size >= LEAST_SAMPLES else None,
        heading_bias=float(np.mean(error)) if error.size >= LEAST_SAMPLES else None,
        parts={
            name: mean([leg.positions[name][leg.steady] for leg in legs if name in leg.positions])
            for name in names
        },
        oscillation=limit_cycle(swings, OFTEN),
    )


def settled(leg: FigureSamples) -> Mask:
    """Steady samples at which a change of the heading target has been flown out: the heading has
    been near it since, or the slowest turn would have come there."""
    if leg.heading_target is None:
        return leg.steady
    step = np.abs(np.diff(leg.heading_target, prepend=leg.heading_target[0]))
    step = np.minimum(step, 360.0 - step)
    step[0] = abs(leg.first_error)
    out = leg.steady.copy()
    settling = round(SETTLING / leg.period)
    for k in np.flatnonzero(step > NEW_TARGET):
        latest = k + round(step[k] / SLOWEST_TURN / leg.period)
        error = np.zeros(0) if leg.heading_error is None else np.abs(leg.heading_error[k:latest])
        there = np.flatnonzero(error < NEW_TARGET)
        out[k : (k + int(there[0]) if there.size else latest) + settling] = False
    return out


def settled_error(leg: FigureSamples) -> Array | None:
    """Heading errors [deg] at settled samples; None without a heading or its target."""
    return None if leg.heading_error is None else leg.heading_error[settled(leg)]


def turn_per_actuator(legs: Sequence[FigureSamples]) -> float | None:
    """Slope of turn rate [deg/s] on the turning part's position [deg]; None where nothing tells.

    The position acts through a first-order lag, the one of TURN_LAGS that explains most. Each leg
    has a mean of its own: what turns a vehicle whose part is at 0 is not of the part.
    """
    rates, positions = [], []
    for leg in legs:
        window = max(round(TURN_WINDOW / leg.period), 5) | 1
        if leg.heading is None or leg.turning is None or len(leg.heading) <= window:
            continue
        use = leg.steady
        if use.sum() < LEAST_SAMPLES:
            continue
        rate = savgol_filter(leg.heading, window, 2, deriv=1, delta=leg.period)[use]
        behind = np.array([_lagging(leg.turning, lag / leg.period) for lag in TURN_LAGS])
        behind = savgol_filter(behind, window, 2)[:, use]
        rates.append(rate - rate.mean())
        positions.append(behind - behind.mean(axis=1, keepdims=True))
    if not rates:
        return None
    fits = [_fit(np.concatenate(rates), one) for one in np.concatenate(positions, axis=1)]
    slope, correlation = max(fits, key=lambda fit: abs(fit[1]))
    return slope if abs(correlation) >= LEAST_CORRELATION else None


def _lagging(position: Array, lag: float) -> Array:
    """A position through a first-order lag of so many samples, which begins settled."""
    if lag == 0.0:
        return position
    share = 1.0 - np.exp(-1.0 / lag)
    begin = [position[0] * (1.0 - share)]
    behind, _ = lfilter([share], [1.0, share - 1.0], position, zi=begin)
    return np.asarray(behind)


def _fit(rate: Array, position: Array) -> tuple[float, float]:
    """Slope and correlation; 0 where the part hardly moved."""
    moved, turned = float(np.mean(position**2)), float(np.mean(rate**2))
    if moved < LEAST_MOVED**2 or turned == 0.0:
        return 0.0, 0.0
    together = float(np.mean(rate * position))
    return together / moved, together / np.sqrt(moved * turned)


def _swing(name: str, leg: FigureSamples) -> Oscillation | None:
    """Of the longest stretch of settled samples."""
    values = {"heading": leg.heading_error, "pitch": leg.pitch, "roll": leg.roll}[name]
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
    """The swing of one signal in one leg, or None.

    Args:
      name: of the signal, a key of LEAST_AMPLITUDE.
      values: deviation from the target [deg], equally spaced, (time,).
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
    if amplitude < LEAST_AMPLITUDE[name] or share < SHARE or growth < LASTING:
        return None
    return Oscillation(
        signal=name, period_s=count * period / peak, amplitude_deg=amplitude, growth=growth, legs=1
    )


def limit_cycle(
    legs: Sequence[Mapping[str, Oscillation | None]], least: float
) -> Oscillation | None:
    """The largest swing among those that at least a part of the legs show, their medians.

    Args:
      legs: of each leg, what `oscillation_of` found, by signal.
      least: that part.
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
