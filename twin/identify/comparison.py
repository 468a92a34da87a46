"""Comparison: residuals between dives and a vehicle with unknown parameters, and their fit.

A comparison gives its residuals as series, each of one dive and one channel. Residuals of a series
are correlated, because internal waves last minutes. Their weights are divided by the integrated
autocorrelation time, so that the stated standard deviations hold
(`tests/twin/identify/test_identify_recovery.py`). Covariances come from a bootstrap over dives.

Cross-validation over left-out dives judges a further parameter (Hastie et al. 2009, The Elements of
Statistical Learning, 7.10): a pitch offset, for example, cannot be told from drag and trim in a log
with a single pitch, and would fit the model's own errors. A fit without one dive, or with one more
parameter, is one Gauss-Newton step from the fit to all dives: the equations are nearly linear. On
public logs, the gain by one step is within a fifth of the gain of complete fits.
"""

from __future__ import annotations

import abc
import copy
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from twin.errors import InputError
from twin.identify.calibration import Array, Calibration
from twin.identify.unknowns import UnknownParameter

Blocks = NDArray[np.int_]

PRIOR = -1
"""Block number of the residuals of the priors"""
DRAWS = 400
LEAST_BLOCKS = 8
"""Minimum number of bootstrap blocks; fewer dives are cut into parts, as three dives say little."""
SEED = 20221123
"""Seed of the bootstrap: standard deviations are the same in every run."""
OUTLIER = 3.0
"""Residual in standard deviations at which its weight has fallen to a half"""
LARGEST = 1e6
"""Largest residual in standard deviations: larger ones, and NaN, are cut off here."""
LEAST_DIVES = 4
"""Minimum number of dives for a cross-validation"""
LEAST_GAIN = 0.04
"""[1] Smallest decrease of left-out dives' mean square error by a supported parameter. The pitch
offsets of ten public logs take 0 to 3.2 %, that of an eleventh 18 % (docs/howto/identify.md)."""
LEAST_DEVIATIONS = 2.0
"""Smallest gain of a supported parameter, in standard deviations of the gain"""


class ComparedQuantity(NamedTuple):
    """Noise of one compared quantity."""

    unit: str
    least: float
    """Lower bound of its standard deviation, in `unit`: errors of sensors and of the model"""
    samples: float = 0.0
    """Number of residuals per independent residual; 0: use the integrated autocorrelation time"""
    longest: int = 0
    """Longest lag, in residuals, in the sum of autocorrelations"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualNoise:
    """Standard deviation and autocorrelation time of a channel's residuals."""

    deviation: float
    """Standard deviation in the channel's unit, outliers weighted down"""
    samples: float
    """Integrated autocorrelation time, in residuals"""


class Residuals(NamedTuple):
    """Residuals of a channel near a calibration, model minus log, with their Jacobian."""

    unit: str
    values: Array
    """Residuals in `unit`, (residuals,)"""
    deviation: Array
    """Standard deviations in `unit`, (residuals,), for weights as if independent: the channel's
    times the root of the autocorrelation time, and larger for outliers"""
    jacobian: Array
    """Slopes in `unit` per spread of each unknown, (residuals, unknowns)"""
    dives: Blocks
    """Index of each residual's dive among the logs, (residuals,)"""


