"""Member flights: members flown side by side on all cores, each as its track and its surfacings.

Surfacings tell where, when and at which cost members come up for the n-th time, with ellipses.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
import os
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.request import Request
from twin import Mission, Origin, Scenario, Trajectory, scenario_of
from twin.checks import state_at
from twin.errors import InaccurateStep, SimulationUnstable
from twin.fossen import LANES
from twin.geodesy import from_tangent_plane, wrap_longitude
from twin.mission import SURFACED_MARGIN_M
from twin.navigation import Ellipse, chi_squared, outline
from twin.numbers import Array
from twin.physics import Fleet, file_timestep, fly_in_lanes, quiet_mujoco, stiffness_of
from twin.vehicle import ENERGY

SAMPLE_PERIOD = 10.0
"""[s] between two samples of a member: a surfacing is known to 3 m at 0.3 m/s"""
STEPS, SETTLED = 2.0, 0.75
"""Times the vehicle file's physics step, which is explicit in what is not rotary damping: in six
hours the end moves by less than 5 m, in lanes by about 1 m (`python -m benchmarks.forecast_speed`).
Where such a step times the vehicle's fastest rate is above `SETTLED` the file's own is flown:
members differ by a fifth, and at 1 they would be unstable"""
PER_CORE = {"mujoco": 12, "lanes": 4 * LANES[0]}
"""Members for each core between two looks: enough to keep it busy, few enough to show progress"""
UNDER = 3.0
"""Times the depth that counts as surfaced, beyond which the vehicle has dived"""
FLOATS = 300.0
"""[s] beyond a mission's own stay at the surface, after which it is over"""
THINNED = 30
"""Samples of a track for one point that is kept"""
HALF, NINETY = 0.5, 0.9
"""Parts that ellipses hold of the surfacings to expect"""
FIX_DEVIATION = 5.0
"""[m] north and east each, of the GPS fix that will be taken"""
TAILS = np.array([0.05, 0.95])
"""Parts of the members that are up before the two bounds of a time"""
LEAST = 0.99
"""Part of the members that must have a surfacing for it to be told: without the late ones, place,
time and ellipse would be those of the early ones"""
ELLIPSE_POINTS = 64
KILO = 1e3


@dataclasses.dataclass(frozen=True, kw_only=True)
class MemberFlight:
    """One member."""

    time: Array
    """[s] since the start of each surfacing, (surfacing,)"""
    place: Array
    """North, east [m] there, (surfacing, 2)"""
    energy: Array
    """[J] taken until then, (surfacing,)"""
    track: Array
    """North, east [m], thinned, (point, 2)"""
    times: Array
    """[s] since the start of its points, (point,)"""
    duration: float
    """[s] of the flight"""
    taken: float
    """[J] in all"""
    end: Array
    """North, east, depth [m] and velocity over ground, NED [m/s], at its end, (6,)"""
    over: bool = False
    """Whether its mission was over with its last surfacing: it floats from then on"""

    def delayed(self, stays: Array, late: float, drift: Array) -> MemberFlight:
        """Add stays at the surface [s] before its dives, in which it drifts [m/s], and let dives
        last longer by a part, along their own way; energy is as flown."""
        longer = late * np.append(0.0, self.time)
        farther = late * np.vstack([np.zeros((1, 2)), self.place.reshape(-1, 2)])
        stayed = np.cumsum(stays)
        ended = np.searchsorted(self.time, self.times)  # dives, before a point of the track
        surfaced = np.arange(len(self.time))
        track = self.track + stayed[ended, None] * drift + farther[ended]
        return dataclasses.replace(
            self,
            time=self.time + stayed[surfaced] + longer[1:],
            place=self.place + stayed[surfaced, None] * drift + farther[1:],
            times=np.append(0.0, self.times + stayed[ended] + longer[ended]),
            track=np.vstack([self.track[:1], track]),
        )

    def not_before(self, earliest: float) -> MemberFlight:
        """Let its first surfacing be no earlier than a time [s]: its first dive lasts so much
        longer, along its own way; energy is as flown."""
        if not len(self.time) or self.time[0] >= earliest:
            return self
        first = float(self.time[0])
        later = earliest - first
        farther = later / first * self.place[0]
        dived = np.clip(self.times / first, 0.0, 1.0)  # how much of the first dive is over
        return dataclasses.replace(
            self,
            time=self.time + later,
            place=self.place + farther,
            times=self.times + dived * later,
            track=self.track + dived[: len(self.track), None] * farther,
        )

    def rates(self) -> tuple[float, float]:
        """[W] and [m/s] over ground until its last surfacing; of the whole flight without one."""
        end, energy = self.duration, self.taken
        if len(self.time):
            end, energy = float(self.time[-1]), float(self.energy[-1])
        before = self.track[self.times <= end]
        return energy / end, float(np.hypot(*np.diff(before, axis=0).T).sum()) / end


