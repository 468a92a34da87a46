"""Import of Slocum logs: segments, units, repairs and refusals, on written and on real files."""

import json
import sys

import numpy as np
import pytest
from logs import refused, slocum

from factory.importing import import_logs, sniff
from factory.importing.formats.slocum.caches import read_header, vehicle_of
from factory.samples import START, Flight, write_csv
from factory.samples.gliders import gps_columns, slocum_columns, write_slocum
from twin.errors import InputError
from twin.records.store import open_store, read_trajectory, write_store

FLIGHT = Flight()


def seconds(dataset):
    """Start times as stored, unix seconds."""
    return dataset["start_time"].values.astype(float)


def write_text(path, columns, *, segments=1):
    """A Slocum's data as dbd2asc writes them: header, names, units, sizes, rows."""
    header = {
        "dbd_label": "DBD_ASC(dinkum_binary_data_ascii)file", "encoding_ver": 2,
        "num_ascii_tags": 13 + segments, "all_sensors": 0, "filename": "unit_7-2023-261-0-4-sf",
        "the8x3_filename": "07160004", "filename_extension": "dbd",
        "filename_label": "unit_7-2023-261-0-4-dbd(07160004)", "mission_name": "MICRO.MI",
        "fileopen_time": "Thu_Jul_24_17:03:02_2023", "sensors_per_cycle": len(columns),
        "num_label_lines": 3, "num_segments": segments,
        **{f"segment_filename_{k}": f"unit_7-2023-261-0-{4 + k}" for k in range(segments)},
    }  # fmt: skip
    lines = [f"{key}: {value}" for key, value in header.items()]
    lines += [" ".join(columns), " ".join(["x"] * len(columns)), " ".join(["8"] * len(columns))]
    rows = np.stack(list(columns.values()), axis=1)
    lines += [" ".join("NaN" if np.isnan(v) else f"{v:.12g}" for v in row) for row in rows]
    path.write_text(" \n".join(lines) + " \n")
    return path


@pytest.mark.parametrize("name", ["a.dba", "a.asc", "a.txt", "a.dbd"])
def test_data_as_text_are_read_whatever_they_are_called(tmp_path, name):
    columns = slocum_columns(FLIGHT)
    gps = gps_columns(FLIGHT)
    at = np.isin(columns["time"], gps["time"])
    for sensor, source in (("m_gps_lat", "lat"), ("m_gps_lon", "lon")):
        columns[sensor] = np.full(len(at), np.nan)
        columns[sensor][at] = gps[source]
    columns["m_gps_mag_var"] = np.full(len(at), -np.radians(FLIGHT.variation))
    columns = {"m_present_time": columns.pop("time"), **columns}
    path = write_text(tmp_path / name, columns, segments=3)
    assert sniff(path) == "slocum"
    dataset, report = import_logs("slocum", [path])
    assert report.deployments == ("unit7",)
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    tables, _ = slocum(tmp_path, FLIGHT)
    for signal in ("measured_depth", "measured_pitch", "measured_heading", "measured_pump"):
        np.testing.assert_allclose(dataset[signal], tables[signal], atol=1e-4)
    whole = path.read_text()
    path.write_text(whole[:-30])
    _, report = import_logs("slocum", [path])
    assert any(e.detail.startswith("truncated: ") for e in report.entries)
    path.write_text(whole[:200])
    refused("truncated within its header", "slocum", [path])
    lines = whole.splitlines()
    path.write_text("\n".join([*lines[:30], "1 2 3", *lines[30:]]))
    refused("has 3 numbers, and 12 sensors are named", "slocum", [path])


