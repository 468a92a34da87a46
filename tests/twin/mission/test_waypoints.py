"""Waypoints: reached in still water, a course that allows for the current, and what is refused."""

import math

import numpy as np
import pytest

import twin
from twin import geodesy
from twin.errors import MissionError
from twin.mission import Mission, Waypoint
from twin.mission.controller import MissionController, Observation
from twin.physics.scenario import scenario_from_dict
from twin.physics.simulation import Simulation
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")
EAST = {"north_m": 0.0, "east_m": 1500.0}


def to_waypoint(target=EAST, **settings):
    usual = {"max_depth_m": 60.0, "pitch_deg": 26.0, "stay_s": 60.0, "arrival_radius_m": 50.0}
    return Waypoint(targets=(target,), **{**usual, **settings})


def fly(*segments, heading=90.0, **scenario):
    mission = Mission(segments=segments, start_heading_deg=heading)
    return twin.simulate(twin.Scenario(mission=mission, sample_period=5.0, **scenario))


def arrival(run, segment=0):
    """Index of the first sample after a segment, of the last one where the run ends with it."""
    after = run["commanded_segment"] > segment
    return int(np.argmax(after)) if after.any() else len(after) - 1


@pytest.mark.parametrize("renewed", ["at-surfacing", "continuously"])
def test_a_target_is_reached_in_still_water(renewed):
    run = fly(to_waypoint(surface_at_target=False, renewed=renewed))
    assert run.provenance["ended"] == "flown"
    north, east = run.position[arrival(run), :2]
    # dead reckoning in a dive without a fix errs, by less than this part of the way
    assert math.hypot(north, east - 1500.0) < 50.0 + 0.02 * 1500.0


def test_the_true_position_is_reached_to_its_radius():
    run = fly(to_waypoint(surface_at_target=False, position="true", arrival_radius_m=20.0))
    place = run.position[arrival(run), :2]
    assert np.hypot(*(place - [0.0, 1500.0])) < 20.0 + 5.0  # a sample later


def test_courses_stem_a_cross_current_once_it_is_known():
    water = twin.Uniform(north=0.1, east=0.0)
    ways = {
        "corrected": {"current_north_m_s": 0.1, "current_east_m_s": 0.0},
        "learned": {"surface_after_s": 1500.0},
        "left out": {"current": "none"},
    }
    off = {}
    for name, settings in ways.items():
        run = fly(to_waypoint(**settings), current=water)
        way = run.position[: arrival(run), :2]
        off[name] = np.abs(way[:, 0]).max()
    assert off["corrected"] < 25.0  # of 1500 m made good, with 0.1 m/s across
    assert off["corrected"] < off["learned"] < off["left out"]


def test_the_first_misclosure_is_the_current():
    mission = Mission(segments=(to_waypoint(surface_after_s=1500.0),), start_heading_deg=90.0)
    water = twin.Uniform(north=0.08, east=-0.05)
    simulation = Simulation(twin.Scenario(mission=mission, current=water, duration=2400.0))
    simulation.run()
    from twin.mission.mission_file import CURRENT_EAST, CURRENT_KNOWN, CURRENT_NORTH
    from twin.physics.model_block import state

    memory = state(simulation.data)["guidance"]
    assert memory[CURRENT_KNOWN] == 1.0
    assert memory[CURRENT_NORTH] == pytest.approx(0.08, abs=0.01)
    assert memory[CURRENT_EAST] == pytest.approx(-0.05, abs=0.01)


def test_surfacings_come_by_time_by_yos_and_at_the_target():
    def surfacings(**settings):
        run = fly(to_waypoint(**settings))
        afloat = run["true_depth"][1:] < 1.0
        return int(np.sum(np.diff(afloat.astype(int)) == 1))

    assert surfacings(surface_at_target=False) == 1  # the end of the mission
    assert surfacings() == 1  # which is at the target
    assert surfacings(surface_after_yos=2.0) > 2
    assert surfacings(surface_after_s=1200.0) > 2


def test_mirrored_targets_are_flown_as_mirror_images():
    runs = [
        fly(
            to_waypoint({"north_m": 800.0, "east_m": side * 700.0}, surface_after_s=1000.0),
            current=twin.Uniform(north=0.02, east=side * 0.05),
            heading=0.0,
        )
        for side in (1.0, -1.0)
    ]
    one, other = (run.position for run in runs)
    assert len(one) == len(other)
    np.testing.assert_allclose(one, other * [1.0, -1.0, 1.0], atol=1e-3)


