"""Route search: the fastest path through a current for a vehicle of given speed through the water.

Candidates come from Dijkstra's algorithm over the nodes of a grid, where the time of an edge
follows from the current when the vehicle passes it, and from random paths of few corners. The
corners are then moved to the least mean time over all samples of the water (Powell 1964, Comput.
J. 7). North and east are metres in the tangent plane at the start. `routes` uses the search.
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
"""[s] Interval between two times of the water"""
REACH = 4
"""Maximum number of nodes that an edge spans, north and east each: 48 directions"""
SPANS = range(-REACH, REACH + 1)
EDGES = np.array([(n, e) for n in SPANS for e in SPANS if math.gcd(n, e) == 1])
LOOKS = (4, 8, 16)
"""Numbers of places along an edge at which the nearest node's current is read. All three are tried:
few places give paths that tolerate a forecast's errors, many the best path if the water is known"""
SLOWEST, BARRED = 0.02, 1e9
"""SLOWEST: [m/s] speed over ground of a vehicle without progress, which waits for better water.
BARRED: [s] time of a forbidden path"""
CORNERS, WORTH = 7, 0.002
"""CORNERS: maximum number between a path's ends; with its end they fill a Slocum's list of
waypoints. WORTH: [1] smallest fraction of the time that each corner must save"""
THROWN, CAUGHT, MOST_THROWN = 600, 3, 4
"""THROWN: number of random paths. CAUGHT: number of paths that are kept. MOST_THROWN: maximum
number of corners of a random path"""
ALONG, ASIDE = (-0.2, 1.2), (0.25, 0.05)
"""[1] In lengths of the straight path. ALONG: limits of random corners along it. ASIDE: standard
deviations of steps across it, for wide and for narrow paths in turn"""
AT_ONCE = 1_000_000
"""Largest number of elements of an array of lines by corners of a polygon"""
ALONE, APART = 3, 2.0
"""ALONE: number of samples of the water whose fastest paths are candidates too. APART: [nodes]
smallest distance of two candidates"""
EDDIES, SHORTEST, LONGEST = 24, 3e4, 2e5
"""EDDIES: number of waves in a sampled error of the field. SHORTEST, LONGEST: [m] limits of their
length, those of mesoscale eddies, which models misplace"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RouteWater:
    """Currents of each member on a grid [m], (north,) and (east,); the first member is the mean."""

    north: Array
    east: Array
    current: Array
    """[m/s] north, east, (member, time, north, east, 2), `STEP` apart in time"""

    @property
    def spacing(self) -> float:
        """[m] Distance of neighbouring nodes."""
        return float(self.north[1] - self.north[0])

    @property
    def corners(self) -> Array:
        """[m] South-west and north-east corner of the region, (2, 2)."""
        return np.array([[self.north[k], self.east[k]] for k in (0, -1)])

    @property
    def lasts(self) -> float:
        """[s] Time from the start to the end of the currents."""
        return STEP * (self.current.shape[1] - 1)

    def part(self, members: slice) -> RouteWater:
        """Water of some of the members."""
        return dataclasses.replace(self, current=self.current[members])


@inline
def made_good(north, east, ahead, aside, speed):  # type: ignore[no-untyped-def]
    """Speed over ground [m/s] along a course, with the heading that cancels the current across it.

    The speed is `SLOWEST` if the current across is faster than the vehicle.

    Args:
      north, east: [m/s] current. ahead, aside: unit vector of the course, north and east.
      speed: [m/s] speed through the water.
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
    """Expected water of a forecast with errors, and samples, (member, time, north, east, 2).

    A forecast that misplaces eddies has the variance of the water. Of its anomalies (forecast less
    mean over region and time) the fraction 1 - N / (2 S) is expected, where N is the variance of
    the error and S that of the anomalies; the rest is sampled. Samples come in pairs of opposite
    errors, so that the mean of an odd number of members is the expected water.

    Args:
      forecast: [m/s] north, east, (time, north, east, 2). error: [m/s] deviation, north and east.
    """
    mean, wrong, there = forecast.mean(axis=(0, 1, 2)), error**2, 0.0
    liveliness = float(((forecast - mean) ** 2).mean())
    if error == 0.0 or liveliness > 0.0:
        there = 1.0 if error == 0.0 else max(1.0 - wrong / (2.0 * liveliness), 0.0)
    # where no anomaly is expected, water and forecast are independent: N = (water's variance) + S
    rest = liveliness * (1.0 - there**2) if there > 0.0 else wrong - liveliness
    expected = mean + there * (forecast - mean)
    found = np.empty((members, *forecast.shape))
    found[0] = expected
    for member in range(1, members, 2):
        one = math.sqrt(rest) * eddies(rng, times, north, east)
        found[member : member + 2] = np.stack([expected + one, expected - one])[: members - member]
    return found