class Comparison(abc.ABC):
    """Residuals of dives as functions of unknown offsets from nominal, in spreads: offsets of the
    parameters, then of biases, which are not in a calibration."""

    step = 1e-4
    """Step of the finite differences in spreads: far above rounding, far below any curvature"""
    biases: tuple[str, ...] = ()

    def __init__(
        self,
        nominal: Calibration,
        parameters: tuple[UnknownParameter, ...],
        channels: Mapping[str, ComparedQuantity],
        dives: Mapping[str, Sequence[int]],
    ):
        """Compare `channels`; `dives` has the index of the dive of each series, by channel."""
        self.nominal, self.parameters = nominal, parameters
        self.channels, self.dives = channels, dives
        self.centres = np.array([p.get(nominal) for p in parameters])
        self.weights: dict[str, list[Array]] = {}
        self._steps: list[tuple[float, Calibration]] = []

    @abc.abstractmethod
    def missed(self, x: Array) -> dict[str, list[Array]]:
        """Residuals, model minus log, at these offsets: a series for each of `dives`, by channel.

        Raises:
          InputError: the vehicle cannot fly with these offsets.
        """

    def missed_at(self, places: Sequence[Array]) -> Iterator[dict[str, list[Array]]]:
        """Yield `missed` at each place in turn."""
        return map(self.missed, places)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.parameters) + len(self.biases)

    def with_parameters(self, *more: UnknownParameter) -> Self:
        """Return a copy with more parameters at the end and the present weights."""
        wider = copy.copy(self)
        wider.parameters = (*self.parameters, *more)
        wider.centres = np.append(self.centres, [p.get(self.nominal) for p in more])
        wider._steps = []
        return wider

    def calibration(self, x: Array) -> Calibration:
        """Return the calibration at these offsets; biases have no effect on it.

        Parameters are set in order. The result before the first changed offset is kept from the
        last call, because neighbouring columns of the slopes share most offsets.
        """
        out = self.nominal
        for k, (parameter, centre) in enumerate(zip(self.parameters, self.centres, strict=True)):
            offset = float(x[k])
            if k == len(self._steps) or self._steps[k][0] != offset:
                made = parameter.at(out, float(centre), offset)
                self._steps[k:] = [(offset, made)]
            out = self._steps[k][1]
        return out

    @property
    def lowest(self) -> Array:
        """Lower bounds of the offsets; for example, a compressibility is not negative."""
        bounds = [
            (p.least - centre) / p.spread if p.least is not None else -np.inf
            for p, centre in zip(self.parameters, self.centres, strict=True)
        ]
        return np.array([*bounds, *(-np.inf for _ in self.biases)])

    def _weighted(self, found: Mapping[str, list[Array]]) -> Array:
        """Residuals divided by their standard deviations, channel by channel, in one array."""
        with np.errstate(over="ignore", invalid="ignore"):
            parts = [
                series * weight
                for name, weights in self.weights.items()
                for series, weight in zip(found[name], weights, strict=True)
            ]
        values = np.concatenate([np.zeros(0), *parts])
        return np.clip(np.nan_to_num(values, nan=LARGEST), -LARGEST, LARGEST)

    def residual(self, x: Array) -> Array:
        """Weighted residuals, then the offsets, which are the priors' residuals. All are infinite
        if the vehicle cannot fly, so that a search steps back."""
        try:
            return np.concatenate([self._weighted(self.missed(x)), x])
        except InputError:
            return np.full(len(self.blocks), np.inf)

    def slopes(self, x: Array) -> Array:
        """Forward differences of the weighted residuals, (residuals, unknowns)."""
        places = [x, *(x + self.step * unit for unit in np.eye(len(x)))]
        base, *moved = map(self._weighted, self.missed_at(places))
        columns = [(one - base) / self.step for one in moved]
        return np.stack(columns, axis=1) if columns else np.zeros((len(base), 0))

    def considered(self, x: Array, held: Sequence[UnknownParameter]) -> tuple[Array, Array]:
        """`consider` for a fit that ended at `x`; each of `held` has its usual error."""
        first, last = len(self.parameters), len(self.parameters) + len(held)
        slopes = self.with_parameters(*held).slopes(np.insert(x, [first] * len(held), 0.0))
        own, others = np.delete(slopes, slice(first, last), axis=1), slopes[:, first:last]
        return consider(own, others, np.array([p.held / p.spread for p in held]))

    def jacobian(self, x: Array) -> Array:
        """Slopes of `residual`, (residuals and offsets, unknowns)."""
        return np.concatenate([self.slopes(x), np.eye(len(x))])

    def residuals(self, x: Array) -> dict[str, Residuals]:
        """Residuals of each channel near these offsets, with the present weights."""
        slopes, missed = self.slopes(x), self.missed(x)
        found, first = {}, 0
        for name, weights in self.weights.items():
            deviation = 1.0 / np.concatenate([np.zeros(0), *weights])
            last = first + len(deviation)
            found[name] = Residuals(
                unit=self.channels[name].unit,
                values=np.concatenate([np.zeros(0), *missed[name]]),
                deviation=deviation,
                jacobian=slopes[first:last] * deviation[:, None],
                dives=self.blocks[first:last],
            )
            first = last
        return found

    @property
    def blocks(self) -> Blocks:
        """Index of the dive of each residual; PRIOR for the offsets."""
        parts = [
            np.full(len(weight), dive)
            for name, weights in self.weights.items()
            for dive, weight in zip(self.dives[name], weights, strict=True)
        ]
        return np.concatenate([*parts, np.full(self.size, PRIOR)])

    def reweight(
        self, x: Array, known: Mapping[str, ResidualNoise] | None = None
    ) -> dict[str, ResidualNoise]:
        """Set the weights by the residuals at `x`, or by a `known` noise; return the noise."""
        found = {}
        for name, series in self.missed(x).items():
            if not sum(map(len, series)):
                self.weights[name] = [np.ones(0) for _ in series]
                continue
            found[name] = noise = (known or {}).get(name) or self._noise(name, series)
            self.weights[name] = [
                np.sqrt(share / noise.samples) / noise.deviation
                for share in shares(series, noise.deviation)
            ]
        return found

    def _noise(self, name: str, series: Sequence[Array]) -> ResidualNoise:
        """Standard deviation and autocorrelation of residuals, outliers weighted down."""
        channel, together = self.channels[name], np.concatenate(list(series))
        kept = shares(series, max(robust_scale(together), channel.least))
        share = np.concatenate(kept)
        deviation = float(np.sqrt(np.sum(share * together**2) / np.sum(share)))
        weighted = [np.sqrt(s) * r for s, r in zip(kept, series, strict=True)]
        samples = channel.samples or correlation_samples(weighted, channel.longest)
        return ResidualNoise(deviation=max(deviation, channel.least), samples=samples)

    def fit(
        self,
        x: Array,
        passes: int,
        *,
        bounds: tuple[Array, Array] | None = None,
        first: Mapping[str, ResidualNoise] | None = None,
        progress: Callable[[float], None] = lambda part: None,
        **ends: Any,
    ) -> tuple[Array, dict[str, ResidualNoise]]:
        """Robust least squares from `x` on; weights are set again after each of `passes`.

        The noise `first` sets the weights of the first pass, if the residuals at `x` are too large
        to do so. Returns the offsets and the noise.
        """
        low, high = bounds or (self.lowest, np.full(self.size, np.inf))
        noise = self.reweight(x, first)
        for k in range(passes):
            begin, search = np.clip(x, low, high), {"bounds": (low, high), "x_scale": "jac"}
            x = least_squares(self.residual, begin, jac=self.jacobian, **search, **ends).x
            noise = self.reweight(x)
            progress((k + 1) / passes)
        return x, noise

    def fitted(self, x: Array) -> Fitted:
        """Result of a fit that ended at `x`."""
        return Fitted(
            calibration=self.calibration(x),
            parameters=self.parameters,
            centres=self.centres,
            offsets=x,
            covariance=bootstrap(self.jacobian(x), self.residual(x), self.blocks),
            deviation={n: rms(np.concatenate(s)) for n, s in self.missed(x).items() if s},
        )


