"""Routes through random eddies, against a brute-force search and the straight route.

    python -m benchmarks.routes [--draws 40] [--seed 300]
    python -m benchmarks.routes --current FILE

Each case is a sea of eddies of a known rms or, with a file of currents, a place, a time and a
direction in it. The route is planned in the forecast; its time is that in the sea itself. The
brute-force search samples a thousand routes of up to four corners, and improves the corners of the
six best (Nelder and Mead). It knows the sea, as the planner does in the part without errors. In the
part with errors the planner has a forecast with an error, represented by an ensemble; other members
choose among its routes, as in `plan_routes`.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import minimize

from benchmarks import command
from glider_twin_ops.forecast import Request, known_without_logs, mission_to
from glider_twin_ops.forecast.request import LEAST_MEMBERS
from glider_twin_ops.forecast.route_search import (
    STEP,
    RouteWater,
    best_ways,
    eddies,
    erring,
    way_times,
)
from glider_twin_ops.forecast.routes import AT_HAND, DRAWS, chosen, route_water, timed_ways
from twin.errors import InputError
from twin.records import unix_seconds
from twin.vehicle.vehicle import load_vehicle
from twin.water.current import parse_field
from twin.water.current.axes import Origin

SPEED = 0.25
"""[m/s] Speed of the vehicle"""
LENGTH = 80e3
"""[m] Length of the straight route"""
HALF = 60e3
"""[m] Half width of the region"""
RATIOS = (0.5, 0.8, 1.1)
"""[1] RMS of the current / speed of the vehicle"""
DEPTH = 200.0
"""[m] Depth of the dives, over which a file's current is averaged"""
MUCH = 0.01
"""[1] Least saving / time of the straight route, for a comparison in a single sea"""
THROWN, MOVED = 1000, 6
ERROR = 0.05
"""[m/s] Error of the forecast, north and east each"""


def sea(rng: np.random.Generator, rms: float) -> RouteWater:
    """Make eddies of a rms [m/s], for the duration of the slowest route."""
    axis = np.arange(-20e3, LENGTH + 20.1e3, 3e3)
    across = np.arange(-HALF, HALF + 1.0, 3e3)
    times = STEP * np.arange(1 + round(3.0 * LENGTH / SPEED / STEP))
    current = eddies(rng, times, axis, across)
    current *= rms / np.sqrt((current**2).sum(axis=-1).mean())
    return RouteWater(north=axis, east=across, current=current[None])


def stops_towards(bearing: float) -> np.ndarray:
    """Start and goal [m] north, east, (2, 2). bearing: [rad] clockwise from north."""
    return np.array([[0.0, 0.0], [LENGTH * math.cos(bearing), LENGTH * math.sin(bearing)]])


def sea_of(path: str, rng: np.random.Generator) -> tuple[RouteWater, np.ndarray]:
    """Cut water from a file; with start and goal [m] north, east, (2, 2)."""
    field = parse_field(path)
    with xr.open_dataset(path) as file:
        first, last = file.time.values[[0, -1]]
        box = [file[axis].values[[0, -1]] for axis in ("latitude", "longitude")]
    hours = AT_HAND * LENGTH / SPEED / 3600.0
    spare = (last - first) - np.timedelta64(math.ceil(hours + 3.0), "h")
    while True:
        latitude, longitude = (float(rng.uniform(*ends)) for ends in box)
        begin = first + rng.uniform() * spare
        goal = stops_towards(rng.uniform(0.0, 2.0 * math.pi))
        request = Request(
            vehicle=load_vehicle("slocum-200"),
            mission=mission_to(f"{latitude},{longitude}", depth=DEPTH, pitch_deg=26.0,
                               surface_after_s=21600.0, radius=1000.0),
            place=Origin(latitude_deg=latitude, longitude_deg=longitude,
                         time=str(begin.astype("datetime64[s]"))),
            field=field, members=LEAST_MEMBERS, hours=hours,
        )  # fmt: skip
        try:
            known = known_without_logs(latitude, unix_seconds(request.place.time))
            return route_water(request, known, goal, hours, rng).part(slice(1)), goal
        except InputError:  # the goal lies outside of the file
            continue


def brute_force(water: RouteWater, stops: np.ndarray, rng: np.random.Generator) -> float:
    """[s] Time of the best route found."""
    ahead = (stops[1] - stops[0]) / LENGTH
    aside = np.array([-ahead[1], ahead[0]])
    ways = []
    for _ in range(THROWN):
        corners = int(rng.integers(1, 5))
        along = np.sort(rng.uniform(-20e3, LENGTH + 20e3, corners))
        across = np.cumsum(rng.normal(0.0, 20e3, corners))
        inner = np.outer(along, ahead) + np.outer(across, aside)
        way = np.concatenate([stops[:1], inner, stops[1:]])
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


