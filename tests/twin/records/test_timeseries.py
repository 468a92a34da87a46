"""Time series: missions end to end over dates, as an oceanographer slices and averages them."""

import importlib.util

import numpy as np
import pytest
import xarray as xr
from logs import stored

import twin
from factory.samples import Flight
from factory.samples.gliders import write_slocum
from twin.errors import InputError, StoreError
from twin.mission import Mission, SawTooth
from twin.records.mission_dataset import dataset_of
from twin.records.store import write_store
from twin.records.timeseries import FROM_THE_START

FLIGHT = Flight()
YO = Mission(
    segments=(SawTooth(max_depth_m=40, pitch_deg=30, heading_deg=40, yos=1),),
    start_depth_m=3.0,
    start_heading_deg=30.0,
)
DAY, NEXT = "2023-09-01T23:59", "2023-09-02T12:00"
NO_DASK = importlib.util.find_spec("dask") is None


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """Two missions of different length, the earlier one second; the later over midnight."""
    runs = [
        twin.simulate(
            mission=YO,
            duration=length,
            sensors="ideal",
            density="thermocline",
            start={"latitude": 49.0, "longitude": -16.0, "time": time},
        )
        for length, time in ((90.0, NEXT), (240.0, DAY))
    ]
    return write_store(dataset_of(runs), tmp_path_factory.mktemp("series") / "runs.zarr")


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("series")
    return stored(folder / "real.zarr", "slocum", write_slocum(folder, FLIGHT))


def test_missions_follow_each_other_by_date_without_padding(simulated):
    series, store = twin.timeseries(simulated), twin.open_store(simulated)
    assert dict(series.sizes) == {"time": int(store["n_samples"].sum())}
    assert series.indexes["time"].is_monotonic_increasing
    assert list(dict.fromkeys(series["mission"].values.tolist())) == [1, 0]
    assert set(series.coords) == {"time"}
    assert {"latitude", "longitude", "depth", "mission", "gps_latitude"} <= set(series.data_vars)
    assert not FROM_THE_START & set(series.variables)
    first = series["mission"] == 1
    np.testing.assert_array_equal(series["true_pitch"].values[first], store["true_pitch"].values[1])
    np.testing.assert_array_equal(series["depth"], series["true_depth"])
    assert series["depth"].attrs["positive"] == "down"
    assert series["time"].attrs["standard_name"] == "time"
    assert series["true_surge"].attrs["units"] == "m s-1"
    assert not series["true_surge"].isnull().any()


def test_days_are_selected_and_hours_averaged(simulated):
    series = twin.timeseries(simulated)
    first = series.sel(time=slice("2023-09-01", "2023-09-01"))
    assert first.sizes["time"] == 120  # a minute at 2 Hz before midnight
    both = series.sel(time=slice("2023-09-01", "2023-09-02"))
    assert both.sizes == series.sizes
    hourly = twin.resample(series, "1h")
    at_noon = series["true_temperature"].where(series["mission"] == 0, drop=True)
    expected = pytest.approx(float(at_noon.mean()), rel=1e-5)
    assert float(hourly["true_temperature"].sel(time="2023-09-02T12:00")) == expected
    frame = series.to_dataframe()
    assert len(frame) == series.sizes["time"]
    assert frame["latitude"].between(48.99, 49.01).all()


def test_logs_are_a_series_of_their_own_depth(logged):
    series = twin.timeseries(logged)
    np.testing.assert_array_equal(series["depth"], series["measured_depth"])
    assert series.indexes["time"].is_monotonic_increasing
    day = str(series["time"].values[0])[:10]
    assert series.sel(time=day).sizes["time"] > 0
    hourly = twin.resample(series, "1h")
    assert np.isfinite(hourly["measured_depth"]).any()
    assert hourly["latitude"].attrs == series["latitude"].attrs
    fixed = np.isfinite(series["gps_latitude"].values)
    assert fixed.sum() >= 2
    for name in ("latitude", "longitude"):  # the track was corrected at the fixes
        away = (series[f"gps_{name}"] - series[name]).values[fixed]
        assert np.abs(away).max() < 3e-4
    unix = series["time"].values.astype("datetime64[ms]").astype(float) / 1e3
    latitude, longitude = FLIGHT.position(unix)
    assert np.abs(series["latitude"] - latitude).max() < 3e-4  # 30 m
    assert np.abs(series["longitude"] - longitude).max() < 4e-4
    one = twin.timeseries(logged, [1])
    assert set(one["mission"].values.tolist()) == {1}
    assert len(one.to_dataframe()) == one.sizes["time"]


