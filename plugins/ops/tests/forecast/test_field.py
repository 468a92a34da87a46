"""A forecast field in a hindcast: it improves the forecast as far as it is right, and not more."""

import dataclasses
import json
import math

import numpy as np
import pytest
import xarray as xr
from logs import stored

from factory.samples import LATITUDE, LONGITUDE, START, Flight
from factory.samples.gliders import write_slocum
from glider_twin_ops.forecast import hindcast, walk
from glider_twin_ops.forecast.hindcast import field_mean
from twin import Series
from twin.__main__ import PROGRAM
from twin.errors import CurrentError
from twin.records import LogStore
from twin.water.current import parse_field

PARTS = ((0.16, 5.3, 0.2, 1.0), (0.14, 9.1, 1.9, -0.7), (0.12, 19.0, 4.0, 0.4))
"""m/s, hours, phase of the northward part, and how much of it is eastward, of the true current"""
ERRORS = ((0.05, 6.7, 2.0, -0.5), (0.04, 13.0, 0.5, 1.0))
"""The same of the field's error"""
BIAS = (0.04, -0.03)
"""m/s, of the field"""
STEP, HOURS = 900.0, 60


def flow(parts, time):
    """North, east [m/s] at a unix time, (2, time)."""
    rows = [
        size * np.cos(2.0 * np.pi * (np.asarray(time) - START) / (3600.0 * period) + phase)
        for size, period, phase, _ in parts
    ]
    return np.stack([sum(rows), sum(p[3] * row for p, row in zip(parts, rows, strict=True))])


def moved(parts, time):
    """The integral of it since START [m]."""
    total = np.zeros((2, len(time)))
    for size, period, phase, east in parts:
        turn = 2.0 * np.pi / (3600.0 * period)
        way = size / turn * (np.sin(turn * (time - START) + phase) - np.sin(phase))
        total += way * np.array([[1.0], [east]])
    return total


@dataclasses.dataclass(frozen=True)
class Drifting(Flight):
    """In a current that neither persists nor is tidal."""

    def state(self, time):
        found = super().state(time)
        north, east = moved(PARTS, np.asarray(time, float))
        return {**found, "north": found["north"] + north, "east": found["east"] + east}


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drift")
    flight = Drifting(dives=30, depth=500.0, step=20.0, north=0.0, east=0.0, surface=600.0)
    return stored(folder / "drift.zarr", "slocum", write_slocum(folder, flight), period=20.0)


@pytest.fixture(scope="module")
def alone(store):
    return hindcast([store])


def series(alone, parts, bias=(0.0, 0.0)):
    """A field from the first fix of the store on."""
    time = alone.deployments[0].legs[0].leg.start + STEP * np.arange(3600.0 * HOURS / STEP)
    north, east = flow(parts, time) + np.array(bias)[:, None]
    return Series(interval=STEP, north=tuple(north), east=tuple(east))


def test_the_truth_with_an_error_improves_the_forecast(store, alone):
    found = hindcast([store], current=series(alone, PARTS + ERRORS, BIAS))
    assert found.current.mean["forecast"] < 0.6 * alone.current.mean["forecast"]
    assert found.surfacing.mean["forecast"] < alone.surfacing.mean["forecast"]
    assert found.current.mean["persistence"] == alone.current.mean["persistence"]
    weights = found.deployments[0].walked.pool.pool.weights
    assert weights["field"] + weights["filter beside the field"] > 0.9
    assert found.current.coverage_90 > 0.7


def test_a_field_that_is_noise_is_not_believed(store, alone):
    noise = np.random.default_rng(4).normal(0.0, 0.25, (2, HOURS))
    strange = Series(interval=3600.0, north=tuple(noise[0]), east=tuple(noise[1]))
    found = hindcast([store], current=strange)
    weights = found.deployments[0].walked.pool.pool.weights
    assert weights["field"] + weights["filter beside the field"] < 0.3
    assert found.current.mean["forecast"] < 1.15 * alone.current.mean["forecast"]


def test_the_truth_is_taken_as_it_is(store, alone):
    found = hindcast([store], current=series(alone, PARTS))
    assert found.current.mean["forecast"] < 0.3 * found.current.mean["persistence"]


def test_a_surfacing_s_field_is_read_along_the_expected_way(store, alone):
    """What a dive's end will be is not known when it begins: its field is that of the way ahead."""
    with LogStore(store) as logs:
        rng, legs, asked = np.random.default_rng(6), [], []
        for one in alone.deployments[0].legs:  # no dive repeats the one before
            way = tuple(one.leg.through_water + rng.normal(0.0, 50.0, 2))
            legs.append(
                dataclasses.replace(one, leg=dataclasses.replace(one.leg, through_water=way))
            )

        def spy(one, alike, way, duration):
            asked.append((one.leg, alike.leg, tuple(way)))
            return mean(one, alike, way, duration)

        mean = field_mean(logs, legs, series(alone, PARTS))
        walk(legs, field=spy)
    ahead = [(leg, way) for leg, alike, way in asked if leg.start != alike.start]
    assert len(ahead) == len(legs) - 1
    assert all(math.dist(way, leg.through_water) > 0.01 for leg, way in ahead)


def gridded(folder, hours):
    """The field as a file that begins with the deployment and lasts so long."""
    time = START + np.arange(0.0, 3600.0 * hours, STEP)
    velocity = flow(PARTS + ERRORS, time) + np.array(BIAS)[:, None]
    axes = ("time", "depth", "latitude", "longitude")
    data = xr.Dataset(
        {
            name: (axes, np.broadcast_to(v[:, None, None, None], (len(time), 2, 3, 3)),
                   {"units": "m s-1", "standard_name": f"{word}_sea_water_velocity"})
            for name, word, v in (
                ("vo", "northward", velocity[0]), ("uo", "eastward", velocity[1]),
            )
        },
        {
            "time": (time * 1e9).astype("datetime64[ns]"),
            "depth": ("depth", [0.0, 600.0], {"units": "m", "positive": "down"}),
            "latitude": ("latitude", LATITUDE + np.array([-2.0, 0.0, 2.0]),
                         {"units": "degrees_north"}),
            "longitude": ("longitude", LONGITUDE + np.array([-3.0, 0.0, 3.0]),
                          {"units": "degrees_east"}),
        },
    )  # fmt: skip
    data.to_netcdf(folder / "field.nc")
    return folder / "field.nc"


def test_the_command_takes_a_file(store, alone, tmp_path, capsys):
    words = ["hindcast", str(store), "--json", "--current", str(gridded(tmp_path, 80.0))]
    assert PROGRAM.main(words) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["current"]["mean_m_per_h"]["forecast"] < 0.6 * alone.current.mean["forecast"]


def test_a_file_that_ends_too_early_is_refused(store, tmp_path):
    with pytest.raises(CurrentError, match="time"):
        hindcast([store], current=parse_field(str(gridded(tmp_path, 20.0))))
