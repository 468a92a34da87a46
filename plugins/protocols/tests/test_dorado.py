"""Logs of MBARI's Dorado vehicles, by the published descriptions of their layout."""

from pathlib import Path

import numpy as np
import pytest
from logs import circles, example, refused, said, values

from factory.__main__ import PROGRAM
from factory.importing import import_logs
from glider_twin_protocols.auv_samples import instruments, track_of, write_along, write_log
from twin.identify.driven_runs import load_runs
from twin.records.attributes import VEHICLE_MJCF
from twin.vehicle.vehicle import load_vehicle

ROOT = Path(__file__).resolve().parents[3]
FINS = example((ROOT / "docs" / "howto" / "import_messages.md").read_text(), "dorado.toml")
"""The mapping of the page"""
TIME, STATE = circles(120.0)
STATE["depth"] = STATE["depth"] * np.clip((TIME - TIME[0] - 4.0) / 30.0, 0.0, 1.0)  # it dives
FIXES = {"latitude": np.full(len(TIME), np.nan), "longitude": np.full(len(TIME), np.nan)}
for _name, _place in (("latitude", 36.8), ("longitude", -122.0)):
    FIXES[_name][:3] = _place + 1e-6 * np.arange(3)


def mission(folder, *, west=False, fixes=True):
    folder.mkdir(exist_ok=True)
    every = instruments(TIME, {**STATE, **(FIXES if fixes else {})}, west=west)
    for name, fields in every.items():
        write_log(folder / f"{name}.log", fields)
    return folder


