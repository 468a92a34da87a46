"""Forecasts: surfacings of members, their ellipses, what is written of them, and the command."""

import dataclasses
import datetime
import html
import json
import math
import re
import threading
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from browser import Browser, needs_browser
from logs import part, stored

import twin
from factory.samples import START, Flight
from factory.samples.gliders import gps_columns, slocum_columns, write_slocum
from glider_twin_ops.commands.forecast import vehicle_of
from glider_twin_ops.forecast import (
    MemberFlight,
    Request,
    begun,
    forecast,
    known_from_logs,
    known_without_logs,
    mission_to,
    notice_boxes,
)
from glider_twin_ops.forecast.member_flights import (
    HALF,
    NINETY,
    degrees,
    fly,
    left_out,
    prediction_quantile,
    surfacings,
    surfacings_of,
)
from glider_twin_ops.forecast.members import draw_models, draw_water, members_of
from glider_twin_ops.pages import forecast_row, write_forecast
from glider_twin_ops.pages.forecast_page import page
from twin import Origin, Scenario, Uniform, load_vehicle, parse_current
from twin.__main__ import PROGRAM
from twin.checks import EndsApart
from twin.errors import (
    CurrentError,
    InaccurateStep,
    InputError,
    MissionError,
    SimulationUnstable,
    StoreError,
    VehicleError,
    WriteError,
)
from twin.geodesy import offset
from twin.identify import other_kind
from twin.navigation.current import Leg
from twin.physics import fly_in_lanes, utc_text
from twin.records import LogStore, unix_seconds, write_store
from twin.show.style import moment_of
from twin.vehicle.vehicle import parse_vehicle

PLACE = Origin(latitude_deg=36.8, longitude_deg=-122.4, time="2026-11-22T12:00:00")
UNIX = 1.795e9
CHI_HALF, CHI_NINETY = 2.0 * np.log(2.0), 2.0 * np.log(10.0)
"""Quantiles of chi-squared with two degrees of freedom"""


def goes_to(place="37,-122.4", **settings):
    usual = {"depth": 50.0, "pitch_deg": 26.0, "surface_after_s": 1500.0, "radius": 100.0}
    return mission_to(place, **usual | settings)


def asked(**changes):
    usual = {"vehicle": load_vehicle("glider"), "mission": goes_to(), "place": PLACE,
             "hours": 1.0, "members": 24}  # fmt: skip
    return Request(**{**usual, **changes})


def prior():
    return known_without_logs(36.8, UNIX)


def drawn(known, count=24, **rngs):
    """Courses of the water by the filter, and by all models with the deviation at the start."""
    one = draw_water(
        known.filter_, 3600.0, count, np.random.default_rng(rngs.get("first", 0)), 7200.0
    )
    return one, *draw_models(one, known.pool, np.random.default_rng(rngs.get("then", 0)))


@pytest.fixture(scope="module")
def steps():
    """Every stage of one forecast."""
    found = []
    forecast(asked(energy_left_kwh=1.5), prior(), refined=found.append)
    return found


def test_the_mean_comes_first_and_all_members_last(steps):
    ends = steps[0], steps[-1]
    assert [(one.flown, one.complete) for one in ends] == [(1, False), (24, True)]
    assert [one.number for one in steps[-1].surfacings] == [1, 2]


def test_the_first_member_is_the_nominal_flight(steps):
    run = twin.simulate(
        Scenario(
            mission=dataclasses.replace(goes_to(), duration_s=3600.0),
            start={"latitude": 36.8, "longitude": -122.4, "time": PLACE.time},
            sample_period=10.0,
        )
    )
    found = surfacings(run["true_depth"], 1.5)
    for one, index in zip(steps[0].surfacings, found, strict=True):
        # a longer physics step and a cut heading are all that differs
        assert (one.north, one.east) == pytest.approx(run.position[index, :2], abs=8.0)
        assert one.time_s == pytest.approx(run.time[index], abs=20.0)


def test_ellipses_grow_with_time_and_hold_the_members(steps):
    first, second = steps[-1].surfacings
    assert second.ellipse(NINETY).semi_major_m > first.ellipse(NINETY).semi_major_m
    assert first.ellipse(HALF).semi_major_m < first.ellipse(NINETY).semi_major_m
    ellipse = first.ellipse(NINETY)
    expected = np.sqrt(prediction_quantile(0.9, 24)) * drawn(prior())[2] * first.time_s
    radius = np.sqrt(ellipse.semi_major_m * ellipse.semi_minor_m)
    assert radius == pytest.approx(expected, rel=0.35)