def test_a_saw_tooth_comes_back_with_its_dives_displacements_and_units(tmp_path):
    dataset, report = slocum(tmp_path, FLIGHT)
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    for dive in range(FLIGHT.dives):
        begins, ends = FLIGHT.dive_times(dive)
        row = dataset.isel(mission=dive)
        start, duration = float(seconds(dataset)[dive]), float(row["dive_duration"])
        assert begins - FLIGHT.step <= start <= begins
        assert ends <= start + duration <= ends + FLIGHT.step
        moved = FLIGHT.displacement(start, start + duration)
        assert float(row["displacement_north"]) == pytest.approx(moved[0], abs=0.05)
        assert float(row["displacement_east"]) == pytest.approx(moved[1], abs=0.05)
        n = int(row["n_samples"])
        time = start + dataset["time"].values[:n]
        truth = FLIGHT.state(time)
        # the tips of the saw-tooth lie between samples
        near = np.abs(row["measured_depth"].values[:n] - truth["depth"])
        assert near.max() < 0.5 * FLIGHT.step * 0.4
        assert np.median(near) < 0.1
        steady = (truth["depth"] > 3.0) & (truth["depth"] < FLIGHT.depth - 3.0)
        assert np.allclose(
            row["measured_pitch"].values[:n][steady], truth["pitch"][steady], atol=1e-3
        )
        assert np.allclose(row["measured_heading"].values[:n], FLIGHT.heading, atol=1e-3)
        assert np.allclose(row["measured_pump"].values[:n][steady], truth["pump"][steady])
        assert np.allclose(row["measured_fin"].values[:n], np.degrees(0.1), atol=1e-3)
        # + battery position is forward, which lowers the nose
        shift = row["measured_shift"].values[:n][steady]
        assert np.allclose(shift, np.where(truth["pitch"][steady] < 0, 0.4, -0.4) * 0.0254)
        gps = row["measured_gps_north"].values[:n]
        assert np.flatnonzero(np.isfinite(gps)).tolist() == [0, n - 1]
        assert gps[0] == 0.0
        assert gps[-1] == pytest.approx(moved[0], abs=0.05)
        assert float(row["magnetic_variation"]) == pytest.approx(FLIGHT.variation)
    # three fixes of the drift before each dive tell the surface current
    assert dataset["surface_drift_north"].values[1:] == pytest.approx(FLIGHT.north, abs=1e-3)
    assert dataset["surface_drift_east"].values[1:] == pytest.approx(FLIGHT.east, abs=1e-3)
    assert dataset["surface_duration"].values[1:] == pytest.approx(FLIGHT.surface, abs=10.0)
    assert "measured_density" not in dataset
    assert report.count("missing", "measured_density") == 1


def test_phases_follow_the_dive(tmp_path):
    dataset, _ = slocum(tmp_path, FLIGHT)
    phase = dataset["measured_phase"].values[0, : int(dataset["n_samples"][0])]
    time = float(seconds(dataset)[0]) + dataset["time"].values[: len(phase)]
    truth = FLIGHT.state(time)
    away = np.abs(truth["depth"] - FLIGHT.depth) > 5.0
    deep = truth["depth"] > 5.0
    assert set(phase[deep & away & (truth["pitch"] < 0)]) == {1.0}
    assert set(phase[deep & away & (truth["pitch"] > 0)]) == {2.0}
    assert phase[0] == phase[-1] == 0.0


def test_disorder_repeats_gaps_spikes_and_sentinels_are_repaired_and_counted(tmp_path):
    clean, _ = slocum(tmp_path, FLIGHT)
    broken = slocum_columns(FLIGHT)
    n = len(broken["time"])
    spike = int(np.argmax(broken["m_depth"] > 30.0))
    broken["m_pressure"][spike] = 90.0
    broken["m_pitch"][spike + 5] = 9.0
    middle = FLIGHT.dive_times(1)[0] + 100.0
    keep = np.abs(broken["time"] - middle) > 40.0
    order = np.arange(n)
    order[[20, 40]] = order[[40, 20]]
    rows = np.concatenate([order[keep], [50, 51, 52]])
    dataset, report = slocum(tmp_path, FLIGHT, rows=rows, **broken)
    assert report.count("removed", "m_pressure") == 1
    assert report.count("removed", "m_pitch") == 1
    assert report.count("repeated", "unit1_flight.csv") == 3
    assert report.count("sorted", "unit1_flight.csv") > 0
    gap = dataset["measured_gap"].values[1]
    marked = np.nansum(gap) * 2.0
    assert 60.0 < marked < 90.0
    assert report.count("interpolated", "attitude or depth") == np.nansum(dataset["measured_gap"])
    same = np.abs(dataset["measured_depth"].values - clean["measured_depth"].values)
    assert np.nanmax(same[0]) < 0.2
    assert np.nanmax(same[1]) < 0.2


