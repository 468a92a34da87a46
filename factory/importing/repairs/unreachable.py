"""Stretches of samples that no vehicle could reach from the rest of its log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BESIDE = 2
"""Samples on either side of a cut that can go alone."""
_BACK = 200
"""Pieces that are looked back over; bad stretches come in fewer pieces than that."""


def unreachable(time: Array, values: Array, *, rate: float, jump: float) -> NDArray[np.bool_]:
    """True for samples outside the longest chain in which nothing changes faster than it can.

    The series is cut wherever neighbours differ by more than `jump` + `rate` [unit/s] times the
    time between them, and the samples beside a cut are pieces of their own: one wrong sample at an
    end shall not take days with it. Of the pieces, those are kept that follow each other at
    possible rates and hold the most samples together; a sentinel that lasts for minutes is as far
    from them as one that lasts for a sample.

    Args:
      time: [s] increasing strictly, shape (samples,).
      values: finite, shape (samples,).
    """
    count = len(values)
    if count < 2:
        return np.zeros(count, bool)
    cuts = np.flatnonzero(np.abs(np.diff(values)) > jump + rate * np.diff(time)) + 1
    if not cuts.size:
        return np.zeros(count, bool)
    beside = np.arange(-_BESIDE, _BESIDE + 1)
    cuts = np.unique(np.clip((cuts[:, None] + beside).ravel(), 1, count - 1))
    first = np.concatenate([[0], cuts])
    last = np.concatenate([cuts, [count]]) - 1
    total = (last - first + 1).astype(np.float64)
    before = np.full(len(first), -1)
    for i in range(1, len(first)):
        earlier = np.arange(max(0, i - _BACK), i)
        ends = last[earlier]
        reach = jump + rate * (time[first[i]] - time[ends])
        fits = np.abs(values[first[i]] - values[ends]) <= reach
        if fits.any():
            best = earlier[fits][np.argmax(total[earlier[fits]])]
            before[i] = best
            total[i] += total[best]
    bad = np.ones(count, bool)
    piece = int(np.argmax(total))
    while piece >= 0:
        bad[first[piece] : last[piece] + 1] = False
        piece = int(before[piece])
    return bad
