"""Fit: what turns and rolls a glider, fitted to the turns of a log.

Every steady part of a log is flown again by the lateral motion about its own glide
(`twin.identify.lateral`): the yaw rate that its roll and its rudder should have given beside the
one it had, and the roll that the battery's rotation should have given beside the measured one.
Dives and climbs each have their own glides, so that what changes sign with the lift parts from
what does not. Which of the coefficients make up a turn is less known than the turn: they start at
the vehicle file's, in proportion to its hull, and what the log does not tell stays there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from twin.identify.calibration import Calibration
from twin.identify.lateral import turning_part
from twin.identify.logged import Log
from twin.identify.turning_residuals import BIAS_SPREADS, BIASES, TURNING, TurnProblem, channel_of
from twin.identify.turning_windows import Group, groups_of, windows_of
from twin.identify.unknowns import UnknownParameter

Array = NDArray[np.float64]

LEAST_WINDOWS = 3
"""of a phase: with fewer its turns are not known"""
FARTHEST = 4.0
"""Spreads from the vehicle file's that a positive coefficient may go: where a turn says only a
ratio of two, damping would grow until no time step holds it."""
ROUNDS = 2
"""Fits of a battery's turns, the later ones from where it was found to hang straight"""
STEERABLE = 0.8
"""Of its travel within which the neutral position stays, so that the part steers both ways"""
PASSES = 3
"""Fits between which weights are taken again."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Turns:
    """What the turns of a log say."""

    calibration: Calibration
    parameters: tuple[UnknownParameter, ...]
    centres: Array
    offsets: Array
    """in spreads, the parameters' then BIASES'"""
    jacobian: Array
    residual: Array
    blocks: NDArray[np.int_]
    """Dive of each residual; -1: what was known before."""
    rate_deviation: float
    """[rad/s] of the yaw rate"""
    roll_deviation: float | None
    """[rad] of the roll; None without the battery's rotation"""
    groups: tuple[Group, ...]
    neutral: float | None
    """[rad] position of the turning part that flies the asymmetry; None: not known"""
    apart: float
    """[rad] by which dives and climbs want it elsewhere; the mean is flown"""

    @property
    def biases(self) -> tuple[float, float]:
        """Yaw bias as a sideslip, roll offset [rad]."""
        yaw, roll = self.offsets[len(self.parameters) :] * np.array(BIAS_SPREADS)
        return float(yaw), float(roll)


def turned(logs: Sequence[Log], calibration: Calibration) -> Turns | None:
    """Fit what turns the vehicle; None where no phase has turns enough."""
    part = turning_part(calibration.vehicle)
    windows = windows_of(logs, calibration)
    if min(sum(w.climbing == c for w in windows) for c in (False, True)) < LEAST_WINDOWS:
        return None
    channel = channel_of(calibration)
    groups = groups_of(windows, channel)
    there = all(g.position is not None for g in groups)
    parameters = tuple(p for p in TURNING if p.channel is None or (p.channel == channel and there))
    if channel != "rotation" or not there:
        parameters = tuple(p for p in parameters if not p.name.startswith("roll_moment"))
    neutral, apart = None, 0.0
    if part is not None and there:
        neutral, calibration = 0.0, _resting(calibration, part.name, 0.0)
    # a battery turns by the sine of its rotation from where it hangs straight: once more from there
    for _ in range(ROUNDS if channel == "rotation" and there else 1):
        problem, x, scales = _fitted(groups, calibration, parameters)
        fitted = problem.calibration(x)
        more = problem.neutral(x)
        if neutral is None or part is None or more is None:
            break
        room, middle = STEERABLE * (part.high - part.low) / 2.0, 0.5 * (part.high + part.low)
        mean, phases = more
        apart = max(phases.values()) - min(phases.values())
        before, neutral = neutral, min(max(neutral + mean, middle - room), middle + room)
        groups = [_counted(group, neutral - before) for group in groups]
        calibration = _resting(calibration, part.name, neutral)
        fitted = _resting(fitted, part.name, neutral)
    parts = problem.parts(x)
    blocks = np.concatenate([b for _, b in parts] + [np.full(len(x), -1)])
    return Turns(
        calibration=fitted,
        parameters=parameters,
        centres=problem.centres,
        offsets=x,
        jacobian=problem.jacobian(x),
        residual=problem.residual(x),
        blocks=blocks,
        rate_deviation=scales[0],
        roll_deviation=scales[1],
        groups=tuple(groups),
        neutral=neutral,
        apart=apart,
    )


def _fitted(
    groups: Sequence[Group], calibration: Calibration, parameters: tuple[UnknownParameter, ...]
) -> tuple[TurnProblem, Array, tuple[float, float | None]]:
    """The problem, its offsets, and the deviations of yaw rate and roll."""
    problem = TurnProblem(groups, calibration, parameters)
    factors = [p.logarithmic for p in parameters] + [False] * len(BIASES)
    farthest = np.where(factors, FARTHEST, np.inf)
    x = problem.best_start()
    scales = problem.reweight(x)
    for _ in range(PASSES):
        found = least_squares(
            problem.residual,
            x,
            jac=problem.jacobian,
            bounds=(-farthest, farthest),
            x_scale="jac",
            max_nfev=15,
            xtol=1e-4,
        )
        x = found.x
        scales = problem.reweight(x)
    return problem, x, scales


def _resting(calibration: Calibration, part: str, neutral: float) -> Calibration:
    """With the neutral position [rad] of its turning part."""
    vehicle = calibration.vehicle.replace(**{part: {"neutral": neutral}})
    return calibration.replace(vehicle=vehicle)


def _counted(group: Group, neutral: float) -> Group:
    """With positions counted from `neutral` [rad]."""
    assert group.position is not None
    return dataclasses.replace(group, position=group.position - neutral)
