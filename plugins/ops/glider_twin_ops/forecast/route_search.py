"""Route search: the fastest way through moving water for a vehicle of a given speed in it.

Dijkstra's algorithm over the nodes of the water, where each edge takes as long as the current along
it, when it is passed, makes it, and ways of few corners that are thrown at random; then the corners
are moved until the mean over all draws of the water is least (Powell 1964, Comput. J. 7).
North and east are metres in the plane that touches the Earth at the start.
"""

from __future__ import annotations

import dataclasses
import heapq
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.compiled import inline, jit
from twin.numbers import Array

STEP = 3.0 * 3600.0
"""[s] between two times of the water"""
REACH = 4
"""Nodes that an edge spans at most: 48 directions"""
SPANS = range(-REACH, REACH + 1)
EDGES = np.array([(n, e) for n in SPANS for e in SPANS if math.gcd(n, e) == 1])
LOOKS = (4, 8, 16)
"""Places of an edge where its current is looked up, at the node that is nearest: few find ways that
bear a forecast's errors, many find the best of a water that is known; all of them are tried"""
SLOWEST = 0.02
"""[m/s] over ground that counts as no progress: it waits there for better water"""
CORNERS = 7
"""Of a way, at most: with its end as many as a Slocum's list of waypoints holds"""
WORTH = 0.002
"""Of the time, that a corner must save"""
THROWN, CAUGHT = 600, 3
"""Ways that are thrown, and how many of them are kept"""
MOST_THROWN = 4
"""Corners of a thrown way, at most"""
ALONG = (-0.2, 1.2)
"""Where they lie, in lengths of the straight way"""
ASIDE = (0.25, 0.05)
"""Standard deviation across it of the step between corners, in lengths: wide and narrow throws"""
AT_ONCE = 1_000_000
"""Numbers of lines and corners that are held beside each other at a time"""
BARRED = 1e9
"""[s] of a way that must not be taken"""
ALONE = 3
"""Single draws whose fastest ways are candidates, too"""
APART = 2.0
"""Nodes by which two ways must differ to be two"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RouteWater:
    """Currents on a grid, by member; the first one is what is expected."""

    north: Array
    """[m], (north,)"""
    east: Array
    """[m], (east,)"""
    current: Array
    """[m/s] north, east, (member, time, north, east, 2), `STEP` apart in time"""

    @property
    def spacing(self) -> float:
        """[m] of the nodes."""
        return float(self.north[1] - self.north[0])

    @property
    def corners(self) -> Array:
        """[m] of the region, south-west and north-east, (2, 2)."""
        return np.array([[self.north[k], self.east[k]] for k in (0, -1)])

    @property
    def lasts(self) -> float:
        """[s] from the start on that it covers."""
        return STEP * (self.current.shape[1] - 1)

    def part(self, members: slice) -> RouteWater:
        """Some of its members."""
        return dataclasses.replace(self, current=self.current[members])


@inline
def made_good(north, east, ahead, aside, speed):  # type: ignore[no-untyped-def]
    """[m/s] along a way with the bow held against what sets across it.

    Not above `SLOWEST` where the current across is faster than the vehicle.

    Args:
      north, east: [m/s] of the current. ahead, aside: the way's unit vector, north and east.
      speed: [m/s] through the water.
    """
    across = north * aside - east * ahead
    room = speed**2 - across**2
    if room <= 0.0:
        return SLOWEST
    return max(north * ahead + east * aside + math.sqrt(room), SLOWEST)


def way_times(
    water: RouteWater, way: Array, speed: float, avoided: Sequence[Array] = (), begin: float = 0.0
) -> Array:
    """[s] that a way takes in each member, (member,); `BARRED` where it must not be taken.

    Args:
      way: [m] north, east of its corners, (corner, 2). speed: [m/s] through the water.
      avoided: polygons, each (corner, 2). begin: [s] after the start.
    """
    low, high = water.corners
    if not ((way >= low) & (way <= high)).all() or crosses(way, avoided):
        return np.full(len(water.current), BARRED)
    way = np.ascontiguousarray(way, dtype=np.float64)
    return np.asarray(_flown(water.current, low, water.spacing, way, float(speed), float(begin)))


@jit(nogil=True)
def _flown(current, corner, spacing, way, speed, begin):  # type: ignore[no-untyped-def]
    """[s] of a way in each member; the current is linear in time and between nodes."""
    taken = np.empty(current.shape[0])
    last, rows, columns = current.shape[1], current.shape[2], current.shape[3]
    for member in range(len(taken)):
        time = begin
        for leg in range(len(way) - 1):
            far, wide = way[leg + 1, 0] - way[leg, 0], way[leg + 1, 1] - way[leg, 1]
            length = math.hypot(far, wide)
            if length < 1.0:
                continue
            steps = math.ceil(length / spacing)
            for k in range(steps):
                part = (k + 0.5) / steps
                row, below = _cell((way[leg, 0] + part * far - corner[0]) / spacing, rows)
                column, left = _cell((way[leg, 1] + part * wide - corner[1]) / spacing, columns)
                when, later = _cell(time / STEP, last)
                north, east = 0.0, 0.0
                for t, of_time in ((when, 1.0 - later), (when + 1, later)):
                    for n, of_row in ((row, 1.0 - below), (row + 1, below)):
                        for e, weight in ((column, 1.0 - left), (column + 1, left)):
                            share = of_time * of_row * weight
                            north += share * current[member, t, n, e, 0]
                            east += share * current[member, t, n, e, 1]
                made = made_good(north, east, far / length, wide / length, speed)
                time += length / steps / made
        taken[member] = time - begin
    return taken


@inline
def _cell(place, count):  # type: ignore[no-untyped-def]
    """Index of the cell of `count` nodes that a place is in, and the part of it that is before."""
    place = min(max(place, 0.0), count - 1.000001)
    return int(place), place - int(place)


def best_ways(
    water: RouteWater,
    stops: Array,
    speed: float,
    avoided: Sequence[Array],
    rng: np.random.Generator,
) -> list[Array]:
    """Ways through stops, [m] north, east, (stop, 2), that are fastest in the mean water or in a
    draw, and polished in all; each (corner, 2), none twice."""
    ways: list[Array] = []
    edges = open_edges(water, avoided)
    for member in range(min(1 + ALONE, len(water.current))):
        found = _through(water, member, stops, speed, avoided, edges, rng)
        if found is not None and all(_differs(found, way, water.spacing) for way in ways):
            ways.append(found)
    return ways


def _through(
    water: RouteWater,
    member: int,
    stops: Array,
    speed: float,
    rings: Sequence[Array],
    edges: NDArray[np.bool_],
    rng: np.random.Generator,
) -> Array | None:
    """The polished way from stop to stop that is fastest, of those that one draw begins with."""
    alone = water.part(slice(member, member + 1))
    whole, begin = stops[:1], 0.0
    for here, there in itertools.pairwise(stops):
        legs = []
        for looks in LOOKS:
            leg = fastest(water, member, here, there, speed, edges, begin, looks)
            if leg is None:
                return None
            legs.append(leg)
        caught = thrown(alone, here, there, speed, rings, begin, rng)
        legs += [polished(alone, leg, speed, rings, begin) for leg in caught]

        def mean(way: Array, begin: float = begin) -> float:
            return _mean_time(water, way, speed, rings, begin)

        legs = [
            polished(water, leg, speed, rings, begin) if mean(leg) < BARRED else leg for leg in legs
        ]
        leg = min(legs, key=mean)
        begin += float(np.median(way_times(water, leg, speed, (), begin)))
        whole = np.concatenate([whole, leg[1:]])
    return whole


def _mean_time(
    water: RouteWater, way: Array, speed: float, avoided: Sequence[Array], begin: float
) -> float:
    """[s] that a way takes in the mean of all members."""
    return float(way_times(water, way, speed, avoided, begin).mean())


def _differs(one: Array, other: Array, spacing: float) -> bool:
    """Whether two ways are apart somewhere, by their points at equal parts of their lengths."""

    def even(way: Array) -> Array:
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
        at = np.linspace(0.0, along[-1], 50)
        return np.stack([np.interp(at, along, way[:, k]) for k in range(2)], axis=1)

    return float(np.hypot(*(even(one) - even(other)).T).max()) > APART * spacing


def fastest(
    water: RouteWater,
    member: int,
    start: Array,
    goal: Array,
    speed: float,
    edges: NDArray[np.bool_],
    begin: float = 0.0,
    looks: int = LOOKS[0],
) -> Array | None:
    """The fastest way in one member, [m] north, east of its nodes, (node, 2); None: there is none.

    Args:
      start, goal: [m] north, east. speed: [m/s]. begin: [s] after the start of the water.
      edges: that may be taken, of `open_edges`.
      looks: places of an edge where its current is looked up.
    """
    first, last = (
        (int(np.argmin(np.abs(water.north - n))), int(np.argmin(np.abs(water.east - e))))
        for n, e in (start, goal)
    )
    field, spacing = water.current[member], water.spacing
    before = _spread(field, spacing, edges, first, last, float(speed), float(begin), looks)
    nodes = [last]
    while nodes[-1] != first:
        came = int(before[nodes[-1]])
        if came < 0:
            return None
        nodes.append(divmod(came, len(water.east)))
    rows, columns = np.array(nodes[-2:0:-1], int).reshape(-1, 2).T
    inner = np.stack([water.north[rows], water.east[columns]], axis=1)
    return np.concatenate([start[None], inner, goal[None]])


def open_edges(water: RouteWater, avoided: Sequence[Array] = ()) -> NDArray[np.bool_]:
    """Which edges of each node may be taken, (north, east, edge): they end in the water's region
    and meet no polygon."""
    rows, columns = len(water.north), len(water.east)
    here = np.indices((rows, columns)).transpose(1, 2, 0)[:, :, None]
    there = here + EDGES
    found = ((there >= 0) & (there < (rows, columns))).all(axis=-1)
    if avoided:
        origin, spacing = water.corners[0], water.spacing
        begins = np.broadcast_to(origin + spacing * here, there.shape).reshape(-1, 2)
        ends = (origin + spacing * there).reshape(-1, 2)
        found &= ~meets(begins, ends, avoided).reshape(found.shape)
    return found


def thrown(
    water: RouteWater,
    start: Array,
    goal: Array,
    speed: float,
    avoided: Sequence[Array],
    begin: float,
    rng: np.random.Generator,
) -> list[Array]:
    """The best of ways that are thrown at random, by the mean over all members; each (corner, 2).

    A search from node to node finds a way of many corners, of which the best few need not be near
    the best way of few corners.

    Args:
      start, goal: [m] north, east. speed: [m/s]. begin: [s] after the start of the water.
    """
    length = float(np.hypot(*(goal - start)))
    if length == 0.0:
        return []
    ahead = (goal - start) / length
    aside = np.array([-ahead[1], ahead[0]])
    found = []
    for k in range(THROWN):
        corners = 1 + k % MOST_THROWN
        along = length * np.sort(rng.uniform(*ALONG, corners))
        across = length * np.cumsum(rng.normal(0.0, ASIDE[k % len(ASIDE)], corners))
        inner = start + np.outer(along, ahead) + np.outer(across, aside)
        way = np.concatenate([start[None], np.clip(inner, *water.corners), goal[None]])
        found.append((_mean_time(water, way, speed, avoided, begin), way))
    found.sort(key=lambda one: one[0])
    return [way for times, way in found[:CAUGHT] if times < BARRED]


@jit(nogil=True)
def _spread(field, spacing, open_, first, last, speed, begin, looks):  # type: ignore[no-untyped-def]
    """Dijkstra's search: of each node the one that it is reached from, row * columns + column.

    Args:
      field: [m/s] north, east, (time, north, east, 2). open_: edges that may be taken, (north,
        east, edge). first, last: row and column. looks: as in `fastest`.
    """
    rows, columns = field.shape[1], field.shape[2]
    best = np.full((rows, columns), np.inf)
    before = np.full((rows, columns), -1)
    best[first] = begin
    heap = [(begin, first[0] * columns + first[1])]
    while heap:
        now, node = heapq.heappop(heap)
        row, column = node // columns, node % columns
        if row == last[0] and column == last[1]:
            break
        if now > best[row, column]:
            continue
        for k in range(len(EDGES)):
            if not open_[row, column, k]:
                continue
            far, wide = EDGES[k, 0], EDGES[k, 1]
            length = math.hypot(far, wide)
            ahead, aside, then = far / length, wide / length, now
            for look in range(looks):
                part = (look + 0.5) / looks
                at = min(int(np.rint(then / STEP)), len(field) - 1)
                n, e = int(np.rint(row + part * far)), int(np.rint(column + part * wide))
                made = made_good(field[at, n, e, 0], field[at, n, e, 1], ahead, aside, speed)
                then += length * spacing / looks / made
            if then < best[row + far, column + wide]:
                best[row + far, column + wide] = then
                before[row + far, column + wide] = node
                heapq.heappush(heap, (then, (row + far) * columns + column + wide))
    return before


def polished(
    water: RouteWater, way: Array, speed: float, avoided: Sequence[Array], begin: float = 0.0
) -> Array:
    """A way of few corners, moved to the least mean time over all members, (corner, 2)."""
    from scipy.optimize import minimize

    few = thinned(water, way, speed, avoided, begin)
    if len(few) < 3:
        few = np.stack([few[0], few.mean(axis=0), few[-1]])

    def moved(inner: Array) -> Array:
        return np.concatenate([few[:1], inner.reshape(-1, 2) * water.spacing, few[-1:]])

    def cost(inner: Array) -> float:
        return _mean_time(water, moved(inner), speed, avoided, begin)

    inner = few[1:-1].ravel() / water.spacing
    options = {"maxfev": 120 * len(inner), "xtol": 0.05, "ftol": 1e-4}
    found = minimize(cost, inner, method="Powell", options=options)
    return moved(found.x) if found.fun < cost(inner) else few


def thinned(
    water: RouteWater, way: Array, speed: float, avoided: Sequence[Array], begin: float = 0.0
) -> Array:
    """A way without the corners that it misses least, at most `CORNERS` between its ends.

    More are left out while that costs less than `WORTH` of the time each.
    """
    now = _mean_time(water, way, speed, avoided, begin)
    while len(way) > 2:
        without = [np.delete(way, k, axis=0) for k in range(1, len(way) - 1)]
        costs = [_mean_time(water, one, speed, avoided, begin) for one in without]
        least = int(np.argmin(costs))
        if len(way) <= CORNERS + 2 and costs[least] > (1.0 + WORTH) * now:
            break
        way, now = without[least], costs[least]
    return way


def crosses(way: Array, avoided: Sequence[Array]) -> bool:
    """Whether a way, (corner, 2), meets a polygon, each (corner, 2), or lies in one."""
    return bool(meets(way[:-1], way[1:], avoided).any())


def meets(begins: Array, ends: Array, avoided: Sequence[Array]) -> NDArray[np.bool_]:
    """Which of straight lines, (line, 2) each end, meet a polygon or begin in one."""
    found = np.zeros(len(begins), dtype=bool)
    for ring in avoided:
        c, d = ring[None], np.roll(ring, -1, axis=0)[None]
        for some in np.array_split(np.arange(len(begins)), 1 + begins.size * len(ring) // AT_ONCE):
            a, b = begins[some, None], ends[some, None]
            apart = _side(a, b, c) * _side(a, b, d) < 0.0
            across = _side(c, d, a) * _side(c, d, b) < 0.0
            found[some] |= (apart & across).any(axis=1) | _inside(begins[some], ring)
    return found


def _inside(points: Array, ring: Array) -> NDArray[np.bool_]:
    """Whether a ray to the north from each point, (point, 2), meets the ring an odd number of
    times."""
    north, east = points[:, :1], points[:, 1:]
    after = np.roll(ring, -1, axis=0)
    spans = (ring[:, 1] > east) != (after[:, 1] > east)
    step = np.where(after[:, 1] == ring[:, 1], 1.0, after[:, 1] - ring[:, 1])
    meets_at = ring[:, 0] + (east - ring[:, 1]) / step * (after[:, 0] - ring[:, 0])
    return np.asarray((spans & (meets_at > north)).sum(axis=1) % 2 == 1)


def _side(a: Array, b: Array, c: Array) -> Array:
    """Twice the area of the triangle of three points, signed."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
