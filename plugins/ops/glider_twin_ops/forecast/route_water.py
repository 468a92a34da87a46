"""Route water: the current of a region, mean over the depths of the dives, and draws of its error.

North and east are metres in the plane that touches the Earth at the start.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.draws import FIELD_TIME, INTERVAL, draw_models, draw_water
from glider_twin_ops.forecast.known import Known
from glider_twin_ops.forecast.request import Request, longest_dive
from twin.errors import InputError
from twin.geodesy import to_tangent_plane
from twin.numbers import Array
from twin.water.current import Current, Grid, sample_track

NODES = 41
"""Along the longer side of the region"""
STEP = 3.0 * 3600.0
"""[s] between two times"""
LEVELS = 9
"""Depths of the mean"""
EDDIES = 24
"""Waves that make an error of the field"""
SHORTEST, LONGEST = 3e4, 2e5
"""[m] Their lengths: mesoscale eddies, that models misplace"""


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
    def lasts(self) -> float:
        """[s] from the start on that it covers."""
        return STEP * (self.current.shape[1] - 1)

    def part(self, members: slice) -> RouteWater:
        """Some of its members."""
        return dataclasses.replace(self, current=self.current[members])

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Whether points, (..., 2), lie inside."""
        low, high = (np.array([self.north[k], self.east[k]]) for k in (0, -1))
        return np.asarray(((points >= low) & (points <= high)).all(axis=-1))


def route_water(
    request: Request, known: Known, points: Array, hours: float, rng: np.random.Generator
) -> RouteWater:
    """The water around places.

    Args:
      request: with the field, the mission whose depths count, and how many members.
      known: what the logs told; used where there is no field.
      points: [m] north, east of start, targets and vias, (point, 2). hours: [h] to cover.

    Raises:
      InputError: nothing is known of the current, or not at one of the places.
      CurrentError: the field does not cover the time.
    """
    if request.field is None and not known.legs:
        raise InputError(
            "the current is not known, so no way is better than the straight one: give --current "
            "with a forecast's file, or --logs"
        )
    low, high = points.min(axis=0), points.max(axis=0)
    margin = max(0.5 * float(np.hypot(*(high - low))), 1e4)
    low, high = low - margin, high + margin
    if request.field is not None:
        covered = _covered(request.field, hours * 3600.0, request)
        low, high = np.maximum(low, covered[0]), np.minimum(high, covered[1])
    outside = (points < low).any(axis=1) | (points > high).any(axis=1)
    if outside.any():
        raise InputError(
            f"the current is not known at place {int(np.argmax(outside))} of the way (0 is the "
            "start): --current ends before it; nothing can be promised there"
        )
    spacing = float((high - low).max()) / (NODES - 1)
    north, east = (np.arange(low[k], high[k] + 0.5 * spacing, spacing) for k in range(2))
    times: Array = STEP * np.arange(math.ceil(hours * 3600.0 / STEP) + 1, dtype=np.float64)
    shape = (request.members, len(times), len(north), len(east), 2)
    if request.field is None:
        duration = times[-1] + INTERVAL
        water = draw_water(
            known.filter_, duration, request.members, rng, longest_dive(request.mission)
        )
        course = draw_models(water, known.pool, rng)[0].current
        every = course[:, :: round(STEP / INTERVAL)][:, : len(times), None, None]
        return RouteWater(north=north, east=east, current=np.broadcast_to(every, shape).copy())
    mean = _mean(request.field, request, times, north, east)
    drawn = erring(mean, request.field_error, request.members, rng, times, north, east)
    return RouteWater(north=north, east=east, current=drawn)


def _covered(field: Current, seconds: float, request: Request) -> tuple[Array, Array]:
    """[m] south-west and north-east corner of what files of the field hold."""
    low, high = np.full(2, -np.inf), np.full(2, np.inf)
    place = request.place
    for part in getattr(field, "parts", (field,)):
        if not isinstance(part, Grid):
            continue
        box, _ = part.load(seconds, place)
        if not np.isfinite(box.latitude).all():
            continue  # one column of water stands for everywhere
        for k, pick in ((0, np.maximum), (1, np.minimum)):
            corner = to_tangent_plane(
                float(box.latitude[-k]),
                float(box.longitude[-k]) + place.longitude_deg,
                place.latitude_deg,
                place.longitude_deg,
            )
            edge = low if k == 0 else high
            edge[:] = pick(edge, corner)
    return low, high


def _mean(field: Current, request: Request, times: Array, north: Array, east: Array) -> Array:
    """[m/s] mean over the depths of the dives, (time, north, east, 2)."""
    deepest = max(getattr(one, "max_depth_m", 0.0) for one in request.mission.segments)
    depths = np.linspace(0.0, max(deepest, 1.0), LEVELS)
    program = field.compile(float(times[-1]), request.place)
    grid = np.meshgrid(times, north, east, depths, indexing="ij")
    t, n, e, d = (axis.ravel() for axis in grid)
    rest = np.zeros_like(t)
    found = sample_track(program, t, n, e, d, rest, rest, rest)[:, :2]
    return np.asarray(found.reshape(*grid[0].shape, 2).mean(axis=3))


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
    mean = forecast.mean(axis=(0, 1, 2))
    liveliness, wrong = float(((forecast - mean) ** 2).mean()), error**2
    there = max(1.0 - wrong / (2.0 * liveliness), 0.0) if liveliness > 0.0 else 0.0
    if error == 0.0:
        there = 1.0
    # water that has nothing of the forecast adds its own liveliness to the forecast's
    rest = liveliness * (1.0 - there**2) if there > 0.0 else wrong - liveliness
    expected = mean + there * (forecast - mean)
    found = np.empty((members, *forecast.shape))
    found[0] = expected
    for member in range(1, members, 2):
        one = math.sqrt(rest) * eddies(rng, times, north, east)
        found[member] = expected + one
        if member + 1 < members:
            found[member + 1] = expected - one
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
