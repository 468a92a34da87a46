"""The reader: what a store is and who knows it, whose vehicle flew, limits, addresses, refusals."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from factory.importing import import_logs
from learn.run_folder import training_folder
from twin.__main__ import PROGRAM
from twin.errors import InputError, StoreError
from twin.physics.scenario import Scenario
from twin.records import attributes
from twin.records.attributes import CONVENTIONS, READER_VERSION, SPLITS
from twin.records.logged import LogRow, LogStore, log_rows
from twin.records.reader import MissionStore
from twin.records.schema import HYDROGRAPHY, LOGGED_ONLY, SIMULATED, VARIABLES, WITH_FLOOR, Variable
from twin.records.schema.limits import TABLE, quantity, recorded_limits, simulated_limits
from twin.records.storage.store_path import Url, check_addresses, store_path
from twin.records.storage.whole import whole_file, whole_folder
from twin.records.store import open_trajectory, read_trajectory, write_store
from twin.records.tracks import read_tracks
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
    for name, said in cases.items():
        found = MissionStore(written(tmp_path / f"{name}.zarr", said)).vehicle
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


# --- limits of variables --------------------------------------------------------------------------


@pytest.mark.parametrize("name", VARIABLES)
def test_every_variable_has_limits(name):
    low, high = recorded_limits(name)
    assert low < high
    closer_low, closer_high = simulated_limits(name)
    assert low <= closer_low < closer_high <= high


def test_every_row_is_used():
    named = (*SIMULATED, *HYDROGRAPHY, *LOGGED_ONLY, *WITH_FLOOR)
    assert {quantity(name) for name in named} == set(TABLE)


def test_sensors_may_say_more_than_a_simulation_does():
    assert simulated_limits("true_surge") == (-5.0, 5.0)
    assert simulated_limits("measured_dvl_surge") == (-10.0, 10.0)
    assert simulated_limits("commanded_heading") == (0.0, 360.0)
    assert recorded_limits("true_heading") == (-180.0, 360.0)


def test_a_unit_without_limits_says_where_they_belong(monkeypatch):
    monkeypatch.setitem(VARIABLES, "true_light", Variable("true_light", "lx", "light"))
    with pytest.raises(LookupError, match=r"'true_light': add limits for the unit 'lx' to .*TABLE"):
        recorded_limits("true_light")
    with pytest.raises(KeyError, match="true_depth"):
        recorded_limits("true_dept")


# --- what a store is, is known in one package -----------------------------------------------------


ROOT = Path(__file__).resolve().parents[3]
OURS = ROOT / "twin" / "records"
ZARR = re.compile(r"open_zarr|to_zarr|\bzarr\.|import zarr|from zarr|\bZarr")
ELSEWHERE = {
    # gridded currents of other programs, which may be zarr
    "twin/water/current/velocity_file.py"
}
NAMES = (
    *(attributes.VERSION, attributes.SAMPLE_PERIOD, attributes.FAILED_MISSIONS),
    *(attributes.VEHICLE_MJCF, attributes.VEHICLE_SHA256, attributes.SOURCE_FORMAT),
    *(attributes.IMPORT_REPORT, attributes.PROGRAM_VERSION, attributes.N_SAMPLES),
    *(attributes.START_TIME, attributes.DIVE_DURATION),
)
"""Names that mean a store's attribute or bookkeeping array wherever they stand."""


def without_text(source):
    """A module without docstrings and comments."""
    source = re.sub(r'"""(?:.|\n)*?"""', "", source)
    return re.sub(r"#.*", "", source)


MODULES = [
    path
    for package in ("twin", "factory", "learn")
    for path in sorted((ROOT / package).rglob("*.py"))
    if OURS not in path.parents
]


def test_zarr_is_opened_and_written_here_only():
    found = {
        str(path.relative_to(ROOT))
        for path in MODULES
        if ZARR.search(without_text(path.read_text()))
    }
    assert found <= ELSEWHERE


def test_the_names_of_attributes_are_spelt_here_only():
    spelt = re.compile("|".join(f"[\"']{name}[\"']" for name in NAMES))
    found = {
        f"{path.relative_to(ROOT)}: {match.group()}"
        for path in MODULES
        for match in spelt.finditer(without_text(path.read_text()))
    }
    assert not found


@pytest.mark.parametrize("text", ["xr.open_zarr(p)", "d.to_zarr(p)", "import zarr", "zarr.open(p)"])
def test_the_search_would_find_it(text):
    assert ZARR.search(without_text(f'"""zarr."""\n{text}'))
    assert not ZARR.search(without_text('"""zarr.json"""  # zarr.open'))


# --- addresses ------------------------------------------------------------------------------------


UNKNOWN = ("gcs://b/run.zarr", "abfs://b/x.zarr", "https://a.b/x.zarr", "memory://x/y.zarr",
           "file:///tmp/x.zarr", "S3://b/x.zarr", "s3a://b/x.nc",
           "hdfs:/b/x.zarr", "gcs://")  # fmt: skip


@pytest.mark.parametrize("address", UNKNOWN)
@pytest.mark.parametrize("kind", [str, Path])
def test_an_address_of_an_unknown_kind_is_no_path(address, kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scheme = address.partition(":")[0]
    place = kind(address)

    def write(context):
        with context(place):
            pass

    for use in (
        lambda: store_path(place),
        lambda: check_addresses([Path("a"), Path(place)]),
        lambda: write(whole_file),
        lambda: write(whole_folder),
        lambda: open_trajectory(place),
        lambda: MissionStore(place),
        lambda: read_tracks(place),
        lambda: import_logs("slocum", [place]),
        lambda: training_folder(Path(place), replace=False),
    ):
        with pytest.raises(InputError, match=rf"{scheme}://.*: unknown kind of address '{scheme}'"):
            use()
    assert not list(tmp_path.iterdir())


def test_what_is_near_is_offered():
    with pytest.raises(InputError, match=r"unknown kind of address 'gcs': did you mean 'gs'\?"):
        store_path(Path("gcs://b/x.zarr"))


@pytest.mark.parametrize("place", ["a/b.zarr", "/a:/b.zarr", "a/b:/c", "./x:y", "x:y", "..", "~/a"])
def test_what_is_no_address_is_a_path(place):
    assert store_path(place) == Path(place)
    assert store_path(Path(place)) == Path(place)


@pytest.mark.parametrize("place", ["s3://b/x.zarr", "gs:/b/x.zarr", Path("az://b/c/x.zarr")])
def test_an_address_that_is_known_is_one(place):
    found = store_path(place)
    assert isinstance(found, Url)
    assert str(found) == str(place).replace("://", ":/").replace(":/", "://")
    assert store_path(found) == found


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "--duration", "5", "--out", "gcs://b/run.zarr"],
        ["flight", "gcs://b/x.zarr"], ["flight", "x.zarr", "--out", "gcs://b/f.nc"],
        ["plot", "gcs://b/x.zarr"], ["render", "x.zarr", "--out", "gcs://b/f.mp4"],
    ],
)  # fmt: skip
def test_every_command_refuses_an_address_of_an_unknown_kind(
    words, tmp_path, monkeypatch,
    capsys
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert PROGRAM.main(words) == 2
    assert "unknown kind of address 'gcs': did you mean 'gs'?" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