def test_an_ellipse_holds_its_part_of_normal_members():
    rng = np.random.default_rng(0)
    covariance = np.array([[300.0**2, 2e4], [2e4, 120.0**2]])
    places = rng.multivariate_normal([1e3, 500.0], covariance, 5000)
    flights = [_flight(place) for place in places]
    (one,) = surfacings_of(flights, PLACE)
    off = places - [one.north, one.east]
    distance = np.einsum("mi,ij,mj->m", off, np.linalg.inv(one.covariance), off)
    assert np.mean(distance < CHI_NINETY) == pytest.approx(0.90, abs=0.02)
    assert np.mean(distance < CHI_HALF) == pytest.approx(0.50, abs=0.02)
    ellipse = one.ellipse(NINETY)
    values, vectors = np.linalg.eigh(CHI_NINETY * covariance)
    assert ellipse.semi_major_m == pytest.approx(np.sqrt(values[1]), rel=0.05)
    bearing = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])) % 180.0
    assert ellipse.bearing_deg == pytest.approx(bearing, abs=2.0)


def _flight(place, time=60.0):
    return MemberFlight(
        time=np.array([time]), place=np.array([place]), energy=np.array([10.0]),
        track=np.zeros((2, 2)), times=np.zeros(2), duration=100.0, taken=20.0, end=np.zeros(6),
    )  # fmt: skip


def test_bounds_of_times_say_how_far_another_draw_moves_them():
    rng = np.random.default_rng(3)
    told = []
    for _ in range(300):
        times = rng.normal(7200.0, 900.0, 100)
        (one,) = surfacings_of([_flight((0.0, 0.0), time) for time in times], PLACE)
        told.append((one.early_s, one.late_s, one.bound_s))
    early, late, said = np.array(told).T
    assert np.mean(said) == pytest.approx(0.5 * (early.std() + late.std()), rel=0.1)


def test_two_members_spread_as_far_as_they_are_apart():
    (one,) = surfacings_of([_flight((0.0, 0.0)), _flight((400.0, 0.0))], PLACE)
    (alone,) = surfacings_of([_flight((200.0, 0.0))], PLACE)
    spread = one.covariance - alone.covariance  # beyond that of the fix
    np.testing.assert_allclose(spread, [[2.0 * 200.0**2, 0.0], [0.0, 0.0]], atol=1e-6)


def test_an_ellipse_of_few_members_holds_its_part_of_further_ones():
    rng = np.random.default_rng(1)
    held, count, trials = 0, 10, 4000
    for _ in range(trials):
        draws = rng.standard_normal((count + 1, 2))
        off = draws[-1] - draws[:-1].mean(axis=0)
        squared = off @ np.linalg.inv(np.cov(draws[:-1], rowvar=False)) @ off
        held += squared < prediction_quantile(0.9, count)
    assert held / trials == pytest.approx(0.9, abs=0.015)
    assert prediction_quantile(0.9, 10**6) == pytest.approx(CHI_NINETY, rel=1e-4)


def test_a_surfacing_around_the_horizon_is_told_of_all_members_or_not_at_all():
    horizon = 100.0
    early, late = _flight((0.0, 0.0), 90.0), _flight((50.0, 0.0), 120.0)
    none = dataclasses.replace(late, time=np.array([]), place=np.zeros((0, 2)))
    (one,) = surfacings_of([early] * 60 + [late] * 40, PLACE, horizon)
    assert (one.part, one.time_s, one.north) == (1.0, pytest.approx(102.0), pytest.approx(20.0))
    # most come up after the horizon: not asked for
    assert surfacings_of([early] * 40 + [late] * 60, PLACE, horizon) == ()
    assert left_out([early] * 40 + [late] * 60, 0, horizon) == ""
    # some are not up when their flights end: the mean of the others would be too early
    cut = [early] * 60 + [none] * 40
    assert surfacings_of(cut, PLACE, horizon) == ()
    assert "surfacing 1 is left out: only 60 %" in left_out(cut, 0, horizon)


def test_members_fly_on_until_the_late_ones_are_up():
    scenarios = members_of(asked(hours=0.5, members=12), prior()).scenarios
    climb, last = 50.0 / 0.2, scenarios[-1]
    assert all(one.duration > 1800.0 + climb for one in scenarios)
    assert len(last.current.north) * last.current.interval > last.duration  # drawn to the end, too


