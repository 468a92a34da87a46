"""Import: what happens at the surface: fixes, offsets of depth, drift, and the dive's current."""

import numpy as np
import pytest
from logs import part, slocum, why

from factory.importing import import_logs
from factory.importing.columns import read_table
from factory.importing.deployment_log import Channel
from factory.importing.dives.segments import longest_stretch
from factory.importing.plausibility import DiveRules
from factory.samples import Flight, write_csv
from factory.samples.gliders import (
    gps_columns,
    slocum_columns,
    write_seaexplorer,
    write_seaglider,
    write_slocum,
)

FLIGHT = Flight()
METRES = 1.0 / 111_200.0
"""[degree] of latitude in a metre"""


def fixes_when(flight, use):
    """The fixes whose time since the stay at the surface began is used [s]."""
    gps = gps_columns(flight)
    return part(gps, use((gps["time"] - gps["time"][0]) % flight.cycle))


def at_both_ends(flight):
    """Fixes when it comes up and before it dives."""
    return fixes_when(flight, lambda t: (t < 200.0) | (t > flight.surface - 200.0))


def with_late_fixes(flight, dive, speed, count):
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


def test_a_receiver_that_races_on_under_water_gives_no_fix(tmp_path):
    right, _ = slocum(tmp_path, FLIGHT)
    dataset, report = slocum(tmp_path, FLIGHT, gps=with_late_fixes(FLIGHT, 1, 5.7, 5))
    assert why(report, "removed", "constant velocity") == 5
    assert report.rows == FLIGHT.dives
    for name in ("displacement_north", "displacement_east", "surface_drift_north"):
        assert np.allclose(dataset[name], right[name], equal_nan=True), name
    assert float(dataset["measured_depth"][1, 0]) < 1.0


def test_a_slow_receiver_under_water_is_counted_or_refused(tmp_path):
    paths = write_slocum(tmp_path, FLIGHT, gps=with_late_fixes(FLIGHT, 1, 0.5, 6))
    dataset, report = import_logs("slocum", paths)
    start, _ = FLIGHT.dive_times(1)
    assert float(dataset["start_time"][1]) > start
    # 0.175 m/s downward: the last four are deeper than 2 m
    kept = why(report, "note", "kept")
    assert 1 <= kept <= 6
    strict, report = import_logs("slocum", paths, rules=DiveRules(coast=0.0))
    assert why(report, "removed", "under water") == kept
    assert float(strict["measured_depth"][1, 0]) <= 2.0
    assert report.rows == FLIGHT.dives


def test_most_fixes_under_water_mean_another_clock(tmp_path):
    flight = Flight(dives=12)
    # keep short stays only, so that an hour puts them under water
    gps = fixes_when(flight, lambda since: (since > 20.0) & (since < 60.0))
    gps["time"] = gps["time"] + 3600.0
    _, report = slocum(tmp_path, flight, gps=gps)
    assert report.count("suspect", "GPS fixes") > 0
    assert why(report, "suspect", "Fixes 1 h earlier would fit") > 0


@pytest.mark.parametrize("offset", [6.2, -1.4])
def test_an_offset_at_the_surface_is_taken_off(tmp_path, offset):
    right, _ = slocum(tmp_path, FLIGHT, m_pressure=None)
    depth = slocum_columns(FLIGHT)["m_depth"] + offset
    dataset, report = slocum(tmp_path, FLIGHT, m_pressure=None, m_depth=depth)
    assert why(report, "repaired", "depth offset") == len(FLIGHT.time)
    assert report.rows == FLIGHT.dives
    for name in ("measured_depth", "measured_pressure", "measured_phase", "displacement_north"):
        assert np.allclose(dataset[name], right[name], atol=0.05, equal_nan=True), name


