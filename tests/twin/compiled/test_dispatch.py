"""Dispatch: one compiled function of a table of kinds, also inside a C callback."""

from __future__ import annotations

import math

import pytest
from numba import cfunc as plain_cfunc

from twin.compiled import cfunc, changed, dispatch, generate, jit

SCALE = 2.0


@jit
def first(x, y):
    return x + y, SCALE * x


@jit(inline="always")
def second(x, y):
    return x * y, 0.0


@jit
def third(x, y):
    return -x, -y


growing = {1: first, 4: second}
table = dispatch("table", ("x", "y"), growing, (math.nan, math.nan), module=__name__)
live = dispatch("live", ("x", "y"), lambda: growing, (0.0, 0.0), module=__name__)


@jit
def total(code, x, y):
    a, b = live(code, x, y)
    return a + b


def test_each_code_runs_its_kernel_and_an_unknown_one_gives_the_fallback():
    assert table(1, 3.0, 5.0) == (8.0, 6.0)
    assert table(4.0, 3.0, 5.0) == (15.0, 0.0)
    assert all(map(math.isnan, table(2, 3.0, 5.0)))
    assert all(map(math.isnan, table(math.nan, 3.0, 5.0)))


def test_it_runs_in_a_c_callback_of_either_decorator():
    for decorate in (cfunc("float64(int64, float64)"), plain_cfunc("float64(int64, float64)")):

        @decorate
        def callback(code, x):
            return table(code, x, 5.0)[0]

        assert callback.ctypes(1, 3.0) == 8.0
        assert callback.ctypes(4, 3.0) == 15.0
        assert math.isnan(callback.ctypes(9, 3.0))


def test_a_growing_table_reaches_what_was_compiled_before(monkeypatch):
    assert total(7, 3.0, 5.0) == 0.0
    monkeypatch.setitem(growing, 7, third)
    changed()
    assert total(7, 3.0, 5.0) == -8.0
    monkeypatch.delitem(growing, 7)
    changed()
    assert total(7, 3.0, 5.0) == 0.0


def test_a_kernel_that_is_not_compiled_is_refused():
    with pytest.raises(TypeError, match=r"_kernel_3 is .*; decorate it with twin.compiled.jit"):
        dispatch("bad", ("x",), {3: lambda x: (x,)}, (0.0,), module=__name__)


def test_two_generated_functions_of_one_name_are_refused():
    with pytest.raises(ValueError, match="has a generated function 'table' already"):
        generate("table", ("x",), lambda: ("return x", {}), module=__name__)


def test_a_generated_function_uses_the_names_it_is_given():
    twice = generate(
        "twice", ("x",), lambda: ("a, b = kernel(x, x)\nreturn a + c", {"kernel": first, "c": 0.5}),
        module=__name__,
    )  # fmt: skip
    assert twice(1.0) == 2.5
