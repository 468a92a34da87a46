"""The twin beside the independent Fossen model where `twin check` does not go; invariances."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from physics import fly_both as both
from physics import glider, hydrodynamic_wrench, set_motion

from twin.errors import SimulationUnstable, VehicleError
from twin.fossen import FossenModel, FossenState
from twin.frames import euler_to_matrix
from twin.mission.controller import Schedule
from twin.physics.model_block import Tables, write_tables
from twin.physics.scenario import Scenario, Start
from twin.physics.simulation import Simulation, simulate
from twin.records.trajectory import Trajectory
from twin.vehicle.laws.flow_frame import native_wrench
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle
from twin.water.current.profile import Profile, Uniform
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


# --- invariances: heading, mirror image, uniform current ------------------------------------------


VALUES, DENSITY = VEHICLE.law.values(), VEHICLE.reference_density
COMMANDS = [
    (0.02, 0.6, VEHICLE.pump_for_net_mass(0.3)),
    (-0.02, -0.8, VEHICLE.pump_for_net_mass(-0.35)),
    (0.015, 0.3, VEHICLE.pump_for_net_mass(0.25)),
]
SCHEDULE = Schedule(times=[0.0, 70.0, 150.0], commands=COMMANDS)
GLIDING = Start(depth=800.0, pitch=-0.4, v_rel=(0.35, 0.01, 0.02), actuators=COMMANDS[0])


ENGINES = pytest.mark.parametrize(("engine", "atol"), [("mujoco", 1e-6), ("lanes", 1e-9)])


def fly(engine, *, schedule=SCHEDULE, **changes):
    given = {"start": GLIDING, "duration": 220.0, "engine": engine, **changes}
    return simulate(Scenario(vehicle=VEHICLE, mission=schedule, **given))


@ENGINES
def test_heading_only_turns_the_track(engine, atol):
    base, turn = fly(engine), 1.234
    turned = fly(engine, start=Start(**{**vars(GLIDING), "heading": turn}))
    c, s = math.cos(turn), math.sin(turn)
    rotated = base.position[:, :2] @ np.array([[c, s], [-s, c]])
    np.testing.assert_allclose(turned.position[:, :2], rotated, atol=atol)
    np.testing.assert_allclose(turned.v_rel, base.v_rel, atol=atol)
    np.testing.assert_allclose(turned["true_roll"], base["true_roll"], atol=1e-6)


@ENGINES
def test_mirror_image_flies_the_mirrored_track(engine, atol):
    base, signs = fly(engine), np.array([1.0, -1.0, 1.0])
    schedule = Schedule(times=SCHEDULE.times, commands=np.array(COMMANDS) * signs)
    changed = {"v_rel": (0.35, -0.01, 0.02), "actuators": tuple(COMMANDS[0] * signs)}
    mirrored = fly(engine, schedule=schedule, start=Start(**{**vars(GLIDING), **changed}))
    np.testing.assert_allclose(mirrored.position, base.position * signs, atol=atol)
    np.testing.assert_allclose(mirrored.v_rel, base.v_rel * signs, atol=atol)
    assert np.abs(base.v_rel[:, 1]).max() > 1e-3


@ENGINES
def test_uniform_current_only_carries_the_glider(engine, atol):
    """Galilean invariance: the motion through the water does not change."""
    base, carried = fly(engine), fly(engine, current=Uniform(north=0.31, east=-0.22))
    drift = base.time[:, None] * np.array([0.31, -0.22, 0.0])
    np.testing.assert_allclose(carried.v_rel, base.v_rel, atol=atol)
    np.testing.assert_allclose(carried.position - drift, base.position, atol=atol)
    np.testing.assert_allclose(carried["true_current_north"], 0.31)


def test_shear_pushes_through_the_added_mass():
    """dV_c/dt along the path acts as M_A R^T dV_c/dt: compared with still water at an instant."""
    model, data = glider(reserve=256)
    down = 0.25
    gradient = 0.002  # 0.2 m/s per 100 m
    set_motion(data, pitch=-0.5, heading=0.7, velocity=(0.3, 0.1, down))
    still = hydrodynamic_wrench(model, data)
    depth = 1000.0
    current = Profile(
        depth=(0.0, 2 * depth), north=(-gradient * depth, gradient * depth), east=(0.0, 0.0)
    )
    # zero at the glider's depth, so only its rate acts
    write_tables(model, Tables(current=current.compile(100.0)))
    sheared = hydrodynamic_wrench(model, data)
    r = euler_to_matrix(0.0, -0.5, 0.7)
    rate = r.T @ np.array([gradient * down, 0.0, 0.0])
    field = np.zeros((3, 3))
    field[0, 2] = gradient
    g = r.T @ field @ r
    twist = np.concatenate([r.T @ [0.3, 0.1, down], np.zeros(3)])
    turned = twist - [0.0, 0.0, 0.0, g[2, 1], -g[2, 0], g[1, 0]]
    expected = VEHICLE.added_mass[:, :3] @ rate
    # the water turns under the hull, and strains the impulse of its added mass
    before, after = (np.array(native_wrench(VALUES, DENSITY, *x)) for x in (twist, turned))
    h = VEHICLE.added_mass @ turned
    expected += after - before
    expected[:3] -= g.T @ h[:3]
    expected[3:] -= np.cross(twist[:3], h[:3] - (VEHICLE.added_mass @ twist)[:3])
    np.testing.assert_allclose(sheared - still, expected, rtol=1e-9, atol=1e-12)
