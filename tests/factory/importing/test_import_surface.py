"""Import: what happens at the surface: fixes, offsets of depth, drift, and the dive's current."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logs import (
    SHARED,
    Flight,
    gps_columns,
    slocum_columns,
    write_csv,
    write_seaexplorer,
    write_seaglider,
    write_slocum,
)

from factory.importing import import_logs
from factory.importing.reading.columns import read_table
from factory.importing.repairs.dive_rules import DiveRules

FLIGHT = Flight()
UNIT334 = SHARED / "slocum_unit334_2023"
COMET = SHARED / "slocum_comet_dvl_2016"
EXPLORER = SHARED / "seaexplorer_pyglider"
METRES = 1.0 / 111_200.0
"""[degree] of latitude in a metre"""


def why(report: object, action: str, word: str) -> int:
    """Count of the entries of an action whose detail holds a word."""
    return sum(e.count for e in report.entries if e.action == action and word in e.detail)  # type: ignore[attr-defined]


def with_late_fixes(flight: Flight, dive: int, speed: float, count: int) -> dict[str, np.ndarray]:
    """Fixes that a receiver goes on with, north at `speed`, after the glider has dived."""
    gps = gps_columns(flight)
    start, _ = flight.dive_times(dive)
    last = int(np.searchsorted(gps["time"], start)) - 1
    steps = np.arange(1, count + 1)
    time = gps["time"][last] + flight.step * steps
    late = {
        "time": time,
        "lat": gps["lat"][last] + speed * (time - gps["time"][last]) * METRES,
        "lon": np.full(count, gps["lon"][last]),
        "status": np.zeros(count),
        "mag_var_rad": np.full(count, gps["mag_var_rad"][0]),
    }
    return {name: np.insert(values, last + 1, late[name]) for name, values in gps.items()}


def test_a_receiver_that_races_on_under_water_gives_no_fix(tmp_path: Path) -> None:
    right, _ = import_logs("slocum", write_slocum(tmp_path, FLIGHT))
    flight_table, gps_table = write_slocum(tmp_path, FLIGHT)
    write_csv(gps_table, with_late_fixes(FLIGHT, 1, 5.7, 5))
    dataset, report = import_logs("slocum", [flight_table, gps_table])
    assert why(report, "removed", "constant velocity") == 5
    assert report.rows == FLIGHT.dives
    for name in ("displacement_north", "displacement_east", "surface_drift_north"):
        assert np.allclose(dataset[name], right[name], equal_nan=True), name
    assert float(dataset["measured_depth"][1, 0]) < 1.0


def test_a_slow_receiver_under_water_is_counted_or_refused(tmp_path: Path) -> None:
    flight_table, gps_table = write_slocum(tmp_path, FLIGHT)
    write_csv(gps_table, with_late_fixes(FLIGHT, 1, 0.5, 6))
    dataset, report = import_logs("slocum", [flight_table, gps_table])
    start, _ = FLIGHT.dive_times(1)
    assert float(dataset["start_time"][1]) > start
    # 0.175 m/s downward: the last four are deeper than 2 m
    kept = why(report, "note", "kept")
    assert 1 <= kept <= 6
    strict, report = import_logs("slocum", [flight_table, gps_table], rules=DiveRules(coast=0.0))
    assert why(report, "removed", "under water") == kept
    assert float(strict["measured_depth"][1, 0]) <= 2.0
    assert report.rows == FLIGHT.dives


def test_most_fixes_under_water_mean_another_clock(tmp_path: Path) -> None:
    flight = Flight(dives=12)
    flight_table, gps_table = write_slocum(tmp_path, flight)
    gps = gps_columns(flight)
    # keep short stays only, so that an hour puts them under water
    since = (gps["time"] - gps["time"][0]) % flight.cycle
    use = (since > 20.0) & (since < 60.0)
    gps = {name: values[use] for name, values in gps.items()}
    gps["time"] = gps["time"] + 3600.0
    write_csv(gps_table, gps)
    _, report = import_logs("slocum", [flight_table, gps_table])
    assert report.count("suspect", "GPS fixes") > 0
    assert why(report, "suspect", "Fixes 1 h earlier would fit") > 0


@pytest.mark.parametrize("offset", [6.2, -1.4])
def test_an_offset_at_the_surface_is_taken_off(tmp_path: Path, offset: float) -> None:
    right, _ = import_logs("slocum", write_slocum(tmp_path, FLIGHT, m_pressure=None))
    depth = slocum_columns(FLIGHT)["m_depth"] + offset
    paths = write_slocum(tmp_path, FLIGHT, m_pressure=None, m_depth=depth)
    dataset, report = import_logs("slocum", paths)
    assert why(report, "repaired", "depth offset") == len(FLIGHT.time)
    assert report.rows == FLIGHT.dives
    for name in ("measured_depth", "measured_pressure", "measured_phase", "displacement_north"):
        assert np.allclose(dataset[name], right[name], atol=0.05, equal_nan=True), name


def test_an_offset_that_drifts_is_followed_and_a_wild_one_is_left(tmp_path: Path) -> None:
    flight = Flight(dives=8)
    time = flight.time
    depth = slocum_columns(flight)["m_depth"]
    slow = 1.0 + 0.6 * (time - time[0]) / np.ptp(time)
    paths = write_slocum(tmp_path, flight, m_pressure=None, m_depth=depth + slow)
    dataset, report = import_logs("slocum", paths)
    assert why(report, "repaired", "depth offset") == len(time)
    assert np.nanmax(np.abs(dataset["measured_depth"].values[:, 0])) < 0.2
    cycle = flight.state(time)["dive"]
    wild = np.random.default_rng(2).uniform(-2.0, 2.0, 20)[cycle.astype(int)]
    paths = write_slocum(tmp_path, flight, m_pressure=None, m_depth=depth + wild)
    _, report = import_logs("slocum", paths)
    assert why(report, "repaired", "depth offset") == 0


def test_small_waves_and_a_hanging_seaglider_have_no_offset(tmp_path: Path) -> None:
    waves = 0.3 * np.abs(np.sin(FLIGHT.time))
    depth = slocum_columns(FLIGHT)["m_depth"] + waves
    _, report = import_logs(
        "slocum", write_slocum(tmp_path, FLIGHT, m_pressure=None, m_depth=depth)
    )
    assert why(report, "repaired", "depth offset") == 0
    samples, dives = write_seaglider(tmp_path, Flight(depth=150.0))
    table = read_table(samples)
    columns = {"glider": ["SG999"] * len(table), **table.columns}
    # it hangs upright until it dives: 1.8 m at the sensor
    for name, factor in (("depth_m", 1.0), ("pressure_dbar", 1.0085)):
        columns[name] = np.maximum(columns[name], 1.8 * factor)
    write_csv(samples, columns)
    dataset, report = import_logs("seaglider", [samples, dives])
    assert why(report, "repaired", "depth offset") == 0
    assert dataset["measured_depth"].values[:, 0] == pytest.approx(1.8, abs=0.05)
    assert (dataset["measured_phase"].values[:, 0] == 0.0).all()


def test_seaexplorers_say_themselves_that_they_float(tmp_path: Path) -> None:
    flight = Flight(depth=100.0, variation=17.0, surface=600.0)
    path = write_seaexplorer(tmp_path / "sea009_M3_gli.csv", flight)
    table = read_table(path)
    columns = {"Timestamp": list(table.texts["Timestamp"]), **table.columns}
    columns["Depth"] = columns["Depth"] + 6.24
    columns["Lat"] = np.zeros(len(table))
    columns["Lon"] = np.zeros(len(table))
    write_csv(path, columns)
    dataset, report = import_logs("seaexplorer", [path])
    assert why(report, "repaired", "depth offset 6.24 m") == len(table)
    assert report.rows == flight.dives
    assert report.rows_with_fixes == 0
    assert np.nanmax(dataset["measured_depth"]) == pytest.approx(100.0, abs=1.5)


def test_holes_of_the_ctd_are_filled_from_the_vehicles_own_pressure(tmp_path: Path) -> None:
    """Above 5 m the CTD is off; the vehicle's sensor is coarser and shows 3 dbar more."""
    columns = slocum_columns(FLIGHT)
    rng = np.random.default_rng(1)
    true = columns["m_pressure"]
    ctd = np.where(columns["m_depth"] > 5.0, true, np.nan)
    coarse = true + 0.3 + 0.01 * rng.standard_normal(len(true))
    paths = write_slocum(
        tmp_path, FLIGHT, sci_water_pressure=ctd, m_pressure=coarse,
        m_depth=None, sci_water_temp=np.full(len(true), 8.0),
    )  # fmt: skip
    dataset, report = import_logs("slocum", paths)
    assert why(report, "note", "where sci_water_pressure was silent") > 100
    assert report.rows == FLIGHT.dives
    for row in range(FLIGHT.dives):
        n = int(dataset["n_samples"][row])
        ends = dataset["measured_depth"].values[row, [0, n - 1]]
        assert np.abs(ends).max() < 0.5
        assert (dataset["measured_phase"].values[row, [0, n - 1]] == 0.0).all()
        assert np.nansum(dataset["measured_gap"].values[row, :n]) == 0.0


