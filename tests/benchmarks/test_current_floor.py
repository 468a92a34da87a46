"""The floor of a navigator that knows the law of the sea's currents."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.current_floor import Dives, misses_of, way_errors

HOUR = 3600.0


def steady(rng: np.random.Generator, seas: int, noise: float, scale: float = 0.0) -> Dives:
    """Three dives of an hour in one steady current, north alone, of 0.1 m/s either way."""
    way = np.array([900.0 + 0j, 800.0j, -700.0 + 0j])
    current = HOUR * rng.normal(0.0, 0.1, 1) * np.ones(3) + 0j
    error = scale * rng.standard_normal() * way
    error = error + noise * (rng.standard_normal(3) + 1j * rng.standard_normal(3))
    drawn = HOUR * rng.normal(0.0, 0.1, (seas, 1)) * np.ones(3) + 0j
    return Dives(over_ground=way + current + error, way=way, current=current, seas=drawn)


def test_what_one_dive_told_leaves_the_noise_of_the_ways() -> None:
    """Normal currents and errors: the miss is Kalman's, and the first one the current's."""
    rng, noise = np.random.default_rng(0), 20.0
    size = np.array([1e-6, 1e-6, noise])
    found = np.array([misses_of(steady(rng, 300, noise), size, 300) for _ in range(400)])
    mean_of_two = np.sqrt(np.pi / 2.0)  # mean length of two normal numbers of deviation 1
    before = 0.1 * HOUR / np.sqrt(2.0)  # of each axis, since every angle is as likely
    for k in (1, 2):
        known = 1.0 / np.sqrt(before**-2 + k * noise**-2)
        expected = mean_of_two * np.hypot(known, noise)
        assert found[:, k].mean() == pytest.approx(expected, rel=0.1)
    assert found[:, 0].mean() == pytest.approx(0.1 * HOUR * np.sqrt(2.0 / np.pi), rel=0.15)


def test_errors_of_the_ways_are_found_beside_the_true_current() -> None:
    rng = np.random.default_rng(1)
    missions = [steady(rng, 0, 15.0, scale=0.04) for _ in range(300)]
    scale, turn, noise = way_errors(missions)
    assert scale == pytest.approx(0.04, rel=0.15)
    assert noise == pytest.approx(15.0, rel=0.1)
    assert turn < 0.01
