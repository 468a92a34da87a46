"""Spray: binned files in the published layout, and its profiles and OG1.0 by the other kinds."""

import netCDF4
import numpy as np
import pytest
from logs import refused

from factory.importing import import_logs, sniff
from factory.samples import Flight, add_variables
from factory.samples.archives import write_ngdac, write_og1, write_spray
from twin.identify.logged_missions import start_vehicle
from twin.records.store import write_store

FLIGHT = Flight(dives=4, depth=400.0, speed=0.3, surface=900.0)


def check(dataset, report, deployment):
    """Every dive has its way, its current, its depths and the water of its climb."""
    assert report.deployments == (deployment,)
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    for dive in range(FLIGHT.dives):
        row = dataset.isel(mission=dive)
        start, end = FLIGHT.dive_times(dive)
        moved = FLIGHT.displacement(start, end)
        assert float(row["dive_duration"]) == pytest.approx(end - start, abs=1e-3)
        assert float(row["displacement_north"]) == pytest.approx(moved[0], rel=2e-3)
        assert float(row["displacement_east"]) == pytest.approx(moved[1], rel=2e-3)
        assert float(row["vehicle_dac_north"]) == pytest.approx(FLIGHT.north)
        assert float(row["vehicle_dac_east"]) == pytest.approx(FLIGHT.east)
        depth, warm = row["measured_depth"].values, row["measured_temperature"].values
        known = FLIGHT.state(start + 60.0 * np.arange(len(depth)))["depth"]
        there = np.isfinite(depth)
        np.testing.assert_allclose(depth[there], known[there], atol=6.0)
        assert np.nanmax(depth) == pytest.approx(400.0, abs=6.0)
        climbing = np.isfinite(warm) & (np.arange(len(depth)) > there.sum() / 2 + 2) & (depth > 15)
        assert climbing.sum() > 10
        np.testing.assert_allclose(warm[climbing], 15.0 - 0.02 * depth[climbing], atol=0.05)


def test_dives_are_made_again_of_their_middles(tmp_path):
    path = write_spray(tmp_path / "CUGN_line_90.nc", FLIGHT)
    dataset, report = import_logs("spray", [path])
    assert sniff(path) == "spray"
    check(dataset, report, "spray-7")
    notes = [e.detail for e in report.entries if e.subject == path.name and e.action == "note"]
    assert any("made again" in note for note in notes)


def write_rows(path, *, upper=False):
    """OG1.0 of the Spray data center: a row a sample of the climb, deepest first, with the times of
    its profile and dive."""
    columns = {}
    for dive in range(FLIGHT.dives):
        start, end = FLIGHT.dive_times(dive)
        deep = np.arange(FLIGHT.depth, 2.0, -4.0)
        latitude, longitude = FLIGHT.position(np.array([start, end]))
        known = {"profile_index": dive + 30.0, "wcur_x": FLIGHT.east, "wcur_y": FLIGHT.north}
        for name, share in (("profile", 0.75), ("uv", 0.5)):
            known[f"time_{name}"] = start + share * (end - start)
            known[f"latitude_{name}"] = latitude[0] + share * np.ptp(latitude)
            known[f"longitude_{name}"] = longitude[0] + share * (longitude[1] - longitude[0])
        known["time"] = known["time_profile"]
        rows = {name: np.full(len(deep), value) for name, value in known.items()}
        rows |= {"depth": deep, "temp": 15.0 - 0.02 * deep, "psal": 33.0 + 0.0 * deep}
        rows |= {"latitude": rows["latitude_profile"], "longitude": rows["longitude_profile"]}
        for name, values in rows.items():
            columns.setdefault(name, []).append(values)
    with netCDF4.Dataset(path, "w") as file:
        case = str.upper if upper else str.lower
        file.createVariable(case("trajectory"), str, ())[...] = "sp028_2023"
        for name, parts in columns.items():
            units = ["seconds since 1970-01-01T00:00:00Z"] if "time" in name else []
            one = ((case("n_measurements"),), np.concatenate(parts), *units)
            add_variables(file, {case(name): one})
    return path


@pytest.mark.parametrize("upper", [False, True], ids=["small", "capital"])
def test_profiles_without_times_are_read_as_bins_are(tmp_path, upper):
    path = write_rows(tmp_path / "sp028.nc", upper=upper)
    assert sniff(path) == "spray"
    check(*import_logs("spray", [path]), "sp028_2023")
    for kind in ("og1", "ngdac"):
        refused("looks like spray: use `factory import spray`", kind, [path])
    with netCDF4.Dataset(path, "a") as file:  # what the reader makes times of
        lost = "TIME_UV" if upper else "time_uv"
        file.renameVariable(lost, "lost")
        del file["lost"].units
    if upper:
        refused(r"'TIME' gives .* no time of their own", "og1", [path])


