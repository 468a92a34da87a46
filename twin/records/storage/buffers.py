"""Buffers: which missions of a store are in memory together, in an order that mixes the store."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.int64]
"""Numbers of missions among those that are wanted."""

BLOCKS = 16
"""Blocks of neighbouring missions, drawn at random, that make a buffer: neighbours are read in one
go, and many blocks mix the store well."""


def buffers(
    lengths: NDArray[np.int64], size: int, rng: np.random.Generator | None = None
) -> list[Places]:
    """Missions that are in memory together, buffer by buffer; each mission is in one of them.

    Args:
      lengths: samples of each mission.
      size: samples of a buffer, about; a longer mission is a buffer of its own.
      rng: draws which neighbours come together and the order of the buffers; None keeps the
        store's order.

    Returns:
      For each buffer its missions, in rising order.
    """
    total = int(lengths.sum())
    count = max(1, math.ceil(total / size))
    if count == 1:
        return [np.arange(len(lengths))]
    blocks = _even_parts(lengths, np.arange(len(lengths)), count * BLOCKS)
    if rng is not None:
        blocks = [blocks[k] for k in rng.permutation(len(blocks))]
    samples = np.array([lengths[block].sum() for block in blocks])
    return [
        np.sort(np.concatenate([blocks[k] for k in part]))
        for part in _even_parts(samples, np.arange(len(blocks)), count)
    ]


def _even_parts(lengths: NDArray[np.int64], items: Places, count: int) -> list[Places]:
    """Items in at most `count` runs of about the same total length."""
    middles = np.cumsum(lengths) - lengths / 2.0
    part = np.floor(middles * (count / lengths.sum())).astype(np.int64)
    return np.split(items, np.flatnonzero(np.diff(part)) + 1)
