"""Hindcast: forecasts of every surfacing of stored deployments, and their scores.

A field gives the current that was forecast for the dives of a deployment. Members fly each
surfacing as in `twin forecast`, from what is known when the dive begins: the currents so far, the
waypoints of the dive, and the expected duration. Depth and pitch are those of the dive before.
Beyond the last waypoint, and in a log without waypoints, the course continues.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.forecast.logged_leg import (
    MODEL,
    LoggedLeg,
    dive_times,
    flown_velocities,
    legs_of,
    pair,
)
from glider_twin_ops.forecast.member_flights import MemberFlight, fly, surfacings_of
from glider_twin_ops.forecast.members import members_of
from glider_twin_ops.forecast.request import HOUR, Known, Request, check_members
from glider_twin_ops.forecast.walk import (
    FieldMean,
    HindcastSurfacing,
    Models,
    Pair,
    Priors,
    Scores,
    Walked,
    scores_of,
    walk,
)
from twin import Mission, Scenario, Vehicle, Waypoint, load_vehicle
from twin.checks import EndsApart, ends_apart, flown_in_mujoco
from twin.errors import InputError, MissionError, StoreError
from twin.geodesy import to_tangent_plane
from twin.identify import start_vehicle
from twin.numbers import Array
from twin.records import LogStore
from twin.water.current import Current

POINTS = 25
"""Number of places along a dive at which the field is read"""
AHEAD = 2e5
"""[m] Length of the course beyond the last waypoint, longer than any dive"""
ARRIVAL = 20.0
"""[m] Radius of arrival at a waypoint, as in the walk (`expected_dive.ARRIVED`)"""
UNDER, FLATTEST, STEEPEST = 5.0, 5.0, 45.0
"""Samples that count as gliding. UNDER: [m] smallest depth. FLATTEST, STEEPEST: [degree] pitch"""
SHALLOWEST = 10.0
"""[m] Smallest depth to which members dive"""


def field_mean(logs: LogStore, legs: Sequence[LoggedLeg], current: Current) -> FieldMean:
    """Make the function that gives a field's mean current over a leg of a deployment.

    Args:
      logs: the store, for the depths.
      legs: legs of one deployment, in order of time, at least one.
      current: field; without a time and place of its own it begins at the first leg.

    Returns:
      A function of a leg, which raises CurrentError if the field does not cover the leg.
    """
    first, part = legs[0], np.linspace(0.0, 1.0, POINTS)

    def mean(one: LoggedLeg, alike: LoggedLeg, way: Array, duration: float) -> Pair:
        time = one.leg.start - first.leg.start + duration * part
        begin = to_tangent_plane(*one.begin, *first.begin)
        measured = logs.signal("measured_depth", alike.mission).astype(float)
        known, depth = np.flatnonzero(np.isfinite(measured)), np.zeros(len(part))
        if known.size:  # interpolate over gaps
            at, dived = part * alike.leg.duration / logs.period, np.maximum(measured[known], 0.0)
            depth = np.interp(at, known, dived)
        found = np.zeros(2)
        for _ in range(2):  # first along the path through the water, then with the field added
            north, east = (
                at + (metres + duration * moved) * part
                for at, metres, moved in zip(begin, way, found, strict=True)
            )
            found = current.velocity(time, north, east, depth, first.origin)[..., :2].mean(axis=0)
        return pair(found)

    return mean


class MemberFlights:
    """Flights of the members of each dive of one deployment.

    Args:
      logs: open store. members, engine: as in `Request`.
    """

    def __init__(self, logs: LogStore, vehicle: Vehicle, *, members: int, engine: str):
        self._logs, self._vehicle = logs, vehicle
        self._members, self._engine = members, engine
        self._nominal: tuple[Scenario, MemberFlight] | None = None
        self.unflown: dict[int, str] = {}
        """Reason why a dive has no forecast by members, by row in the store"""

    def expect(
        self,
        before: Sequence[LoggedLeg],
        one: LoggedLeg,
        models: Models,
        duration: float,
        reach: Pair,
    ) -> tuple[Array, Array] | None:
        """Fly the members of a dive.

        Args:
          before: the dives so far, at least one.
          one: dive whose begin, waypoints and current estimate are read.
          models: models after the last dive of `before`.
          duration: [s] expected duration.
          reach: [1] squared radii of the two ellipses, as in `Walked`.

        Returns:
          Mean of the surfacings, north and east [m] from the begin, (2,), and covariance of
          members and fix [m2], (2, 2); None without a forecast (reason in `unflown`).
        """
        place, last = one.origin, before[-1].leg
        try:
            request = Request(
                vehicle=self._vehicle,
                mission=self._mission(before[-1], one, duration, models.ways.steered(one)),
                place=place,
                hours=duration / HOUR,
                members=self._members,
                engine=self._engine,
            )
        except MissionError as error:
            self.unflown[one.mission] = str(error)
            return None
        known = Known(
            **copy.deepcopy(models)._asdict(),
            place=one.begin,
            time=last.end,
            last_current=pair(last.current),
            source=f"{len(before)} dives",
            legs=len(before),
            reach=reach[1],
            by_model=all(each.method == MODEL for each in before),
        ).at(one.leg.start)
        members = members_of(request, known)
        found = [flight for some in fly(members.scenarios) for flight in some]
        flights = [flight for flight in found if isinstance(flight, MemberFlight)]
        told = surfacings_of(flights, place)
        if not told:
            self.unflown[one.mission] = (
                f"{sum(len(flight.time) > 0 for flight in flights)} of {len(found)} members surface"
            )
            return None
        if isinstance(found[0], MemberFlight):
            self._nominal = members.scenarios[0], found[0]
        return np.array([told[0].north, told[0].east]), told[0].covariance

    def beside_mujoco(self) -> EndsApart | None:
        """Fly the last dive's first member in MuJoCo too; None if lanes flew no member."""
        if self._nominal is None or self._engine != "lanes":
            return None
        scenario, flight = self._nominal
        return ends_apart(flight.duration, flight.end, flown_in_mujoco(scenario))

    def _mission(self, last: LoggedLeg, one: LoggedLeg, duration: float, steered: Pair) -> Mission:
        """Mission to the waypoints of a dive, at depth and pitch of the dive before."""
        depth = self._logs.signal("measured_depth", last.mission).astype(float)
        pitch = math.degrees(self._vehicle.usual_glide[0])
        if "measured_pitch" in self._logs:
            pitched = np.abs(self._logs.signal("measured_pitch", last.mission).astype(float))
            glides = (depth > UNDER) & (pitched > FLATTEST) & (pitched < STEEPEST)
            pitch = float(np.median(pitched[glides])) if glides.any() else pitch
        points = [np.zeros(2), *(np.array(target) for target in one.targets)]
        course = next(
            (b - a for a, b in zip(points[-2::-1], points[:0:-1], strict=True) if (b != a).any()),
            np.array(last.leg.through_water),
        )
        points.append(points[-1] + AHEAD * course / max(float(np.hypot(*course)), 1e-9))
        segment = Waypoint(
            targets=tuple({"north_m": float(n), "east_m": float(e)} for n, e in points[1:]),
            max_depth_m=float(np.nanmax(depth, initial=SHALLOWEST)),
            pitch_deg=pitch,
            surface_after_s=duration,
            surface_at_target=False,
            arrival_radius_m=ARRIVAL,
            current_north_m_s=steered[0],
            current_east_m_s=steered[1],
        )
        mission = Mission(name="hindcast", segments=(segment,))
        mission.check(self._vehicle)
        return mission


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Scored:
    """Scores of surfacings, of currents, and of surfacings by flown members."""

    surfacing: Scores
    current: Scores
    """Scores of the displacement by the current, with given duration and path through the water"""
    members: Scores | None = None
    """Scores of surfacings by flown members; None if no members were flown"""

    def describe(self) -> dict[str, object]:
        """Scores as `--json` prints them."""
        told = {n: getattr(self, n) for n in ("surfacing", "current", "members")}
        return {name: one.describe() for name, one in told.items() if one is not None}


