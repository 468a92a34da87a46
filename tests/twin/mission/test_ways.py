"""Level ways, circles, lawn-mowers, hovers and waypoints: flown, and what is refused of them."""

import math

import numpy as np
import pytest
from torpedo import TORPEDO

import twin
from twin import geodesy
from twin.errors import MissionError
from twin.mission import Circle, Hover, LawnMower, Mission, SawTooth, Surface, Transect, Waypoint
from twin.mission.controller import MissionController, Observation
from twin.mission.glide_balance import imbalance
from twin.mission.turning import turn_factor, turn_per_position
from twin.mission.way import level_way, way
from twin.physics.scenario import Scenario, Start, scenario_from_dict
from twin.physics.simulation import Simulation
from twin.vehicle.vehicle import load_vehicle
from twin.water.floor import GridFloor

PROPELLED = ("tethys", "tethys:gazebo", TORPEDO)


def fly(vehicle, *segments, depth=10.0, duration=None, floor=None, speed=0.0, **mission):
    plan = Mission(segments=segments, start_depth_m=depth, at_end="hold", **mission)
    start = Start(depth=depth, v_rel=(speed, 0.0, 0.0))
    return twin.simulate(vehicle=vehicle, mission=plan, duration=duration, floor=floor, start=start)


def test_to_a_near_target_it_is_one_yo_and_one_stay():
    """The yo at the sinking and rising speeds that the vehicle holds at these pitches."""
    glider = load_vehicle("glider")
    target = {"north_m": 0.0, "east_m": 0.0}
    usual = {"pitch_deg": 25.0, "net_mass_kg": 0.3, "climb_net_mass_kg": 0.2}
    segment = Waypoint(targets=(target, target), max_depth_m=90.0, stay_s=200.0, **usual)
    run = twin.simulate(
        vehicle=glider, duration=1200.0,
        mission=Mission(segments=(SawTooth(max_depth_m=90.0, yos=1, **usual),), at_end="hold"),
    )  # fmt: skip
    depth, sinking = run["true_depth"], run["true_velocity_down"]
    legs = (depth > 30.0) & (depth < 75.0)
    down, up = (np.median(np.abs(sinking[legs & (s * sinking > 0.05)])) for s in (1.0, -1.0))
    time, deepest = segment.expected(glider, 0.0, "way")
    assert deepest == 90.0
    assert time - 200.0 == pytest.approx(90.0 / down + 90.0 / up, rel=0.02)


@pytest.mark.parametrize("name", PROPELLED)
def test_a_transect_holds_depth_heading_and_speed(name):
    vehicle = load_vehicle(name)
    run = fly(vehicle, Transect(depth_m=15.0, heading_deg=70.0, speed_m_s=0.9, duration_s=600.0))
    late = run.time > 400.0
    np.testing.assert_allclose(run["true_depth"][late], 15.0, atol=0.15)
    np.testing.assert_allclose(run["true_heading"][late], 70.0, atol=0.6)
    speed = np.hypot(run["true_surge"], run["true_heave"])[late]
    np.testing.assert_allclose(speed, 0.9, rtol=0.01)
    # it went the way that its speed and heading say
    assert np.max(run["true_depth"]) < 16.0
    assert math.degrees(math.atan2(run["true_east"][-1], run["true_north"][-1])) == pytest.approx(
        70.0, abs=2.0
    )


@pytest.mark.parametrize("name", PROPELLED)
@pytest.mark.parametrize("radius", [40.0, -60.0])
def test_a_circle_has_its_radius_and_speed(name, radius):
    vehicle = load_vehicle(name)
    run = fly(vehicle, Circle(depth_m=10.0, radius_m=radius, turns=2.0), speed=0.9)
    late = run.time > 0.5 * run.time[-1]  # the second time round
    north, east = run["true_north"][late], run["true_east"][late]
    centre = np.array([north.max() + north.min(), east.max() + east.min()]) / 2.0
    np.testing.assert_allclose(
        np.hypot(north - centre[0], east - centre[1]), abs(radius), rtol=0.03
    )
    turned = np.unwrap(np.radians(run["true_heading"]))
    assert (turned[-1] - turned[0]) / (4.0 * math.pi) == pytest.approx(
        math.copysign(1, radius), 0.05
    )
    assert run.time[-1] == pytest.approx(
        4.0 * math.pi * abs(radius) / vehicle.cruise_speed, abs=1.0
    )
    np.testing.assert_allclose(run["true_depth"][late], 10.0, atol=0.25)


