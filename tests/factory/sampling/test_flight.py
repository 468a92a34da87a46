"""Flights: the physics is the twin's, and what is drawn reaches it."""

import dataclasses

import numpy as np
import pytest
from stores import drawn

from factory.sampling.conditions import spread_vehicle
from factory.sampling.draw import plan_missions, sensor_seed
from factory.sampling.fly import build_mission, build_scenario, fly
from factory.sampling.parameters import ADDED_MASS, declared, parameter_table
from factory.sampling.recipe import make_recipe
from twin.mission import Mission, load_mission
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation, simulate
from twin.sensors import SensorSuite
from twin.vehicle.vehicle import load_vehicle
from twin.water.current import Uniform

VEHICLE = load_vehicle()
TABLE = parameter_table(VEHICLE)
SECONDS = 300.0


def parameters(duration=SECONDS, **changes):
    return drawn("paper", seed=5, duration=duration, **changes)


def flown(**changes):
    dive = {
        "mission__kind": "saw-tooth",
        "mission__pitch_deg": 35,
        "mission__net_mass_kg": 0.3,
        "mission__max_depth_m": 400,
        "mission__heading_change_deg": 0,
        "current__speed": 0,
    }
    made = parameters(**{**dive, **changes})
    return fly(made, VEHICLE, SensorSuite.preset("ideal"), sensor_seed(5, 0, 0)).trajectory


