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
from numpy.typing import NDArray

from glider_twin_ops.forecast.expected_dive import (
    SCHEDULE_PRIORS,
    WAY_PRIORS,
    Rhythm,
    SurfacingSchedule,
    WayPool,
    middle,
    plain_velocity,
)
from glider_twin_ops.forecast.logged_leg import DiveTime, LoggedLeg, pair, place_at, usual_duration
from glider_twin_ops.forecast.pool import CURRENT_PRIORS, CurrentPool, Mixture, Prior, tidal_fit
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

    current: Mapping[str, Prior] = dataclasses.field(default_factory=lambda: CURRENT_PRIORS)
    way: Mapping[str, Prior] = dataclasses.field(default_factory=lambda: WAY_PRIORS)
    schedule: Mapping[str, Prior] = dataclasses.field(default_factory=lambda: SCHEDULE_PRIORS)
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
    scored: bool
    """False in the part that only teaches"""
    places: dict[str, Pair]
    """Latitude, longitude [degree]: `begin`, `fix`, and where each method has the surfacing"""
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
    pool: CurrentPool
    """Of the current, after the last dive"""
    ways: WayPool
    """After the last dive"""
    schedule: SurfacingSchedule
    """As it was known when the last dive began"""
    rhythm: Rhythm | None
    """Stays at the surface and durations; None where the dives are too few"""
    reach: Pair
    """[1] squared distances within which the two ellipses of the next surfacing lie"""


def walk(
    legs: Sequence[LoggedLeg],
    *,
    dives: Sequence[DiveTime] = (),
    train: int = 0,
    priors: Priors | None = None,
    field: FieldMean | None = None,
    flown: MembersFlown | None = None,
) -> Walked:
    """Forecast every leg's end.

    Args:
      legs: of one deployment, in order of time, at least one.
      dives: all that are known, those without a known way, too, in order of time; by default the
        legs'.
      train: legs at the beginning that are not scored.
      priors: what is believed before the first.
      field: what a forecast field foretells of each leg.
      flown: flies members of each scored leg too.
    """
    priors = priors or Priors()
    pool = CurrentPool(
        latitude=float(np.median([one.begin[0] for one in legs])),
        time=legs[0].leg.start,
        field=field is not None,
        priors=priors.current,
    )
    ways, ends = WayPool(priors.way), SurfacingSchedule(priors.schedule)
    reaches = Reaches(priors.surfacing_reach), Reaches(priors.current_reach)
    times = list(dives) or [DiveTime(one.leg.start, one.leg.end, math.nan) for one in legs]
    parts: dict[str, list[Array]] = {"current": [], "way": [], "schedule": []}
    found: list[HindcastSurfacing] = []
    for k, one in enumerate(legs):
        leg = one.leg
        while times and times[0].end <= leg.start + 1.0:
            if (part := ends.learn(times.pop(0))) is not None:
                parts["schedule"].append(part)
        if field is not None:
            told = field(one, one, np.array(leg.through_water), leg.duration)
            leg = dataclasses.replace(leg, field=told)
        if k:
            lasts = ends.expect(leg.start)
            judged = _judge(legs[:k], one, leg, (pool, ways), lasts, reaches, field)
            for reach, each in zip(reaches, (judged.surfacing, judged.current), strict=True):
                reach.learn(each.distance)
            members, duration = None, middle(lasts)
            if flown is not None and k >= train:
                members = flown(legs[:k], one, pool, ways, duration, judged.surfacing.reach)
            if members is not None:
                mean, covariance = members
                # the members know no other duration than the one that is expected
                late = lasts.covariance[0, 0] * np.outer(mean, mean) / duration**2
                missed = {"forecast": pair(np.array(one.leg.over_ground) - mean)}
                by_members = dataclasses.replace(
                    judged.surfacing,
                    missed=judged.surfacing.missed | missed,
                    covariance=covariance + late,
                    reach=CHI_SQUARED,
                )
                judged = dataclasses.replace(judged, members=by_members)
            found.append(dataclasses.replace(judged, scored=k >= train))
        parts["current"].append(pool.learn(leg))
        parts["way"].append(ways.learn(one))
    pools = {"current": pool.pool, "way": ways.pool, "schedule": ends.pool}
    whole = copy.deepcopy(ends)
    for dive in times:
        whole.learn(dive)
    return Walked(
        surfacings=tuple(found),
        weights={
            name: dict(zip(one.names, np.mean(parts[name], axis=0).tolist(), strict=True))
            for name, one in pools.items()
            if parts[name]
        },
        pool=pool,
        ways=ways,
        schedule=ends,
        rhythm=Rhythm.of(whole, dives),
        reach=reaches[0].now,
    )


