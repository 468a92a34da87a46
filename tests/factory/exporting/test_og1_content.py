"""What an OG1.0 file of a log holds: metadata, flight terms, raw times, flags; what comes back."""

import math
from types import SimpleNamespace

import gsw
import netCDF4
import numpy as np
import pytest
import xarray as xr
from compliance import complaints, needs_checker
from logs import refused, stored
from simulated_logs import simulated_flight

from factory.__main__ import PROGRAM
from factory.exporting import EXPORTERS, ExportOptions
from factory.exporting.metadata import read_metadata
from factory.exporting.og1.deployments import export_og1_logs
from factory.exporting.og1.flight_terms import (
    ON_BOARD,
    STRAIGHT,
    JoinedDives,
    flight_terms,
    flown,
)
from factory.exporting.og1.og1_terms import simulated_mission
from factory.generation.generated_store import open_exportable
from factory.samples import Flight
from factory.samples.gliders import write_seaglider
from twin.errors import StoreError, VehicleError
from twin.records.logged import LogStore
from twin.records.store import write_store

FLIGHT = Flight(dives=3)
DEPLOYMENT = """
metadata:
  title: Salmon of the Gulf
  summary: A survey of salmon in the Gulf of St. Lawrence with an underwater glider.
  acknowledgement: Paid by nobody.
  comment: Iceberg ahead.
  creator_name: A. Nansen
  creator_email: nansen@example.org
  creator_url: https://example.org
  publisher_name: The Gulf
  publisher_email: gulf@example.org
  publisher_url: https://example.org
  institution: University of the Gulf
  license: CC0
  project: Salmon 2023
  naming_authority: org.example
  wmo_id: "6801670"
  glider_serial: "334"
  id: not this one
glider_devices:
  ctd:
    long_name: Seabird Glider Payload CTD
    make_model: SBE 41CP
    serial_number: "9028"
    calibration_date: "2023-05-23"
netcdf_variables:
  timebase: {source: sci_water_temp}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Logs of a Seaglider with the file that describes their deployment beside them."""
    folder = tmp_path_factory.mktemp("log")
    write_seaglider(folder, FLIGHT)
    (folder / "deployment.yml").write_text(DEPLOYMENT)
    return folder


@pytest.fixture(scope="module")
def store(folder, tmp_path_factory):
    files = sorted(folder.glob("*.csv"))
    return stored(tmp_path_factory.mktemp("store") / "real.zarr", "seaglider", files)


@pytest.fixture(scope="module")
def og1(store, tmp_path_factory):
    (path,) = EXPORTERS["og1"].export(
        LogStore(store), range(FLIGHT.dives), tmp_path_factory.mktemp("og1")
    )
    return path


def test_what_people_said_beside_the_log_is_in_the_file(og1):
    with netCDF4.Dataset(og1) as file:
        assert (file.contributor_name, file.contributor_email) == (
            "A. Nansen",
            "nansen@example.org",
        )
        assert (file.title, file.project, file.license) == (
            "Salmon of the Gulf", "Salmon 2023", "CC0"
        )  # fmt: skip
        assert file.id != "not this one"
        assert og1.name == f"{file.id}.nc"
        assert file.comment.startswith("Iceberg ahead. On one time grid")
        assert str(file["WMO_IDENTIFIER"][...]) == "6801670"
        assert str(file["PLATFORM_SERIAL_NUMBER"][...]) == "334"
        ctd = file["SENSOR_CTD"]
        assert (ctd.sensor_model, ctd.sensor_serial_number) == ("SBE 41CP", "9028")
        assert ctd.sensor_calibration_date == "2023-05-23"


UNITS = {
    "TIME": "seconds since 1970-01-01T00:00:00Z", "LONGITUDE": "degrees_east",
    "LATITUDE": "degrees_north", "POSITION_SD": "m", "DEPTH": "m", "LONGITUDE_GPS": "degrees_east",
    "LATITUDE_GPS": "degrees_north", "MAGNETIC_VARIATION": "degree", "PRES": "dbar",
    "PITCH": "degree", "ROLL": "degree", "HEADING": "degree", "BATTERY_SHIFT": "m",
    "PUMPED_VOLUME": "cm3", "DENSITY": "kg m-3", "TEMP": "degree_Celsius", "PSAL": "1",
    "CNDC": "S m-1", "GLIDER_SPEED_MODEL": "m s-1", "VERT_CURR_MODEL": "m s-1",
    "ANGLE_OF_ATTACK_MODEL": "degree", "DAVG_CURR_NORTH": "m s-1",
}  # fmt: skip
"""As OceanGliders 1.0 has them: literals, not the tables that the exporter writes from"""