def test_an_offset_that_drifts_is_followed_and_a_wild_one_is_left(tmp_path):
    flight = Flight(dives=8)
    time = flight.time
    depth = slocum_columns(flight)["m_depth"]
    slow = 1.0 + 0.6 * (time - time[0]) / np.ptp(time)
    dataset, report = slocum(tmp_path, flight, m_pressure=None, m_depth=depth + slow)
    assert why(report, "repaired", "depth offset") == len(time)
    assert np.nanmax(np.abs(dataset["measured_depth"].values[:, 0])) < 0.2
    cycle = flight.state(time)["dive"]
    wild = np.random.default_rng(2).uniform(-2.0, 2.0, 20)[cycle.astype(int)]
    _, report = slocum(tmp_path, flight, m_pressure=None, m_depth=depth + wild)
    assert why(report, "repaired", "depth offset") == 0


def test_small_waves_and_a_hanging_seaglider_have_no_offset(tmp_path):
    waves = 0.3 * np.abs(np.sin(FLIGHT.time))
    depth = slocum_columns(FLIGHT)["m_depth"] + waves
    _, report = slocum(tmp_path, FLIGHT, m_pressure=None, m_depth=depth)
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


def test_seaexplorers_say_themselves_that_they_float(tmp_path):
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


def test_holes_of_the_ctd_are_filled_from_the_vehicles_own_pressure(tmp_path):
    """Above 5 m the CTD is off; the vehicle's sensor is coarser and shows 3 dbar more."""
    columns = slocum_columns(FLIGHT)
    rng = np.random.default_rng(1)
    true = columns["m_pressure"]
    ctd = np.where(columns["m_depth"] > 5.0, true, np.nan)
    coarse = true + 0.3 + 0.01 * rng.standard_normal(len(true))
    dataset, report = slocum(
        tmp_path, FLIGHT, sci_water_pressure=ctd, m_pressure=coarse,
        m_depth=None, sci_water_temp=np.full(len(true), 8.0),
    )  # fmt: skip
    assert why(report, "note", "where sci_water_pressure was silent") > 100
    assert report.rows == FLIGHT.dives
    for row in range(FLIGHT.dives):
        n = int(dataset["n_samples"][row])
        ends = dataset["measured_depth"].values[row, [0, n - 1]]
        assert np.abs(ends).max() < 0.5
        assert (dataset["measured_phase"].values[row, [0, n - 1]] == 0.0).all()
        assert np.nansum(dataset["measured_gap"].values[row, :n]) == 0.0


def test_a_carried_glider_has_no_drift(tmp_path):
    gps = gps_columns(FLIGHT)
    start, _ = FLIGHT.dive_times(0)
    first = gps["time"] < start
    carried = gps["lat"] + np.where(first, 2.8 * (gps["time"] - start) * METRES, 0.0)
    dataset, report = slocum(tmp_path, FLIGHT, gps={**gps, "lat": carried})
    assert report.count("left out", "surface drift") == 1
    assert np.isnan(dataset["surface_drift_north"].values[0])
    assert dataset["surface_drift_north"].values[1:] == pytest.approx(FLIGHT.north, abs=1e-3)


def test_a_log_that_pauses_for_days_says_so(tmp_path):
    paths = write_slocum(tmp_path, FLIGHT)
    pause = 3.0 * 86400.0
    after = FLIGHT.dive_times(1)[0] - 150.0
    for path in paths:
        table = dict(read_table(path).columns)
        table["time"] = np.where(table["time"] > after, table["time"] + pause, table["time"])
        write_csv(path, table)
    dataset, report = import_logs("slocum", paths)
    assert why(report, "note", "silent for 3.0 days") == 1
    # the stay before the second dive began after the pause
    assert float(dataset["surface_duration"][1]) < 300.0


def test_the_current_between_fixes_is_what_the_flight_does_not_explain(tmp_path):
    """The imaginary glider moves along its nose: 3 degree less than the method takes it for."""
    dataset, _ = slocum(tmp_path, FLIGHT)
    rate = FLIGHT.speed * np.sin(np.radians(FLIGHT.pitch))
    flown = FLIGHT.speed * np.cos(np.radians(FLIGHT.pitch))
    excess = flown - rate / np.tan(np.radians(FLIGHT.pitch + 3.0))
    share = 2.0 * FLIGHT.leg / dataset["dive_duration"].values
    course = np.radians(FLIGHT.heading)
    north, east = dataset["dac_north"].values, dataset["dac_east"].values
    assert north == pytest.approx(FLIGHT.north + excess * share * np.cos(course), abs=0.01)
    assert east == pytest.approx(FLIGHT.east + excess * share * np.sin(course), abs=0.01)
    assert "tan" in dataset["dac_north"].attrs["comment"]
    without, _ = slocum(tmp_path, FLIGHT, m_pitch=None)
    assert "dac_north" not in without


