"""Surveys: what the factory draws and flies for vehicles that a propeller drives."""

import dataclasses
import math

import numpy as np
import pytest

from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.missions_page import store_page
from factory.sampling.conditions import DEEPEST_FLOOR_M, SHALLOWEST_FLOOR_M, spread_vehicle
from factory.sampling.draw import kind_of, sensor_seed
from factory.sampling.fly import Impossible, build_mission, build_scenario, fly
from factory.sampling.mission_kinds import ALTITUDE, DEPTH, MISSION_KINDS, kinds_for
from factory.sampling.parameters import parameter_table
from factory.sampling.recipe import make_recipe
from factory.soundness import replay_mission, verify_store
from twin.errors import InputError
from twin.sensors.dvl import MODES
from twin.vehicle.vehicle import load_vehicle
from twin.water.floor import RoughFloor
from twin.water.floor.lookup import floor_depths

LEVEL = ("transect", "circle", "lawn-mower")
SHORT = {
    "mission.duration_h": "uniform(0.08, 0.12)",
    "mission.segment_duration_s": "uniform(60, 150)",
    "mission.turns": 0.3,
    "mission.leg_length_m": 60,
    "mission.surface_duration_s": 40,
    "floor.depth_m": "uniform(45, 70)",
}
"""Missions of five to seven minutes with several segments each, in reach of the Doppler log."""


def short(preset="paper", **changes):
    named = {name.replace("__", "."): value for name, value in changes.items()}
    return make_recipe(preset=preset, hours=0.5, vehicle="tethys", changes={**SHORT, **named})


@pytest.fixture(scope="module", params=["paper", "field"])
def run(request, tmp_path_factory):
    out = tmp_path_factory.mktemp("survey") / f"{request.param}.zarr"
    generate(short(request.param), out, workers=1)
    return GeneratedStore(out)


# --- what is drawn --------------------------------------------------------------------------------


def test_a_glider_draws_no_survey_and_a_survey_no_open_water():
    glider, tethys = (parameter_table(load_vehicle(name)) for name in ("glider", "tethys"))
    assert not [name for name in glider if name.startswith("floor.")]
    assert {"mission.level_by", "mission.min_altitude_m", "mission.radius_m"}.isdisjoint(glider)
    assert "water.bottom_below_m" in glider
    assert "water.bottom_below_m" not in tethys
    assert tethys["current.speed"].paper == "0"
    assert glider["current.speed"].paper != "0"
    # a pump beside a propeller stays neutral
    assert "mission.net_mass_kg" not in tethys
    assert kinds_for(load_vehicle("glider")) == ("saw-tooth", "spiral", "surface")
    assert set(LEVEL) < set(kinds_for(load_vehicle("tethys")))


@pytest.fixture(scope="module")
def many():
    recipe = make_recipe(preset="field", hours=200.0, vehicle="tethys")
    return [recipe.parameters(mission, 0) for mission in range(60)]


def test_every_kind_is_drawn_and_keeps_what_it_uses(many):
    segments = [segment for parameters in many for segment in parameters.segments]
    assert {segment["mission.kind"] for segment in segments} == set(
        kinds_for(load_vehicle("tethys"))
    )
    for segment in segments:
        used = {f"mission.{name}" for name in kind_of(segment).uses} | {"mission.kind"}
        given = {name for name, value in segment.items() if value == value}
        assert given <= used
        if segment["mission.kind"] in LEVEL:
            held = {DEPTH: "mission.depth_m", ALTITUDE: "mission.altitude_m"}
            assert {name in given for name in held.values()} == {True, False}
            assert held[str(segment["mission.level_by"])] in given


def test_drawn_depths_and_altitudes_keep_clear_of_the_shallowest_floor(many):
    """Nothing that is drawn asks for what a floor cut off at its shallowest leaves no room for."""
    for segment in (segment for parameters in many for segment in parameters.segments):
        if segment["mission.kind"] == "surface":
            continue
        clear = float(segment["mission.min_altitude_m"])
        for name in ("mission.depth_m", "mission.altitude_m", "mission.min_depth_m"):
            value = float(segment[name])
            assert not value + clear > SHALLOWEST_FLOOR_M
        assert not float(segment["mission.altitude_m"]) <= clear