def test_energy_and_days_follow_from_the_power(steps):
    found = steps[-1]
    assert found.days_left == pytest.approx(1.5 * 3.6e6 / found.power_w / 86400.0)
    assert found.surfacings[1].energy_kj > found.surfacings[0].energy_kj > 0.5
    without = dataclasses.replace(found.request, energy_left_kwh=None)
    assert dataclasses.replace(found, request=without).days_left is None


@pytest.fixture(scope="module")
def short():
    """Half an hour, ten members."""
    return forecast(asked(members=10, hours=0.5), prior(), threads=1)


def test_results_do_not_depend_on_the_threads(short):
    assert short.describe() == forecast(short.request, prior(), threads=3).describe()


def test_lanes_and_mujoco_fly_the_same_draws_to_the_same_places(short):
    mujoco = forecast(dataclasses.replace(short.request, engine="mujoco"), prior())
    ours, theirs = short.surfacings[0], mujoco.surfacings[0]
    # a sample of 10 s may be one sooner or later: 4 m at 0.4 m/s, and the depth's rate the same
    apart = np.linalg.norm(ours.members - theirs.members, axis=1)
    assert 0.0 < apart.max() < 8.0
    assert ours.time_s == pytest.approx(theirs.time_s, abs=10.0)
    assert ours.energy_kj == pytest.approx(theirs.energy_kj, rel=0.01)
    assert (short.describe()["engine"], mujoco.describe()["engine"]) == ("lanes", "mujoco")
    assert mujoco.describe()["beside_mujoco"] is None


def test_the_first_member_s_end_is_compared_with_mujoco_s(short):
    said = short.describe()["beside_mujoco"]
    one = members_of(short.request, prior()).scenarios[0]
    ours = twin.simulate(one)
    theirs = twin.simulate(dataclasses.replace(one, engine="mujoco", timestep=None))
    names = [f"true_velocity_{axis}" for axis in ("north", "east", "down")]
    for name, ends in (
        ("position_m", [run.position[-1] for run in (ours, theirs)]),
        ("speed_m_s", [np.array([run[one][-1] for one in names]) for run in (ours, theirs)]),
    ):
        assert said[name] == pytest.approx(np.linalg.norm(ends[0] - ends[1]), rel=1e-9)
    assert 0.0 < said["position_m"] < 2.0
    assert said["time_s"] == one.duration // 10.0 * 10.0
    assert said["unstable"] == ""


@pytest.mark.parametrize(
    ("position", "speed", "hours", "says"),
    [
        (2.0, 1e-5, 6.0, "after 6.00 h: usual"),
        (2.0, 0.041, 6.0, "2 m and 41 mm/s from it after 6.00 h: usual, its speed differs most "
         "while it turns"),
        (11.0, 0.0, 6.0, "more than the 10 m that are usual; --engine mujoco flies all"),
        (19.0, 0.0, 12.0, "after 12.00 h: usual"),
    ],
)  # fmt: skip
def test_whether_two_engines_differ_as_usual_is_said(position, speed, hours, says):
    found = EndsApart(time_s=3600.0 * hours, position_m=position, speed_m_s=speed, unstable="")
    assert found.text.endswith(says)


def test_a_bound_on_another_day_has_its_day(steps):
    late = asked(place=dataclasses.replace(PLACE, time="2026-11-22T23:40:00"))
    found = dataclasses.replace(steps[-1], request=late)
    for time, last, says in ((600.0, 1800.0, "23:40 to 11-23 00:10"),
                             (1800.0, 2400.0, "11-22 23:40 to 00:20")):  # fmt: skip
        one = dataclasses.replace(found.surfacings[0], time_s=time, early_s=0.0, late_s=last)
        assert forecast_row(found, one)["5 to 95 %"] == says


def test_warnings_of_the_flight_beside_lanes_do_not_reach_them(monkeypatch):
    """Its filters of warnings are put back while the lanes fly: these still may step coarsely."""
    began, flying, over = (threading.Event() for _ in range(3))

    def beside(scenario):
        with warnings.catch_warnings():
            began.set()
            assert flying.wait(60.0)
        over.set()
        return SimulationUnstable("of the test", mission=0, time_s=1.0)

    def all_members(scenarios, **settings):
        assert began.wait(60.0)
        return fly(scenarios, **settings)

    def in_lanes(scenarios, **settings):
        flying.set()
        assert over.wait(60.0)
        warnings.warn("too long", InaccurateStep, stacklevel=2)
        return fly_in_lanes(scenarios, **settings)

    monkeypatch.setattr("glider_twin_ops.forecast.surfacing_forecast.flown_in_mujoco", beside)
    monkeypatch.setattr("glider_twin_ops.forecast.surfacing_forecast.fly", all_members)
    monkeypatch.setattr("glider_twin_ops.forecast.member_flights.fly_in_lanes", in_lanes)
    assert forecast(asked(members=10), prior()).flown == 10