def consider(own: Array, others: Array, off: Array) -> tuple[Array, Array]:
    """Covariance of a fit by noise, and its change by each held parameter that is off by `off`,
    (unknowns, held), by the slopes `others`. Together they have the covariance noise + change
    change^T (Tapley et al. 2004, Statistical Orbit Determination, 6.2)."""
    inverse = np.asarray(np.linalg.inv(own.T @ own + np.eye(own.shape[1])), np.float64)
    return inverse, inverse @ (own.T @ others) * off


class Fitted(NamedTuple):
    """Result of a comparison's fit, with its covariance."""

    calibration: Calibration
    parameters: tuple[UnknownParameter, ...]
    centres: Array
    offsets: Array
    """Offsets in spreads, those of the parameters before those of the biases"""
    covariance: Array
    """Covariance of the offsets, by a bootstrap over the dives"""
    deviation: Mapping[str, float]
    """Root mean square of each channel's residuals, in its unit"""


def shares(series: Sequence[Array], scale: float) -> list[Array]:
    """Fraction of its weight that each residual keeps: one half at OUTLIER times `scale`."""
    return [1.0 / (1.0 + (r / (OUTLIER * scale)) ** 2) for r in series]


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def robust_scale(values: Array) -> float:
    """Standard deviation about zero from the median size, for normally distributed values."""
    return float(1.4826 * np.median(np.abs(values)) + 1e-12)


