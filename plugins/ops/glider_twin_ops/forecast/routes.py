"""Routes: the best ways to a place for a vehicle that may be slower than the water.

Candidates are the fastest ways in the mean water and in single draws of it, moved to the least mean
over all draws. Other draws, which found none of them, say how long each takes and choose: a way is
promised only where it is seldom slower than the straight one. The best three and the straight way
are flown by the twin.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.known import Known
from glider_twin_ops.forecast.members import MemberFlight, fly, fly_nominal, members_of
from glider_twin_ops.forecast.request import LEAST_MEMBERS, LONGEST_HOURS, Request
from glider_twin_ops.forecast.route_search import (
    BARRED,
    LOOKS,
    fastest,
    open_edges,
    polished,
    thrown,
    way_times,
)
from glider_twin_ops.forecast.route_water import RouteWater, route_water
from glider_twin_ops.forecast.surfacing_forecast import feature
from twin.errors import InputError, MissionError, SimulationUnstable
from twin.geodesy import from_tangent_plane, to_tangent_plane, wrap_longitude
from twin.mission import Mission
from twin.numbers import Array

PITCHES = (18.0, 22.0, 26.0, 30.0, 35.0)
"""[degree] of the polar"""
BEYOND = 60_000.0
"""[m] to the place that the polar is flown to: farther than a glider goes in its time"""
POLAR_HOURS = 12.0
"""[h] that each of them is flown for"""
DRAWS = 48
"""Of the water beside what is expected, for the search, and as many others to judge by"""
ALONE = 3
"""Single draws whose fastest ways are candidates, too"""
BEST = 3
"""Ways that are flown"""
SLOWER, SELDOM = 1.02, 0.05
"""Times the straight way that counts as slower, and the part of draws in which a way may be so"""
OFTEN = 0.5
"""Part of the draws that do not arrive from which no way is to be taken"""
APART = 2.0
"""Nodes by which two ways must differ to be two"""
MOST_VIAS = 6
AT_HAND = 2.5
"""Times the time of the straight way in still water that the water must be known for"""
NEAR = 2000.0
"""[m] from the last place that counts as there"""
NINETY = (0.05, 0.95)
LATE = 1.2
"""Times the hours within which 95 of 100 draws arrive that the twin flies"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Route:
    """One way."""

    name: str
    places: tuple[tuple[float, float], ...]
    """Latitude, longitude [degree] of corners and last place, the start left out"""
    hours: Array
    """[h] in each draw of the water that judges, (draw,)"""
    gain: Array
    """Part of the straight way's time that it saves, (draw,)"""
    flown: Array = dataclasses.field(default_factory=lambda: np.empty(0))
    """[h] of the members that the twin flew; NaN: did not arrive, (member,)"""
    flown_hours: float = 0.0
    """[h] that these were flown for"""
    known_hours: float = math.inf
    """[h] for which the water is known"""

    @property
    def arrives(self) -> float:
        """Part of the draws that are there while the water is known."""
        return float(np.mean(self.hours <= self.known_hours))

    @property
    def missed(self) -> float:
        """Part of the flights that do not arrive; 0 where they were too short to say."""
        if not len(self.flown) or np.quantile(self.hours, NINETY[1]) > self.flown_hours:
            return 0.0
        return float(np.mean(~np.isfinite(self.flown)))

    @property
    def goto(self) -> str:
        """As `twin forecast --goto` takes it."""
        return ";".join(f"{latitude:.4f},{longitude:.4f}" for latitude, longitude in self.places)

    def row(self) -> dict[str, object]:
        """Of a table."""
        told = self.describe()
        low, high = told["hours_90"]
        gain = "" if self.name == "straight" else (
            f"{100 * told['gain']:.0f} % ({100 * told['gain_90'][0]:.0f} to "
            f"{100 * told['gain_90'][1]:.0f})"
        )  # fmt: skip
        found: dict[str, object] = {
            "way": self.name,
            "hours": f"{told['hours']:.1f} ({low:.1f} to {high:.1f})"
            if self.arrives > 0.0
            else f"over {self.known_hours:.0f}",
            "gain": gain,
            "slower in": f"{100 * told['slower_in']:.0f} %",
            "arrives in": f"{100 * told['arrives_in']:.0f} %",
        }
        if told["flown"]:
            hours = told["hours_flown"]
            found["flown"] = "none arrived" if hours is None else f"{hours:.1f} h"
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
    """The straight way and the best others; `best` is the one to take."""

    routes: tuple[Route, ...]
    """The straight one first, then by mean time"""
    best: Route
    speed: float
    """[m/s] through the water, stays at the surface included"""
    pitch_deg: float
    start: tuple[float, float]
    """Latitude, longitude [degree]"""
    order: tuple[int, ...]
    """Vias as they were given, in the order of the ways"""

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
        """Which way to take, and what is promised of it."""
        told = self.best.describe()
        best, makes = self.best, f"it makes {self.speed:.2f} m/s through the water"
        if best.arrives < 1.0 - OFTEN:
            return (
                f"take none: by the best way {100.0 * best.arrives:.0f} of 100 draws are there "
                f"within the {best.known_hours:.0f} h that the water is known for; {makes}"
            )
        if best.missed > OFTEN:
            return (
                f"take none: {told['arrived']} of {told['flown']} flights by the best way are "
                f"there within {best.flown_hours:.0f} h; {makes}"
            )
        low = told["gain_90"][0]
        said = "no gain over the straight way is promised"
        if self.best.name != "straight" and low > 0.0:
            said = (
                f"at least {100.0 * low:.0f} % faster than the straight way, with 95 of 100 draws"
            )
        return f"take {self.best.name}: {said}"

    def geojson(self) -> dict[str, Any]:
        """A FeatureCollection of lines."""
        features = [
            feature(
                "LineString",
                [[east, north] for north, east in (self.start, *one.places)],
                {"best": one is self.best, **one.describe()},
            )
            for one in self.routes
        ]
        return {"type": "FeatureCollection", "features": features}


