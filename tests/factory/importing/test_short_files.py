"""Logs whose files end early: what is known of a dive then, and what the report blames."""

import dataclasses

import numpy as np
import pytest
from logs import slocum, told

from factory.importing import TRUNCATED, import_logs
from factory.importing.deployment_log import Channel
from factory.samples import START, Flight, write_csv
from factory.samples.gliders import slocum_columns, write_dbd, write_seaexplorer
from factory.soundness import verify_logs
from twin.records.logged import LogStore
from twin.records.store import write_store

DEEP = Flight(dives=1, depth=400.0, surface=600.0)
"""One dive of 76 min"""
FLIGHT_COMPUTER = (
    "measured_pitch", "measured_roll", "measured_heading", "measured_pump", "measured_shift",
    "measured_fin",
)  # fmt: skip


def science(flight):
    """A Slocum's science sensors, a computer of their own."""
    time = flight.time
    depth = flight.state(time)["depth"]
    return {
        "sci_m_present_time": time,
        "sci_water_pressure": depth * 1.0065 / 10.0,
        "sci_water_temp": 10.0 - depth / 100.0,
        "sci_water_cond": np.full(len(time), 4.0),
    }


def row(dataset, name, number=0):
    """Unix times and values of a signal in a dive."""
    count = int(dataset["n_samples"][number])
    start = dataset["start_time"].values[number]
    begin = start.astype("datetime64[ms]").astype(float) / 1e3 if start.dtype.kind == "M" else start
    return begin + dataset["time"].values[:count], dataset[name].values[number, :count]


@pytest.fixture
def cut(tmp_path):
    """A flight file of which 0.4 are left beside a whole science file, and when it ends."""
    pytest.importorskip("dbdreader")
    path, _ = write_dbd(tmp_path, DEEP)
    data = path.read_bytes()
    path.write_bytes(data[: int(0.4 * len(data))])
    write_dbd(tmp_path, DEEP, columns=science(DEEP), crc="0badcaff")
    begin, end = DEEP.dive_times(0)
    return tmp_path, begin + 0.4 * (end - begin)


def test_nothing_of_a_flight_file_that_was_cut_is_held(cut, tmp_path):
    folder, _ = cut
    dataset, _ = import_logs("slocum", [folder])
    ends = {}
    for name in FLIGHT_COMPUTER:
        time, values = row(dataset, name)
        known = np.isfinite(values)
        ends[name] = time[known][-1]
        assert known[: int(known.sum())].all()  # and no hole before
    begin, end = DEEP.dive_times(0)
    assert begin < min(ends.values()) <= max(ends.values()) < 0.5 * (begin + end) + 60.0
    assert np.ptp(list(ends.values())) < 60.0
    # the descent's values alone: none is held into the climb
    assert np.nanmax(row(dataset, "measured_pitch")[1][30:]) < 0.0
    time, depth = row(dataset, "measured_depth")
    assert np.isfinite(depth).all()
    assert np.interp(end - 600.0, time, depth) == pytest.approx(
        DEEP.state(np.array([end - 600.0]))["depth"][0], abs=1.0
    )
    assert np.isfinite(row(dataset, "measured_temperature")[1]).mean() > 0.95
    assert "dac_north" not in dataset  # nobody knows the way
    store = write_store(dataset, tmp_path / "cut.zarr")
    with LogStore(store) as logs:
        assert verify_logs(logs).ok


def test_the_file_that_ends_is_blamed_and_no_sign(cut):
    folder, _ = cut
    dataset, report = import_logs("slocum", [folder])
    time, values = row(dataset, "measured_pitch")
    last = time[np.isfinite(values)][-1]
    moment = np.datetime64(round(last), "s").astype("datetime64[m]").astype(str).replace("T", " ")
    (why,) = [one for one in told(report, "note") if "the depth goes on for" in one]
    assert f"{TRUNCATED}the flight log ends at {moment[:-1]}" in why
    minutes = float(why.partition("goes on for ")[2].split()[0])
    assert minutes == pytest.approx((DEEP.dive_times(0)[1] - last) / 60.0, abs=3.0)
    blamed = [one for one in told(report, "suspect") if "sign" in one or "column" in one]
    assert blamed == []


