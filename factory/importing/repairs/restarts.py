"""What a restarted pressure sensor writes before its first measurement: 0, or its last value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factory.importing.repairs.unreachable import unreachable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FASTEST = 1.0
"""[m/s] No glider changes its depth faster over a restart: what needs more is no measurement."""
_FEW = 3
"""So many zeros in a row can be a restart's."""
_HOLE = 20.0
"""[s] A sensor that is silent for longer may have been restarted."""


def lone_zeros(time: Array, values: Array, *, rate: float, jump: float) -> Mask:
    """Exact zeros that the nearest other sample before or after cannot have reached.

    Args:
      time: [s] increasing strictly, shape (samples,).
      values: finite, [dbar] or [m], shape (samples,).
      rate, jump: by which other samples are judged (`unreachable`).
    """
    other = np.flatnonzero(values != 0.0)
    zero = values == 0.0
    if not zero.any() or not other.size:
        return np.zeros(len(values), bool)
    # neither is a sentinel a place from which to judge
    other = other[~unreachable(time[other], values[other], rate=rate, jump=jump)]
    at = np.searchsorted(other, np.arange(len(values)))
    bad = np.zeros(len(values), bool)
    for near, there in ((at - 1, at > 0), (at, at < len(other))):
        beside = other[np.clip(near, 0, len(other) - 1)]
        reach = jump + FASTEST * np.abs(time - time[beside])
        bad |= zero & there & (np.abs(values[beside]) > reach)
    # many in a row are the surface, and it is the other sample that is wrong
    return bad & short_runs(zero, _FEW)


def stale(time: Array, values: Array, *, rate: float, jump: float) -> Mask:
    """Samples after a hole that repeat the one before it exactly, far from the one after them.

    Args as `lone_zeros`; `rate` is not used: a restart takes longer than noise does.
    """
    del rate
    bad = np.zeros(len(values), bool)
    if len(values) > 2:
        gap, step = np.diff(time), np.diff(values)
        again = (step[:-1] == 0.0) & (gap[:-1] > _HOLE)
        bad[1:-1] = again & (np.abs(step[1:]) > jump + FASTEST * gap[1:])
    return bad


def short_runs(mask: Mask, longest: int) -> Mask:
    """True where `mask` is, in runs of `longest` samples at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    short = np.zeros(len(mask), bool)
    for start, end in edges.reshape(-1, 2):
        if end - start <= longest:
            short[start:end] = True
    return short
