"""Tether: on a kind of vehicle that is new to networks, surge is held to the flight filter's."""

from __future__ import annotations

import numpy as np
import pytest

from learn.networks.familiarity import LASTS_S, Tether

PERIOD = 0.5
TIME = np.arange(0.0, 1200.0, PERIOD)


def test_what_lasts_is_held_and_what_is_brief_is_not():
    filtered = 0.3 + 0.02 * np.sin(TIME / 40.0)
    brief = np.where((TIME > 300.0) & (TIME < 304.0), 0.1, 0.0)
    held = Tether(0.004).held(filtered + 0.15 + brief, filtered, PERIOD)
    late = TIME > 5.0 * LASTS_S
    off = held - filtered - brief
    assert np.abs(off[late] - 0.004).max() < 0.1 * 4.0 / LASTS_S + 1e-9
    near = filtered + 0.003
    np.testing.assert_array_equal(Tether(0.004).held(near, filtered, PERIOD), near)


def test_a_step_says_what_the_whole_mission_says():
    random = np.random.default_rng(0)
    filtered = np.cumsum(0.002 * random.standard_normal(TIME.size))
    surge = filtered + np.cumsum(0.002 * random.standard_normal(TIME.size))
    tether, lasting, found = Tether(0.005), 0.0, []
    for own, theirs in zip(surge, filtered, strict=True):
        lasting, off = tether.step(lasting, own - theirs, PERIOD)
        found.append(own - off)
    np.testing.assert_allclose(found, tether.held(surge, filtered, PERIOD), atol=1e-12)


def test_the_reach_is_what_half_of_the_validation_had():
    apart = [np.full(9000, 0.002), np.full(4000, -0.009)]
    assert Tether.of(apart, PERIOD).most == pytest.approx(0.002, rel=1e-3)


def test_a_begin_under_way_where_the_filter_is_at_rest_for_seconds_is_soon_forgotten():
    filtered = np.minimum(0.3, 0.06 * TIME)
    held = Tether(0.003).held(np.full(TIME.size, 0.3), filtered, PERIOD)
    assert np.abs(held - 0.3).max() < 0.02
