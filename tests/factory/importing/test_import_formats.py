"""Import of SeaExplorer, OG1.0 and LRAUV logs, on written and on real files."""

import gzip
from datetime import UTC, datetime

import netCDF4
import numpy as np
import pytest
from logs import refused

from factory.exporting.og1.missions import export_og1
from factory.generation.generated_store import GeneratedStore
from factory.importing import import_logs
from factory.importing.deployment_log import OTHER_KIND
from factory.importing.units import in_unit
from factory.samples import START, Flight, write_csv, write_netcdf
from factory.samples.archives import write_ngdac, write_og1
from factory.samples.gliders import write_seaexplorer
from glider_twin_protocols.auv_samples import write_mat
from twin.records.logged import LogStore
from twin.records.store import write_store

FLIGHT = Flight(depth=100.0, variation=17.0, surface=600.0)


@pytest.mark.parametrize("delimiter", [",", ";"])
def test_seaexplorer_navigation_logs_come_back(tmp_path, delimiter):
    path = write_seaexplorer(tmp_path / "sea009_M3_gli.csv", FLIGHT, delimiter)
    dataset, report = import_logs("seaexplorer", [path])
    assert report.deployments == ("SEA009_M3",)
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    assert dataset["dive_duration"].values == pytest.approx(2.0 * FLIGHT.leg, abs=25.0)
    moved = FLIGHT.displacement(*FLIGHT.dive_times(0))  # the same in every dive
    assert dataset["displacement_north"].values == pytest.approx(moved[0], abs=3.0)
    n = int(dataset["n_samples"][0])
    pitch = dataset["measured_pitch"].values[0, :n]
    down = np.isclose(pitch, -FLIGHT.pitch, atol=1e-3)
    assert np.allclose(dataset["measured_heading"].values[0, :n], FLIGHT.heading, atol=1e-3)
    assert np.allclose(dataset["measured_shift"].values[0, :n][down], 0.06, atol=1e-4)
    # + turns the mass to starboard there, to port here
    assert np.allclose(dataset["measured_rotation"].values[0, :n], -5.0)
    assert "commanded_heading" not in dataset
    assert report.count("removed", "DesiredH") == report.count("read", path.name)


def test_a_seaexplorer_s_reckoned_place_gives_its_variation(tmp_path):
    """Without a row at the surface no position is a fix; the field is known all the same."""
    path = write_seaexplorer(tmp_path / "sea009_M3_gli.csv", FLIGHT)
    rows = [line.split(",") for line in path.read_text().splitlines()]
    names = rows[0]
    for row in rows[1:]:
        row[names.index("NavState")] = row[names.index("NavState")].replace("116", "117")
        row[names.index("Declination")] = ""
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    dataset, report = import_logs("seaexplorer", [path])
    assert report.rows_with_fixes == 0
    assert dataset["magnetic_variation"].values == pytest.approx(-18.05, abs=0.1)


def test_seaexplorer_refusals(tmp_path):
    path = write_seaexplorer(tmp_path / "sea009_M3_gli.csv", FLIGHT)
    payload = write_csv(
        tmp_path / "sea010_M1_pld.csv",
        {"PLD_REALTIMECLOCK": ["23/08/2021 23:22:52.837"] * 2, "NAV_DEPTH": [1.0, 2.0]},
    )
    refused(r"payload log without the navigation log \(gli\)", "seaexplorer", [payload])
    cut = tmp_path / "cut.csv.gz"
    cut.write_bytes(gzip.compress(path.read_bytes())[:-2000])
    refused("cannot be read to its end", "seaexplorer", [cut])
    (tmp_path / "none").mkdir()
    refused("holds no seaexplorer logs", "seaexplorer", [tmp_path / "none"])


@pytest.fixture(scope="module")
def exported(field_store, tmp_path_factory):
    run = GeneratedStore(field_store)
    return run, export_og1(run, 0, tmp_path_factory.mktemp("og1"))


