"""Stores of logs in the factory's commands: export and back, verify, replay, plot, info."""

import importlib.util
import json
import shutil
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from logs import refused, stored
from matplotlib.quiver import Quiver

from factory.__main__ import PROGRAM
from factory.exporting.flat_table import export_parquet
from factory.exporting.og1.deployments import export_og1_logs
from factory.generation.generated_store import GeneratedStore, open_missions
from factory.importing import import_logs
from factory.logs_page import OURS, THEIRS, averaged, current_errors, deployment_page, dive_figures
from factory.samples import LATITUDE, START, Flight
from factory.samples.gliders import write_seaglider, write_slocum
from factory.soundness import verify_logs
from twin.errors import StoreError
from twin.records.logged import LogStore
from twin.records.store import write_store
from twin.records.tracks import read_tracks

FLIGHT = Flight(dives=3)
PERIOD = 4.0


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    return import_logs("slocum", write_slocum(folder, FLIGHT), period=PERIOD)[0]


@pytest.fixture(scope="module")
def store(imported, tmp_path_factory):
    return write_store(imported, tmp_path_factory.mktemp("store") / "real.zarr")


@pytest.fixture(scope="module")
def og1(store, tmp_path_factory):
    (path,) = export_og1_logs(LogStore(store), range(3), tmp_path_factory.mktemp("og1"))
    return path


def call(capsys, *words):
    code = PROGRAM.main([str(word) for word in words])
    out = capsys.readouterr()
    return code, out.out, out.err


def test_time_and_place_of_the_export_are_real(og1, store):
    logs = LogStore(store)
    with netCDF4.Dataset(og1) as file:
        time = np.asarray(file["TIME"][:])
        assert (np.diff(time) > 0.0).all()
        assert START <= time[0] < time[-1] <= FLIGHT.time[-1]
        assert np.nanmax(np.abs(np.asarray(file["TIME_DEPTH"][:]) - time)) < PERIOD
        assert file["TIME_DEPTH"].units == file["TIME"].units
        assert "SIMULATED" not in file.title
        assert str(file["TRAJECTORY"][...]) == "unit1"
        fixed = ~np.ma.getmaskarray(file["TIME_GPS"][:])
        assert fixed.sum() == 2 * len(logs)
        when = np.asarray(file["TIME_GPS"][:])[fixed]
        true = FLIGHT.position(when)
        np.testing.assert_allclose(np.asarray(file["LATITUDE_GPS"][:])[fixed], true[0], atol=1e-7)
        np.testing.assert_allclose(np.asarray(file["LONGITUDE_GPS"][:])[fixed], true[1], atol=1e-7)
        # by the flight model of a Slocum, corrected at the fixes
        latitude, longitude = FLIGHT.position(time)
        off = np.hypot(
            np.asarray(file["LATITUDE"][:]) - latitude,
            (np.asarray(file["LONGITUDE"][:]) - longitude) * np.cos(np.radians(LATITUDE)),
        )
        assert off.max() * 111e3 < 100.0
        assert "by a flight model" in file["LATITUDE"].interpolation_methodology
        assert file.flight_model == "flight model of vehicle slocum-200"
        # at every fix the position is the fix, and nowhere else does it claim to be one
        gps = np.stack([file[f"{name}_GPS"][:][fixed] for name in ("LATITUDE", "LONGITUDE")])
        own = np.stack([file[name][:][fixed] for name in ("LATITUDE", "LONGITUDE")])
        np.testing.assert_allclose(own, gps, atol=1e-6)  # 0.1 m
        np.testing.assert_array_equal(np.asarray(file["DEAD_RECKONING"][:]) == 0, fixed)
        np.testing.assert_array_equal(np.asarray(file["LATITUDE_QC"][:]), np.where(fixed, 1, 8))
        assert float(file["POSITION_SD"][:].max()) > float(file["POSITION_SD"][:][fixed].max())


