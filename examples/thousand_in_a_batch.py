"""A thousand gliders in one `mujoco.batch`: what can battery and pump do?

Each glider holds a battery shift and a pumped volume of its own for 200 seconds. The model is an
ordinary `mujoco.MjModel` whose water is ours, and MuJoCo's thread pool steps all of them.
"""

import time

import matplotlib.pyplot as plt
import numpy as np
from mujoco.batch import Batch

from twin.physics.mujoco_model import compile_model

COUNT, SECONDS = 1000, 200.0

model = compile_model("glider")
batch = Batch(model, COUNT, 2)
draw = np.random.default_rng(3)
pump = draw.uniform(-450.0, 450.0, COUNT)  # [cm3], less is heavier
shift = -np.sign(pump) * draw.uniform(0.005, 0.04, COUNT)  # [m], nose down where it is heavy
batch.bind("qpos")[:, 2] = -200.0  # [m], up is positive here
batch.bind("ctrl")[:] = np.stack([shift, np.zeros(COUNT), pump], axis=1)

began = time.perf_counter()
batch.step(nstep=round(SECONDS / model.opt.timestep))
took = time.perf_counter() - began
print(f"{COUNT} gliders, {SECONDS:.0f} s each: {COUNT * SECONDS / took:.0f} times real time")

velocity = batch.bind("qvel")[:, :3]  # over ground, which is through the water here
sinking, forward = -velocity[:, 2], np.hypot(velocity[:, 0], velocity[:, 1])
best = forward.argmax()
print(f"fastest forward: {forward[best]:.2f} m/s, {shift[best]:.3f} m and {pump[best]:.0f} cm3")

figure, axes = plt.subplots(figsize=(6.4, 4.6), layout="constrained")
dots = axes.scatter(forward, sinking, c=1000 * shift, s=9, cmap="coolwarm")
figure.colorbar(dots, label="battery forward [mm]")
axes.invert_yaxis()
axes.set(xlabel="speed forward [m/s]", ylabel="speed down [m/s]", title="A thousand gliders")
axes.grid(alpha=0.3)
figure.savefig("thousand_in_a_batch.png", dpi=150)
