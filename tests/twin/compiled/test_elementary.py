"""Elementary functions in plain arithmetic against NumPy's, and their limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.compiled import elementary, jit


@jit
def table(x, y, out):
    """Every function at each pair of numbers."""
    for k in range(x.size):
        out[0, k], out[1, k] = elementary.sincos(x[k])
        out[2, k] = elementary.atan2(y[k], x[k])
        out[3, k], out[4, k] = elementary.asin(y[k]), elementary.acos(y[k])
        out[5, k] = elementary.exp(-abs(x[k]))


def test_they_are_right_to_a_few_units_of_the_last_bit():
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.normal(0.0, 20.0, 20_000), np.linspace(-7.0, 7.0, 20_001)])
    y = np.concatenate([rng.uniform(-1.0, 1.0, 20_000), np.linspace(-1.0, 1.0, 20_001)])
    out = np.empty((6, x.size))
    table(x, y, out)
    wanted = (np.sin(x), np.cos(x), np.arctan2(y, x), np.arcsin(y), np.arccos(y), np.exp(-abs(x)))
    for found, value in zip(out[:5], wanted[:5], strict=True):
        np.testing.assert_allclose(found, value, rtol=5e-16, atol=5e-16)
    np.testing.assert_allclose(out[5], wanted[5], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize(("y", "x"), [(0.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0),
                                      (1.0, 1.0), (-1.0, -1.0)])  # fmt: skip
def test_angles_of_the_axes_are_exact(y, x):
    assert elementary.atan2(y, x) == math.atan2(y, x)


def test_what_is_beyond_their_range_is_held_at_its_end():
    assert elementary.asin(1.5) == elementary.asin(1.0) == 0.5 * math.pi
    assert elementary.acos(-1.5) == elementary.acos(-1.0) == math.pi
    assert elementary.exp(3.0) == elementary.exp(0.0) == 1.0
    assert 0.0 <= elementary.exp(-1e9) < 1e-16


def test_a_large_angle_keeps_its_turns():
    for turns in (1e3, 1e6):
        sine, cosine = elementary.sincos(0.3 + 2.0 * math.pi * turns)
        exact = math.fmod(0.3 + 2.0 * math.pi * turns, 2.0 * math.pi)
        assert sine == pytest.approx(math.sin(exact), abs=2e-9)
        assert sine**2 + cosine**2 == pytest.approx(1.0, abs=1e-15)
