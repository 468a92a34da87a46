"""The way to waypoints and the time of the next surfacing, as a pilot expects them."""

import itertools
import math

import numpy as np
import pytest

from glider_twin_ops.forecast import LoggedLeg
from glider_twin_ops.forecast.expected_dive import (
    SurfacingSchedule,
    WayPool,
    guided_way,
    middle,
    plain_velocity,
)
from glider_twin_ops.forecast.logged_leg import REPORTED, DiveTime, usual_duration
from twin.navigation.current import Leg

HOUR = 3600.0


def leg(way, *, start=0.0, onboard=None, **sent):
    flown = Leg(start=start, duration=HOUR, over_ground=way, through_water=way)
    said = {"method": REPORTED, "begin": (31.0, -80.0), "onboard": onboard}
    return LoggedLeg(mission=0, leg=flown, **said, **sent)


def flown(targets, speed, believed, duration, step=1.0):
    """The same second by second: its heading made anew at each."""
    place, way, left = np.zeros(2), np.zeros(2), list(targets)
    toward = None
    for _ in range(round(duration / step)):
        while left and math.dist(left[0], place) <= 20.0:
            left.pop(0)
        if left:
            toward = (np.array(left[0]) - place) / math.dist(left[0], place)
        along = believed @ toward
        across = believed - along * toward
        through = math.sqrt(speed**2 - across @ across) * toward - across
        way += step * through
        place += step * (through + believed)
    return way


@pytest.mark.parametrize("believed", [(0.0, 0.0), (0.1, -0.12)])
@pytest.mark.parametrize("duration", [0.4 * HOUR, 2.0 * HOUR, 4.0 * HOUR])
def test_the_guided_way_is_that_of_guidance(believed, duration):
    targets = [(300.0, 100.0), (600.0, 900.0), (-200.0, 1500.0)]
    found = guided_way(targets, 0.28, believed, duration)
    expected = flown(targets, 0.28, np.array(believed), duration)
    assert found == pytest.approx(expected, abs=5.0)


def test_beyond_the_last_waypoint_it_goes_straight_on():
    way = guided_way([(0.0, 500.0)], 0.25, (0.0, 0.0), 3.0 * HOUR)
    assert way == pytest.approx((0.0, 0.25 * 3.0 * HOUR))
    assert guided_way([], 0.25, (0.0, 0.0), HOUR) is None


def test_a_current_that_is_too_strong_is_leaned_into_as_far_as_it_goes():
    north, east = guided_way([(0.0, 5e3)], 0.25, (0.6, 0.0), HOUR)
    assert north == pytest.approx(-0.95 * 0.25 * HOUR, rel=1e-6)
    assert math.hypot(north, east) == pytest.approx(0.25 * HOUR)


def test_the_plain_way_is_the_mean_speed_toward_the_first_waypoint():
    before = [leg((720.0, 0.0)), leg((0.0, 1080.0)), leg((900.0, 0.0)), leg((0.0, 1260.0))]
    plain = plain_velocity(before, [(-3e3, 0.0), (5.0, 9.0)])
    assert plain == pytest.approx((-(0.3 + 0.25 + 0.35) / 3.0, 0.0))
    assert plain_velocity(before, ()) == pytest.approx((0.0, (0.3 + 0.25 + 0.35) / 3.0))


def test_the_way_to_waypoints_is_believed_where_dives_went_it():
    rng = np.random.default_rng(0)
    follows, drifts = WayPool(), WayPool()
    for k in range(12):
        targets = (tuple(3e3 * rng.standard_normal(2)),)
        way = guided_way(targets, 0.27, (0.0, 0.0), HOUR)
        follows.learn(leg(way, start=k * HOUR, targets=targets))
        drifts.learn(leg((900.0, 100.0), start=k * HOUR, targets=targets))
    ahead = leg((math.nan, math.nan), targets=((0.0, 4e3),))
    assert follows.expect(ahead, HOUR).mean == pytest.approx((0.0, 0.27), abs=0.02)
    assert drifts.expect(ahead, HOUR).mean == pytest.approx((0.25, 0.028), abs=0.03)


@pytest.mark.parametrize("reckons", [True, False])
def test_a_vehicle_that_steers_against_a_current_shows_it_in_its_own_track(reckons):
    pool, believed = WayPool(), (0.1, 0.0)
    steered = believed if reckons else (0.0, 0.0)
    for k in range(4):
        targets = ((0.0, 4e3),)
        way = guided_way(targets, 0.27, steered, HOUR)
        track = tuple(np.array(way) + HOUR * np.array(steered))
        pool.learn(leg(way, start=k * HOUR, targets=targets, believed=believed, onboard=track))
    ahead = leg((math.nan, math.nan), targets=((0.0, 4e3),), believed=(0.12, 0.0))
    assert pool.steered(ahead) == ((0.12, 0.0) if reckons else (0.0, 0.0))
    north, _ = pool.expect(ahead, HOUR).mean
    assert north == pytest.approx(-0.12 if reckons else 0.0, abs=0.02)


def expected(known, begin):
    """Duration of a dive after these."""
    schedule = SurfacingSchedule()
    for dive in known:
        schedule.learn(dive)
    return schedule.expect(begin)


def test_a_surfacing_by_the_clock_is_foretold_by_the_clock():
    rng = np.random.default_rng(1)
    ends = 1.6e9 - 1.6e9 % (4.0 * HOUR) + 4.0 * HOUR * np.arange(20) + rng.uniform(0, 60, 20)
    *known, (begin, end, _) = [  # late starts make short dives
        DiveTime(before + wait, after, wait)
        for (before, after), wait in zip(
            itertools.pairwise(ends), rng.uniform(600.0, 5400.0, 20), strict=False
        )
    ]
    assert begin + middle(expected(known, begin)) == pytest.approx(end, abs=120.0)
    assert abs(usual_duration(known) - (end - begin)) > 300.0


def test_a_dive_that_lasts_as_long_whenever_it_begins_is_foretold_to_last_so():
    rng, known, time = np.random.default_rng(2), [], 0.0
    for _ in range(20):
        begin = time + rng.uniform(600.0, 9000.0)
        time = begin + 5400.0 + rng.uniform(-60.0, 60.0)
        known.append(DiveTime(begin, time, math.nan))
    assert middle(expected(known, time + 3000.0)) == pytest.approx(5400.0, abs=150.0)


def test_a_clock_much_longer_than_the_dives_says_nothing():
    known = [DiveTime(1000.0 * k, 1000.0 * k + 700.0, 300.0) for k in range(5)]
    assert not {"every 1 h", "every 4 h"} & {*expected(known, 6000.0).names}
