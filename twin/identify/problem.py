"""Problem: residuals between logs and a vehicle with given parameters, to be minimised.

Compared are the depth rate at every sample under water and, where a store has fixes, the
depth-averaged current of each mission with that of the mission before, which a wrong angle of
attack or compass makes jump as the vehicle turns.

Residuals of depth rate are not independent: internal waves last minutes. Their number is divided
by the integrated autocorrelation time before anything is weighted, which is what makes the stated
deviations hold (`tests/twin/identify/test_identify_recovery.py`).

The deviations of a fit come from a bootstrap over its dives.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.identify.calibration import Calibration
from twin.identify.logged import Log
from twin.identify.speed import FlightModel, horizontal, motion_of, steady_parts
from twin.identify.translation import Translation
from twin.identify.unknowns import UnknownParameter

Blocks = NDArray[np.int_]

PRIOR = -1
"""Block of the residuals that are what was known before."""
DRAWS = 400
LEAST_BLOCKS = 8
"""Fewer dives are cut into parts: draws of three dives say little about their spread."""
SEED = 20221123
"""Deviations are the same in every run."""


def cut(blocks: Blocks) -> Blocks:
    """The dives of residuals, cut in equal parts where they are fewer than LEAST_BLOCKS."""
    numbers = np.unique(blocks[blocks != PRIOR])
    parts = -(-LEAST_BLOCKS // max(len(numbers), 1))
    if parts == 1:
        return blocks
    out = blocks.copy()
    for number in numbers:
        rows = np.flatnonzero(blocks == number)
        for k, piece in enumerate(np.array_split(rows, parts)):
            out[piece] = parts * number + k
    return out


def bootstrap(jacobian: Array, residual: Array, blocks: Blocks) -> Array:
    """Covariance of the offsets by block bootstrap, (parameters, parameters).

    Args:
      jacobian: (residuals, parameters), weighted, at the fit.
      residual: (residuals,), weighted.
      blocks: (residuals,) the dive of each; PRIOR: what was known before.
    """
    blocks = cut(blocks)
    numbers = np.unique(blocks[blocks != PRIOR])
    size = jacobian.shape[1]
    curve, slope = np.zeros((len(numbers), size, size)), np.zeros((len(numbers), size))
    for k, number in enumerate(numbers):
        rows = blocks == number
        curve[k] = jacobian[rows].T @ jacobian[rows]
        slope[k] = jacobian[rows].T @ residual[rows]
    known = jacobian[blocks == PRIOR]
    kept = residual[blocks == PRIOR]
    rng = np.random.default_rng(SEED)
    offsets = np.empty((DRAWS, size))
    for draw in range(DRAWS):
        count = np.bincount(rng.integers(0, len(numbers), len(numbers)), minlength=len(numbers))
        drawn = rng.normal(size=len(kept))
        matrix = np.tensordot(count, curve, axes=1) + known.T @ known
        right = count @ slope + known.T @ (kept + drawn)
        offsets[draw] = -np.linalg.solve(matrix, right)
    covariance = np.atleast_2d(np.cov(offsets, rowvar=False))
    # draws of n blocks scatter by (n - 1) / n of the variance
    return np.asarray(covariance * len(numbers) / max(len(numbers) - 1, 1), np.float64)


Array = NDArray[np.float64]

OUTLIER = 3.0
"""Deviations at which a residual's weight has fallen to a half."""
STEP = 1e-4
"""Spreads of the finite differences: far above rounding, far below any curvature."""
LEAST_PAIRS = 6
"""Pairs of missions with fixes below which fixes are not used."""
LEAST_CURRENT_CHANGE = 0.01
"""[m/s] between missions that no estimate of its spread falls below."""
LONGEST_CORRELATION = 600.0
"""[s] up to which autocorrelation is summed: half of a long dive."""


