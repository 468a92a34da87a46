"""The tasks for dm_control, in the manner of its own suite's tests."""

import math
import re

import numpy as np
import pytest
from dm_control.rl import control as dm_rl
from torpedo import TORPEDO

from twin import control
from twin.control.policies import POLICIES, Autopilot, Proportional
from twin.control.task import wrap_angle
from twin.errors import InputError
from twin.navigation.settings import Navigation

NAMED = {
    "body": "nbody",
    "joint": "njnt",
    "geom": "ngeom",
    "site": "nsite",
    "camera": "ncam",
    "light": "nlight",
    "mesh": "nmesh",
    "texture": "ntex",
    "material": "nmat",
    "actuator": "nu",
    "sensor": "nsensor",
    "numeric": "nnumeric",
    "text": "ntext",
    "tuple": "ntuple",
}

GLIDING = ("hold", "depth", "waypoints", "energy")
"""Tasks of gliders; `test_pose_tasks.py` has those of thrusters"""
every_task = pytest.mark.parametrize("task", GLIDING)


def random_policy(spec, seed):
    generator = np.random.default_rng(seed)
    return lambda: generator.uniform(spec.minimum, spec.maximum)


def fly(task, seed, *, steps=40, **task_kwargs):
    """Time steps of an episode under random commands, the first included."""
    environment = control.load(task, task_kwargs={"random": seed, **task_kwargs})
    policy = random_policy(environment.action_spec(), seed)
    time_steps = [environment.reset()]
    while len(time_steps) <= steps and not time_steps[-1].last():
        time_steps.append(environment.step(policy()))
    return time_steps


def stacked(time_steps):
    rows = [np.concatenate([x.ravel() for x in t.observation.values()]) for t in time_steps]
    return np.array(rows)


@every_task
@pytest.mark.parametrize("vehicle", ["glider", "tethys"])
def test_components_have_names_and_there_are_cameras(task, vehicle):
    model = control.load(task, task_kwargs={"vehicle": vehicle}).physics.model
    for kind, count in NAMED.items():
        for index in range(getattr(model, count)):
            assert model.id2name(index, kind) != "", f"{kind} {index} has no name"
    assert model.ncam >= 2


@every_task
def test_time_steps_conform_to_the_specs(task):
    environment = control.load(task, task_kwargs={"random": 0})
    specs = environment.observation_spec()
    for time_step in fly(task, 0):
        assert set(time_step.observation) == set(specs)
        for name, spec in specs.items():
            value = time_step.observation[name]
            spec.validate(value)
            assert np.isfinite(value).all(), name
        if time_step.first():
            assert time_step.reward is None
            assert time_step.discount is None
        else:
            assert isinstance(time_step.reward, float)
            assert 0.0 <= time_step.reward <= 1.0
            assert isinstance(time_step.discount, float)
            assert time_step.discount in (0.0, 1.0)


@every_task
def test_actions_are_named_and_normalised_or_in_the_actuators_units(task):
    environment = control.load(task)
    spec = environment.action_spec()
    assert spec.name.split("\t") == ["shift", "rotation", "pump"]
    np.testing.assert_array_equal(spec.minimum, -1.0)
    np.testing.assert_array_equal(spec.maximum, 1.0)
    in_units = control.load(task, task_kwargs={"normalised": False}).action_spec()
    low, high = environment.physics.actuator_range()
    np.testing.assert_array_equal(in_units.minimum, low)
    np.testing.assert_array_equal(in_units.maximum, high)


def test_actions_reach_the_actuators_in_both_scales():
    fraction = np.array([0.3, -0.2, 0.5])
    normalised = control.load("hold", task_kwargs={"random": 4})
    in_units = control.load("hold", task_kwargs={"random": 4, "normalised": False})
    command = normalised.task.to_command(fraction)
    np.testing.assert_allclose(normalised.task.to_action(command), fraction, atol=1e-15)
    normalised.reset(), in_units.reset()
    for _ in range(60):
        normalised.step(fraction), in_units.step(command)
    np.testing.assert_array_equal(normalised.physics.state(), in_units.physics.state())
    np.testing.assert_allclose(normalised.physics.activation(), command, rtol=1e-3)


def test_commands_beyond_the_bounds_are_those_at_the_bounds():
    task = control.load("hold").task
    np.testing.assert_array_equal(task.to_command([9.0, -9.0, 9.0]), task.to_command([1, -1, 1]))


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.0, 0.0], r"action of shape \(2,\) must be of shape \(3,\): shift, rotation, pump"),
        ([[0.0, 0.0, 0.0]], "must be of shape"),
        ([0.0, 0.0, math.nan], "action: pump is nan: actions must be finite numbers"),
    ],
)
def test_an_action_that_is_none_is_refused_by_name(action, message):
    environment = control.load("hold", task_kwargs={"random": 0})
    environment.reset()
    with pytest.raises(InputError, match=message):
        environment.step(action)