def test_a_flight_log_that_begins_late_is_told_and_nothing_is_held_before(tmp_path):
    pytest.importorskip("dbdreader")
    path, _ = write_dbd(tmp_path, DEEP, without=("m_gps_lat", "m_gps_lon", "m_gps_status"))
    begin, end = DEEP.dive_times(0)
    late = 0.5 * (begin + end) + 300.0
    flown = slocum_columns(DEEP)
    kept = flown["time"] >= late
    columns = {"m_present_time" if n == "time" else n: v[kept] for n, v in flown.items()}
    write_dbd(tmp_path, DEEP, columns=columns)
    path.unlink()
    (tmp_path / "unit_1-2023-317-0-0.ebd").rename(tmp_path / "late.dbd")
    write_dbd(tmp_path, DEEP, columns=science(DEEP), crc="0badcaff")
    dataset, report = import_logs("slocum", [tmp_path], variation_deg=DEEP.variation)
    time, values = row(dataset, "measured_pitch")
    assert np.isnan(values[time < late - 60.0]).all()
    assert np.isfinite(values[time > late + 60.0]).mean() > 0.95
    assert any("the flight log begins at" in one for one in told(report, "note"))


def test_a_science_that_ends_early_leaves_no_water(tmp_path):
    pytest.importorskip("dbdreader")
    write_dbd(tmp_path, DEEP)
    begin, end = DEEP.dive_times(0)
    ends = begin + 0.3 * (end - begin)
    kept = {name: one[DEEP.time < ends] for name, one in science(DEEP).items()}
    write_dbd(tmp_path, DEEP, columns=kept, crc="0badcaff")
    dataset, _ = import_logs("slocum", [tmp_path])
    for name in ("measured_temperature", "measured_salinity"):
        time, values = row(dataset, name)
        assert np.isnan(values[(time > ends + 180.0)]).all(), name
    time, density = row(dataset, "measured_density")
    depth = row(dataset, "measured_depth")[1]
    deepest = float(np.max(depth[time < ends]))
    assert np.isnan(density[depth > deepest + 60.0]).all()  # no profile goes there
    assert np.isfinite(row(dataset, "measured_pitch")[1]).mean() > 0.95


def test_a_navigation_log_that_ends_early_holds_nothing(tmp_path):
    """A SeaExplorer's payload goes on with a pressure of its own: it is no depth of the vehicle."""
    path = write_seaexplorer(tmp_path / "sea009_M3_gli.csv", DEEP)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[: int(0.4 * len(lines))]))
    dataset, _ = import_logs("seaexplorer", [tmp_path])
    time, values = row(dataset, "measured_pitch")
    assert np.isfinite(values).all()
    assert time[-1] <= START + 0.4 * (DEEP.time[-1] - START) + 30.0


def test_a_depth_that_ends_deep_rises_to_the_fix(tmp_path):
    """Nobody knows the way; the fix knows the depth."""
    flight = Flight(dives=1, depth=100.0, surface=600.0)
    begin, end = flight.dive_times(0)
    flown = (flight.time < begin + 0.6 * (end - begin)) | (flight.time > end + 120.0)
    dataset, _ = slocum(tmp_path, flight, rows=flown)
    time, depth = row(dataset, "measured_depth")
    last = begin + 0.6 * (end - begin)
    half = 0.5 * (last + time[-1])
    assert np.interp(last, time, depth) == pytest.approx(80.0, abs=2.0)
    assert np.interp(half, time, depth) == pytest.approx(40.0, abs=4.0)
    assert depth[-1] < 1.0
    assert np.interp(half, time, row(dataset, "measured_gap")[1]) == 1.0


