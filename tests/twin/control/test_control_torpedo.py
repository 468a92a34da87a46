"""The tasks with a vehicle that has a propeller and fins."""

from __future__ import annotations

import numpy as np
import pytest
from torpedo import TORPEDO

from twin import control
from twin.control.policies import Autopilot

PARTS = ("propeller", "rudder", "elevator")


def episode(task, seconds):
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


@pytest.mark.parametrize("task", control.ALL_TASKS)
def test_actions_and_observations_are_by_part(task):
    environment, time_step, rewards = episode(task, 60.0)
    spec = environment.action_spec()
    assert tuple(spec.name.split("\t")) == PARTS
    assert spec.shape == time_step.observation["actuators"].shape == (3,)
    assert len(rewards) == 300  # its control period is 0.2 s
    assert ((rewards >= 0.0) & (rewards <= 1.0)).all()
    assert environment.physics.part_names() == PARTS


def test_the_autopilot_reaches_depth_and_heading():
    environment, _, rewards = episode("depth", 400.0)
    assert abs(environment.task.error(environment.physics)) < 1.0
    assert rewards[-100:].min() > 0.9
    environment, _, rewards = episode("hold", 120.0)
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