def test_og1_files_of_our_own_come_back_sample_for_sample(exported):
    run, path = exported
    dataset, report = import_logs("og1", [path], period=0.5)
    assert report.count("note", path.name) == 1  # it says that it is simulated
    assert "simulated" in dataset.attrs["comment"]
    starts = dataset["start_time"].values.astype(float)
    begin = run.array("start_time")[0].astype("datetime64[s]").astype(float)
    checked = 0
    for row in range(dataset.sizes["mission"]):
        first = (starts[row] - begin) / 0.5
        if abs(first - round(first)) > 1e-3:
            continue  # begins a second before its first sample, not on the file's grid
        n = int(dataset["n_samples"][row])
        part = slice(round(first), round(first) + n)
        for name in ("pitch", "roll", "heading", "pressure", "pump", "shift", "rotation"):
            ours = dataset[f"measured_{name}"].values[row, :n]
            assert np.array_equal(ours, run.row(f"measured_{name}", 0)[part]), name
        for name in ("true_surge", "true_sway", "true_heave", "true_heading"):
            assert np.array_equal(dataset[name].values[row, :n], run.row(name, 0)[part]), name
        for axis in ("north", "east"):
            fixes = run.row(f"measured_gps_{axis}", 0)[part]
            if np.isfinite(fixes[[0, -1]]).all():
                moved = float(dataset[f"displacement_{axis}"][row])
                assert moved == pytest.approx(fixes[-1] - fixes[0], abs=0.1)
        checked += 1
    assert checked == dataset.sizes["mission"] > 0


def test_og1_magnetic_headings_take_the_field_of_their_place_and_date(tmp_path):
    path = write_og1(tmp_path / "magnetic.nc", FLIGHT)
    dataset, report = import_logs("og1", [path], variation_deg=FLIGHT.variation)
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    assert np.nanmedian(dataset["measured_heading"]) == pytest.approx(FLIGHT.heading, abs=1e-3)
    assert np.nanmax(dataset["measured_pitch"]) == pytest.approx(FLIGHT.pitch, abs=1e-3)
    dataset, report = import_logs("og1", [path])
    magnetic = FLIGHT.heading - FLIGHT.variation
    assert np.nanmedian(dataset["measured_heading"]) == pytest.approx(magnetic - 18.05, abs=0.1)
    assert dataset["magnetic_variation"].values == pytest.approx(-18.05, abs=0.1)
    assert [e.detail for e in report.entries if e.subject == "magnetic variation"] == [
        "magnetic: the log has none; -18.05 degree by IGRF-14 at its place and date"
    ]
    with netCDF4.Dataset(path, "a") as file:
        file["LATITUDE_GPS"][:] = np.nan
    refused(r"HEADING is magnetic .*no position is there", "og1", [path])


def test_og1_fixes_stand_at_the_measurements_where_they_have_no_time_of_their_own(tmp_path):
    """As converters of Seaglider files write it: integer nanoseconds since an odd moment."""
    right, _ = import_logs(
        "og1", [write_og1(tmp_path / "a.nc", FLIGHT)], variation_deg=FLIGHT.variation
    )
    time, state = FLIGHT.with_fixes()
    moment = "2023-11-14 22:13:18.193000192"
    since = np.round((time - START + 1.806999808) * 1e9).astype(np.int64)
    path = tmp_path / "sg999_20231114T221318_delayed.nc"
    columns = {
        "TIME": since, "DEPTH": state["depth"], "PITCH": state["pitch"],
        "HEADING": state["heading"], "LATITUDE_GPS": state["latitude"],
        "LONGITUDE_GPS": state["longitude"], "TEMP_QC": np.ones(len(time)),
        "divenum": state["dive"] + 7, "DAVG_CURR_NORTH": np.full(len(time), FLIGHT.north),
        "DAVG_CURR_EAST": np.full(len(time), FLIGHT.east),
    }  # fmt: skip
    variables = {name: (("N_MEASUREMENTS",), values) for name, values in columns.items()}
    variables["TIME"] += (f"nanoseconds since {moment}",)
    write_netcdf(path, variables, id="sg999_20231114T221318")
    dataset, report = import_logs("og1", [path])
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    assert dataset["dive"].values.tolist() == [7, 8, 9]
    assert dataset["start_time"].values == pytest.approx(right["start_time"].values, abs=1e-3)
    for name in ("displacement_north", "displacement_east", "measured_depth"):
        assert np.allclose(dataset[name], right[name], atol=0.01, equal_nan=True), name
    assert dataset["vehicle_dac_north"].values == pytest.approx(FLIGHT.north)
    assert dataset["vehicle_dac_east"].values == pytest.approx(FLIGHT.east)
    assert "TEMP_QC" in report.names["OG1 file"]["not read"]


