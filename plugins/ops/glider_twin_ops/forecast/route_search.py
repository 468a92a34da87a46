"""Route search: the fastest way through moving water for a vehicle of a given speed in it.

Dijkstra's algorithm over the nodes of the water, where each edge takes as long as the current along
it, when it is passed, makes it, and ways of few corners that are thrown at random; then the corners
are moved until the mean over all draws of the water is least (Powell 1964, Comput. J. 7).
North and east are metres in the plane that touches the Earth at the start.
"""

from __future__ import annotations

import dataclasses
import functools
import heapq
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.members import FIELD_TIME
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
SLOWEST, BARRED = 0.02, 1e9
"""[m/s] over ground that counts as no progress: it waits there for better water; and [s] of a way
that must not be taken"""
CORNERS, WORTH = 7, 0.002
"""Of a way, at most: with its end as many as a Slocum's list of waypoints holds; and the part of
the time that each must save"""
THROWN, CAUGHT, MOST_THROWN = 600, 3, 4
"""Ways that are thrown, how many of them are kept, and the corners of each, at most"""
ALONG, ASIDE = (-0.2, 1.2), (0.25, 0.05)
"""Where these lie, in lengths of the straight way, and the standard deviation across it of the step
between corners, in lengths: wide and narrow throws"""
AT_ONCE = 1_000_000
"""Numbers of lines and corners that are held beside each other at a time"""
ALONE, APART = 3, 2.0
"""Single draws whose fastest ways are candidates, too, and nodes by which two ways must differ"""
EDDIES, SHORTEST, LONGEST = 24, 3e4, 2e5
"""Waves that make an error of the field, and their lengths [m]: mesoscale eddies, that models
misplace"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RouteWater:
    """Currents on a grid [m], (north,) and (east,), by member; the first is what is expected."""

    north: Array
    east: Array
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


def erring(
    forecast: Array,
    error: float,
    members: int,
    rng: np.random.Generator,
    times: Array,
    north: Array,
    east: Array,
) -> Array:
    """The water that a forecast lets expect, and draws of it, (member, time, north, east, 2).

    A forecast that misplaces eddies is as lively as the water, and the larger its error, the less
    of what it shows is there: of what differs from the mean over region and time the part 1 - N / 2
    S is expected, where N is the variance of its error and S its own; the rest is drawn. Draws come
    in pairs of opposite errors, so that an odd number of members has the expected water as mean.

    Args:
      forecast: [m/s] north, east, (time, north, east, 2). error: [m/s] standard deviation each way.
    """
    mean, wrong, there = forecast.mean(axis=(0, 1, 2)), error**2, 0.0
    liveliness = float(((forecast - mean) ** 2).mean())
    if error == 0.0 or liveliness > 0.0:
        there = 1.0 if error == 0.0 else max(1.0 - wrong / (2.0 * liveliness), 0.0)
    # water that has nothing of the forecast adds its own liveliness to the forecast's
    rest = liveliness * (1.0 - there**2) if there > 0.0 else wrong - liveliness
    expected = mean + there * (forecast - mean)
    found = np.empty((members, *forecast.shape))
    found[0] = expected
    for member in range(1, members, 2):
        one = math.sqrt(rest) * eddies(rng, times, north, east)
        found[member : member + 2] = np.stack([expected + one, expected - one])[: members - member]
    return found


def eddies(rng: np.random.Generator, times: Array, north: Array, east: Array) -> Array:
    """A random flow without divergence, 1 m/s each way, (time, north, east, 2)."""
    turn = rng.uniform(0.0, 2.0 * math.pi, EDDIES)
    length = np.exp(rng.uniform(math.log(SHORTEST), math.log(LONGEST), EDDIES))
    wave = 2.0 * math.pi / length * np.array([np.cos(turn), np.sin(turn)])
    rate = rng.standard_normal(EDDIES) / FIELD_TIME
    phase = rng.uniform(0.0, 2.0 * math.pi, EDDIES)
    size = rng.standard_normal(EDDIES) * math.sqrt(2.0 / EDDIES) * math.sqrt(2.0)
    # a wave is a product of one of time, north and east each: real part of exp(i (a + b + c))
    over, up = np.exp(1j * (phase - np.outer(times, rate))), np.exp(1j * np.outer(north, wave[0]))
    of_two = (over[:, None] * up).reshape(-1, EDDIES)
    right = np.exp(1j * np.outer(wave[1], east))
    shape = len(times), len(north), len(east)
    flow = [
        ((of_two * sized) @ right).real.reshape(shape)
        for sized in (-size * np.sin(turn), size * np.cos(turn))
    ]
    return np.stack(flow, axis=-1)


def way_times(
    water: RouteWater, way: Array, speed: float, avoided: Sequence[Array] = (), begin: float = 0.0
) -> Array:
    """[s] that a way takes in each member, (member,); `BARRED` where it must not be taken.

    Args:
      way: [m] north, east of its corners, (corner, 2). speed: [m/s] through the water.
      avoided: polygons, each (corner, 2). begin: [s] after the start.
    """
    low, high = water.corners
    if not ((way >= low) & (way <= high)).all() or meets(way[:-1], way[1:], avoided).any():
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


@dataclasses.dataclass(kw_only=True)
class Search:
    """Ways through one water at one speed, from one time on; each (corner, 2), [m] north, east."""

    water: RouteWater
    speed: float
    """[m/s] through the water"""
    avoided: Sequence[Array] = ()
    """Polygons, each (corner, 2)"""
    begin: float = 0.0
    """[s] after the start of the water"""

    @functools.cached_property
    def edges(self) -> NDArray[np.bool_]:
        """Mask of the allowed edges of each node, (north, east, edge): they end in the water's
        region and meet no polygon."""
        rows, columns = len(self.water.north), len(self.water.east)
        here = np.indices((rows, columns)).transpose(1, 2, 0)[:, :, None]
        there = here + EDGES
        found = ((there >= 0) & (there < (rows, columns))).all(axis=-1)
        if self.avoided:
            origin, spacing = self.water.corners[0], self.water.spacing
            begins = np.broadcast_to(origin + spacing * here, there.shape).reshape(-1, 2)
            ends = (origin + spacing * there).reshape(-1, 2)
            found &= ~meets(begins, ends, self.avoided).reshape(found.shape)
        return found

    def mean(self, way: Array) -> float:
        """[s] that a way takes in the mean of all members."""
        times = way_times(self.water, way, self.speed, self.avoided, self.begin)
        return float(times.mean())

    def fastest(
        self, member: int, start: Array, goal: Array, looks: int = LOOKS[0]
    ) -> Array | None:
        """The fastest way from node to node in one member, by `LOOKS`; None: there is none."""
        water = self.water
        first, last = (
            (int(np.argmin(np.abs(water.north - n))), int(np.argmin(np.abs(water.east - e))))
            for n, e in (start, goal)
        )
        field, speed, begin = water.current[member], float(self.speed), float(self.begin)
        before = _spread(field, water.spacing, self.edges, first, last, speed, begin, looks)
        nodes = [last]
        while nodes[-1] != first:
            came = int(before[nodes[-1]])
            if came < 0:
                return None
            nodes.append(divmod(came, len(water.east)))
        rows, columns = np.array(nodes[-2:0:-1], int).reshape(-1, 2).T
        inner = np.stack([water.north[rows], water.east[columns]], axis=1)
        return np.concatenate([start[None], inner, goal[None]])

    def thrown(self, start: Array, goal: Array, rng: np.random.Generator) -> list[Array]:
        """The best of ways that are thrown at random, by the mean over all members.

        A search from node to node finds a way of many corners, of which the best few need not be
        near the best way of few corners.
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
            inner = np.clip(inner, *self.water.corners)
            way = np.concatenate([start[None], inner, goal[None]])
            found.append((self.mean(way), way))
        found.sort(key=lambda one: one[0])
        return [way for times, way in found[:CAUGHT] if times < BARRED]

    def thinned(self, way: Array) -> Array:
        """A way without the corners that it misses least: at most `CORNERS` between its ends, and
        more are left out while that costs less than `WORTH` of the time each."""
        now = self.mean(way)
        while len(way) > 2:
            without = [np.delete(way, k, axis=0) for k in range(1, len(way) - 1)]
            costs = [self.mean(one) for one in without]
            least = int(np.argmin(costs))
            if len(way) <= CORNERS + 2 and costs[least] > (1.0 + WORTH) * now:
                break
            way, now = without[least], costs[least]
        return way

    def polished(self, way: Array) -> Array:
        """A way of few corners, moved to the least mean time over all members."""
        from scipy.optimize import minimize

        few = self.thinned(way)
        if len(few) < 3:
            few = np.stack([few[0], few.mean(axis=0), few[-1]])

        def moved(inner: Array) -> Array:
            return np.concatenate([few[:1], inner.reshape(-1, 2) * self.water.spacing, few[-1:]])

        inner = few[1:-1].ravel() / self.water.spacing
        options = {"maxfev": 120 * len(inner), "xtol": 0.05, "ftol": 1e-4}
        found = minimize(lambda x: self.mean(moved(x)), inner, method="Powell", options=options)
        return moved(found.x) if found.fun < self.mean(moved(inner)) else few