def test_a_lawn_mower_flies_its_legs_beside_each_other():
    mower = LawnMower(depth_m=12.0, heading_deg=30.0, leg_length_m=150.0, spacing_m=-30.0, legs=3)
    assert [part.heading_deg for part in mower.flown_as()] == [30.0, 300.0, 210.0, 300.0, 30.0]
    assert [part.length_m for part in mower.flown_as()] == [150.0, 30.0, 150.0, 30.0, 150.0]
    vehicle = load_vehicle(TORPEDO)
    run = fly(vehicle, mower, depth=12.0, speed=1.0)
    assert set(run["commanded_segment"]) == {0.0, 1.0, 2.0, 3.0, 4.0}
    assert run.time[-1] == pytest.approx(3 * 150 / 1.2 + 2 * 30 / 1.2, abs=1.5)
    turn = math.radians(30.0)
    across = run["true_east"] * math.cos(turn) - run["true_north"] * math.sin(turn)
    places = [np.mean(across[run["commanded_segment"] == leg][-60:]) for leg in (0.0, 2.0, 4.0)]
    # turns cut and widen what dead reckoning by time leaves of a spacing, by less than a diameter
    assert np.all(np.abs(np.diff(places) + 30.0) < 10.0)


def test_a_transect_follows_the_sea_floor():
    north = np.linspace(-100.0, 900.0, 101)
    depth = 40.0 + 6.0 * np.sin(north / 120.0)
    floor = GridFloor(
        north_m=north, east_m=[-200.0, 200.0], depth_m=np.column_stack([depth, depth])
    )
    vehicle = load_vehicle("tethys")
    run = fly(
        vehicle,
        Transect(altitude_m=8.0, heading_deg=0.0, duration_s=600.0),
        depth=30.0, floor=floor, speed=1.0,
    )  # fmt: skip
    late = run.time > 150.0
    assert np.std(run["true_altitude"][late]) < 1.2 < np.std(run["true_depth"][late])
    assert np.mean(run["true_altitude"][late]) == pytest.approx(8.0, abs=0.7)
    # and a depth gives way to a floor that comes too near
    run = fly(
        vehicle,
        Transect(depth_m=38.0, min_altitude_m=6.0, heading_deg=0.0, duration_s=600.0),
        depth=25.0, floor=floor, speed=1.0,
    )  # fmt: skip
    assert np.min(run["true_altitude"]) > 4.0
    assert np.max(run["true_depth"]) > 35.0
    with pytest.raises(MissionError, match="floor"):
        fly(vehicle, Transect(altitude_m=8.0, duration_s=60.0), depth=30.0)


def test_a_hover_holds_depth_and_pitch_without_thrust():
    run = fly("tethys", Hover(depth_m=14.0, pitch_deg=-12.0, duration_s=1500.0), depth=10.0)
    late = run.time > 900.0
    np.testing.assert_allclose(run["true_depth"][late], 14.0, atol=0.05)
    np.testing.assert_allclose(run["true_pitch"][late], -12.0, atol=0.2)
    assert np.max(run["true_depth"]) < 14.5
    assert not run["true_propeller"].any()


def test_a_steady_flight_balances_surge_heave_and_pitch():
    for name in PROPELLED:
        vehicle = load_vehicle(name)
        for pitch in (-15.0, 10.0):
            steady = way(vehicle, "way", "pitch_deg", pitch, 0.0, 0.9)
            alpha = steady.angle_of_attack
            velocity = 0.9 * np.array([math.cos(alpha), 0.0, math.sin(alpha)])
            rest = imbalance(vehicle, steady.command, velocity, pitch=math.radians(pitch))
            np.testing.assert_allclose(rest[[0, 2, 4]], 0.0, atol=1e-5)
            assert steady.vertical_speed == pytest.approx(
                0.9 * math.sin(alpha - math.radians(pitch))
            )


def test_a_hull_that_turns_by_itself_is_steered_by_its_rudder_all_the_same():
    vehicle = load_vehicle("tethys")
    steady = level_way(vehicle, "way", None)
    sense = vehicle.steered("heading").sense("heading")
    assert turn_per_position(vehicle, steady) * sense < 0.0  # fins too small: a steady turn lies
    assert turn_factor(vehicle, steady) == sense


def test_the_battery_takes_its_share_of_the_pitch():
    vehicle = load_vehicle("tethys")
    shift, elevator = (vehicle.part_names.index(name) for name in ("shift", "elevator"))
    none = way(vehicle, "way", "pitch_deg", -15.0, 0.0, None)
    half = way(vehicle, "way", "pitch_deg", -15.0, 0.0, None, trim_share=0.5)
    whole = way(vehicle, "way", "pitch_deg", -15.0, 0.0, None, trim_share=1.0)
    assert none.command[shift] == 0.0
    assert half.command[shift] == pytest.approx(0.5 * whole.command[shift])
    assert 0.0 < half.command[elevator] < none.command[elevator]
    # what is left to the elevator is drag alone: the pump and the battery sit below the axis
    assert abs(whole.command[elevator]) < 0.1 * none.command[elevator]


