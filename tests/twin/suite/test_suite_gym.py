"""The suite's tasks as Gymnasium environments."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest

from twin import suite
from twin.render.context import available_backend
from twin.suite import gym

installed = all(importlib.util.find_spec(name) for name in ("shimmy", "gymnasium", "imageio"))
needs_extra = pytest.mark.skipif(not installed, reason="the extra 'gym' is not installed")
every_task = pytest.mark.parametrize("task", suite.ALL_TASKS)


@needs_extra
@every_task
# advice about unbounded boxes, which dm_env observations are
@pytest.mark.filterwarnings("ignore:.*(infinity|alternative render modes):UserWarning")
def test_gymnasiums_own_checker_passes(task):
    from gymnasium.utils.env_checker import check_env

    env = gym.make(task, {"random": 0})
    check_env(env, skip_render_check=True)
    assert env.metadata["render_fps"] == pytest.approx(2.0)


@needs_extra
def test_episodes_are_the_suites():
    env = gym.make("hold", {"random": 3})
    native = suite.load("hold", {"random": 3})
    observation, _ = env.reset()
    expected = native.reset()
    action = np.array([0.2, -0.4, -0.6])
    for _ in range(20):
        for name, value in expected.observation.items():
            np.testing.assert_array_equal(observation[name], value)
        observation, reward, terminated, truncated, _ = env.step(action)
        expected = native.step(action)
        assert reward == expected.reward
        assert (terminated, truncated) == (False, False)


@needs_extra
def test_seeds_flat_observations_and_both_ends():
    env = gym.make("depth", {"time_limit": 1.0}, {"flat_observation": True})
    first, _ = env.reset(seed=11)
    again, _ = env.reset(seed=11)
    np.testing.assert_array_equal(first["observations"], again["observations"])
    assert env.observation_space.contains(first)
    assert env.step(env.action_space.sample())[2:4] == (False, False)
    assert env.step(env.action_space.sample())[2:4] == (False, True)  # time limit: truncated
    env.reset()
    env.unwrapped.physics.data.qpos[2] = -1e4
    assert env.step(np.zeros(3))[2:4] == (True, False)  # too deep: terminated


@needs_extra
@pytest.mark.skipif(available_backend() is None, reason="nothing here can draw")
def test_pictures():
    kwargs = {"camera_id": "side", "height": 64, "width": 80}
    env = gym.make("energy", render_mode="rgb_array", render_kwargs=kwargs)
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (64, 80, 3)
    assert picture.std() > 5.0
    env.close()


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "shimmy", None)
    monkeypatch.setitem(sys.modules, "shimmy.dm_control_compatibility", None)
    with pytest.raises(gym.MissingExtra, match=r"pip install 'glider-twin\[gym\]'"):
        gym.make("hold")