def test_a_log_that_ends_below_says_so_and_has_no_current(tmp_path):
    start, end = FLIGHT.dive_times(1)
    gps = gps_columns(FLIGHT)
    gps = part(gps, (gps["time"] > end) | (gps["time"] < start))
    # the rest of the log is gone too, so that the depth is held to the fix
    kept = FLIGHT.time < start + 0.4 * (end - start)
    dataset, report = slocum(tmp_path, FLIGHT, rows=kept, gps=gps)
    assert report.count("note", "incomplete dives") == 1
    assert why(report, "note", ": log ends at") == 1
    assert np.isnan(dataset["dac_north"].values[1])
    assert np.isfinite(dataset["dac_north"].values[0])
    n = int(dataset["n_samples"][1])
    assert dataset["measured_gap"].values[1, n - 1] == 1.0


@pytest.mark.parametrize("zero", [(6.0, 14.0), (14.0, 14.0), (0.0, 0.0)])
def test_stays_at_the_surface_are_no_dives_whatever_the_vehicles_own_sensor_shows(tmp_path, zero):
    """The CTD is silent there, and the other sensor was never zeroed and drifts."""
    flight = Flight(dives=8, depth=120.0, surface=5000.0)
    columns, time = slocum_columns(flight), flight.time
    noise = np.random.default_rng(5).normal(0.0, 0.05, len(time))
    drift = np.interp(time, time[[0, -1]], zero)
    dataset, report = slocum(
        tmp_path,
        flight,
        gps=at_both_ends(flight),
        m_depth=None,
        m_pressure=columns["m_pressure"] + 0.1 * (drift + noise),
        sci_water_pressure=np.where(columns["m_depth"] > 5.0, columns["m_pressure"], np.nan),
    )
    assert report.rows == report.rows_with_fixes == flight.dives
    assert dataset["dive_duration"].values == pytest.approx(2.0 * flight.leg, abs=20.0)
    assert np.abs(dataset["measured_depth"].values[:, 0]).max() < 2.0
    assert report.count("removed", "GPS fixes") == 0


@pytest.mark.parametrize(("again", "word"), [(False, "no value yet"), (True, "no new one yet")])
def test_what_a_restarted_sensor_writes_first_is_removed_and_so_are_spikes(again, word, tmp_path):
    """After a restart it is 0 or an old value; with a hole on both sides it parted the log."""
    flight = Flight(dives=6, depth=180.0, speed=0.5, pitch=40.0)
    columns, time = slocum_columns(flight), flight.time
    right, _ = slocum(tmp_path, flight, m_depth=None)
    bottom = flight.dive_times(2)[0] + flight.leg
    keep = np.abs(time - bottom) > 80.0
    alone = int(np.argmin(np.abs(time - bottom)))
    keep[alone] = True  # in the hole
    before = np.flatnonzero(keep[:alone])[-1]
    if again:  # at the surface, the depth from before the hole
        since = time > bottom
        columns["m_pressure"] = np.where(since, 0.02, columns["m_pressure"])
    first = columns["m_pressure"][before] if again else 0.0
    pressure = np.where(np.abs(time - bottom) <= 2.0, first, columns["m_pressure"])
    spike = np.flatnonzero(columns["m_depth"] > 50.0)[3]
    pressure[spike] += 9.0
    dataset, report = slocum(tmp_path, flight, rows=keep, m_pressure=pressure, m_depth=None)
    assert report.count("suspect", "m_pressure") == 0
    assert why(report, "removed", word) == 1
    assert why(report, "removed", "changes faster") == 1
    if again:
        return
    assert report.rows == flight.dives
    off = np.abs(dataset["measured_depth"].values - right["measured_depth"].values)
    assert np.nanmax(np.delete(off, 2, axis=0)) < 0.5
    assert np.nanmax(off[2]) < 30.0  # the hole is bridged, not filled with the surface


