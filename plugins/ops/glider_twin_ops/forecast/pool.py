"""Pool: forecasts of several models, weighted by the likelihood of the observed values.

Each observed value multiplies a model's weight by its likelihood under the model's forecast. Old
values are forgotten (dynamic model averaging: Raftery, Karny and Ettler 2010, Technometrics 52).
The forecast is a mixture of one Student's t distribution a model; with its heavy tails a single
outlier hardly moves the weights. The scale of each model's errors is estimated robustly, from a
prior that counts as a number of errors, with the same forgetting.

`CurrentPool` has simple models of the mean current over the next dive; `expected_dive` has others.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError
from twin.navigation.current import (
    CONSTITUENTS,
    CurrentFilter,
    CurrentParameters,
    Leg,
    begin_leg,
    pass_leg,
)
from twin.numbers import Array

FREEDOM = 5.0
"""[1] Degrees of freedom of Student's t: changes of a current have such heavy tails"""
FORGETTING = 0.95
"""[1] Factor of a weight's logarithm, and of the count of errors behind a scale, at each value:
about the last twenty values count"""
TEMPER = 0.5
"""[1] Exponent of a likelihood: errors of successive values correlate, so two count as one"""
COUNTED = 4.0
"""[1] Number of errors that the prior of a scale counts as"""
LEAST = 1e-4
"""[1] Fraction of the prior that is mixed into the weights, so that a model can regain weight"""


class Prior(NamedTuple):
    """Prior of one model, before the first value of a deployment."""

    weight: float
    """[1] relative weight; the weights of a pool need not add up to 1"""
    scale: float
    """scale of the errors; it multiplies the root of the model's own covariance (`shapes`)"""


@dataclasses.dataclass(frozen=True, eq=False)
class Mixture:
    """Forecast of several numbers: a mixture of the models that have a forecast."""

    names: tuple[str, ...]
    weights: Array
    """[1] (model,), adding up to 1"""
    means: Array
    """(model, number)"""
    covariances: Array
    """(model, number, number)"""

    @functools.cached_property
    def mean(self) -> Array:
        """(number,)"""
        return np.asarray(self.weights @ self.means)

    @functools.cached_property
    def covariance(self) -> Array:
        """Covariance within the models plus that between their means, (number, number)."""
        apart = self.means - self.mean
        within = np.einsum("m,mij->ij", self.weights, self.covariances)
        return np.asarray(within + np.einsum("m,mi,mj->ij", self.weights, apart, apart))

    def draw(self, count: int, freedom: float, rng: np.random.Generator) -> Array:
        """Sample the mixture, (draw, number): a model by its weight, then an error by Student's t
        of `freedom` degrees with the model's covariance."""
        taken = rng.choice(len(self.weights), size=count, p=self.weights)
        heavy = np.sqrt((freedom - 2.0) / rng.chisquare(freedom, count))
        roots = np.linalg.cholesky(self.covariances)
        normal = rng.standard_normal((count, self.means.shape[1]))
        error = np.einsum("mij,mj->mi", roots[taken], normal)
        return np.asarray(self.means[taken] + heavy[:, None] * error)