def test_mujoco_s_failure_beside_lanes_is_told(monkeypatch):
    failure = SimulationUnstable("too stiff", mission=0, time_s=1.0)
    monkeypatch.setattr(
        "glider_twin_ops.forecast.surfacing_forecast.flown_in_mujoco", lambda _: failure
    )
    said = forecast(asked(members=10, hours=0.3), prior()).beside_mujoco
    assert said.position_m is None
    assert said.text == "MuJoCo could not fly it: too stiff"


@pytest.mark.parametrize("engine", ["lanes", "mujoco"])
def test_members_fly_twice_the_vehicle_file_s_step(engine):
    assert members_of(asked(members=10, engine=engine), prior()).scenarios[3].timestep == 0.2


def test_a_field_carries_the_members_and_its_error_spreads_them():
    request = asked(field=Uniform(north=0.0, east=0.3), field_error=0.05, hours=0.5)
    found = members_of(request, prior())
    currents = np.array([s.current.velocity(900.0, 0.0, 0.0, 10.0)[:2] for s in found.scenarios])
    assert currents[0] == pytest.approx([0.0, 0.3], abs=1e-9)
    assert currents[1:, 1].std() == pytest.approx(0.05, rel=0.4)
    assert "field" in found.spread["current"]


def test_what_is_said_to_be_drawn_is_what_is_drawn():
    known = prior()
    _, water, _ = drawn(known, 4000, first=2, then=3)
    said = members_of(asked(members=10), known).spread
    deviation = float(re.search(r"known to ([0-9.]+) m/s", said["current"])[1])
    assert water.current[1:, 0].std() == pytest.approx(deviation, rel=0.03)
    compass = float(re.search(r"\+-([0-9.]+) degree", said["compass"])[1])
    assert np.degrees(water.compass[1:]).std() == pytest.approx(compass, rel=0.05)
    assert "+-6.0 %" in said["speed"]  # and not the scatter of ten members


def test_members_fly_to_starboard_where_the_compass_was_known_to_read_too_little(monkeypatch):
    """True heading less reading is 20 degrees: the reading is held, so that all turns right."""
    known = np.radians(20.0), 1e-9
    monkeypatch.setattr("glider_twin_ops.forecast.members.known_compass", lambda _: known)
    one = members_of(asked(hours=0.5, members=10), prior()).scenarios[0]
    run = twin.simulate(dataclasses.replace(one, current=None))
    first, last = np.searchsorted(run.time, (600.0, 1400.0))  # of a dive to the north
    north, east = (run[f"true_{axis}"][last] - run[f"true_{axis}"][first]
                   for axis in ("north", "east"))  # fmt: skip
    assert np.degrees(np.arctan2(east, north)) == pytest.approx(20.0, abs=2.0)


def test_a_file_of_another_time_is_refused_with_the_way_out(tmp_path):
    axes = {"time": [np.datetime64("2026-11-20", "ns")], "latitude": [36.0, 38.0],
            "longitude": [-124.0, -121.0]}  # fmt: skip
    still = tuple(axes), np.zeros((1, 2, 2)), {"units": "m/s"}
    xr.Dataset({"uo": still, "vo": still}, axes).to_netcdf(tmp_path / "now.nc")
    with pytest.raises(CurrentError, match=r"begins at 2026-11-22T12.*grid:FILE,hold=216000"):
        members_of(asked(field=parse_current(f"grid:{tmp_path}/now.nc")), prior())
    field = parse_current(f"grid:{tmp_path}/now.nc,hold=216000")
    assert len(members_of(asked(field=field), prior()).scenarios) == 24


