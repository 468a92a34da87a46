"""The vector environment under stable-baselines3."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra 'sb3' is not installed")

from stable_baselines3 import PPO, SAC

from twin import control
from twin.errors import InputError

DEPTH = "glider_twin/Depth-v0"


def vector(count, **settings):
    made = gymnasium.make_vec(DEPTH, num_envs=count, autoreset_mode="same_step", **settings)
    return control.StableBaselinesVec(made)


def test_ppo_learns_on_many_vehicles():
    env = vector(8, time_limit=10.0)
    model = PPO("MlpPolicy", env, n_steps=25, batch_size=50, n_epochs=1, seed=0, device="cpu")
    before = {k: v.clone() for k, v in model.policy.state_dict().items()}
    model.learn(400)
    assert any((before[k] != v).any() for k, v in model.policy.state_dict().items())
    action, _ = model.predict(env.reset(), deterministic=True)
    assert action.shape == (8, 3)


def test_sac_learns_on_one_vehicle():
    model = SAC(
        "MlpPolicy", gymnasium.make(DEPTH), learning_starts=20, batch_size=16, seed=0, device="cpu"
    )
    model.learn(30)
    assert model.num_timesteps == 30


def test_the_last_observation_of_an_episode_is_handed_over():
    env = vector(2, time_limit=1.0)
    env.seed(3)
    first = env.reset()
    np.testing.assert_array_equal(first[0], gymnasium.make(DEPTH).reset(seed=3)[0])
    actions = np.full((2, 3), 0.5, np.float32)
    env.step(actions)
    begun, _, over, infos = env.step(actions)
    assert over.all()
    for i, info in enumerate(infos):
        assert info["TimeLimit.truncated"] is True
        assert not np.array_equal(info["terminal_observation"], begun[i])


def test_another_way_of_resetting_is_refused():
    with pytest.raises(InputError, match='autoreset_mode="same_step"'):
        control.StableBaselinesVec(gymnasium.make_vec(DEPTH, num_envs=2))