def test_segments_become_those_of_guidance_with_their_headings(many):
    tethys = load_vehicle("tethys")
    for parameters in many[:20]:
        mission = build_mission(parameters, tethys)
        heading = parameters.number("mission.start_heading_deg")
        for drawn, flown in zip(parameters.segments, mission.segments, strict=True):
            assert flown.kind == drawn["mission.kind"]
            change = float(drawn["mission.heading_change_deg"])
            if not math.isnan(change):
                heading = (heading + change) % 360.0
                assert flown.heading_deg == pytest.approx(heading)
        mission.check(tethys)


def test_the_floor_is_that_of_the_drawn_numbers_and_reaches_as_far_as_the_mission():
    recipe = short("field")
    parameters = recipe.parameters(0, 0)
    floor = build_scenario(parameters, recipe.vehicle).floor
    value = parameters.number
    fastest = max(recipe.vehicle.cruise_speed, 1.1)
    assert isinstance(floor, RoughFloor)
    assert floor.reach_m is not None
    assert floor.reach_m > (fastest + value("current.speed")) * parameters.duration_s
    wanted = RoughFloor(
        depth_m=value("floor.depth_m"), height_m=value("floor.roughness_m"),
        length_m=value("floor.correlation_m"), slope=value("floor.slope"),
        slope_direction_deg=value("floor.slope_direction_deg"), seed=int(value("floor.seed")),
        shallowest_m=SHALLOWEST_FLOOR_M, deepest_m=DEEPEST_FLOOR_M, reach_m=floor.reach_m,
    )  # fmt: skip
    assert floor == wanted


def test_a_kind_that_the_vehicle_cannot_fly_is_refused_with_those_it_can():
    with pytest.raises(InputError, match=r"mission.kind = hover.*saw-tooth, spiral, transect"):
        short(mission__kind="hover").parameters(0, 0)
    with pytest.raises(InputError, match="choose among depth and altitude"):
        short(mission__kind="transect", mission__level_by="high").parameters(0, 0)
    glider = make_recipe(hours=0.5, changes={"mission.kind": "transect"})
    with pytest.raises(InputError, match=r"vehicle 'glider'.*allowed: saw-tooth, spiral"):
        glider.parameters(0, 0)


# --- what is flown --------------------------------------------------------------------------------


def test_a_survey_store_is_sound_and_replays_to_the_byte(run):
    report = verify_store(run)
    assert report.ok, [check.problems for check in report.checks]
    assert not run.failures()
    assert run.sensor_preset == {"paper": "survey", "field": "survey-field"}[run.settings["preset"]]
    for mission in range(len(run)):
        assert replay_mission(run, mission).identical


def test_truth_altimeter_and_doppler_log_see_the_floor_that_was_drawn(run):
    locked = []
    for mission in range(len(run)):
        samples = int(run.samples[mission])
        row = {
            name: run.row(name, mission)[:samples].astype(float)
            for name in (
                "true_north", "true_east", "true_depth", "true_altitude", "true_contact",
                "true_pitch", "measured_altitude", "measured_dvl_mode",
            )
        }  # fmt: skip
        scenario = build_scenario(run.parameters(mission), run.vehicle)
        table = scenario.floor.compile(scenario.duration)
        floor = floor_depths(table, row["true_north"], row["true_east"])
        np.testing.assert_allclose(row["true_altitude"], floor - row["true_depth"], atol=0.02)
        assert row["true_altitude"].min() > 3.0
        assert not row["true_contact"].any()
        assert floor.min() >= SHALLOWEST_FLOOR_M
        assert floor.max() <= DEEPEST_FLOOR_M
        seen = np.isfinite(row["measured_altitude"])
        assert seen.any()
        error = row["measured_altitude"][seen] - row["true_altitude"][seen]
        assert np.abs(np.median(error)) < 2.0
        # the slant range of a level instrument, all four beams of it well within 110 m
        near = (row["true_altitude"] < 80.0) & (row["true_depth"] > 2.0)
        near &= np.abs(row["true_pitch"]) < 12.0
        locked.append(row["measured_dvl_mode"][near] == MODES["bottom"])
    assert np.concatenate(locked).size > 200
    assert np.concatenate(locked).mean() > 0.9


