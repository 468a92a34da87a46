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

    @property
    def biases(self) -> tuple[float, float]:
        """Yaw bias as a sideslip, roll offset [rad]."""
        yaw, roll = self.offsets[len(self.parameters) :] * np.array(BIAS_SPREADS)
        return float(yaw), float(roll)


def turned(logs: Sequence[Log], calibration: Calibration) -> Turns | None:
    """Fit what turns the vehicle; None where no phase has turns enough."""
    windows = windows_of(logs, calibration)
    if min(sum(w.climbing == c for w in windows) for c in (False, True)) < LEAST_WINDOWS:
        return None
    channel = channel_of(calibration)
    groups = groups_of(windows, channel)
    there = all(g.position is not None for g in groups)
    parameters = tuple(p for p in TURNING if p.channel is None or (p.channel == channel and there))
    if channel != "rotation" or not there:
        parameters = tuple(p for p in parameters if not p.name.startswith("roll_moment"))
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
    parts = problem.parts(x)
    blocks = np.concatenate([b for _, b in parts] + [np.full(len(x), -1)])
    return Turns(
        calibration=problem.calibration(x),
        parameters=parameters,
        centres=problem.centres,
        offsets=x,
        jacobian=problem.jacobian(x),
        residual=problem.residual(x),
        blocks=blocks,
        rate_deviation=scales[0],
        roll_deviation=scales[1],
        groups=tuple(groups),
    )
