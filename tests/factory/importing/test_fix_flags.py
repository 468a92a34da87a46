"""Positions that a log itself calls no fix: each kind of log has its own flag."""

import csv

import netCDF4
import numpy as np
import pytest
from logs import slocum

from factory.importing import import_logs
from factory.importing.gps_fixes import has_fix
from factory.samples import Flight, add_variables, write_csv
from factory.samples.archives import write_og1, write_pyglider
from factory.samples.gliders import (
    gps_columns,
    write_basestation,
    write_seaexplorer,
)

FLIGHT = Flight(depth=100.0, surface=600.0)
OFF = 0.004
"""[degree] north of its place by which what is no fix is wrong: 445 m"""


def check(dataset, *, rows=FLIGHT.dives, metres=40.0):
    """Every dive begins and ends where the vehicle was, to what it drifts in some minutes."""
    assert dataset.sizes["mission"] == rows
    for number in range(rows):
        start, end = FLIGHT.dive_times(number)
        places = np.array(FLIGHT.position(np.array([start, end])))
        moved = (places[0, 1] - places[0, 0]) * 111.2e3
        assert dataset["displacement_north"].values[number] == pytest.approx(moved, abs=metres)


def surfaced(time):
    """Whether a time is within the first 30 s after a dive."""
    ends = np.array([FLIGHT.dive_times(k)[1] for k in range(FLIGHT.dives)])
    return ((time[:, None] >= ends) & (time[:, None] < ends + 30.0)).any(axis=1)


def seaexplorer(folder, flags):
    """Its first rows at the surface hold the reckoned place; flags of state and `surfaced`."""
    path = write_seaexplorer(folder / "sea009_M3_gli.csv", FLIGHT)
    with path.open() as file:
        names, *rows = csv.reader(file)
    columns = {name: [row[k] for row in rows] for k, name in enumerate(names)}
    time = FLIGHT.time[0] + 10.0 * np.arange(len(rows))
    old = surfaced(time)
    latitude = np.array(columns["Lat"], float)
    # it reckons on, some metres a row
    columns["Lat"] = latitude + np.where(old, 60.0 * OFF + 0.002 * np.arange(len(rows)) % 0.01, 0.0)
    states = np.array(columns["NavState"], int)
    columns["DeadReckoning"] = flags(states, old)
    write_csv(path, columns)


def test_a_seaexplorers_flag_says_what_a_fix_is(tmp_path):
    seaexplorer(tmp_path, lambda state, old: np.where((state == 116) & ~old, 0, 1))
    dataset, report = import_logs("seaexplorer", [tmp_path])
    check(dataset)
    assert "DeadReckoning" not in str(report.names["navigation log"].get("not read"))
    for number in range(FLIGHT.dives):
        north = dataset["end_latitude"].values[number]
        came_up = FLIGHT.position(np.array([FLIGHT.dive_times(number)[1] + 60.0]))
        assert north == pytest.approx(came_up[0][0], abs=2e-4)


@pytest.mark.parametrize("constant", [0, 1])
def test_a_flag_that_never_changes_adds_no_fix(tmp_path, constant):
    """Of 1 throughout nothing is a fix; of 0 throughout nobody kept it, and the state decides."""
    seaexplorer(tmp_path, lambda state, old: np.full(len(state), constant))
    _, report = import_logs("seaexplorer", [tmp_path])
    assert (report.count("kept", "GPS fixes") > 0) is (constant == 0)
    if constant:
        assert report.rows_with_fixes == 0


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [("quality", 1, 6), ("fix_quality", 2, 0), ("hdop", 0.9, 99.9), ("num_satellites", 7, 0)],
)
def test_what_a_receiver_says_beside_its_places(tmp_path, name, good, bad):
    gps = gps_columns(FLIGHT)
    old = surfaced(gps["time"])
    gps["lat"] = gps["lat"] + np.where(old, OFF, 0.0)
    gps[name] = np.where(old, bad, good)
    dataset, report = slocum(tmp_path, FLIGHT, gps=gps)
    check(dataset)
    removed = [e.count for e in report.entries if "says that it has none" in e.detail]
    assert removed == [int(old.sum())]


