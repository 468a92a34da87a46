"""Routes: ways through drawn eddies, around polygons and through places in the best order."""

import dataclasses
import json

import numpy as np
import pytest
import xarray as xr

from glider_twin_ops.forecast import Request, known_without_logs, mission_to, plan_routes
from glider_twin_ops.forecast.route_search import (
    BARRED,
    CORNERS,
    SLOWEST,
    STEP,
    RouteWater,
    Search,
    best_ways,
    eddies,
    erring,
    made_good,
    meets,
    way_times,
)
from glider_twin_ops.forecast.routes import route_water
from twin import Origin, load_vehicle
from twin.__main__ import PROGRAM
from twin.errors import InputError
from twin.records import unix_seconds
from twin.water.current import parse_field

SPEED = 0.25
TIME = "2026-03-01T00:00:00"
STOPS = np.array([[0.0, 0.0], [40e3, 0.0]])
NORTH, EAST = np.arange(-10e3, 50.1e3, 3e3), np.arange(-30e3, 30.1e3, 3e3)


def water(current=0.0):
    """A region of 60 by 60 km; still, or with a current (time, north, east, 2)."""
    whole = np.broadcast_to(current, (60, len(NORTH), len(EAST), 2)).copy()
    return RouteWater(north=NORTH, east=EAST, current=whole[None])


STILL = water()
JET = water(np.stack(np.broadcast_arrays(np.where(EAST > 6e3, 0.15, -0.075), 0.0), axis=-1))
"""Against the way on it and with it on its eastern side"""


def time_of(sea, way, *avoided):
    return way_times(sea, np.array(way), SPEED, avoided)[0]


def found(sea, *avoided):
    return best_ways(sea, STOPS, SPEED, avoided, np.random.default_rng(0))


def test_a_vehicle_makes_good_what_is_left_when_it_holds_its_bow_against_the_current():
    for (north, east), made in (
        ((0.1, 0.0), 0.35), ((-0.1, 0.0), 0.15), ((0.0, 0.15), 0.2), ((0.05, -0.15), 0.25),
        ((-0.5, 0.0), SLOWEST), ((0.5, 0.3), SLOWEST),
    ):  # fmt: skip
        assert made_good(north, east, 1.0, 0.0, SPEED) == pytest.approx(made), (north, east)


def test_in_still_water_nothing_is_faster_than_the_straight_way():
    straight, search = time_of(STILL, STOPS), Search(water=STILL, speed=SPEED)
    assert straight == pytest.approx(40e3 / SPEED)
    way = search.fastest(0, *STOPS)
    assert time_of(STILL, way) == pytest.approx(straight, rel=0.03)
    assert time_of(STILL, search.polished(way)) < 1.003 * straight


def test_a_way_goes_where_the_current_helps():
    (way,) = found(JET)
    assert time_of(JET, way) < 0.75 * time_of(JET, STOPS)
    assert way[:, 1].max() > 6e3
    np.testing.assert_allclose(way[[0, -1]], STOPS)


def test_a_way_through_eddies_is_as_good_as_many_that_are_tried():
    rng = np.random.default_rng(4)
    sea = water(0.18 * eddies(rng, STEP * np.arange(60.0), NORTH, EAST))
    straight, taken = time_of(sea, STOPS), min(time_of(sea, way) for way in found(sea))
    inner = zip(
        rng.uniform(0.0, 20e3, 500), rng.uniform(20e3, 40e3, 500),
        *rng.uniform(-25e3, 25e3, (2, 500)), strict=True,
    )  # fmt: skip
    tried = min(time_of(sea, [STOPS[0], (n, e), (m, f), STOPS[1]]) for n, m, e, f in inner)
    assert straight - taken > 0.9 * (straight - tried)
    assert taken < 0.95 * straight


def test_draws_of_the_error_have_the_size_that_is_asked_and_no_divergence():
    rng = np.random.default_rng(0)
    axis = np.arange(0.0, 400e3, 2e3)
    drawn = np.stack([eddies(rng, np.array([0.0]), axis, axis)[0] for _ in range(12)])
    assert drawn.std(axis=(0, 1, 2)) == pytest.approx([1.0, 1.0], abs=0.15)
    north = np.diff(drawn[..., 0], axis=1)[:, :, :-1]
    east = np.diff(drawn[..., 1], axis=2)[:, :-1]
    assert (north + east).std() < 0.2 * north.std()


