"""Walk: forecasts of each surfacing of a deployment, from the data before its dive.

At the fix before a dive a pilot knows all dives so far with their currents, the dive's list of
waypoints (those that its log commands, in order), the current that the vehicle reckons with, and
the forecast field, if there is one. How many waypoints the dive will reach is not known. Each dive
gets two forecasts.

- Surfacing: expected duration times the sum of expected velocity through the water and expected
  current. Rivals go at the speed of the last three dives toward the first waypoint, for the median
  duration of the last three; each rival has its own current.
- Current: velocity through the water and duration are given, the same for every method.

Pools, filter and ellipses learn at every fix. `hindcast` and `known_from_logs` use the walk.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.expected_dive import (
    GROUND_PRIORS,
    SCHEDULE_PRIORS,
    WAY_PRIORS,
    GroundPool,
    Rhythm,
    SurfacingSchedule,
    WayPool,
    middle,
    plain_way,
)
from glider_twin_ops.forecast.logged_leg import DiveTime, LoggedLeg, pair, place_at, usual_duration
from glider_twin_ops.forecast.pool import CURRENT_PRIORS, CurrentPool, Mixture, Prior, tidal_fit
from twin.navigation import chi_squared
from twin.navigation.current import Leg, Reaches
from twin.numbers import Array

Pair = tuple[float, float]
FieldMean = Callable[[LoggedLeg, LoggedLeg, Array, float], Pair]
"""Mean current north, east [m/s] that a field forecasts for a dive. Arguments: leg that gives the
begin, leg that gives the depths, displacement through the water [m], duration [s]"""


class Models(NamedTuple):
    """Pools of one deployment, as they stand after its dives so far."""

    pool: CurrentPool
    """Current"""
    ways: WayPool
    """Velocity through the water"""
    ground: GroundPool
    """Velocity over ground"""


MembersFlown = Callable[
    [Sequence[LoggedLeg], LoggedLeg, Models, float, Pair], tuple[Array, Array] | None
]
"""Mean [m] and covariance [m2] of the members' surfacings (`MemberFlights.expect`)"""

HOUR = 3600.0
"""[s]"""
CHI_SQUARED = chi_squared(0.5), chi_squared(0.9)
RIVAL_DAYS = 5.0
"""[d] Length of the record that the rival `tide` fits"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Priors:
    """Priors before the first dive; the defaults are those of `benchmarks.surfacings --priors`."""

    current: Mapping[str, Prior] = dataclasses.field(default_factory=lambda: CURRENT_PRIORS)
    way: Mapping[str, Prior] = dataclasses.field(default_factory=lambda: WAY_PRIORS)
    ground: Mapping[str, Prior] = dataclasses.field(default_factory=lambda: GROUND_PRIORS)
    schedule: Mapping[str, Prior] = dataclasses.field(default_factory=lambda: SCHEDULE_PRIORS)
    surfacing_reach: Pair = (0.99, 17.0)
    """[1] squared Mahalanobis radii of the 50 and 90 % ellipses of a surfacing"""
    current_reach: Pair = (0.72, 7.3)
    """[1] squared Mahalanobis radii of the 50 and 90 % ellipses of a current"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Judged:
    """Errors of a forecast and of its rivals at one fix."""

    hours: float
    """[h] duration of the dive"""
    missed: dict[str, Pair]
    """North, east [m] by method: the fix less the forecast place"""
    covariance: Array
    """[m2] covariance of the forecast, (2, 2)"""
    reach: Pair
    """[1] squared Mahalanobis radii of the 50 and 90 % ellipses"""

    def error(self, method: str) -> float:
        """[m/h] distance between fix and forecast over the dive's duration; NaN without one."""
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
        """True for each of the 50 and 90 % ellipses that contains the fix."""
        return self.distance <= self.reach[0], self.distance <= self.reach[1]


