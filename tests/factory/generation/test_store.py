"""Stores of the factory as others see them: xarray, zarr, the reader of single missions."""

import asyncio
import json
import re
import shutil
import warnings
from concurrent.futures import ThreadPoolExecutor

import gsw
import numpy as np
import pytest
import xarray as xr
import zarr
from unchanged import PRESETS, SEED, differences, expected_hashes
from zarr.storage import MemoryStore

import factory
from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate, generate_into
from factory.sampling.distribution import Fixed
from factory.sampling.draw import sensor_seed
from factory.sampling.fly import fly
from factory.sampling.recipe import make_recipe
from factory.soundness import replay_mission
from twin.errors import InputError, StoreError
from twin.geodesy import from_tangent_plane
from twin.records.coordinates import COORDINATES, NO_TIME, PLACE
from twin.records.schema import SCHEMA_VERSION, SIMULATED, VARIABLES
from twin.records.storage.checksums import array_checksums
from twin.records.storage.sharded import stored_values
from twin.records.store import open_store, read_trajectory
from twin.sensors import SensorSuite
from twin.vehicle.vehicle import load_vehicle


def test_xarray_opens_it_without_options_and_shows_units(field_store):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = xr.open_zarr(field_store)
    signals = [name for name in data if data[name].dims == ("mission", "time")]
    assert {entry.name for entry in SensorSuite().writes(signals)} <= set(signals)
    groups = {"true": "truth", "measured": "measured", "commanded": "commanded"}
    for name in signals:
        attributes = data[name].attrs
        assert attributes["units"] == VARIABLES[name].units
        assert attributes["long_name"]
        assert attributes["signal_group"] == groups[name.split("_")[0]]
        assert data[name].dtype == np.float32
    for name in data.variables:
        assert "long_name" in data[name].attrs, name
        assert "units" in data[name].attrs or data[name].dtype.kind in "iM", name
    assert data["true_pitch"].attrs["standard_name"] == "platform_pitch_fore_up"
    assert data.attrs["schema_version"] == SCHEMA_VERSION
    assert "Simulated" in data.attrs["comment"]


def test_the_stored_numbers_are_the_flown_ones(paper_store, recipe):
    """What zarr decodes is what the simulation gave, to the declared decimals."""
    made = recipe()
    flight = fly(made.parameters(1, 0), made.vehicle, made.suite, sensor_seed(0, 1, 0))
    group = zarr.open_group(paper_store, mode="r")
    for name, values in flight.signals.items():
        if name.startswith("true_energy_"):
            continue  # made of the others on demand
        array = group[name]
        assert isinstance(array, zarr.Array)
        stored = np.asarray(array[1])[: len(values)]
        decimals = VARIABLES[name].decimals
        np.testing.assert_array_equal(stored, stored_values(values, decimals))
        step = 0.0 if decimals is None else 0.5 * 10.0**-decimals
        np.testing.assert_allclose(stored, values, rtol=1.2e-7, atol=step)


def test_a_mission_starts_at_rest_in_moving_water(paper_store):
    data = open_store(paper_store)
    first = data.isel(time=0)
    for name in ("surge", "sway", "heave"):
        # at rest, but for the half step of acceleration that a staggered velocity is ahead
        np.testing.assert_allclose(first[f"true_{name}"], 0.0, atol=0.005)
    speed = np.hypot(first["true_velocity_north"], first["true_velocity_east"])
    np.testing.assert_allclose(speed, data["current_speed"], atol=0.005)
    assert float(data["true_surge"].isel(time=slice(60, None)).max()) > 0.2  # and glides off


def test_measured_is_true_without_sensor_errors_and_not_with_them(paper_store, field_store):
    paper, field = open_store(paper_store), open_store(field_store)
    for name in ("pitch", "heading", "depth", "shift", "yaw_rate"):
        np.testing.assert_array_equal(paper[f"measured_{name}"], paper[f"true_{name}"])
        assert float(np.abs(field[f"measured_{name}"] - field[f"true_{name}"]).max()) > 0
    assert not [name for name in paper if str(name).startswith("sensor_")]
    assert "sensor_compass_b_deg" in field
    assert int(np.isfinite(field["measured_gps_north"]).sum()) > 100