def test_preset_paper_is_still_water_where_the_log_measures_the_networks_target():
    recipe = short()
    flight = fly(recipe.parameters(1, 0), recipe.vehicle, recipe.suite, sensor_seed(0, 1, 0))
    signals = flight.signals
    assert not np.any(signals["true_current_north"])
    for name, bound in (("surge", 0.012), ("sway", 0.006)):
        error = signals[f"measured_dvl_{name}"] - signals[f"true_{name}"]
        error = error[np.isfinite(error)]
        # 1 % and the misalignment of a perfect mount; outliers are few
        assert np.median(np.abs(error)) < bound
        assert 0.0 < np.mean(np.abs(error) > 0.05) < 0.05


def test_a_mission_that_runs_aground_is_none_to_keep():
    recipe = short(
        mission__kind="saw-tooth", mission__max_depth_m=100, mission__min_altitude_m=0.2,
        mission__pitch_deg=20, floor__depth_m=40, mission__duration_h=0.15,
        mission__segment_duration_s=600,
    )  # fmt: skip
    with pytest.raises(Impossible, match=r"ran aground at \d+\.\d s") as error:
        fly(recipe.parameters(0, 0), recipe.vehicle, recipe.suite, sensor_seed(0, 0, 0))
    assert error.value.time_s > 60.0


def test_the_page_shows_the_floor_and_the_doppler_log(run):
    axes = store_page(run).axes
    labels = {ax.get_xlabel() for ax in axes}
    assert {"DVL surge error [m/s]", "its lock [% of samples]"} <= labels
    assert any("the sea floor under each" in ax.get_title(loc="left") for ax in axes) or any(
        "the sea floor under each" in ax.get_title() for ax in axes
    )


# --- kinds ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MISSION_KINDS)
def test_every_shipped_kind_is_complete(name):
    kind = MISSION_KINDS[name]
    flier = load_vehicle("bluerov2" if name == "sticks" else "tethys")
    table = parameter_table(flier)
    assert kind.fits(flier)
    gliders_only = {"net_mass_kg", "climb_net_mass_kg"}
    assert {f"mission.{n}" for n in set(kind.uses) - gliders_only} <= set(table)
    if name == "sticks":
        recipe = make_recipe(preset="rov", hours=0.5, vehicle="bluerov2")
    else:
        recipe = short(mission__kind=name) if name != "surface" else short("field")
    parameters = dataclasses.replace(recipe.parameters(0, 0))
    drawn = next(s for s in parameters.segments if s["mission.kind"] == name)
    assert kind.shortest_time(drawn, flier) > 0.0
    flown, heading = kind.segment(drawn, 30.0, flier)
    assert flown.kind == name
    assert 0.0 <= heading < 360.0


def test_added_masses_stay_positive_whatever_is_drawn():
    """Tethys' Gazebo set has its roll coupled to sway so closely that factors apart break it."""
    gazebo = make_recipe(preset="field", hours=0.5, vehicle="tethys:gazebo", changes=SHORT)
    nominal, parameters = gazebo.vehicle, gazebo.parameters(0, 0)
    assert nominal.added_mass[1, 3] != 0.0
    for sway, roll in ((0.9, 1.1), (1.1, 0.9)):
        drawn = {"vehicle.added_mass_sway": sway, "vehicle.added_mass_roll": roll}
        values = {**parameters.values, **drawn}
        spread = spread_vehicle(nominal, dataclasses.replace(parameters, values=values))
        assert np.linalg.eigvalsh(spread.added_mass).min() > 0.0
        both = math.sqrt(sway * roll) * nominal.added_mass[1, 3]
        assert spread.added_mass[1, 3] == spread.added_mass[3, 1] == pytest.approx(both)