@every_task
def test_the_same_seed_gives_the_same_trajectory_and_another_seed_or_episode_does_not(task):
    first, again, other = fly(task, 7), fly(task, 7), fly(task, 8)
    assert [t.reward for t in first] == [t.reward for t in again]
    np.testing.assert_array_equal(stacked(first), stacked(again))
    assert not np.array_equal(stacked(first)[0], stacked(other)[0])
    environment = control.load(task, task_kwargs={"random": 7})
    np.testing.assert_array_equal(stacked([environment.reset()])[0], stacked(first)[0])
    assert not np.array_equal(stacked([environment.reset()])[0], stacked(first)[0])


@every_task
def test_no_observation_is_constant(task):
    rows = stacked(fly(task, 0, steps=100))
    assert (np.ptp(rows, axis=0) > 0.0).all()


@every_task
def test_observations_do_not_share_memory(task):
    first, second, *_ = fly(task, 0, steps=1)
    for name, value in first.observation.items():
        assert not np.may_share_memory(value, second.observation[name]), name


@every_task
def test_environment_settings_pass_through(task):
    environment = control.load(task)
    assert environment.control_timestep() == environment.task.vehicle.control_period
    environment = control.load(
        task, environment_kwargs={"flat_observation": True, "control_timestep": 1.0}
    )
    assert set(environment.observation_spec()) == {dm_rl.FLAT_OBSERVATION_KEY}
    assert environment.control_timestep() == 1.0


@every_task
def test_rewards_can_be_shown_in_the_hulls_colour(task):
    environment = control.load(task, task_kwargs={"random": 1}, visualize_reward=True)
    colours = environment.physics.named.model.mat_rgba
    before = colours["hull"].copy()
    environment.reset()
    policy = Autopilot(environment)
    while (time_step := environment.step(policy())).reward < 0.1:
        pass
    assert not np.array_equal(colours["hull"], before)
    assert time_step.mid()


@every_task
def test_the_autopilot_does_far_better_than_chance(task):
    def mean_reward(policy_of):
        environment = control.load(task, task_kwargs={"random": 3, "time_limit": 600.0})
        policy = policy_of(environment)
        time_step, rewards = environment.reset(), []
        while not time_step.last():
            time_step = environment.step(policy())
            rewards.append(time_step.reward)
        assert time_step.discount == 1.0  # the time limit, nothing else
        return np.mean(rewards)

    chance = mean_reward(lambda environment: random_policy(environment.action_spec(), 0))
    piloted = mean_reward(Autopilot)
    assert piloted > 0.5
    assert piloted > 2.0 * chance


@every_task
@pytest.mark.parametrize("policy", POLICIES)
def test_every_policy_commands_within_the_bounds(task, policy):
    environment = control.load(task, task_kwargs={"random": 3})
    pilot, spec = POLICIES[policy](environment, 0), environment.action_spec()
    time_step, actions = environment.reset(), []
    for _ in range(20):
        actions.append(np.array(pilot(time_step)))
        spec.validate(actions[-1])
        time_step = environment.step(actions[-1])
    assert (np.ptp(actions, axis=0) > 0.0).any() == (policy != "still")


def test_proportional_gains_go_to_a_depth():
    environment = control.load("depth", task_kwargs={"random": 3})
    pilot, time_step = Proportional(environment), environment.reset()
    first, rewards = time_step.observation["to_target"][0], []
    while not time_step.last():
        time_step = environment.step(pilot(time_step))
        rewards.append(time_step.reward)
    assert abs(first) > 20.0
    assert abs(time_step.observation["to_target"][0]) < 5.0
    assert np.mean(rewards) > 0.5


def test_unknown_names_are_refused_with_the_nearest():
    with pytest.raises(InputError, match="did you mean 'waypoints'"):
        control.load("waypoint")
    with pytest.raises(InputError, match="did you mean 'random'"):
        control.load("hold", task_kwargs={"randm": 1})
    with pytest.raises(InputError, match="time_limit 0"):
        control.load("hold", task_kwargs={"time_limit": 0.0})


@pytest.mark.parametrize(
    ("task", "environment", "told"),
    [
        ({"normalised": "no"}, {}, "normalised is 'no': give True or False"),
        ({"time_limit": "x"}, {}, "time_limit"),
        ({}, {"control_timestep": 0.33}, "steps of 0.1 s, such as 0.3 s"),
        ({}, {"control_timestep": -1}, "such as 0.1 s"),
        ({}, {"control_timestep": float("nan")}, "such as 0.1 s"),
    ],
)
def test_a_setting_that_cannot_be_is_refused(task, environment, told):
    with pytest.raises(InputError, match=re.escape(told)):
        control.load("depth", task_kwargs=task, environment_kwargs=environment)


@pytest.mark.parametrize(("angle", "wrapped"), [(0.1, 0.1), (4.0, 4.0 - math.tau), (-7.0, -0.7168)])
def test_wrap_angle(angle, wrapped):
    assert wrap_angle(angle) == pytest.approx(wrapped, abs=1e-4)