class Problem:
    """Residuals of a set of logs as a function of offsets from nominal, in spreads."""

    def __init__(
        self,
        logs: Sequence[Log],
        nominal: Calibration,
        parameters: tuple[UnknownParameter, ...],
        model: FlightModel,
        fixes: bool,
    ):
        self.logs, self.nominal, self.parameters, self.model = logs, nominal, parameters, model
        self.masks = [log.use & steady_parts(log) for log in logs]
        self.centres = np.array([p.get(nominal) for p in parameters])
        self.pairs = [
            k
            for k in range(1, len(logs))
            if logs[k].follows
            and logs[k].displacement is not None
            and logs[k - 1].displacement is not None
        ]
        if not fixes or len(self.pairs) < LEAST_PAIRS:
            self.pairs = []
        self.weights = [np.full(int(mask.sum()), 100.0) for mask in self.masks]  # 1 / (1 cm/s)
        self.pair_weights = np.full(2 * len(self.pairs), 1.0 / LEAST_CURRENT_CHANGE)

    def with_parameter(self, parameter: UnknownParameter) -> Problem:
        """The same with one parameter more, the last, and the weights of now."""
        wider = copy.copy(self)
        wider.parameters = (*self.parameters, parameter)
        wider.centres = np.append(self.centres, parameter.get(self.nominal))
        return wider

    def calibration(self, x: Array) -> Calibration:
        """The calibration at these offsets."""
        out = self.nominal
        for parameter, centre, offset in zip(self.parameters, self.centres, x, strict=True):
            out = parameter.at(out, float(centre), float(offset))
        return out

    def motions(self, calibration: Calibration) -> list[Translation]:
        """Velocities through the water of every log."""
        return [motion_of(log, calibration, self.model) for log in self.logs]

    def depth_rates(self, calibration: Calibration, motions: list[Translation]) -> list[Array]:
        """Model less measured [m/s] at the used samples of each log."""
        out = []
        for log, mask, motion in zip(self.logs, self.masks, motions, strict=True):
            sink = motion.sink_rate(log.roll, calibration.true_pitch(log.pitch))
            out.append((log.filtered(sink) - log.depth_rate)[mask])
        return out

    def current_changes(self, calibration: Calibration, motions: list[Translation]) -> Array:
        """North and east change of the depth-averaged current [m/s] of each pair, flat."""
        if not self.pairs:
            return np.zeros(0)
        current = np.full((len(self.logs), 2), np.nan)
        for k, (log, motion) in enumerate(zip(self.logs, motions, strict=True)):
            if log.displacement is not None:
                moved = [
                    log.period * float(np.sum(v)) for v in horizontal(log, calibration, motion)
                ]
                current[k] = (np.array(log.displacement) - moved) / log.duration
        return np.concatenate([current[k] - current[k - 1] for k in self.pairs])

    def weighted(self, calibration: Calibration, motions: list[Translation]) -> Array:
        """Residuals of depth rate and current, in independent deviations."""
        rates = self.depth_rates(calibration, motions)
        parts = [r * w for r, w in zip(rates, self.weights, strict=True)]
        parts.append(self.current_changes(calibration, motions) * self.pair_weights)
        return np.concatenate(parts)

    def residual(self, x: Array) -> Array:
        """Weighted residuals followed by the offsets themselves; infinite where nothing flies,
        from which a search steps back."""
        calibration = self.calibration(x)
        try:
            motions = self.motions(calibration)
        except InputError:
            return np.full(
                sum(w.size for w in self.weights) + self.pair_weights.size + x.size, np.inf
            )
        return np.concatenate([self.weighted(calibration, motions), x])

    def jacobian(self, x: Array) -> Array:
        """Forward differences; the compass changes no motion, only where it leads."""
        calibration = self.calibration(x)
        motions = self.motions(calibration)
        base = self.weighted(calibration, motions)
        columns = []
        for k, parameter in enumerate(self.parameters):
            moved = x.copy()
            moved[k] += STEP
            calibration = self.calibration(moved)
            turns = parameter.name.startswith("heading")
            there = self.weighted(calibration, motions if turns else self.motions(calibration))
            columns.append((there - base) / STEP)
        return np.concatenate([np.stack(columns, axis=1), np.eye(len(x))])

    @property
    def blocks(self) -> NDArray[np.int_]:
        """The mission of each residual; a change of current is the later one's."""
        parts = [np.full(int(mask.sum()), k) for k, mask in enumerate(self.masks)]
        parts.append(np.repeat(np.array(self.pairs, int), 2))
        parts.append(np.full(len(self.parameters), PRIOR))
        return np.concatenate(parts)

    @property
    def lowest(self) -> Array:
        """Bounds of the offsets from below: no hull grows under pressure."""
        bounds = [
            (p.least - centre) / p.spread if p.least is not None else -np.inf
            for p, centre in zip(self.parameters, self.centres, strict=True)
        ]
        return np.array(bounds)

    def reweight(self, x: Array) -> tuple[float, float]:
        """Weights of the next fit; returns deviation [m/s] and correlation time [s]."""
        calibration = self.calibration(x)
        motions = self.motions(calibration)
        rates = self.depth_rates(calibration, motions)
        scale = robust_scale(np.concatenate(rates))
        shares = [1.0 / (1.0 + (r / (OUTLIER * scale)) ** 2) for r in rates]
        total = sum(float(s.sum()) for s in shares)
        square = sum(float((s * r * r).sum()) for s, r in zip(shares, rates, strict=True))
        deviation = float(np.sqrt(square / total))
        period = self.logs[0].period
        samples = correlation_samples(
            [np.sqrt(s) * r for s, r in zip(shares, rates, strict=True)],
            round(LONGEST_CORRELATION / period),
        )
        self.weights = [np.sqrt(s / samples) / deviation for s in shares]
        changes = self.current_changes(calibration, motions)
        if changes.size:
            spread = max(robust_scale(changes), LEAST_CURRENT_CHANGE)
            # Differences of one series: each current enters two of them, hence twice the variance.
            self.pair_weights = 1.0 / (
                np.sqrt(2.0) * spread * np.sqrt(1.0 + (changes / (OUTLIER * spread)) ** 2)
            )
        return deviation, samples * period


def robust_scale(values: Array) -> float:
    """Standard deviation about zero from the median, as for normal values."""
    return float(1.4826 * np.median(np.abs(values)) + 1e-12)


def correlation_samples(series: list[Array], longest: int) -> float:
    """Integrated autocorrelation time in samples, at least 1: 1 + 2 sum rho(k), up to the first
    lag at which rho is no longer positive (Geyer 1992)."""
    longest = min(longest, max(len(s) for s in series) - 1)
    total = np.zeros(longest + 1)
    for s in series:
        size = 1 << (2 * len(s) - 1).bit_length()
        spectrum = np.fft.rfft(s, size)
        covariance = np.fft.irfft(spectrum * spectrum.conj(), size)[: longest + 1]
        total[: len(covariance)] += covariance[: len(total)]
    rho = total / total[0]
    stop = int(np.argmax(rho <= 0.0)) if (rho <= 0.0).any() else len(rho)
    return float(max(1.0 + 2.0 * rho[1:stop].sum(), 1.0))
