"""The way to waypoints and the time of the next surfacing, as a pilot expects them.

When members come up: stays at the surface, and dives that last longer than they were flown.
"""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from logs import part, stored

from factory.samples import START, Flight
from factory.samples.gliders import gps_columns, write_slocum
from glider_twin_ops.forecast import LoggedLeg, known_from_logs
from glider_twin_ops.forecast.expected_dive import (
    Rhythm,
    SurfacingSchedule,
    WayPool,
    guided_way,
    middle,
    plain_way,
)
from glider_twin_ops.forecast.logged_leg import REPORTED, DiveTime, dive_times, usual_duration
from glider_twin_ops.forecast.member_flights import MemberFlight
from glider_twin_ops.forecast.pool import Mixture
from twin.navigation.current import Leg
from twin.records import LogStore
from twin.records.coordinates import utc_minute

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


def test_rivals_know_the_list_of_waypoints():
    """At the mean speed of the last three dives, 0.3 m/s; without a list as the last one went."""
    before = [leg((720.0, 0.0)), leg((0.0, 1080.0)), leg((900.0, 0.0)), leg((0.0, 1260.0))]
    plain = plain_way(before, [(-500.0, 0.0), (-480.0, 3e3)], HOUR)
    assert plain == pytest.approx((-480.0, 600.0), abs=5.0)  # 20 m before the first it turns
    assert plain_way(before, (), HOUR) == pytest.approx((0.0, 1080.0))
    still = [leg((0.0, 0.0))]
    assert plain_way(still, (), HOUR) == pytest.approx((0.0, 0.0))


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


# --- stays and late dives -------------------------------------------------------------------------

FLIGHT = Flight(dives=9, depth=1000.0, surface=5400.0, step=20.0)
"""Dives of 3.2 h, with 1.5 h at the surface before each"""


def rhythm(stays, lasts):
    """Of dives that follow each other after these stays [s]."""
    dives, at, schedule = [], 0.0, SurfacingSchedule()
    for stay, last in zip(stays, lasts, strict=True):
        dives.append(DiveTime(at + stay, at + stay + last, stay))
        at = dives[-1].end
        schedule.learn(dives[-1])
    return Rhythm.of(schedule, dives)


def test_stays_are_those_of_the_log_and_a_gap_is_none():
    found = rhythm([0.0, 600.0, 900.0, 30.0 * HOUR, 700.0], [2.0 * HOUR] * 5)
    assert sorted(found.stays) == [600.0, 700.0, 900.0]
    drawn = found.draw(5000, 4, 0.0, np.random.default_rng(0))
    assert drawn.stays[0].tolist() == [700.0] * 4
    assert drawn.late[0] == 0.0
    # of three known ones each of the four places between and beside them is as likely
    parts = np.histogram(drawn.stays[1:], [0.0, 600.0, 700.0, 900.0, np.inf])[0] / drawn.stays.size
    assert parts == pytest.approx([0.25] * 4, abs=0.02)
    # a tail is as long as its end is away from the median
    for side, end, away in ((-1.0, 600.0, 100.0), (1.0, 900.0, 200.0)):
        beyond = side * (drawn.stays - end)
        assert beyond[beyond > 0.0].mean() == pytest.approx(away, rel=0.06)
    assert "12 min at the surface (10 to 15 so far)" in found.words
    assert rhythm([0.0, 600.0], [HOUR, HOUR]) is None


def silent(folder, begin, end):
    """A store of a log without its samples and fixes between two times [s] unix."""
    rows, fixes = FLIGHT.time, gps_columns(FLIGHT)
    kept, seen = ((time < begin) | (time > end) for time in (rows, fixes["time"]))
    files = write_slocum(folder, FLIGHT, rows=kept, gps=part(fixes, seen))
    stored(folder / "log.zarr", "slocum", files)
    return folder / "log.zarr"


def test_a_hole_of_a_dive_and_a_half_is_no_stay(tmp_path):
    """Half a file and a whole one did not come."""
    begin, end = FLIGHT.dive_times(4)[0] + FLIGHT.leg, FLIGHT.dive_times(5)[1] + 300.0
    store = silent(tmp_path, begin, end)
    with LogStore(store) as logs:
        found = dive_times(logs, "unit1")
    assert [round((one.begin - START) / FLIGHT.cycle, 1) for one in found.dives] == pytest.approx(
        [(one * FLIGHT.cycle + FLIGHT.surface) / FLIGHT.cycle for one in (0, 1, 2, 3, 6, 7, 8)],
        abs=0.1,
    )
    assert [one.stay for one in found.dives] == pytest.approx(
        [np.nan, *[FLIGHT.surface] * 3, np.nan, *[FLIGHT.surface] * 2], abs=60.0, nan_ok=True
    )
    assert np.array(found.holes) == pytest.approx(np.array([[begin, end]]), abs=60.0)
    assert f"1 hole of an hour or more: {utc_minute(found.holes[0][0])} to " in found.silent
    known = known_from_logs(store)
    assert known.silent == found.silent
    assert known.rhythm.stays == pytest.approx([FLIGHT.surface] * 5, abs=60.0)


def test_a_silence_in_which_no_usual_dive_fits_is_a_stay(tmp_path):
    begin, end = FLIGHT.dive_times(4)[1] + 60.0, FLIGHT.dive_times(5)[0] - 60.0
    store = silent(tmp_path, begin, end)
    with LogStore(store) as logs:
        found = dive_times(logs, "unit1")
    assert end - begin > HOUR
    assert len(found.dives) == FLIGHT.dives
    assert found.dives[5].stay == pytest.approx(FLIGHT.surface, abs=60.0)
    assert (found.holes, found.silent) == ((), "")