def test_a_log_that_is_silent_for_hours_between_two_fixes_is_no_dive_of_hours(tmp_path):
    """Files are missing: nobody knows whether it surfaced, and one row of all is no dive."""
    flight = Flight(dives=12, depth=90.0)
    start, end = flight.dive_times(2)[0] + 200.0, flight.dive_times(9)[0] + 200.0
    gps = gps_columns(flight)
    keep, fixes = ((time < start) | (time > end) for time in (flight.time, gps["time"]))
    dataset, report = slocum(tmp_path, flight, rows=keep, gps=part(gps, fixes))
    assert float(dataset["dive_duration"].max()) < 1.1 * flight.cycle
    assert report.rows_with_fixes == 4
    assert report.rows == 6
    assert why(report, "note", "neither depth nor attitude is known for 3600 s") == 1


def test_regular_sparse_sampling_at_depth_is_no_gap_and_a_hole_is_one(tmp_path):
    flight = Flight(dives=2, depth=150.0)
    columns = slocum_columns(flight)
    since = (columns["time"] - columns["time"][0]).astype(int)
    deep = columns["m_depth"] > 40.0
    keep = ~deep | (since % 60 == 0)
    dataset, _ = slocum(tmp_path, flight, rows=keep)
    assert np.nanmean(dataset["measured_gap"]) < 0.02
    middle = flight.dive_times(1)[0] + 0.6 * flight.leg
    keep &= np.abs(columns["time"] - middle) > 200.0
    dataset, _ = slocum(tmp_path, flight, rows=keep)
    assert np.nansum(dataset["measured_gap"][0]) < 12
    assert 120 < np.nansum(dataset["measured_gap"][1]) < 260


def test_raw_times_stand_beside_the_grid(tmp_path):
    flight = Flight(dives=1, step=7.0)
    dataset, _ = slocum(tmp_path, flight)
    n = int(dataset["n_samples"][0])
    raw = dataset["measured_depth_time"].values[0, :n].astype(float)
    grid = dataset["time"].values[:n]
    assert np.abs(raw - grid).max() <= 3.5 + 1e-3
    start = float(dataset["start_time"].values.astype(float)[0])
    original = np.unique(np.round(raw, 3)) + start
    assert np.abs(original[:, None] - flight.time[None]).min(axis=1).max() < 1e-2
    exact = np.abs(raw - grid) < 1e-6
    assert exact.sum() > 10
    truth = flight.state(start + grid[exact])["depth"]
    assert np.abs(dataset["measured_depth"].values[0, :n][exact] - truth).max() < 0.5


def test_waypoints_and_the_current_that_the_vehicle_uses_are_signals(tmp_path):
    time = FLIGHT.time
    there = np.full(len(time), np.nan)
    latitude, longitude, east, north = (there.copy() for _ in range(4))
    first, second = (int(np.argmin(np.abs(time - FLIGHT.dive_times(k)[0]))) for k in (0, 1))
    latitude[[2, second - 5]] = 0.0, 4936.0  # not set yet, then 49 deg 36 min
    longitude[[2, second - 5]] = 0.0, -5800.0
    east[second - 8], north[second - 8] = 0.1, 0.2
    paths = write_slocum(
        tmp_path, FLIGHT, c_wpt_lat=latitude, c_wpt_lon=longitude, m_water_vx=east, m_water_vy=north
    )
    dataset, report = import_logs("slocum", paths, variation_deg=0.0)
    waypoint = dataset["commanded_waypoint_north"].values
    n = dataset["n_samples"].values
    assert np.isnan(waypoint[0]).all()
    place = float(dataset["start_latitude"][1])
    assert waypoint[1, : n[1]] == pytest.approx((49.6 - place) / METRES, rel=5e-3)
    assert np.isnan(dataset["measured_current_north"].values[0]).all()
    assert dataset["measured_current_north"].values[2, : n[2]] == pytest.approx(0.2)
    assert dataset["measured_current_east"].values[2, : n[2]] == pytest.approx(0.1)
    assert why(report, "removed", "no waypoint yet") == 1
    assert first < second


