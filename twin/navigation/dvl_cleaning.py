"""DVL cleaning: outliers out, then smoothing, of velocities that come with gaps.

As for the paper's Tethys data: outliers are removed, what is left is smoothed with a Gaussian. Both
look ahead, so they are for the labels of a training and for tracks after a mission, never for what
a network sees. The causal kind looks back only, as a vehicle under way can.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

Smoothing = Literal["gaussian", "causal", "none"]
SMOOTHINGS: tuple[Smoothing, ...] = get_args(Smoothing)

BOTTOM, WATER = 1, 2
"""Locks in `measured_dvl_mode`; 0 is none."""
HAMPEL_SAMPLES = 11
"""Window of the outlier test: 5.5 s at 2 Hz."""
HAMPEL_SIGMAS = 3.0
MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution."""
LEAST_SPREAD = 2e-3
"""[m/s] spread below which nothing counts as an outlier: the noise of averaged pings."""
SMOOTHING_S = 1.0
"""[s] standard deviation of the Gaussian: short against the seconds in which a turn begins."""
REACH = 4.0
"""Standard deviations after which the Gaussian is cut off, scipy's own."""


def outliers(values: Array, valid: Mask, *, causal: bool = False) -> Mask:
    """Valid samples farther from the running median than three scaled median deviations (Hampel).

    A window is of valid samples: those beside a gap are judged together with those beyond it.

    Args:
      values: [m/s], (time,).
      valid: where there is a measurement, (time,).
      causal: windows end at the sample instead of being centred on it.
    """
    found = np.zeros(len(values), bool)
    if not valid.any():
        return found
    known = values[valid]
    half = HAMPEL_SAMPLES // 2
    around = (HAMPEL_SAMPLES - 1, 0) if causal else (half, half)
    windows = sliding_window_view(np.pad(known, around, mode="edge"), HAMPEL_SAMPLES)
    middle = np.median(windows, axis=1)
    # The deviations are from this window's median: a turn, in which all of it moves, is wide.
    spread = MAD_TO_SIGMA * np.median(np.abs(windows - middle[:, None]), axis=1)
    found[valid] = np.abs(known - middle) > HAMPEL_SIGMAS * np.maximum(spread, LEAST_SPREAD)
    return found


def smoothed(values: Array, valid: Mask, period: float, kind: Smoothing = "gaussian") -> Array:
    """Valid samples averaged with their valid neighbours, NaN elsewhere; (time,).

    The weights are normalised by those that fall on valid samples, so that a gap neither drags its
    neighbours to zero nor is filled.

    Args:
      values: [m/s], (time,).
      valid: where there is a measurement, (time,).
      period: [s] between samples.
      kind: `gaussian` of `SMOOTHING_S`; `causal`, the half of it that lies in the past, which lags
        by 0.8 of `SMOOTHING_S`; or `none`.
    """
    if kind == "none":
        return np.where(valid, values, np.nan)
    counted = valid.astype(float)
    total = _weighted(np.where(valid, values, 0.0), period, kind)
    weight = _weighted(counted, period, kind)
    return np.where(valid, total / np.where(valid, weight, 1.0), np.nan)


def _weighted(values: Array, period: float, kind: Smoothing) -> Array:
    """Sum of the samples under the kernel, nothing beyond the ends."""
    sigma = SMOOTHING_S / period
    if kind == "gaussian":
        return np.asarray(gaussian_filter1d(values, sigma, mode="constant", truncate=REACH))
    past = np.exp(-0.5 * np.square(np.arange(round(REACH * sigma) + 1) / sigma))
    return np.convolve(values, past / past.sum())[: len(values)]