def test_directions_are_averaged_as_directions():
    """Against vectors added by hand: headings about north, longitudes across 180."""
    time = np.datetime64("2024-05-01T00:00", "ns") + np.arange(8) * np.timedelta64(15, "m")
    series = xr.Dataset(
        {
            "measured_heading": ("time", [350.0, 20.0, 359.0, 1.0, 90.0, 270.0, np.nan, np.nan]),
            "commanded_heading": ("time", [300.0, 340.0, 300.0, 340.0, 10.0, 10.0, 10.0, 10.0]),
            "longitude": ("time", [179.9, -179.9, 179.9, -179.9, 10.0, 11.0, 10.0, 11.0]),
            "mission": ("time", [3, 3, 3, 4, 4, 4, 4, 4]),
            "depth": ("time", [1.0, 2.0, np.nan, 3.0, 4.0, 4.0, 4.0, 4.0]),
        },
        {"time": time},
    )
    for name in ("measured_heading", "commanded_heading"):
        series[name].attrs["units"] = "degree"
    series["longitude"].attrs["standard_name"] = "longitude"
    mean = twin.resample(series.isel(time=[3, 0, 7, 1, 2, 4, 5, 6]), "1h")
    assert list(mean.data_vars) == list(series.data_vars)
    turned = np.radians([350.0, 20.0, 359.0, 1.0])
    expected = np.degrees(np.arctan2(np.sin(turned).sum(), np.cos(turned).sum()))
    assert float(mean["measured_heading"][0]) == pytest.approx(expected % 360.0)
    assert np.isnan(mean["measured_heading"][1])  # east and west cancel
    np.testing.assert_allclose(mean["commanded_heading"], [320.0, 10.0])
    assert abs(float(mean["longitude"][0])) == pytest.approx(180.0)
    assert float(mean["longitude"][1]) == pytest.approx(10.5)
    np.testing.assert_array_equal(mean["mission"], [3, 4])
    np.testing.assert_allclose(mean["depth"], [2.0, 4.0])
    np.testing.assert_array_equal(twin.resample(series, "1 hour")["depth"], mean["depth"])
    for step in ("hourly", "", "0h", "-1h", "30", 3):
        with pytest.raises(InputError, match=f"step {step!r} is not a length of time"):
            twin.resample(series, step)
    with pytest.raises(InputError, match="UTC `time`"):
        twin.resample(xr.Dataset(), "1h")


@pytest.mark.parametrize("kind", ["simulated", "logged"])
def test_a_plain_store_makes_a_table_of_a_mission(kind, request):
    frame = xr.open_zarr(request.getfixturevalue(kind)).isel(mission=0)
    frame = frame.drop_dims("state", errors="ignore").to_dataframe()
    assert frame.index.name == "time"
    assert {"datetime", "latitude", "longitude", "measured_depth"} <= set(frame.columns)
    assert frame["datetime"].notna().any()


def test_a_dataset_of_a_store_serves_too(simulated):
    xr.testing.assert_identical(
        twin.timeseries(twin.open_store(simulated)).drop_attrs(),
        twin.timeseries(simulated).drop_attrs(),
    )


def test_what_cannot_be_asked_is_told(simulated, tmp_path):
    with pytest.raises(StoreError, match="missions 0 to 1, not 2"):
        twin.timeseries(simulated, [2])
    with pytest.raises(InputError, match="empty list"):
        twin.timeseries(simulated, [])
    with pytest.raises(InputError, match="path of a store"):
        twin.timeseries(xr.Dataset())
    undated = twin.open_store(simulated).load().drop_vars(["datetime", "start_time"])
    for array in undated.variables.values():
        array.encoding.clear()
    path = write_store(undated, tmp_path / "undated.zarr")
    with pytest.raises(StoreError, match="does not say when mission 0 began"):
        twin.timeseries(path)


@pytest.mark.skipif(
    importlib.util.find_spec("compliance_checker") is None,
    reason="compliance-checker is not installed (extra `test`)",
)
def test_a_series_passes_the_cf_check(logged, tmp_path):
    from compliance_checker.runner import CheckSuite, ComplianceChecker

    path, report = tmp_path / "series.nc", tmp_path / "report.txt"
    twin.timeseries(logged, [0]).to_netcdf(path)
    CheckSuite.load_all_available_checkers()
    passed, _ = ComplianceChecker.run_checker(
        str(path), ["cf:1.11"], verbose=0, criteria="lenient", output_filename=str(report)
    )
    assert passed, report.read_text()


@pytest.mark.skipif(NO_DASK, reason="dask is not installed")
def test_with_dask_nothing_is_read_before_it_is_asked_for(simulated):
    series = twin.timeseries(simulated)
    assert series["true_surge"].chunks is not None
    assert twin.open_store(simulated)["true_surge"].chunks is not None
    assert np.isfinite(series["true_surge"].mean().compute())
