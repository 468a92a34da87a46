"""Walk: each surfacing of a deployment forecast from what was known before its dive.

At the fix before a dive are known: all dives so far with their currents, the waypoints of the dive
(those that its log commands, in their order: what a pilot has loaded; how far along them it will
come is not known), the current that the vehicle reckons with, and where there is one the forecast
field. Two things are forecast.

- The surfacing: the duration that the schedule expects, times the way through the water and
  the current that their pools expect. Rivals go at the speed of the last three dives toward the
  first waypoint, for the median duration of the last three, each with a current of its own.
- The current: the way through the water and the duration are given, the same for every method.

Nothing is frozen: pools, filter and ellipses learn at every fix.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from glider_twin_ops.forecast import surfacing_schedule, way_pool
from glider_twin_ops.forecast.current_models import PRIORS, CurrentPool, TidalFit
from glider_twin_ops.forecast.logged_leg import DiveTime, LoggedLeg, place_at, usual_duration
from glider_twin_ops.forecast.pool import Mixture, Prior
from glider_twin_ops.forecast.surfacing_schedule import Rhythm, SurfacingSchedule, middle
from glider_twin_ops.forecast.way_pool import WayPool, plain_velocity
from twin.navigation import chi_squared
from twin.navigation.current import Leg, Reaches
from twin.numbers import Array

Pair = tuple[float, float]
FieldMean = Callable[[LoggedLeg, LoggedLeg, Array, float], Pair]
"""North, east [m/s] that a field foretells, mean over a dive: by the leg for its begin, a leg for
its depths, the way through the water [m] and the duration [s]"""

MembersFlown = Callable[
    [Sequence[LoggedLeg], LoggedLeg, CurrentPool, WayPool, float, Pair],
    tuple[Array, Array] | None,
]
"""Mean [m] and covariance [m2] of where members come up (`MemberFlights.expect`)"""

HOUR = 3600.0
"""[s]"""
CHI_SQUARED = chi_squared(0.5), chi_squared(0.9)
RIVAL_DAYS = 5.0
"""[d] of the rival that fits mean and tide"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Priors:
    """What is believed before the first dive; the shipped values hold over deployments."""

    current: Mapping[str, Prior] = dataclasses.field(default_factory=lambda: PRIORS)
    way: Mapping[str, Prior] = dataclasses.field(default_factory=lambda: way_pool.PRIORS)
    schedule: Mapping[str, Prior] = dataclasses.field(
        default_factory=lambda: surfacing_schedule.PRIORS
    )
    surfacing_reach: Pair = (0.81, 4.8)
    """[1] squared distances within which the two ellipses of a surfacing lie"""
    current_reach: Pair = (0.69, 3.1)
    """[1] of a current"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Judged:
    """A forecast beside what was found, and its rivals."""

    hours: float
    """[h] that the dive lasted"""
    missed: dict[str, Pair]
    """North, east [m] by method: the fix less where each had it"""
    covariance: Array
    """[m2] of the forecast, (2, 2)"""
    reach: Pair
    """[1] squared distances within which the ellipses of 50 and 90 % lie"""

    def error(self, method: str) -> float:
        """[m/h] distance by which a method missed, by the time; NaN where it said nothing."""
        if method not in self.missed:
            return float("nan")
        return float(np.hypot(*self.missed[method])) / self.hours

    @property
    def distance(self) -> float:
        """[1] squared Mahalanobis distance of the fix from the forecast."""
        missed = np.array(self.missed["forecast"])
        return float(missed @ np.linalg.solve(self.covariance, missed))

    @property
    def held(self) -> tuple[bool, bool]:
        """Whether the ellipses of 50 and 90 % held the fix."""
        return self.distance <= self.reach[0], self.distance <= self.reach[1]


@dataclasses.dataclass(frozen=True, kw_only=True)
class HindcastSurfacing:
    """One surfacing, forecast and found."""

    mission: int
    """Row in the store."""
    time: float
    """[s] unix"""
    method: str
    """How its way through the water was found"""
    scored: bool
    """False in the part that only teaches"""
    places: dict[str, Pair]
    """Latitude, longitude [degree]: `begin`, `fix`, and where each method has the surfacing"""
    expected_hours: float
    """[h] that the dive was to last"""
    surfacing: Judged
    current: Judged
    found: Pair
    """North, east [m/s] of the current, mean over the dive"""
    expected: Pair
    """The same as it was forecast"""
    members: Judged | None = None
    """Where it surfaced, the forecast by members flown; None where none were"""

    @property
    def hours(self) -> float:
        """[h] since the fix before"""
        return self.surfacing.hours


@dataclasses.dataclass(frozen=True, kw_only=True)
class Walked:
    """A deployment walked through."""

    surfacings: tuple[HindcastSurfacing, ...]
    """One for each leg but the first"""
    weights: dict[str, dict[str, float]]
    """[1] mean part of each model in explaining the dives, by pool: current, way, schedule"""
    scales: dict[str, dict[str, float]]
    """of each model's errors at the end, in the pool's own unit"""
    pool: CurrentPool
    """Of the current, after the last dive"""
    ways: WayPool
    """After the last dive"""
    rhythm: Rhythm | None
    """Stays at the surface and durations; None where the dives are too few"""
    reach: Pair
    """[1] squared distances within which the two ellipses of the next surfacing lie"""
    singles: dict[str, float]
    """[m/h] mean error of each model of the current alone, over the scored dives"""


def walk(
    legs: Sequence[LoggedLeg],
    *,
    latitude: float,
    dives: Sequence[DiveTime] = (),
    train: int = 0,
    priors: Priors | None = None,
    field: FieldMean | None = None,
    flown: MembersFlown | None = None,
) -> Walked:
    """Forecast every leg's end.

    Args:
      legs: of one deployment, in order of time.
      latitude: [degree] of the deployment.
      dives: all that are known, those without a known way, too, in order of time; by default the
        legs'.
      train: legs at the beginning that are not scored.
      priors: what is believed before the first.
      field: what a forecast field foretells of each leg.
      flown: flies members of each scored leg too.
    """
    priors = priors or Priors()
    begin = legs[0].leg.start if legs else 0.0
    pool = CurrentPool(
        latitude=latitude, time=begin, field=field is not None, priors=priors.current
    )
    ways, ends, tide = WayPool(priors.way), SurfacingSchedule(priors.schedule), TidalFit(RIVAL_DAYS)
    reaches = Reaches(priors.surfacing_reach), Reaches(priors.current_reach)
    times = list(dives) or [_time_of(one) for one in legs]
    parts: dict[str, list[Array]] = {"current": [], "way": [], "schedule": []}
    alone: list[Array] = []
    found: list[HindcastSurfacing] = []
    for k, one in enumerate(legs):
        leg = one.leg
        while times and times[0].end <= leg.start + 1.0:
            _keep(parts["schedule"], ends.learn(times.pop(0)))
        if field is not None:
            told = field(one, one, np.array(leg.through_water), leg.duration)
            leg = dataclasses.replace(leg, field=told)
        if k:
            lasts = ends.expect(leg.start)
            judged = _judge(legs[:k], one, leg, (pool, ways, tide), lasts, reaches, field)
            members = None
            if flown is not None and k >= train:
                members = _by_members(flown, legs[:k], one, judged.surfacing, (pool, ways), lasts)
            found.append(dataclasses.replace(judged, scored=k >= train, members=members))
            for reach, each in zip(reaches, (judged.surfacing, judged.current), strict=True):
                reach.learn(each.distance)
            if k >= train:
                off = [model.expect(leg)[0] - leg.current for model in pool.models.values()]
                alone.append(HOUR * np.hypot(*np.array(off).T))
        _keep(parts["current"], pool.learn(leg))
        _keep(parts["way"], ways.learn(one))
        tide.learn(leg)
    pools = {"current": pool.pool, "way": ways.pool, "schedule": ends.pool}
    errors = np.mean(alone, axis=0) if alone else np.full(len(pool.models), np.nan)
    return Walked(
        surfacings=tuple(found),
        weights={
            name: dict(zip(one.names, np.mean(parts[name], axis=0).tolist(), strict=True))
            for name, one in pools.items()
            if parts[name]
        },
        scales={name: one.scales for name, one in pools.items()},
        pool=pool,
        ways=ways,
        rhythm=_rhythm(ends, times, dives),
        reach=reaches[0].now,
        singles=dict(zip(pool.models, errors.tolist(), strict=True)),
    )


def _time_of(one: LoggedLeg) -> DiveTime:
    return DiveTime(one.leg.start, one.leg.end, math.nan)


def _rhythm(
    ends: SurfacingSchedule, left: Sequence[DiveTime], dives: Sequence[DiveTime]
) -> Rhythm | None:
    """After all dives, of which those that are left have not been learned."""
    schedule = copy.deepcopy(ends)
    for dive in left:
        schedule.learn(dive)
    return Rhythm.of(schedule, dives)


def _keep(parts: list[Array], part: Array | None) -> None:
    if part is not None:
        parts.append(part)


def _judge(
    before: Sequence[LoggedLeg],
    one: LoggedLeg,
    leg: Leg,
    known: tuple[CurrentPool, WayPool, TidalFit],
    lasts: Mixture,
    reaches: tuple[Reaches, Reaches],
    field: FieldMean | None,
) -> HindcastSurfacing:
    """One surfacing, forecast by what the dives before have taught."""
    pool, ways, tide = known
    duration = middle(lasts)
    through = ways.expect(one, duration)
    ahead = _leg_ahead(leg, duration, duration * through.mean)
    if field is not None:
        told = field(one, before[-1], duration * through.mean, duration)
        ahead = dataclasses.replace(ahead, field=told)
    carried = pool.expect(ahead)
    ground = through.mean + carried.mean
    ended = np.array(leg.over_ground)
    usual = usual_duration([_time_of(each) for each in before])
    plain = plain_velocity(before, one.targets)
    last = before[-1].leg.current
    fitted = tide.expect(_leg_ahead(leg, usual, usual * plain))[0]
    reached = {
        "forecast": duration * ground,
        "persistence": usual * (plain + last),
        "tide": usual * (plain + fitted),
        "no_current": usual * plain,
    }
    if one.onboard is not None:
        reached["onboard"] = usual * (plain + np.array(ways.steered(one)))
    given = np.array(leg.through_water)
    mixed = pool.expect(leg)
    drifted = {
        "forecast": mixed.mean,
        "persistence": last,
        "tide": tide.expect(leg)[0],
        "no_current": np.zeros(2),
    }
    missed = {name: ended - given - leg.duration * each for name, each in drifted.items()}
    if one.onboard is not None:
        missed["onboard"] = ended - np.array(one.onboard)
    places = {"fix": ended, **reached}
    return HindcastSurfacing(
        mission=one.mission,
        time=leg.end,
        method=one.method,
        scored=True,
        places={
            "begin": one.begin,
            **{name: place_at(metres, one.begin) for name, metres in places.items()},
        },
        expected_hours=duration / HOUR,
        surfacing=Judged(
            hours=leg.duration / HOUR,
            missed={name: _pair(ended - metres) for name, metres in reached.items()},
            covariance=duration**2 * (through.covariance + carried.covariance)
            + lasts.covariance[0, 0] * np.outer(ground, ground),
            reach=reaches[0].now,
        ),
        current=Judged(
            hours=leg.duration / HOUR,
            missed={name: _pair(metres) for name, metres in missed.items()},
            covariance=leg.duration**2 * mixed.covariance,
            reach=reaches[1].now,
        ),
        found=_pair(leg.current),
        expected=_pair(mixed.mean),
    )


def _by_members(
    flown: MembersFlown,
    before: Sequence[LoggedLeg],
    one: LoggedLeg,
    surfacing: Judged,
    known: tuple[CurrentPool, WayPool],
    lasts: Mixture,
) -> Judged | None:
    """The same surfacing with its forecast by members flown."""
    pool, ways = known
    duration = middle(lasts)
    told = flown(before, one, pool, ways, duration, surfacing.reach)
    if told is None:
        return None
    mean, covariance = told
    # the members know no other duration than the one that is expected
    late = lasts.covariance[0, 0] * np.outer(mean, mean) / duration**2
    missed = {**surfacing.missed, "forecast": _pair(np.array(one.leg.over_ground) - mean)}
    return Judged(
        hours=surfacing.hours, missed=missed, covariance=covariance + late, reach=CHI_SQUARED
    )


def _leg_ahead(leg: Leg, duration: float, through: Array) -> Leg:
    """The leg as it is expected: nothing of it but its start is known."""
    unknown = (math.nan, math.nan)
    return Leg(
        start=leg.start, duration=duration, over_ground=unknown, through_water=_pair(through)
    )


def _pair(values: Array) -> Pair:
    return float(values[0]), float(values[1])
