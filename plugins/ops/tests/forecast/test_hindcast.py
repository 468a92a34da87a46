"""A hindcast: what was known before a dive, scored beside persistence, on logs of a tidal sea.

A forecast field improves it as far as it is right, and not more.
"""

import dataclasses
import json
import math
import re
import shutil

import numpy as np
import pytest
import xarray as xr
from logs import stored

from factory.samples import LATITUDE, LONGITUDE, START, Flight
from factory.samples.gliders import write_slocum
from glider_twin_ops.forecast import hindcast, legs_of, scores_of, walk
from glider_twin_ops.forecast.hindcast import field_mean
from glider_twin_ops.forecast.pool import FILTER
from glider_twin_ops.forecast.walk import METHODS
from twin import Series
from twin.__main__ import PROGRAM
from twin.errors import CurrentError, InputError, StoreError
from twin.navigation.current import Reaches
from twin.records import LogStore
from twin.water.current import parse_field

TIDE, PERIOD = 0.25, 12.4206012
"""[m/s] northward, [h]"""
STEP, HOURS = 900.0, 60


def flow(parts, time):
    """North, east [m/s] at a unix time, (2, time), of parts: [m/s], [h], phase of the northward
    one, and how much of it is eastward."""
    rows = [
        size * np.cos(2.0 * np.pi * (np.asarray(time) - START) / (3600.0 * period) + phase)
        for size, period, phase, _ in parts
    ]
    return np.stack([sum(rows), sum(p[3] * row for p, row in zip(parts, rows, strict=True))])


@dataclasses.dataclass(frozen=True)
class Drifting(Flight):
    """In a current of such parts beside a steady one."""

    parts: tuple = ()

    def state(self, time):
        found = super().state(time)
        for size, period, phase, east in self.parts:
            turn = 2.0 * np.pi / (3600.0 * period)
            way = size / turn * (np.sin(turn * (np.asarray(time) - START) + phase) - np.sin(phase))
            found |= {"north": found["north"] + way, "east": found["east"] + east * way}
        return found


def drifting(folder, **flight):
    files = write_slocum(folder, Drifting(depth=500.0, step=20.0, north=0.0, **flight))
    return stored(folder / "flown.zarr", "slocum", files, period=20.0)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    tide = ((TIDE, PERIOD, 0.0, 0.0),)
    return drifting(tmp_path_factory.mktemp("tide"), dives=24, east=0.03, surface=900.0, parts=tide)


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
        over = lasted * np.mean(
            [np.array(leg.over_ground) / leg.duration for leg in before], axis=0
        )
        ended = np.array(one.legs[k].leg.over_ground)
        np.testing.assert_allclose(missed["over_ground"], ended - over, atol=1e-6)


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
    tide = TIDE * np.cos(2.0 * np.pi / (3600.0 * PERIOD) * (middle - START))
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


def test_one_rival_stands_for_all_deployments(store, drifted, found, alone):
    both = hindcast([store, drifted])
    for which in ("surfacing", "current"):
        together = getattr(both, which)
        parts = [getattr(one, which) for one in both.deployments]
        assert {one.rival for one in parts} == {together.rival}
        for one in parts:
            assert one.ratio == pytest.approx(one.mean["forecast"] / one.mean[together.rival])
    own = {one.current.rival for one in (found, alone)}
    assert own != {both.current.rival}  # alone, one of them has another


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
    methods = {"forecast", "over_ground", "persistence", "tide", "no_current", "onboard"}
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
    told = []

    def flown(before, one, models, duration, reach):
        told.append((len(before), models.pool.filters[FILTER].time))
        return np.zeros(2), np.eye(2)

    walk(legs, train=len(legs) - 1, flown=flown)
    assert told == [(len(legs) - 1, legs[-1].leg.start)]
    assert whole.members.missed["forecast"] != whole.surfacing.missed["forecast"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--members 3", "members = 3 must be from 10"),
        ("--engine mujoco", "--engine is for --members"),
        ("--train-fraction 1", "must be from 0 to below 1"),
        ("--train-fraction -0.1", "must be from 0 to below 1"),
    ],
)
def test_what_leaves_nothing_to_score_is_refused(store, words, message, capsys):
    assert PROGRAM.main(["hindcast", str(store), *words.split()]) == 2
    assert message in capsys.readouterr().err


def test_what_cannot_be_forecast_is_told(tmp_path):
    with pytest.raises(InputError, match="at least one store"):
        hindcast([])
    columns = {"m_pitch": None, "m_water_vx": None, "m_water_vy": None}
    stored(tmp_path / "mute.zarr", "slocum", write_slocum(tmp_path, Flight(), **columns))
    with pytest.raises(StoreError, match="nothing can be forecast"):
        hindcast([tmp_path / "mute.zarr"])


# --- a forecast field -----------------------------------------------------------------------------

PARTS = ((0.16, 5.3, 0.2, 1.0), (0.14, 9.1, 1.9, -0.7), (0.12, 19.0, 4.0, 0.4))
"""Of the true current"""
ERRORS = ((0.05, 6.7, 2.0, -0.5), (0.04, 13.0, 0.5, 1.0))
"""Of the field's error"""
BIAS = (0.04, -0.03)
"""m/s, of the field"""


