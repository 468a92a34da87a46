"""Normalisation: shift and scale of a network's inputs and target."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Normalisation:
    """Shift and scale of inputs and target, fitted on training missions only."""

    features: tuple[str, ...]
    mean: tuple[float, ...]
    scale: tuple[float, ...]
    target: str
    target_mean: float
    """[m/s]"""
    target_scale: float
    """[m/s]"""

    def inputs(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Normalised features of the same shape (..., features)."""
        mean = np.array(self.mean, np.float32)
        scale = np.array(self.scale, np.float32)
        return (values - mean) / scale

    def wanted(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Normalised target of the same shape; zero where it is not known."""
        shifted = values - np.float32(self.target_mean)
        return np.nan_to_num(shifted / np.float32(self.target_scale), nan=0.0)


class Moments:
    """Means and squared deviations of columns, gathered mission by mission.

    Missions are joined by Chan, Golub and LeVeque, "Updating formulae and a pairwise algorithm for
    computing sample variances" (1979), eq. 2.1: as exact as two passes over all samples together.
    The result follows from the missions and their order alone.
    """

    def __init__(self, columns: int) -> None:
        self._count = 0
        self._mean = np.zeros(columns)
        self._squares = np.zeros(columns)

    def add(self, values: NDArray[np.float32]) -> None:
        """One mission, (samples, columns)."""
        count = len(values)
        if not count:
            return
        exact = values.astype(np.float64)
        mean = exact.mean(0)
        squares = np.square(exact - mean).sum(0)
        total, away = self._count + count, mean - self._mean
        self._squares += squares + np.square(away) * (self._count * count / total)
        self._mean += away * (count / total)
        self._count = total

    def statistics(self, about_zero: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Mean and standard deviation of each column; of those marked, zero and about zero."""
        squares = self._squares / self._count
        mean = np.where(about_zero, 0.0, self._mean)
        deviation = np.sqrt(np.where(about_zero, squares + np.square(self._mean), squares))
        return mean, deviation


class NormalisationFit:
    """A normalisation from training missions, each seen once.

    A feature that never changes keeps the scale 1: it says nothing, and a division by its rounding
    noise would make it loud.
    """

    def __init__(self, features: Sequence[str], target: str, centred: Iterable[str] = ()) -> None:
        """`centred`: features and target whose mean is taken as zero, because the training shows
        every mission with its mirror image, where they have the other sign."""
        self._features, self._target = tuple(features), target
        self._centred = np.isin([*features, target], list(centred))
        self._inputs, self._wanted = Moments(len(self._features)), Moments(1)

    def add(self, matrix: NDArray[np.float32], wanted: NDArray[np.float32]) -> None:
        """One mission: features (time, features), and target (time,), NaN where not known."""
        self._inputs.add(matrix)
        self._wanted.add(wanted[np.isfinite(wanted)][:, None])

    def result(self) -> Normalisation:
        """Shift and scale of all that was added."""
        mean, deviation = self._inputs.statistics(self._centred[:-1])
        (target_mean,), (target_scale,) = self._wanted.statistics(self._centred[-1:])
        constant = deviation <= 1e-6 * np.maximum(np.abs(mean), 1e-6)
        return Normalisation(
            features=self._features,
            mean=tuple(map(float, mean)),
            scale=tuple(map(float, np.where(constant, 1.0, deviation))),
            target=self._target,
            target_mean=float(target_mean),
            target_scale=float(target_scale) or 1.0,
        )
