"""Hindcast: walk through deployments, forecast every surfacing from what was known, and score it.

Field: what a forecast of the current foretells for the dives of a deployment.
Scores tell by how much forecasts miss, how sure that is, and whether ellipses hold.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.logged_leg import LoggedLeg, dive_times, flown_velocities, legs_of
from glider_twin_ops.forecast.member_hindcast import MemberFlights
from glider_twin_ops.forecast.request import check_members
from glider_twin_ops.forecast.walk import (
    FieldMean,
    HindcastSurfacing,
    Judged,
    Pair,
    Priors,
    Walked,
    walk,
)
from twin import load_vehicle
from twin.checks import EndsApart
from twin.errors import InputError, StoreError
from twin.geodesy import to_tangent_plane
from twin.identify import start_vehicle
from twin.numbers import Array
from twin.records import LogStore
from twin.water.current import Current

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
    """Of some surfacings; None where nothing could be scored."""

    segments: int
    """Surfacings scored"""
    segments_of: dict[str, int]
    """Of these, the surfacings that a method says anything of: its figures are of them alone"""
    mean: dict[str, float | None]
    """[m/h] by method"""
    median: dict[str, float | None]
    """[m/h] by method"""
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


POINTS = 25
"""Places along a dive at which the field is read"""


def field_mean(logs: LogStore, legs: Sequence[LoggedLeg], current: Current) -> FieldMean:
    """What a field foretells of the mean current over the legs of a deployment.

    Args:
      logs: the store, for the depths.
      legs: of one deployment, in order of time, at least one.
      current: its time and place count from the first leg's, unless it has its own.

    Returns:
      A function, which raises CurrentError where the field does not cover a leg.
    """
    first = legs[0]
    origin = first.origin
    part = np.linspace(0.0, 1.0, POINTS)

    def mean(one: LoggedLeg, alike: LoggedLeg, way: Array, duration: float) -> Pair:
        time = one.leg.start - first.leg.start + duration * part
        begin = to_tangent_plane(*one.begin, *first.begin)
        depth = _depths(logs, alike, part)
        found = np.zeros(2)
        for _ in range(2):  # along the way through the water, then along the way the field makes
            north, east = (
                at + (metres + duration * moved) * part
                for at, metres, moved in zip(begin, way, found, strict=True)
            )
            found = current.velocity(time, north, east, depth, origin)[..., :2].mean(axis=0)
        return float(found[0]), float(found[1])

    return mean


def _depths(logs: LogStore, one: LoggedLeg, part: Array) -> Array:
    """Measured depths [m] at parts of a leg, (part,); gaps are bridged."""
    depth = logs.signal("measured_depth", one.mission).astype(float)
    known = np.flatnonzero(np.isfinite(depth))
    if not known.size:
        return np.zeros(len(part))
    return np.interp(part * one.leg.duration / logs.period, known, np.maximum(depth[known], 0.0))


@dataclasses.dataclass(frozen=True, kw_only=True)
class DeploymentHindcast:
    """One deployment."""

    name: str
    store: Path
    dives: int
    """Dives in the store, those without two fixes or a known way through the water too"""
    legs: tuple[LoggedLeg, ...]
    train: int
    """Legs at the beginning that are not scored"""
    walked: Walked
    surfacing: Scores
    """Of where it surfaced"""
    current: Scores
    """Of the current, the way through the water and the duration given"""
    members: Scores | None = None
    """Of where it surfaced by members flown; None where none were"""
    unflown: Mapping[int, str] = dataclasses.field(default_factory=dict)
    """Dives that members told nothing of, by row in the store, and why"""
    beside_mujoco: EndsApart | None = None
    """The first member of the last dive in lanes"""

    @property
    def surfacings(self) -> tuple[HindcastSurfacing, ...]:
        """One for each leg but the first."""
        return self.walked.surfacings


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hindcast:
    """Of all deployments of some stores."""

    deployments: tuple[DeploymentHindcast, ...]
    train_fraction: float
    surfacing: Scores
    """of all scored surfacings together"""
    current: Scores
    members: Scores | None = None
    """None where no members were flown"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Asked:
    """What `hindcast` is asked for of every store."""

    train_fraction: float
    vehicle: str | None
    current: Current | None
    priors: Priors | None
    waypoints: int | None
    members: int | None
    engine: str


