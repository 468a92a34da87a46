"""Compiled functions: for Python and compiled code, with borrowed arrays, generated, portable."""

import logging
import math
import sys
from math import tan

import numba
import numpy as np
import pytest
from numba import cfunc as plain_cfunc
from numba.core.errors import TypingError
from trees import own_module

from twin.compiled import (
    borrowing,
    cfunc,
    changed,
    dispatch,
    elementary,
    folder,
    generate,
    inline,
    jit,
)
from twin.compiled.portable import calls_math, portable, widest_vectors

SCALE = 2.0


@jit
def half(x):
    return 0.5 * x


@inline
def twice(x):
    return x + x


@jit
def thrice(x):
    return twice(x) + 2.0 * half(x)


@jit
def third(x):
    return x / 3.0


@inline
def negative(x):
    return -x


@jit
def falling(x):
    return negative(third(x))


def test_what_only_compiled_code_calls_has_no_way_in_for_python():
    assert falling(1.5) == -0.5
    for function in (third, negative):
        assert function._called is None
        assert function._numba_type_ is not None  # a second process finds `falling` compiled
        assert function._inner.targetoptions["no_cpython_wrapper"]
    assert falling._inner is None


def test_python_can_call_it_all_the_same():
    assert thrice(1.0) == 3.0
    assert (half(3.0), twice(3.0)) == (1.5, 6.0)
    assert half._called is half.dispatcher is not half._inner
    assert thrice(2.0) == 6.0


def test_both_are_kept_and_not_mixed_up(tmp_path):
    """The one without a way in would end the process that calls it."""
    run = own_module(
        tmp_path,
        "from twin.compiled import jit\n\n@jit\ndef low(x):\n    return x + x\n\n"
        "@jit\ndef high(x):\n    return 3.0 * low(x)\n",
    )
    hits = "print(value, [sum(f.stats.cache_hits.values()) for f in {0}])"

    def kept(calls: str, asked: str) -> str:
        return run(f"high, low; value = {calls}; {hits.format(asked)}")

    assert kept("high(1.0)", "[high.dispatcher]") == "6.0 [0]"
    assert kept("low(1.0)", "[low.dispatcher]") == "2.0 [0]"
    assert kept("high(1.0) + low(1.0)", "[high.dispatcher, low.dispatcher]") == "8.0 [1, 1]"


def test_the_first_compiling_of_all_says_so_once(monkeypatch, caplog, tmp_path):
    monkeypatch.setattr(folder, "candidates", lambda: iter([tmp_path / "kept"]))
    monkeypatch.setattr(folder._seldom, "first", False)
    folder.cache_root.__wrapped__()
    assert folder._seldom.first
    with caplog.at_level(logging.WARNING):
        assert jit(lambda x: x - 1.0)(3.0) == 2.0
        assert jit(lambda x: x - 2.0)(3.0) == 1.0
    assert [record.getMessage() for record in caplog.records] == [folder.FIRST]
    (tmp_path / "kept" / "version").mkdir()
    folder.cache_root.__wrapped__()
    assert not folder._seldom.first


# --- borrowed arrays and vectors --------------------------------------------------------------


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


def text(function, *arguments):
    """LLVM's text of a function that is compiled anew: what is kept between processes has none."""
    options = {k: v for k, v in function.targetoptions.items() if k != "nopython"}
    fresh = numba.njit(**options)(function.py_func)
    fresh(*arguments)
    return "\n".join(fresh.inspect_llvm().values())


def test_a_borrowed_array_is_the_same_memory_and_its_references_are_not_counted():
    array = np.arange(8.0)
    before = sys.getrefcount(array)
    assert _sum_of_ends(array, 8) == 28.0
    assert array[0] == 28.0
    assert sys.getrefcount(array) == before
    inside = text(_sum_of_ends, np.arange(8.0), 8).partition("\n}")[0]
    assert "NRT_incref" not in inside
    assert "NRT_decref" not in inside
    with pytest.raises(TypingError):  # a function that makes an array does not borrow
        _of_its_own(3)


def test_the_widest_vectors_are_asked_for_where_a_function_says_so_and_nowhere_else():
    a, b, c = np.arange(64.0), np.zeros(64), np.zeros(64)
    asked = '"prefer-vector-width"="512"'
    assert asked in text(_widely, a, b)
    assert asked not in text(_as_usual, a, c)
    assert (b == c).all()


# --- generated functions ----------------------------------------------------------------------


@jit
def first(x, y):
    return x + y, SCALE * x


@jit(inline="always")
def second(x, y):
    return x * y, 0.0


@jit
def opposite(x, y):
    return -x, -y


growing = {1: first, 4: second}
table = dispatch("table", ("x", "y"), lambda: growing, (math.nan, 0.0), module=__name__)


@jit
def total(code, x, y):
    a, b = table(code, x, y)
    return a + b


def test_each_code_runs_its_kernel_and_an_unknown_one_gives_the_fallback():
    assert table(1, 3.0, 5.0) == (8.0, 6.0)
    assert table(4.0, 3.0, 5.0) == (15.0, 0.0)
    for unknown in (2, math.nan):
        found = table(unknown, 3.0, 5.0)
        assert math.isnan(found[0])
        assert found[1] == 0.0


@pytest.mark.parametrize("decorator", [cfunc, plain_cfunc])
def test_it_runs_in_a_c_callback_of_either_decorator(decorator):
    @decorator("float64(int64, float64)")
    def callback(code, x):
        return table(code, x, 5.0)[0]

    assert callback.ctypes(1, 3.0) == 8.0
    assert callback.ctypes(4, 3.0) == 15.0
    assert math.isnan(callback.ctypes(9, 3.0))


