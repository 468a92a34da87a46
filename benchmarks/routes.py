"""Routes: ways through drawn eddies, beside a brute-force search and the straight way.

    python -m benchmarks.routes [--draws 40] [--seed 100]

Each draw is a sea of eddies of a known rms. The way is planned in the forecast; times are those in
the sea itself. The brute-force search throws a thousand ways of up to four corners across the
region and moves the corners of the six best (Nelder and Mead): it knows the sea, as the planner
does in the part without errors. In the part with errors the planner knows the sea but for an error
of its own, which `plan_routes` allows for by its draws; as there, the same draws choose among its
ways.
"""

from __future__ import annotations

import argparse
import dataclasses
import json

import numpy as np
from scipy.optimize import minimize

from twin.forecast.route_search import BARRED, way_times
from twin.forecast.route_water import STEP, RouteWater, _eddies
from twin.forecast.routes import DRAWS, best_ways

SPEED = 0.25
"""[m/s] of the vehicle"""
LENGTH = 80e3
"""[m] of the way"""
HALF = 60e3
"""[m] of the region beside it"""
RATIOS = (0.5, 0.8, 1.1)
"""rms of the current over the vehicle's speed"""
THROWN, MOVED = 1000, 6
ERROR = 0.05
"""[m/s] of the forecast, each way"""


def sea(rng: np.random.Generator, rms: float) -> RouteWater:
    """Eddies of a rms [m/s], as long as the slowest way lasts."""
    axis = np.arange(-20e3, LENGTH + 20.1e3, 3e3)
    across = np.arange(-HALF, HALF + 1.0, 3e3)
    times = STEP * np.arange(1 + round(3.0 * LENGTH / SPEED / STEP))
    current = _eddies(rng, times, axis, across)
    current *= rms / np.sqrt((current**2).sum(axis=-1).mean())
    return RouteWater(north=axis, east=across, current=current[None])


def brute_force(water: RouteWater, stops: np.ndarray, rng: np.random.Generator) -> float:
    """[s] of the best way that it finds."""
    ways = []
    for _ in range(THROWN):
        corners = int(rng.integers(1, 5))
        north = np.sort(rng.uniform(water.north[0], water.north[-1], corners))
        east = np.cumsum(rng.normal(0.0, 20e3, corners))
        way = np.concatenate([stops[:1], np.stack([north, east], axis=1), stops[1:]])
        ways.append((float(way_times(water, way, SPEED)[0]), way))
    ways.sort(key=lambda one: one[0])
    best = float(way_times(water, stops, SPEED)[0])
    for _, way in ways[:MOVED]:

        def cost(inner: np.ndarray) -> float:
            moved = np.concatenate([stops[:1], 1e4 * inner.reshape(-1, 2), stops[1:]])
            return float(way_times(water, moved, SPEED)[0])

        found = minimize(cost, way[1:-1].ravel() / 1e4, method="Nelder-Mead",
                         options={"maxfev": 500, "xatol": 0.02, "fatol": 60.0})  # fmt: skip
        best = min(best, float(found.fun))
    return best


def one_draw(ratio: float, seed: int, *, brute: bool) -> dict[str, float]:
    """Times [s] in one sea."""
    rng = np.random.default_rng(seed)
    truth = sea(rng, ratio * SPEED)
    stops = np.array([[0.0, 0.0], [LENGTH, 0.0]])
    known = dataclasses.replace(truth, current=truth.current)
    found = {"straight": float(way_times(truth, stops, SPEED)[0])}
    if brute:
        ways = best_ways(known, stops, SPEED, ())
        # the straight way is one that the planner may take
        found["planned"] = min(float(way_times(truth, way, SPEED)[0]) for way in (stops, *ways))
        found["brute force"] = brute_force(truth, stops, rng)
        return found
    times = STEP * np.arange(truth.current.shape[1])
    error = ERROR * _eddies(rng, times, truth.north, truth.east)
    forecast = truth.current[0] - error
    errors = [ERROR * _eddies(rng, times, truth.north, truth.east) for _ in range(DRAWS - 1)]
    water = RouteWater(
        north=truth.north, east=truth.east,
        current=np.stack([forecast, *(forecast + one for one in errors)]),
    )  # fmt: skip
    ways = best_ways(water, stops, SPEED, ())
    straight = way_times(water, stops, SPEED)
    safe = [stops]
    for way in ways:
        taking = way_times(water, way, SPEED)
        if taking.mean() < BARRED and np.mean(taking > 1.02 * straight) <= 0.05:
            safe.append(way)
    taken = min(safe, key=lambda way: float(way_times(water, way, SPEED).mean()))
    found["planned"] = float(way_times(truth, taken, SPEED)[0])
    return found


def run(draws: int, first: int) -> dict[str, dict[str, float]]:
    """By ratio of rms and speed; seas of the seeds from `first` on."""
    told = {}
    for ratio in RATIOS:
        exact = [one_draw(ratio, seed, brute=True) for seed in range(first, first + draws)]
        straight, planned, best = (
            np.array([one[name] for one in exact])
            for name in ("straight", "planned", "brute force")
        )
        wrong = [one_draw(ratio, 1000 + seed, brute=False) for seed in range(first, first + draws)]
        gained = np.array([1.0 - one["planned"] / one["straight"] for one in wrong])
        told[f"rms {ratio:g} of the speed"] = {
            "faster than straight [%]": 100.0 * float(np.mean(1.0 - planned / straight)),
            "brute force faster [%]": 100.0 * float(np.mean(1.0 - best / straight)),
            "part of the brute force's gain": float((straight - planned).sum()
                                                    / (straight - best).sum()),
            "least part in a draw": float(np.min((straight - planned) / (straight - best))),
            "with the forecast's error, faster [%]": 100.0 * float(gained.mean()),
            "slower by more than 2 % in [%]": 100.0 * float(np.mean(gained < -0.02)),
        }  # fmt: skip
    return told


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--seed", type=int, default=100, help="of the first sea")
    options = parser.parse_args()
    print(json.dumps(run(options.draws, options.seed), indent=1))
