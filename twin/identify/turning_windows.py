"""Turning windows: steady parts of a log in which turns are compared, grouped by phase and speed.

`yaw_rates` and `rolls` compute the linear lateral motion about a group's glide.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit
from twin.identify.calibration import Array, Calibration
from twin.identify.linear_motion import Glide, Lateral, turning_part
from twin.identify.logged_missions import Log
from twin.identify.pitch import battery_moment, righting_arm
from twin.identify.speed import motion_of, net_mass_of, steady_parts
from twin.identify.translation import Translation
from twin.vehicle.parts import BatteryHinge, Fin

LONGEST, SHORTEST = 900.0, 100.0
"""[s] Longest and shortest window: longer steady parts are cut, shorter parts are left out."""
SETTLE = 30.0
"""[s] Time at the start of a window that is not compared: its initial sideslip is a guess."""
LEAST_DEPTH = 5.0
"""[m] Smallest depth of a window"""
SPACINGS, LEAST_AVERAGE, MOST_AVERAGE = 2.5, 10.0, 90.0
"""SPACINGS: duration of the compared means of yaw rate and roll, in original samples; the end of a
part's move is known to about one. LEAST_AVERAGE, MOST_AVERAGE: [s] limits of the duration."""
LEAST_BEND = 1e-6
"""[rad] Second difference of the heading above which a sample is original, not interpolated"""
SPEED_BINS, ENOUGH_IN_BIN = 3, 6
"""SPEED_BINS: maximum number of speed groups of a phase. ENOUGH_IN_BIN: minimum number of windows
of a group, which has its own glide"""
MOST_ROLL = math.radians(60.0)
"""[rad] Largest roll of a window: beyond it no glide is linear."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TurningWindow:
    """Steady part of a log in a dive or a climb."""

    log: Log
    part: slice
    climbing: bool
    speed: float
    """[m/s] Median speed through the water"""
    glide: Glide
    block: int = 0
    """Index of the dive among the logs"""


def _flight(log: Log, calibration: Calibration) -> tuple[Translation, Array, Array]:
    """Velocities, true pitch [rad] and net mass [kg] of a log."""
    net = net_mass_of(log, calibration)
    return motion_of(log, calibration), calibration.true_pitch(log.pitch), net


def _glide(motion: Translation, pitch: Array, net: Array, part: slice) -> Glide:
    columns = (motion.surge, motion.heave, pitch, net)
    return Glide(*(float(np.median(one[part])) for one in columns))


def windows_of(logs: Sequence[Log], calibration: Calibration) -> list[TurningWindow]:
    """Find the steady parts of the logs, each within one dive or climb."""
    found: list[TurningWindow] = []
    for number, log in enumerate(logs):
        motion, pitch, net = _flight(log, calibration)
        steady = log.use & steady_parts(log) & (log.depth > LEAST_DEPTH)
        steady &= (np.abs(log.roll) < MOST_ROLL) & (np.sign(pitch) == -np.sign(net))
        steady &= motion.surge > 0.05
        phase = np.where(steady, np.sign(pitch), 0.0)
        edges = np.flatnonzero(np.diff(phase)) + 1
        for first, last in zip([0, *edges], [*edges, len(phase)], strict=True):
            if phase[first] == 0.0:
                continue
            pieces = max(1, math.ceil((last - first) * log.period / LONGEST))
            for bounds in np.array_split(np.arange(first, last), pieces):
                if len(bounds) * log.period < SHORTEST or len(bounds) < log.window + 2:
                    continue
                part = slice(int(bounds[0]), int(bounds[-1]) + 1)
                found.append(
                    TurningWindow(
                        log=log,
                        part=part,
                        climbing=bool(phase[first] > 0.0),
                        speed=float(np.median(motion.speed[part])),
                        glide=_glide(motion, pitch, net, part),
                        block=number,
                    )
                )
    return found


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Group:
    """Windows with one common glide; arrays are (samples, windows), padded at the end."""

    windows: tuple[TurningWindow, ...]
    glide: Glide
    climbing: bool
    period: float
    roll: Array
    """[rad] Measured roll"""
    slope: Array
    """[rad/s] Rate of change of the roll"""
    position: Array | None
    """[rad] Position of the turning part minus its neutral position; None: not in the log"""
    rate: Array
    """[rad/s] Yaw rate about the body's axis"""
    used: NDArray[np.bool_]
    """True for averages that are compared, (averages, windows)"""
    count: int
    """Number of samples in an average"""

    def reglided(self, calibration: Calibration) -> Group:
        """Return the group with the median glide of its windows by another calibration."""
        flights = {w.log.index: w.log for w in self.windows}
        flown = {index: _flight(log, calibration) for index, log in flights.items()}
        glides = [_glide(*flown[w.log.index], w.part) for w in self.windows]
        return dataclasses.replace(self, glide=_median(glides))


