"""Flat layout of a compiled current: what `sampler.py` reads and every kind writes.

A program is one float64 vector, so that native callbacks can carry it:

    program[0]              number of records (0, or an empty vector, is still water)
    then per record         code of the kind, payload length, payload

Velocities of records add up. All payloads are SI and NED about the mission's origin; each kind's
file says what its payload holds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

RECORD_HEADER = 2
"""Numbers in front of each payload: code and payload length."""


def record(code: int, *payload: ArrayLike) -> Floats:
    """One record: its code, the length of its payload, and the payload flattened in order."""
    body = np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in payload])
    return np.concatenate([np.array([code, body.size], dtype=np.float64), body])


def program(records: Sequence[Floats]) -> Floats:
    """The whole program: the number of records followed by them."""
    return np.concatenate([np.array([len(records)], dtype=np.float64), *records])
