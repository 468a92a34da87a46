"""Normalisation: shift and scale of a network's inputs and target."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray


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


def fit_normalisation(
    matrices: Sequence[NDArray[np.float32]],
    targets: Sequence[NDArray[np.float32]],
    *,
    features: Sequence[str],
    target: str,
    centred: Iterable[str] = (),
) -> Normalisation:
    """Means and standard deviations over all samples of the training missions.

    A feature that never changes keeps the scale 1: it says nothing, and a division by its rounding
    noise would make it loud.

    Args:
      matrices: features (time, features) of each training mission.
      targets: the target (time,) of each.
      centred: features and target whose mean is taken as zero, because the training shows every
        mission with its mirror image, where they have the other sign.
    """
    values = np.concatenate(matrices).astype(np.float64)
    wanted = np.concatenate(targets).astype(np.float64)
    zero = np.isin(features, list(centred))
    mean = np.where(zero, 0.0, values.mean(0))
    deviation = np.sqrt(np.square(values - mean).mean(0))
    target_mean = 0.0 if target in centred else float(wanted.mean())
    constant = deviation <= 1e-6 * np.maximum(np.abs(mean), 1e-6)
    scale = np.where(constant, 1.0, deviation)
    return Normalisation(
        features=tuple(features),
        mean=tuple(map(float, mean)),
        scale=tuple(map(float, scale)),
        target=target,
        target_mean=target_mean,
        target_scale=float(np.sqrt(np.square(wanted - target_mean).mean())) or 1.0,
    )