def test_units_are_the_format_s_and_values_are_in_them(og1, store):
    with netCDF4.Dataset(og1) as file:
        assert {name: file[name].units for name in UNITS} == UNITS
        depth, pressure = (np.nanmax(file[name][:].filled(np.nan)) for name in ("DEPTH", "PRES"))
        pitch = np.nanmax(np.abs(file["PITCH"][:].filled(np.nan)))
    assert depth == pytest.approx(FLIGHT.depth, rel=0.02)
    assert pressure == pytest.approx(1.0065 * FLIGHT.depth, rel=0.03)  # 1 dbar is 0.994 m
    assert pitch == pytest.approx(FLIGHT.pitch, rel=0.02)


@needs_checker
@pytest.mark.filterwarnings("ignore:Passing the dataset:DeprecationWarning")
def test_it_passes_the_cf_check_and_declares_what_it_passes(og1, tmp_path, monkeypatch):
    """ACDD wants a standard name for each variable: it is missing only where CF has none."""
    found = complaints(og1, ["cf:1.10", "acdd:1.3"], tmp_path, monkeypatch)
    assert not any(found["cf:1.10"].values()), found["cf:1.10"]
    acdd = found["acdd:1.3"]
    declares = "Conventions does not contain 'ACDD-1.3'"
    lacking = [m for m in acdd["high_priorities"] + acdd["medium_priorities"] if m != declares]
    assert set(lacking) <= {"standard_name"}, acdd
    with netCDF4.Dataset(og1) as file:
        assert lacking
        assert "ACDD" not in file.Conventions
        assert "CF-1.10" in file.Conventions


def test_the_command_says_whose_flight_model_it_took(store, tmp_path, capsys):
    words = ["export", str(store), "--to", "og1", "--out", str(tmp_path / "out"), "--mission", "0"]
    assert PROGRAM.main(words) == 0
    assert "by the shipped vehicle seaglider" in capsys.readouterr().err
    assert PROGRAM.main([*words, "--overwrite", "--vehicle", "seaglider"]) == 0
    assert "shipped vehicle" not in capsys.readouterr().err


def test_flight_terms_and_currents_are_those_of_the_flight_model(og1, store):
    track = flown(LogStore(store), [1]).tracks[1]
    assert track.dive is not None
    with netCDF4.Dataset(og1) as file:
        mine = np.asarray(file["DIVE_NUMBER"][:]) == int(LogStore(store).number("dive")[1])
        w = np.ma.filled(file["VERT_CURR_MODEL"][:].astype(float), np.nan)[mine]
        # at a sample that two dives share the later one is in the file
        np.testing.assert_allclose(w[:-1], track.dive.water_up[: len(w) - 1], rtol=1e-6)
        assert file["VERT_CURR_MODEL"].standard_name == "upward_sea_water_velocity"
        assert file["VERT_CURR_MODEL"].coverage_content_type == "modelResult"
        dac = np.ma.filled(file["DAC_NORTH_MODEL"][:].astype(float), np.nan)[mine][:-1]
        np.testing.assert_allclose(dac, track.currents[0].north, rtol=1e-5)
        speed = np.asarray(file["GLIDER_SPEED_MODEL"][:])[mine]
        assert 0.1 < np.median(speed) < 0.6


def test_the_bounds_are_a_closed_ring_of_latitude_and_longitude(og1):
    """EPSG:4326 names the latitude first; the ring goes round the box of the limits once."""
    with netCDF4.Dataset(og1) as file:
        text, name = file.geospatial_bounds, file.geospatial_bounds_crs
        limits = {n: getattr(file, f"geospatial_{n}") for n in
                  ("lat_min", "lat_max", "lon_min", "lon_max")}  # fmt: skip
        assert limits["lat_min"] == pytest.approx(np.nanmin(file["LATITUDE"][:]))
        assert limits["lon_max"] == pytest.approx(np.nanmax(file["LONGITUDE"][:]))
    assert name == "EPSG:4326"
    inner = text.removeprefix("POLYGON ((").removesuffix("))")
    ring = np.array([[float(word) for word in pair.split()] for pair in inner.split(", ")])
    assert ring.shape == (5, 2)
    np.testing.assert_array_equal(ring[0], ring[-1])
    south, north, west, east = (round(limits[n], 5) for n in limits)
    assert {tuple(one) for one in ring} == {(a, b) for a in (south, north) for b in (west, east)}
    assert np.count_nonzero(np.diff(ring, axis=0)) == 4  # along one side at a time