@dataclasses.dataclass(frozen=True, kw_only=True)
class DeploymentHindcast(_Scored):
    """Hindcast of one deployment."""

    name: str
    store: Path
    dives: int
    """Number of dives in the store, including dives without two fixes or a known displacement"""
    legs: tuple[LoggedLeg, ...]
    train: int
    """Number of legs at the beginning that are not scored"""
    walked: Walked
    unflown: Mapping[int, str] = dataclasses.field(default_factory=dict)
    """Reason why a dive has no forecast by members, by row in the store"""
    beside_mujoco: EndsApart | None = None
    """Difference between lanes and MuJoCo for the first member of the last dive"""

    @property
    def surfacings(self) -> tuple[HindcastSurfacing, ...]:
        """Surfacings with their forecasts, one for each leg but the first."""
        return self.walked.surfacings

    def describe(self) -> dict[str, object]:
        """Scores as `--json` prints them, and the dives without a forecast by members."""
        if self.members is None:
            return super().describe()
        return super().describe() | {
            "members_unflown": {str(mission): why for mission, why in self.unflown.items()},
            "beside_mujoco": self.beside_mujoco and dataclasses.asdict(self.beside_mujoco),
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hindcast(_Scored):
    """Hindcasts of all deployments of the stores, with their scores together."""

    deployments: tuple[DeploymentHindcast, ...]
    train_fraction: float

    def rows(self, which: str, least: int = 0) -> list[tuple[str, Scores]]:
        """Name and scores of each deployment of at least `least` surfacings; with several, scores
        of all together come last."""
        told = ((one.name, getattr(one, which)) for one in self.deployments)
        found = [(name, one) for name, one in told if one is not None and one.segments >= least]
        return [*found, ("all", getattr(self, which))] if len(found) > 1 else found


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
    """Forecast and score the surfacings of every deployment of some stores of logs.

    Args:
      stores: paths of stores that `factory import` wrote.
      train_fraction: fraction of each deployment's legs, from the first, that the models learn from
        and that is not scored, such as the dives that a vehicle was identified on.
      vehicle: flight model for the velocity through the water, a file or a shipped name; None takes
        depth rate and pitch, else the vehicle's reported current.
      current: forecast field that is known ahead.
      priors: priors of the models, before the first dive; None: the shipped priors.
      waypoints: number of a dive's waypoints that are known, from the first; None: all.
      members: number of members that are flown for each scored surfacing, as in `forecast`, by
        `vehicle` or the shipped vehicle of the log's type; None: none.
      engine: flies the members, as `Scenario.engine`.
      advance: called after each deployment.

    Raises:
      CurrentError: the field does not cover a deployment.
      StoreError: no store of logs, or none of its dives has two fixes and a known path in water.
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
    paths = [Path(path) for path in stores]
    for k, path in enumerate(paths):
        if path.resolve() in [before.resolve() for before in paths[:k]]:
            raise InputError(f"{path} is named twice: its dives would count double, name it once")
    found: list[DeploymentHindcast] = []
    for path in paths:
        before = len(found)
        with LogStore(path) as logs:
            flown = None if vehicle is None else flown_velocities(path, vehicle)
            flies = None
            if members is not None:
                flies = load_vehicle(vehicle) if vehicle else start_vehicle(path)
            for name in dict.fromkeys(logs.deployments):
                legs = [
                    dataclasses.replace(one, targets=one.targets[:waypoints])
                    for one in legs_of(logs, name, flown)
                ]
                by = None
                if flies is not None and members is not None:
                    by = MemberFlights(logs, flies, members=members, engine=engine)
                if legs:
                    train = int(train_fraction * len(legs))
                    walked = walk(
                        legs,
                        dives=dive_times(logs, name).dives,
                        train=train,
                        priors=priors,
                        field=None if current is None else field_mean(logs, legs, current),
                        flown=None if by is None else by.expect,
                    )
                    one = DeploymentHindcast(
                        name=name,
                        store=path,
                        dives=len(logs.missions_of(name)),
                        legs=tuple(legs),
                        train=train,
                        walked=walked,
                        unflown={} if by is None else by.unflown,
                        beside_mujoco=None if by is None else by.beside_mujoco(),
                        **_scores([walked], by is not None),
                    )
                    _check_new(one, found)
                    found.append(one)
                advance()
        if len(found) == before:
            raise StoreError(
                f"store {path}: no dive has GPS fixes at both ends and a known way through the "
                "water (pitch and heading, or the vehicle's reported current): nothing can be "
                "forecast"
            )
    together = _scores([one.walked for one in found], members is not None)
    best = {which: scores.rival for which, scores in together.items()}
    alike = []
    for one in found:
        scores: dict[str, Any] = {**_scores([one.walked], members is not None, best)}
        alike.append(dataclasses.replace(one, **scores))
    return Hindcast(deployments=tuple(alike), train_fraction=train_fraction, **together)


def _scores(
    deployments: Sequence[Walked], members: bool, rivals: Mapping[str, str | None] | None = None
) -> dict[str, Scores]:
    """Scores of several deployments together, by field of `_Scored`, beside one rival each."""
    found = {}
    for which in ("surfacing", "current", *["members"] * members):
        told = ([getattr(s, which) for s in one.surfacings if s.scored] for one in deployments)
        runs = [[one for one in each if one is not None] for each in told]
        found[which] = scores_of(runs, None if rivals is None else rivals[which])
    return found


def _check_new(one: DeploymentHindcast, before: Sequence[DeploymentHindcast]) -> None:
    """Raise InputError if two deployments share a dive: equal place and second."""
    dives, *others = (
        {(round(leg.leg.start), *(round(v, 4) for v in leg.begin)) for leg in each.legs}
        for each in (one, *before)
    )
    for other, known in zip(before, others, strict=True):
        if shared := len(dives & known):
            raise InputError(
                f"{shared} dives of {one.name} in {one.store} are those of {other.name} in "
                f"{other.store}: they would count double, leave one of the stores out"
            )