class Pool:
    """Weights and scales of several models, learned from every observed value.

    pool = Pool({"persistence": Prior(1.0, 0.1), "mean": Prior(1.0, 0.1)})
    ahead = pool.expect([[0.1, 0.0], [0.2, 0.1]])
    pool.learn([0.12, 0.01])

    Args:
      priors: prior of each model, by the model's name.
      freedom: [1] degrees of freedom of Student's t, above 2.
      counted: [1] number of errors that the prior of a scale counts as.
      forgetting: [1] see `FORGETTING`.

    Raises:
      InputError: no model, or a weight or scale that is not positive.
    """

    def __init__(
        self,
        priors: Mapping[str, Prior],
        *,
        freedom: float = FREEDOM,
        counted: float = COUNTED,
        forgetting: float = FORGETTING,
    ):
        if not priors:
            raise InputError("a pool needs at least one model")
        for name, (weight, scale) in priors.items():
            if not (weight > 0.0 and scale > 0.0):
                raise InputError(
                    f"model {name} has weight {weight:g} and scale {scale:g}; both "
                    "must be positive: leave out a model that shall not count"
                )
        self.names = tuple(priors)
        self.freedom, self.forgetting = freedom, forgetting
        weights = np.array([prior.weight for prior in priors.values()])
        self._prior = weights / weights.sum()
        self._logarithms = np.log(self._prior)
        self._squares = counted * np.array([prior.scale for prior in priors.values()]) ** 2
        self._count = np.full(len(self.names), counted)
        self._asked: tuple[Array, Array, NDArray[np.bool_]] | None = None

    @property
    def weights(self) -> dict[str, float]:
        """[1] Weight of every model now; they add up to 1."""
        return dict(zip(self.names, _normalised(self._logarithms).tolist(), strict=True))

    @property
    def scales(self) -> dict[str, float]:
        """Scale of every model's errors now."""
        return dict(zip(self.names, np.sqrt(self._squares / self._count).tolist(), strict=True))

    def expect(self, means: ArrayLike, shapes: ArrayLike | None = None) -> Mixture:
        """Mix the models' forecasts.

        Args:
          means: (model, number); NaN in the row of a model that has no forecast now.
          shapes: covariance of errors of scale 1, (model, number, number); None: the unit matrix.

        Raises:
          InputError: no model has a forecast.
        """
        said = np.asarray(means, float)
        known = np.isfinite(said).all(axis=1)
        if not known.any():
            raise InputError("none of the pool's models says anything")
        size = said.shape[1]
        shape = np.tile(np.eye(size), (len(said), 1, 1)) if shapes is None else np.asarray(shapes)
        spread = (self._squares / self._count)[:, None, None] * shape
        self._asked = said, spread, known
        wider = self.freedom / (self.freedom - 2.0)
        return Mixture(
            names=tuple(name for name, there in zip(self.names, known, strict=True) if there),
            weights=_normalised(self._logarithms[known]),
            means=said[known],
            covariances=wider * spread[known],
        )

    def learn(self, value: ArrayLike) -> Array:
        """Learn from the value, (number,), that was observed after the last forecast.

        Returns:
          Posterior weight of each model for this value, (model,); 0 for a model without a forecast.

        Raises:
          InputError: there was no forecast before.
        """
        if self._asked is None:
            raise InputError("a pool learns from what it was asked before: call expect first")
        means, spread, known = self._asked
        self._asked = None
        missed = np.asarray(value, float) - means[known]
        size = missed.shape[1]
        whitened = np.linalg.solve(spread[known], missed[..., None])[..., 0]
        distance = np.einsum("mi,mi->m", missed, whitened)
        _, volume = np.linalg.slogdet(spread[known])
        tail = 0.5 * (self.freedom + size) * np.log1p(distance / self.freedom)
        likely = -0.5 * volume - tail
        explained = np.zeros(len(known))
        explained[known] = _normalised(self._logarithms[known] + likely)
        moved = self._logarithms.copy()
        before = _log_sum(moved[known])
        moved[known] = self.forgetting * moved[known] + TEMPER * likely
        moved[known] += before - _log_sum(moved[known])  # weights without a forecast stay
        kept = (1.0 - LEAST) * _normalised(moved) + LEAST * self._prior
        self._logarithms = np.log(kept)
        doubt = (self.freedom + size) / (self.freedom + distance)
        error = doubt * distance * (self._squares / self._count)[known] / size
        self._squares[known] = self.forgetting * self._squares[known] + error
        self._count[known] = self.forgetting * self._count[known] + 1.0
        return explained


def _log_sum(logarithms: Array) -> float:
    most = float(logarithms.max())
    return most + math.log(float(np.exp(logarithms - most).sum()))


def _normalised(logarithms: Array) -> Array:
    return np.asarray(np.exp(logarithms - _log_sum(logarithms)))


HOUR, DAY = 3600.0, 86400.0
NOTHING = np.full(2, np.nan)
PERSISTENCE, MEAN, TIDE, FILTER = "persistence", "mean of three", "tidal fit", "filter"
FIELD, BESIDE = "field", "filter beside the field"
CURRENT_PRIORS: Mapping[str, Prior] = {
    PERSISTENCE: Prior(0.17, 0.07),
    MEAN: Prior(0.09, 0.075),
    TIDE: Prior(0.11, 0.07),
    FILTER: Prior(0.71, 0.82),
    FIELD: Prior(0.5, 0.1),
    BESIDE: Prior(0.5, 1.0),
}
"""Prior of each model, learned over deployments (`python -m benchmarks.surfacings`): scale in m/s,
or in a filter's own standard deviations. The priors of the two models with a field are assumed."""
LAST = {PERSISTENCE: 1, MEAN: 3}
"""Number of last dives whose mean current a model forecasts"""
TIDAL_DAYS, FEWEST = 2.0, 6
"""TIDAL_DAYS: [d] record of a tidal fit. FEWEST: dives below which only the mean is fitted"""


