"""End of a Slocum's binary file: whether its last cycle is whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_CYCLE = b"d"
"""Tag that begins a cycle; then two bits a sensor (2: a new value), and the new values."""
_CLOSED = b"X"
"""Last byte of a file that older software closed; newer software ends with the last cycle."""
_PREAMBLE = 16
"""[bytes] before the first cycle: the tags s and a, and three numbers that show the byte order."""
_NEW = 2


def ends_whole(data: bytes, start: int, sizes: Sequence[int], state_bytes: int) -> bool:
    """Whether the file ends where a cycle ends.

    Args:
      data: the whole file.
      start: [bytes] where its binary part begins.
      sizes: [bytes] of each sensor's value, in the order of the cache file.
      state_bytes: of each cycle.
    """
    if data.endswith(_CLOSED):
        return True
    table = np.zeros((state_bytes, 256), np.int64)
    every = np.zeros(4 * state_bytes, np.int64)
    every[: len(sizes)] = sizes[: 4 * state_bytes]
    states = np.arange(256)
    for k in range(4):
        new = (states >> (6 - 2 * k)) & 3 == _NEW
        table += np.outer(every[k::4], new)
    row = np.arange(state_bytes)
    at = start + _PREAMBLE
    while data[at : at + 1] == _CYCLE:
        if at + 1 + state_bytes > len(data):
            return False
        state = np.frombuffer(data, np.uint8, state_bytes, at + 1)
        at += 1 + state_bytes + int(table[row, state].sum())
    return at == len(data)