def test_every_drawn_value_is_a_variable_over_missions(field_store):
    run = GeneratedStore(field_store)
    drawn = [name for name, d in run.distributions.items() if not isinstance(d, Fixed)]
    drawn.remove("mission.duration_h")  # the array `duration` has it
    for name in drawn:
        array = run.dataset[run.table[name].variable]
        assert array.dims[0] == "mission"
        assert array.attrs["parameter"] == name
        assert array.attrs["distribution"] == run.distributions[name].text()
    made = make_recipe(preset="field", hours=0.5, changes=json.loads(run.dataset.attrs["changes"]))
    for mission in range(len(run)):
        assert repr(run.parameters(mission)) == repr(made.parameters(mission, 0))


def test_provenance_is_enough_to_rebuild_vehicle_and_sensors(field_store):
    run, nominal = GeneratedStore(field_store), load_vehicle()
    assert run.dataset.attrs["vehicle_mjcf"] == nominal.xml
    assert run.vehicle.flow_frame.drag == nominal.flow_frame.drag
    made = make_recipe(preset="field", hours=0.5)
    assert run.suite == made.suite
    settings = run.settings
    assert settings["integrator"] == "discrete"
    assert settings["timestep_s"] == 0.1
    assert {"mujoco", "numba", "numpy", "python", "glider-twin"} <= set(settings["versions"])
    assert re.match(
        rf"factory generate of glider-twin [\d.]+, recipe {run.recipe.digest}$",
        run.dataset.attrs["history"],
    )


def test_the_reader_of_single_missions_reads_it(paper_store):
    trajectory = read_trajectory(paper_store, 2)
    samples = int(open_store(paper_store)["n_samples"][2])
    assert len(trajectory.time) == samples
    assert trajectory.position.shape == (samples, 3)
    assert set(SIMULATED) == set(trajectory.signals)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda a: a.update(schema_version=SCHEMA_VERSION + 1), "upgrade"),
        (lambda a: a.pop("schema_version"), "does not say its schema_version"),
        (lambda a: a.pop("settings"), "was not made by `factory generate`"),
        (lambda a: a.update(settings="{"), "was not made by `factory generate`"),
        (lambda a: (a.pop("settings"), a.update(scenario="{}")), "`twin plot` and `twin render`"),
    ],
)
def test_foreign_damaged_and_newer_stores_are_told(tmp_path, paper_store, damage, message):
    store = tmp_path / "copy.zarr"
    store.mkdir()
    group = json.loads((paper_store / "zarr.json").read_text())
    damage(group["attributes"])
    (store / "zarr.json").write_text(json.dumps(group))
    with pytest.raises(StoreError, match=message):
        GeneratedStore(store)


def test_what_is_no_store_is_called_what_it_is(tmp_path):
    (tmp_path / "log.csv").write_text("time,depth\n")
    (tmp_path / "old.zarr").mkdir()
    (tmp_path / "old.zarr" / ".zgroup").write_text("{}")
    (tmp_path / "empty.zarr").mkdir()
    for name, told in (
        ("log.csv", "is a file; a store of missions is a folder"),
        ("old.zarr", "is a store of zarr's version 2"),
        ("empty.zarr", "is an empty folder"),
        ("nothing.zarr", "no store at"),
    ):
        with pytest.raises(StoreError, match=f"{told}.*`factory generate"):
            GeneratedStore(tmp_path / name)


def test_a_store_of_another_table_of_parameters_is_told(copied):
    text = (copied / "zarr.json").read_text()
    (copied / "zarr.json").write_text(text.replace("vehicle.ballast_g", "vehicle.lead_g"))
    run = GeneratedStore(copied)
    assert len(run) > 0  # its signals can still be read
    with pytest.raises(StoreError, match=r"other parameters \(vehicle.ballast_g, vehicle.lead_g\)"):
        run.parameters(0)


def test_a_store_in_memory_has_every_byte(recipe, paper_store):
    kept: dict = {}
    store = MemoryStore(kept)
    made = recipe()
    summary = factory.generate(store=store, hours=made.plan.hours, changes=made.changes, workers=1)
    assert summary.store is store
    assert summary.missions == len(made.plan)
    assert {key: value.to_bytes() for key, value in kept.items()} == {
        path.relative_to(paper_store).as_posix(): path.read_bytes()
        for path in paper_store.rglob("*")
        if path.is_file()
    }
    with pytest.raises(StoreError, match="holds something already"):
        generate_into(recipe(), MemoryStore(kept), workers=1)
    with pytest.raises(StoreError, match="is read-only"):
        generate_into(recipe(), MemoryStore(read_only=True), workers=1)