def test_vertical_velocity_is_up_in_climbs_and_down_in_dives(og1):
    with netCDF4.Dataset(og1) as file:
        depth, time, up = (
            np.ma.filled(file[name][:].astype(float), np.nan)
            for name in ("DEPTH", "TIME", "GLIDER_VERT_VELO_MODEL")
        )
    rises = -np.gradient(depth, time)
    steady = (depth > 10.0) & (depth < FLIGHT.depth - 10.0) & np.isfinite(up)
    for sign in (-1.0, 1.0):
        way = steady & (sign * rises > 0.05)
        assert way.sum() > 50
        # the water of the log is still: the model rises as the depth falls
        np.testing.assert_allclose(np.median(up[way]), np.median(rises[way]), rtol=0.3)


def test_each_flight_term_has_the_sign_and_unit_that_its_name_says():
    """A dive that slips to starboard and is set by a current; its first sample hardly moves."""
    speed = np.array([0.01, 0.41, 0.41])
    motion = SimpleNamespace(
        speed=speed, surge=np.full(3, 0.4), sway=np.full(3, 0.03),
        angle_of_attack=np.full(3, np.pi / 60.0),
    )  # fmt: skip
    dive = SimpleNamespace(
        motion=motion, velocity=np.array([[0.3, -0.4]] * 3), sink_rate=np.full(3, 0.15),
        water_up=np.full(3, 0.02), speed_deviation=np.full(3, 0.03),
        attack_deviation=np.full(3, np.pi / 180.0),
    )  # fmt: skip
    current = SimpleNamespace(first=1, last=1, north=0.1, east=-0.05, deviation=0.01)
    tracks = SimpleNamespace(tracks={0: SimpleNamespace(dive=dive, currents=(current,))})
    joined = JoinedDives(SimpleNamespace(samples=[3]), (0,), np.arange(3))
    found = {name: one.values for name, one in flight_terms(joined, tracks)}
    steady = {
        "GLIDER_SPEED_MODEL": 0.41, "GLIDER_HORZ_VELO_MODEL": 0.5, "GLIDER_SURGE_MODEL": 0.4,
        "GLIDER_VERT_VELO_MODEL": -0.15,  # up
        "GLIDER_SWAY_MODEL": 0.03,  # to starboard
        "ANGLE_OF_ATTACK_MODEL": 3.0,  # degree
        "VERT_CURR_MODEL": 0.02, "DAC_NORTH_MODEL": 0.1, "DAC_EAST_MODEL": -0.05,
        "DAC_SD_MODEL": 0.01, "GLIDER_SPEED_SD_MODEL": 0.03, "ANGLE_OF_ATTACK_SD_MODEL": 1.0,
    }  # fmt: skip
    assert {name: values[1] for name, values in found.items()} == pytest.approx(steady)
    unknown = {name for name, values in found.items() if np.isnan(values[0])}
    assert unknown == {
        "ANGLE_OF_ATTACK_MODEL",
        "ANGLE_OF_ATTACK_SD_MODEL",
        *(f"DAC_{n}_MODEL" for n in ("NORTH", "EAST", "SD")),
    }


def test_conductivity_is_what_salinity_was_made_of(og1):
    with netCDF4.Dataset(og1) as file:
        values = [np.asarray(file[name][:], float) for name in ("CNDC", "TEMP", "PRES", "PSAL")]
        good = np.isfinite(values).all(axis=0)
        conductivity, temperature, pressure, salinity = (one[good] for one in values)
        again = gsw.SP_from_C(10.0 * conductivity, temperature, pressure)
        np.testing.assert_allclose(again, salinity, atol=1e-4)
        assert file["CNDC"].units == "S m-1"


def test_positions_are_good_at_fixes_and_the_first_one_is_of_the_deployment(og1):
    """OceanGliders' flags: 1 is good data, 8 an estimated value."""
    with netCDF4.Dataset(og1) as file:
        fixed = ~np.ma.getmaskarray(file["TIME_GPS"][:])
        assert 2 * FLIGHT.dives >= fixed.sum() > FLIGHT.dives
        for axis in ("LATITUDE", "LONGITUDE"):
            np.testing.assert_array_equal(file[f"{axis}_QC"][:], np.where(fixed, 1, 8))
            assert file[f"DEPLOYMENT_{axis}"][...] == file[f"{axis}_GPS"][fixed][0]
        assert file["DEPLOYMENT_TIME"][...] == file["TIME_GPS"][fixed][0]