def best_ways(
    water: RouteWater,
    stops: Array,
    speed: float,
    avoided: Sequence[Array],
    rng: np.random.Generator,
) -> list[Array]:
    """Ways through stops, [m] north, east, (stop, 2), that are fastest in the mean water or in a
    draw, and polished in all; each (corner, 2), none twice."""

    def even(way: Array) -> Array:
        """Points at equal parts of a way's length, (2, point)."""
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
        at = np.linspace(0.0, along[-1], 50)
        return np.array([np.interp(at, along, metres) for metres in way.T])

    ways: list[Array] = []
    search = Search(water=water, speed=speed, avoided=avoided)
    for member in range(min(1 + ALONE, len(water.current))):
        found = _through(search, member, stops, rng)
        if found is not None:
            apart = [float(np.hypot(*(even(found) - even(way))).max()) for way in ways]
            ways += [found] if min(apart, default=math.inf) > APART * water.spacing else []
    return ways


def _through(search: Search, member: int, stops: Array, rng: np.random.Generator) -> Array | None:
    """The polished way from stop to stop that is fastest, of those that one draw begins with."""
    whole, search.begin = stops[:1], 0.0
    alone = search.water.part(slice(member, member + 1))
    for here, there in itertools.pairwise(stops):
        found = [search.fastest(member, here, there, looks) for looks in LOOKS]
        legs = [leg for leg in found if leg is not None]
        if len(legs) < len(found):
            return None
        of_one = dataclasses.replace(search, water=alone)
        legs += [of_one.polished(leg) for leg in of_one.thrown(here, there, rng)]
        legs = [search.polished(leg) if search.mean(leg) < BARRED else leg for leg in legs]
        leg = min(legs, key=search.mean)
        whole = np.concatenate([whole, leg[1:]])
        free = way_times(search.water, leg, search.speed, (), search.begin)
        search.begin += float(np.median(free))
    return whole


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