def test_a_carried_glider_has_no_drift(tmp_path: Path) -> None:
    flight_table, gps_table = write_slocum(tmp_path, FLIGHT)
    gps = gps_columns(FLIGHT)
    start, _ = FLIGHT.dive_times(0)
    first = gps["time"] < start
    carried = gps["lat"] + np.where(first, 2.8 * (gps["time"] - start) * METRES, 0.0)
    write_csv(gps_table, {**gps, "lat": carried})
    dataset, report = import_logs("slocum", [flight_table, gps_table])
    assert report.count("left out", "surface drift") == 1
    assert np.isnan(dataset["surface_drift_north"].values[0])
    assert dataset["surface_drift_north"].values[1:] == pytest.approx(FLIGHT.north, abs=1e-3)


def test_a_log_that_pauses_for_days_says_so(tmp_path: Path) -> None:
    flight_table, gps_table = write_slocum(tmp_path, FLIGHT)
    pause = 3.0 * 86400.0
    after = FLIGHT.dive_times(1)[0] - 150.0
    for path in (flight_table, gps_table):
        table = dict(read_table(path).columns)
        table["time"] = np.where(table["time"] > after, table["time"] + pause, table["time"])
        write_csv(path, table)
    dataset, report = import_logs("slocum", [flight_table, gps_table])
    assert why(report, "note", "silent for 3.0 days") == 1
    # the stay before the second dive began after the pause
    assert float(dataset["surface_duration"][1]) < 300.0