def test_what_a_profiler_measured_stays_as_sparse_as_it_was(imported, tmp_path):
    sparse = np.full(imported["measured_depth"].shape, np.nan)
    sparse[:, 5:40:7] = 0.3
    data = imported.assign(true_surge=(("mission", "time"), sparse))
    logs = LogStore(write_store(data, tmp_path / "profiler.zarr"))
    again, _ = import_logs("og1", export_og1_logs(logs, range(3), tmp_path), period=PERIOD)
    np.testing.assert_allclose(again["true_surge"].values, sparse, atol=1e-6)


def test_what_was_bridged_is_no_measurement(imported, tmp_path):
    holed = imported.copy(deep=True)
    holed["measured_gap"][1, 40:60] = 1.0
    logs = LogStore(write_store(holed, tmp_path / "holed.zarr"))
    (path,) = export_og1_logs(logs, [1], tmp_path)
    with netCDF4.Dataset(path) as file:
        assert np.ma.getmaskarray(file["PRES"][:])[40:60].all()
        assert np.ma.getmaskarray(file["PITCH"][:]).sum() == 20
        assert not np.ma.getmaskarray(file["DEPTH"][:]).any()
        assert set(np.asarray(file["DIVE_NUMBER"][:])) == {int(holed["dive"][1])}


def test_water_and_currents_are_exported_by_deployment(tmp_path):
    for name in ("SG1", "SG2"):
        (tmp_path / name).mkdir()
    files = [
        *write_seaglider(tmp_path / "SG1", FLIGHT, "SG1"),
        *write_seaglider(tmp_path / "SG2", Flight(dives=2), "SG2"),
    ]
    logs = LogStore(stored(tmp_path / "two.zarr", "seaglider", files))
    paths = export_og1_logs(logs, range(len(logs)), tmp_path / "og1")
    assert len(paths) == 2
    for path, name in zip(paths, logs.deployments[:1] + logs.deployments[-1:], strict=True):
        with netCDF4.Dataset(path) as file:
            assert str(file["TRAJECTORY"][...]) == name
            assert float(np.ma.median(file["PSAL"][:])) == pytest.approx(34.0)
            assert float(np.ma.median(file["TEMP"][:])) == pytest.approx(8.0)
            assert 1020.0 < float(np.ma.median(file["DENSITY"][:])) < 1030.0
            assert "SENSOR_CTD" in file.variables
            np.testing.assert_allclose(file["DAVG_CURR_NORTH"][:], FLIGHT.north, rtol=1e-6)


@pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="pyarrow is not installed")
def test_parquet_of_a_log_says_when_and_where(store, tmp_path):
    import pyarrow.parquet as pq

    logs = LogStore(store)
    table = pq.read_table(export_parquet(logs, [0, 2], tmp_path / "real.parquet"))
    assert table.num_rows == logs.samples[0] + logs.samples[2]
    assert set(table["deployment"].to_pylist()) == {"unit1"}
    moments = table["datetime"].to_numpy().astype("datetime64[us]").astype(float) / 1e6
    np.testing.assert_allclose(moments[: logs.samples[0]], logs.time(0), atol=1e-3)
    assert table["latitude"].to_numpy()[0] == pytest.approx(logs.fixes(0)[0][0])
    assert b"Recorded by vehicles" in table.schema.metadata[b"comment"]


def test_a_sound_log_is_sound(store, capsys):
    code, out, err = call(capsys, "verify", store)
    assert (code, err) == (0, "")
    assert "sound: 3 dives" in out
    report = verify_logs(LogStore(store))
    assert all(check.done for check in report.checks)