def meets(begins: Array, ends: Array, avoided: Sequence[Array]) -> NDArray[np.bool_]:
    """Which of straight lines, (line, 2) each end, meet a polygon or begin in one."""
    found = np.zeros(len(begins), dtype=bool)
    for ring in avoided:
        c, d = ring[None], np.roll(ring, -1, axis=0)[None]
        (north_c, east_c), (north_d, east_d) = ring.T, d[0].T
        step = np.where(east_d == east_c, 1.0, east_d - east_c)
        for some in np.array_split(np.arange(len(begins)), 1 + begins.size * len(ring) // AT_ONCE):
            a, b = begins[some, None], ends[some, None]
            apart = _side(a, b, c) * _side(a, b, d) < 0.0
            across = _side(c, d, a) * _side(c, d, b) < 0.0
            # inside: a ray to the north meets the ring an odd number of times
            north, east = begins[some, :1], begins[some, 1:]
            meets_at = north_c + (east - east_c) / step * (north_d - north_c)
            met = ((east_c > east) != (east_d > east)) & (meets_at > north)
            found[some] |= (apart & across).any(axis=1) | (met.sum(axis=1) % 2 == 1)
    return found


def _side(a: Array, b: Array, c: Array) -> Array:
    """Twice the area of the triangle of three points, signed."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