def correlation_samples(series: Sequence[Array], longest: int) -> float:
    """Integrated autocorrelation time in samples, at least 1: 1 + 2 sum rho(k), up to the first
    lag at which rho is no longer positive (Geyer 1992)."""
    series = [s for s in series if len(s)]
    longest = min(longest, max(len(s) for s in series) - 1)
    total = np.zeros(longest + 1)
    for s in series:
        size = 1 << (2 * len(s) - 1).bit_length()
        spectrum = np.fft.rfft(s, size)
        covariance = np.fft.irfft(spectrum * spectrum.conj(), size)[: min(longest + 1, len(s))]
        total[: len(covariance)] += covariance
    if not total[0] > 0.0:
        return 1.0  # all of them zero: a sample apart is as good as any
    rho = total / total[0]
    stop = int(np.argmax(rho <= 0.0)) if (rho <= 0.0).any() else len(rho)
    return float(max(1.0 + 2.0 * rho[1:stop].sum(), 1.0))


def cut(blocks: Blocks) -> Blocks:
    """Return the blocks, each dive cut into equal parts if there are fewer than LEAST_BLOCKS."""
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
      blocks: (residuals,) index of each residual's dive; PRIOR for the priors.
    """
    blocks = cut(blocks)
    numbers = np.unique(blocks[blocks != PRIOR])
    size = jacobian.shape[1]
    curve, slope = np.zeros((len(numbers), size, size)), np.zeros((len(numbers), size))
    for k, number in enumerate(numbers):
        rows = blocks == number
        curve[k] = jacobian[rows].T @ jacobian[rows]
        slope[k] = jacobian[rows].T @ residual[rows]
    known, kept = jacobian[blocks == PRIOR], residual[blocks == PRIOR]
    rng = np.random.default_rng(SEED)
    offsets = np.empty((DRAWS, size))
    for draw in range(DRAWS):
        count = np.bincount(rng.integers(0, len(numbers), len(numbers)), minlength=len(numbers))
        drawn = rng.normal(size=len(kept))
        matrix = np.tensordot(count, curve, axes=1) + known.T @ known
        right = count @ slope + known.T @ (kept + drawn)
        offsets[draw] = -np.linalg.solve(matrix, right)
    covariance = np.atleast_2d(np.cov(offsets, rowvar=False))
    # samples of n blocks have (n - 1) / n of the variance
    return np.asarray(covariance * len(numbers) / max(len(numbers) - 1, 1), np.float64)


class Gain(NamedTuple):
    """Decrease of the squared error of left-out dives by one more parameter."""

    share: float
    """[1] Decrease / squared error without the parameter; negative: the error grows"""
    deviations: float
    """[1] Decrease divided by its standard deviation, from its scatter between dives"""

    @property
    def supported(self) -> bool:
        """True if the log supports the parameter."""
        return self.share > LEAST_GAIN and self.deviations > LEAST_DEVIATIONS


def gain_of(comparison: Comparison, x: Array, candidate: UnknownParameter) -> Gain:
    """Gain by one more parameter in the prediction of left-out dives.

    Args:
      comparison: fitted; its weights judge the fits with and without the candidate.
      x: offsets from nominal of its fit.
      candidate: the further parameter, not among those of the comparison.
    """
    wider = comparison.with_parameters(candidate)
    at = np.append(x, 0.0)
    jacobian, residual = wider.jacobian(at), wider.residual(at)
    without = left_out(jacobian[:-1, :-1], residual[:-1], wider.blocks[:-1])
    taken = without - left_out(jacobian, residual, wider.blocks)
    scatter = float(np.std(taken, ddof=1) * np.sqrt(len(taken)))
    total = float(taken.sum())
    deviations = total / scatter if scatter > 0.0 else 0.0
    return Gain(share=total / float(without.sum()), deviations=deviations)


def left_out(jacobian: Array, residual: Array, blocks: Blocks) -> Array:
    """Sums of squared residuals of each dive, predicted by a fit to the other dives, (blocks,).

    Args:
      jacobian: (residuals, parameters), weighted, near the fit to all.
      residual: (residuals,), weighted.
      blocks: (residuals,) index of each residual's dive; PRIOR for the priors. Few dives are cut
        into parts (`cut`).
    """
    blocks = cut(blocks)
    matrix, slope = jacobian.T @ jacobian, jacobian.T @ residual
    errors = []
    for number in np.unique(blocks[blocks != PRIOR]):
        own, seen = jacobian[blocks == number], residual[blocks == number]
        step = -np.linalg.solve(matrix - own.T @ own, slope - own.T @ seen)
        errors.append(float(np.sum((seen + own @ step) ** 2)))
    return np.array(errors)
