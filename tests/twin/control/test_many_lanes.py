"""Environments in lanes: episodes, observations and rewards of MuJoCo's, and the log of lanes."""

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")

import twin
from twin.control import GliderEnv, GliderVectorEnv
from twin.errors import InputError, VehicleError
from twin.frames import quaternion_to_euler
from twin.mission.controller import Schedule
from twin.physics.start import Start

RIGHT = {"attitude": 0.02, "rates": 0.02, "velocity": 0.01, "depth": 0.05, "depth_rate": 0.01,
         "actuators": 1e-3, "net_buoyancy": 1e-3}  # fmt: skip
"""At most so far from MuJoCo's after two minutes, in SI units"""
WATER = {"current": "tide:m2=0.05+ekman:tau=0.1,direction=90+inertial:speed=0.08,layer=40"}
REAL = {"randomise": "field"}


def in_lanes(task, count, **settings):
    return GliderVectorEnv(task, count, engine="lanes", **settings)


@pytest.mark.parametrize("task", ["hold", "depth", "waypoints", "energy"])
@pytest.mark.parametrize("settings", [{}, WATER, REAL], ids=["plain", "current", "real"])
def test_episodes_are_those_of_mujoco(task, settings):
    settings = {
        "autoreset_mode": "same_step",
        "observation": "dict",
        "time_limit": 60.0,
        **settings,
    }
    both = [GliderVectorEnv(task, 3, engine=engine, **settings) for engine in ("mujoco", "lanes")]
    assert both[0].observation_space == both[1].observation_space
    assert both[0].action_space == both[1].action_space
    seen = [env.reset(seed=4)[0] for env in both]
    for name in seen[0]:
        np.testing.assert_allclose(seen[0][name], seen[1][name], rtol=1e-9, atol=1e-9)
    rng, ends = np.random.default_rng(0), 0
    for step in range(240):
        if step % 40 == 0:
            actions = rng.uniform(-0.3, 0.3, (3, 3)).astype(np.float32)
        (seen, rewards, *over, _), (mine, ours, *ended, _) = (env.step(actions) for env in both)
        np.testing.assert_array_equal(over, ended)
        np.testing.assert_allclose(rewards, ours, atol=0.01)
        ends += int(np.sum(over))
        for name, bound in RIGHT.items():
            assert np.abs(seen[name] - mine[name]).max() < bound, (step, name)
    assert ends == 6


def test_a_vehicle_flies_as_simulate_flies_it_to_the_last_bit():
    commands = np.array([[0.02, 0.3, -200.0], [-0.02, -0.3, 200.0], [0.0, 0.0, 0.0]])
    env = in_lanes("hold", 70, normalised=False)
    env.reset(seed=0)
    start = Start(depth=120.0, pitch=-0.5, heading=1.0, v_rel=(0.3, 0.0, 0.01))
    env.physics.place((66,), start, vehicle=env.task.vehicle, conditions=None, duration=1.0)
    env.physics.settle(np.arange(70) == 66)
    found = []
    for step in range(60):
        actions = np.zeros((70, 3))
        actions[66] = commands[step // 20]
        env.step(actions)
        physics = env.physics
        angles = [physics.roll(), physics.pitch(), physics.heading()]
        found.append([physics.north()[66], physics.depth()[66], *(angle[66] for angle in angles)])
    flown = twin.simulate(
        vehicle="glider",
        mission=Schedule(times=[0.0, 10.0, 20.0], commands=commands.tolist()),
        start=start,
        duration=30.0,
        engine="lanes",
    )
    states = flown.states[1:]
    np.testing.assert_array_equal(np.array(found)[:, 0], states[:, 0])
    np.testing.assert_array_equal(np.array(found)[:, 1], -states[:, 2])
    angles = np.array(quaternion_to_euler(states[:, 3:7] * [1.0, 1.0, -1.0, -1.0])).T
    np.testing.assert_allclose(np.array(found)[:, 2:], angles, atol=1e-14)


@pytest.mark.parametrize("settings", [{}, {**WATER, **REAL}], ids=["plain", "real"])
def test_neither_threads_nor_neighbours_nor_what_was_before_change_a_bit(settings):
    settings = {"time_limit": 10.0, "autoreset_mode": "same_step", **settings}
    rng = np.random.default_rng(1)
    actions = rng.uniform(-1.0, 1.0, (45, 130, 3)).astype(np.float32)

    def flown(count, threads, late=0):
        env = in_lanes("waypoints", count, threads=threads, **settings)
        env.reset(seed=9)
        for k in range(late):
            env.step(actions[k, :count])
        env.reset(seed=9)
        return np.array([env.step(a[:count])[0] for a in actions])

    alone = flown(1, 1)
    for other in (flown(130, 1), flown(130, 2), flown(3, 1, late=7)):
        np.testing.assert_array_equal(other[:, :1], alone)


def test_vehicles_that_are_not_stepped_stay_where_they_are():
    env = in_lanes("depth", 3)
    env.reset(seed=0)
    physics = env.physics

    def states():
        return np.column_stack(
            [physics.north(), physics.depth(), physics.pitch(), physics.velocity_through_water()]
        )

    before = states()
    physics.step(20, np.array([True, False, True]))
    moved = states() != before
    assert moved[[0, 2]].any(axis=1).all()
    assert not moved[1].any()


def test_measurements_are_copies():
    env = in_lanes("energy", 2)
    env.reset(seed=0)
    physics = env.physics
    for name in ("depth", "rates", "activation", "current", "velocity_over_ground"):
        values = getattr(physics, name)()
        before = values.copy()
        env.step(np.ones((2, 3), np.float32))
        np.testing.assert_array_equal(values, before)


def test_what_lanes_cannot_do_is_refused():
    with pytest.raises(InputError, match="unknown engine 'lane': did you mean 'lanes'"):
        GliderVectorEnv("depth", 2, engine="lane")
    with pytest.raises(InputError, match=r"^engine is an option of gymnasium.make_vec only"):
        GliderEnv("depth", engine="lanes")
    with pytest.raises(VehicleError, match="does not fly in lanes"):
        in_lanes("depth", 2, hydrodynamics="ellipsoid")
    with pytest.raises(InputError, match="give at least 1"):
        in_lanes("depth", 0)
