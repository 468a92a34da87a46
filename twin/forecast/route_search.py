"""Route search: the fastest way through moving water for a vehicle of a given speed in it.

Dijkstra's algorithm over the nodes of the water, where each edge takes as long as the current along
it, when it is passed, makes it; then the few corners of the way are moved until the mean over all
draws of the water is least (Powell 1964, Comput. J. 7).
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.forecast.route_water import STEP, RouteWater

Array = NDArray[np.float64]

REACH = 4
"""Nodes that an edge spans at most: 48 directions"""
EDGES = np.array(
    [
        (n, e)
        for n in range(-REACH, REACH + 1)
        for e in range(-REACH, REACH + 1)
        if math.gcd(n, e) == 1
    ]
)
PARTS = (0.125, 0.375, 0.625, 0.875)
"""Of an edge, where its current is looked up, at the node that is nearest"""
SLOWEST = 0.02
"""[m/s] over ground that counts as no progress: it waits there for better water"""
CORNERS = 7
"""Of a way, at most: with its end as many as a Slocum's list of waypoints holds"""
WORTH = 0.002
"""Of the time, that a corner must save"""
BARRED = 1e9
"""[s] of a way that must not be taken"""


def made_good(current: Array, direction: Array, speed: float) -> Array:
    """[m/s] along a direction (unit vectors, (..., 2)) with the bow held against what sets across.

    Not above `SLOWEST` where the current across is faster than the vehicle.
    """
    along = (current * direction).sum(axis=-1)
    across = current[..., 0] * direction[..., 1] - current[..., 1] * direction[..., 0]
    room = speed**2 - across**2
    made = along + np.sqrt(np.maximum(room, 0.0))
    return np.where(room > 0.0, np.maximum(made, SLOWEST), SLOWEST)


def way_times(
    water: RouteWater, way: Array, speed: float, avoided: Sequence[Array] = (), begin: float = 0.0
) -> Array:
    """[s] that a way takes in each member, (member,); `BARRED` where it must not be taken.

    Args:
      way: [m] north, east of its corners, (corner, 2). speed: [m/s] through the water.
      avoided: polygons, each (corner, 2). begin: [s] after the start.
    """
    time = np.full(len(water.current), begin)
    if not water.holds(way).all() or crosses(way, avoided):
        return np.full(len(time), BARRED)
    for here, there in itertools.pairwise(way):
        length = float(np.hypot(*(there - here)))
        if length < 1.0:
            continue
        steps = math.ceil(length / water.spacing)
        direction = (there - here) / length
        for k in range(steps):
            north, east = here + (k + 0.5) / steps * (there - here)
            current = water.at(float(north), float(east), time)
            time = time + length / steps / made_good(current, direction, speed)
    return time - begin


def fastest(
    water: RouteWater,
    member: int,
    start: Array,
    goal: Array,
    speed: float,
    avoided: Sequence[Array] = (),
    begin: float = 0.0,
) -> Array | None:
    """The fastest way in one member, [m] north, east of its nodes, (node, 2); None: there is none.

    Args:
      start, goal: [m] north, east. speed: [m/s]. begin: [s] after the start of the water.
    """
    rows, columns = len(water.north), len(water.east)
    field = water.current[member]
    offsets = EDGES * water.spacing
    lengths = np.hypot(*offsets.T)
    directions = offsets / lengths[:, None]
    first, last = (_node(water, point) for point in (start, goal))
    best = np.full((rows, columns), np.inf)
    best[first] = begin
    before: dict[tuple[int, int], tuple[int, int]] = {}
    heap = [(begin, first)]
    while heap:
        now, here = heapq.heappop(heap)
        if here == last:
            break
        if now > best[here]:
            continue
        there = np.array(here) + EDGES
        inside = ((there >= 0) & (there < (rows, columns))).all(axis=1)
        there = there[inside]
        then = np.full(len(there), now)
        ahead = directions[inside]
        for part in PARTS:
            k = np.minimum(np.rint(then / STEP).astype(int), len(field) - 1)
            place = np.rint(here + part * EDGES[inside]).astype(int)
            made = made_good(field[k, place[:, 0], place[:, 1]], ahead, speed)
            then = then + lengths[inside] / len(PARTS) / made
        better = then < best[there[:, 0], there[:, 1]]
        for node, time in zip(there[better].tolist(), then[better].tolist(), strict=True):
            edge = np.array([_point(water, here), _point(water, node)])
            if avoided and crosses(edge, avoided):
                continue
            best[tuple(node)] = time
            before[tuple(node)] = here
            heapq.heappush(heap, (time, tuple(node)))
    if not np.isfinite(best[last]):
        return None
    nodes = [last]
    while nodes[-1] != first:
        nodes.append(before[nodes[-1]])
    found = np.array([_point(water, node) for node in reversed(nodes)])
    return np.concatenate([start[None], found[1:-1], goal[None]])