def test_a_topic_or_column_that_stops_is_not_held(tmp_path):
    time = START + np.arange(0.0, 1200.0, 1.0)
    depth = 20.0 * (1.0 - np.abs(((time - START) / 600.0) % 1.0 * 2.0 - 1.0))
    pitch = np.where(time < START + 400.0, -10.0, np.nan)
    order = np.where((time - START) % 60.0 == 0.0, time - START, np.nan)
    path = write_csv(tmp_path / "run.csv", {"t": time, "z": depth, "pitch": pitch, "wanted": order})
    mapping = tmp_path / "mine.toml"
    mapping.write_text(
        'vehicle = "x"\nrows = "file"\n[time]\ncolumn = "t"\nunit = "s"\n[signals]\n'
        'measured_depth = { column = "z", unit = "m" }\n'
        'measured_pitch = { column = "pitch", unit = "deg" }\n'
        'commanded_heading = { column = "wanted", unit = "deg" }\n'
    )
    dataset, _ = import_logs("csv", [path], mapping=mapping)
    at, values = row(dataset, "measured_pitch")
    assert np.isfinite(values[at < START + 400.0]).all()
    assert np.isnan(values[at > START + 410.0]).all()
    # what is commanded holds while the vehicle logs
    at, values = row(dataset, "commanded_heading")
    assert np.isfinite(values).all()


def test_a_row_ends_where_its_depth_ends(tmp_path):
    time = START + np.arange(0.0, 1200.0, 1.0)
    depth = np.where(time < START + 600.0, 10.0 + 0.01 * (time - START), np.nan)
    path = write_csv(tmp_path / "run.csv", {"t": time, "z": depth, "roll": np.sin(time / 50.0)})
    mapping = tmp_path / "mine.toml"
    mapping.write_text(
        'vehicle = "x"\nrows = "gaps"\n[time]\ncolumn = "t"\nunit = "s"\n[signals]\n'
        'measured_depth = { column = "z", unit = "m" }\n'
        'measured_roll = { column = "roll", unit = "deg" }\n'
    )
    dataset, report = import_logs("csv", [path], mapping=mapping)
    assert float(dataset["dive_duration"][0]) == pytest.approx(599.0, abs=1.0)
    assert any(TRUNCATED in one and "10 min" in one for one in told(report, "left out"))


@pytest.mark.parametrize(
    ("times", "asked", "covered"),
    [
        ([0.0, 4.0, 8.0, 12.0], [6.0, 23.0, 30.0], [True, True, False]),  # three spacings, no more
        ([0.0, 4.0, 8.0, 4000.0, 4004.0, 4008.0], [2000.0, 3990.0], [False, True]),
        # silent again and again: reported on change
        ([0.0, 4.0, 2000.0, 2004.0, 4000.0, 4004.0], [1000.0, 3000.0, 5900.0], [True] * 3),
        ([], [1.0], [False]),
    ],
)
def test_a_channel_covers_what_its_spacing_says(times, asked, covered):
    channel = Channel(np.array(times), np.zeros(len(times)))
    assert channel.covers(np.array(asked)).tolist() == covered
    known = channel.known(np.array(asked))
    assert np.isfinite(known).tolist() == covered


def test_two_computers_of_the_same_end_lose_nothing(tmp_path):
    """The usual log: a row without a hole stays without one."""
    pytest.importorskip("dbdreader")
    flight = dataclasses.replace(DEEP, depth=100.0)
    write_dbd(tmp_path, flight)
    write_dbd(tmp_path, flight, columns=science(flight), crc="0badcaff")
    dataset, report = import_logs("slocum", [tmp_path])
    for name in FLIGHT_COMPUTER:
        assert np.isfinite(row(dataset, name)[1]).all(), name
    assert not any(TRUNCATED in one for one in told(report, "note"))
