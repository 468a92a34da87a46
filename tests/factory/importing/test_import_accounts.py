"""The accounts of an import: names, soundness, and times and fixes against the raw files."""

import netCDF4
import numpy as np
import pytest

from benchmarks.real_logs.accounts import Raw, account, fixes_apart, table, times_apart
from factory.importing import import_logs
from factory.importing.gps_fixes import FIXES
from factory.samples import Flight
from factory.samples.archives import write_ngdac, write_og1
from factory.samples.gliders import write_basestation, write_dbd, write_seaexplorer
from glider_twin_protocols.auv_samples import write_mat

FLIGHT = Flight(depth=100.0, surface=600.0)


@pytest.mark.parametrize(
    ("kind", "write", "fixes"),
    [
        ("slocum", write_dbd, 6),
        ("seaglider", write_basestation, 6),
        ("seaexplorer", lambda f, flight: write_seaexplorer(f / "sea009_M3_gli.csv", flight), 6),
        ("lrauv", lambda f, flight: write_mat(f / "log.mat", flight), 6),
        ("ngdac", write_ngdac, 0),
    ],
)
def test_an_import_keeps_times_and_fixes_of_the_raw_files(kind, write, fixes, tmp_path):
    if kind == "slocum":
        pytest.importorskip("dbdreader")
    write(tmp_path, FLIGHT)
    found = account(kind, tmp_path, None)
    assert found["refused"] == ""
    assert found["rows"] == FLIGHT.dives
    assert found["problems"] == 0
    assert found["time_error_s"] < 1e-3
    assert found["fixes_compared"] == fixes
    if fixes:
        assert found["fix_error_m"] < 1e-3
    assert found["read"] > 3
    assert f"| {found['log']} | {kind} | 3, {fixes // 2} |" in table([found])


@pytest.mark.parametrize(
    ("kind", "write"),
    [
        ("slocum", write_dbd),
        ("seaglider", write_basestation),
        ("seaexplorer", lambda f, flight: write_seaexplorer(f / "sea009_M3_gli.csv", flight)),
        ("lrauv", lambda f, flight: write_mat(f / "log.mat", flight)),
        ("og1", lambda f, flight: write_og1(f / "deployment.nc", flight)),
    ],
)
def test_every_fix_that_was_read_is_kept_removed_or_left_out(kind, write, tmp_path):
    if kind == "slocum":
        pytest.importorskip("dbdreader")
    write(tmp_path, FLIGHT)
    dataset, report = import_logs(kind, [tmp_path])
    counts = {what: report.count(what, FIXES) for what in ("kept", "removed", "left out")}
    assert report.count("read", FIXES) == sum(counts.values())
    ends = set(np.round(dataset["start_time"].values, 3))
    ends |= set(np.round(dataset["start_time"].values + dataset["dive_duration"].values, 3))
    assert counts["kept"] == len(ends)


def test_fixes_of_a_long_stay_are_left_out_and_counted(tmp_path):
    path = write_og1(tmp_path / "deployment.nc", FLIGHT)
    with netCDF4.Dataset(path) as file:
        there = ~np.ma.getmaskarray(np.ma.masked_invalid(file["LATITUDE_GPS"][:]))
        there &= ~np.ma.getmaskarray(np.ma.masked_invalid(file["TIME_GPS"][:]))
        total = int(there.sum())
    _, report = import_logs("og1", [path])
    assert report.count("read", FIXES) == total
    kept = report.count("kept", FIXES)
    assert 0 < kept <= 2 * report.rows
    assert report.count("left out", FIXES) == total - kept - report.count("removed", FIXES)


def test_what_the_raw_files_contradict_is_told(tmp_path):
    path = write_og1(tmp_path / "deployment.nc", FLIGHT)
    dataset, _ = import_logs("og1", [path])
    time = FLIGHT.time
    latitude, longitude = FLIGHT.position(time)
    right = np.stack([time, latitude, longitude], axis=1)
    assert times_apart(dataset, Raw(time, right)) < 1e-3
    assert fixes_apart(dataset, Raw(time, right)) == (pytest.approx(0.0, abs=1e-3), 6)
    assert times_apart(dataset, Raw(time[::5] + 0.5, right)) > 1.0
    moved = right + np.array([0.0, 1e-4, 0.0])
    assert fixes_apart(dataset, Raw(time, moved))[0] == pytest.approx(11.1, abs=0.1)
    assert fixes_apart(dataset, Raw(time, right[:5]))[0] == np.inf


def test_a_refused_log_has_its_reason(tmp_path):
    (tmp_path / "a.nc").write_bytes(b"nothing")
    found = account("ngdac", tmp_path, None)
    assert "a.nc" in found["refused"]
    assert "refused: " in table([found])