@pytest.fixture(scope="module")
def drifted(tmp_path_factory):
    """In a current that neither persists nor is tidal."""
    return drifting(
        tmp_path_factory.mktemp("drift"), dives=30, east=0.0, surface=600.0, parts=PARTS
    )


@pytest.fixture(scope="module")
def alone(drifted):
    return hindcast([drifted])


def series(alone, parts, bias=(0.0, 0.0)):
    """A field from the first fix of the drifted on."""
    time = alone.deployments[0].legs[0].leg.start + STEP * np.arange(3600.0 * HOURS / STEP)
    north, east = flow(parts, time) + np.array(bias)[:, None]
    return Series(interval=STEP, north=tuple(north), east=tuple(east))


def test_the_truth_with_an_error_improves_the_forecast(drifted, alone):
    found = hindcast([drifted], current=series(alone, PARTS + ERRORS, BIAS))
    assert found.current.mean["forecast"] < 0.6 * alone.current.mean["forecast"]
    assert found.surfacing.mean["forecast"] < alone.surfacing.mean["forecast"]
    assert found.current.mean["persistence"] == alone.current.mean["persistence"]
    weights = found.deployments[0].walked.pool.pool.weights
    assert weights["field"] + weights["filter beside the field"] > 0.9
    assert found.current.coverage_90 > 0.7


def test_a_field_that_is_noise_is_not_believed(drifted, alone):
    noise = np.random.default_rng(4).normal(0.0, 0.25, (2, HOURS))
    strange = Series(interval=3600.0, north=tuple(noise[0]), east=tuple(noise[1]))
    found = hindcast([drifted], current=strange)
    weights = found.deployments[0].walked.pool.pool.weights
    assert weights["field"] + weights["filter beside the field"] < 0.3
    assert found.current.mean["forecast"] < 1.15 * alone.current.mean["forecast"]


def test_the_truth_is_taken_as_it_is(drifted, alone):
    found = hindcast([drifted], current=series(alone, PARTS))
    assert found.current.mean["forecast"] < 0.3 * found.current.mean["persistence"]


def test_a_surfacing_s_field_is_read_along_the_expected_way(drifted, alone):
    """What a dive's end will be is not known when it begins: its field is that of the way ahead."""
    with LogStore(drifted) as logs:
        rng, legs, asked = np.random.default_rng(6), [], []
        for one in alone.deployments[0].legs:  # no dive repeats the one before
            way = tuple(one.leg.through_water + rng.normal(0.0, 50.0, 2))
            legs.append(
                dataclasses.replace(one, leg=dataclasses.replace(one.leg, through_water=way))
            )

        def spy(one, alike, way, duration):
            asked.append((one.leg, alike.leg, tuple(way)))
            return mean(one, alike, way, duration)

        mean = field_mean(logs, legs, series(alone, PARTS))
        walk(legs, field=spy)
    ahead = [(leg, way) for leg, alike, way in asked if leg.start != alike.start]
    assert len(ahead) == len(legs) - 1
    assert all(math.dist(way, leg.through_water) > 0.01 for leg, way in ahead)


def gridded(folder, hours):
    """The field as a file that begins with the deployment and lasts so long."""
    time = START + np.arange(0.0, 3600.0 * hours, STEP)
    velocity = flow(PARTS + ERRORS, time) + np.array(BIAS)[:, None]
    axes = ("time", "depth", "latitude", "longitude")
    data = xr.Dataset(
        {
            name: (axes, np.broadcast_to(v[:, None, None, None], (len(time), 2, 3, 3)),
                   {"units": "m s-1", "standard_name": f"{word}_sea_water_velocity"})
            for name, word, v in (
                ("vo", "northward", velocity[0]), ("uo", "eastward", velocity[1]),
            )
        },
        {
            "time": (time * 1e9).astype("datetime64[ns]"),
            "depth": ("depth", [0.0, 600.0], {"units": "m", "positive": "down"}),
            "latitude": ("latitude", LATITUDE + np.array([-2.0, 0.0, 2.0]),
                         {"units": "degrees_north"}),
            "longitude": ("longitude", LONGITUDE + np.array([-3.0, 0.0, 3.0]),
                          {"units": "degrees_east"}),
        },
    )  # fmt: skip
    data.to_netcdf(folder / "field.nc")
    return folder / "field.nc"


def test_the_command_takes_a_file(drifted, alone, tmp_path, capsys):
    words = ["hindcast", str(drifted), "--json", "--current", str(gridded(tmp_path, 80.0))]
    assert PROGRAM.main(words) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["current"]["mean_m_per_h"]["forecast"] < 0.6 * alone.current.mean["forecast"]


def test_a_file_that_ends_too_early_is_refused(drifted, tmp_path):
    with pytest.raises(CurrentError, match="time"):
        hindcast([drifted], current=parse_field(str(gridded(tmp_path, 20.0))))