def test_a_store_and_a_path_exclude_each_other(tmp_path):
    for settings in ({}, {"out": tmp_path / "a.zarr", "store": MemoryStore()}):
        with pytest.raises(InputError, match="give either out, a path or an address, or store"):
            factory.generate(**settings)
    with pytest.raises(InputError, match="a zarr store must be empty"):
        factory.generate(store=MemoryStore(), resume=True)
    with pytest.raises(InputError, match="either a scheduler or an executor"):
        factory.generate(store=MemoryStore(), scheduler="tcp://x", executor=ThreadPoolExecutor())


def test_icechunk_keeps_it_in_one_commit(recipe, paper_store):
    icechunk = pytest.importorskip("icechunk", reason='needs pip install "glider-twin[icechunk]"')
    repository = icechunk.Repository.create(icechunk.in_memory_storage())
    session = repository.writable_session("main")
    generate_into(recipe(), session.store, workers=1)
    before = repository.readonly_session("main").store
    assert asyncio.run(before.is_empty(""))
    session.commit("missions of preset paper")
    assert len(list(repository.ancestry(branch="main"))) == 2  # the empty one and this
    there = xr.open_zarr(repository.readonly_session("main").store, consolidated=False)
    here = xr.open_zarr(paper_store)
    np.testing.assert_array_equal(there["true_depth"], here["true_depth"])
    assert there.attrs == here.attrs


@pytest.mark.parametrize("preset", PRESETS)
def test_an_hour_has_the_same_arrays(tmp_path, preset):
    """A change on purpose counts up `PHYSICS_VERSION` and keeps the new hashes
    (`python -m benchmarks.arrays --write`); docs/physics/versions.md shows it. Another
    version of MuJoCo, numba or numpy may change last bits."""
    store = tmp_path / "missions.zarr"
    generate(make_recipe(preset=preset, hours=1.0, seed=SEED), store, workers=2)
    assert differences(array_checksums(store), expected_hashes(1, preset)) == []


def test_a_changed_array_is_named():
    kept = expected_hashes(1, "paper")
    assert differences({**kept, "true_surge": "other"}, kept) == ["true_surge"]
    assert differences({**kept, "new": "x"}, kept) == ["new"]


# --- time and place, from the true track and the draws --------------------------------------------


def test_time_and_place_are_coordinates_and_carry_cf_attributes(field_store):
    data = xr.open_zarr(field_store)
    assert {*COORDINATES, *PLACE} <= set(data.coords)
    assert {*COORDINATES} <= set(data["true_depth"].coords)
    for name, standard, units in (
        ("latitude", "latitude", "degree_north"),
        ("longitude", "longitude", "degree_east"),
        ("start_latitude", "latitude", "degree_north"),
        ("start_longitude", "longitude", "degree_east"),
    ):
        assert data[name].attrs["standard_name"] == standard
        assert data[name].attrs["units"] == units
    for name in ("datetime", "start_time"):
        assert data[name].attrs["standard_name"] == "time"
        assert data[name].dtype.kind == "M"
    assert {data[name].attrs["axis"] for name in COORDINATES} == {"T", "Y", "X"}


def test_a_sample_is_where_and_when_the_vehicle_was(field_store):
    data = xr.open_zarr(field_store)
    raw = zarr.open_group(field_store, mode="r")["datetime"]
    for mission in range(data.sizes["mission"]):
        one, samples = data.isel(mission=mission), int(data["n_samples"][mission])
        elapsed = one["datetime"].values[:samples] - one["start_time"].values
        np.testing.assert_array_equal(
            elapsed, (1e3 * one["time"].values[:samples]).astype("timedelta64[ms]")
        )
        place = float(one["start_latitude"]), float(one["start_longitude"])
        track = (one[f"true_{name}"].values[:samples].astype(float) for name in ("north", "east"))
        expected = from_tangent_plane(*track, *place)
        for name, values in zip(("latitude", "longitude"), expected, strict=True):
            np.testing.assert_allclose(one[name].values[:samples], values, rtol=0, atol=1e-7)
            assert np.isnan(one[name].values[samples:]).all()
        assert np.isnat(one["datetime"].values[samples:]).all()
        assert (np.asarray(raw[mission])[samples:] == NO_TIME).all()