def groups_of(
    windows: Sequence[TurningWindow], channel: str | None, neutral: float = 0.0
) -> list[Group]:
    """Group windows by phase and speed; `neutral` is the turning part's neutral position [rad]."""
    logs = list({w.log.index: w.log for w in windows}.values())
    average = min(max(SPACINGS * spacing(logs), LEAST_AVERAGE), MOST_AVERAGE)
    count = max(round(average / logs[0].period), 1)
    found = []
    for climbing in (False, True):
        phase = sorted((w for w in windows if w.climbing == climbing), key=lambda w: w.speed)
        if not phase:
            continue
        bins = max(1, min(SPEED_BINS, len(phase) // ENOUGH_IN_BIN))
        for chosen in np.array_split(np.arange(len(phase)), bins):
            found.append(_group([phase[k] for k in chosen], channel, count, neutral))
    return found


def _median(glides: Sequence[Glide]) -> Glide:
    return Glide(*np.median(glides, axis=0).tolist())


def _group(
    windows: Sequence[TurningWindow], channel: str | None, count: int, neutral: float
) -> Group:
    period = windows[0].log.period
    length = max(w.part.stop - w.part.start for w in windows)
    skip = round(SETTLE / period)
    shape = (length, len(windows))
    roll, slope, position, rate = (np.zeros(shape) for _ in range(4))
    used = np.zeros(shape, bool)
    lacking = channel is None or any(getattr(w.log, channel) is None for w in windows)
    for k, window in enumerate(windows):
        log, part = window.log, window.part
        n = part.stop - part.start
        roll[:n, k] = log.roll[part]
        # d(roll)/dt = p + tan(pitch) (q sin(roll) + r cos(roll))
        p, q, r = log.rates[:, part]
        turning = q * np.sin(log.roll[part]) + r * np.cos(log.roll[part])
        slope[:n, k] = p + np.tan(window.glide.pitch) * turning
        rate[:n, k] = r
        used[skip : n - log.window // 2, k] = True
        if not lacking and channel is not None:
            position[:n, k] = getattr(log, channel)[part] - neutral
    return Group(
        windows=tuple(windows),
        glide=_median([w.glide for w in windows]),
        climbing=windows[0].climbing,
        period=period,
        roll=roll,
        slope=slope,
        position=None if lacking else position,
        rate=rate,
        used=np.asarray(averaged(used.astype(float), count) == 1.0),
        count=count,
    )


def spacing(logs: Sequence[Log]) -> float:
    """Time [s] between original samples; a store has interpolated samples between them."""
    bends, samples = 0, 0
    for log in logs:
        bent = np.abs(np.diff(log.heading, 2)) > LEAST_BEND
        bends, samples = bends + int(bent.sum()), samples + len(bent)
    # an interpolated line bends at two samples of the store for each original sample
    share = bends / max(samples, 1)
    return logs[0].period * max(2.0 / share, 1.0) if share > 0.0 else MOST_AVERAGE


def averaged(values: Array, n: int) -> Array:
    """Average (samples, windows) over `n` samples: (averages, windows); a remainder is dropped."""
    whole = len(values) // n * n
    return values[:whole].reshape(-1, n, values.shape[1]).mean(axis=1)


def channel_of(calibration: Calibration) -> str | None:
    """Channel of the turning part in a log: "rotation", "fin", or None."""
    part = turning_part(calibration.vehicle)
    if isinstance(part, BatteryHinge):
        return "rotation"
    return "fin" if isinstance(part, Fin) else None


def yaw_rates(
    group: Group, lateral: Lateral, position: Array, yaw: float, roll_offset: float
) -> Array:
    """Compute the yaw rate [rad/s] from roll and turning part, (samples, windows).

    Args:
      position: effective position of the turning part (`felt`).
      yaw: constant yaw moment [N m]. roll_offset: zero of the roll sensor [rad].
    """
    step, response = lateral.turned_by_roll(group.period)
    roll = np.sin(group.roll - roll_offset)
    inputs = np.stack([roll, group.slope, position, np.full_like(roll, yaw)], axis=-1)
    driven = 0.5 * (inputs[1:] + inputs[:-1]) @ response.T
    state = np.linalg.solve(np.eye(2) - step, response @ inputs[0].T).T
    return _march(step, np.ascontiguousarray(driven), np.ascontiguousarray(state), 1)


def rolls(group: Group, lateral: Lateral, position: Array) -> Array:
    """Compute the roll [rad] from the battery's positions, (samples, windows)."""
    step, response = lateral.rolled_by_part(group.period)
    driven = 0.5 * (position[1:] + position[:-1])[..., None] * response[:, 0]
    state = np.linalg.solve(np.eye(4) - step, response[:, :1] * position[0]).T
    return np.arctan(_march(step, driven, np.ascontiguousarray(state), 3))


@jit
def _march(step: Array, driven: Array, state: Array, which: int) -> Array:
    """Step x(k + 1) = step x(k) + driven(k); return element `which` of x, (samples, windows).

    Loops over single numbers: numba takes seconds to compile assignments between arrays.
    """
    samples, windows, n = driven.shape
    out = np.empty((samples + 1, windows))
    x, y = np.empty(n), np.empty(n)
    for w in range(windows):
        for i in range(n):
            x[i] = state[w, i]
        out[0, w] = x[which]
        for k in range(samples):
            for i in range(n):
                y[i] = driven[k, w, i]
                for j in range(n):
                    y[i] += step[i, j] * x[j]
            for i in range(n):
                x[i] = y[i]
            out[k + 1, w] = x[which]
    return out


def felt(calibration: Calibration, position: Array) -> Array:
    """Position of the turning part for the linear model. A rudder's is unchanged; a hinge's makes
    the linear roll equal to the tangent of the true roll, (a + b cos x) tan(roll) = -b sin x."""
    if channel_of(calibration) != "rotation":
        return position
    vehicle = calibration.vehicle
    whole = vehicle.mass * righting_arm(calibration)
    raised = battery_moment(calibration) * (1.0 - np.cos(position))
    return whole * np.sin(position) / (whole - raised)