def test_a_growing_table_reaches_what_was_compiled_before(monkeypatch):
    assert math.isnan(total(7, 3.0, 5.0))
    monkeypatch.setitem(growing, 7, opposite)
    changed()
    assert total(7, 3.0, 5.0) == -8.0
    monkeypatch.delitem(growing, 7)
    changed()
    assert math.isnan(total(7, 3.0, 5.0))


def test_what_cannot_be_generated_is_refused():
    bad = dispatch("bad", ("x",), lambda: {3: lambda x: (x,)}, (0.0,), module=__name__)
    with pytest.raises(TypeError, match=r"_kernel_3 is .*; decorate it with twin.compiled.jit"):
        bad(3, 1.0)
    with pytest.raises(ValueError, match="has a generated function 'table' already"):
        generate("table", ("x",), lambda: ("return x", {}), module=__name__)


def test_a_generated_function_uses_the_names_it_is_given():
    names = {"kernel": first, "c": 0.5}
    doubled = generate(
        "doubled", ("x",), lambda: ("a, b = kernel(x, x)\nreturn a + c", names), module=__name__
    )
    assert doubled(1.0) == 2.5


# --- elementary functions, and functions compiled once more with them -----------------------------


@jit
def inner(x):
    return math.cos(x) + tan(x)


@jit
def outer(x, shift=1.0):
    return inner(x) if x < 1.0 and not math.isnan(x) else math.floor(x) + shift


@jit
def plain(x):
    return math.sqrt(x) + math.pi


of_kinds = generate(
    "of_kinds", ("x",), lambda: ("return kernel(x)", {"kernel": inner}), module=__name__
)


def test_the_same_source_with_elementary_functions():
    x = np.random.default_rng(1).uniform(-1.0, 1.0, 500).tolist()
    mine = [elementary.cos(v) + elementary.tan(v) for v in x]
    assert [portable(outer)(v) for v in x] == mine
    assert [portable(of_kinds)(v) for v in x] == mine
    assert [outer(v) for v in x] == [math.cos(v) + math.tan(v) for v in x] != mine
    assert portable(outer)(2.5) == outer(2.5) == 3.0  # a default, and what stays of math
    assert calls_math(outer)
    assert calls_math(of_kinds)
    assert not calls_math(plain)
    assert portable(outer) is portable(outer)


def test_another_processor_has_compiled_code_of_its_own(tmp_path):
    """numba's switches say which; the cache must not hand it code with other instructions."""
    run = own_module(
        tmp_path, "from twin.compiled import jit\n\n@jit\ndef twice(x):\n    return x + x\n"
    )

    def hits(**switches: str) -> int:
        asked = "print(sum(twice.dispatcher.stats.cache_hits.values()))"
        return int(run(f"twice; twice(1.0); {asked}", **switches))

    other = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    assert [hits(), hits(), hits(**other), hits(**other), hits()] == [0, 1, 0, 1, 1]


@jit
def every(x, y, out):
    """Every function at each pair of numbers."""
    for k in range(x.size):
        out[0, k], out[1, k] = elementary.sincos(x[k])
        out[2, k] = elementary.atan2(y[k], x[k])
        out[3, k], out[4, k] = elementary.asin(y[k]), elementary.acos(y[k])
        out[5, k], out[6, k] = elementary.exp(5.0 * x[k]), elementary.log(abs(x[k]) + 1e-3)
        out[7, k], out[8, k] = elementary.tan(x[k]), elementary.hypot(x[k], y[k])


def test_they_are_right_to_a_few_units_of_the_last_bit():
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.normal(0.0, 20.0, 20_000), np.linspace(-7.0, 7.0, 20_001)])
    y = np.concatenate([rng.uniform(-1.0, 1.0, 20_000), np.linspace(-1.0, 1.0, 20_001)])
    out = np.empty((9, x.size))
    every(x, y, out)
    wanted = (np.sin(x), np.cos(x), np.arctan2(y, x), np.arcsin(y), np.arccos(y), np.exp(5.0 * x),
              np.log(abs(x) + 1e-3), np.tan(x), np.hypot(x, y))  # fmt: skip
    for found, value in zip(out, wanted, strict=True):
        np.testing.assert_allclose(found, value, rtol=5e-16, atol=5e-16)


@pytest.mark.parametrize(("y", "x"), [(0.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0),
                                      (1.0, 1.0), (-1.0, -1.0)])  # fmt: skip
def test_angles_of_the_axes_are_exact(y, x):
    assert elementary.atan2(y, x) == math.atan2(y, x)


def test_what_is_beyond_their_range_is_held_at_its_end():
    assert elementary.asin(1.5) == elementary.asin(1.0) == 0.5 * math.pi
    assert elementary.acos(-1.5) == elementary.acos(-1.0) == math.pi
    assert elementary.exp(0.0) == 1.0
    assert 0.0 < elementary.exp(-1e9) == elementary.exp(elementary.LOWEST) < 1e-300
    assert 1e300 < elementary.exp(1e9) == elementary.exp(elementary.HIGHEST) < math.inf
    assert elementary.log(1.0) == 0.0
    assert math.isnan(elementary.log(0.0))
    assert math.isnan(elementary.log(-1.0))


def test_a_large_angle_keeps_its_turns():
    for turns in (1e3, 1e6):
        sine, cosine = elementary.sincos(0.3 + 2.0 * math.pi * turns)
        exact = math.fmod(0.3 + 2.0 * math.pi * turns, 2.0 * math.pi)
        assert sine == pytest.approx(math.sin(exact), abs=2e-9)
        assert sine**2 + cosine**2 == pytest.approx(1.0, abs=1e-15)