@pytest.mark.parametrize(
    ("vehicle", "segment", "message"),
    [
        ("glider", Transect(depth_m=10, duration_s=60), "no propeller.*give a saw-tooth"),
        (
            "tethys",
            SawTooth(max_depth_m=30, pitch_deg=30, speed_m_s=0.5, yos=1),
            "trim_share.*elevator at",
        ),
        ("tethys", Circle(depth_m=10, radius_m=3, turns=1), r"give at least [\d.]+ m"),
        ("tethys", Transect(depth_m=10, speed_m_s=3, duration_s=60), "up to 1.* m/s"),
        ("slocum-200", Hover(depth_m=10, duration_s=60), "buoyancy_pid"),
        ("tethys", Hover(depth_m=10, pitch_deg=50, duration_s=60), "needs the shift at"),
        ("glider", SawTooth(max_depth_m=30, trim_share=0.5, yos=1), "battery beside an elevator"),
    ],
)
def test_what_a_vehicle_cannot_fly_is_refused(vehicle, segment, message):
    with pytest.raises(MissionError, match=message):
        Mission(segments=(segment,)).check(load_vehicle(vehicle))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Transect(duration_s=60), "either depth_m or altitude_m"),
        (lambda: Transect(depth_m=10, altitude_m=5), "not both"),
        (lambda: Circle(depth_m=10, radius_m=0), "positive to starboard"),
        (
            lambda: LawnMower(depth_m=5, heading_deg=0, leg_length_m=9, spacing_m=9, legs=2.5),
            "whole",
        ),
        (lambda: Mission(segments=(Transect(depth_m=10), Transect(depth_m=5))), "length_m"),
        (
            lambda: Mission(segments=(Transect(depth_m=30, duration_s=9),), max_depth_m=31),
            "for the overshoot",
        ),
    ],
)
def test_impossible_fields_are_refused(make, message):
    with pytest.raises(MissionError, match=message):
        make()


def test_missions_of_new_kinds_survive_the_way_through_toml():
    mission = twin.load_mission("transects")
    assert Mission.from_dict(mission.to_dict()) == mission
    assert mission.time_limit_s(load_vehicle("tethys")) > 2000.0


SLOW = 0.8


@pytest.mark.parametrize("vehicle", ["tethys", "tethys:gazebo"])
@pytest.mark.parametrize(
    "segment",
    [
        SawTooth(max_depth_m=20.0, min_depth_m=5.0, pitch_deg=10.0, speed_m_s=SLOW, duration_s=300),
        Transect(depth_m=10.0, heading_deg=30.0, speed_m_s=SLOW, duration_s=300.0),
    ],
)
def test_pump_and_battery_take_it_under_water(vehicle, segment):
    """An elevator alone lifts the tail out of the water, and the hull stays awash."""
    plan = Mission(
        segments=(segment, Surface(duration_s=200.0), segment), duration_s=900.0, at_end="hold"
    )
    run = Simulation(Scenario(vehicle=vehicle, mission=plan)).run()
    for part in (0, 2):
        inside = run["commanded_segment"] == part
        time, depth = run.time[inside], run["true_depth"][inside]
        under = time[np.argmax(depth > 2.0)] - time[0]
        assert depth.max() > 9.0
        assert under < 90.0
    # under way it is neutral again, and the battery where the way has it
    way = (run["commanded_segment"] == 0) & (run.time > 250.0)
    assert run["commanded_pump"][way] == pytest.approx(500.0)
    assert np.abs(run["commanded_shift"][way]).max() < 0.03


# --- waypoints ------------------------------------------------------------------------------------


VEHICLE = load_vehicle("glider")
EAST = {"north_m": 0.0, "east_m": 1500.0}


def to_waypoint(target=EAST, **settings):
    usual = {"max_depth_m": 60.0, "pitch_deg": 26.0, "stay_s": 60.0, "arrival_radius_m": 50.0}
    return Waypoint(targets=(target,), **{**usual, **settings})


def to_targets(*segments, heading=90.0, **scenario):
    mission = Mission(segments=segments, start_heading_deg=heading)
    return twin.simulate(twin.Scenario(mission=mission, sample_period=5.0, **scenario))


def arrival(run, segment=0):
    """Index of the first sample after a segment, of the last one where the run ends with it."""
    after = run["commanded_segment"] > segment
    return int(np.argmax(after)) if after.any() else len(after) - 1


@pytest.mark.parametrize("renewed", ["at-surfacing", "continuously"])
def test_a_target_is_reached_in_still_water(renewed):
    run = to_targets(to_waypoint(surface_at_target=False, renewed=renewed))
    assert run.provenance["ended"] == "flown"
    north, east = run.position[arrival(run), :2]
    # dead reckoning in a dive without a fix errs, by less than this part of the way
    assert math.hypot(north, east - 1500.0) < 50.0 + 0.02 * 1500.0


def test_the_true_position_is_reached_to_its_radius():
    run = to_targets(to_waypoint(surface_at_target=False, position="true", arrival_radius_m=20.0))
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
        run = to_targets(to_waypoint(**settings), current=water)
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
        run = to_targets(to_waypoint(**settings))
        afloat = run["true_depth"][1:] < 1.0
        return int(np.sum(np.diff(afloat.astype(int)) == 1))

    assert surfacings(surface_at_target=False) == 1  # the end of the mission
    assert surfacings() == 1  # which is at the target
    assert surfacings(surface_after_yos=2.0) > 2
    assert surfacings(surface_after_s=1200.0) > 2


def test_mirrored_targets_are_flown_as_mirror_images():
    runs = [
        to_targets(
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
    run = to_targets(to_waypoint(position="dead-reckoned"), compass_offset=math.radians(5.0))
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
