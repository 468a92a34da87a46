"""Routes: the fastest paths to a place for a vehicle that may be slower than the current.

Candidates are the fastest paths in the mean water and in single samples of it, moved to the least
mean time over these samples (`route_search`). A second set of samples, independent of the search,
gives each path's times. The chosen path must seldom be slower than the straight path. The twin
flies the best three and the straight path. The water is the current of a region, mean over the
depths of the dives, with samples of its error.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from glider_twin_ops.forecast.member_flights import MemberFlight, fly, fly_nominal
from glider_twin_ops.forecast.members import INTERVAL, draw_models, draw_water, members_of
from glider_twin_ops.forecast.request import HOUR, LONGEST_HOURS, Known, Request, longest_dive
from glider_twin_ops.forecast.route_search import (
    BARRED,
    STEP,
    RouteWater,
    best_ways,
    erring,
    way_times,
)
from glider_twin_ops.forecast.surfacing_forecast import collection, feature
from twin import Grid, Mission, Waypoint
from twin.errors import InputError, MissionError
from twin.geodesy import from_tangent_plane, to_tangent_plane, wrap_longitude
from twin.numbers import Array
from twin.water.current import Current, sample_track

PITCHES = (18.0, 22.0, 26.0, 30.0, 35.0)
"""[degree] Pitches of the polar"""
BEYOND, POLAR_HOURS = 60_000.0, 12.0
"""Flights for the polar. BEYOND: [m] distance of the target; none arrives. POLAR_HOURS: [h]"""
DRAWS, BEST = 48, 3
"""DRAWS: number of samples of the water besides the mean, for the search and again for the
judgement. BEST: number of paths that are flown besides the straight path"""
SLOWER, SELDOM, OFTEN = 1.02, 0.05, 0.5
"""[1] SLOWER: time over the straight path's that counts as slower. SELDOM: largest fraction of
samples in which a path may be slower. OFTEN: no path is recommended above this fraction that never
arrives."""
MOST_VIAS, NINETY = 6, (0.05, 0.95)
AT_HAND, LATE = 2.5, 1.2
"""[1] AT_HAND: time with known water over the straight path's time in still water. LATE: flight
time of the twin over the time within which 95 % of the samples arrive"""
NEAR = 2000.0
"""[m] Distance from the last place that counts as arrival"""
NODES, LEVELS = 41, 9
"""NODES: number of nodes along the region's longer side. LEVELS: number of depths of the mean"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Route:
    """Path to the place with its times [h]."""

    name: str
    places: tuple[tuple[float, float], ...]
    """Latitude, longitude [degree] of corners and last place, without the start"""
    hours: Array
    """[h] Time in each sample of the water for the judgement, (draw,)"""
    gain: Array
    """[1] fraction of the straight path's time that this path saves, (draw,)"""
    known_hours: float
    """[h] Time for which the water is known"""
    flown: Array = dataclasses.field(default_factory=lambda: np.empty(0))
    """[h] time of each member that the twin flew; NaN: no arrival, (member,)"""
    flown_hours: float = 0.0
    """[h] flight time of the members"""

    @property
    def arrives(self) -> float:
        """[1] Fraction of the samples that arrive while the water is known."""
        return float(np.mean(self.hours <= self.known_hours))

    @property
    def missed(self) -> float:
        """[1] Fraction of the flights without arrival; 0 if the flight time was too short."""
        if not len(self.flown) or np.quantile(self.hours, NINETY[1]) > self.flown_hours:
            return 0.0
        return float(np.mean(~np.isfinite(self.flown)))

    @property
    def goto(self) -> str:
        """Places as the text of `twin forecast --goto`."""
        return ";".join(f"{latitude:.4f},{longitude:.4f}" for latitude, longitude in self.places)

    def row(self) -> dict[str, object]:
        """Row of the command's table."""
        told = self.describe()
        hours = "{:.1f} ({:.1f} to {:.1f})".format(told["hours"], *told["hours_90"])
        gain = (100 * part for part in (told["gain"], *told["gain_90"]))
        gained = "" if self.name == "straight" else "{:.0f} % ({:.0f} to {:.0f})".format(*gain)
        found: dict[str, object] = {
            "way": self.name,
            "hours": hours if self.arrives > 0.0 else f"over {self.known_hours:.0f}",
            "gain": gained,
            "slower in": f"{100 * told['slower_in']:.0f} %",
            "arrives in": f"{100 * told['arrives_in']:.0f} %",
        }
        if told["flown"]:
            mean = told["hours_flown"]
            found["flown"] = "none arrived" if mean is None else f"{mean:.1f} h"
            found["arrived"] = f"{told['arrived']} of {told['flown']}"
        return found

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        arrived = self.flown[np.isfinite(self.flown)]
        return {
            "name": self.name,
            "goto": self.goto,
            "hours": float(self.hours.mean()),
            "hours_90": np.quantile(self.hours, NINETY).tolist(),
            "gain": float(self.gain.mean()),
            "gain_90": np.quantile(self.gain, NINETY).tolist(),
            "arrives_in": self.arrives,
            "slower_in": float(np.mean(self.gain < 1.0 - SLOWER)),
            "flown": len(self.flown),
            "arrived": len(arrived),
            "hours_flown": float(arrived.mean()) if arrived.size else None,
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class RoutePlan:
    """Straight path and the best other paths; `best` is the recommended path."""

    routes: tuple[Route, ...]
    """Straight path first, then by mean time"""
    best: Route
    speed: float
    """[m/s] through the water, surface intervals included"""
    pitch_deg: float
    start: tuple[float, float]
    """Latitude, longitude [degree]"""
    order: tuple[int, ...]
    """Indices of the vias in the order in which the paths pass them"""

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        return {
            "routes": [one.describe() for one in self.routes],
            "best": self.best.name,
            "speed": self.speed,
            "pitch_deg": self.pitch_deg,
            "order": list(self.order),
        }

    def verdict(self) -> str:
        """Recommended path with its least gain, in words."""
        told = self.best.describe()
        best, none = self.best, ""
        if best.arrives < 1.0 - OFTEN:
            none = (
                f"by the best way {100.0 * best.arrives:.0f} of 100 draws are there "
                f"within the {best.known_hours:.0f} h that the water is known for"
            )
        elif best.missed > OFTEN:
            flights = f"{told['arrived']} of {told['flown']} flights"
            none = f"{flights} by the best way are there within {best.flown_hours:.0f} h"
        if none:
            return f"take none: {none}; it makes {self.speed:.2f} m/s through the water"
        said, sure = "no gain over the straight way is promised", 100.0 * told["gain_90"][0]
        if best.name != "straight" and sure > 0.0:
            said = f"at least {sure:.0f} % faster than the straight way, with 95 of 100 draws"
        return f"take {best.name}: {said}"

    def geojson(self) -> dict[str, Any]:
        """GeoJSON FeatureCollection of the paths."""
        features = []
        for one in self.routes:
            line = [[east, north] for north, east in (self.start, *one.places)]
            said = {"best": one is self.best, **one.describe()}
            features.append(feature("LineString", line, said))
        return collection(features)


def polar(request: Request, aim: Waypoint, pitches: Sequence[float]) -> dict[float, float]:
    """Horizontal speed in still water [m/s] by pitch [degree], from flights of the mission.

    Args:
      aim: the request's segment; its last place is moved beyond the reach of the vehicle.

    Raises:
      MissionError: the vehicle can fly none of the pitches.
    """
    place = request.place
    origin, last = (place.latitude_deg, place.longitude_deg), aim.targets[-1]
    way = np.array(to_tangent_plane(last["latitude"], last["longitude"], *origin), float)
    (far,) = _places(way[None] * max(BEYOND / max(float(np.hypot(*way)), 1.0), 1.0), origin)
    missions = {}
    for pitch in pitches:
        mission = _aimed(request.mission, aim, [far], pitch)
        with contextlib.suppress(MissionError):
            mission.check(request.vehicle)
            missions[pitch] = mission
    if not missions:
        raise MissionError(f"{request.vehicle.name} can dive at none of {list(pitches)} degree")
    short = dataclasses.replace(request, hours=POLAR_HOURS)
    flown = zip(missions, fly_nominal(short, list(missions.values())), strict=True)
    return {pitch: one.rates()[1] for pitch, one in flown if isinstance(one, MemberFlight)}


def _places(metres: Array, origin: tuple[float, float]) -> list[tuple[float, float]]:
    """Latitude, longitude [degree] of places north, east [m] of an origin, (place, 2)."""
    latitude, longitude = from_tangent_plane(metres[:, 0], metres[:, 1], *origin)
    return list(zip(latitude.tolist(), wrap_longitude(longitude).tolist(), strict=True))


def _aimed(
    mission: Mission, aim: Waypoint, places: Sequence[tuple[float, float]], pitch: float
) -> Mission:
    """Mission to some places [degree], at a pitch [degree]."""
    targets = tuple({"latitude": north, "longitude": east} for north, east in places)
    segment = dataclasses.replace(aim, targets=targets, pitch_deg=pitch, climb_pitch_deg=None)
    return dataclasses.replace(mission, segments=(segment,))


def plan_routes(
    request: Request,
    known: Known,
    *,
    vias: Sequence[tuple[float, float]] = (),
    avoided: Sequence[Sequence[tuple[float, float]]] = (),
    pitch_deg: float | None = None,
    fly_them: bool = True,
    say: Callable[[str], object] = lambda _: None,
) -> RoutePlan:
    """Find the fastest paths to the place of a request's mission.

    Args:
      request: start, mission to one place, field and its error; hours are not used.
      vias: latitude, longitude [degree] of places to pass, in any order.
      avoided: polygons of latitude, longitude [degree].
      pitch_deg: pitch of the dives; None: the fastest of `PITCHES`.
      fly_them: True if the twin flies the best three and the straight path.
      say: called with the name of each step.

    Raises:
      InputError: the current is unknown in the region, a place lies in a polygon, too many vias.
      CurrentError: the field ends too early.
    """
    if len(vias) > MOST_VIAS:
        raise InputError(f"--via has {len(vias)} places; at most {MOST_VIAS} can be put in order")
    place = request.place
    origin = place.latitude_deg, place.longitude_deg
    if said := request.notes():
        raise InputError(f"no way to look for: {said[0]}")
    aim = request.mission.segments[0]
    assert isinstance(aim, Waypoint)
    goal = aim.targets[-1]["latitude"], aim.targets[-1]["longitude"]
    points = np.array([(0.0, 0.0), *(to_tangent_plane(*one, *origin) for one in (*vias, goal))])
    rings = [np.array([to_tangent_plane(*one, *origin) for one in ring]) for ring in avoided]
    say("polar")
    speeds = polar(request, aim, PITCHES if pitch_deg is None else (pitch_deg,))
    pitch, speed = max(speeds.items(), key=lambda one: one[1])
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    say("water")
    rng = np.random.default_rng(request.seed)
    wide = dataclasses.replace(request, members=1 + 2 * DRAWS)
    both = route_water(wide, known, points, AT_HAND * length / speed / HOUR, rng)
    water, judge = both.part(slice(1 + DRAWS)), both.part(slice(1 + DRAWS, None))

    def stops_in(order: Sequence[int]) -> Array:
        return points[[0, *(1 + k for k in order), len(points) - 1]]

    order = min(  # of least mean time along straight legs
        itertools.permutations(range(len(vias))),
        key=lambda order: float(way_times(water, stops_in(order), speed).mean()),
    )
    stops = stops_in(order)
    say("search")
    found = best_ways(water, stops, speed, rings, rng)
    if not found:
        raise InputError("no way leads there: the polygons or the current bar all of them")
    timed = timed_ways(judge, stops, found, speed, rings)
    if not timed:
        raise InputError("no way of few corners keeps clear of the polygons: make them coarser")
    straight = way_times(judge, stops, speed)
    names = (["straight"] if timed[0][1] is stops else []) + [f"way {1 + k}" for k in range(BEST)]
    routes = [
        Route(
            name=name,
            places=tuple(_places(way[1:], origin)),
            hours=times / HOUR,
            gain=1.0 - times / straight,
            known_hours=judge.lasts / HOUR,
        )
        for (times, way), name in zip(timed, names, strict=False)
    ]
    if fly_them:
        say("flights")
        longest = LATE * max(float(np.quantile(one.hours, NINETY[1])) for one in routes)
        beyond = (request.flown - request.horizon) / HOUR  # extra time for late members
        longest = max(min(longest, LONGEST_HOURS, judge.lasts / HOUR - beyond), 1.0)
        asked = dataclasses.replace(request, hours=longest)
        missions = [_aimed(asked.mission, aim, one.places, pitch) for one in routes]
        routes = [_flown(*one, asked, known) for one in zip(routes, missions, strict=True)]
    best = routes[chosen(straight, [times for times, _ in timed])]
    return RoutePlan(
        routes=tuple(routes), best=best, speed=speed, pitch_deg=pitch, start=origin, order=order
    )


def _flown(route: Route, mission: Mission, asked: Request, known: Known) -> Route:
    """Fly the members along a route and add their times."""
    members = members_of(dataclasses.replace(asked, mission=mission), known)
    place = asked.place
    last = to_tangent_plane(*route.places[-1], place.latitude_deg, place.longitude_deg)
    found = []
    for flight in itertools.chain.from_iterable(fly(members.scenarios)):
        if isinstance(flight, MemberFlight):
            there = flight.times[np.hypot(*(flight.track - last).T) <= NEAR]
            found.append(there[0] / HOUR if there.size else math.nan)
    return dataclasses.replace(route, flown=np.array(found), flown_hours=asked.hours)


def timed_ways(
    judge: RouteWater, stops: Array, ways: Sequence[Array], speed: float, avoided: Sequence[Array]
) -> list[tuple[Array, Array]]:
    """Times [s], (draw,), and corners, (corner, 2), of the straight path through stops, then of the
    best others by mean time; without forbidden paths."""
    timed = [(way_times(judge, way, speed, avoided), way) for way in (stops, *ways)]
    others = sorted(timed[1:], key=lambda one: float(one[0].mean()))
    return [one for one in (timed[0], *others[:BEST]) if float(one[0].mean()) < BARRED]


def chosen(straight: Array, times: Sequence[Array]) -> int:
    """Index of the recommended path: the least mean time among paths that are seldom slower than
    the straight path, or among all paths if each is often slower.

    Args:
      straight: [s] times of the straight path, allowed or not, (draw,).
      times: [s] times of the paths, each (draw,).
    """
    safe = [k for k, one in enumerate(times) if np.mean(one > SLOWER * straight) <= SELDOM]
    return min(safe or range(len(times)), key=lambda k: float(times[k].mean()))


def route_water(
    request: Request, known: Known, points: Array, hours: float, rng: np.random.Generator
) -> RouteWater:
    """Samples of the water around places.

    Args:
      request: request with the field, the mission's depths, and the number of members.
      known: state by the logs, used if there is no field.
      points: [m] north, east of start, targets and vias, (point, 2). hours: [h] to cover.

    Raises:
      InputError: the current is not known at all, or not at one of the places.
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
        covered = _covered(request.field, hours * HOUR, request)
        low, high = np.maximum(low, covered[0]), np.minimum(high, covered[1])
    outside = (points < low).any(axis=1) | (points > high).any(axis=1)
    if outside.any():
        raise InputError(
            f"the current is not known at place {int(np.argmax(outside))} of the way (0 is the "
            "start): --current ends before it; nothing can be promised there"
        )
    spacing = float((high - low).max()) / (NODES - 1)
    north, east = (np.arange(low[k], high[k] + 0.5 * spacing, spacing) for k in range(2))
    times: Array = STEP * np.arange(math.ceil(hours * HOUR / STEP) + 1, dtype=np.float64)
    if request.field is None:
        duration, dive = times[-1] + INTERVAL, longest_dive(request.mission)
        water = draw_water(known.filter_, duration, request.members, rng, dive)
        course = draw_models(water, known.pool, rng)[0].current
        every = course[:, :: round(STEP / INTERVAL)][:, : len(times), None, None]
        shape = (request.members, len(times), len(north), len(east), 2)
        drawn = np.broadcast_to(every, shape).copy()
    else:
        mean = _mean(request.field, request, times, north, east)
        drawn = erring(mean, request.field_error, request.members, rng, times, north, east)
    return RouteWater(north=north, east=east, current=drawn)


def _covered(field: Current, seconds: float, request: Request) -> tuple[Array, Array]:
    """[m] South-west and north-east corner of the region that the files of a field cover."""
    low, high = np.full(2, -np.inf), np.full(2, np.inf)
    place = request.place
    origin = place.latitude_deg, place.longitude_deg
    for part in getattr(field, "parts", (field,)):
        box = part.load(seconds, place)[0] if isinstance(part, Grid) else None
        if box is None or not np.isfinite(box.latitude).all():
            continue  # a file of one water column covers every place
        south_west, north_east = (
            to_tangent_plane(float(box.latitude[k]), float(box.longitude[k]) + origin[1], *origin)
            for k in (0, -1)
        )
        low, high = np.maximum(low, south_west), np.minimum(high, north_east)
    return low, high


def _mean(field: Current, request: Request, times: Array, north: Array, east: Array) -> Array:
    """[m/s] Mean of a field over the depths of the dives, (time, north, east, 2)."""
    depths = np.linspace(0.0, max(request.deepest, 1.0), LEVELS)
    program = field.compile(float(times[-1]), request.place)
    grid = np.meshgrid(times, north, east, depths, indexing="ij")
    t, n, e, d = (axis.ravel() for axis in grid)
    rest = np.zeros_like(t)
    found = sample_track(program, t, n, e, d, rest, rest, rest)[:, :2]
    return np.asarray(found.reshape(*grid[0].shape, 2).mean(axis=3))
