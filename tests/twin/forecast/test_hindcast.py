"""A hindcast: what was known before a dive, scored beside persistence, on logs of a tidal sea."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from logs import SHARED, START, Flight, write_slocum

from factory.importing import import_logs
from twin.__main__ import PROGRAM
from twin.errors import InputError, StoreError
from twin.forecast import METHODS, hindcast, legs_of, scores_of, walk
from twin.navigation.current import CurrentParameters
from twin.records.logged import LogStore
from twin.records.store import write_store

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
    dataset, _ = import_logs("slocum", write_slocum(folder, flight), period=20.0)
    return write_store(dataset, folder / "tide.zarr")


@pytest.fixture(scope="module")
def found(store):
    return hindcast([store], train_fraction=0.4)


def test_in_a_tide_it_is_far_better_than_persistence(found) -> None:
    scores = found.scores
    assert scores.segments == 15
    assert scores.mean["forecast"] < 0.5 * scores.mean["persistence"]
    assert scores.ratio_interval[1] < 0.8
    low, high = scores.mean_interval["forecast"]
    assert low < scores.mean["forecast"] < high
    assert scores.coverage_90 > 0.7


def test_every_method_is_given_the_same_way_through_the_water(found) -> None:
    (one,) = found.deployments
    for before, logged, surfacing in zip(one.legs, one.legs[1:], one.surfacings[1:], strict=False):
        leg = logged.leg
        np.testing.assert_allclose(
            surfacing.missed["no_current"], leg.current * leg.duration, atol=1e-6
        )
        np.testing.assert_allclose(
            surfacing.missed["persistence"],
            (leg.current - before.leg.current) * leg.duration,
            atol=1e-6,
        )
        np.testing.assert_allclose(
            surfacing.missed["forecast"],
            (np.array(surfacing.current) - surfacing.expected) * leg.duration,
            atol=1e-6,
        )


def test_a_forecast_knows_nothing_of_what_comes_after(found) -> None:
    """Later legs changed at will change no forecast before them."""
    (one,) = found.deployments
    changed = []
    for k, logged in enumerate(one.legs):
        leg = logged.leg
        if k >= 18:
            ground = (leg.over_ground[0] + 7000.0, leg.over_ground[1])
            leg = dataclasses.replace(leg, over_ground=ground)
        changed.append(dataclasses.replace(logged, leg=leg))
    again = walk(changed, one.tuned.parameters, latitude=one.latitude, train=one.train)
    for k in range(len(one.legs)):
        same = again[k].expected == one.surfacings[k].expected
        assert same == (k <= 18), k


def test_the_training_part_is_not_scored_and_alone_is_learned_from(store, found) -> None:
    (one,) = found.deployments
    assert one.train == 9
    assert [s.scored for s in one.surfacings] == [False] * 9 + [True] * 15
    assert hindcast([store], train_fraction=0.0).deployments[0].tuned.legs == 0


def test_the_current_of_a_dive_is_the_tide_s(store) -> None:
    with LogStore(store) as logs:
        legs = legs_of(logs, logs.deployments[0])
    assert {one.method for one in legs} == {"depth rate and pitch"}
    middle = np.array([one.leg.start + 0.5 * one.leg.duration for one in legs])
    tide = TIDE * np.cos(2.0 * np.pi / PERIOD * (middle - START))
    seen = np.array([one.leg.current[0] for one in legs])
    np.testing.assert_allclose(seen, tide, atol=0.05)  # the angle of attack is taken as 3 degree


def test_two_deployments_are_scored_together(found) -> None:
    (one,) = found.deployments
    both = scores_of([one.surfacings, one.surfacings])
    assert both.segments == 2 * found.scores.segments
    assert both.mean["forecast"] == pytest.approx(found.scores.mean["forecast"])
    assert both.coverage_90 == found.scores.coverage_90


def test_a_method_with_fewer_segments_says_so(found) -> None:
    (one,) = found.deployments
    some = [
        dataclasses.replace(s, missed={**s.missed, "onboard": (100.0, 0.0)})
        if k % 4 == 0
        else dataclasses.replace(s, missed={n: m for n, m in s.missed.items() if n != "onboard"})
        for k, s in enumerate(one.surfacings)
    ]
    scores = scores_of([some])
    assert scores.segments_of == {"forecast": 15, "persistence": 15, "no_current": 15, "onboard": 3}
    assert scores.partial == ("onboard",)
    assert scores.mean_interval["onboard"] is None


def test_few_segments_have_no_interval(found) -> None:
    (one,) = found.deployments
    scored = [s for s in one.surfacings if s.scored]
    few, enough = scores_of([scored[:8]]), scores_of([scored[:12]])
    assert few.ratio is not None
    assert few.ratio_interval is None
    assert set(few.mean_interval.values()) == {None}
    low, high = enough.mean_interval["persistence"]
    assert high > 1.05 * low


def test_the_same_dives_are_not_scored_twice(store, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is named twice"):
        hindcast([store, store.parent / ".." / store.parent.name / store.name])
    shutil.copytree(store, tmp_path / "copy.zarr")
    with pytest.raises(InputError, match=r"24 dives of .* would count double"):
        hindcast([store, tmp_path / "copy.zarr"])


def test_too_few_dives_are_told_in_a_line(tmp_path: Path, capsys) -> None:
    dataset, _ = import_logs("slocum", write_slocum(tmp_path, Flight(dives=1)))
    write_store(dataset, tmp_path / "one.zarr")
    assert PROGRAM.main(["hindcast", str(tmp_path / "one.zarr")]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert "1 dive between fixes: too few to score" in line


def test_without_a_training_part_nothing_is_said_to_be_learned(store, capsys) -> None:
    assert PROGRAM.main(["hindcast", str(store), "--train-fraction", "0"]) == 0
    said = capsys.readouterr().err
    assert "nothing learned" in said
    assert "learned from 0" not in said


def test_the_command_says_the_figures_by_their_names(store, tmp_path: Path, capsys) -> None:
    out = tmp_path / "page"
    words = ["hindcast", str(store), "--train-fraction", "0.3", "--json", "--out", str(out)]
    assert PROGRAM.main(words) == 0
    said = json.loads(capsys.readouterr().out)
    for name in ("mean_m_per_h", "median_m_per_h"):
        assert set(said[name]) == {"forecast", "persistence", "no_current", "onboard"} == {*METHODS}
    assert said["segments"] == 17
    assert said["segments_of"]["forecast"] == 17
    assert 0.0 <= said["coverage_90"] <= 1.0
    assert said["deployments"][0]["trained_on"] == 7
    page = (out / "index.html").read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", page)  # nothing is fetched
    assert "Where it surfaced" in page
    assert page.count("<img") == 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--train-fraction", "1"], "must be from 0 to below 1"),
        (["--train-fraction", "-0.1"], "must be from 0 to below 1"),
    ],
)
def test_a_fraction_that_leaves_nothing_is_refused(store, words, message, capsys) -> None:
    assert PROGRAM.main(["hindcast", str(store), *words]) == 2
    assert message in capsys.readouterr().err


def test_what_cannot_be_forecast_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one store"):
        hindcast([])
    columns = {"m_pitch": None, "m_water_vx": None, "m_water_vy": None}
    dataset, _ = import_logs("slocum", write_slocum(tmp_path, Flight(), **columns))
    write_store(dataset, tmp_path / "mute.zarr")
    with pytest.raises(StoreError, match="nothing can be forecast"):
        hindcast([tmp_path / "mute.zarr"])


def test_persistence_as_parameters_forecasts_about_the_last_current(found) -> None:
    (one,) = found.deployments
    surfacings = walk(
        one.legs, CurrentParameters.persistence(1.0), latitude=one.latitude, train=one.train
    )
    scores = scores_of([surfacings])
    assert scores.ratio == pytest.approx(1.0, abs=0.35)  # a walk has a trend, persistence none


@pytest.mark.skipif(not SHARED.is_dir(), reason="shared data are absent")
def test_a_satellite_log_of_the_shelf_off_florida(tmp_path: Path) -> None:
    pytest.importorskip("dbdreader")
    folder = SHARED / "slocum_seus_2016"
    files = sorted((folder / "ramses-20160909T2028").glob("*.sbd"))
    dataset, _ = import_logs("slocum", files, cache=folder / "cache", period=20.0)
    write_store(dataset, tmp_path / "ramses.zarr")
    scores = hindcast([tmp_path / "ramses.zarr"]).scores
    assert scores.segments >= 50
    assert scores.ratio < 0.5
    assert 0.85 <= scores.coverage_90 <= 0.95