def test_single_depths_of_a_noisy_sensor_at_the_surface_are_no_dive(tmp_path):
    """Air and waves pass it: some samples show 5 to 13 m, which neighbours can just reach."""
    flight = Flight(dives=6, depth=60.0, surface=2000.0)
    depth = slocum_columns(flight)["m_depth"].copy()
    for dive in range(flight.dives):
        start, _ = flight.dive_times(dive)
        at = np.searchsorted(flight.time, start - 1000.0)
        depth[[at, at + 40, at + 41, at + 42, at + 80]] = 11.0, 6.0, 11.0, 7.0, 5.5
    dataset, report = slocum(
        tmp_path, flight, gps=at_both_ends(flight), m_pressure=None, m_depth=depth
    )
    assert report.rows == report.rows_with_fixes == flight.dives
    assert dataset["dive_duration"].values == pytest.approx(2.0 * flight.leg, abs=20.0)
    assert why(report, "left out", "deeper than 5 m for less than 30 s") == 5 * flight.dives


def test_two_depths_of_a_restarted_sensor_are_no_dive():
    """Every 15 s, with 40 min before and behind them, as modena wrote in 2016; not every 60 s."""
    surface = np.arange(0.0, 60.0, 15.0)
    time = np.concatenate([surface, 2400.0 + np.arange(0.0, 60.0, 15.0), 5000.0 + surface])
    depth = np.zeros(12)
    depth[[5, 6]] = 10.1, 11.9
    assert longest_stretch(Channel(time, depth), 5.0) == 0.0
    depth[7] = 6.0
    assert longest_stretch(Channel(time, depth), 5.0) > 30.0
    rare = np.arange(0.0, 600.0, 60.0)
    assert longest_stretch(Channel(rare, np.where(rare == 300.0, 12.0, 0.0)), 5.0) == 60.0


def test_dives_without_science_are_filled_from_the_depth_of_a_satellite_file(tmp_path):
    """It has no pressure of the vehicle's own; the CTD wakes once and shows what it had last."""
    flight = Flight(dives=12)
    columns = slocum_columns(flight)
    start, end = flight.dive_times(1)
    off = (flight.time > start - 100.0) & (flight.time < end + 100.0)
    ctd = np.where(off, np.nan, columns["m_pressure"])
    ctd[np.searchsorted(flight.time, start + 100.0)] = 0.4
    dataset, report = slocum(
        tmp_path, flight, sci_water_pressure=ctd, m_pressure=None,
        sci_water_temp=np.where(off, np.nan, 8.0),
    )  # fmt: skip
    assert why(report, "note", "from m_depth where sci_water_pressure was silent") > 100
    assert report.rows == flight.dives
    n = int(dataset["n_samples"][1])
    times = float(dataset["start_time"][1]) + dataset["time"].values[:n]
    apart = np.abs(dataset["measured_depth"].values[1, :n] - flight.state(times)["depth"])
    assert np.percentile(apart, 99.0) < 0.5
    assert float(dataset["measured_gap"][1].sum()) == 0.0


def test_one_wrong_sample_beside_a_step_takes_no_days_with_it(tmp_path):
    """A spike that the sample after it can reach parted the log: the shorter part was removed."""
    flight = Flight(dives=6, depth=60.0, surface=600.0)
    depth = slocum_columns(flight)["m_depth"].copy()
    start, _ = flight.dive_times(4)
    at = int(np.searchsorted(flight.time, start - 300.0))
    depth[at] = 13.0  # 4 m + 2 m/s cannot reach it in 4 s ...
    keep = (flight.time <= flight.time[at]) | (flight.time > flight.time[at] + 40.0)  # ... or can
    _, report = slocum(tmp_path, flight, rows=keep, m_depth=depth, m_pressure=None)
    assert report.count("removed", "m_depth") == 1
    assert report.rows == flight.dives