@pytest.mark.parametrize(
    ("column", "factor", "why"),
    [
        ("m_pitch", 180.0 / np.pi, "degrees"),
        ("m_heading", 180.0 / np.pi, "degrees"),
        ("m_pressure", 10.0, "dbar"),
        ("m_pressure", 1e5, "Pa"),
        ("time", 1e3, "milliseconds"),
    ],
)
def test_swapped_units_are_repaired_and_counted(tmp_path, column, factor, why):
    right, _ = slocum(tmp_path, FLIGHT)
    changed = {column: slocum_columns(FLIGHT)[column] * factor}
    dataset, report = slocum(tmp_path, FLIGHT, **changed)
    repaired = [e for e in report.entries if e.action == "repaired"]
    assert len(repaired) == 1
    assert why in repaired[0].detail
    assert repaired[0].count == len(FLIGHT.time)
    for name in ("measured_pitch", "measured_heading", "measured_depth"):
        assert np.allclose(dataset[name], right[name], atol=2e-4, equal_nan=True), name


def test_a_pressure_alone_is_scaled_by_the_speed_that_it_gives(tmp_path):
    right, _ = slocum(tmp_path, FLIGHT, m_depth=None)
    dbar = slocum_columns(FLIGHT)["m_pressure"] * 10.0
    dataset, report = slocum(tmp_path, FLIGHT, m_depth=None, m_pressure=dbar)
    assert report.count("repaired", "pressure") == len(FLIGHT.time)
    assert np.allclose(dataset["measured_depth"], right["measured_depth"], equal_nan=True)


@pytest.mark.parametrize(
    ("column", "subject"),
    [("m_pitch", "measured_pitch"), ("m_ballast_pumped", "measured_pump")],
)
def test_a_sign_that_contradicts_the_dives_is_suspect(tmp_path, column, subject):
    columns = slocum_columns(FLIGHT)
    # a heading that never changes is suspect by itself
    wobble = {"m_heading": columns["m_heading"] + 1e-3 * np.sin(FLIGHT.time)}
    _, report = slocum(tmp_path, FLIGHT, **wobble)
    assert report.count("suspect") == 0
    changed = {**wobble, column: -columns[column]}
    _, report = slocum(tmp_path, FLIGHT, **changed)
    assert report.count("suspect", subject) == report.count("suspect") == len(FLIGHT.time)


def test_litres_infinities_and_swapped_positions(tmp_path):
    right, _ = slocum(tmp_path, FLIGHT)
    columns = slocum_columns(FLIGHT)
    latitude, longitude = FLIGHT.position(FLIGHT.time)
    roll = columns["m_roll"].copy()
    roll[7] = np.inf
    gps = gps_columns(FLIGHT)
    gps["lat"], gps["lon"] = gps["lon"], gps["lat"]
    dataset, report = slocum(
        tmp_path,
        FLIGHT,
        gps=gps,
        m_ballast_pumped=columns["m_ballast_pumped"] / 1000.0,
        m_roll=roll,
        m_lat=latitude,
        m_lon=longitude,
    )
    assert report.count("repaired", "m_ballast_pumped") == len(FLIGHT.time)
    assert report.count("removed", "m_roll") == 1
    assert report.count("repaired", "unit1_gps.csv") == len(gps["time"])
    assert np.allclose(dataset["measured_pump"], right["measured_pump"], equal_nan=True)
    assert np.allclose(dataset["displacement_north"], right["displacement_north"])


def test_a_pressure_that_fits_no_unit_is_refused(tmp_path):
    paths = write_slocum(tmp_path, FLIGHT, m_pressure=slocum_columns(FLIGHT)["m_pressure"] * 37.0)
    refused(r"m_pressure: pressure and depth do not belong together", "slocum", paths)


