"""What numba does not look after."""

from __future__ import annotations

import sys

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from twin.compiled import borrowing, jit
from twin.compiled.unchecked import widest_vectors


@borrowing
def _last(array):
    return array[-1]


@borrowing
def _sum_of_ends(array, count):
    total = 0.0
    for k in range(count):
        total += _last(array[: k + 1])
    array[0] = total
    return total


@borrowing
def _of_its_own(count):
    return np.zeros(count).sum()


@borrowing
def _widely(a, b):
    widest_vectors()
    for k in range(64):
        b[k] = 2.0 * a[k]


@jit
def _as_usual(a, b):
    for k in range(64):
        b[k] = 2.0 * a[k]


def test_a_borrowed_array_is_the_same_memory_and_stays_its_owners():
    array = np.arange(8.0)
    before = sys.getrefcount(array)
    assert _sum_of_ends(array, 8) == 28.0
    assert array[0] == 28.0
    assert sys.getrefcount(array) == before


def text(function, *arguments):
    """Of a function that is compiled anew: what is kept between processes has none."""
    options = {k: v for k, v in function.targetoptions.items() if k != "nopython"}
    fresh = numba.njit(**options)(function.py_func)
    fresh(*arguments)
    return "\n".join(fresh.inspect_llvm().values())


def test_borrowing_counts_no_references():
    inside = text(_sum_of_ends, np.arange(8.0), 8).partition("\n}")[0]
    assert "NRT_incref" not in inside
    assert "NRT_decref" not in inside


def test_a_function_that_makes_an_array_does_not_borrow():
    with pytest.raises(TypingError):
        _of_its_own(3)


def test_the_widest_vectors_are_asked_for_where_a_function_says_so_and_nowhere_else():
    a, b, c = np.arange(64.0), np.zeros(64), np.zeros(64)
    asked = '"prefer-vector-width"="512"'
    assert asked in text(_widely, a, b)
    assert asked not in text(_as_usual, a, c)
    assert (b == c).all()
