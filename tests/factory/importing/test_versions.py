"""Files that others write in ways of their own: dates, fixes apart, two versions of one deployment,
parts that end early, libraries that never come back."""

import dataclasses
import datetime
import multiprocessing
import shutil
import warnings

import netCDF4
import numpy as np
import pytest
from logs import refused, told

from factory import samples
from factory.importing import import_logs, netcdf
from factory.importing.netcdf import open_netcdf
from factory.importing.sample_clock import unix_seconds
from factory.importing.tally import Tally
from factory.samples import START, Flight, add_variables, write_csv
from factory.samples.archives import write_og1
from factory.samples.gliders import write_seaexplorer
from glider_twin_protocols.ros_messages import unit_quaternions

FLIGHT = Flight()
DAY = 86400.0


def moment_of(time):
    return datetime.datetime.fromtimestamp(time, datetime.UTC)


# ---- dates


def dated(folder, layout, unit):
    """A table whose times are written in a layout, and a mapping that says the unit."""
    time = START + np.arange(0.0, 1200.0, 4.0)
    table = folder / "dated.csv"
    words = [f"{moment_of(float(t)):{layout}}" for t in time]
    depth = 30.0 * np.sin(np.linspace(0.0, np.pi, len(time)))
    lines = [f"{w},{d:.2f},352.5" for w, d in zip(words, depth, strict=True)]
    table.write_text("\n".join(["when,depth,lon", *lines]) + "\n")
    mapping = folder / "mine.toml"
    mapping.write_text(
        'vehicle = "mine"\nframe = "FRD"\nrows = "file"\n[time]\ncolumn = "when"\n'
        f'unit = "{unit}"\n[signals]\nmeasured_depth = {{ column = "depth", unit = "m" }}\n'
        '[ignored]\nlon = "of the table"\n'
    )
    return table, mapping


@pytest.mark.parametrize("layout", ["%m/%d/%Y %H:%M:%S", "%d/%m/%Y %H:%M:%S", "%d %b %Y %H:%M:%S"])
def test_dates_are_read_by_the_layout_that_the_mapping_gives(tmp_path, layout):
    """No month is guessed of a day: written times are ISO 8601, or as the mapping says."""
    table, mapping = dated(tmp_path, layout, layout)
    dataset, report = import_logs("csv", [table], mapping=mapping)
    assert report.rows == 1
    assert not any("when" in one or "dated" in one for one in told(report, "left out"))
    assert float(dataset["start_time"].values[0]) == pytest.approx(START, abs=10.0)
    table, mapping = dated(tmp_path, layout, "iso")
    refused(r"no ISO 8601 time: write its layout", "csv", [table], mapping=mapping)


@pytest.mark.parametrize("unit", ["%H:%M:%S", "%d.%m. %H:%M", "%Q"])
def test_a_layout_without_a_date_is_refused(tmp_path, unit):
    table, mapping = dated(tmp_path, "%Y-%m-%dT%H:%M:%SZ", unit)
    refused(r"no year, month and day|no layout of strptime", "csv", [table], mapping=mapping)


def test_days_without_a_beginning_are_not_of_the_future():
    moment = datetime.datetime(2024, 3, 1, tzinfo=datetime.UTC)
    days = (moment - datetime.datetime(1950, 1, 1, tzinfo=datetime.UTC)).days
    read = unix_seconds(np.full(3, float(days)), "TIME", Tally())
    assert read == pytest.approx(moment.timestamp())


def test_rows_of_the_future_are_suspect(tmp_path):
    later = datetime.datetime.now(datetime.UTC).timestamp() + 30.0 * DAY
    shifted = tmp_path / "later.nc"
    write_og1(shifted, FLIGHT)
    with netCDF4.Dataset(shifted, "a") as file:
        for name in ("TIME", "TIME_GPS"):
            file[name][:] = file[name][:] + (later - FLIGHT.time[0]) / 60.0
    dataset, report = import_logs("og1", [shifted])
    assert report.suspect == report.rows == FLIGHT.dives
    assert all("later than this computer's clock" in str(why) for why in dataset["suspect"].values)


