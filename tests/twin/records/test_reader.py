"""The reader: what kind of store it is, whose vehicle flew, and what is refused."""

import json
import shutil

import numpy as np
import pytest
import xarray as xr

from twin.errors import StoreError
from twin.physics.scenario import Scenario
from twin.records.attributes import CONVENTIONS, READER_VERSION, SPLITS
from twin.records.logged import LogRow, LogStore, log_rows
from twin.records.reader import MissionStore
from twin.records.store import read_trajectory, write_store
from twin.vehicle.vehicle import load_vehicle
from twin.version import IMPORT_VERSION


def written(path, attributes=None, **arrays):
    """A store of two missions of three samples."""
    depth = np.array([[0.0, 1.0, 2.0], [0.0, 1.0, np.nan]], np.float32)
    data = xr.Dataset(
        {
            "n_samples": ("mission", np.array([3, 2], np.int32)),
            "measured_depth": (("mission", "time"), depth),
            **arrays,
        },
        {"time": [0.0, 0.5, 1.0]},
        {**CONVENTIONS, READER_VERSION: IMPORT_VERSION, **(attributes or {})},
    )
    return write_store(data, path)


def test_a_store_says_kind_period_samples_and_signals(tmp_path):
    with MissionStore(written(tmp_path / "a.zarr")) as store:
        assert (store.kind, store.logged, len(store), store.period) == ("simulated", False, 2, 0.5)
        assert store.samples.tolist() == [3, 2]
        assert store.signals() == ["measured_depth"]
        assert "measured_depth" in store
        assert "true_depth" not in store
    logged = written(tmp_path / "b.zarr", {"source_format": "slocum"})
    assert MissionStore(logged).kind == "logged"


@pytest.mark.parametrize(
    "missions", [[], [3], [0, 1, 2], range(40), [39, 0, 7, 8, 7], [1, 6, 12, 20, 21]]
)
def test_rows_are_those_asked_for_in_their_order(missions, tmp_path):
    depth = np.arange(120.0, dtype=np.float32).reshape(40, 3)
    data = xr.Dataset(
        {"n_samples": ("mission", [3] * 40), "measured_depth": (("mission", "time"), depth)},
        {"time": [0.0, 0.5, 1.0]},
        CONVENTIONS,
    )
    with MissionStore(write_store(data, tmp_path / "many.zarr")) as store:
        np.testing.assert_array_equal(store.rows("measured_depth", missions), depth[list(missions)])


def test_the_vehicle_is_the_one_that_the_store_describes(tmp_path):
    rogue = load_vehicle("rogue")
    scenario = Scenario(vehicle=rogue, duration=60.0).describe()
    cases: dict[str, dict[str, object]] = {
        "scenario": {"scenario": json.dumps(scenario)},
        "mjcf": {"vehicle_mjcf": rogue.xml, "settings": json.dumps({"vehicle": "rogue"})},
    }
    for name, attributes in cases.items():
        found = MissionStore(written(tmp_path / f"{name}.zarr", attributes)).vehicle
        assert (found.name, found.mass) == (rogue.name, rogue.mass)
    plain = MissionStore(written(tmp_path / "plain.zarr")).vehicle
    assert plain.mass == load_vehicle("glider").mass
    logs = MissionStore(written(tmp_path / "logs.zarr", {"source_format": "seaglider"})).vehicle
    assert logs.name == "seaglider"
    others = MissionStore(written(tmp_path / "others.zarr", {"source_format": "og1"})).vehicle
    assert others.name == "slocum-200"


def test_splits_are_read_as_flags_and_as_words(tmp_path):
    flags = ("mission", np.array([2, 0], np.int8), {"flag_meanings": " ".join(SPLITS)})
    words = ("mission", np.array(["test", "train"], object))
    for name, split in (("flags", flags), ("words", words)):
        assert MissionStore(written(tmp_path / name, split=split)).splits == ["test", "train"]
    odd = ("mission", np.array(["tset", "train"], object))
    with pytest.raises(StoreError, match=r"odd: .*'tset'.*test"):
        _ = MissionStore(written(tmp_path / "odd", split=odd)).splits
    with pytest.raises(StoreError, match="no array 'split'"):
        _ = MissionStore(written(tmp_path / "none")).splits


def test_what_is_asked_for_and_is_not_there_is_named(tmp_path):
    store = MissionStore(written(tmp_path / "a.zarr"))
    with pytest.raises(StoreError, match=r"a\.zarr lacks the array 'duration'"):
        store.array("duration")
    with pytest.raises(StoreError, match=r"a\.zarr has missions 0 to 1, not 2"):
        store.check_mission(2)
    with pytest.raises(StoreError, match=r"n_samples of mission 1 is 2; its arrays allow 3 to 3"):
        store.check_samples([0, 1], least=3)
    with pytest.raises(StoreError, match=r"a\.zarr: its attribute 'settings' cannot be read"):
        store.json("settings")
    with pytest.raises(StoreError, match="holds simulated missions; this needs logs"):
        LogStore(tmp_path / "a.zarr")


def test_rows_without_times_follow_nothing(tmp_path):
    rows = log_rows(MissionStore(written(tmp_path / "a.zarr")))
    assert [row.displacement for row in rows] == [None, None]
    assert not rows[1].follows(rows[0])


GAPS = [(-2.0, False), (-0.5, True), (0.0, True), (3599.0, True), (3601.0, False)]


@pytest.mark.parametrize(("gap", "follows"), GAPS)
def test_a_dive_follows_another_of_its_deployment(gap, follows):
    first = LogRow(deployment="a", start=100.0, duration=50.0, displacement=None)
    second = LogRow(deployment="a", start=150.0 + gap, duration=50.0, displacement=None)
    assert second.follows(first) is follows
    other = LogRow(deployment="b", start=150.0, duration=50.0, displacement=None)
    assert not other.follows(first)


def test_a_signal_whose_file_is_gone_is_refused_by_its_name(tmp_path):
    path = written(tmp_path / "a.zarr")
    with MissionStore(path) as store:
        assert store.rows("measured_depth", [0]).sum() == 3.0
    shutil.rmtree(path / "measured_depth/c/0")
    said = r"file measured_depth/c/0/0 of its array measured_depth is gone.*`factory verify "
    with MissionStore(path) as store:
        for read in (
            lambda: store.row("measured_depth", 1),
            lambda: store.rows("measured_depth", [0, 1]),
            lambda: store.array("measured_depth"),
            store.check_arrays,
            lambda: read_trajectory(path, 0),
        ):
            with pytest.raises(StoreError, match=said):
                read()
        assert store.samples.tolist() == [3, 2]


def test_a_chunk_that_never_had_a_file_is_read_as_missing_values(tmp_path):
    empty = ("mission", "time"), np.full((2, 3), np.nan, np.float32)
    path = written(tmp_path / "a.zarr", measured_pitch=empty)
    assert not (path / "measured_pitch/c").exists()
    unlisted = written(tmp_path / "b.zarr", measured_pitch=empty)
    shutil.rmtree(unlisted / "checksums")
    for one in (path, unlisted):
        with MissionStore(one) as store:
            assert np.isnan(store.rows("measured_pitch", [0, 1])).all()
            store.check_arrays()
