"""Time and place in stores of the factory: real coordinates, from the true track and the draws."""

import json
import shutil

import gsw
import numpy as np
import pytest
import xarray as xr
import zarr

from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from factory.soundness import replay_mission
from twin.geodesy import from_tangent_plane
from twin.records.coordinates import COORDINATES, NO_TIME, PLACE

OFF_MONTEREY = (36.8, -122.4)


def test_they_are_coordinates_and_carry_cf_attributes(field_store):
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
    assert (starts == OFF_MONTEREY).all()
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


def test_a_store_without_them_still_opens_and_replays(paper_store, tmp_path):
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