@pytest.mark.parametrize(
    ("damage", "check", "words"),
    [
        (lambda d: d["measured_depth"].values.__setitem__((1, 30), np.nan), "finite", "sample 30"),
        (lambda d: d["measured_depth"].values.__setitem__((1, 30), 900.0), "depth", "changes by"),
        (lambda d: d["measured_depth"].values[1, 30:].__iadd__(7.0 * PERIOD), "depth", "changes"),
        (lambda d: d["measured_pressure"].values.__imul__(10.0), "depth", "dbar/m"),
        (lambda d: d["measured_pitch"].values.__setitem__((0, 9), 300.0), "range", "to 300"),
        (lambda d: d["measured_gap"].values.__setitem__((2, 9), 0.5), "range", "code 0.5"),
        (lambda d: d["measured_roll"].values.__setitem__((0, -1), 1.0), "padding", "has values"),
        (lambda d: d["start_time"].values.__setitem__(2, START), "order", "dive 2 begins before"),
        (lambda d: d["end_latitude"].values.__iadd__(0.1), "fixes", "off what lies between"),
        (lambda d: d["n_samples"].values.__isub__(3), "metadata", "samples, not"),
    ],
)
def test_damage_is_found_and_named(imported, tmp_path, damage, check, words):
    data = imported.copy(deep=True).pad(time=(0, 1))
    data["time"] = ("time", PERIOD * np.arange(data.sizes["time"]), imported["time"].attrs)
    damage(data)
    report = verify_logs(LogStore(write_store(data, tmp_path / "bad.zarr")))
    found = {c.name: c.problems for c in report.checks if c.problems}
    assert check in found, found
    assert any(words in problem for problem in found[check]), found


def test_an_unreadable_chunk_is_named(imported, tmp_path):
    path = write_store(imported, tmp_path / "cut.zarr")
    for chunk in (path / "measured_roll" / "c").rglob("*"):
        if chunk.is_file():
            chunk.write_bytes(b"cut")
    chunks = next(c for c in verify_logs(LogStore(path)).checks if c.name == "chunks")
    assert chunks.problems
    assert "measured_roll of mission 0 cannot be read" in chunks.problems[0]


def test_a_log_is_not_replayed(store, capsys):
    code, _, err = call(capsys, "verify", store, "--replay", "0")
    assert code == 2
    assert len(err.strip().splitlines()) == 1
    assert "logs of real vehicles, which cannot be flown again" in err
    with pytest.raises(StoreError, match="cannot be flown again"):
        GeneratedStore(store)


def test_both_kinds_of_store_are_opened(store, paper_store):
    assert isinstance(open_missions(store), LogStore)
    assert isinstance(open_missions(paper_store), GeneratedStore)


def test_the_page_shows_where_how_deep_and_how(store, tmp_path, capsys):
    logs = LogStore(store)
    figure = deployment_page(logs, "unit1")
    assert "unit1" in figure.get_suptitle()
    assert "2023-11-14" in figure.get_suptitle()
    titles = {axes.get_title(loc="left") for axes in figure.axes}
    assert {"GPS fixes and dives", "depth of all dives", "pitch, median"} <= titles
    figures = dive_figures(logs, [0, 1, 2])
    rate = 100.0 * FLIGHT.speed * np.sin(np.radians(FLIGHT.pitch))
    np.testing.assert_allclose(figures["sink"], rate, rtol=0.01)
    np.testing.assert_allclose(figures["pitch_up"], FLIGHT.pitch, atol=0.01)
    np.testing.assert_allclose(figures["deepest"], FLIGHT.depth, rtol=0.02)
    code, out, _ = call(capsys, "plot", store, "--out", tmp_path / "page.png")
    assert code == 0
    assert (tmp_path / "page.png").stat().st_size > 10_000
    assert "page.png" in out


def test_currents_are_drawn_and_pages_are_named_by_deployment(tmp_path, capsys):
    for name in ("SG1", "SG2"):
        (tmp_path / name).mkdir()
    files = [f for n in ("SG1", "SG2") for f in write_seaglider(tmp_path / n, FLIGHT, n)]
    path = stored(tmp_path / "two.zarr", "seaglider", files)
    logs = LogStore(path)
    missions = logs.missions_of(logs.deployments[0])
    theirs = averaged(logs, missions, THEIRS)
    np.testing.assert_allclose(theirs, [(FLIGHT.north, FLIGHT.east)] * len(missions), atol=1e-6)
    page = deployment_page(logs, logs.deployments[0])
    page.draw_without_rendering()
    arrows = [c for c in page.axes[0].collections if isinstance(c, Quiver)]
    shown = [np.column_stack([one.V, one.U]) for one in arrows]
    ours = averaged(logs, missions, OURS)
    for found, drawn in zip((ours, theirs), shown, strict=True):
        np.testing.assert_allclose(drawn, found, atol=1e-6)
    texts = [text.get_text() for axes in page.axes for text in axes.texts]
    for name in ("ours", "base station's"):
        assert any(text.endswith(f" cm/s, {name}") for text in texts)
    (west, east), (south, north) = page.axes[0].get_xlim(), page.axes[0].get_ylim()
    for one in arrows:
        assert (((west, south) < one.XY) & ((east, north) > one.XY)).all()
    code, out, _ = call(capsys, "plot", path, "--json")
    assert code == 0
    assert sorted(Path(p).name for p in json.loads(out)["pages"]) == ["two-SG1.png", "two-SG2.png"]