def test_the_current_between_fixes_is_what_the_flight_does_not_explain(tmp_path: Path) -> None:
    """The imaginary glider moves along its nose: 3 degree less than the method takes it for."""
    dataset, _ = import_logs("slocum", write_slocum(tmp_path, FLIGHT))
    rate = FLIGHT.speed * np.sin(np.radians(FLIGHT.pitch))
    flown = FLIGHT.speed * np.cos(np.radians(FLIGHT.pitch))
    excess = flown - rate / np.tan(np.radians(FLIGHT.pitch + 3.0))
    share = 2.0 * FLIGHT.leg / dataset["dive_duration"].values
    course = np.radians(FLIGHT.heading)
    north, east = dataset["dac_north"].values, dataset["dac_east"].values
    assert north == pytest.approx(FLIGHT.north + excess * share * np.cos(course), abs=0.01)
    assert east == pytest.approx(FLIGHT.east + excess * share * np.sin(course), abs=0.01)
    assert "tan" in dataset["dac_north"].attrs["comment"]
    without, _ = import_logs("slocum", write_slocum(tmp_path, FLIGHT, m_pitch=None))
    assert "dac_north" not in without


def test_a_log_that_ends_below_says_so_and_has_no_current(tmp_path: Path) -> None:
    columns = slocum_columns(FLIGHT)
    start, end = FLIGHT.dive_times(1)
    keep = (columns["time"] < start + 0.4 * (end - start)) | (columns["time"] > end + 1.0)
    paths = write_slocum(tmp_path, FLIGHT)
    write_csv(paths[0], {name: values[keep] for name, values in columns.items()})
    table = {n: v[v.size * [True]] for n, v in gps_columns(FLIGHT).items()}
    late = (table["time"] > end) | (table["time"] < start)
    write_csv(paths[1], {n: v[late] for n, v in table.items()})
    # the rest of the log is gone too, so that the depth is held to the fix
    kept = columns["time"] < start + 0.4 * (end - start)
    write_csv(paths[0], {name: values[kept] for name, values in columns.items()})
    dataset, report = import_logs("slocum", paths)
    assert report.count("note", "incomplete dives") == 1
    assert why(report, "note", "dive 1: log ends at") == 1
    assert np.isnan(dataset["dac_north"].values[1])
    assert np.isfinite(dataset["dac_north"].values[0])
    n = int(dataset["n_samples"][1])
    assert dataset["measured_gap"].values[1, n - 1] == 1.0