def test_field_missions_are_in_the_open_atlantic_on_any_day_of_a_year(field_store):
    run = GeneratedStore(field_store)
    for mission in range(len(run)):
        drawn = run.parameters(mission)
        assert run.array("start_latitude")[mission] == drawn.number("water.latitude")
        assert -38.0 <= run.array("start_longitude")[mission] <= -32.0
        days = run.array("start_time")[mission] - np.datetime64("2020-01-01")
        assert 0.0 <= days / np.timedelta64(1, "D") <= 366.0
    assert len(set(run.array("start_time"))) == len(run)


def test_paper_missions_are_off_monterey_bay(paper_store):
    data = xr.open_zarr(paper_store)
    starts = np.stack([data["start_latitude"], data["start_longitude"]], axis=1)
    assert (starts == (36.8, -122.4)).all()
    assert (data["start_time"].values == np.datetime64("2020-01-01")).all()


def test_a_gridded_current_says_where_it_is(tmp_path):
    days = np.array(["2003-08-01", "2003-08-04"], "datetime64[ns]")
    latitude, longitude = np.arange(47.0, 52.0), np.arange(-18.0, -13.0)
    flow = (("time", "lat", "lon"), np.full((2, 5, 5), 0.1))
    names = (("u", "eastward_sea_water_velocity"), ("v", "northward_sea_water_velocity"))
    path = tmp_path / "water.nc"
    xr.Dataset(
        {n: (*flow, {"standard_name": standard, "units": "m s-1"}) for n, standard in names},
        {
            "time": days,
            "lat": ("lat", latitude, {"units": "degrees_north"}),
            "lon": ("lon", longitude, {"units": "degrees_east"}),
        },
    ).to_netcdf(path)
    text = f"grid:{path},lat=49,lon=-16,time=2003-08-02"
    store = tmp_path / "missions.zarr"
    generate(make_recipe(preset="paper", hours=0.05, current=text), store, workers=1)
    data = xr.open_zarr(store)
    assert (data["start_latitude"] == 49.0).all()
    assert (data["start_longitude"] == -16.0).all()
    assert (data["start_time"].values == np.datetime64("2003-08-02")).all()


def test_a_store_without_coordinates_still_opens_and_replays(paper_store, tmp_path):
    """As stores were before: no coordinates, and parameters that did not exist."""
    old = tmp_path / "old.zarr"
    shutil.copytree(paper_store, old)
    for name in (*COORDINATES, *PLACE):
        shutil.rmtree(old / name)
    metadata = old / "zarr.json"
    group = json.loads(metadata.read_text())
    for name in (*COORDINATES, *PLACE):
        del group["consolidated_metadata"]["metadata"][name]
    for array in group["consolidated_metadata"]["metadata"].values():
        array["attributes"].pop("coordinates", None)
    del group["attributes"]["coordinates"]
    settings = json.loads(group["attributes"]["settings"])
    for name in ("water.longitude", "mission.start_day"):
        del settings["distributions"][name]
    group["attributes"]["settings"] = json.dumps(settings)
    metadata.write_text(json.dumps(group))
    with GeneratedStore(old) as run:
        assert "latitude" not in run
        assert run.parameters(0).number("water.longitude") == pytest.approx(-121.8)
        assert replay_mission(run, 0).identical


def test_the_density_is_that_of_temperature_and_salinity_where_the_mission_is(field_store):
    """TEOS-10 with the composition of the salt at the mission's own place."""
    data = xr.open_zarr(field_store)
    for mission in range(data.sizes["mission"]):
        one = data.isel(mission=mission, time=slice(0, int(data["n_samples"][mission])))
        place = float(one["start_longitude"]), float(one["start_latitude"])
        pressure = gsw.p_from_z(-one["true_depth"].values.astype(float), place[1])
        absolute = gsw.SA_from_SP(one["true_salinity"].values, pressure, *place)
        conservative = gsw.CT_from_t(absolute, one["true_temperature"].values, pressure)
        expected = gsw.rho(absolute, conservative, pressure)
        error = np.abs(one["true_density"].values - expected)
        # depths are linear between the metres of the profile, densities kept to 1e-4
        assert error.max() < 3e-4
        conductivity = one["measured_conductivity"].values
        assert np.isfinite(conductivity).all()
