"""Residuals: yaw rate and roll of the model less those of a log, weighted."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.identify.calibration import Calibration
from twin.identify.lateral import linearised
from twin.identify.problem import OUTLIER, correlation_samples, robust_scale
from twin.identify.turning.response import felt, rolls, yaw_rates
from twin.identify.turning.unknowns import BIAS_SPREADS, BIASES, channel_of, munk_moment
from twin.identify.turning.windows import Group, averaged
from twin.identify.unknowns import Parameter

Array = NDArray[np.float64]

LEAST_TURN = math.radians(0.01)
"""[rad/s] that the yaw rate is off at least: compasses and the log's rounding."""
LEAST_ROLL = math.radians(0.3)
"""[rad] that the roll is off at least"""
START_YAW, START_DAMPING = (-2.0, -1.0, 0.0, 1.0), (0.0, 1.0)
"""Spreads of yaw moment and damping from the vehicle file's at which the search looks."""
STEP = 1e-3
"""Spreads of the finite differences."""
LONGEST_CORRELATION = 300.0
"""[s]"""


class TurnProblem:
    """Residuals of yaw rate and roll as a function of offsets from the start, in spreads."""

    def __init__(
        self,
        groups: Sequence[Group],
        start: Calibration,
        parameters: tuple[Parameter, ...],
    ):
        self.groups, self.start, self.parameters = groups, start, parameters
        self.channel = channel_of(start)
        self.centres = np.array([p.get(start) for p in parameters])
        self.weights: list[tuple[Array, Array | None]] = []

    def calibration(self, x: Array) -> Calibration:
        """The calibration at these offsets, the biases left out."""
        out = self.start
        for parameter, centre, offset in zip(self.parameters, self.centres, x, strict=False):
            out = parameter.at(out, float(centre), float(offset))
        return out

    def biases(self, x: Array) -> tuple[float, float]:
        """Yaw bias as a sideslip, roll offset [rad]."""
        yaw, roll = x[len(self.parameters) :] * np.array(BIAS_SPREADS)
        return float(yaw), float(roll)

    def raw(self, x: Array) -> list[tuple[Array, Array | None]]:
        """Yaw rate [rad/s] and roll [rad], model less log, (averages, windows) of each group."""
        calibration = self.calibration(x)
        bias, offset = self.biases(x)
        out = []
        for group in self.groups:
            lateral = linearised(calibration.vehicle, group.glide)
            position = np.zeros_like(group.roll)
            if group.position is not None:
                position = felt(calibration, group.position)
            square = group.glide.surge**2 + group.glide.heave**2
            yaw = munk_moment(calibration) * bias * square
            rate = yaw_rates(group, lateral, position, yaw, offset) - group.rate
            rate = averaged(rate, group.count)
            roll = None
            if group.position is not None and self.channel == "rotation":
                roll = averaged(rolls(group, lateral, position) - group.roll, group.count)
                # its roll with the battery at rest is an offset of the trim, not dynamics
                roll = roll - np.median(roll[group.used])
            out.append((rate, roll))
        return out

    def parts(self, x: Array) -> list[tuple[Array, NDArray[np.int_]]]:
        """Weighted residuals of each group and the dive of each."""
        out = []
        for group, (rate, roll), (w_rate, w_roll) in zip(
            self.groups, self.raw(x), self.weights, strict=True
        ):
            blocks = np.broadcast_to(group.blocks, group.used.shape)[group.used]
            out.append(((rate * w_rate)[group.used], blocks))
            if roll is not None and w_roll is not None:
                out.append(((roll * w_roll)[group.used], blocks))
        return out

    def residual(self, x: Array) -> Array:
        """Weighted residuals, then the offsets; huge where nothing can be integrated."""
        with np.errstate(over="ignore", invalid="ignore"):
            values = np.concatenate([part for part, _ in self.parts(x)])
        return np.concatenate([np.clip(np.nan_to_num(values, nan=1e6), -1e6, 1e6), x])

    def jacobian(self, x: Array) -> Array:
        """Forward differences."""
        base = self.residual(x)
        columns = [(self.residual(x + STEP * unit) - base) / STEP for unit in np.eye(len(x))]
        return np.stack(columns, axis=1)

    def best_start(self) -> Array:
        """Offsets to begin from: of several yaw moments and dampings, with the asymmetry that
        suits each, those that fit best. Turns to the wrong side are a valley of their own."""
        best, lowest = np.zeros(len(self.parameters) + len(BIASES)), math.inf
        names = [p.name for p in self.parameters]
        self.reweight(best)
        for yaw, damping in itertools.product(START_YAW, START_DAMPING):
            x = np.zeros_like(best)
            x[names.index("yaw_moment")], x[names.index("yaw_damping")] = yaw, damping
            base = self.residual(x)
            free = range(len(names), len(x))
            columns = [(self.residual(x + STEP * np.eye(len(x))[k]) - base) / STEP for k in free]
            step, *_ = np.linalg.lstsq(np.stack(columns, axis=1), -base, rcond=None)
            x[len(names) :] = np.clip(step, -2.0, 2.0)
            cost = float(np.sum(self.residual(x) ** 2))
            if cost < lowest:
                best, lowest = x, cost
        return best

    def reweight(self, x: Array) -> tuple[float, float | None]:
        """Weights of the next fit; returns deviations of yaw rate [rad/s] and roll [rad]."""
        found = self.raw(x)
        rate, rate_weights = self._weights([r for r, _ in found], LEAST_TURN)
        rolled = [r for _, r in found if r is not None]
        roll: float | None = None
        roll_weights: list[Array] = []
        if rolled:
            roll, roll_weights = self._weights(rolled, LEAST_ROLL)
        later = iter(roll_weights)
        self.weights = [
            (w, None if r is None else next(later))
            for w, (_, r) in zip(rate_weights, found, strict=True)
        ]
        return rate, roll

    def _weights(self, found: list[Array], least: float) -> tuple[float, list[Array]]:
        groups = [g for g in self.groups if g.position is not None]
        groups = groups if len(groups) == len(found) else list(self.groups)
        values = np.concatenate([r[g.used] for r, g in zip(found, groups, strict=True)])
        scale = max(robust_scale(values), least)
        shares = [1.0 / (1.0 + (r / (OUTLIER * scale)) ** 2) for r in found]
        series = [
            (np.sqrt(s) * r)[g.used[:, k], k]
            for r, s, g in zip(found, shares, groups, strict=True)
            for k in range(r.shape[1])
        ]
        first = self.groups[0]
        samples = correlation_samples(
            [one for one in series if len(one) > 2],
            round(LONGEST_CORRELATION / (first.period * first.count)),
        )
        return scale, [np.sqrt(s / samples) / scale for s in shares]