def test_a_folder_of_logs_is_a_mission_in_a_stores_units_and_axes(tmp_path):
    folder = mission(tmp_path / "2011.256.02")
    dataset, report = import_logs("dorado", [folder])
    assert (report.deployments, report.rows, report.period) == (("2011.256.02",), 1, 0.2)
    assert set(report.files) == {"navigation.log", "tailCone.log", "gps.log"}
    exact = {
        "roll": STATE["roll"], "pitch": STATE["pitch"], "depth": STATE["depth"],
        "roll_rate": 0.01, "pitch_rate": -0.02, "yaw_rate": STATE["yaw_rate"],
    }  # fmt: skip
    for name, expected in exact.items():
        found = values(dataset, f"measured_{name}")
        np.testing.assert_allclose(found, expected, atol=2e-4, err_msg=name)
    turned = (values(dataset, "measured_heading") - STATE["heading"] + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(turned, 0.0, atol=1e-3)
    spin = values(dataset, "measured_propeller")  # whole rad/s, 0.05 s later
    np.testing.assert_allclose(spin[1:-1], STATE["rpm"][1:-1] * np.pi / 30.0, atol=0.6)
    assert dataset.attrs[VEHICLE_MJCF] == load_vehicle("tethys").xml
    assert "tethys" in {e.subject for e in report.entries if "stands for" in e.detail}
    assert {"rudderAngle", "elevatorAngle"} <= set(report.names["Dorado tailCone"]["not read"])


def test_folders_of_one_name_are_two_missions(tmp_path):
    folders = [tmp_path / day / "missionlogs" for day in ("monday", "tuesday")]
    for day, folder in enumerate(folders):
        folder.mkdir(parents=True)
        for name, fields in instruments(TIME + 86400.0 * day, STATE).items():
            write_log(folder / f"{name}.log", fields)
    write_log(folders[1] / "navigation.1.log", instruments(TIME + 86401.0, STATE)["navigation"])
    _, report = import_logs("dorado", folders)
    assert report.rows == 2
    assert "another file of the folder has navigation" in said(report, "left out", "navigation.log")


def test_longitudes_that_count_westward_are_turned(tmp_path):
    """Some receivers' logs do so; the vehicle's own track tells."""
    east, _ = import_logs("dorado", [mission(tmp_path / "east")])
    west, report = import_logs("dorado", [mission(tmp_path / "west", west=True)])
    assert "counted westward" in said(report, "repaired", "gps longitude")
    for dataset in (east, west):
        assert dataset["start_longitude"].values[0] == pytest.approx(-122.0, abs=1e-4)
        assert dataset["start_latitude"].values[0] == pytest.approx(36.8, abs=1e-4)


def test_the_track_is_in_metres_where_there_are_no_places(tmp_path):
    dataset, _ = import_logs("dorado", [mission(tmp_path / "2003.100.01", fixes=False)])
    for axis, expected in zip(("north", "east"), track_of(TIME, STATE), strict=True):
        away = (values(dataset, f"measured_onboard_{axis}") - expected)[:-1]
        assert np.ptp(away) < 0.05, axis


def test_netcdf_of_each_instrument_gives_the_same(tmp_path):
    logs, _ = import_logs("dorado", [mission(tmp_path / "logs")])
    folder = tmp_path / "netcdf"
    folder.mkdir()
    for name, fields in instruments(TIME, {**STATE, **FIXES}).items():
        write_along(folder / f"{name}.nc", {n: v for _, n, v in fields})
    dataset, _ = import_logs("dorado", [folder])
    assert set(dataset.data_vars) == set(logs.data_vars)
    for signal in dataset.data_vars:
        if dataset[signal].dtype.kind == "f":
            np.testing.assert_allclose(
                dataset[signal], logs[signal], rtol=1e-5, err_msg=f"{signal}"
            )


def test_the_mapping_of_the_page_makes_a_store_that_identification_reads(tmp_path):
    folder, store = mission(tmp_path / "2011.256.02"), tmp_path / "real.zarr"
    mapping = tmp_path / "dorado.toml"
    mapping.write_text(FINS)
    words = ["import", "dorado", str(folder), "--mapping", str(mapping), "--out", str(store)]
    assert PROGRAM.main(words) == 0
    vehicle = load_vehicle("tethys")
    (run,) = load_runs(store, vehicle)
    assert run.use.any()
    for name, expected in (("rudder", -0.12), ("elevator", 0.06)):
        found = run.positions[:, vehicle.part_names.index(name)]
        np.testing.assert_allclose(found, expected, atol=1e-5, err_msg=name)


def test_a_log_that_was_cut_off_is_read_to_its_end(tmp_path):
    folder = mission(tmp_path / "cut")
    for path in folder.iterdir():
        path.write_bytes(path.read_bytes()[: -path.stat().st_size // 4 - 3])
    dataset, report = import_logs("dorado", [folder])
    assert "truncated: " in said(report, "note", "navigation.log")
    assert 400 < int(dataset["n_samples"][0]) < 500
    np.testing.assert_allclose(
        values(dataset, "measured_depth"), STATE["depth"][: int(dataset["n_samples"][0])], atol=1e-4
    )


def test_numbers_of_damaged_bytes_are_removed_and_counted(tmp_path):
    folder = mission(tmp_path / "damaged")
    path = folder / "navigation.log"
    data = bytearray(path.read_bytes())
    data[-8:] = b"\xff\xff\xff\xff\xff\xff\xef\x7f"  # the last longitude: the largest double
    path.write_bytes(bytes(data))
    _, report = import_logs("dorado", [folder])
    assert said(report, "removed", "navigation.log") == "1 values beyond any measurement"


def test_what_is_wrong_with_a_log_is_told(tmp_path, capsys):
    path = tmp_path / "navigation.log"
    header = b"# binary navigation\n# timeTag time %8.8e ,time ,UNKNOWN\n"
    path.write_bytes(header + b"# quad mPhi %d ,roll ,Degrees\n# begin\n" + bytes(64))
    refused(r"navigation\.log: .*type 'quad'.*known are timeTag", "dorado", [path])
    path.write_bytes(b"# binary navigation\n# double mPhi %e ,roll ,Degrees\n# begin\n" + bytes(64))
    refused(r"navigation\.log has no field time; it has mPhi", "dorado", [path])
    again = b"# short status %d ,s ,UNKNOWN\n"
    path.write_bytes(header + 3 * again + b"# begin\n" + bytes(64))
    refused("names a field three times", "dorado", [path])
    path.write_bytes(header + b"# begin\n")
    refused(r"navigation\.log holds no record", "dorado", [path])
    path.write_bytes(b"Nov 27 08:00:00 host kernel: no log of a vehicle\n")
    assert PROGRAM.main(["import", "dorado", str(path), "--out", str(tmp_path / "no.zarr")]) != 0
    error = capsys.readouterr().err
    assert "navigation.log is not a log of the kind dorado" in error
    assert "Traceback" not in error
    path.write_bytes(header + b"# short status %d ,s ,UNKNOWN\n# begin\n" + bytes(80))
    refused("no topic of it is known; it has navigation", "dorado", [path])