@pytest.mark.parametrize("count", [9, 39])
def test_a_box_of_a_notice_holds_another_vehicle_as_often_as_it_says(count):
    """One of `count` + 1 alike is the farthest to each of four sides: no distribution matters."""
    rng, trials = np.random.default_rng(4), 400
    held, says = 0, set()
    for _ in range(trials):
        places = 5e3 * rng.standard_normal((count + 1, 2))
        *ways, other = [(np.array([0.0, 3600.0]), np.stack([one, one])) for one in places]
        request = SimpleNamespace(place=PLACE, horizon=3600.0)
        found = SimpleNamespace(ways=ways, request=request, begins=datetime.datetime(2026, 11, 22))
        (box,) = notice_boxes(found)
        ((longitude, latitude), _) = degrees(other[1], PLACE)
        held += box.west <= longitude <= box.east and box.south <= latitude <= box.north
        says.add(box.holds)
    (part,) = says
    inside = ((count - 1.0) / (count + 1.0)) ** 2  # north and east are independent here
    noise = math.sqrt(inside * (1.0 - inside) / trials)
    assert held / trials == pytest.approx(inside, abs=4.0 * noise)
    assert part <= inside  # whatever their correlation
    assert part == pytest.approx(inside, abs=0.05)


def test_geojson_holds_points_ellipses_and_the_track(steps):
    document = steps[-1].geojson()
    kinds = [f["geometry"]["type"] for f in document["features"]]
    assert kinds.count("Polygon") == 4
    assert kinds.count("LineString") == 1
    ring = next(f for f in document["features"] if f["properties"].get("holds") == 0.9)
    points = np.array(ring["geometry"]["coordinates"][0])
    assert points[0] == pytest.approx(points[-1])
    surfacing = steps[-1].surfacings[0]
    assert points.mean(axis=0) == pytest.approx([surfacing.longitude, surfacing.latitude], abs=2e-3)
    x, y = points.T
    assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0.0  # counterclockwise, as RFC 7946 has it
    json.dumps(document, allow_nan=False)


def test_the_date_line_tears_nothing():
    place = Origin(latitude_deg=-45.0, longitude_deg=179.99, time=PLACE.time)
    flights = [_flight((0.0, east)) for east in (500.0, 1500.0, 2500.0)]
    (one,) = surfacings_of(flights, place)
    assert one.longitude == pytest.approx(-179.991, abs=0.002)
    ring = one.ring(NINETY, place)
    assert np.abs(np.diff(ring[:, 0])).max() < 0.1