def test_longitudes_up_to_360_are_those_of_a_store(tmp_path):
    table, mapping = dated(tmp_path, "%Y-%m-%dT%H:%M:%SZ", "iso")
    head, *rows = table.read_text().split()
    rows = [f"{row},{35.0 + 1e-5 * k:.5f}" for k, row in enumerate(rows)]
    table.write_text("\n".join([f"{head},lat", *rows]) + "\n")
    text = mapping.read_text().partition("[ignored]")[0]
    mapping.write_text(
        text + 'gps_longitude = { column = "lon", unit = "deg" }\n'
        'gps_latitude = { column = "lat", unit = "deg" }\n'
    )
    dataset, report = import_logs("csv", [table], mapping=mapping)
    assert report.rows == 1
    assert float(dataset["start_longitude"].values[0]) == pytest.approx(-7.5)


# ---- OG1


def test_fixes_along_a_dimension_of_their_own(tmp_path):
    whole = write_og1(tmp_path / "whole.nc", FLIGHT)
    apart = tmp_path / "apart.nc"
    with netCDF4.Dataset(whole) as source, netCDF4.Dataset(apart, "w") as target:
        known = np.flatnonzero(np.isfinite(source["TIME_GPS"][:].filled(np.nan)))
        for name, variable in source.variables.items():
            about = {k: variable.getncattr(k) for k in variable.ncattrs()}
            gps = (("N_GPS",), variable[:][known], about)
            one = gps if name.endswith("_GPS") else (variable.dimensions, variable[:], about)
            add_variables(target, {name: one})
    one, told_of_one = import_logs("og1", [whole])
    other, told_of_other = import_logs("og1", [apart])
    assert told_of_one.rows_with_fixes == told_of_other.rows_with_fixes == FLIGHT.dives
    for name in ("start_latitude", "start_longitude", "dac_north"):
        np.testing.assert_allclose(other[name].values, one[name].values)


def test_two_versions_of_one_deployment_are_one(tmp_path):
    """A copy, and a version that ends earlier, add no dive; one that goes on adds its own."""
    whole = write_og1(tmp_path / "a_delayed.nc", FLIGHT)
    short = write_og1(tmp_path / "b_realtime.nc", dataclasses.replace(FLIGHT, dives=1))
    shutil.copyfile(whole, tmp_path / "c_copy.nc")
    for path in (whole, short, tmp_path / "c_copy.nc"):
        with netCDF4.Dataset(path, "a") as file:
            file.id = "sp065_2021"
    dataset, report = import_logs("og1", [tmp_path])
    alone, _ = import_logs("og1", [whole])
    assert report.rows == FLIGHT.dives
    left = told(report, "left out")
    assert any(one.startswith("b_realtime.nc: files: a_delayed.nc holds more") for one in left)
    assert any(one.startswith("c_copy.nc: files:") for one in left)
    np.testing.assert_array_equal(dataset["start_time"].values, alone["start_time"].values)


def test_a_reported_current_needs_no_attitude(tmp_path):
    path = write_og1(tmp_path / "log.nc", FLIGHT)
    with netCDF4.Dataset(path, "a") as file:
        for name in ("PITCH", "HEADING"):
            file[name][:] = np.nan
        for name, value in (("DAC_NORTH", 0.2), ("DAC_EAST", -0.1)):
            one = (("N_MEASUREMENTS",), np.full(len(FLIGHT.time), value), "m s-1")
            add_variables(file, {name: one})
    dataset, report = import_logs("og1", [path])
    np.testing.assert_allclose(dataset["vehicle_dac_north"].values, 0.2)
    np.testing.assert_allclose(dataset["vehicle_dac_east"].values, -0.1)
    assert not any("DAC_" in one for one in told(report, "left out"))


def test_headings_in_radian_that_are_called_degrees_are_told(tmp_path):
    path = write_og1(tmp_path / "log.nc", FLIGHT)
    with netCDF4.Dataset(path, "a") as file:
        file["HEADING"].long_name = "true heading"
        file["HEADING"][:] = np.linspace(0.0, 6.0, len(file.dimensions["N_MEASUREMENTS"]))
    _, report = import_logs("og1", [path])
    assert report.suspect == FLIGHT.dives
    assert any("radian that are called degrees?" in one for one in told(report, "suspect"))


# ---- parts that end early