class CurrentPool:
    """Models of the mean current over a dive: last dives, tide, filter, forecast field.

    pool = CurrentPool(latitude=31.5, time=legs[0].start)
    for leg in legs:
        ahead = pool.expect(leg)   # ahead.mean: north, east [m/s]
        pool.learn(leg)

    Args:
      latitude: [degree] of the deployment.
      time: [s] begin of the deployment, on the legs' clock.
      field: True if the legs hold a forecast field's current.
      priors: by the models' names.
    """

    def __init__(
        self,
        *,
        latitude: float,
        time: float,
        field: bool = False,
        priors: Mapping[str, Prior] = CURRENT_PRIORS,
    ):
        follows = {FILTER: 0.0, BESIDE: 1.0} if field else {FILTER: 0.0}
        self.filters = {
            name: CurrentFilter(CurrentParameters(field=part), latitude=latitude, time=time)
            for name, part in follows.items()
        }
        """Current filters by model; with a field, a filter follows current minus field"""
        names = [one for one in CURRENT_PRIORS if field or one not in (FIELD, BESIDE)]
        self.pool = Pool({name: priors[name] for name in names})
        self._legs: list[Leg] = []

    def alone(self, name: str, leg: Leg) -> tuple[Array, Array]:
        """Mean current over a leg that begins now, by one model, with its covariance.

        Args:
          leg: start, duration, displacement through the water and field; `over_ground` is not read.

        Returns:
          North, east [m/s], (2,), NaN while the model has no forecast, and a covariance (2, 2) of
          scale 1, which the pool scales. A filter's covariance has errors of speed and compass.
        """
        if name in self.filters:
            filter_ = self.filters[name]
            begin_leg(filter_, leg)
            field = leg.foretold(filter_.parameters)
            ahead = filter_.forecast([leg.end], leg.velocity, field=field)
            spread = ahead.displacement_covariance[0] / filter_.inflation
            return ahead.displacement[0] / leg.duration, spread / leg.duration**2
        if name == FIELD:
            mean = NOTHING if leg.field is None else np.array(leg.field)
        elif name == TIDE:
            mean = tidal_fit(self._legs, leg, TIDAL_DAYS)
        else:
            last = [one.current for one in self._legs[-LAST[name] :]]
            mean = np.mean(last, axis=0) if last else NOTHING
        return mean, np.eye(2)

    def expect(self, leg: Leg) -> Mixture:
        """Forecast the mean current [m/s] over a leg that begins now, by all models."""
        means, shapes = zip(*(self.alone(name, leg) for name in self.pool.names), strict=True)
        return self.pool.expect(np.array(means), np.array(shapes))

    def learn(self, leg: Leg) -> Array:
        """Learn from a leg that has ended; returns each model's posterior weight for it."""
        self.expect(dataclasses.replace(leg, over_ground=(math.nan, math.nan)))
        part = self.pool.learn(leg.current)
        self._legs.append(leg)
        for filter_ in self.filters.values():
            begin_leg(filter_, leg)
            pass_leg(filter_, leg)
        return part


def tidal_fit(legs: Sequence[Leg], ahead: Leg, days: float) -> Array:
    """Mean current [m/s] over a leg, (2,): mean and M2, fitted to the legs of the last days.

    Fewer than `FEWEST` legs, or legs within one period of M2, give their mean; no legs give NaN.
    """
    recent = [one for one in legs if one.start >= ahead.start - days * DAY]
    if not recent:
        return NOTHING
    period = CONSTITUENTS["M2"].period * HOUR
    enough = len(recent) >= FEWEST and recent[-1].end - recent[0].start >= period
    turn = 2.0 * math.pi / period if enough else 0.0
    rows = np.array([_means(one, turn, ahead.start) for one in recent])
    fitted, *_ = np.linalg.lstsq(rows, np.array([one.current for one in recent]), rcond=None)
    return np.asarray(_means(ahead, turn, ahead.start) @ fitted)


def _means(leg: Leg, turn: float, origin: float) -> Array:
    """Means of 1, cosine, sine over a leg, at a rate [rad/s] since a time [s]; rate 0: 1 alone."""
    if turn == 0.0:
        return np.ones(1)
    begin, end, over = turn * np.array([leg.start - origin, leg.end - origin, leg.duration])
    sine, cosine = math.sin(end) - math.sin(begin), math.cos(begin) - math.cos(end)
    return np.array([1.0, sine / over, cosine / over])