@pytest.mark.parametrize(("waited", "holes"), [(2.0, ()), (0.5, ((2.0, 3.5),))])
def test_a_stay_that_the_vehicle_reports_is_no_hole_without_fixes_either(waited, holes):
    """Two dives of two hours, two hours apart: what the reported stay leaves may hold a dive."""
    numbers = {"dive_duration": [2.0 * HOUR] * 2, "surface_duration": [math.nan, waited * HOUR]}
    logs = SimpleNamespace(
        starts=np.array([0.0, 4.0 * HOUR]), missions_of=lambda name: [0, 1],
        number=lambda name: np.array(numbers[name]), fixes=lambda row: ((math.nan,) * 2,) * 2,
        signal=lambda name, row: np.array([0.5, 60.0, 0.5]),
    )  # fmt: skip
    found = dive_times(logs, "unit1")
    assert len(found.dives) == 2
    assert found.holes == tuple((begin * HOUR, end * HOUR) for begin, end in holes)


def test_what_it_has_been_at_the_surface_already_is_taken_off_the_first_stay():
    found = rhythm([600.0] * 6, [2.0 * HOUR] * 6)
    drawn = found.draw(5, 2, 240.0, np.random.default_rng(0))
    assert np.allclose(drawn.stays, [360.0, 600.0])
    # a dive ago it was another stay
    assert (found.draw(5, 2, 2.2 * HOUR, np.random.default_rng(0)).stays == 600.0).all()


def test_dives_that_keep_the_time_are_drawn_closer_than_those_that_do_not():
    rng = np.random.default_rng(1)
    steady = rhythm([600.0] * 12, [2.0 * HOUR] * 12)
    loose = rhythm([600.0] * 12, list(HOUR * rng.uniform(1.0, 3.0, 12)))
    spread = [
        np.ptp(np.quantile(one.draw(2000, 1, 0.0, rng).late, [0.05, 0.95]))
        for one in (steady, loose)
    ]
    assert spread[0] < 0.2 < spread[1]


def test_one_dive_of_four_that_may_last_half_as_long_again_is_late_and_none_is_early():
    late = Mixture(
        names=("usual", "longer"), weights=np.array([0.75, 0.25]),
        means=np.array([[2.0 * HOUR], [3.0 * HOUR]]), covariances=np.full((2, 1, 1), 60.0**2),
    )  # fmt: skip
    found = Rhythm(stays=np.array([600.0, 700.0]), late=late)
    drawn = found.draw(4000, 1, 0.0, np.random.default_rng(3)).late
    parts = np.histogram(drawn, [-0.8, -0.25, 0.25, 0.75])[0] / drawn.size
    assert parts == pytest.approx([0.0, 0.75, 0.25], abs=0.03)
    assert np.median(drawn[drawn > 0.25]) == pytest.approx(0.5, abs=0.01)


def test_a_member_drifts_at_the_surface_and_goes_on_along_its_way():
    time = np.array([1000.0, 3000.0])
    place = np.array([[300.0, 0.0], [300.0, 800.0]])
    flight = MemberFlight(
        time=time, place=place, energy=np.ones(2), track=np.array([[0.0, 0.0], [150.0, 0.0]]),
        times=np.array([0.0, 500.0]), duration=4000.0, taken=2.0, end=np.zeros(6),
    )  # fmt: skip
    stays, drift = np.array([100.0, 200.0, 50.0]), np.array([0.5, -0.2])
    found = flight.delayed(stays, 0.1, drift)
    assert found.time == pytest.approx([1000.0 + 100.0 + 100.0, 3000.0 + 300.0 + 100.0 + 200.0])
    first = [300.0 + 50.0 + 30.0, -20.0]
    assert found.place[0] == pytest.approx(first)
    assert found.place[1] == pytest.approx([first[0] + 100.0, first[1] - 40.0 + 800.0 + 80.0])
    # it begins where it is, and dives where it has drifted to
    assert found.times == pytest.approx([0.0, 100.0, 600.0])
    assert found.track == pytest.approx(np.array([[0.0, 0.0], [50.0, -20.0], [200.0, -20.0]]))
    assert (found.duration, found.taken) == (flight.duration, flight.taken)
    same = flight.delayed(np.zeros(3), 0.0, np.zeros(2))
    assert (same.time == time).all()
    assert (same.place == place).all()


def test_what_the_log_shows_under_water_lengthens_the_first_dive_along_its_way():
    """Half as long again at the same speed: half as far again, and all later ones as much later and
    farther away."""
    flight = MemberFlight(
        time=np.array([1000.0, 3000.0]), place=np.array([[300.0, -60.0], [300.0, 800.0]]),
        energy=np.ones(2), track=np.array([[0.0, 0.0], [150.0, -30.0], [300.0, 400.0]]),
        times=np.array([0.0, 500.0, 2000.0]), duration=4000.0, taken=2.0, end=np.zeros(6),
    )  # fmt: skip
    found = flight.not_before(1500.0)
    assert found.time == pytest.approx([1500.0, 3500.0])
    assert found.place == pytest.approx(np.array([[450.0, -90.0], [450.0, 770.0]]))
    assert found.times == pytest.approx([0.0, 750.0, 2500.0])
    assert found.track == pytest.approx(np.array([[0.0, 0.0], [225.0, -45.0], [450.0, 370.0]]))
    assert flight.not_before(1000.0) is flight
