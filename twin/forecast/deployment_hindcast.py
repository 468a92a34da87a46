"""Hindcast: tune on the first part of each deployment, forecast and score the rest.

Field: what a forecast of the current foretells for the dives of a deployment.
"""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError
from twin.forecast.scores import Scores, scores_of
from twin.forecast.walk import HindcastSurfacing, walk
from twin.geodesy import to_tangent_plane
from twin.logs.logged_leg import LoggedLeg, flown_velocities, legs_of
from twin.navigation.current import Tuned, tune
from twin.records.logged import LogStore
from twin.water.current.axes import Origin
from twin.water.current.base import Current

Array = NDArray[np.float64]

POINTS = 25
"""Places along a dive at which the field is read"""


def with_field(logs: LogStore, legs: Sequence[LoggedLeg], current: Current) -> list[LoggedLeg]:
    """Legs with what a field foretells of their mean current.

    Args:
      logs: the store, for the depths.
      legs: of one deployment, in order of time.
      current: its time and place count from the first leg's, unless it has its own.

    Raises:
      CurrentError: the field does not cover the deployment.
    """
    if not legs:
        return []
    first = legs[0]
    moment = datetime.datetime.fromtimestamp(first.leg.start, datetime.UTC)
    origin = Origin(
        latitude_deg=first.begin[0],
        longitude_deg=first.begin[1],
        time=moment.replace(tzinfo=None).isoformat(),
    )
    part = np.linspace(0.0, 1.0, POINTS)
    duration = np.array([one.leg.duration for one in legs])
    since = np.array([one.leg.start for one in legs]) - first.leg.start
    time = since[:, None] + duration[:, None] * part
    begins = np.array([to_tangent_plane(*one.begin, *first.begin) for one in legs]).T
    ways = np.array([one.leg.through_water for one in legs]).T
    depth = np.stack([_depths(logs, one, part) for one in legs])
    found = np.zeros((len(legs), 2))
    for _ in range(2):  # along the way through the water, then along the way that the field makes
        north, east = (
            begin[:, None] + (way + duration * moved)[:, None] * part
            for begin, way, moved in zip(begins, ways, found.T, strict=True)
        )
        found = current.velocity(time, north, east, depth, origin)[..., :2].mean(axis=1)
    return [
        dataclasses.replace(
            one, leg=dataclasses.replace(one.leg, field=(float(mean[0]), float(mean[1])))
        )
        for one, mean in zip(legs, found, strict=True)
    ]


def _depths(logs: LogStore, one: LoggedLeg, part: Array) -> Array:
    """Measured depths [m] at parts of a leg, (part,); gaps are bridged."""
    depth = logs.signal("measured_depth", one.mission).astype(float)
    known = np.flatnonzero(np.isfinite(depth))
    if not known.size:
        return np.zeros(len(part))
    return np.interp(part * one.leg.duration / logs.period, known, np.maximum(depth[known], 0.0))


TRAIN_FRACTION = 0.4
"""[1] of the legs of a deployment that parameters are learned from"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DeploymentHindcast:
    """One deployment."""

    name: str
    store: Path
    latitude: float
    """[degree] for which the inertial frequency is taken"""
    dives: int
    """Dives in the store, those without two fixes or a known way through the water too"""
    legs: tuple[LoggedLeg, ...]
    train: int
    """Legs that parameters were learned from"""
    tuned: Tuned
    surfacings: tuple[HindcastSurfacing, ...]
    """One for each leg"""
    scores: Scores


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hindcast:
    """Of all deployments of some stores."""

    deployments: tuple[DeploymentHindcast, ...]
    train_fraction: float
    scores: Scores
    """of all scored surfacings together"""


def hindcast(
    stores: Sequence[str | Path],
    *,
    train_fraction: float = TRAIN_FRACTION,
    vehicle: str | None = None,
    current: Current | None = None,
    advance: Callable[[], object] = lambda: None,
) -> Hindcast:
    """Walk through every deployment of some stores of logs.

    Args:
      stores: paths of stores that `factory import` wrote.
      train_fraction: part of each deployment's legs, at its beginning, that parameters are learned
        from; the rest is scored. 0: nothing is learned, the prior's parameters are taken.
      vehicle: flight model for the way through the water, a file or a shipped name; by default that
        of depth rate and pitch, and where these are not logged the vehicle's reported current.
      current: forecast field that is known ahead; what of it counts is learned, too.
      advance: called once for each deployment that is done.

    Raises:
      CurrentError: the field does not cover a deployment.
      StoreError: no store of logs, or none of its dives has two fixes and a way through the water.
      InputError: a fraction that is not from 0 to below 1, no store, or the same dives twice.
      VehicleError: no such vehicle.
    """
    if not stores:
        raise InputError("name at least one store of logs")
    if not 0.0 <= train_fraction < 1.0:
        raise InputError(
            f"a training fraction of {train_fraction:g}; it must be from 0 to below 1, so that "
            "some of the dives are left to score"
        )
    paths = [Path(path) for path in stores]
    for k, path in enumerate(paths):
        if path.resolve() in [before.resolve() for before in paths[:k]]:
            raise InputError(f"{path} is named twice: its dives would count double, name it once")
    found: list[DeploymentHindcast] = []
    for path in paths:
        for one in _store(path, train_fraction, vehicle, current, advance):
            _check_new(one, found)
            found.append(one)
    return Hindcast(
        deployments=tuple(found),
        train_fraction=train_fraction,
        scores=scores_of([one.surfacings for one in found]),
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


def _store(
    path: Path,
    train_fraction: float,
    vehicle: str | None,
    current: Current | None,
    advance: Callable[[], object],
) -> list[DeploymentHindcast]:
    with LogStore(path) as logs:
        flown = None if vehicle is None else flown_velocities(path, vehicle)
        found = []
        for name in dict.fromkeys(logs.deployments):
            legs = legs_of(logs, name, flown)
            if current is not None:
                legs = with_field(logs, legs, current)
            if legs:
                dives = len(logs.missions_of(name))
                found.append(_deployment(name, path, dives, legs, train_fraction))
            advance()
    if not found:
        raise StoreError(
            f"store {path}: no dive has GPS fixes at both ends and a known way through the water "
            "(pitch and heading, or the vehicle's reported current): nothing can be forecast"
        )
    return found


def _deployment(
    name: str, path: Path, dives: int, legs: Sequence[LoggedLeg], train_fraction: float
) -> DeploymentHindcast:
    latitude = float(np.median([one.begin[0] for one in legs]))
    train = int(train_fraction * len(legs))
    tuned = tune([one.leg for one in legs[:train]], latitude=latitude)
    if not train and legs[0].leg.field is not None:  # taken as it is: nothing is learned
        tuned = dataclasses.replace(
            tuned, parameters=dataclasses.replace(tuned.parameters, field=1.0)
        )
    surfacings = walk(legs, tuned.parameters, latitude=latitude, train=train)
    return DeploymentHindcast(
        name=name,
        store=path,
        latitude=latitude,
        dives=dives,
        legs=tuple(legs),
        train=train,
        tuned=tuned,
        surfacings=tuple(surfacings),
        scores=scores_of([surfacings]),
    )