def test_columns_of_a_receiver():
    quality = np.array([0.0, 1.0, 2.0, 6.0, 7.0, 8.0, np.nan])
    assert has_fix({"Quality": quality}, 7).tolist() == [False, True, True] + [False] * 3 + [True]
    assert has_fix({"hdop": np.array([0.8, 99.0, 99.9])}, 3).tolist() == [True, False, False]
    # a vehicle that does not count its satellites
    assert has_fix({"satellites": np.zeros(3)}, 3).all()
    assert has_fix({"satellites": np.array([0.0, 8.0])}, 2).tolist() == [False, True]
    assert has_fix({"status": np.zeros(2)}, 2).all()


@pytest.mark.parametrize("flag", ["hdop", "qc"])
def test_a_seaglider_without_a_fix(tmp_path, flag):
    """The receiver's HDOP of 99, or the base station's flag: the fix after the first dive is none,
    and the one before the second dive ends it."""
    first, *_ = write_basestation(tmp_path, FLIGHT)
    with netCDF4.Dataset(first, "a") as file:
        file["log_gps_lat"][2] += OFF
        if flag == "hdop":
            file.createVariable("log_gps_hdop", "f8", ("gps_info",))[:] = [0.8, 0.9, 99.0]
        else:
            file.createVariable("log_gps_qc", "S1", ("gps_info",))[:] = [b"1", b"1", b"9"]
    dataset, report = import_logs("seaglider", [tmp_path])
    assert report.count("removed", "GPS fixes") == 1
    check(dataset, metres=60.0)


@pytest.mark.parametrize("flag", ["number", "letter", "reckoned"])
def test_og1_flags_of_a_fix(tmp_path, flag):
    path = write_og1(tmp_path / "deployment.nc", FLIGHT)
    old = surfaced(FLIGHT.time)
    with netCDF4.Dataset(path, "a") as file:
        file["LATITUDE_GPS"][:] = file["LATITUDE_GPS"][:] + np.where(old, OFF, 0.0)
        under = FLIGHT.state(FLIGHT.time)["under"] > 0
        name, values = {
            "number": ("LATITUDE_GPS_QC", np.where(old, 8, 1).astype("i1")),
            "letter": ("LATITUDE_GPS_QC", np.where(old, b"9", b"1")),
            "reckoned": ("DEAD_RECKONING", (under | old).astype("i1")),
        }[flag]
        add_variables(file, {name: (("N_MEASUREMENTS",), values)})
    dataset, _ = import_logs("og1", [path])
    check(dataset)


def test_pyglider_keeps_a_seaexplorers_flag(tmp_path):
    path = write_pyglider(tmp_path / "series.nc", FLIGHT)
    under = FLIGHT.state(FLIGHT.time)["under"] > 0
    old = surfaced(FLIGHT.time)
    with netCDF4.Dataset(path, "a") as file:
        file["latitude"][:] = FLIGHT.position(FLIGHT.time)[0] + np.where(old, OFF, 0.0)
        file["longitude"][:] = FLIGHT.position(FLIGHT.time)[1]
        flags = (("time",), np.where(under | old, 1.0, 0.0), {"source": "DeadReckoning"})
        add_variables(file, {"dead_reckoning": flags})
    dataset, report = import_logs("ngdac", [path])
    check(dataset)
    assert any("fixes by DeadReckoning" in entry.detail for entry in report.entries)


def test_a_mapping_names_the_column_that_says_a_fix(tmp_path):
    time = FLIGHT.time
    state = FLIGHT.state(time)
    latitude, longitude = FLIGHT.position(time)
    old = surfaced(time)
    seen = state["under"] == 0.0
    path = write_csv(
        tmp_path / "run.csv",
        {
            "t": time, "z": state["depth"], "lat": latitude + np.where(old, OFF, 0.0),
            "lon": longitude, "mode": np.where(seen & ~old, 3, 0),
        },
    )  # fmt: skip
    mapping = tmp_path / "mine.toml"
    mapping.write_text(
        'vehicle = "x"\nrows = "dives"\n[time]\ncolumn = "t"\nunit = "s"\n[signals]\n'
        'measured_depth = { column = "z", unit = "m" }\n'
        'gps_latitude = { column = "lat", unit = "deg" }\n'
        'gps_longitude = { column = "lon", unit = "deg" }\n'
        'gps_fix = { column = "mode" }\n'
    )
    dataset, report = import_logs("csv", [path], mapping=mapping)
    check(dataset)
    why = "the receiver says that it has none"
    removed = [e.count for e in report.entries if (e.subject, e.detail) == ("GPS fixes", why)]
    assert sum(removed) == int((~seen | old).sum())
