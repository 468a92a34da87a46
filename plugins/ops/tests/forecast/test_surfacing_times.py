"""When members come up: stays at the surface, and dives that last longer than they were flown."""

import numpy as np
import pytest
from logs import part, stored

from factory.samples import START, Flight
from factory.samples.gliders import gps_columns, write_slocum
from glider_twin_ops.forecast import known_from_logs
from glider_twin_ops.forecast.expected_dive import Rhythm, SurfacingSchedule
from glider_twin_ops.forecast.logged_leg import DiveTime, dive_times
from glider_twin_ops.forecast.member_flights import MemberFlight
from twin.records import LogStore
from twin.records.coordinates import utc_minute

HOUR = 3600.0
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