def steady(trajectory, name):
    """Mean over the last half."""
    return float(trajectory[name][len(trajectory.time) // 2 :].mean())


def test_preset_paper_is_the_twin_itself():
    """Without spreads, a flight is what `twin simulate` makes of the same mission."""
    made = parameters()
    plan = build_mission(made, VEHICLE)
    plain = Mission.from_dict(plan.to_dict())
    speed, toward = made.number("current.speed"), made.number("current.steady_direction_deg")
    current = Uniform.toward(speed, toward)
    twin = simulate(Scenario(mission=plain, duration=SECONDS, current=current))
    factory = fly(made, VEHICLE, SensorSuite.preset("ideal"), sensor_seed(5, 0, 0)).trajectory
    np.testing.assert_array_equal(factory.states, twin.states)


def test_the_paper_test_flies_the_shipped_mission():
    recipe = make_recipe(preset="paper-test")
    made = dataclasses.replace(recipe.parameters(0, 0), duration_s=4000.0)
    mission = load_mission("spiral-level-spiral")
    current = Uniform(north=-0.05, east=-0.002)
    twin = simulate(Scenario(mission=mission, duration=4000.0, current=current))
    factory = fly(made, recipe.vehicle, recipe.suite, sensor_seed(0, 0, 0)).trajectory
    # the direction of the current passes through degrees, so the last bits may differ
    np.testing.assert_allclose(factory.position, twin.position, atol=1e-6)


def test_every_spread_coefficient_reaches_the_vehicle():
    names = {
        "k_d0": ("drag", 0), "k_d": ("drag", 1), "k_l0": ("lift", 0), "k_alpha": ("lift", 1),
        "k_beta": ("side_force", 0), "k_mr": ("roll_moment", 0), "k_p": ("roll_moment", 1),
        "k_m0": ("pitch_moment", 0), "k_m": ("pitch_moment", 1), "k_q": ("pitch_moment", 2),
        "k_my": ("yaw_moment", 0), "k_r": ("yaw_moment", 1),
    }  # fmt: skip
    for name, (group, place) in names.items():
        spread = spread_vehicle(VEHICLE, parameters(**{f"vehicle__{name}": 1.07}))
        for other in ("drag", "lift", "side_force", "roll_moment", "pitch_moment", "yaw_moment"):
            factors = np.array(getattr(spread.law, other)) / np.array(getattr(VEHICLE.law, other))
            expected = np.ones(len(factors))
            if other == group:
                expected[place] = 1.07
            np.testing.assert_allclose(factors, expected, rtol=1e-12)
    for name, (_, (i, j)) in ADDED_MASS.items():
        spread = spread_vehicle(VEHICLE, parameters(**{f"vehicle__added_mass_{name}": 0.93}))
        changed = np.argwhere(spread.added_mass != VEHICLE.added_mass)
        assert {tuple(cell) for cell in changed.tolist()} == {(i, j), (j, i)}
        assert spread.added_mass[i, j] == pytest.approx(0.93 * VEHICLE.added_mass[i, j])
    actuators = ("shift", "rotation", "pump")
    for index, name in enumerate(actuators):
        spread = spread_vehicle(VEHICLE, parameters(**{f"vehicle__{name}_lag": 1.2}))
        assert spread.actuator_lag[index] == pytest.approx(1.2 * VEHICLE.actuator_lag[index])
        spread = spread_vehicle(VEHICLE, parameters(**{f"vehicle__{name}_rate": 0.8}))
        assert spread.actuator_rate[index] == pytest.approx(0.8 * VEHICLE.actuator_rate[index])


def test_a_ballast_error_is_a_net_mass_that_the_pump_does_not_know():
    exact, heavy = flown(), flown(vehicle__ballast_g=20)
    assert steady(heavy, "true_net_mass") - steady(exact, "true_net_mass") == pytest.approx(0.02)
    np.testing.assert_array_equal(heavy["commanded_pump"], exact["commanded_pump"])
    assert steady(heavy, "true_velocity_down") > steady(exact, "true_velocity_down")


def test_a_shift_offset_is_taken_up_by_the_pitch_loop():
    """The battery sits 1 mm further forward than its encoder says, so the loop puts it back."""
    exact, ahead = flown(), flown(vehicle__shift_offset_mm=1)
    gap = ahead["true_shift"][-200:].mean() - exact["true_shift"][-200:].mean()
    assert gap == pytest.approx(-0.001, abs=1e-4)
    assert steady(ahead, "true_pitch") == pytest.approx(steady(exact, "true_pitch"), abs=0.2)


def test_a_rotation_offset_rolls_the_glider_like_the_rotation_itself():
    spiral = {"mission__kind": "spiral", "mission__rotation_deg": 10}
    turned = flown(**spiral, vehicle__rotation_offset_deg=2)
    commanded = flown(**{**spiral, "mission__rotation_deg": 12})
    assert steady(turned, "true_roll") == pytest.approx(steady(commanded, "true_roll"), abs=1e-3)
    assert steady(turned, "true_rotation") == pytest.approx(10.0, abs=1e-6)


def test_a_compressible_hull_in_stratified_water_is_neutral_at_half_its_depth():
    made = parameters(
        water__stratified=1, vehicle__compressibility=5e-10, mission__max_depth_m=200,
        mission__net_mass_kg=0.3, mission__kind="saw-tooth", current__speed=0, duration=900.0,
        vehicle__ballast_g=0,
    )  # fmt: skip
    truth = fly(made, VEHICLE, SensorSuite.preset("ideal"), sensor_seed(5, 0, 0)).trajectory
    dive = truth["commanded_pump"] == truth["commanded_pump"][10]
    depth = truth["true_depth"][dive]
    assert depth.max() > 100.0
    # the commanded 0.3 kg at the reference density, where it was ballasted
    at_half = np.interp(100.0, depth[40:], truth["true_net_mass"][dive][40:])
    assert at_half == pytest.approx(0.3, abs=0.002)
    assert abs(truth["true_net_mass"][dive][40] - 0.3) > 0.01  # and not elsewhere


def test_the_guidance_does_not_know_the_spread_vehicle():
    made = parameters(vehicle__k_m=1.1, vehicle__k_alpha=0.9)
    mission, scenario = build_mission(made, VEHICLE), build_scenario(made, VEHICLE)
    nominal_table, nominal_gains = mission.compile(VEHICLE)
    tables = Simulation(scenario).tables
    np.testing.assert_array_equal(tables.plan, nominal_table)
    np.testing.assert_array_equal(tables.gains, nominal_gains)
    own_table, _ = mission.compile(spread_vehicle(VEHICLE, made))
    assert not np.array_equal(own_table, nominal_table, equal_nan=True)
    assert scenario.vehicle.flow_frame.pitch_moment != VEHICLE.flow_frame.pitch_moment


def test_zero_errors_leave_the_compiled_model_as_it_is():
    scenario = build_scenario(parameters(), VEHICLE)
    assert scenario.ballast.heavy == 0.0
    assert set(scenario.encoder_zeros.values()) == {0.0}
    touched = Simulation(scenario)
    plain = Simulation(dataclasses.replace(scenario, ballast=None, encoder_zeros={}))
    np.testing.assert_array_equal(plain.model.qpos0, touched.model.qpos0)
    np.testing.assert_array_equal(plain.model.numeric_data, touched.model.numeric_data)


def test_a_given_current_replaces_the_drawn_ones():
    recipe = make_recipe(hours=0.2, current="uniform:0.1,-0.2")
    made = recipe.parameters(0, 0)
    flight = fly(
        made, recipe.vehicle, recipe.suite, sensor_seed(0, 0, 0), current=recipe.given_current
    )
    np.testing.assert_allclose(flight.trajectory["true_current_north"], 0.1, rtol=1e-12)
    np.testing.assert_allclose(flight.trajectory["true_current_east"], -0.2, rtol=1e-12)
    assert made.values["current.speed"] != made.values["current.speed"]  # NaN: not used


def test_missions_of_one_plan_differ():
    plan = plan_missions(declared("paper", TABLE)["mission.duration_h"], hours=4.0, seed=0)
    missions = [drawn("paper", mission, duration=600.0) for mission in range(len(plan))]
    assert len({one.segments[0]["mission.pitch_deg"] for one in missions}) == len(plan)