def test_a_way_keeps_clear_of_polygons():
    def crosses(way):
        return meets(np.array(way[:-1]), np.array(way[1:]), [wall]).any()

    wall = np.array([[18e3, -20e3], [22e3, -20e3], [22e3, 8e3], [18e3, 8e3]])
    assert crosses(STOPS)
    assert crosses([[20e3, 0.0], [20e3, 1e3]])  # within it
    assert not crosses([[0.0, 0.0], [20e3, 9e3], [40e3, 0.0]])
    assert time_of(STILL, STOPS, wall) == BARRED
    (way,) = found(STILL, wall)
    assert not crosses(way)
    assert time_of(STILL, way) < 1.05 * np.hypot(20e3, 8e3) * 2.0 / SPEED  # around its corner
    ring = np.array([[30e3, -5e3], [45e3, -5e3], [45e3, 5e3], [30e3, 5e3]])  # around the goal
    assert Search(water=STILL, speed=SPEED, avoided=[ring]).fastest(0, *STOPS) is None


def test_a_way_keeps_the_corners_that_save_time():
    north = np.linspace(0.0, 40e3, 21)
    way = np.stack([north, np.interp(north, [0.0, 4e3, 36e3, 40e3], [0.0, 9e3, 9e3, 0.0])], axis=1)
    few = Search(water=JET, speed=SPEED).thinned(way)
    assert 4 <= len(few) <= CORNERS + 2
    np.testing.assert_allclose(few[[0, -1]], way[[0, -1]])
    assert time_of(JET, few) < 1.01 * time_of(JET, way)
    assert len(Search(water=STILL, speed=SPEED).thinned(way)) == 2


# --- what is asked for ----------------------------------------------------------------------------


def asked(current):
    mission = mission_to(
        "40.2,-50", depth=150.0, pitch_deg=26.0, surface_after_s=7200.0, radius=1000.0
    )
    return Request(
        vehicle=load_vehicle("slocum-200"), mission=mission, members=12, hours=100.0,
        place=Origin(latitude_deg=40.0, longitude_deg=-50.0, time=TIME),
        field=None if current is None else parse_field(current),
    )  # fmt: skip


def known():
    return known_without_logs(40.0, unix_seconds(TIME))


def test_nothing_is_promised_where_the_current_is_not_known():
    with pytest.raises(InputError, match="the current is not known"):
        plan_routes(asked(None), known())


def test_the_water_outside_of_a_file_is_refused(tmp_path):
    axes = {
        "time": np.array(["2026-03-01", "2026-03-30"], "datetime64[ns]"),
        "depth": np.array([0.0, 300.0]),
        "latitude": np.linspace(39.9, 40.3, 5),
        "longitude": np.linspace(-50.2, -49.8, 5),
    }
    path = tmp_path / "forecast.nc"
    slow = np.full([len(axis) for axis in axes.values()], 0.05)
    velocities = {
        name: (tuple(axes), slow, {"standard_name": f"{way}_sea_water_velocity", "units": "m s-1"})
        for name, way in (("uo", "eastward"), ("vo", "northward"))
    }
    xr.Dataset(velocities, axes).to_netcdf(path)
    rng, request = np.random.default_rng(0), asked(str(path))
    sea = route_water(request, known(), np.array([[0.0, 0.0], [20e3, 0.0]]), 30.0, rng)
    assert sea.lasts >= 30.0 * 3600.0
    assert sea.north[-1] < 34e3  # the file ends there
    np.testing.assert_allclose(sea.current[0], 0.05, atol=1e-3)
    assert sea.current[1:].std() == pytest.approx(0.1, rel=0.35)
    np.testing.assert_allclose(sea.current[1:11].mean(axis=0), sea.current[0], atol=1e-9)
    with pytest.raises(InputError, match="not known at place 1"):
        route_water(request, known(), np.array([[0.0, 0.0], [60e3, 0.0]]), 30.0, rng)