# --- a vehicle with a propeller and fins ---

PARTS = ("propeller", "rudder", "elevator")


def piloted(task, seconds):
    environment = control.load(
        task, task_kwargs={"vehicle": str(TORPEDO), "random": 0, "time_limit": seconds}
    )
    pilot, time_step = Autopilot(environment), environment.reset()
    rewards = []
    while not time_step.last():
        time_step = environment.step(pilot(time_step))
        rewards.append(time_step.reward)
        assert all(np.isfinite(value).all() for value in time_step.observation.values())
    return environment, time_step, np.array(rewards)


@every_task
def test_actions_and_observations_are_by_part(task):
    environment, time_step, rewards = piloted(task, 60.0)
    spec = environment.action_spec()
    assert tuple(spec.name.split("\t")) == PARTS
    assert spec.shape == time_step.observation["actuators"].shape == (3,)
    assert len(rewards) == 300  # its control period is 0.2 s
    assert ((rewards >= 0.0) & (rewards <= 1.0)).all()
    assert environment.physics.part_names() == PARTS


def test_the_autopilot_reaches_depth_and_heading():
    environment, _, rewards = piloted("depth", 400.0)
    assert abs(environment.task.error(environment.physics)) < 1.0
    assert rewards[-100:].min() > 0.9
    environment, _, rewards = piloted("hold", 120.0)
    assert abs(environment.task.heading_error(environment.physics)) < np.deg2rad(2.0)
    assert abs(environment.task.pitch_error(environment.physics)) < np.deg2rad(8.0)
    assert rewards[-100:].min() > 0.8


def test_gymnasium_has_it_too():
    pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")
    env = control.GliderEnv("depth", vehicle=str(TORPEDO))
    first, _ = env.reset(seed=1)
    assert env.action_space.shape == (3,)
    assert env.observation_space.contains(first)
    assert np.isfinite(env.step(np.zeros(3))[1])


# --- navigated on board: observations of what is known, rewards of the truth ---

IDEAL = Navigation(estimator="ekf", sensors="ideal")
ACTION = [0.3, 0.1, -0.6]


def known_on_board(name, steps=60, navigate=None, random=2):
    environment = control.load(
        name, task_kwargs={"random": random}, environment_kwargs={"navigate": navigate}
    )
    rows = [environment.reset()]
    rows += [environment.step(ACTION) for _ in range(steps)]
    return environment, rows


@pytest.mark.parametrize("name", GLIDING)
def test_perfect_sensors_show_nearly_the_truth(name):
    _, truth = known_on_board(name)
    _, believed = known_on_board(name, navigate=IDEAL)
    for one, other in zip(truth[2:], believed[2:], strict=True):
        assert one.reward == pytest.approx(other.reward, abs=1e-12)
        assert list(one.observation) == list(other.observation)
        for key in ("attitude", "depth", "actuators"):
            assert other.observation[key] == pytest.approx(one.observation[key], abs=1e-6), key
    # the rates are those of the sample, and the velocity is estimated
    assert believed[-1].observation["rates"] == pytest.approx(
        truth[-1].observation["rates"], abs=1e-3
    )
    assert believed[-1].observation["velocity"] == pytest.approx(
        truth[-1].observation["velocity"], abs=0.08
    )


def test_the_current_is_estimated_and_not_shown():
    _, truth = known_on_board("waypoints")
    _, believed = known_on_board("waypoints", navigate=IDEAL)
    assert np.abs(truth[-1].observation["current"]).max() > 0.01
    assert believed[-1].observation["current"] == pytest.approx(0.0, abs=1e-9)


def test_every_episode_has_errors_of_its_own_that_its_seed_repeats():
    environment, first = known_on_board("hold", 5, navigate="ekf")
    second = [environment.reset(), *(environment.step(ACTION) for _ in range(5))]
    _, again = known_on_board("hold", 5, navigate="ekf")
    depth = [
        rows[-1].observation["depth"][0] - rows[0].observation["depth"][0]
        for rows in (first, second)
    ]
    assert np.array_equal(first[-1].observation["attitude"], again[-1].observation["attitude"])
    assert depth[0] != depth[1]


def test_a_specification_measures_nothing():
    environment, _ = known_on_board("hold", 3, navigate="ekf")
    before = environment.task.believed._on_board.sensors.count
    environment.observation_spec()
    assert environment.task.believed._on_board.sensors.count == before == 4


def test_what_cannot_be_navigated_is_refused():
    with pytest.raises(InputError, match="needs a time limit"):
        control.load(
            "hold", task_kwargs={"time_limit": float("inf")}, environment_kwargs={"navigate": "ekf"}
        )
    with pytest.raises(InputError, match="unknown velocity estimator 'efk'"):
        control.load("hold", environment_kwargs={"navigate": "efk"})