def test_the_page_needs_no_network_and_shows_every_surfacing(steps, tmp_path):
    text = page(steps[-1])
    assert not re.findall(r'(?:src|href)="', text)
    assert set(re.findall(r"https?://[^\"' ]+", text)) == {"http://www.w3.org/2000/svg"}
    assert text.count('class="ninety"') == text.count('class="half"') == 2
    assert 'http-equiv="refresh"' not in text
    assert 'http-equiv="refresh"' in page(steps[0], reload_s=5.0)
    write_forecast(steps[0], tmp_path / "next")
    path = write_forecast(steps[-1], tmp_path / "next")
    document = json.loads((path.parent / "forecast.json").read_text())
    assert document["flown"] == 24
    assert json.loads((path.parent / "forecast.geojson").read_text())["features"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("x")
    with pytest.raises(WriteError, match="did not write it"):
        write_forecast(steps[-1], tmp_path / "mine")


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    flight = Flight(dives=8, depth=200.0, north=0.12, east=-0.05, step=10.0)
    return stored(folder / "real.zarr", "slocum", write_slocum(folder, flight), period=10.0)


def test_logs_tell_the_place_the_time_and_the_current(store):
    known = known_from_logs(store)
    current, covariance = known.filter_.current
    # logs without a vehicle take 3 degree for the angle of attack; this glider has none
    assert current == pytest.approx([0.12, -0.05], abs=0.06)
    assert current == pytest.approx(known.last_current, abs=0.03)
    assert np.sqrt(covariance[0, 0]) < 0.06
    flight = Flight(dives=8, depth=200.0, north=0.12, east=-0.05)
    end = START + 8 * flight.cycle
    assert known.time == pytest.approx(end, abs=60.0)
    before = covariance[0, 0]
    assert known.at(known.time + 86400.0).filter_.current[1][0, 0] > before
    with pytest.raises(InputError, match="before the last fix"):
        known.at(end - 3600.0)


def test_no_surfacing_is_earlier_than_what_the_log_holds(tmp_path):
    """A dive that goes on for two hours, seen near 40 m: what usual dives of 11 min would have said
    is past already."""
    flight = Flight(dives=4, depth=50.0, north=0.05, east=0.0, step=10.0)
    columns, gps = slocum_columns(flight), gps_columns(flight)
    begin = START + 3 * flight.cycle + flight.surface
    flown = columns["time"] < begin + 0.8 * flight.leg
    seen = begin + 7200.0
    longer = np.arange(columns["time"][flown][-1] + 10.0, seen + 5.0, 10.0)
    whole = {
        name: np.append(values[flown], np.full(len(longer), values[flown][-1]))
        for name, values in columns.items()
    }
    whole["time"][flown.sum() :] = longer
    write_slocum(tmp_path, flight, gps=part(gps, gps["time"] < begin), **whole)
    known = known_from_logs(stored(tmp_path / "cut.zarr", "slocum", [tmp_path], period=10.0))
    assert known.last_seen.time == pytest.approx(seen, abs=20.0)
    depth = columns["m_depth"][flown][-1]
    assert known.last_seen.depth == pytest.approx(depth, abs=0.5)
    assert known.last_seen.rise == pytest.approx(depth / flight.depth * flight.leg, rel=0.1)
    place, known, _ = begun(None, known)
    mission = goes_to("49.9,-58", surface_after_s=600.0)
    found = forecast(asked(place=place, mission=mission, hours=2.5), known)
    first = found.surfacings[0]
    start = unix_seconds(str(place.time))
    rises = known.last_seen.time + known.last_seen.rise
    assert start + first.early_s >= rises - 1.0
    assert found.spread["under water"].startswith(f"the log has it at {depth:.0f} m at ")
    # a later start is not bound by it
    later = dataclasses.replace(place, time=utc_text(moment_of(rises + 600.0)))
    assert members_of(asked(place=later, mission=mission), known).earliest == 0.0


def test_members_take_the_model_that_the_dives_speak_for():
    """Of a current that jumps and then stays: the last dive's, and not the filter's mean."""
    known = prior()
    rng = np.random.default_rng(3)
    for k in range(40):
        side = 0.3 if (k // 4) % 2 else -0.3  # four dives each way
        moved = 7.2e3 * (np.array([side, 0.1]) + 0.005 * rng.standard_normal(2))
        leg = {"duration": 7.2e3, "over_ground": tuple(moved), "through_water": (0.0, 0.0)}
        known.pool.learn(Leg(start=UNIX + 9e3 * k, **leg))
    weights = known.pool.pool.weights
    assert weights["persistence"] > 0.5
    water, mixed, deviation = drawn(known, 400, first=4, then=5)
    changed = (mixed.current != water.current).any(axis=(1, 2))
    assert changed[1:].mean() == pytest.approx(1.0 - weights["filter"], abs=0.08)
    near = np.abs(mixed.current[changed][1:, 0] - [0.3, 0.1]).max(axis=1) < 0.1
    assert near.mean() > 0.4
    assert mixed.current[1:, 0].std(axis=0).mean() == pytest.approx(deviation, rel=0.25)


def test_a_vehicle_of_another_kind_than_the_log_s_is_named(store, tmp_path):
    warning = other_kind(store, load_vehicle("glider"))
    assert warning.startswith("vehicle glider (glider) is of another kind than that of the log")
    assert f"{store} (slocum)" in warning
    assert other_kind(store, load_vehicle("slocum-1000")) == ""
    mine = tmp_path / "mine.xml"
    mine.write_text(load_vehicle("seaglider").xml)
    assert "vehicle mine (seaglider) is of another" in other_kind(store, load_vehicle(str(mine)))
    mine.write_text(load_vehicle("slocum-200").xml)
    assert other_kind(store, load_vehicle(str(mine))) == ""


def test_a_log_s_own_kind_of_vehicle_is_flown_where_none_is_named(store):
    for name, words in (
        ("slocum-200", (None, store)), ("spray", ("spray", None)), ("glider", (None, None)),
    ):  # fmt: skip
        assert vehicle_of(*words).name == name


def test_logs_of_another_time_or_place_are_not_taken(store):
    known = known_from_logs(store)
    (latitude, longitude), day = known.place, 86400.0
    assert known.check_begin(latitude, longitude, known.time + 3600.0) == ""
    assert "3.0 days before" in known.check_begin(latitude, longitude, known.time + 3 * day)
    assert "45 km from" in known.check_begin(latitude + 0.4, longitude, known.time + 3600.0)
    for place, later in ((known.place, 3650 * day), ((36.8, -122.4), 3600.0)):
        with pytest.raises(InputError, match="do not describe this water"):
            known.check_begin(*place, known.time + later)


def test_a_target_at_the_start_or_beyond_reach_is_named():
    here, far = (
        asked(mission=goes_to(one, radius=500.0)).notes()
        for one in ("36.801,-122.4", "36.8,-119.4")
    )
    assert "already within 500 m of target 1" in here[0]
    assert asked().notes() == ()  # 22 km in an hour: the way to it is flown
    assert "268 km away, farther than anything goes in a day:" in far[0]
    with pytest.raises(MissionError, match=r"did you mean 37, -122\.4 \(the sign of the long"):
        asked(mission=goes_to("37,122.4"))


def test_a_plan_that_is_over_before_the_hours_is_said(steps, tmp_path):
    near = goes_to("36.803,-122.4")
    found = forecast(asked(mission=near, hours=2.0), prior())
    (one,) = found.surfacings
    assert found.over_s == pytest.approx(one.time_s, abs=120.0)
    (said,) = found.remarks
    assert f"the plan is over about {found.moment(found.over_s)[:10]}" in said
    assert f"{2.0 - found.over_s / 3600.0:.1f} h before the forecast ends" in said
    assert said in html.unescape(write_forecast(found, tmp_path / "next").read_text())
    assert (steps[-1].over_s, steps[-1].remarks) == (None, [])
    assert steps[0].bounds_known == ""  # of the mean alone
    off = [f"{round(one.bound_s / 60.0)}" for one in steps[-1].surfacings]
    assert f"24 members tell the bounds of the times to +-{', '.join(off)} min" in (page(steps[-1]))


def test_dives_deeper_than_the_vehicle_is_built_for_are_warned_of():
    for name, depth, says in (
        ("slocum-200", 240.0, "dives to 240 m, and slocum-200 is built for 200 m"),
        ("slocum-1000", 300.0, ""), ("glider", 1500.0, ""), ("glider", 1700.0, 'e="rated_depth"'),
    ):  # fmt: skip
        notes = asked(vehicle=load_vehicle(name), mission=goes_to(depth=depth)).notes()
        assert len(notes) == bool(says), (name, depth)
        assert says in "".join(notes)
    xml = load_vehicle("glider").xml.replace(
        "</custom>", '<numeric name="rated_depth" data="6000"/></custom>'
    )
    own = parse_vehicle(xml, Path("mine.xml"))
    assert asked(vehicle=own, mission=goes_to(depth=5000.0)).notes() == ()
    with pytest.raises(VehicleError, match="rated_depth"):
        load_vehicle("spray").replace(rated_depth=0.0)


@pytest.mark.parametrize(
    ("name", "depth", "limit"), [("slocum-200", 241.0, 240), ("glider", 5e4, 1800)]
)
def test_dives_far_deeper_than_that_are_refused_in_a_line(name, depth, limit, capsys):
    mission = goes_to(depth=depth)
    with pytest.raises(MissionError, match=rf"dives to {depth:g} m, .* 1.2 times that, {limit} m"):
        asked(vehicle=load_vehicle(name), mission=mission)
    start = ["--vehicle", name, "--from", "36.8,-122.4,2026-11-22T12:00", "--depth", f"{depth:g}"]
    for words in (["forecast", "--goto", "37,-122.4"], ["route", "--to", "37,-122.4"]):
        assert PROGRAM.main([*words, *start]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"times that, {limit} m" in line


def test_logs_without_fixes_are_refused(store):
    with xr.open_zarr(store) as dataset:
        lost = dataset.load().assign(displacement_north=dataset["displacement_north"] * np.nan)
    path = write_store(lost, store.parent / "lost.zarr")
    with pytest.raises(StoreError, match="GPS fixes at both ends"):
        known_from_logs(path)


def test_the_command_begins_at_the_last_fix_of_the_logs(store, tmp_path, capsys):
    out = tmp_path / "next"
    assert PROGRAM.main([
        "forecast", "--logs", str(store), "--goto", "49.7,-58", "--depth", "50", "--hours", "1",
        "--surface-every", "0.4", "--members", "10", "--out", str(out), "--json",
    ]) == 0  # fmt: skip
    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert answer["flown"] == 10
    assert answer["engine"] == "lanes"
    assert 0.0 < answer["beside_mujoco"]["position_m"] < 5.0
    assert "8 dives" in answer["spread"]["current"]
    assert answer["surfacings"][0]["ellipse_90"]["semi_major_m"] > 20.0
    # it drifts with what the fixes have told
    assert "surfacing 1: about" in said.err
    assert json.loads((out / "forecast.json").read_text())["surfacings"] == answer["surfacings"]


def test_where_the_log_itself_goes_is_offered(store, tmp_path, capsys):
    assert PROGRAM.main(["forecast", "--logs", str(store)]) == 2
    said = capsys.readouterr().err
    assert "give --goto" in said
    assert "the log has none; `twin watch --new" in said
    with xr.open_zarr(store) as dataset:
        sent = dataset.load().copy()
    for axis, metres in (("north", 3000.0), ("east", -500.0)):
        depth = sent["measured_depth"]
        sent[f"commanded_waypoint_{axis}"] = depth.copy(data=np.full(depth.shape, metres, "f4"))
    write_store(sent, tmp_path / "sent.zarr")
    with LogStore(store) as logs:
        latitude, longitude = logs.fixes(7)[0]
    assert PROGRAM.main(["forecast", "--logs", str(tmp_path / "sent.zarr")]) == 2
    there = re.search(r'sent to --goto "(.*),(.*)"; `twin watch', capsys.readouterr().err)
    moved = offset(*(np.float64(word) for word in there.groups()), latitude, longitude)
    assert [float(one) for one in moved] == pytest.approx([3000.0, -500.0], abs=20.0)


def test_an_interruption_says_how_many_members_the_folder_holds(
    tmp_path, capsys, monkeypatch, steps
):
    def interrupted(request, known, *, threads, refined):
        refined(steps[0])
        raise KeyboardInterrupt

    monkeypatch.setattr("glider_twin_ops.forecast.forecast", interrupted)
    out = tmp_path / "next"
    words = ["forecast", "--from", "36.8,-122.4,2026-11-22T12:00", "--goto", "37,-122.4"]
    assert PROGRAM.main([*words, "--members", "24", "--out", str(out)]) == 130
    assert f"interrupted: {out} holds the forecast of 1 of 24 members" in capsys.readouterr().err
    written = json.loads((out / "forecast.json").read_text())
    assert (written["flown"], written["members"]) == (1, 24)
    text = (out / "index.html").read_text()
    assert "1 of 24 members" in text
    assert "http-equiv" not in text


THERE = "--from 36.8,-122.4,2026-11-22"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (THERE, "give --goto"),
        ("--goto 37,-122", "give --from"),
        ("--from 36.8,-122.4 --goto 37,-122", "the time is missing"),
        (f"{THERE} --goto 37;-122", "write LAT,LON"),
        (f"{THERE} --goto 37,-122 --members 9", "from 10"),
        (f"{THERE} --goto 37,-122 --way modle", "model"),
        (f"{THERE} --goto 37,-122 --way log", "for --logs"),
        (f"{THERE} --mission field --depth 9", "for --goto"),
        (f"{THERE} --goto 37,-122 --current-error 1", "for --current"),
        (f"{THERE} --goto 37,-122 --engine lane", "lanes"),
    ],
)
def test_what_cannot_be_forecast_is_refused_in_a_line(words, message, capsys):
    assert PROGRAM.main(["forecast", *words.split()]) == 2
    assert message in capsys.readouterr().err


def test_a_mission_by_the_sea_floor_is_refused():
    segment = dataclasses.replace(goes_to().segments[0], min_altitude_m=10.0)
    with pytest.raises(MissionError, match="no sea floor"):
        asked(mission=dataclasses.replace(goes_to(), segments=(segment,)))


SMALLEST = """
Math.min(...[...document.querySelectorAll("svg text")]
  .filter(one => one.getClientRects().length)
  .map(one => parseFloat(getComputedStyle(one).fontSize) * one.getScreenCTM().a))
"""


@needs_browser
def test_words_of_the_map_are_as_large_as_on_a_desk(tmp_path):
    out = tmp_path / "next"
    words = ("--from", "36.8,-122.4,2020-01-01T00:00", "--goto", "36.9,-122.6", "--hours", "6")
    assert PROGRAM.main(["forecast", *words, "--members", "10", "--out", str(out)]) == 0
    with Browser() as browser:
        for width, height in ((1280, 720), (390, 844)):
            browser.resize(width, height, phone=width < 400)
            browser.open(out / "index.html")
            assert browser.run(SMALLEST) > 10.5
            assert browser.run("document.documentElement.scrollWidth") <= width
        browser.run(
            "map.dispatchEvent(new WheelEvent('wheel', {deltaY: -1, clientX: 99, clientY: 99}))"
        )
        assert 10.5 < browser.run(SMALLEST) < 11.5
        assert browser.problems == []
