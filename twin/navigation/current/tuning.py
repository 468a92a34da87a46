"""Tune: the parameters of a current by the most likely surprises at the fixes of a training part.

The likelihood of a filter's innovations (Schweppe 1965, IEEE Trans. Inf. Theory 11), with Student's
t in place of the normal distribution, so that a front crossed once does not set the scale, times
the prior of `parameters`. Persistence is a special case with one parameter; it is taken where it is
the more likely of the two: the prior of the rest is what the larger model pays for its freedom.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.navigation.current.constituents import chosen_constituents
from twin.navigation.current.filter import CurrentFilter, Innovation
from twin.navigation.current.leg import Leg, replay
from twin.navigation.current.parameters import (
    CurrentParameters,
    likely_logarithms,
    parameters_of,
    prior_cost,
)

Array = NDArray[np.float64]

DEGREES = 5.0
"""[1] of freedom of Student's t: as heavy as the tails of currents' changes are"""
MOST_STEPS = 30
"""of the search; the likelihood is flat beyond what a few dozen dives can tell"""
FEWEST = 8
"""Legs below which only the scale of the currents is sought, and the rest is the prior's"""
WANDER, WANDER_SPREAD = 0.14, 1.0
"""[m/s] in a day: prior of persistence, 0.05 m/s in three hours, and spread of its logarithm"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tuned:
    """What a training part says."""

    parameters: CurrentParameters
    cost: float
    """Negative logarithm of likelihood and prior of the chosen parameters, without constants"""
    persistence_cost: float
    """The same of persistence"""
    legs: int
    """that had a surprise to count"""


def tune(
    legs: Sequence[Leg],
    *,
    latitude: float,
    constituents: Sequence[str] | None = None,
) -> Tuned:
    """The most likely parameters; the prior's centre where no leg tells anything.

    Args:
      legs: of the training part, in order of time.
      latitude: [degree]
      constituents: of the tide; by default those that the record can tell apart.

    Raises:
      InputError: legs that are not in order of time.
    """
    from scipy.optimize import minimize

    check_order(legs)
    if constituents is None:
        constituents = constituents_of(legs)

    def cost(sought: Array) -> float:
        logarithms = start.copy()
        logarithms[: len(sought)] = sought
        parameters = parameters_of(logarithms, constituents)
        return surprise(parameters, legs, latitude)[0] + prior_cost(logarithms)

    def persistence_cost(logarithm: Array) -> float:
        parameters = CurrentParameters.persistence(math.exp(float(logarithm[0])))
        away = (float(logarithm[0]) - math.log(WANDER)) / WANDER_SPREAD
        return surprise(parameters, legs, latitude)[0] + 0.5 * away**2

    start = likely_logarithms()
    many = len(start) if len(legs) >= FEWEST else 1
    found = minimize(cost, start[:many], method="L-BFGS-B", options={"maxiter": MOST_STEPS})
    simple = minimize(
        persistence_cost, [math.log(WANDER)], method="L-BFGS-B", options={"maxiter": MOST_STEPS}
    )
    start[:many] = found.x
    parameters = parameters_of(start, constituents)
    if simple.fun < found.fun:
        parameters = CurrentParameters.persistence(math.exp(float(simple.x[0])))
    return Tuned(
        parameters=parameters,
        cost=float(min(found.fun, simple.fun)),
        persistence_cost=float(simple.fun),
        legs=surprise(parameters, legs, latitude)[1],
    )


def constituents_of(legs: Sequence[Leg]) -> tuple[str, ...]:
    """Names of the constituents that legs can tell apart."""
    if not legs:
        return chosen_constituents(0.0, 0.0)
    hours = (legs[-1].end - legs[0].start) / 3600.0
    starts = np.array([leg.start for leg in legs])
    usual = float(np.median(np.diff(starts))) if len(legs) > 1 else legs[0].duration
    return chosen_constituents(hours, usual / 3600.0)


def surprise(
    parameters: CurrentParameters, legs: Sequence[Leg], latitude: float
) -> tuple[float, int]:
    """Negative log-likelihood of the fixes of legs, without constants, and how many counted."""
    if not legs:
        return 0.0, 0
    filter_ = CurrentFilter(parameters, latitude=latitude, time=legs[0].start)
    found = replay(filter_, legs)
    return sum(_one(innovation) for innovation in found), len(found)


def _one(innovation: Innovation) -> float:
    """Of Student's t of two dimensions, the displacement by its duration: a current."""
    spread = innovation.covariance / innovation.duration**2
    _, volume = np.linalg.slogdet(spread)
    tail = 0.5 * (DEGREES + 2.0) * math.log1p(innovation.distance / DEGREES)
    return 0.5 * float(volume) + tail


def check_order(legs: Sequence[Leg]) -> None:
    """Raise InputError where a leg begins before the one before it has ended."""
    for k, (one, after) in enumerate(itertools.pairwise(legs)):
        if after.start < one.end - 1.0:
            raise InputError(
                f"leg {k + 1} begins {one.end - after.start:.0f} s before leg {k} ends: sort them "
                "by time, and tune each deployment on its own"
            )
