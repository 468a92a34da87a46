"""A current of your own: a front, written as one class and compiled into the physics.

North of the front the water flows east, south of it west. The kernel gives velocity and its
derivatives, so that the twin feels the acceleration of the water too.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cosh, tanh
from typing import ClassVar

import matplotlib.pyplot as plt
import numpy as np

import twin
from twin.compiled import Compiled, jit
from twin.water.current import Current, register


@jit
def front_kernel(program, start, size, t, north, east, depth):
    """Velocity (3), local rate (3) and gradient (3 x 3): north, east, down."""
    speed, width, place = program[start], program[start + 1], program[start + 2]
    x = (north - place) / width
    flow, slope = speed * tanh(x), speed / (width * cosh(x) ** 2)
    return 0.0, flow, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, slope, 0.0, 0.0, 0.0, 0.0, 0.0


@register
@dataclass(frozen=True, kw_only=True)
class Front(Current):
    """A jet to each side of a line."""

    kind: ClassVar[str] = "front"
    payload_size: ClassVar[int] = 3
    kernel: ClassVar[Compiled] = front_kernel
    usage: ClassVar[Mapping[str, str]] = {"front:speed=0.2,width=300,place=600": "m/s, m, m"}

    speed: float
    width: float
    place: float

    def records(self, duration_s, origin):
        """Numbers that the kernel reads from `program[start]` on."""
        return [self.record(self.speed, self.width, self.place)]


mission = twin.Mission(
    segments=(twin.SawTooth(max_depth_m=80, pitch_deg=26, heading_deg=0, yos=3),)
)
run = twin.simulate(mission=mission, current="front:speed=0.2,width=300,place=600")
print(f"the water flows east at {run['true_current_east'].min():.2f} at first")
print(f"and at {run['true_current_east'].max():.2f} m/s at the end")

front = twin.parse_current("front:speed=0.2,width=300,place=600")
north, east = np.mgrid[0:1250:60, -320:120:60]
flow = np.vectorize(lambda n, e: front.velocity(0.0, n, e, 10.0)[1])(north, east)  # [m/s] east
figure, axes = plt.subplots(figsize=(5, 5.6), layout="constrained")
axes.quiver(east, north, flow, 0 * flow, color="0.6")
axes.plot(run["true_east"], run["true_north"], lw=2)
axes.axhline(600, color="k", ls="--", lw=0.8)
axes.set(xlabel="east [m]", ylabel="north [m]", title="A course north across a front")
figure.savefig("own_current.png", dpi=150)
