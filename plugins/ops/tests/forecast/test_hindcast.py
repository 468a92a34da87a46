"""A hindcast: what was known before a dive, scored beside persistence, on logs of a tidal sea."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from logs import SHARED, stored

from factory.samples import START, Flight
from factory.samples.gliders import write_slocum
from glider_twin_ops.forecast import hindcast, legs_of, scores_of, walk
from glider_twin_ops.forecast.pool import FILTER
from glider_twin_ops.forecast.walk import METHODS
from twin.__main__ import PROGRAM
from twin.errors import InputError, StoreError
from twin.navigation.current import Reaches
from twin.records import LogStore

TIDE, PERIOD = 0.25, 12.4206012 * 3600.0
"""[m/s] northward, [s]"""


@dataclasses.dataclass(frozen=True)
class TidalFlight(Flight):
    """In a tide along the meridian instead of a steady current."""

    def state(self, time):
        found = super().state(time)
        turn = 2.0 * np.pi / PERIOD
        moved = TIDE / turn * np.sin(turn * (np.asarray(time) - START))
        return {**found, "north": found["north"] + moved}


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tide")
    flight = TidalFlight(dives=24, depth=500.0, step=20.0, north=0.0, east=0.03, surface=900.0)
    return stored(folder / "tide.zarr", "slocum", write_slocum(folder, flight), period=20.0)


@pytest.fixture(scope="module")
def found(store):
    return hindcast([store])


def test_in_a_tide_it_is_far_better_than_persistence(found):
    scores = found.current
    assert scores.segments == 23
    assert scores.mean["forecast"] < 0.5 * scores.mean["persistence"]
    assert scores.rival == "tide"
    low, high = scores.ratio_interval
    assert low < scores.ratio < high
    assert scores.coverage_90 > 0.7


def test_of_the_current_every_method_is_given_the_same_way_and_duration(found):
    (one,) = found.deployments
    for before, logged, surfacing in zip(one.legs, one.legs[1:], one.surfacings, strict=False):
        leg, missed = logged.leg, surfacing.current.missed
        for name, off in (
            ("no_current", leg.current),
            ("persistence", leg.current - before.leg.current),
            ("forecast", np.array(surfacing.found) - surfacing.expected),
        ):
            np.testing.assert_allclose(missed[name], off * leg.duration, atol=1e-6)


def test_of_the_surfacing_rivals_go_the_plain_way(found):
    """The speed of the last three dives where the last one went, for their median duration."""
    (one,) = found.deployments
    for k, surfacing in enumerate(one.surfacings, start=1):
        before = [each.leg for each in one.legs[max(k - 3, 0) : k]]
        speed, last = np.mean([np.hypot(*leg.velocity) for leg in before]), before[-1]
        lasted = np.median([leg.duration for leg in before])
        plain = lasted * speed * last.velocity / np.hypot(*last.velocity)
        off, missed = np.array(one.legs[k].leg.over_ground) - plain, surfacing.surfacing.missed
        np.testing.assert_allclose(missed["no_current"], off, atol=1e-6)
        np.testing.assert_allclose(missed["persistence"], off - lasted * last.current, atol=1e-6)


def test_a_forecast_knows_nothing_of_what_comes_after(found):
    """A leg and all after it changed at will change no forecast before its fix."""
    (one,) = found.deployments
    changed = list(one.legs[:18])
    for logged in one.legs[18:]:
        (north, east), (ahead, aside) = logged.leg.over_ground, logged.leg.through_water
        leg = dataclasses.replace(
            logged.leg,
            over_ground=(north + 7000.0, east),
            through_water=(ahead, aside - 3000.0),
            duration=0.8 * logged.leg.duration,
        )
        changed.append(dataclasses.replace(logged, leg=leg))
    same, again = walk(one.legs).surfacings, walk(changed).surfacings
    for k, (first, second) in enumerate(zip(same, again, strict=True), start=1):
        places = first.places["forecast"] == second.places["forecast"]
        alike = np.array_equal(first.surfacing.covariance, second.surfacing.covariance)
        assert places == alike == (k <= 18), k
        assert first.surfacing.reach == second.surfacing.reach or k > 18


def test_a_part_that_only_teaches_is_not_scored(store, found):
    later = hindcast([store], train_fraction=0.4)
    (one,), (whole,) = later.deployments, found.deployments
    assert [s.scored for s in one.surfacings] == [False] * 8 + [True] * 15
    assert later.surfacing.segments == 15
    assert one.surfacings[-1].places == whole.surfacings[-1].places


def test_ellipses_follow_how_many_fixes_they_held():
    rng = np.random.default_rng(2)
    reaches = Reaches((1.0, 1.0))  # of normal errors the second shall become 4.6 and the first 1.4
    held = []
    for missed in rng.standard_normal((600, 2)):
        distance = float(missed @ missed)
        held.append(reaches.held(distance))
        reaches.learn(distance)
    half, ninety = np.mean(held, axis=0)
    assert half == pytest.approx(0.5, abs=0.03)
    assert ninety == pytest.approx(0.9, abs=0.02)


def test_the_current_of_a_dive_is_the_tide_s(store):
    with LogStore(store) as logs:
        legs = legs_of(logs, logs.deployments[0])
    assert {one.method for one in legs} == {"depth rate and pitch"}
    middle = np.array([one.leg.start + 0.5 * one.leg.duration for one in legs])
    tide = TIDE * np.cos(2.0 * np.pi / PERIOD * (middle - START))
    seen = np.array([one.leg.current[0] for one in legs])
    np.testing.assert_allclose(seen, tide, atol=0.05)  # the angle of attack is taken as 3 degree


def judged(found):
    (one,) = found.deployments
    return [each.surfacing for each in one.surfacings]


def test_two_deployments_are_scored_together(found):
    both = scores_of([judged(found), judged(found)])
    assert both.segments == 2 * found.surfacing.segments
    assert both.mean["forecast"] == pytest.approx(found.surfacing.mean["forecast"])
    assert both.coverage_90 == found.surfacing.coverage_90


def test_a_method_with_fewer_segments_is_no_rival(found):
    some = []
    for k, one in enumerate(judged(found)):
        missed = {name: off for name, off in one.missed.items() if name != "onboard"}
        missed |= {"onboard": (0.1, 0.0)} if k % 4 == 0 else {}
        some.append(dataclasses.replace(one, missed=missed))
    scores = scores_of([some])
    assert scores.segments_of["onboard"] == 6
    assert scores.partial == ("onboard",)
    assert scores.mean["onboard"] < scores.mean[scores.rival]


def test_few_segments_have_no_interval(found):
    few, enough = scores_of([judged(found)[:8]]), scores_of([judged(found)[:12]])
    assert few.ratio_interval is None
    low, high = enough.ratio_interval
    assert high > 1.02 * low


def test_the_same_dives_are_not_scored_twice(store, tmp_path):
    with pytest.raises(InputError, match="is named twice"):
        hindcast([store, store.parent / ".." / store.parent.name / store.name])
    shutil.copytree(store, tmp_path / "copy.zarr")
    with pytest.raises(InputError, match=r"24 dives of .* would count double"):
        hindcast([store, tmp_path / "copy.zarr"])


def test_too_few_dives_are_told_in_a_line(tmp_path, capsys):
    stored(tmp_path / "one.zarr", "slocum", write_slocum(tmp_path, Flight(dives=1)))
    assert PROGRAM.main(["hindcast", str(tmp_path / "one.zarr")]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert "1 dive between fixes: too few to score" in line


def test_the_command_says_the_figures_by_their_names(store, tmp_path, capsys):
    out = tmp_path / "page"
    words = ["hindcast", str(store), "--train-fraction", "0.3", "--json", "--out", str(out)]
    assert PROGRAM.main(words) == 0
    said = json.loads(capsys.readouterr().out)
    methods = {"forecast", "persistence", "tide", "no_current", "onboard"}
    assert methods == {*METHODS}
    for one in (said, *said["deployments"]):
        for which in ("surfacing", "current"):
            figures = one[which]
            assert {*figures} == {
                "segments", "mean_m_per_h", "median_m_per_h", "coverage_50", "coverage_90",
            }  # fmt: skip
            assert set(figures["mean_m_per_h"]) == set(figures["median_m_per_h"]) == methods
            assert figures["segments"] == 17
            assert 0.0 <= figures["coverage_50"] <= figures["coverage_90"] <= 1.0
    page = (out / "index.html").read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", page)  # nothing is fetched
    assert "Where it surfaced" in page
    assert page.count("<img") == 3


def test_members_are_flown_for_every_scored_surfacing(store, tmp_path, capsys):
    out = tmp_path / "page"
    words = ["hindcast", str(store), "--train-fraction", "0.8", "--members", "20", "--json"]
    assert PROGRAM.main([*words, "--out", str(out)]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["members"]["segments"] == said["surfacing"]["segments"] == 5
    mean, others = (said[which]["mean_m_per_h"] for which in ("members", "surfacing"))
    # the same fixes beside the same rivals
    assert {**mean, "forecast": 0.0} == {**others, "forecast": 0.0}
    assert 0.0 < mean["forecast"] < 0.5 * mean["persistence"]
    assert "by members flown" in (out / "index.html").read_text()
    assert said["deployments"][0]["beside_mujoco"]["position_m"] < 50.0


def test_members_know_nothing_of_what_comes_after(store, tmp_path):
    """What they are given ends where the dive begins."""
    whole = hindcast([store], train_fraction=0.9, members=10).deployments[0].surfacings[-1]
    with LogStore(store) as logs:
        legs = legs_of(logs, logs.deployments[0])
    flights = {}

    def flown(before, one, pool, ways, duration, reach):
        flights[one.mission] = len(before), pool.filters[FILTER].time, duration
        return np.zeros(2), np.eye(2)

    walk(legs, train=len(legs) - 1, flown=flown)
    (told,) = flights.values()
    assert told[:2] == (len(legs) - 1, legs[-1].leg.start)
    assert whole.members.missed["forecast"] != whole.surfacing.missed["forecast"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--members", "3"], "members = 3 must be from 10"),
        (["--engine", "mujoco"], "--engine is for --members"),
        (["--train-fraction", "1"], "must be from 0 to below 1"),
        (["--train-fraction", "-0.1"], "must be from 0 to below 1"),
    ],
)
def test_what_leaves_nothing_to_score_is_refused(store, words, message, capsys):
    assert PROGRAM.main(["hindcast", str(store), *words]) == 2
    assert message in capsys.readouterr().err


def test_what_cannot_be_forecast_is_told(tmp_path):
    with pytest.raises(InputError, match="at least one store"):
        hindcast([])
    columns = {"m_pitch": None, "m_water_vx": None, "m_water_vy": None}
    stored(tmp_path / "mute.zarr", "slocum", write_slocum(tmp_path, Flight(), **columns))
    with pytest.raises(StoreError, match="nothing can be forecast"):
        hindcast([tmp_path / "mute.zarr"])


@pytest.mark.skipif(not SHARED.is_dir(), reason="shared data are absent")
def test_a_satellite_log_of_the_shelf_off_florida(tmp_path):
    pytest.importorskip("dbdreader")
    folder = SHARED / "slocum_seus_2016"
    files = sorted((folder / "ramses-20160909T2028").glob("*.sbd"))
    stored(tmp_path / "ramses.zarr", "slocum", files, cache=folder / "cache", period=20.0)
    found = hindcast([tmp_path / "ramses.zarr"])
    for scores in (found.surfacing, found.current):
        assert scores.segments >= 100
        assert scores.ratio < 0.6
        assert 0.83 <= scores.coverage_90 <= 0.97
        assert 0.38 <= scores.coverage_50 <= 0.62
