"""Cost of one current sample in ns, per kind of current: python -m benchmarks.current_sampling

The loop runs in compiled code over a saw-tooth glide with advancing time, as in the physics;
the position changes on every call. Printed is the best of several repeats.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from benchmarks.figures import measured, seconds
from twin.water.current import Grid, Profile, Uniform, parse_current
from twin.water.current import sampler as layout
from twin.water.current.sampler import sample

CALLS = 200_000
REPEATS = 7


@njit(error_model="numpy")
def glide(program, calls):
    total = 0.0
    for i in range(calls):
        t = 0.1 * i
        depth = 500.0 * abs(2.0 * (t / 6000.0 - np.floor(t / 6000.0 + 0.5)))
        part = sample(program, t, 0.35 * t, 0.1 * t, depth, 0.35, 0.1, 0.15)
        total += part[0] + part[3]
    return total


def grid_program(components: int) -> np.ndarray:
    """Grid like Copernicus': 50 uneven levels, 1/12 degree, daily for six days."""
    random = np.random.default_rng(1)
    depth = 0.5 * (5700.0 / 0.5) ** (np.arange(50) / 49.0)
    axis = np.arange(-8, 9) * 9000.0
    field = random.normal(0.0, 0.1, (6, 50, axis.size, axis.size, components))
    days = 86400.0 * np.arange(6)
    return layout.program([Grid.box_record(days, depth, axis, axis, field, 1e-7)])


def main() -> None:
    texts = {
        "still water": "none",
        "uniform": "uniform:0.1,0.05",
        "ekman": "ekman:tau=0.1,direction=90",
        "geostrophic": "geostrophic:surface=0.2,direction=45",
        "tide M2 + S2": "tide:m2=0.1,s2=0.03",
        "inertial": "inertial:speed=0.08",
        "gauss-markov": "gauss-markov:speed=0.1,std=0.05,direction=0",
        "log layer": "log-layer:friction=0.01,direction=0,bottom=510",
        "uniform + ekman + geostrophic + tide + gauss-markov": (
            "uniform:0.1,0+ekman:tau=0.1,direction=0+geostrophic:surface=0.2,direction=0"
            "+tide:m2=0.1,s2=0.03+gauss-markov:speed=0.1,std=0.05,direction=0"
        ),
    }
    programs = {name: parse_current(text).compile(36000.0) for name, text in texts.items()}
    uneven = 1000.0 * (np.arange(40) / 39.0) ** 1.5
    profile = Profile.record(40, uneven, np.random.default_rng(2).normal(0, 0.1, (40, 3)))
    programs["profile, 40 uneven depths"] = layout.program([profile])
    programs["uniform + profile"] = layout.program([Uniform.record(0.1, 0.0, 0.0), profile])
    programs["grid u, v"] = grid_program(2)
    programs["grid u, v, w"] = grid_program(3)
    best = {}
    for name, program in programs.items():
        glide(program, 10)
        times = [seconds(lambda program=program: glide(program, CALLS)) for _ in range(REPEATS)]
        best[name] = min(times) / CALLS * 1e9
        print(f"{name:55s} {best[name]:7.1f} ns")
    kinds = [best[name] for name in texts if name != "still water" and "+" not in texts[name]]
    together = best["uniform + ekman + geostrophic + tide + gauss-markov"]
    gridded = best["grid u, v, w"]
    measured("current_sampling", kinds=kinds, gridded=gridded, together=together)


if __name__ == "__main__":
    main()