def hindcast(
    stores: Sequence[str | Path],
    *,
    train_fraction: float = 0.0,
    vehicle: str | None = None,
    current: Current | None = None,
    priors: Priors | None = None,
    waypoints: int | None = None,
    members: int | None = None,
    engine: str = "lanes",
    advance: Callable[[], object] = lambda: None,
) -> Hindcast:
    """Walk through every deployment of some stores of logs.

    Args:
      stores: paths of stores that `factory import` wrote.
      train_fraction: part of each deployment's legs, at its beginning, that teaches and is not
        scored, such as the dives that a vehicle was identified on.
      vehicle: flight model for the way through the water, a file or a shipped name; by default that
        of depth rate and pitch, and where these are not logged the vehicle's reported current.
      current: forecast field that is known ahead.
      priors: what is believed before the first dive; by default what deployments have in common.
      waypoints: how many of a dive's waypoints count as known, the first ones; None: all.
      members: fly so many for each scored surfacing too, as `forecast` does, by `vehicle` or the
        shipped one of the log's kind; None: none.
      engine: what flies these, as `Scenario.engine`.
      advance: called once for each deployment that is done.

    Raises:
      CurrentError: the field does not cover a deployment.
      StoreError: no store of logs, or none of its dives has two fixes and a way through the water.
      InputError: a fraction that is not from 0 to below 1, no store, the same dives twice, or
        members that are too few or too many.
      VehicleError: no such vehicle.
    """
    if not stores:
        raise InputError("name at least one store of logs")
    if not 0.0 <= train_fraction < 1.0:
        raise InputError(
            f"a training fraction of {train_fraction:g}; it must be from 0 to below 1, so that "
            "some of the dives are left to score"
        )
    if members is not None:
        check_members(members, engine)
    asked = _Asked(
        train_fraction=train_fraction,
        vehicle=vehicle,
        current=current,
        priors=priors,
        waypoints=waypoints,
        members=members,
        engine=engine,
    )
    paths = [Path(path) for path in stores]
    for k, path in enumerate(paths):
        if path.resolve() in [before.resolve() for before in paths[:k]]:
            raise InputError(f"{path} is named twice: its dives would count double, name it once")
    found: list[DeploymentHindcast] = []
    for path in paths:
        for one in _store(path, asked, advance):
            _check_new(one, found)
            found.append(one)
    return Hindcast(
        deployments=tuple(found),
        train_fraction=train_fraction,
        surfacing=scores_of([_scored(one.surfacings, "surfacing") for one in found]),
        current=scores_of([_scored(one.surfacings, "current") for one in found]),
        members=None if members is None else scores_of([_by_members(one.walked) for one in found]),
    )


def _check_new(one: DeploymentHindcast, before: Sequence[DeploymentHindcast]) -> None:
    """Raise where a deployment holds dives of one before: the same place at the same second."""
    dives = {_moment(leg) for leg in one.legs}
    for other in before:
        if shared := len(dives & {_moment(leg) for leg in other.legs}):
            raise InputError(
                f"{shared} dives of {one.name} in {one.store} are those of {other.name} in "
                f"{other.store}: they would count double, leave one of the stores out"
            )


def _moment(one: LoggedLeg) -> tuple[float, float, float]:
    return round(one.leg.start), round(one.begin[0], 4), round(one.begin[1], 4)


def _scored(surfacings: Sequence[HindcastSurfacing], which: str) -> list[Judged]:
    return [getattr(one, which) for one in surfacings if one.scored]


def _by_members(walked: Walked) -> list[Judged]:
    return [one.members for one in walked.surfacings if one.members is not None]


def _store(path: Path, asked: _Asked, advance: Callable[[], object]) -> list[DeploymentHindcast]:
    with LogStore(path) as logs:
        flown = None if asked.vehicle is None else flown_velocities(path, asked.vehicle)
        vehicle = None
        if asked.members is not None:
            vehicle = load_vehicle(asked.vehicle) if asked.vehicle else start_vehicle(path)
        found = []
        for name in dict.fromkeys(logs.deployments):
            legs = [
                dataclasses.replace(one, targets=one.targets[: asked.waypoints])
                for one in legs_of(logs, name, flown)
            ]
            if legs:
                train = int(asked.train_fraction * len(legs))
                flies = None
                if vehicle is not None and asked.members is not None:
                    flies = MemberFlights(logs, vehicle, members=asked.members, engine=asked.engine)
                walked = walk(
                    legs,
                    latitude=float(np.median([one.begin[0] for one in legs])),
                    dives=dive_times(logs, name).dives,
                    train=train,
                    priors=asked.priors,
                    field=None if asked.current is None else field_mean(logs, legs, asked.current),
                    flown=None if flies is None else flies.expect,
                )
                found.append(
                    DeploymentHindcast(
                        name=name,
                        store=path,
                        dives=len(logs.missions_of(name)),
                        legs=tuple(legs),
                        train=train,
                        walked=walked,
                        surfacing=scores_of([_scored(walked.surfacings, "surfacing")]),
                        current=scores_of([_scored(walked.surfacings, "current")]),
                        members=None if flies is None else scores_of([_by_members(walked)]),
                        unflown={} if flies is None else flies.unflown,
                        beside_mujoco=None if flies is None else flies.beside_mujoco(),
                    )
                )
            advance()
    if not found:
        raise StoreError(
            f"store {path}: no dive has GPS fixes at both ends and a known way through the water "
            "(pitch and heading, or the vehicle's reported current): nothing can be forecast"
        )
    return found