def polished(
    water: RouteWater, way: Array, speed: float, avoided: Sequence[Array], begin: float = 0.0
) -> Array:
    """A way of few corners, moved to the least mean time over all members, (corner, 2)."""
    from scipy.optimize import minimize

    few = thinned(water, way, speed, avoided, begin)
    if len(few) < 3:
        few = np.stack([few[0], few.mean(axis=0), few[-1]])
    ends = few[:1], few[-1:]

    def cost(inner: Array) -> float:
        moved = np.concatenate([ends[0], inner.reshape(-1, 2) * water.spacing, ends[1]])
        return float(way_times(water, moved, speed, avoided, begin).mean())

    inner = few[1:-1].ravel() / water.spacing
    found = minimize(cost, inner, method="Powell", options={"maxfev": 120 * len(inner),
                     "xtol": 0.05, "ftol": 1e-4})  # fmt: skip
    moved = np.concatenate([ends[0], found.x.reshape(-1, 2) * water.spacing, ends[1]])
    return moved if found.fun < cost(inner) else few


def thinned(
    water: RouteWater, way: Array, speed: float, avoided: Sequence[Array], begin: float = 0.0
) -> Array:
    """A way without the corners that it misses least, at most `CORNERS` between its ends.

    More are left out while that costs less than `WORTH` of the time each.
    """

    def cost(one: Array) -> float:
        return float(way_times(water, one, speed, avoided, begin).mean())

    now = cost(way)
    while len(way) > 2:
        without = [np.delete(way, k, axis=0) for k in range(1, len(way) - 1)]
        costs = [cost(one) for one in without]
        least = int(np.argmin(costs))
        if len(way) <= CORNERS + 2 and costs[least] > (1.0 + WORTH) * now:
            break
        way, now = without[least], costs[least]
    return way


def crosses(way: Array, avoided: Sequence[Array]) -> bool:
    """Whether a way, (corner, 2), meets a polygon, each (corner, 2), or lies in one."""
    a, b = way[:-1, None], way[1:, None]
    for ring in avoided:
        c, d = ring[None], np.roll(ring, -1, axis=0)[None]
        apart = _side(a, b, c) * _side(a, b, d) < 0.0
        across = _side(c, d, a) * _side(c, d, b) < 0.0
        if (apart & across).any() or _inside(way[0], ring):
            return True
    return False


def _inside(point: Array, ring: Array) -> bool:
    """Whether a ray to the north from a point meets the ring an odd number of times."""
    after = np.roll(ring, -1, axis=0)
    spans = (ring[:, 1] > point[1]) != (after[:, 1] > point[1])
    step = np.where(spans, after[:, 1] - ring[:, 1], 1.0)
    north = ring[:, 0] + (point[1] - ring[:, 1]) / step * (after[:, 0] - ring[:, 0])
    return bool((spans & (north > point[0])).sum() % 2)


def _side(a: Array, b: Array, c: Array) -> Array:
    """Twice the area of the triangle of three points, signed."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def _node(water: RouteWater, point: Array) -> tuple[int, int]:
    north, east = (
        int(np.argmin(np.abs(axis - value)))
        for axis, value in zip((water.north, water.east), point, strict=True)
    )
    return north, east


def _point(water: RouteWater, node: Sequence[int]) -> tuple[float, float]:
    return float(water.north[node[0]]), float(water.east[node[1]])