def test_ngdac_profiles_make_one_log_with_its_currents(tmp_path):
    paths = write_ngdac(tmp_path, FLIGHT)
    dataset, report = import_logs("ngdac", paths)
    assert report.deployments == ("unit-23",)
    assert report.rows == FLIGHT.dives
    assert dataset["vehicle_dac_north"].values == pytest.approx(FLIGHT.north)
    assert dataset["vehicle_dac_east"].values == pytest.approx(FLIGHT.east)
    n = int(dataset["n_samples"][0])
    start = float(dataset["start_time"].values.astype(float)[0])
    truth = FLIGHT.state(start + dataset["time"].values[:n])
    north = truth["north"] - truth["north"][0]
    assert np.allclose(dataset["measured_onboard_north"].values[0, :n], north, rtol=5e-3, atol=1.0)
    assert np.nanmedian(dataset["measured_heading"]) == pytest.approx(FLIGHT.heading, abs=1e-3)
    # what the file's own quality control calls bad goes; where the vehicle's own fixes are, rows
    # run from fix to fix
    for path in paths:
        with netCDF4.Dataset(path, "a") as file:
            under = file["depth"][:] > 0.0
            for name in ("lat", "lon"):
                fix = file.createVariable(f"m_gps_{name}", "f8", ("time",))
                fix[:] = np.ma.masked_where(under, file[name][:])
            file["depth_qc"][7] = 4
            file["depth"][7] = 500.0
    dataset, report = import_logs("ngdac", paths)
    assert report.count("removed", "depth") == len(paths)
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    for dive in range(FLIGHT.dives):
        moved = FLIGHT.displacement(*FLIGHT.dive_times(dive))
        assert float(dataset["displacement_north"][dive]) == pytest.approx(moved[0], abs=1.0)


def test_seaexplorer_offloads_hold_events_and_other_files(tmp_path):
    """The rest is read; a CTD of the payload and its oxygen come with it."""
    right, _ = import_logs("seaexplorer", [write_seaexplorer(tmp_path / "a_gli.csv", FLIGHT)])
    folder = tmp_path / "offload"
    folder.mkdir()
    write_seaexplorer(folder / "sea009.3.gli.sub.1.csv", FLIGHT)
    (folder / "sea.0.gli.evt.1").write_text("12/07/2018 20:53:02\t   3\tKey=q\n" * 5)
    (folder / "sea.0.pld1.evt.1").write_text("12/07/2018 20:53:02\t   3\tStarting, v2.5\n" * 5)
    (folder / "sea.msn").write_text("mission")
    (folder / "sea009.3.gli.sub.2.gz").write_bytes(b"\x1f\x8b\x08 damaged")
    time = FLIGHT.time[::3]
    depth = FLIGHT.state(time)["depth"]
    stamps = [datetime.fromtimestamp(t, UTC).strftime("%d/%m/%Y %H:%M:%S.%f")[:-3] for t in time]
    write_csv(
        folder / "sea009.3.pld1.sub.1.csv",
        {
            "PLD_REALTIMECLOCK": stamps,
            "LEGATO_TEMPERATURE": 8.0 + 0.01 * depth,
            "LEGATO_CONDUCTIVITY": np.full(len(time), 34.0),
            "LEGATO_PRESSURE": 1.0065 * depth,
            "AROD_FT_DO": 250.0 - depth,
        },
    )
    dataset, report = import_logs("seaexplorer", [folder])
    assert report.deployments == ("SEA009_M3",)
    told = [e.detail for e in report.entries if e.subject in ("unreadable file", OTHER_KIND)]
    assert len(told) == 2
    assert report.count("left out", OTHER_KIND) == 2
    assert told[1].startswith("2 of 4 files: is the vehicle's list of events")
    assert np.array_equal(dataset["measured_depth"], right["measured_depth"], equal_nan=True)
    there = np.isfinite(dataset["measured_oxygen"].values)
    off = dataset["measured_oxygen"].values - 250.0 + dataset["measured_depth"].values
    assert np.abs(off[there]).max() < 2.0
    assert there.mean() > 0.5