def test_a_log_without_gps_is_split_by_its_depth(tmp_path):
    flight_table, _ = write_slocum(tmp_path, FLIGHT)
    refused("--variation-deg", "slocum", [flight_table])
    dataset, report = import_logs("slocum", [flight_table], variation_deg=FLIGHT.variation)
    assert report.rows == FLIGHT.dives
    assert report.rows_with_fixes == 0
    assert report.count("missing", "GPS fixes") == 1
    assert np.isnan(dataset["displacement_north"].values).all()
    assert "measured_gps_north" not in dataset
    assert np.nanmedian(dataset["measured_heading"]) == pytest.approx(FLIGHT.heading, abs=1e-3)


def test_bad_and_stray_fixes_are_counted(tmp_path):
    gps = gps_columns(FLIGHT)
    gps["status"][3] = 2.0
    gps["lat"][10] += 0.1  # 11 km away for one fix
    deep = FLIGHT.dive_times(0)[0] + 100.0
    late = {
        "time": deep, "lat": gps["lat"][20], "lon": gps["lon"][20], "status": 0.0,
        "mag_var_rad": gps["mag_var_rad"][0],
    }  # fmt: skip
    gps = {name: np.append(values, late[name]) for name, values in gps.items()}
    _, report = slocum(tmp_path, FLIGHT, gps=gps)
    fixes = [e for e in report.entries if e.subject == "GPS fixes"]
    removed = {e.detail: e.count for e in fixes if e.action == "removed"}
    assert removed == {
        "status is not valid": 1,
        "under water: deeper than 2 m": 1,
        "away from their neighbours": 1,
    }
    assert report.rows == FLIGHT.dives


def test_truth_and_reported_current_arrive_where_they_belong(tmp_path):
    paths = write_slocum(tmp_path, FLIGHT)
    start, end = FLIGHT.dive_times(1)
    times = np.arange(start + 20.0, start + 60.0, 1.0)
    speed = np.full(len(times), 0.4)
    speed[10:15] = np.nan
    paths.append(write_csv(tmp_path / "unit1_truth.csv", {"time": times, "U_dvl_ms": speed}))
    angle = np.radians(FLIGHT.variation)
    x = FLIGHT.east * np.cos(angle) - FLIGHT.north * np.sin(angle)
    y = FLIGHT.east * np.sin(angle) + FLIGHT.north * np.cos(angle)
    events = {
        "time": [end + 100.0] * 2,
        "name": ["m_final_water_vx", "m_final_water_vy"],
        "value": [x, y],
    }
    paths.append(write_csv(tmp_path / "unit1_events.csv", events))
    dataset, report = import_logs("slocum", paths)
    assert report.count("read", "U_dvl_ms") == 35
    found = np.isfinite(dataset["true_speed"].values)
    assert not found[[0, 2]].any()
    # 2 s grid, 1 s truth: every second sample, and none where the truth has a hole
    assert 15 <= found[1].sum() <= 20
    assert float(dataset["vehicle_dac_north"][1]) == pytest.approx(FLIGHT.north)
    assert float(dataset["vehicle_dac_east"][1]) == pytest.approx(FLIGHT.east)
    assert np.isnan(dataset["vehicle_dac_north"].values[[0, 2]]).all()


def test_two_vehicles_in_one_call_stay_apart(tmp_path):
    other = Flight(dives=2, heading=200.0)
    paths = write_slocum(tmp_path, FLIGHT) + write_slocum(tmp_path, other, name="zeta")
    dataset, report = import_logs("slocum", paths)
    assert report.deployments == ("unit1", "zeta")
    headings = np.nanmedian(dataset["measured_heading"].values, axis=1)
    assert headings == pytest.approx([40.0] * 3 + [200.0] * 2, abs=1e-3)