def test_a_payload_that_goes_on_alone_is_told(tmp_path):
    path = write_seaexplorer(tmp_path / "sea035.12.gli.sub.1", FLIGHT)
    time = FLIGHT.time[-1] + np.arange(0.0, 600.0, 10.0)
    write_csv(
        tmp_path / "sea035.12.pld1.sub.1",
        {
            "PLD_REALTIMECLOCK": [f"{moment_of(float(t)):%d/%m/%Y %H:%M:%S}" for t in time],
            "LEGATO_TEMPERATURE": np.full(len(time), 8.0),
            "LEGATO_SALINITY": np.full(len(time), 35.0),
        },
        ";",
    )
    _, report = import_logs("seaexplorer", [tmp_path])
    (said,) = [one for one in told(report, "left out") if "SEA035_M12 payload" in one]
    assert f"after the navigation log ends at {moment_of(FLIGHT.time[-1]):%Y-%m-%d %H:%M}" in said
    shutil.copyfile(tmp_path / "sea035.12.pld1.sub.1", tmp_path / "sea036.1.pld1.sub.1")
    _, report = import_logs("seaexplorer", [tmp_path])
    assert report.deployments == ("SEA035_M12",)
    assert any("navigation log (gli) of SEA036_M1" in one for one in told(report, "left out"))
    path.unlink()
    refused("without the navigation log", "seaexplorer", [tmp_path])


def test_a_recording_that_was_cut_is_read_to_its_end(tmp_path):
    pytest.importorskip("mcap")
    (path,) = samples.write("mcap", tmp_path, Flight(depth=30.0))
    _, whole = import_logs("mcap", [path])
    content = path.read_bytes()
    path.write_bytes(content[:-40])
    _, report = import_logs("mcap", [path])
    assert report.samples == whole.samples
    assert any("it lacks its end" in one for one in told(report, "note"))
    path.write_bytes(content[: len(content) // 3])
    refused("cut off before its first whole chunk", "mcap", [path])


# ---- libraries that never come back


@pytest.mark.parametrize(
    "program", ["import time; input(); time.sleep(600.0)", "import os; input(); os.abort()"]
)
def test_a_file_from_which_its_library_does_not_come_back(tmp_path, monkeypatch, program):
    path = write_og1(tmp_path / "log.nc", FLIGHT)
    trial = netcdf._Trial()
    monkeypatch.setattr(netcdf, "_trial", trial)
    with monkeypatch.context() as patch:
        patch.setattr(netcdf._Trial, "PROGRAM", program)
        patch.setattr(netcdf._Trial, "LONGEST", 2.0)
        refused("its library does not come back from it", "og1", [path])
    with open_netcdf(path) as file:
        assert "TIME" in file.variables
    assert trial._process is not None
    trial._process.kill()
    trial._process.wait()
    other = write_og1(tmp_path / "other.nc", FLIGHT)
    with open_netcdf(other) as file:
        assert "TIME" in file.variables
    trial.end()


def test_a_fork_tries_files_by_a_process_of_its_own(tmp_path):
    path, other = (write_og1(tmp_path / name, FLIGHT) for name in ("a.nc", "b.nc"))
    with open_netcdf(path):
        pass
    context = multiprocessing.get_context("fork")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside threads
        process = context.Process(target=netcdf._trial.passes, args=(other,))
        process.start()
    process.join(60.0)
    assert process.exitcode == 0
    with open_netcdf(other):
        pass


def test_no_module_of_the_folder_is_imported(tmp_path, monkeypatch):
    """Logs lie in folders of others: a file called numpy.py there is never run."""
    path = write_og1(tmp_path / "log.nc", FLIGHT)
    for name in ("numpy", "netCDF4", "os"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close(); raise SystemExit(1)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(netcdf, "_trial", trial := netcdf._Trial())
    with open_netcdf(path) as file:
        assert "TIME" in file.variables
    trial.end()
    assert not (tmp_path / "ran").exists()


# ---- attitudes that are none


def test_a_quaternion_is_an_attitude_only_at_length_one():
    tally = Tally()
    rows = np.array(
        [[1.0, 0, 0, 0], [0.0, 0, 0, 0], [1.4, 0.2, 0, 0], [-9999.0] * 4, [0.999, 0, 0, 0]]
    )
    found = {f"orientation.{axis}": rows[:, k] for k, axis in enumerate("wxyz")}
    unit_quaternions(found, "/imu", tally)
    (entry,) = tally.entries()
    assert (entry.action, entry.subject, entry.count) == ("removed", "/imu", 3)
    np.testing.assert_array_equal(found["orientation.w"], [1.0, np.nan, np.nan, np.nan, 1.0])
    found = {f"orientation.{axis}": np.zeros(2) for axis in "wxyz"}
    found["orientation_covariance.0"] = np.full(2, -1.0)
    unit_quaternions(found, "/imu", quiet := Tally())
    assert not quiet.entries()  # the message says itself that it has none