@pytest.mark.skipif(not UNIT334.is_dir(), reason="needs the shared logs of unit334")
def test_unit334_ends_at_the_surface_in_the_vehicles_current() -> None:
    pytest.importorskip("pyarrow")
    dataset, _ = import_logs("slocum", [UNIT334])
    last = dataset["n_samples"].values - 1
    rows = np.arange(len(last))
    assert np.abs(dataset["measured_depth"].values[rows, last]).max() < 0.5
    assert (dataset["measured_phase"].values[rows, last] == 0.0).all()
    apart = [dataset[f"dac_{a}"].values - dataset[f"vehicle_dac_{a}"].values for a in
             ("north", "east")]  # fmt: skip
    assert np.hypot(*apart).max() < 0.015
    by_hand = {0: (-0.025, 0.019), 3: (-0.007, -0.015), 10: (0.076, 0.008)}
    for row, (north, east) in by_hand.items():
        assert float(dataset["dac_north"][row]) == pytest.approx(north, abs=0.005)
        assert float(dataset["dac_east"][row]) == pytest.approx(east, abs=0.005)


@pytest.mark.skipif(not COMET.is_dir(), reason="needs the shared logs of comet")
def test_comets_racing_receiver_is_dropped() -> None:
    pytest.importorskip("pyarrow")
    dataset, report = import_logs("slocum", [COMET])
    assert why(report, "removed", "constant velocity") == 6
    assert report.rows == 16
    # it lay in a current of 0.2 m/s and dived for ten minutes
    assert np.hypot(dataset["displacement_north"], dataset["displacement_east"]).values[0] < 130.0
    assert float(dataset["measured_depth"][0, 0]) < 1.5
    drift = np.hypot(dataset["surface_drift_north"].values, dataset["surface_drift_east"].values)
    assert np.nanmax(drift) < 1.0


@pytest.mark.skipif(not EXPLORER.is_dir(), reason="needs the shared SeaExplorer logs")
def test_real_seaexplorers_float_at_their_own_zero() -> None:
    for name, rows in (("sea046_M45", 5), ("sea035_M10", 61)):
        dataset, report = import_logs("seaexplorer", [EXPLORER / f"{name}_gli.csv.gz"])
        assert why(report, "repaired", "depth offset") > 0
        assert report.rows == rows
        depth = dataset["measured_depth"].values
        at_fix = np.isfinite(dataset["measured_gps_north"].values)
        assert np.abs(depth[at_fix]).max() < 1.0
        assert (dataset["measured_phase"].values[at_fix] == 0.0).all()