@dataclasses.dataclass(frozen=True, kw_only=True)
class HindcastSurfacing:
    """Forecasts of one surfacing beside its fix."""

    mission: int
    """Row in the store."""
    time: float
    """[s] unix"""
    scored: bool
    """False for the first legs, which only teach the models"""
    places: dict[str, Pair]
    """Latitude, longitude [degree] of `begin`, of `fix`, and of each method's forecast"""
    surfacing: Judged
    current: Judged
    found: Pair
    """North, east [m/s] of the observed current, mean over the dive"""
    expected: Pair
    """North, east [m/s] of the forecast current, mean over the dive"""
    members: Judged | None = None
    """Errors of the surfacing forecast by flown members; None where no members were flown"""

    @property
    def hours(self) -> float:
        """[h] between the two fixes."""
        return self.surfacing.hours


@dataclasses.dataclass(frozen=True, kw_only=True)
class Walked:
    """Forecasts of all surfacings of a deployment, and the models after its last dive."""

    surfacings: tuple[HindcastSurfacing, ...]
    """One for each leg but the first"""
    weights: dict[str, dict[str, float]]
    """[1] mean posterior weight of each model over the dives, by pool: current, way, ground,
    schedule"""
    pool: CurrentPool
    """Models of the current, after the last dive"""
    ways: WayPool
    """Models of the velocity through the water, after the last dive"""
    ground: GroundPool
    """Models of the velocity over ground, after the last dive"""
    schedule: SurfacingSchedule
    """Models of the duration, as known when the last dive began"""
    rhythm: Rhythm | None
    """Surface intervals and durations; None where the dives are too few"""
    reach: Pair
    """[1] squared Mahalanobis radii of the next surfacing's 50 and 90 % ellipses"""


def walk(
    legs: Sequence[LoggedLeg],
    *,
    dives: Sequence[DiveTime] = (),
    train: int = 0,
    priors: Priors | None = None,
    field: FieldMean | None = None,
    flown: MembersFlown | None = None,
) -> Walked:
    """Forecast the end of every leg but the first, then learn from its fix.

    Args:
      legs: of one deployment, in order of time, at least one.
      dives: begin and end of all known dives in order of time, those without a known displacement
        through the water too; by default those of the legs.
      train: number of legs at the beginning that are not scored.
      priors: of the models, before the first leg; None takes the shipped ones.
      field: gives the current that a forecast field has for a leg.
      flown: flies members of each scored leg too.
    """
    priors = priors or Priors()
    pool = CurrentPool(
        latitude=float(np.median([one.begin[0] for one in legs])),
        time=legs[0].leg.start,
        field=field is not None,
        priors=priors.current,
    )
    models = Models(pool, WayPool(priors.way), GroundPool(priors.ground))
    ends = SurfacingSchedule(priors.schedule)
    reaches = Reaches(priors.surfacing_reach), Reaches(priors.current_reach)
    times = list(dives) or [DiveTime(one.leg.start, one.leg.end, math.nan) for one in legs]
    parts: dict[str, list[Array]] = {n: [] for n in ("current", "way", "ground", "schedule")}
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
            judged = _judge(legs[:k], one, leg, models, lasts, reaches, field)
            for reach, each in zip(reaches, (judged.surfacing, judged.current), strict=True):
                reach.learn(each.distance)
            members, duration = None, middle(lasts)
            if flown is not None and k >= train:
                members = flown(legs[:k], one, models, duration, judged.surfacing.reach)
            if members is not None:
                mean, covariance = members
                # every member flies the expected duration: the duration's error is added here
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
        parts["way"].append(models.ways.learn(one))
        if (part := models.ground.learn(np.array(leg.over_ground) / leg.duration)) is not None:
            parts["ground"].append(part)
    pools = dict(zip(parts, (one.pool for one in (*models, ends)), strict=True))
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
        **models._asdict(),
        schedule=ends,
        rhythm=Rhythm.of(whole, dives),
        reach=reaches[0].now,
    )