def test_a_list_of_targets_is_flown_in_order_with_degrees_and_metres():
    latitude, longitude = geodesy.from_tangent_plane(600.0, 0.0, 36.8, -122.4)
    segment = Waypoint(
        targets=[
            {"latitude": float(latitude), "longitude": float(longitude)},
            {"north_m": 600.0, "east_m": 600.0},
        ],
        max_depth_m=40.0,
        position="true",
        surface_at_target=False,
        renewed="continuously",
        arrival_radius_m=30.0,
    )
    start = {"latitude": 36.8, "longitude": -122.4}
    scenario = twin.Scenario(mission=Mission(segments=(segment,)), start=start, sample_period=5.0)
    run = twin.simulate(scenario)
    for index, place in enumerate(([600.0, 0.0], [600.0, 600.0])):
        assert np.hypot(*(run.position[arrival(run, index), :2] - place)) < 40.0
    again = scenario_from_dict(scenario.describe())
    assert again.mission == scenario.mission
    assert again.run_time() == scenario.run_time()


def test_a_held_target_is_a_virtual_mooring():
    """Yos about the place in a cross current, with a fix now and then."""
    segment = to_waypoint({"north_m": 300.0, "east_m": 0.0}, surface_after_yos=2.0)
    mission = Mission(segments=(segment,), at_end="hold", duration_s=9000.0)
    run = twin.simulate(
        twin.Scenario(
            mission=mission, current=twin.Uniform(north=0.0, east=0.08), sample_period=5.0
        )
    )
    late = run.time > 3000.0
    away = np.hypot(*(run.position[late, :2] - [300.0, 0.0]).T)
    assert away.max() < 450.0
    # without anyone flying it, the current would have taken it 480 m from there
    dives = np.diff((run["true_depth"][late] > 30.0).astype(int)) == 1
    assert dives.sum() >= 6


def test_python_guidance_flies_it_as_the_native_one():
    mission = Mission(segments=(to_waypoint(surface_after_s=900.0),), start_heading_deg=90.0)
    water = twin.Uniform(north=0.05, east=0.0)
    scenario = twin.Scenario(mission=mission, current=water, duration=1800.0)
    free = twin.Scenario(current=water, duration=1800.0, start=scenario.begin)
    python = twin.simulate(free, controller=MissionController(mission, VEHICLE))
    np.testing.assert_allclose(python.position, twin.simulate(scenario).position, atol=1e-3)


def test_a_navigator_on_board_decides_position_and_current():
    mission = Mission(segments=(to_waypoint({"north_m": 500.0, "east_m": 0.0}),))
    controller = MissionController(mission, VEHICLE)
    parts = dict.fromkeys(VEHICLE.part_names, 0.0)
    still = {"time": 0.0, "depth": 20.0, "roll": 0.0,
             "pitch": -0.4, "heading": 0.0, "roll_rate": 0.0,
                 "pitch_rate": 0.0, "yaw_rate": 0.0, "parts": parts}  # fmt: skip
    controller(Observation(**still, north=500.0, east=-300.0, current_north=0.0, current_east=0.0))
    from twin.mission.mission_file import HEADING_SETPOINT

    assert controller.state[HEADING_SETPOINT] == pytest.approx(math.radians(90.0))


def test_a_compass_that_reads_too_much_turns_the_way_to_port():
    run = fly(to_waypoint(position="dead-reckoned"), compass_offset=math.radians(5.0))
    north, east = run.position[arrival(run), :2]
    assert math.degrees(math.atan2(east, north)) == pytest.approx(85.0, abs=0.7)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"target": {"north": 1.0, "east_m": 2.0}}, "north_m"),
        ({"target": {"north_m": 1.0, "longitude": 2.0}}, "latitude and longitude, or"),
        ({"target": {"latitude": 89.0, "longitude": 0.0}}, "-88 to 88"),
        ({"target": (1.0, 2.0)}, "latitude = DEGREES"),
        ({"target": {"north_m": 8e5, "east_m": 9e5}}, "1204 km from the origin; at most 1000 km"),
        ({"renewed": "sometimes"}, "at-surfacing"),
        ({"position": "gps"}, "dead-reckoned"),
        ({"current_north_m_s": 0.1}, "together"),
        ({"current": "none", "current_north_m_s": 0.1, "current_east_m_s": 0.0}, "ignored"),
        ({"surface_after_yos": 1.5}, "a whole number"),
        ({"surface_at_target": "yes"}, "true or false"),
        ({"arrival_radius_m": 0.0}, "above 0"),
    ],
)
def test_what_is_no_waypoint_is_refused(settings, words):
    with pytest.raises(MissionError, match=words):
        to_waypoint(**settings)


def test_places_on_the_earth_need_a_start_on_it():
    mission = Mission(segments=(to_waypoint({"latitude": 36.9, "longitude": -122.4}),))
    with pytest.raises(MissionError, match="--start LAT,LON"):
        twin.Scenario(mission=mission)
    with pytest.raises(MissionError, match=r"Mission\.placed"):
        MissionController(mission, VEHICLE)
    MissionController(mission.placed(36.8, -122.4), VEHICLE)