def fly(
    scenarios: Sequence[Scenario], *, threads: int = 0
) -> Iterator[list[MemberFlight | SimulationUnstable]]:
    """Fly the first member, then the others in fleets; yields what each fleet found.

    In lanes the first ones fly together, which takes no longer, and are told one after the other.

    Args:
      threads: of a fleet; 0 takes every core.
    """
    cores = threads or os.cpu_count() or 1
    engine = scenarios[0].engine
    first = LANES[0] if engine == "lanes" else 1
    rest = max(len(scenarios) - first, 0)
    fleets = math.ceil(rest / (PER_CORE[engine] * cores))
    ends = [0, *(first + rest * k // fleets for k in range(fleets)), len(scenarios)]
    for a, b in itertools.pairwise(ends):
        found = _flown(scenarios[a:b], threads)
        for some in (found[:1], found[1:]) if a == 0 else (found,):  # the mean of all at once
            if some:
                yield some


@contextlib.contextmanager
def coarse_steps() -> Iterator[None]:
    """Let steps be inaccurate: a millimetre per second is little beside an unknown current.

    Filters of warnings belong to the process: who flies in several threads enters it before the
    first of them starts and leaves it after the last has ended.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InaccurateStep)
        yield


def _flown(scenarios: Sequence[Scenario], threads: int) -> list[MemberFlight | SimulationUnstable]:
    """One fleet."""
    results: list[Trajectory | SimulationUnstable]
    with quiet_mujoco(), coarse_steps():
        if scenarios[0].engine == "lanes":
            results = fly_in_lanes(scenarios, threads=threads, lean=True)
        else:
            results = Fleet(scenarios, threads=threads).run()
    return [
        result if isinstance(result, SimulationUnstable) else told(result, scenario)
        for result, scenario in zip(results, scenarios, strict=True)
    ]


def fly_nominal(
    request: Request, missions: Sequence[Mission]
) -> list[MemberFlight | SimulationUnstable]:
    """Fly missions by the request's vehicle in still water, from its start."""
    still = [dataclasses.replace(request, mission=mission, field=None) for mission in missions]
    longest = max(one.flown for one in still)
    scenarios = [nominal_scenario(one, one.mission) for one in still]
    return _flown([dataclasses.replace(one, duration=longest) for one in scenarios], threads=0)


def nominal_scenario(request: Request, mission: Mission) -> Scenario:
    """Flight of a mission as long as members fly, in the request's field."""
    flown = dataclasses.replace(mission, duration_s=request.flown)
    place = request.place
    targets = getattr(
        flown.placed(place.latitude_deg, place.longitude_deg).segments[0], "targets", None
    )
    heading = math.radians(mission.start_heading_deg)
    if targets:  # toward the first, so that no turn at the start takes time
        heading = math.atan2(targets[0]["east_m"], targets[0]["north_m"]) % (2.0 * math.pi)
    own, stiff = file_timestep(request.vehicle), stiffness_of(request.vehicle)
    rough = stiff is None or STEPS * own * stiff.rest <= SETTLED
    return scenario_of(
        vehicle=request.vehicle,
        mission=flown,
        duration=request.flown,
        start={
            "latitude": place.latitude_deg,
            "longitude": place.longitude_deg,
            "time": place.time,
            "heading": heading,
        },
        current=request.field,
        engine=request.engine,
        timestep=STEPS * own if rough else own,
        sample_period=SAMPLE_PERIOD,
        density=request.density,
    )


def told(run: Trajectory, scenario: Scenario) -> MemberFlight:
    """Surfacings of a run."""
    depth, afloat = run["true_depth"], 0.5 * scenario.vehicle.hull_length + SURFACED_MARGIN_M
    found = surfacings(depth, afloat)
    stays = [getattr(one, "stay_s", 0.0) for one in getattr(scenario.mission, "segments", ())]
    last = int(found[-1]) if len(found) else len(depth) - 1
    floats = run.time[-1] - run.time[last] > max(stays, default=0.0) + FLOATS
    energy = np.sum([run[name] for name in run if name.startswith(ENERGY)], axis=0)
    return MemberFlight(
        time=run.time[found],
        place=run.position[found, :2],
        energy=energy[found],
        track=run.position[::THINNED, :2],
        times=run.time[::THINNED],
        duration=float(run.time[-1]),
        taken=float(energy[-1]),
        end=state_at(run, -1),
        over=bool(floats and depth[last:].max() <= UNDER * afloat),
    )


def surfacings(depth: Array, afloat: float) -> NDArray[np.int64]:
    """Indices of the samples at which a vehicle has come up from a dive.

    Args:
      depth: [m], (time,). afloat: [m] above which it counts as surfaced.
    """
    known = np.flatnonzero((depth > UNDER * afloat) | (depth <= afloat))
    up = depth[known] <= afloat
    return known[up & ~np.append(True, up)[:-1]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Surfacing:
    """One surfacing; times are after the start."""

    number: int
    """1 is the next"""
    part: float
    """of the members that have it"""
    north: float
    """[m] from the start, as east is"""
    east: float
    covariance: Array
    """[m2], (2, 2); of members and fix"""
    latitude: float
    """[degree], as the longitude is"""
    longitude: float
    time_s: float
    """mean"""
    early_s: float
    """5 of 100 members are up before"""
    late_s: float
    """5 of 100 members are up later"""
    bound_s: float
    """deviation of these two by the draw of the members: another seed tells them so far off"""
    energy_kj: float
    """mean, taken since the start"""
    energy_deviation_kj: float
    members: Array
    """North, east [m] of every member that has it, (member, 2)"""

    def ellipse(self, holds: float) -> Ellipse:
        """Ellipse that holds a part of the surfacings to expect, such as 0.9.

        Of few members it is wider: their mean and covariance are known by them alone.
        """
        return Ellipse.of(self._shape(holds))

    def _shape(self, holds: float) -> Array:
        """[m2], (2, 2): squared semi-axes, from north and east."""
        fix = FIX_DEVIATION**2 * np.eye(2)
        drawn = prediction_quantile(holds, len(self.members))
        return drawn * (self.covariance - fix) + chi_squared(holds) * fix

    def ring(self, holds: float, place: Origin) -> Array:
        """Longitude, latitude [degree] around it, closed, counterclockwise, (point, 2)."""
        around = outline(self._shape(holds), ELLIPSE_POINTS + 1)
        return degrees(np.array([self.north, self.east]) + around, place)

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        same = ("number", "latitude", "longitude", "time_s", "early_s", "late_s", "bound_s")
        return {name: getattr(self, name) for name in same} | {
            "part_of_members": self.part,
            "ellipse_50": dataclasses.asdict(self.ellipse(HALF)),
            "ellipse_90": dataclasses.asdict(self.ellipse(NINETY)),
            "energy_kJ": self.energy_kj,
            "energy_deviation_kJ": self.energy_deviation_kj,
        }


def prediction_quantile(holds: float, count: int) -> float:
    """Squared deviations, in those of `count` draws, within which a further draw falls in a plane.

    (n^2 - 1) p / (n (n - p)) of the quantile of F(p, n - p), p = 2 (Hotelling 1931, Ann. Math.
    Stat. 2); chi-squared's for many draws. Fewer than three tell no more than three do.
    """
    n = max(count, 3)
    return (n * n - 1.0) / n * ((1.0 - holds) ** (-2.0 / (n - 2)) - 1.0)


def surfacings_of(
    flights: Sequence[MemberFlight], place: Origin, within: float = math.inf
) -> tuple[Surfacing, ...]:
    """The surfacings whose median time is within a horizon, in order, while all members have them.

    Args:
      flights: of the members so far, flown beyond the horizon; of a single one the ellipses are
        those of its fix.
      place: of the start. within: [s] the horizon.
    """
    found = []
    for index in range(max((len(one.time) for one in flights), default=0)):
        having = [one for one in flights if len(one.time) > index]
        if not _due(flights, index, within) or len(having) < LEAST * len(flights):
            break
        places = np.array([one.place[index] for one in having])
        times = np.array([one.time[index] for one in having])
        energy = np.array([one.energy[index] for one in having]) / KILO
        centre = places.mean(axis=0)
        spread = FIX_DEVIATION**2 * np.eye(2)
        if len(having) > 1:
            spread = spread + np.cov(places, rowvar=False)
        longitude, latitude = degrees(centre[None], place)[0].tolist()
        early, late = np.quantile(times, TAILS).tolist()
        # how many of n members are before a bound is binomial: half of the distance between the
        # ranks one deviation before and behind it (David and Nagaraja 2003, Order Statistics, 7.1)
        off = np.sqrt(TAILS * (1.0 - TAILS) / len(times))
        below, above = (np.quantile(times, np.clip(TAILS + s * off, 0.0, 1.0)) for s in (-1, 1))
        north, east = centre.tolist()
        found.append(
            Surfacing(
                number=index + 1,
                part=len(having) / len(flights),
                north=north,
                east=east,
                covariance=spread,
                latitude=latitude,
                longitude=float(wrap_longitude(np.array(longitude))),
                time_s=float(times.mean()),
                early_s=early,
                late_s=late,
                bound_s=0.5 * float((above - below).mean()),
                energy_kj=float(energy.mean()),
                energy_deviation_kj=float(energy.std()),
                members=places,
            )
        )
    return tuple(found)


def left_out(flights: Sequence[MemberFlight], told: int, within: float) -> str:
    """Why the surfacing after those told is not told; empty where none is due."""
    if not _due(flights, told, within):
        return ""
    part = sum(len(one.time) > told for one in flights) / len(flights)
    return (
        f"surfacing {told + 1} is left out: only {100.0 * part:.0f} % of the members have it, the "
        "others end at their last target or are late; their mean would be that of the early ones"
    )


def over(flights: Sequence[MemberFlight], within: float) -> float | None:
    """[s] at which the mission is over in the median, where half of the members end it by a time
    [s] that a forecast reaches to; else None."""
    ends = [float(one.time[-1]) for one in flights if one.over and one.time[-1] < within]
    return float(np.median(ends)) if 2 * len(ends) >= max(len(flights), 1) else None


def _due(flights: Sequence[MemberFlight], index: int, within: float) -> bool:
    """Whether half of the members have a surfacing within a time [s]."""
    early = sum(len(one.time) > index and one.time[index] <= within for one in flights)
    return 2 * early >= max(len(flights), 1)


def degrees(points: Array, place: Origin) -> Array:
    """Longitude, latitude [degree] of north, east [m] from a place, (point, 2).

    Longitudes go on across the date line.
    """
    latitude, longitude = from_tangent_plane(
        points[:, 0], points[:, 1], place.latitude_deg, place.longitude_deg
    )
    return np.stack([longitude, latitude], axis=1)