def sea_and_stops(sort: float | str, rng: np.random.Generator) -> tuple[RouteWater, np.ndarray]:
    """Make a sea for a ratio of rms to speed, or from a file; with start and goal [m], (2, 2)."""
    if isinstance(sort, str):
        return sea_of(sort, rng)
    return sea(rng, sort * SPEED), stops_towards(0.0)


def known_sea(sort: float | str, seed: int) -> dict[str, float]:
    """Times [s] of routes planned in the sea itself."""
    rng = np.random.default_rng(seed)
    truth, stops = sea_and_stops(sort, rng)
    ways = best_ways(truth, stops, SPEED, (), np.random.default_rng(seed))
    return {
        "straight": float(way_times(truth, stops, SPEED)[0]),
        # the planner may choose the straight route
        "planned": min(float(way_times(truth, way, SPEED)[0]) for way in (stops, *ways)),
        "brute force": brute_force(truth, stops, rng),
    }


def foretold_sea(sort: float | str, seed: int, *, added: bool) -> float:
    """Saving, relative to the straight route's time, by planning in a forecast with errors.

    Args:
      added: whether the error is added to the sea, so that the forecast varies more; otherwise the
        forecast varies as much, but is partly misplaced, which is the planner's assumption.
    """
    rng = np.random.default_rng(seed)
    truth, stops = sea_and_stops(sort, rng)
    times = STEP * np.arange(truth.current.shape[1])
    axes = times, truth.north, truth.east
    forecast = (
        truth.current[0] + ERROR * eddies(rng, *axes)
        if added
        else erring(truth.current[0], ERROR, 2, rng, *axes)[1]
    )
    drawn = erring(forecast, ERROR, 1 + 2 * DRAWS, rng, *axes)
    both = RouteWater(north=truth.north, east=truth.east, current=drawn)
    water, judge = both.part(slice(1 + DRAWS)), both.part(slice(1 + DRAWS, None))
    timed = timed_ways(judge, stops, best_ways(water, stops, SPEED, (), rng), SPEED, ())
    taken = timed[chosen(way_times(judge, stops, SPEED), [times for times, _ in timed])][1]
    straight, planned = (float(way_times(truth, way, SPEED)[0]) for way in (stops, taken))
    return 1.0 - planned / straight


def run(sorts: Sequence[float | str], draws: int, first: int) -> dict[str, dict[str, Any]]:
    """Figures by ratio of rms to speed, or by file; seeds count from `first`."""
    told: dict[str, dict[str, Any]] = {}
    seeds = range(first, first + draws)
    for sort in sorts:
        exact = [known_sea(sort, seed) for seed in seeds]
        straight, planned, best = (np.array([one[name] for one in exact]) for name in exact[0])
        saved, gain = straight - planned, straight - best
        much = gain > MUCH * straight
        longest = np.max((planned - best)[~much], initial=0.0) / 60.0
        found: dict[str, Any] = {
            "faster than straight [%]": 100.0 * float(np.mean(1.0 - planned / straight)),
            "brute force faster [%]": 100.0 * float(np.mean(1.0 - best / straight)),
            "part of the brute force's gain": float(saved.sum() / gain.sum()),
            f"seas where it gains {100 * MUCH:g} % and more": int(much.sum()),
            "least part in one of them": float(np.min((saved / gain)[much])),
            "of them below nine tenths": int(((saved / gain)[much] < 0.9).sum()),
            "longest loss to it elsewhere [min]": float(longest),
        }
        for name, added in (("some of it misplaced", False), ("errors on top of it", True)):
            one = np.array([foretold_sea(sort, 1000 + seed, added=added) for seed in seeds])
            found[f"with {name} in the forecast"] = {
                "faster than straight [%]": 100.0 * float(one.mean()),
                "slower by more than 2 % in [%]": 100.0 * float(np.mean(one < -0.02)),
                "slowest [%]": -100.0 * float(one.min()),
            }
        told[f"rms {sort:g} of the speed" if isinstance(sort, float) else Path(sort).name] = found
    return told


def main(*, draws: int = 40, seed: int = 300, current: str | None = None) -> None:
    """Print the savings of routes.

    Args:
      seed: of the first sea.
      current: a file of currents, whose water is the sea.
    """
    print(json.dumps(run(RATIOS if current is None else (current,), draws, seed), indent=1))


if __name__ == "__main__":
    sys.exit(command.run(main))
