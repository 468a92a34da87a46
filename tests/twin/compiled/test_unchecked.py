"""What numba does not look after."""

from __future__ import annotations

import sys

import numpy as np

from twin.compiled import jit
from twin.compiled.unchecked import borrowed


@jit
def _last(array):
    return array[-1]


@jit
def _sum_of_ends(array, count):
    array = borrowed(array)
    total = 0.0
    for k in range(count):
        total += _last(array[: k + 1])
    array[0] = total
    return total


def test_a_borrowed_array_is_the_same_memory_and_stays_its_owners():
    array = np.arange(8.0)
    before = sys.getrefcount(array)
    assert _sum_of_ends(array, 8) == 28.0
    assert array[0] == 28.0
    assert sys.getrefcount(array) == before
