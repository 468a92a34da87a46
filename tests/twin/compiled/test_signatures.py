"""Signatures that numba found once: the same code and the same errors, looked for no more."""

from __future__ import annotations

import math

import numba
import pytest
from numba.extending import overload

from twin.compiled import signatures


def test_what_was_found_is_not_looked_for_again(monkeypatch):
    looked = []
    find = signatures._find

    def finding(kind, context, args, kws):
        looked.append((kind.typing_key, args))
        return find(kind, context, args, kws)

    monkeypatch.setattr(signatures, "_find", finding)
    monkeypatch.setattr(signatures, "_found", {})

    def sums():
        return numba.njit(lambda a, b: (a + b) * (a + b) + (b + a))

    assert sums()(1.5, 2.0) == 15.75
    assert looked
    assert len(looked) == len(set(looked))  # each once, typed and written
    count = len(looked)
    assert sums()(1.5, 2.0) == 15.75
    assert len(looked) == count
    assert sums()(1, 2) == 12  # other types are
    assert len(looked) > count


def test_each_caller_gets_what_was_made_for_its_options():
    def ratio(a, b):
        raise NotImplementedError

    @overload(ratio)
    def _ratio(a, b):
        return lambda a, b: a / b

    def callers(error_model):
        one = numba.njit(lambda a, b: ratio(a, b), error_model=error_model)
        other = numba.njit(lambda a, b: ratio(a, b) + 0.0, error_model=error_model)
        return one, other

    for quiet, loud in zip(callers("numpy"), callers("python"), strict=True):
        assert quiet(1.0, 0.0) == math.inf
        with pytest.raises(ZeroDivisionError):
            loud(1.0, 0.0)


def test_what_failed_is_looked_for_again():
    def late(x):
        raise NotImplementedError

    with pytest.raises(numba.TypingError):
        numba.njit(lambda x: late(x))(1.0)

    @overload(late)
    def _of_floats(x):
        return (lambda x: 2.0 * x) if isinstance(x, numba.types.Float) else None

    assert numba.njit(lambda x: late(x))(1.5) == 3.0
    with pytest.raises(numba.TypingError, match="late"):
        numba.njit(lambda x: late(x))(1)

    @overload(late)
    def _of_integers(x):
        return (lambda x: 3 * x) if isinstance(x, numba.types.Integer) else None

    assert numba.njit(lambda x: late(x))(2) == 6
    assert numba.njit(lambda x: late(x))(1.5) == 3.0
