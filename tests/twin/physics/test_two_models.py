"""The twin beside the independent Fossen model where `twin check` does not go."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from physics import fly_both as both

from twin.errors import SimulationUnstable, VehicleError
from twin.fossen import FossenModel, FossenState
from twin.mission.controller import Schedule
from twin.physics.scenario import Scenario, Start
from twin.physics.simulation import Simulation, simulate
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle
from twin.water.current.profile import Profile
from twin.water.current.tide import TidalEllipse, Tide
from twin.water.density import DensityProfile

VEHICLE = load_vehicle("glider")
TORPEDO = load_vehicle(Path(__file__).parents[2] / "vehicles" / "torpedo.xml")
NEUTRAL = (0.0, 0.0, 0.0)
HEAVY = (0.02, 0.3, VEHICLE.pump_for_net_mass(0.3))


def fly_both(start: Start, commands=NEUTRAL, *, vehicle: Vehicle = VEHICLE, **options):
    """`physics.fly_both`, of the glider and in samples of a second by default."""
    options = {"sample_period": 1.0, **options}
    return both(vehicle, start, commands, options.pop("duration"), **options)


def rates(trajectory: Trajectory) -> np.ndarray:
    return np.stack([trajectory[f"true_{n}_rate"] for n in ("roll", "pitch", "yaw")], axis=-1)


def test_a_rolled_hull_leaves_the_surface_alike():
    """Rolled 46 deg and nose up at the surface: the strips push, turn and roll the hull."""
    start = Start(depth=0.05, roll=0.8, pitch=0.4, heading=0.3)
    ours, theirs = fly_both(start, duration=1.5, timestep=0.01, sample_period=0.1)
    assert 0.2 < ours["true_immersion"][0] < 0.8
    assert np.ptp(theirs.rates, axis=0).min() > 0.2  # [rad/s] it does turn about every axis
    # within some hundredths of the motion
    assert np.abs(rates(ours) - theirs.rates).max() < 0.02
    assert np.abs(ours.v_rel - theirs.v_rel).max() < 0.005


@pytest.mark.parametrize("side", [0.4, -0.4])
def test_a_hull_that_slips_sideways_tumbles_alike(side):
    """70 deg of sideslip at 0.43 m/s, far beyond the identified range."""
    start = Start(depth=300.0, v_rel=(0.15, side, 0.0), rates=(0.05, 0.05, 0.05))
    ours, theirs = fly_both(start, duration=4.0, timestep=0.02, sample_period=0.5)
    moved = np.ptp(theirs.v_rel, axis=0)
    assert moved[1] > 0.2
    assert np.abs(ours.v_rel - theirs.v_rel).max() < 1e-3 * moved[1]
    assert np.abs(rates(ours) - theirs.rates).max() < 1e-3


def test_a_vertical_current_that_changes_with_depth_moves_both_alike():
    """Downwelling and upwelling of 0.1 m/s in turn: a descent passes through their shear."""
    current = Profile(
        depth=(250.0, 300.0, 320.0, 340.0, 360.0),
        north=(0.0,) * 5,
        east=(0.0,) * 5,
        down=(0.0, 0.0, 0.1, -0.1, 0.1),
    )
    start = Start(depth=300.0, pitch=-0.4, v_rel=(0.4, 0.0, 0.01), actuators=HEAVY)
    ours, theirs = fly_both(start, HEAVY, duration=200.0, current=current)
    still, _ = fly_both(start, HEAVY, duration=200.0)
    felt = np.abs(still.v_rel - ours.v_rel).max(axis=0)
    assert felt[0] > 0.004  # [m/s] what the shear does to surge
    assert felt[2] > 0.0005  # and to heave
    assert np.abs(ours.v_rel - theirs.v_rel).max() < 1e-4
    assert np.abs(ours.position - theirs.position_ned).max() < 0.02


def test_an_unsteady_uniform_current_moves_both_alike():
    """An hour of a tide of 0.5 m/s from slack water; the hull drifts with it, neutral and level."""
    tide = Tide(ellipses=(TidalEllipse(constituent="M2", semi_major=0.5, phase_deg=90.0),))
    duration = 3600.0
    start = Start(depth=300.0)
    ours, theirs = fly_both(start, duration=duration, current=tide, sample_period=60.0)
    omega = 2 * np.pi / (12.4206012 * 3600.0)
    np.testing.assert_allclose(
        ours["true_current_north"], 0.5 * np.sin(omega * ours.time), atol=1e-6
    )
    assert np.abs(ours.v_rel - theirs.v_rel).max() < 1e-6
    assert np.abs(ours.position - theirs.position_ned).max() < 1e-3


@pytest.mark.parametrize(("density", "deeper"), [(1026.0, False), (1024.0, True)])
def test_a_neutral_glider_rises_in_denser_water_and_sinks_in_lighter(density, deeper):
    """Buoyancy is that of the local density: 0.1 % of it is 64 g of a hull of 65.3 kg."""
    start, held = Start(depth=300.0), Schedule(times=[0.0], commands=[NEUTRAL])
    water = DensityProfile.constant(density)
    ours = simulate(
        Scenario(vehicle=VEHICLE, mission=held, duration=60.0, start=start, density=water)
    )
    state = FossenState(position_ned=(0.0, 0.0, 300.0))
    theirs = FossenModel(VEHICLE, density=([0.0], [density])).simulate(state, held, 60.0)
    moved = theirs.position_ned[-1, 2] - 300.0
    assert (moved > 1.0) if deeper else (moved < -1.0)
    assert ours["true_depth"][-1] - 300.0 == pytest.approx(moved, rel=1e-3)


def test_a_neutral_glider_stays_neutral_under_any_gravity():
    """Weight and buoyancy are both in proportion to g."""
    start = Start(depth=300.0)
    for gravity in (9.78, 9.83):
        ours, theirs = fly_both(start, duration=60.0, vehicle=VEHICLE.replace(gravity=gravity))
        assert abs(theirs.position_ned[-1, 2] - 300.0) < 0.01
        assert abs(ours["true_depth"][-1] - 300.0) < 0.01


def test_the_gravity_of_the_file_is_that_of_weight_and_buoyancy():
    text = VEHICLE.xml.replace('gravity="0 0 -9.81"', 'gravity="0 0 -9.70"')
    lighter = parse_vehicle(text, VEHICLE.path)
    assert lighter.gravity == 9.70
    ours, _ = fly_both(Start(depth=300.0), duration=60.0, vehicle=lighter)
    assert abs(ours["true_depth"][-1] - 300.0) < 0.01
    assert ours["true_specific_force_z"][0] == pytest.approx(-9.70, abs=0.02)


BEYOND = [(1.0, 0.0, 0.0), (0.0, -9.0, 0.0), (0.0, 0.0, -9e3)]
"""commands far outside the travel of one actuator each"""


@pytest.mark.parametrize("command", BEYOND)
def test_a_command_beyond_the_travel_is_one_to_its_end(command):
    """It approaches the end at its lag (docs/physics/equations.md) and does not slam into it."""
    end = np.clip(command, VEHICLE.actuator_min, VEHICLE.actuator_max)
    start = Start(depth=300.0)
    far, theirs = fly_both(start, command, duration=20.0)
    near, _ = fly_both(start, tuple(end), duration=20.0)
    np.testing.assert_array_equal(far.states[:, 17:20], near.states[:, 17:20])
    np.testing.assert_allclose(far.states[:, 17:20], theirs.actuators, rtol=0.02, atol=1e-4)


def test_a_run_that_leaves_physics_but_stays_finite_is_told():
    """A screw of a hundred times its thrust drives the hull beyond 20 m/s."""
    screw = TORPEDO.part("propeller")
    strong = {"thrust_coefficient": 100.0 * screw.thrust_coefficient, "zero_thrust_advance": 0.0}
    wild = TORPEDO.replace(propeller=strong)
    plan = Schedule(times=[0.0], commands=[(screw.high, 0.0, 0.0)])
    start = Start(depth=300.0)
    with pytest.raises(SimulationUnstable) as ours:
        simulate(Scenario(vehicle=wild, mission=plan, duration=60.0, start=start))
    with pytest.raises(SimulationUnstable) as theirs:
        FossenModel(wild).simulate(FossenState(position_ned=(0.0, 0.0, 300.0)), plan, 60.0)
    assert 10.0 < np.linalg.norm(ours.value.partial.v_rel[-1]) < 20.5  # a sample before it
    assert ours.value.time_s == pytest.approx(theirs.value.time_s, abs=1.0)


@pytest.mark.parametrize(
    "changes", [{"drag": (-2.0, 0.0)}, {"drag": (7.0, -1.0)}, {"yaw_moment": (34.0, 1.0)}]
)
def test_drag_and_damping_that_drive_are_refused(changes):
    with pytest.raises(VehicleError, match="never drives"):
        VEHICLE.replace(**changes)


def test_the_battery_is_where_its_command_has_led_it():
    """No trail behind what lag and rate give: 10 ms of it were 0.2 mm at 20 mm/s."""
    plan = Schedule(times=[0.0, 5.0], commands=[NEUTRAL, (0.04, 1.0, 0.0)])
    run = Simulation(
        Scenario(vehicle=VEHICLE, mission=plan, duration=20.0, start=Start(depth=300.0))
    )
    moved = 0.0
    for _ in range(150):
        mujoco.mj_step(run.model, run.data)
        assert np.abs(run.data.qpos[7:9] - run.data.act[:2]).max() < 5e-6
        moved = max(moved, run.data.qvel[6])
    assert moved > 0.01