def test_vias_are_put_in_order_and_the_ways_flown(tmp_path, capsys):
    out = tmp_path / "ways.geojson"
    words = [
        "route", "--vehicle", "slocum-200", "--from", f"40,-50,{TIME}", "--to", "40.09,-50",
        "--via", "40.06,-50;40.03,-50.01", "--current", "uniform:0.05,0", "--pitch", "26",
        "--current-error", "0.02", "--members", "10", "--surface-every", "2", "--depth", "150",
        "--out", str(out), "--json",
    ]  # fmt: skip
    assert PROGRAM.main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["order"] == [1, 0]
    straight = told["routes"][0]
    assert (straight["name"], straight["gain"]) == ("straight", 0.0)
    assert straight["goto"].startswith("40.0300,-50.0100;40.0600,")
    assert straight["arrived"] == straight["flown"] == 10
    assert straight["hours_flown"] == pytest.approx(straight["hours"], rel=0.25)
    assert 0.2 < told["speed"] < 0.5
    shapes = json.loads(out.read_text())["features"]
    assert [one["properties"]["best"] for one in shapes].count(True) == 1
    assert PROGRAM.main(words) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_place_up_current_that_is_not_reached_is_not_recommended():
    plan, down = (
        plan_routes(asked(f"uniform:{north},0"), known(), fly_them=False) for north in (-0.6, 0.3)
    )
    assert plan.best.arrives < 0.5
    assert plan.verdict().startswith("take none: by the best way 0 of 100 draws are there within")
    assert down.best.arrives == 1.0
    assert "take none" not in down.verdict()
    # flights that were too short for the way say nothing of it
    none, slow = np.full(16, np.nan), float(np.quantile(down.best.hours, 0.95))
    short, whole = (
        dataclasses.replace(
            down, best=dataclasses.replace(down.best, flown=none, flown_hours=part * slow)
        )
        for part in (0.9, 1.1)
    )
    assert short.best.missed == 0.0
    assert "take none" not in short.verdict()
    assert whole.verdict().startswith("take none: 0 of 16 flights by the best way are there")


@pytest.mark.parametrize("part", [0.0, 0.5, 2.0, 3.0])
def test_a_forecast_that_misplaces_eddies_is_believed_by_its_error(part):
    """Part: variance of the error over that of the forecast."""
    rng = np.random.default_rng(5)
    axes = STEP * np.arange(20.0), np.arange(0.0, 200e3, 5e3), np.arange(0.0, 150e3, 5e3)
    forecast = np.array([0.1, 0.0]) + 0.1 * eddies(rng, *axes)
    mean = forecast.mean(axis=(0, 1, 2))
    live = float(((forecast - mean) ** 2).mean())
    drawn = erring(forecast, float(np.sqrt(part * live)), 41, rng, *axes)
    there = max(1.0 - part / 2.0, 0.0)
    np.testing.assert_allclose(drawn[0] - mean, there * (forecast - mean), atol=1e-12)
    np.testing.assert_allclose(drawn.mean(axis=0), drawn[0], atol=1e-12)
    off = float(((drawn[1:] - forecast) ** 2).mean())
    assert off == pytest.approx(part * live, rel=0.25, abs=1e-12)  # the error that was asked for
    if part <= 2.0:  # as lively as the forecast
        assert float(((drawn[1:] - mean) ** 2).mean()) == pytest.approx(live, rel=0.25)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--to 40", "write LAT,LON in degrees"),
        ("--to 40.1,-50 --via x,y", "--via x,y"),
        ("--to 40.1,-50", "the current is not known"),
        ("--to 40.1,-50 --current-error 0.1", "--current-error is for --current"),
        ("--to 40.1,-50 --avoid points.geojson", "no GeoJSON of polygons"),
        ("--to 40.1,-50 --avoid nowhere", "nowhere"),
    ],
)
def test_what_cannot_be_planned_is_said_in_one_line(tmp_path, capsys, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "points.geojson").write_text(
        '{"type": "Feature", "geometry": {"type": "Point", "coordinates": [0, 0]}}'
    )
    assert PROGRAM.main(["route", "--from", f"40,-50,{TIME}", *words.split()]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said