def test_another_vehicles_gps_is_refused(tmp_path):
    time = FLIGHT.time
    latitude, longitude = FLIGHT.position(time)
    flight_table, gps_table = write_slocum(tmp_path, FLIGHT, m_lat=latitude + 3.0, m_lon=longitude)
    refused(r"km from the vehicle's place in unit1", "slocum", [flight_table, gps_table])
    gps = gps_columns(FLIGHT)
    gps["time"] = gps["time"] + 1e7
    write_csv(gps_table, gps)
    refused("covers another time than every flight table", "slocum", [flight_table, gps_table])


def test_a_store_of_logs_opens_like_a_store_of_missions(tmp_path):
    dataset, report = slocum(tmp_path, FLIGHT)
    path = write_store(dataset, tmp_path / "real.zarr")
    stored = open_store(path)
    assert stored.attrs["title"] == "Underwater glider logs"
    assert "simulated" not in stored.attrs["comment"].lower()
    assert "preset" not in stored.attrs
    assert json.loads(stored.attrs["import_report"])["rows"] == report.rows
    assert stored["deployment"].values.tolist() == ["unit1"] * 3
    trajectory = read_trajectory(path, 1)
    assert set(trajectory.signals) == set(report.channels)
    assert abs(
        np.datetime64("1970-01-01")
        + np.timedelta64(int(START), "s")
        - stored["start_time"].values[0]
    ) < np.timedelta64(400, "s")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.dbd", b"", "is empty"),
        ("a.dbd", b"hello\n" * 100, "not a Slocum binary file"),
        ("a.dbd", b"dbd_label: DBD\nencoding_ver: 5\n", "truncated within its header"),
        ("a.csv", b"pitch_deg,vbd_cc,time\n1,2,3\n", "looks like seaglider"),
        ("a.csv", b"NavState,Timestamp,Lat,Lon\n1,2,3,4\n", "looks like seaexplorer"),
        ("a.parquet", b"PAR1 but not whole", "not a whole parquet file"),
        ("a.csv", b"time,m_depth,m_pitch\n", "no rows"),
        ("a.csv", b"time,m_depth,m_pitch\n5,1,1\n", "is not a unix time"),
    ],
)
def test_files_that_are_no_slocum_log_are_named_in_one_line(tmp_path, name, content, message):
    if name.endswith(".parquet"):
        pytest.importorskip("pyarrow")
    path = tmp_path / name
    path.write_bytes(content)
    if name.endswith(".dbd") and content:
        pytest.importorskip("dbdreader")
    with pytest.raises(InputError, match=message) as caught:
        import_logs("slocum", [path])
    assert "\n" not in str(caught.value)


def test_without_dbdreader_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "dbdreader", None)
    path = tmp_path / "a.dbd"
    path.write_bytes(b"dbd_label: x\n")
    refused(r"glider-twin\[slocum\]", "slocum", [path])


def header(crc="abcd1234", total=3, used=2):
    lines = {
        "dbd_label": "DBD(dinkum_binary_data)file", "encoding_ver": 5, "num_ascii_tags": 14,
        "all_sensors": "F", "the8x3_filename": "00000000",
        "full_filename": "unit_334-2023-262-2-41", "filename_extension": "dbd",
        "mission_name": "A.MI", "fileopen_time": "Fri", "total_num_sensors": total,
        "sensors_per_cycle": used, "state_bytes_per_cycle": 1, "sensor_list_crc": crc,
        "sensor_list_factored": 1,
    }  # fmt: skip
    return "".join(f"{k}:    {v}\n" for k, v in lines.items()).encode() + b"sa\x10"


def test_missing_and_wrong_cache_files_are_told_before_decoding(tmp_path):
    pytest.importorskip("dbdreader")
    path = tmp_path / "a.dbd"
    path.write_bytes(header())
    assert vehicle_of(read_header(path), path) == "unit_334"
    refused(r"cache file abcd1234\.cac is missing.*--cache", "slocum", [path])
    (tmp_path / "abcd1234.cac").write_text("s: T    0    0 4 m_depth m\ns: F 1 -1 4 m_pitch rad\n")
    refused(r"is not the one of a\.dbd", "slocum", [path])