def _judge(
    before: Sequence[LoggedLeg],
    one: LoggedLeg,
    leg: Leg,
    known: tuple[CurrentPool, WayPool],
    lasts: Mixture,
    reaches: tuple[Reaches, Reaches],
    field: FieldMean | None,
) -> HindcastSurfacing:
    """One surfacing, forecast by what the dives before have taught."""
    pool, ways = known
    duration = middle(lasts)
    through = ways.expect(one, duration)
    ahead = _leg_ahead(leg, duration, duration * through.mean)
    if field is not None:
        told = field(one, before[-1], duration * through.mean, duration)
        ahead = dataclasses.replace(ahead, field=told)
    carried = pool.expect(ahead)
    ground = through.mean + carried.mean
    legs = [each.leg for each in before]
    usual = usual_duration([DiveTime(each.start, each.end, math.nan) for each in legs])
    plain = plain_velocity(before, one.targets)
    mixed = pool.expect(leg)

    def rivals(over: Leg) -> dict[str, Array]:
        """[m/s] current of each rival, mean over a leg."""
        tide = tidal_fit(legs, over, RIVAL_DAYS)
        return {"persistence": legs[-1].current, "tide": tide, "no_current": np.zeros(2)}

    expected = rivals(_leg_ahead(leg, usual, usual * plain))
    reached = {"forecast": duration * ground}
    reached |= {name: usual * (plain + current) for name, current in expected.items()}
    ended, given = np.array(leg.over_ground), np.array(leg.through_water)
    drifted = {"forecast": mixed.mean, **rivals(leg)}
    missed = {name: ended - given - leg.duration * each for name, each in drifted.items()}
    if one.onboard is not None:
        reached["onboard"] = usual * (plain + np.array(ways.steered(one)))
        missed["onboard"] = ended - np.array(one.onboard)
    places = {name: place_at(to, one.begin) for name, to in {"fix": ended, **reached}.items()}
    hours = leg.duration / HOUR
    return HindcastSurfacing(
        mission=one.mission,
        time=leg.end,
        scored=True,
        places={"begin": one.begin, **places},
        surfacing=Judged(
            hours=hours,
            missed={name: pair(ended - metres) for name, metres in reached.items()},
            covariance=duration**2 * (through.covariance + carried.covariance)
            + lasts.covariance[0, 0] * np.outer(ground, ground),
            reach=reaches[0].now,
        ),
        current=Judged(
            hours=hours,
            missed={name: pair(metres) for name, metres in missed.items()},
            covariance=leg.duration**2 * mixed.covariance,
            reach=reaches[1].now,
        ),
        found=pair(leg.current),
        expected=pair(mixed.mean),
    )


def _leg_ahead(leg: Leg, duration: float, through: Array) -> Leg:
    """Leg as it is expected: nothing of it but its start is known."""
    unknown = (math.nan, math.nan)
    return Leg(start=leg.start, duration=duration, over_ground=unknown, through_water=pair(through))


