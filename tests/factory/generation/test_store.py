"""Stores of the factory as others see them: xarray, zarr, the reader of single missions."""

import json
import re
import warnings

import numpy as np
import pytest
import xarray as xr
import zarr

from factory.generation.generated_store import GeneratedStore
from factory.sampling.distribution import Fixed
from factory.sampling.draw import samples_in, sensor_seed
from factory.sampling.fly import fly
from factory.sampling.recipe import make_recipe
from twin.errors import StoreError
from twin.records.schema import SCHEMA_VERSION, SIMULATED, VARIABLES
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


def test_padding_is_nan_and_samples_are_counted(field_store):
    data = open_store(field_store)
    for mission in range(data.sizes["mission"]):
        samples = int(data["n_samples"][mission])
        assert samples == samples_in(float(data["duration"][mission]))
        depth = data["true_depth"][mission].values
        assert np.isfinite(depth[:samples]).all()
        assert np.isnan(depth[samples:]).all()
    assert data["n_samples"].max() == data.sizes["time"]
    np.testing.assert_array_equal(data["time"], np.arange(data.sizes["time"]) * 0.5)


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
