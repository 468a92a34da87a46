"""Tracks of missions that do not begin at the origin, and the heave of a steep vehicle."""

from __future__ import annotations

import numpy as np
import pytest
from navigation import PERIOD, add_fixes, steady_mission

from twin.navigation.dead_reckoning import (
    LEAST_COSINE,
    AttitudeSeries,
    heave_from_depth_rate,
    horizontal_error,
    true_ground_track,
    true_water_track,
    water_track,
)
from twin.navigation.dives import find_dives


def moved_away(signals, north, east):
    """The same mission with its launch elsewhere [m]."""
    elsewhere = dict(signals)
    elsewhere["true_north"] = signals["true_north"] + north
    elsewhere["true_east"] = signals["true_east"] + east
    return elsewhere


@pytest.mark.parametrize("current", [(0.0, 0.0), (0.12, -0.05)])
def test_tracks_count_from_their_first_sample_wherever_that_is(current):
    here = steady_mission(1000, current=current)
    there = moved_away(here, 1500.0, -820.0)
    for track in (true_ground_track(there), true_water_track(there, PERIOD)):
        assert track[0] == pytest.approx([0.0, 0.0])
    np.testing.assert_allclose(true_ground_track(there), true_ground_track(here), atol=1e-9)
    np.testing.assert_allclose(
        true_water_track(there, PERIOD), true_water_track(here, PERIOD), atol=1e-9
    )
    reckoned = water_track(
        there["true_surge"],
        there["true_sway"],
        there["measured_depth"],
        AttitudeSeries.of(there),
        PERIOD,
    )
    assert horizontal_error(reckoned, true_water_track(there, PERIOD)).max() < 1e-9


def test_the_solved_heave_is_exact_to_a_fifth_of_a_cosine_and_fades_beyond():
    """0.1 m/s of depth rate at rest otherwise: w = 0.1 / cos(roll) down to a cosine of 0.2."""
    assert LEAST_COSINE == 0.2
    for cosine in (1.0, 0.5, 0.21):
        heave = heave_from_depth_rate(0.1, 0.0, 0.0, np.arccos(cosine), 0.0)
        assert heave == pytest.approx(0.1 / cosine)
    for cosine in (0.19, 0.1, 0.05):  # 0.1 cos / 0.2^2
        heave = heave_from_depth_rate(0.1, 0.0, 0.0, np.arccos(cosine), 0.0)
        assert heave == pytest.approx(0.1 * cosine / 0.04)


@pytest.mark.parametrize("period", [0.5, 1.0, 5.0])
def test_five_minutes_without_a_fix_make_a_dive_at_any_sample_period(period):
    """Shorter gaps are missed fixes at the surface."""
    short, long = round(295.0 / period), round(300.0 / period)
    signals = steady_mission(short + long + 1)
    add_fixes(signals, [0, short, short + long])
    assert [(d.start, d.end) for d in find_dives(signals, period)] == [(short, short + long)]
    assert find_dives(signals, period)[0].seconds(period) == pytest.approx(300.0)