def test_an_lrauv_log_that_has_every_sample_twice(tmp_path):
    dataset, report = import_logs("lrauv", [write_mat(tmp_path / "log.mat", FLIGHT)])
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    assert report.count("repeated", "depth") == len(FLIGHT.time[::5])
    assert np.nanmedian(dataset["measured_temperature"]) == pytest.approx(10.0, abs=1e-3)


def test_lrauv_units_in_text(tmp_path):
    time = FLIGHT.time
    state = FLIGHT.state(time)
    columns = {
        "EpochSeconds": time,
        "depth": [f"{d:.6f} m" for d in state["depth"]],
        "platform_pitch_angle": [f"{np.radians(p):.6f} rad" for p in state["pitch"]],
        "platform_buoyancy_position": [f"{p:.6f} cc" for p in state["pump"]],
        "platform_mass_position": ["nan"] * len(time),
        "platform_elevator_angle": [f"{-np.radians(p):.6f} rad" for p in state["pitch"]],
        "platform_rudder_angle": ["5.000000 arcdeg"] * len(time),
        "platform_propeller_rotation_rate": ["300.0 rpm"] * len(time),
        "VerticalControl.elevatorAngleAction": ["2.0 arcdeg"] * len(time),
    }
    dataset, report = import_logs("lrauv", [write_csv(tmp_path / "a.csv", columns)])
    assert report.rows == FLIGHT.dives
    assert np.nanmax(dataset["measured_pitch"]) == pytest.approx(FLIGHT.pitch, abs=1e-3)
    assert "simulated" in dataset.attrs["comment"]
    n = int(dataset["n_samples"][0])
    one = {name: dataset[name].values[0, :n] for name in dataset.data_vars if name[0] in "mc"}
    np.testing.assert_allclose(one["measured_elevator"], -one["measured_pitch"], atol=1e-3)
    np.testing.assert_allclose(one["measured_rudder"], 5.0)
    np.testing.assert_allclose(one["measured_propeller"], 10.0 * np.pi, rtol=1e-6)
    np.testing.assert_allclose(one["commanded_elevator"], 2.0)
    store = LogStore(write_store(dataset, tmp_path / "a.zarr"))
    assert {"elevator", "rudder", "propeller"} <= set(store.vehicle.part_names)
    assert {dataset[f"measured_{n}"].attrs["units"] for n in ("elevator", "rudder")} == {"degree"}
    columns["depth"][3] = "2 rad"
    refused("column depth mixes the units", "lrauv", [write_csv(tmp_path / "a.csv", columns)])
    refused("unit 'arcdeg' is not one of m", np.zeros(1), "arcdeg", "m", "a.csv depth", by=in_unit)


def test_lrauv_refusals(tmp_path):
    path = write_mat(tmp_path / "log.mat", FLIGHT)
    cut = tmp_path / "cut.mat"
    cut.write_bytes(path.read_bytes()[:3000])
    refused("truncated or damaged", "lrauv", [cut])
    refused("looks like lrauv", "og1", [path])