@pytest.mark.parametrize("flag", [3, 4, 9], ids=["probably bad", "bad", "missing"])
def test_samples_flagged_bad_are_left_out(tmp_path, flag):
    path = write_rows(tmp_path / "sp028.nc")
    with netCDF4.Dataset(path, "a") as file:
        flags = np.where(np.asarray(file["depth"][:]) > 200.0, flag, 2).astype(np.int8)
        add_variables(file, {"temp_qc": (("n_measurements",), flags)})
    dataset, _ = import_logs("spray", [path])
    depth = dataset["measured_depth"].values[np.isfinite(dataset["measured_temperature"].values)]
    assert 190.0 < depth.max() < 210.0


def test_missions_of_one_file_are_deployments_and_empty_profiles_go(tmp_path):
    path = write_spray(tmp_path / "GoM.nc", FLIGHT, missions=(3, 12))
    with netCDF4.Dataset(path, "a") as file:
        file["lat"][0] = np.nan
        file["time"][1] = file["time_uv"][1]
    dataset, report = import_logs("spray", [path])
    assert report.deployments == ("spray-3", "spray-12")
    assert report.count("left out", path.name) == 2
    assert report.rows == 2 * FLIGHT.dives - 2
    assert (
        float(np.diff(dataset["start_time"].values.astype("datetime64[s]").astype(float)).max())
        > 3e7
    )


def test_other_files_and_shapes_are_refused(tmp_path):
    path = write_spray(tmp_path / "a.nc", FLIGHT)
    with netCDF4.Dataset(path, "a") as file:
        file["time_uv"][:] = np.nan
    refused("no profile has a place and a time", "spray", [path])
    refused("use `factory import ngdac`", "spray", write_ngdac(tmp_path, Flight())[:1])
    good = write_spray(tmp_path / "b.nc", FLIGHT)
    refused("leave --payload out", "spray", [good], payload=("oxygen=doxy",))


def test_a_spray_s_og1_file_in_the_published_layout_is_read(tmp_path):
    """OG1.0 of a glider without attitude: CTD, its fixes and its own depth-averaged currents.

    The layout: one dimension, names in capitals, a sensor each with its variables, the platform by
    its name, model and maker, fixes with times of their own (OceanGliders OG1.0, the format's
    page of mandatory and recommended variables).
    """
    path = write_og1(tmp_path / "sp031_20261124T1200_delayed.nc", FLIGHT)
    state = FLIGHT.state(FLIGHT.time)
    with netCDF4.Dataset(path, "a") as file:
        file.setncatts(
            {
                "title": "OceanGliders trajectory file",
                "platform": "sub-surface gliders",
                "platform_vocabulary": "https://vocab.nerc.ac.uk/collection/L06/current/27/",
                "Conventions": "CF-1.10, ACDD-1.3, OG-1.0",
                "id": "sp031_20261124T1200_delayed",
                "start_date": "20261124T1200",
                "rtqc_method": "none",
                "contributor_name": "Scripps",
                "contributing_institutions": "Scripps Institution of Oceanography",
            }
        )
        for name in ("PITCH", "HEADING"):  # these gliders send none
            file.renameVariable(name, f"LEFT_OUT_{name}")
            file[f"LEFT_OUT_{name}"][:] = np.nan
        for name, values, unit in (
            ("TEMP", 15.0 - 0.02 * state["depth"], "degree_Celsius"),
            ("PSAL", 33.0 + 0.0 * state["depth"], "1e-3"),
            ("PRES", 1.0065 * state["depth"], "dbar"),
        ):
            about = {"units": unit, "coordinates": "TIME LONGITUDE LATITUDE DEPTH"}
            add_variables(file, {name: (("N_MEASUREMENTS",), values, about)})
        for name, text in (
            ("PLATFORM_MODEL", "Scripps Institution of Oceanography Spray glider"),
            ("PLATFORM_NAME", "sp031"),
            ("PLATFORM_SERIAL_NUMBER", "sp031"),
            ("PLATFORM_MAKER", "Scripps Institution of Oceanography"),
        ):
            file.createVariable(name, str, ())[...] = text
    assert sniff(path) == "og1"
    dataset, report = import_logs("og1", [path])
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    for dive in range(FLIGHT.dives):
        moved = FLIGHT.displacement(*FLIGHT.dive_times(dive))
        row = dataset.isel(mission=dive)
        assert float(row["displacement_north"]) == pytest.approx(moved[0], abs=30.0)
        assert float(row["displacement_east"]) == pytest.approx(moved[1], abs=30.0)
    depth, warm = dataset["measured_depth"].values, dataset["measured_temperature"].values
    known = np.isfinite(depth) & np.isfinite(warm)
    assert known.sum() > 100
    np.testing.assert_allclose(warm[known], 15.0 - 0.02 * depth[known], atol=0.1)
    assert "measured_pitch" not in dataset or not np.isfinite(dataset["measured_pitch"]).any()
    store = write_store(dataset, tmp_path / "spray.zarr")
    assert start_vehicle(store).name == "spray"
