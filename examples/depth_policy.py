"""A policy of six numbers learns the depth task by the cross-entropy method.

Pump and battery answer the depth to go, the vertical speed and the pitch in proportion. Of many
random policies the best fifth says where to draw the next ones.
"""

import matplotlib.pyplot as plt
import numpy as np

from twin import control

GENERATIONS, POLICIES, EPISODES, BEST = 7, 16, 2, 4
draw = np.random.default_rng(1)
environment = control.load(
    "depth", task_kwargs={"random": 0}, environment_kwargs={"control_timestep": 10.0}
)


def episode(gains, seed):
    """Mean reward of an episode, and the depth to go [m] over its time."""
    environment.task.random.seed(seed)  # start and goal
    now, rewards, to_go = environment.reset(), [], []
    while not now.last():
        seen = now.observation
        to_target, rate, pitch = seen["to_target"][0], seen["depth_rate"][0], seen["attitude"][1]
        state = np.array([to_target / 50, rate / 0.2, pitch])
        shift, pump = np.tanh(gains.reshape(2, 3) @ state)
        now = environment.step([shift, 0.0, pump])
        rewards.append(now.reward)
        to_go.append(now.observation["to_target"][0])
    return float(np.mean(rewards)), np.array(to_go)


mean, spread = np.zeros(6), np.ones(6)
for generation in range(GENERATIONS):
    policies = mean + spread * draw.normal(size=(POLICIES, 6))
    seeds = range(EPISODES * generation, EPISODES * (generation + 1))
    scores = np.array([np.mean([episode(p, s)[0] for s in seeds]) for p in policies])
    best = policies[scores.argsort()[-BEST:]]
    mean, spread = best.mean(axis=0), best.std(axis=0) + 0.1
    print(f"generation {generation}: mean reward {scores.mean():.2f}, best {scores.max():.2f}")

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for seed in range(100, 106):  # starts and goals that it never saw
    reward, to_go = episode(mean, seed)
    axes.plot(10 * np.arange(len(to_go)) / 60, to_go, label=f"reward {reward:.2f}")
axes.axhline(0, color="k", lw=0.8)
axes.set(xlabel="time [min]", ylabel="depth to go [m]", title="The learned policy on new goals")
axes.legend(ncols=2)
figure.savefig("depth_policy.png", dpi=150)
