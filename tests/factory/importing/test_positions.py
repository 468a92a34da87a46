"""Positions of logged rows: dead-reckoned, corrected at the fixes, and said how."""

import numpy as np
import pytest
import xarray as xr
from logs import slocum

from factory.importing.dives.positions import row_positions
from factory.samples import Flight
from twin.geodesy import offset
from twin.records.coordinates import METHODS
from twin.records.logged import LogStore
from twin.records.store import write_store

FLIGHT = Flight()
ORIGIN = (49.5, -58.0)
STEP = 2.0


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("positions")
    dataset, _ = slocum(folder, FLIGHT)
    return write_store(dataset, folder / "real.zarr")


def signals(samples=400, **extra):
    """A row with a fix at both ends, 300 m apart to the north."""
    gps = np.full(samples, np.nan)
    gps[0], gps[-1] = 0.0, 300.0
    east = np.where(np.isfinite(gps), 0.0, np.nan)
    gap = np.zeros(samples)
    return {"measured_gap": gap, "measured_gps_north": gps, "measured_gps_east": east, **extra}


def metres(found):
    return offset(found.latitude, found.longitude, *ORIGIN)


def test_dives_are_where_the_vehicle_was_and_met_their_fixes(store):
    logs = LogStore(store)
    for mission in range(len(logs)):
        latitude, longitude, method = logs.positions(mission)
        assert method == METHODS["depth_rate_and_pitch"]
        truth = FLIGHT.position(logs.time(mission))
        north, east = offset(latitude, longitude, float(truth[0][0]), float(truth[1][0]))
        true_north, true_east = offset(*truth, float(truth[0][0]), float(truth[1][0]))
        assert np.hypot(north - true_north, east - true_east).max() < 25.0
        for k, fix in zip((0, -1), logs.fixes(mission), strict=True):
            assert np.hypot(*offset(latitude[k], longitude[k], *fix)) < 0.1


def test_they_are_coordinates_with_a_word_of_how_they_were_found(store):
    data = xr.open_zarr(store)
    assert {"datetime", "latitude", "longitude", "start_time"} <= set(data.coords)
    assert "position_method" in data["latitude"].attrs["comment"]
    assert data["position_method"].attrs["flag_meanings"].split() == list(METHODS)
    elapsed = data["datetime"].values - data["start_time"].values[:, None]
    seconds = elapsed[0, : int(data["n_samples"][0])] / np.timedelta64(1, "s")
    np.testing.assert_allclose(seconds, data["time"].values[: len(seconds)], atol=1e-3)


def test_without_anything_else_it_is_the_straight_line():
    found = row_positions(signals(), ORIGIN, STEP)
    north, east = metres(found)
    assert found.method == "straight_line"
    np.testing.assert_allclose(north, np.linspace(0.0, 300.0, 400), atol=0.05)
    np.testing.assert_allclose(east, 0.0, atol=0.05)


def test_beyond_its_last_fix_a_straight_line_is_nowhere():
    given = signals()
    given["measured_gps_north"][-1] = given["measured_gps_east"][-1] = np.nan
    found = row_positions(given, ORIGIN, STEP)
    assert np.isfinite(found.latitude[0])
    assert np.isnan(found.latitude[1:]).all()


def test_the_vehicles_own_track_is_bent_to_the_fixes():
    share = np.linspace(0.0, 1.0, 400)
    own = {"measured_onboard_north": 200.0 * share, "measured_onboard_east": 80.0 * share**2}
    found = row_positions(signals(**own), ORIGIN, STEP)
    north, east = metres(found)
    assert found.method == "onboard_track"
    np.testing.assert_allclose(north, 300.0 * share, atol=0.5)
    np.testing.assert_allclose(east, 80.0 * share**2 - 80.0 * share, atol=0.5)


def test_without_a_fix_nobody_knows():
    found = row_positions({"measured_gap": np.zeros(10)}, None, STEP)
    assert found.method == "unknown"
    assert np.isnan(found.latitude).all()
    assert np.isnan(found.longitude).all()