def test_missing_values_are_flagged(store, tmp_path):
    data = xr.open_zarr(store).load()
    data["measured_temperature"][0, 20:40] = np.nan
    data["measured_gap"][0, 60:70] = 1.0
    logs = LogStore(write_store(data, tmp_path / "holed.zarr"))
    (path,) = export_og1_logs(logs, [0], tmp_path)
    with netCDF4.Dataset(path) as file:
        for variable in file.variables:
            if variable.endswith("_QC"):
                flags = np.asarray(file[variable][:])
                assert set(flags) <= set(file[variable].flag_values)
                bare = np.ma.getmaskarray(file[variable.removesuffix("_QC")][:])
                values = np.ma.filled(file[variable.removesuffix("_QC")][:].astype(float), np.nan)
                np.testing.assert_array_equal(flags == 9, bare | np.isnan(values), variable)
        assert (np.asarray(file["TEMP_QC"][:])[20:40] == 9).all()
        assert (np.asarray(file["DEPTH_QC"][:])[60:70] == 8).all()


def test_without_a_flight_model_the_track_is_the_vehicle_s_own_or_straight(store, tmp_path):
    data = xr.open_zarr(store).load().drop_vars("measured_pump")
    bare = LogStore(write_store(data, tmp_path / "bare.zarr"))
    found = flown(bare, [0, 1])
    assert found.model.startswith("none: ")
    assert "measured_pump" in found.model
    assert found.tracks[0].method == STRAIGHT
    half = len(found.tracks[0].position) // 2
    np.testing.assert_allclose(
        found.tracks[0].position[half],
        found.tracks[0].position[-1] * half / (len(found.tracks[0].position) - 1),
        rtol=1e-6,
    )
    # 3 cm/s from dive to dive of 2 h: halfway between fixes 76 m, and as the root of the time
    passed = np.ptp(bare.time(0)[found.tracks[0].fixes.sample])
    halfway = math.hypot(5.0, 0.03 * math.sqrt(7200.0 * passed / 8.0))
    assert found.tracks[0].deviation[half] == pytest.approx(halfway, rel=1e-3)
    way = np.cumsum(np.ones(data["measured_pitch"].shape), axis=1)
    data["measured_onboard_north"] = (("mission", "time"), way)
    data["measured_onboard_east"] = (("mission", "time"), 0.0 * way)
    own = flown(LogStore(write_store(data, tmp_path / "own.zarr")), [0]).tracks[0]
    assert own.method == ON_BOARD
    np.testing.assert_allclose(own.position[own.fixes.sample], own.fixes.position, atol=1e-6)
    with pytest.raises(StoreError, match="whatever --vehicle is given"):
        flown(bare, [0], vehicle="nautilus")
    with pytest.raises(VehicleError, match="unknown vehicle"):
        flown(LogStore(store), [0], vehicle="nautilus")


def test_a_flight_of_twin_simulate_is_corrected_too(tmp_path):
    run = open_exportable(simulated_flight(tmp_path, "glider", current="uniform:0.1,0.05", yos=1))
    (path,) = EXPORTERS["og1"].export(run, [0], tmp_path / "og1")
    with netCDF4.Dataset(path) as file:
        metres = [
            111e3 * (np.asarray(file["LATITUDE"][:]) - np.asarray(file["TRUE_LATITUDE"][:])),
            73e3 * (np.asarray(file["LONGITUDE"][:]) - np.asarray(file["TRUE_LONGITUDE"][:])),
        ]
        error = np.hypot(*metres)
        assert error.max() < 40.0
        assert simulated_mission(run, 0).duration == pytest.approx(np.ptp(file["TIME"][:]))
        fixed = np.asarray(file["DEAD_RECKONING"][:]) == 0
        assert fixed.any()
        gps = np.asarray(file["LATITUDE_GPS"][:])[fixed]
        np.testing.assert_allclose(np.asarray(file["LATITUDE"][:])[fixed], gps, atol=1e-7)
        assert "SIMULATED" in file.title
        assert file.start_date == "20030801T000000"


def test_a_metadata_file_that_is_none_is_told(store, tmp_path, capsys):
    wrong = tmp_path / "wrong.yml"
    wrong.write_text("title: alone\n")
    words = ["export", str(store), "--to", "og1", "--out", str(tmp_path / "og1")]
    assert PROGRAM.main([*words, "--metadata", str(wrong)]) == 2
    assert "has no section `metadata`" in capsys.readouterr().err
    wrong.write_text("metadata: [unclosed\n")
    refused("is not YAML", wrong, by=read_metadata)
    refused("cannot read metadata", tmp_path / "absent.yml", by=read_metadata)
    refused(
        "the parquet export takes no --metadata",
        LogStore(store),
        [0],
        tmp_path / "a.parquet",
        options=ExportOptions(metadata=wrong),
        by=EXPORTERS["parquet"].export,
    )
