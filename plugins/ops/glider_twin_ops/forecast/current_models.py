"""Models: forecasts of the current of the next dive, each by one simple idea, and their pool.

A model says before a dive what the mean current over it will be, and learns from the dive when its
fix has come. `CurrentPool` mixes them by what they were worth so far (`pool`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from glider_twin_ops.forecast.pool import Mixture, Pool, Prior
from twin.navigation.current import (
    CONSTITUENTS,
    CurrentFilter,
    CurrentParameters,
    Leg,
    begin_leg,
    pass_leg,
)
from twin.numbers import Array

HOUR, DAY = 3600.0, 86400.0
NOTHING = np.full(2, np.nan)


class CurrentModel(Protocol):
    """One idea of the current."""

    def expect(self, leg: Leg) -> tuple[Array, Array]:
        """The mean current over a leg that begins now, and how its error spreads.

        Args:
          leg: its start, duration, way through the water and field; its `over_ground` is not read.

        Returns:
          North, east [m/s], (2,), NaN while the model has nothing to say, and a matrix (2, 2) that
          the pool scales.
        """

    def learn(self, leg: Leg) -> None:
        """Take a leg whose fix has come."""


class RecentMean:
    """The mean current of the last dives; of the last one: persistence."""

    def __init__(self, dives: int):
        self.dives = dives
        self._currents: list[Array] = []

    def expect(self, leg: Leg) -> tuple[Array, Array]:
        """See `CurrentModel`."""
        mean = np.mean(self._currents, axis=0) if self._currents else NOTHING
        return mean, np.eye(2)

    def learn(self, leg: Leg) -> None:
        """See `CurrentModel`."""
        self._currents = [*self._currents, leg.current][-self.dives :]


class TidalFit:
    """Mean and M2 by least squares over the dives of the last days, and nothing else.

    Until the dives of that time are `FEWEST` and span a period of M2: their mean alone.
    """

    FEWEST = 6

    def __init__(self, days: float):
        self.days = days
        self._legs: list[Leg] = []

    def expect(self, leg: Leg) -> tuple[Array, Array]:
        """See `CurrentModel`."""
        recent = [one for one in self._legs if one.start >= leg.start - self.days * DAY]
        if not recent:
            return NOTHING, np.eye(2)
        period = CONSTITUENTS["M2"].period * HOUR
        enough = len(recent) >= self.FEWEST and recent[-1].end - recent[0].start >= period
        turn = 2.0 * math.pi / period if enough else 0.0
        rows = np.array([_means(one, turn, leg.start) for one in recent])
        fitted, *_ = np.linalg.lstsq(rows, np.array([one.current for one in recent]), rcond=None)
        return np.asarray(_means(leg, turn, leg.start) @ fitted), np.eye(2)

    def learn(self, leg: Leg) -> None:
        """See `CurrentModel`."""
        self._legs = [one for one in self._legs if one.start >= leg.start - self.days * DAY]
        self._legs.append(leg)


def _means(leg: Leg, turn: float, origin: float) -> Array:
    """Over a leg the means of 1, cosine and sine at a rate [rad/s] since a time [s]; rate 0: 1."""
    if turn == 0.0:
        return np.ones(1)
    begin, end = turn * (leg.start - origin), turn * (leg.end - origin)
    over = turn * leg.duration
    return np.array(
        [1.0, (math.sin(end) - math.sin(begin)) / over, (math.cos(begin) - math.cos(end)) / over]
    )


class Filtered:
    """A current filter with the prior's parameters; beside a field it follows what that lacks."""

    def __init__(self, latitude: float, time: float, *, field: float = 0.0):
        parameters = dataclasses.replace(CurrentParameters(), field=field)
        self.filter_ = CurrentFilter(parameters, latitude=latitude, time=time)

    def expect(self, leg: Leg) -> tuple[Array, Array]:
        """See `CurrentModel`; the way's errors of speed and compass are part of it."""
        begin_leg(self.filter_, leg)
        field = leg.foretold(self.filter_.parameters)
        ahead = self.filter_.forecast([leg.end], leg.velocity, field=field)
        spread = ahead.displacement_covariance[0] / self.filter_.inflation
        return ahead.displacement[0] / leg.duration, spread / leg.duration**2

    def learn(self, leg: Leg) -> None:
        """See `CurrentModel`."""
        begin_leg(self.filter_, leg)
        pass_leg(self.filter_, leg)


class Foretold:
    """A forecast field as it is."""

    def expect(self, leg: Leg) -> tuple[Array, Array]:
        """See `CurrentModel`."""
        return NOTHING if leg.field is None else np.array(leg.field), np.eye(2)

    def learn(self, leg: Leg) -> None:
        """See `CurrentModel`."""


PERSISTENCE, MEAN, TIDE, FILTER = "persistence", "mean of three", "tidal fit", "filter"
FIELD, BESIDE = "field", "filter beside the field"
PRIORS: Mapping[str, Prior] = {
    PERSISTENCE: Prior(0.17, 0.07),
    MEAN: Prior(0.09, 0.075),
    TIDE: Prior(0.11, 0.07),
    FILTER: Prior(0.71, 0.82),
    FIELD: Prior(0.5, 0.1),
    BESIDE: Prior(0.5, 1.0),
}
"""Of each model, as deployments have them in common (`python -m benchmarks.surfacings`); scales in
m/s, of the filters in their own deviations. The two with a field are assumed."""


class CurrentPool:
    """The models together, of one deployment.

    pool = CurrentPool(latitude=31.5, time=legs[0].start)
    for leg in legs:
        ahead = pool.expect(leg)   # ahead.mean: north, east [m/s]
        pool.learn(leg)

    Args:
      latitude: [degree] of the deployment.
      time: [s] at which it begins, on the legs' clock.
      field: whether legs say what a forecast field foretells.
      priors: of the models by name; by default those that deployments have in common.
    """

    def __init__(
        self,
        *,
        latitude: float,
        time: float,
        field: bool = False,
        priors: Mapping[str, Prior] = PRIORS,
    ):
        self.filtered = Filtered(latitude, time)
        self.models: dict[str, CurrentModel] = {
            PERSISTENCE: RecentMean(1),
            MEAN: RecentMean(3),
            TIDE: TidalFit(2.0),
            FILTER: self.filtered,
        }
        if field:
            self.models |= {FIELD: Foretold(), BESIDE: Filtered(latitude, time, field=1.0)}
        self.pool = Pool({name: priors[name] for name in self.models})

    def expect(self, leg: Leg) -> Mixture:
        """What the models together say of the mean current [m/s] over a leg that begins now."""
        said = [model.expect(leg) for model in self.models.values()]
        means, shapes = zip(*said, strict=True)
        return self.pool.expect(np.array(means), np.array(shapes))

    def learn(self, leg: Leg) -> Array:
        """Take a leg whose fix has come; returns the part of each model in explaining it."""
        self.expect(dataclasses.replace(leg, over_ground=(math.nan, math.nan)))
        part = self.pool.learn(leg.current)
        for model in self.models.values():
            model.learn(leg)
        return part