METHODS = ("forecast", "persistence", "tide", "no_current", "onboard")
RESAMPLED, BLOCK, SEED = 2000, 6, 1
"""Bootstrap samples, surfacings in a block (about a day: errors of neighbours are alike, Kunsch
1989, Ann. Stat. 17), and the seed"""
LEAST_BLOCKS, LEAST_SEGMENTS = 5, 12
"""Blocks of a deployment, which are shorter where it is short, and surfacings below which there are
no intervals: those resampled from fewer are too narrow"""
INTERVAL = (2.5, 97.5)
"""[%]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scores:
    """Errors of some surfacings by method [m/h]; None where nothing could be scored."""

    segments: int
    """Surfacings scored"""
    segments_of: dict[str, int]
    """Of these, the surfacings that a method says anything of: its figures are of them alone"""
    mean: dict[str, float | None]
    median: dict[str, float | None]
    rival: str | None
    """The method beside the forecast with the smallest mean, of those that say something of every
    surfacing"""
    ratio: float | None
    """[1] mean of the forecast by that of the rival"""
    ratio_interval: tuple[float, float] | None
    """[1] 95 % bootstrap interval of that; None of fewer than `LEAST_SEGMENTS`"""
    coverage_50: float | None
    """[1] part of the fixes within the 50 % ellipse"""
    coverage_90: float | None

    @property
    def partial(self) -> tuple[str, ...]:
        """Methods that say something of some surfacings only."""
        return tuple(n for n, count in self.segments_of.items() if 0 < count < self.segments)

    def describe(self) -> dict[str, object]:
        """The figures with their units in the names."""
        return {
            "segments": self.segments,
            "mean_m_per_h": self.mean,
            "median_m_per_h": self.median,
            "coverage_50": self.coverage_50,
            "coverage_90": self.coverage_90,
        }


def scores_of(deployments: Sequence[Sequence[Judged]]) -> Scores:
    """The scores of some deployments together.

    Args:
      deployments: what was scored of each; blocks of the bootstrap stay within one.
    """
    every = [one for run in deployments for one in run]
    errors = {name: np.array([one.error(name) for one in every]) for name in METHODS}
    known = {name: values[np.isfinite(values)] for name, values in errors.items()}
    mean = {n: float(v.mean()) if v.size else None for n, v in known.items()}
    whole = {
        name: figure
        for name, figure in mean.items()
        if name != "forecast" and figure is not None and len(known[name]) == len(every)
    }
    rival = min(whole, key=lambda name: whole[name]) if whole else None
    interval = None
    if rival is not None and len(every) >= LEAST_SEGMENTS:
        interval = bootstrap(
            [len(run) for run in deployments],
            lambda rows: float(errors["forecast"][rows].mean() / errors[rival][rows].mean()),
        )
    held = np.array([one.held for one in every], float).reshape(-1, 2)
    return Scores(
        segments=len(every),
        segments_of={name: len(values) for name, values in known.items()},
        mean=mean,
        median={n: float(np.median(v)) if v.size else None for n, v in known.items()},
        rival=rival,
        ratio=None if rival is None else float(errors["forecast"].mean()) / whole[rival],
        ratio_interval=interval,
        coverage_50=float(held[:, 0].mean()) if every else None,
        coverage_90=float(held[:, 1].mean()) if every else None,
    )


def bootstrap(
    counts: Sequence[int],
    figure: Callable[[NDArray[np.intp]], float],
    interval: tuple[float, float] = INTERVAL,
) -> tuple[float, float]:
    """Interval of a figure, resampled in blocks of neighbours, each deployment as long as it is.

    Args:
      counts: surfacings of each deployment, one after the other.
      figure: of the surfacings at some indices.
      interval: [%] its two percentiles.
    """
    rng = np.random.default_rng(SEED)
    found = []
    for _ in range(RESAMPLED):
        picked, first = [], 0
        for count in counts:
            if not count:
                continue
            block = min(BLOCK, max(count // LEAST_BLOCKS, 1))
            begins = rng.integers(0, count - block + 1, -(-count // block))
            rows = (begins[:, None] + np.arange(block)).ravel()[:count]
            picked.append(first + rows)
            first += count
        found.append(figure(np.concatenate(picked)))
    low, high = np.percentile(found, interval)
    return float(low), float(high)