def polar(request: Request, pitches: Sequence[float] = PITCHES) -> dict[float, float]:
    """Speed over ground in still water [m/s] by pitch [degree], as the twin flies the mission.

    Raises:
      MissionError: the vehicle can fly none of the pitches.
    """
    missions = {}
    far = _beyond(request)
    for pitch in pitches:
        mission = _pitched(far, pitch)
        try:
            mission.check(request.vehicle)
            missions[pitch] = mission
        except MissionError:
            continue
    if not missions:
        raise MissionError(f"{request.vehicle.name} can dive at none of {list(pitches)} degree")
    short = dataclasses.replace(request, hours=POLAR_HOURS)
    flown = fly_nominal(short, list(missions.values()))
    return {
        pitch: flight.rates()[1]
        for pitch, flight in zip(missions, flown, strict=True)
        if isinstance(flight, MemberFlight)
    }


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
    """The best ways to the place of a request's mission.

    Args:
      request: start, mission to one place, field and its error; hours are not used.
      vias: latitude, longitude [degree] of places to pass, in any order.
      avoided: polygons of latitude, longitude [degree].
      pitch_deg: of the dives; None: the fastest one.
      fly_them: whether the twin flies the best three.
      say: called with a word on what is being done.

    Raises:
      InputError: the current is not known there, a place lies in a polygon, too many vias.
      CurrentError: the field does not last.
    """
    if len(vias) > MOST_VIAS:
        raise InputError(f"--via has {len(vias)} places; at most {MOST_VIAS} can be put in order")
    place = request.place
    origin = place.latitude_deg, place.longitude_deg
    if said := request.notes():
        raise InputError(f"no way to look for: {said[0]}")
    target = request.mission.segments[0].targets[-1]  # type: ignore[attr-defined]
    goal = target["latitude"], target["longitude"]
    points = np.array([(0.0, 0.0), *(to_tangent_plane(*one, *origin) for one in (*vias, goal))])
    rings = [np.array([to_tangent_plane(*one, *origin) for one in ring]) for ring in avoided]
    say("polar")
    speeds = polar(request, PITCHES if pitch_deg is None else (pitch_deg,))
    pitch, speed = max(speeds.items(), key=lambda one: one[1])
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    hours = AT_HAND * length / speed / 3600.0
    say("water")
    rng = np.random.default_rng(request.seed)
    wide = dataclasses.replace(request, members=1 + 2 * DRAWS)
    both = route_water(wide, known, points, hours, rng)
    water, judge = both.part(slice(1 + DRAWS)), both.part(slice(1 + DRAWS, None))
    order = _order(water, points, speed)
    stops = points[[0, *(1 + k for k in order), len(points) - 1]]
    say("search")
    found = best_ways(water, stops, speed, rings, rng)
    if not found:
        raise InputError("no way leads there: the polygons or the current bar all of them")
    timed = timed_ways(judge, stops, found, speed, rings)
    if not timed:
        raise InputError("no way of few corners keeps clear of the polygons: make them coarser")
    straight = way_times(judge, stops, speed)
    routes: list[Route] = []
    names = (["straight"] if timed[0][1] is stops else []) + [f"way {1 + k}" for k in range(BEST)]
    for (times, way), name in zip(timed, names, strict=False):
        latitude, longitude = from_tangent_plane(way[1:, 0], way[1:, 1], *origin)
        east = wrap_longitude(longitude)
        routes.append(
            Route(
                name=name,
                places=tuple(zip(latitude.tolist(), east.tolist(), strict=True)),
                hours=times / 3600.0,
                gain=1.0 - times / straight,
                known_hours=judge.lasts / 3600.0,
            )
        )
    steeper = dataclasses.replace(request, mission=_pitched(request.mission, pitch))
    if fly_them:
        say("flights")
        longest = LATE * max(float(np.quantile(one.hours, NINETY[1])) for one in routes)
        beyond = (steeper.flown - steeper.horizon) / 3600.0  # members fly on for so long
        longest = max(min(longest, LONGEST_HOURS, judge.lasts / 3600.0 - beyond), 1.0)
        routes = [_flown(one, steeper, known, longest) for one in routes]
    best = routes[chosen(straight, [times for times, _ in timed])]
    return RoutePlan(
        routes=tuple(routes), best=best, speed=speed, pitch_deg=pitch, start=origin, order=order
    )