def eddies(rng: np.random.Generator, times: Array, north: Array, east: Array) -> Array:
    """Random flow without divergence, rms 1 m/s north and east each, (time, north, east, 2)."""
    turn = rng.uniform(0.0, 2.0 * math.pi, EDDIES)
    length = np.exp(rng.uniform(math.log(SHORTEST), math.log(LONGEST), EDDIES))
    wave = 2.0 * math.pi / length * np.array([np.cos(turn), np.sin(turn)])
    rate = rng.standard_normal(EDDIES) / FIELD_TIME
    phase = rng.uniform(0.0, 2.0 * math.pi, EDDIES)
    size = rng.standard_normal(EDDIES) * math.sqrt(2.0 / EDDIES) * math.sqrt(2.0)
    # each wave is a product of three factors, of time, north and east: Re exp(i (a + b + c))
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
    """[s] Time of a path in each member, (member,); `BARRED` outside the region or in a polygon.

    Args:
      way: [m] north, east of the path's corners, (corner, 2). speed: [m/s] through the water.
      avoided: polygons, each (corner, 2). begin: [s] departure after the start.
    """
    low, high = water.corners
    if not ((way >= low) & (way <= high)).all() or meets(way[:-1], way[1:], avoided).any():
        return np.full(len(water.current), BARRED)
    way = np.ascontiguousarray(way, dtype=np.float64)
    return np.asarray(_flown(water.current, low, water.spacing, way, float(speed), float(begin)))


@jit(nogil=True)
def _flown(current, corner, spacing, way, speed, begin):  # type: ignore[no-untyped-def]
    """[s] Time of a path in each member; currents are interpolated in time and between nodes."""
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
    """Index of the cell that holds a place, and fraction of the cell before it; `count` nodes."""
    place = min(max(place, 0.0), count - 1.000001)
    return int(place), place - int(place)


@dataclasses.dataclass(kw_only=True)
class Search:
    """Search for paths, each (corner, 2), [m] north, east, at one speed and one departure time."""

    water: RouteWater
    speed: float
    """[m/s] through the water"""
    avoided: Sequence[Array] = ()
    """Polygons, each (corner, 2)"""
    begin: float = 0.0
    """[s] departure after the start of the water"""

    @functools.cached_property
    def edges(self) -> NDArray[np.bool_]:
        """Mask of the allowed edges of each node, (north, east, edge): an allowed edge ends in the
        region and meets no polygon."""
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
        """[s] Mean time of a path over all members."""
        times = way_times(self.water, way, self.speed, self.avoided, self.begin)
        return float(times.mean())

    def fastest(
        self, member: int, start: Array, goal: Array, looks: int = LOOKS[0]
    ) -> Array | None:
        """Fastest path over nodes in one member, with currents read at `looks` places an edge."""
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
        """Best `CAUGHT` of `THROWN` random paths of few corners, by the mean time over all members.

        The path over nodes has many corners. A few of these need not lie near the best path of few.
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
        """Remove corners whose removal costs least time: down to `CORNERS` between the ends, then
        while a removal costs less than the fraction `WORTH` of the time."""
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
        """Path of few corners, moved to the least mean time over all members."""
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
    """Paths through stops, [m] north, east, (stop, 2), that start as the fastest in the mean water
    or in one sample, and are polished in all; each (corner, 2), without near duplicates."""

    def even(way: Array) -> Array:
        """Points at equal distances along a path, (2, point)."""
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
    """Fastest polished path from stop to stop, of the candidates of one member; None: no path."""
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
    """Dijkstra's search: predecessor of each node as row * columns + column, -1 without one.

    Args:
      field: [m/s] north, east, (time, north, east, 2). open_: mask of allowed edges, (north, east,
        edge). first, last: row and column. looks: as in `fastest`.
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
    """Mask of the straight lines, (line, 2) each end, that cross a polygon or begin in one."""
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
    """Signed double area of the triangle of three points."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
