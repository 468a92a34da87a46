"""Train a policy that beats the autopilot at reaching a depth.

PPO of stable-baselines3 on 128 gliders at once, a command every 5 s. The score is the mean reward
of episodes that it was not trained on, in the task's own control period: the command is held.
Each dot of the picture is one of these episodes. `train_depth_policy.py STEPS EPISODES` trains and
judges by other numbers. With `--engine lanes` the Fossen model flies what it is trained on; it is
judged in MuJoCo all the same.
"""

import argparse
import statistics
import time

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import torch
from stable_baselines3 import PPO

from twin.control import GliderEnv, StableBaselinesVec
from twin.control.policies import POLICIES

TASK, HELD, FIRST_SEED = "glider_twin/Depth-v0", 10, 10_000
parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
parser.add_argument("steps", type=int, nargs="?", default=700_000)
parser.add_argument("episodes", type=int, nargs="?", default=24)
parser.add_argument("--engine", choices=("mujoco", "lanes"), default="mujoco")
options = parser.parse_args()
episodes = options.episodes

torch.set_num_threads(1)
gliders = gymnasium.make_vec(
    TASK, num_envs=128, engine=options.engine, control_timestep=0.5 * HELD,
    autoreset_mode="same_step",
)  # fmt: skip
model = PPO(
    "MlpPolicy", StableBaselinesVec(gliders), n_steps=180, batch_size=4608, gamma=0.99, seed=1,
    learning_rate=1e-3, policy_kwargs={"log_std_init": -1.0}, device="cpu",
)  # fmt: skip
began, processor = time.perf_counter(), time.process_time()
model.learn(options.steps)
print(
    f"{options.steps} steps by {options.engine}: {time.perf_counter() - began:.1f} s, "
    f"{time.process_time() - processor:.1f} s of processor time"
)
model.save("depth_policy")

env = gymnasium.make_vec(TASK, num_envs=episodes)
seen, _ = env.reset(seed=FIRST_SEED)
alive, total = np.ones(episodes), np.zeros(episodes)
for step in range(limit := 1800):
    if step % HELD == 0:
        action, _ = model.predict(seen, deterministic=True)
    seen, reward, terminated, _, _ = env.step(action)
    total += alive * reward
    alive *= ~terminated
scores = {"trained": total / limit}

for name, make in POLICIES.items():
    glider = GliderEnv("depth")
    means = []
    for seed in range(FIRST_SEED, FIRST_SEED + episodes):
        glider.reset(seed=seed)
        policy, over, rewards = make(glider.environment, seed), False, 0.0
        while not over:
            _, reward, terminated, truncated, _ = glider.step(policy(None))
            rewards, over = rewards + reward, terminated or truncated
        means.append(rewards / limit)
    scores[name] = np.array(means)

for name, means in scores.items():
    error = statistics.stdev(means) / len(means) ** 0.5
    print(f"{name:13s} mean reward {means.mean():.3f} +- {error:.3f}, worst {means.min():.3f}")

figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
for row, means in enumerate(reversed(scores.values())):
    axes.plot(means, np.full(len(means), row), "o", alpha=0.5)
    axes.plot(means.mean(), row, "|k", ms=18)
axes.set_yticks(range(len(scores)), [*reversed(scores)])
axes.set(xlabel="mean reward of an episode; bars: mean of all", xlim=(0, 1), ylim=(-0.5, 4.5))
axes.grid(axis="x", alpha=0.3)
figure.savefig("train_depth_policy.png", dpi=150)