def test_currents_are_judged_by_the_profiler(imported, tmp_path):
    given = {"dac": (0.1, 0.0), "vehicle_dac": (0.1, 0.3)}
    data = imported.assign(
        {
            f"{kind}_{axis}": ("mission", np.full(3, value))
            for kind, pair in given.items()
            for axis, value in zip(("north", "east"), pair, strict=True)
        }
    )
    for axis, value in (("north", 0.1), ("east", 0.04)):
        data[f"true_current_{axis}"] = xr.full_like(data["measured_depth"], value)
    logs = LogStore(write_store(data, tmp_path / "currents.zarr"))
    errors = current_errors(logs, [0, 1, 2])
    assert list(errors) == ["ours", "vehicle's own"]
    assert errors["ours"] == pytest.approx(0.04, abs=1e-6)
    assert errors["vehicle's own"] == pytest.approx(0.26, abs=1e-6)
    page = deployment_page(logs, "unit1")
    (said,) = [t.get_text() for a in page.axes for t in a.texts if "profiler" in t.get_text()]
    assert said == "error against the profiler [m/s]: ours 0.040, vehicle's own 0.260"
    assert current_errors(LogStore(write_store(imported, tmp_path / "none.zarr")), [0, 1, 2]) == {}


def test_info_lists_deployments(store, capsys):
    code, out, _ = call(capsys, "info", store)
    assert code == 0
    assert "slocum: unit1" in out
    assert "measured_density" in out
    assert "2023-11-14" in out


@pytest.mark.parametrize("words", [["info"], ["plot"], ["export", "--to", "parquet"]])
def test_an_array_that_is_gone_is_named(words, store, tmp_path, capsys):
    cut = tmp_path / "cut.zarr"
    shutil.copytree(store, cut)
    shutil.rmtree(cut / "measured_pitch")
    code, _, err = call(capsys, words[0], cut, *words[1:])
    assert code == 2
    assert err.strip().endswith("is damaged: its array measured_pitch is gone; make it again")
    (cut / "zarr.json").write_text("{broken")
    code, _, err = call(capsys, words[0], cut, *words[1:])
    assert code == 2
    assert "is damaged: its zarr.json cannot be read" in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("missions", "message"), [(["0", "0"], "mission 0 twice"), ([], "needs a number")]
)
def test_each_exported_mission_is_named_once(missions, message, store, capsys):
    code, _, err = call(capsys, "export", store, "--to", "parquet", "--mission", *missions)
    assert code == 2
    assert message in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["plot", "STORE", "--out", "foo.xyz"], "--out foo.xyz: the ending must be one of .png"),
        (["generate", "--resume", "--out", "STORE"], "holds logs of real vehicles"),
    ],
)
def test_what_a_log_cannot_be_asked_is_told(words, message, store, capsys):
    code, _, err = call(capsys, *(store if word == "STORE" else word for word in words))
    assert code == 2
    assert message in err
    assert len(err.splitlines()) == 1


def test_a_log_is_no_file_of_tracks(store):
    refused(r"is a store of missions, not a file of dead-reckoned", store, by=read_tracks)


def test_verify_names_an_array_that_is_gone(store, tmp_path):
    cut = tmp_path / "cut.zarr"
    shutil.copytree(store, cut)
    shutil.rmtree(cut / "measured_pitch")
    report = verify_logs(LogStore(cut))
    assert not report.ok
    assert report.checks[0].problems == ["array 'measured_pitch' is gone"]
