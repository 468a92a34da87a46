"""Tasks of a vehicle with thrusters: rewards, goals, a plain PD loop that solves them."""

import math

import numpy as np
import pytest

from twin import control
from twin.control import rewards
from twin.control.environment import load_environment
from twin.control.policies import POLICIES
from twin.control.pose import CURRENTS, DISTANCES, PATH_SPEED
from twin.control.task import wrap_angle
from twin.errors import MissionError
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle

ROV = load_vehicle("bluerov2")
TASKS = ("reach", "station", "path")
every_task = pytest.mark.parametrize("task", TASKS)


def pd(observation):
    """Thrusters by a PD loop on what is observed alone, with the drag of the current fed forward.

    The hull is nearly level, and the least squares of thrusts give the shares.
    """
    through = observation["velocity"]
    over = through + observation["current"]
    wanted = 40.0 * observation["to_target"] + 60.0 * (observation["speed"] - over)
    linear, square = np.array([13.7, 0.0, 33.0]), np.array([141.0, 217.0, 190.0])
    swim = observation["speed"] - observation["current"]
    wanted += linear * swim + square * swim * np.abs(swim)
    yaw = 12.0 * math.atan2(*observation["to_heading"]) - 6.0 * observation["rates"][2]
    level = -9.0 * observation["attitude"] - 3.0 * observation["rates"][:2]
    thrust = ROV.thrust_weights @ np.concatenate([wanted, level, [yaw]])
    command = ROV.rest
    for k, part in enumerate(ROV.parts[:8]):
        share = abs(thrust[k]) / (part.ahead if thrust[k] > 0.0 else part.astern)
        e = part.curvature
        inverse = (math.sqrt((1 - e) ** 2 + 4 * e * min(share, 1.0)) - 1 + e) / (2 * e)
        beyond = part.dead_band * min(share / 0.002, 1.0) + (1 - part.dead_band) * inverse
        command[k] = math.copysign(beyond, thrust[k])
    return command


def flown(task, policy, seed=0, **settings):
    """Rewards of an episode; `policy` makes commands from observations."""
    environment = load_environment(task, {"random": seed, "normalised": False, **settings})
    observation, found = environment.reset(), []
    while not environment.over:
        observation, reward, discount, _ = environment.step(policy(observation))
        found.append(reward)
    assert discount == 1.0  # the time limit, nothing else
    return environment, np.array(found)


@every_task
@pytest.mark.parametrize("seed", [0, 1])
def test_a_pd_loop_on_the_observations_solves_it_and_rest_does_not(task, seed):
    environment, piloted = flown(task, pd, seed)
    _, resting = flown(task, lambda _: ROV.rest, seed)
    late = slice(-len(piloted) // 4, None)
    assert piloted[late].mean() > 0.85
    assert resting[late].mean() < 0.5
    if task != "path":
        assert np.linalg.norm(environment.task.error(environment.physics)) < 0.15
        assert abs(environment.task.heading_error(environment.physics)) < math.radians(3.0)


@every_task
def test_the_autopilot_holds_poses_by_the_gains_of_the_file(task):
    environment = load_environment(task, {"random": 3})
    pilot, found = POLICIES["autopilot"](environment, 0), []
    environment.reset()
    while not environment.over:
        found.append(environment.step(pilot(None)).reward)
    assert np.mean(found[-300:]) > 0.8


def test_rewards_are_of_place_and_of_heading_there():
    environment = load_environment("reach", {"random": 2})
    environment.reset()
    task, physics = environment.task, environment.physics

    def reward(away, turned):
        north, east, depth = task.target
        with physics.reset_context():
            heading = (task.target_heading + turned) % math.tau
            physics.set_start(Start(north=north + away, east=east, depth=depth, heading=heading))
        return task.get_reward(physics)

    assert reward(0.0, 0.0) == pytest.approx(1.0)
    assert reward(0.0, math.pi) == pytest.approx(0.5, abs=0.01)
    near = rewards.tolerance(1.0, bounds=(0.0, 0.1), margin=2.0, sigmoid="long_tail")
    assert reward(1.0, 0.0) == pytest.approx(near)
    assert reward(4.0, 0.0) < near / 2.0


def test_goals_are_ahead_to_starboard_and_down():
    environment = load_environment("station", {"random": 2})
    environment.reset()
    task, physics = environment.task, environment.physics
    with physics.reset_context():
        physics.set_start(Start(depth=12.0, heading=math.pi / 2))
    task.target, task.target_heading, task.speed = (2.0, 3.0, 13.0), 0.0, (0.0, 0.2, 0.0)
    seen = task.get_observation(physics)
    np.testing.assert_allclose(seen["to_target"], [3.0, -2.0, 1.0], atol=1e-9)  # it heads east
    np.testing.assert_allclose(seen["to_heading"], [-1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(seen["speed"], [0.2, 0.0, 0.0], atol=1e-9)


def test_a_station_begins_at_rest_over_ground_in_a_current_from_any_side():
    sides = []
    for seed in range(8):
        environment = load_environment("station", {"random": seed})
        environment.reset()
        physics = environment.physics
        np.testing.assert_allclose(physics.velocity_over_ground(), 0.0, atol=1e-9)
        current = physics.current()
        assert CURRENTS[0] <= np.linalg.norm(current) <= CURRENTS[1]
        sides.append(wrap_angle(math.atan2(current[1], current[0]) - physics.heading()))
    assert np.ptp(sides) > math.pi


def test_the_point_of_a_path_moves_at_its_speed_and_turns_into_the_next_leg():
    environment = load_environment("path", {"random": 4}, {"control_timestep": 0.5})
    environment.reset()
    task, points, ends = environment.task, [], []
    while not environment.over:
        environment.step(np.zeros(len(ROV.parts)))
        points.append(np.array(task.target))
        ends.append(tuple(task.leg[1]))
    gone = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.median(gone) == pytest.approx(0.5 * PATH_SPEED)
    assert gone.max() < 0.5 * PATH_SPEED + 1e-9  # at a corner it goes less far
    least = int(60.0 * PATH_SPEED / math.hypot(DISTANCES[1], 2.0))
    assert len(set(ends)) > least


def test_vehicles_without_thrusters_are_refused():
    with pytest.raises(MissionError, match=r"remus.*holds no pose: give bluerov2"):
        load_environment("reach", {"vehicle": "remus"})


@every_task
def test_lanes_fly_it_as_mujoco_does(task):
    pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")
    settings = {"observation": "dict", "control_timestep": 0.1, "normalised": False}
    both = [control.GliderVectorEnv(task, 2, engine=e, **settings) for e in ("mujoco", "lanes")]
    seen = [env.reset(seed=4)[0] for env in both]
    for _ in range(100):
        action = np.stack([pd({k: v[i] for k, v in seen[0].items()}) for i in range(2)])
        seen = [env.step(action)[0] for env in both]
    for name in ("to_target", "to_heading", "velocity", "attitude"):
        np.testing.assert_allclose(seen[0][name], seen[1][name], atol=0.02, err_msg=name)