def _judge(
    before: Sequence[LoggedLeg],
    one: LoggedLeg,
    leg: Leg,
    models: Models,
    lasts: Mixture,
    reaches: tuple[Reaches, Reaches],
    field: FieldMean | None,
) -> HindcastSurfacing:
    """Forecast one surfacing by all methods from the dives before, and take its errors."""
    pool, ways, _ = models
    duration = middle(lasts)
    through = ways.expect(one, duration)
    ahead = _leg_ahead(leg, duration, duration * through.mean)
    if field is not None:
        told = field(one, before[-1], duration * through.mean, duration)
        ahead = dataclasses.replace(ahead, field=told)
    carried = pool.expect(ahead)
    over_ground = models.ground.expect(through, carried)
    ground = over_ground.mean
    legs = [each.leg for each in before]
    usual = usual_duration([DiveTime(each.start, each.end, math.nan) for each in legs])
    plain = plain_way(before, one.targets, usual)
    mixed = pool.expect(leg)

    def rivals(over: Leg) -> dict[str, Array]:
        """Mean current [m/s] of each rival over a leg."""
        tide = tidal_fit(legs, over, RIVAL_DAYS)
        return {"persistence": legs[-1].current, "tide": tide, "no_current": np.zeros(2)}

    expected = rivals(_leg_ahead(leg, usual, plain))
    reached = {"forecast": duration * ground, "over_ground": usual * models.ground.steady}
    reached |= {name: plain + usual * current for name, current in expected.items()}
    ended, given = np.array(leg.over_ground), np.array(leg.through_water)
    drifted = {"forecast": mixed.mean, **rivals(leg)}
    missed = {name: ended - given - leg.duration * each for name, each in drifted.items()}
    if one.onboard is not None:
        reached["onboard"] = plain + usual * np.array(ways.steered(one))
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
            covariance=duration**2 * over_ground.covariance
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
    """Leg of an expected duration [s] and displacement through the water [m], its end unknown."""
    unknown = (math.nan, math.nan)
    return Leg(start=leg.start, duration=duration, over_ground=unknown, through_water=pair(through))


METHODS = ("forecast", "over_ground", "persistence", "tide", "no_current", "onboard")
RESAMPLED, BLOCK, SEED = 2000, 6, 1
"""RESAMPLED: number of bootstrap samples. BLOCK: surfacings in a block, about a day, since errors
of neighbours correlate (Kunsch 1989, Ann. Stat. 17). SEED: the bootstrap's"""
LEAST_BLOCKS, LEAST_SEGMENTS = 5, 12
"""LEAST_BLOCKS: minimum number; a short deployment has shorter blocks. LEAST_SEGMENTS: minimum
number of surfacings with an interval; intervals resampled from fewer are too narrow."""
INTERVAL = (2.5, 97.5)
"""[%] Percentiles of a 95 % interval"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scores:
    """Errors [m/h] of scored surfacings by method; None where nothing could be scored."""

    segments: int
    """Number of scored surfacings"""
    segments_of: dict[str, int]
    """Number of scored surfacings that each method forecast: its mean and median are over these"""
    mean: dict[str, float | None]
    median: dict[str, float | None]
    rival: str | None
    """Best rival: the method with the smallest mean of those, beside the forecast, that forecast
    every surfacing"""
    ratio: float | None
    """[1] mean error of the forecast over that of the rival"""
    ratio_interval: tuple[float, float] | None
    """[1] 95 % bootstrap interval of the ratio; None below `LEAST_SEGMENTS` surfacings"""
    coverage_50: float | None
    """[1] fraction of the fixes within the 50 % ellipse"""
    coverage_90: float | None

    @property
    def partial(self) -> tuple[str, ...]:
        """Methods that forecast some of the surfacings, and not all."""
        return tuple(n for n, count in self.segments_of.items() if 0 < count < self.segments)

    def describe(self) -> dict[str, object]:
        """Numbers as `--json` prints them, with units in the names."""
        return {
            "segments": self.segments,
            "mean_m_per_h": self.mean,
            "median_m_per_h": self.median,
            "coverage_50": self.coverage_50,
            "coverage_90": self.coverage_90,
        }


def scores_of(deployments: Sequence[Sequence[Judged]], rival: str | None = None) -> Scores:
    """Scores of several deployments together.

    Args:
      deployments: scored surfacings of each; a block of the bootstrap lies within one deployment.
      rival: method to compare with; None: the best of these deployments.
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
    if rival not in whole:
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
    """Bootstrap interval of a number, by blocks of neighbours within each deployment.

    Args:
      counts: number of surfacings of each deployment, which follow each other.
      figure: function of the resampled surfacings' indices.
      interval: [%] the two percentiles.
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
