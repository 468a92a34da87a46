"""Invariances of the physics: heading, mirror image, uniform current; and its power."""

import math

import numpy as np
import pytest
from physics import glider, hydrodynamic_wrench, set_motion

from twin.frames import euler_to_matrix
from twin.mission.controller import Schedule
from twin.physics.model_block import Tables, write_tables
from twin.physics.scenario import Scenario, Start
from twin.physics.simulation import simulate
from twin.vehicle.laws.flow_frame import native_wrench
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.profile import Profile, Uniform

VEHICLE = load_vehicle("glider")
VALUES, DENSITY = VEHICLE.law.values(), VEHICLE.reference_density
COMMANDS = [
    (0.02, 0.6, VEHICLE.pump_for_net_mass(0.3)),
    (-0.02, -0.8, VEHICLE.pump_for_net_mass(-0.35)),
    (0.015, 0.3, VEHICLE.pump_for_net_mass(0.25)),
]
SCHEDULE = Schedule(times=[0.0, 70.0, 150.0], commands=COMMANDS)
START = Start(depth=800.0, pitch=-0.4, v_rel=(0.35, 0.01, 0.02), actuators=COMMANDS[0])


ENGINES = pytest.mark.parametrize(("engine", "atol"), [("mujoco", 1e-6), ("lanes", 1e-9)])


def fly(engine, *, schedule=SCHEDULE, **changes):
    given = {"start": START, "duration": 220.0, "engine": engine, **changes}
    return simulate(Scenario(vehicle=VEHICLE, mission=schedule, **given))


@ENGINES
def test_heading_only_turns_the_track(engine, atol):
    base, turn = fly(engine), 1.234
    turned = fly(engine, start=Start(**{**vars(START), "heading": turn}))
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
    mirrored = fly(engine, schedule=schedule, start=Start(**{**vars(START), **changed}))
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