def _order(water: RouteWater, points: Array, speed: float) -> tuple[int, ...]:
    """Vias in the order whose straight legs take least in the mean of all draws."""
    inner = range(1, len(points) - 1)

    def cost(order: Sequence[int]) -> float:
        return float(way_times(water, points[[0, *order, len(points) - 1]], speed).mean())

    return tuple(k - 1 for k in min(itertools.permutations(inner), key=cost))


def timed_ways(
    judge: RouteWater, stops: Array, ways: Sequence[Array], speed: float, avoided: Sequence[Array]
) -> list[tuple[Array, Array]]:
    """Times [s], (draw,), and corners, (corner, 2), of the straight way through stops and then of
    the best others, by mean time; those that must not be taken are left out."""
    timed = [(way_times(judge, way, speed, avoided), way) for way in (stops, *ways)]
    first, *others = [(times, way, float(times.mean())) for times, way in timed]
    others.sort(key=lambda one: one[2])
    return [(times, way) for times, way, mean in (first, *others[:BEST]) if mean < BARRED]


def chosen(straight: Array, times: Sequence[Array]) -> int:
    """Which way to take: the fastest in the mean of those that are seldom slower than the straight
    one, or of all where each is often slower.

    Args:
      straight: [s] of the straight way, whether or not it may be taken, (draw,).
      times: [s] of the ways, each (draw,).
    """
    safe = [k for k, one in enumerate(times) if np.mean(one > SLOWER * straight) <= SELDOM]
    return min(safe or range(len(times)), key=lambda k: float(times[k].mean()))


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
            return float(way_times(water, way, speed, rings, begin).mean())

        legs = [
            polished(water, leg, speed, rings, begin) if mean(leg) < BARRED else leg for leg in legs
        ]
        leg = min(legs, key=mean)
        begin += float(np.median(way_times(water, leg, speed, (), begin)))
        whole = np.concatenate([whole, leg[1:]])
    return whole


def _differs(one: Array, other: Array, spacing: float) -> bool:
    """Whether two ways are apart somewhere, by their points at equal parts of their lengths."""

    def even(way: Array) -> Array:
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
        at = np.linspace(0.0, along[-1], 50)
        return np.stack([np.interp(at, along, way[:, k]) for k in range(2)], axis=1)

    return float(np.hypot(*(even(one) - even(other)).T).max()) > APART * spacing


def _beyond(request: Request) -> Mission:
    """The mission with its last place so far away that nothing arrives while the polar is flown."""
    place, segment = request.place, request.mission.segments[0]
    last = segment.targets[-1]  # type: ignore[attr-defined]
    there = to_tangent_plane(
        last["latitude"], last["longitude"], place.latitude_deg, place.longitude_deg
    )
    way = np.array([float(metres) for metres in there])
    north, east = way * max(BEYOND / max(float(np.hypot(*way)), 1.0), 1.0)
    latitude, longitude = from_tangent_plane(
        np.array([north]), np.array([east]), place.latitude_deg, place.longitude_deg
    )
    target = {"latitude": float(latitude[0]), "longitude": float(wrap_longitude(longitude)[0])}
    far = dataclasses.replace(segment, targets=(target,))  # type: ignore[call-arg]
    return dataclasses.replace(request.mission, segments=(far,))


def _pitched(mission: Mission, pitch: float) -> Mission:
    segments = tuple(
        dataclasses.replace(one, pitch_deg=pitch, climb_pitch_deg=None)  # type: ignore[call-arg]
        for one in mission.segments
    )
    return dataclasses.replace(mission, segments=segments)


def _flown(route: Route, request: Request, known: Known, hours: float) -> Route:
    """With the times of the members that the twin flies along it."""
    targets = tuple({"latitude": north, "longitude": east} for north, east in route.places)
    segment = dataclasses.replace(request.mission.segments[0], targets=targets)  # type: ignore[call-arg]
    mission = dataclasses.replace(request.mission, segments=(segment,))
    asked = dataclasses.replace(
        request,
        mission=mission,
        hours=hours,
        members=max(request.members, LEAST_MEMBERS),
    )
    north, east = to_tangent_plane(
        *route.places[-1], request.place.latitude_deg, request.place.longitude_deg
    )
    found = []
    for chunk in fly(members_of(asked, known).scenarios):
        for flight in chunk:
            if isinstance(flight, SimulationUnstable):
                continue
            away = np.hypot(flight.track[:, 0] - north, flight.track[:, 1] - east)
            there = np.flatnonzero(away <= NEAR)
            found.append(flight.times[there[0]] / 3600.0 if there.size else math.nan)
    return dataclasses.replace(route, flown=np.array(found), flown_hours=hours)
