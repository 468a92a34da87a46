"""Elementary functions against NumPy's, and functions compiled once more with them."""

import math
from math import tan

import numpy as np
import pytest
from trees import own_module

from twin.compiled import elementary, generate, jit
from twin.compiled.portable import calls_math, portable


@jit
def inner(x):
    return math.cos(x) + tan(x)


@jit
def outer(x, shift=1.0):
    return inner(x) if x < 1.0 and not math.isnan(x) else math.floor(x) + shift


@jit
def plain(x):
    return math.sqrt(x) + math.pi


table = generate(
    "of_kinds", ("x",), lambda: ("return kernel(x)", {"kernel": inner}), module=__name__
)


def test_the_same_source_with_elementary_functions():
    x = np.random.default_rng(1).uniform(-1.0, 1.0, 500).tolist()
    mine = [elementary.cos(v) + elementary.tan(v) for v in x]
    assert [portable(outer)(v) for v in x] == mine
    assert [portable(table)(v) for v in x] == mine
    assert [outer(v) for v in x] == [math.cos(v) + math.tan(v) for v in x] != mine
    assert portable(outer)(2.5) == outer(2.5) == 3.0  # a default, and what stays of math
    assert calls_math(outer)
    assert calls_math(table)
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
