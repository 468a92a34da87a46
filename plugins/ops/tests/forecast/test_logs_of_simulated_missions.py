"""Simulated missions that were exported as OG1.0 and imported as logs: what a forecast knows."""

import numpy as np
import pytest
import simulated_logs
import xarray as xr
from logs import stored

import twin
from factory.exporting import EXPORTERS
from factory.generation import open_exportable
from glider_twin_ops.forecast import known_from_logs
from glider_twin_ops.forecast.logged_leg import PITCH, flown_velocities
from twin.errors import StoreError
from twin.records import write_store


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """OG1.0 files of one flight that surfaces, and of a later one that ends under water."""
    folder = tmp_path_factory.mktemp("og1")
    surfaced = simulated_logs.simulated_flight(folder, "slocum-200")
    submerged = twin.simulate(
        mission="default",
        duration=1200.0,
        start={"latitude": 49.0, "longitude": -16.0, "time": "2003-08-05T00:00"},
        sensors="field",
    ).save(folder / "later.zarr")
    return [
        EXPORTERS["og1"].export(open_exportable(one), [0], folder / one.stem, lambda: None)[0]
        for one in (surfaced, submerged)
    ]


def store(files, folder):
    return stored(folder / "log.zarr", "og1", files, period=2.0)


def test_the_last_deployment_that_came_up_is_taken_and_a_later_one_named(files, tmp_path):
    known = known_from_logs(store(files, tmp_path))
    assert known.legs >= 1
    assert known.place == pytest.approx((49.0, -16.0), abs=0.05)
    assert known.source.endswith(
        f"of sim000000_20030801T000000 (way through the water: {PITCH}); no dive of "
        "sim000000_20030805T000000 ends with a fix"
    )


def test_a_mission_that_ends_under_water_says_which_fix_is_missing(files, tmp_path):
    with pytest.raises(StoreError, match=r"of 1 dive of .* 1 begins with one and 0 end;"):
        known_from_logs(store(files[1:], tmp_path))


def test_velocities_are_those_of_every_dive_that_the_model_flies(tmp_path):
    current = (0.07, -0.04)
    flown = simulated_logs.simulated_flight(
        tmp_path, "glider", sensors="ideal", current="uniform:0.07,-0.04,-0.01"
    )
    found = flown_velocities(flown, None)
    assert list(found) == [0]
    truth = xr.open_zarr(flown).load()
    deep = truth["true_depth"].values[0] > 5.0
    for column, axis in enumerate(("north", "east")):
        through = truth[f"true_velocity_{axis}"].values[0] - current[column]
        error = found[0][:, column] - through
        assert np.sqrt(np.mean(error[deep] ** 2)) < 0.01
    for name in ("pitch", "roll", "heading"):  # what is not known would count as current
        truth[f"measured_{name}"][0, deep.size // 4 : 3 * deep.size // 4] = np.nan
    assert flown_velocities(write_store(truth, tmp_path / "cut.zarr"), None) == {}
