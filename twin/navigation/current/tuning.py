"""Tuning: legs between fixes, and the parameters of a current under which they are likeliest.

The likelihood of a filter's innovations (Schweppe 1965, IEEE Trans. Inf. Theory 11), with Student's
t in place of the normal distribution, so that a front crossed once does not set the scale, times
the prior of `parameters`. A forecast field counts as far as it makes the fixes more likely, and not
at all where they are more likely without it. Persistence is a special case with one parameter; it
is taken where it is the more likely of the two: the prior of the rest is what the larger model pays
for its freedom.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Sequence

import numpy as np

from twin.errors import InputError
from twin.navigation.current.current_parameters import (
    DEGREES,
    FIELD,
    FIELD_SPREAD,
    MOST_FIELD,
    CurrentParameters,
    chosen_constituents,
    likely_logarithms,
    parameters_of,
    prior_cost,
)
from twin.navigation.current.filter import CurrentFilter
from twin.navigation.current.modes import Innovation
from twin.numbers import Array

MOST_STEPS = 30
"""of the search; the likelihood is flat beyond what a few dozen dives can tell"""
FEWEST = 8
"""Legs of one record below which only the scale of the currents is sought, and what single dives
add where records have so many together; the rest is the prior's"""
WANDER, WANDER_SPREAD = 0.14, 1.0
"""[m/s] in a day: prior of persistence, 0.05 m/s in three hours, and spread of its logarithm"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Leg:
    """One dive between two fixes."""

    start: float
    """[s] of the fix before, on the clock of the deployment"""
    duration: float
    """[s] to the fix after"""
    over_ground: tuple[float, float]
    """North, east [m] from fix to fix"""
    through_water: tuple[float, float] | None
    """North, east [m]; None where it is not known"""
    field: tuple[float, float] | None = None
    """North, east [m/s], mean over the leg, that a forecast field foretells; None without"""

    @property
    def end(self) -> float:
        """[s] of the fix after"""
        return self.start + self.duration

    @property
    def velocity(self) -> Array | None:
        """North, east through the water [m/s], mean over the leg, (2,); None without."""
        return None if self.through_water is None else np.array(self.through_water) / self.duration

    @property
    def current(self) -> Array:
        """North, east [m/s], mean over the leg, (2,); NaN where it is not known."""
        through = (math.nan, math.nan) if self.through_water is None else self.through_water
        return (np.array(self.over_ground) - np.array(through)) / self.duration

    def foretold(self, parameters: CurrentParameters) -> Array:
        """North, east [m/s] of the field as far as it is believed, (2,); 0 without."""
        return parameters.field * np.array((0.0, 0.0) if self.field is None else self.field)


def begin_leg(filter_: CurrentFilter, leg: Leg) -> None:
    """Bring a filter to the fix before a leg; positions count from there."""
    if leg.start > filter_.time:
        filter_.step(leg.start - filter_.time, None)
    filter_.locate((0.0, 0.0))


def pass_leg(
    filter_: CurrentFilter, leg: Leg, covariance: Array | None = None
) -> Innovation | None:
    """Let a filter make a leg, which it has begun, and take the fix after it.

    covariance: [m2/s2], (2, 2), of the velocity through the water, mean over the leg.
    """
    field = leg.foretold(filter_.parameters)
    filter_.step(leg.duration, leg.velocity, covariance, field=field)
    return filter_.fix(leg.over_ground)


def replay(
    filter_: CurrentFilter, legs: Iterable[Leg], covariance: Array | None = None
) -> Sequence[Innovation]:
    """Innovations of a filter at the fixes of legs in order of time; `covariance` as `pass_leg`."""
    found = []
    for leg in legs:
        begin_leg(filter_, leg)
        found.append(pass_leg(filter_, leg, covariance))
    return [innovation for innovation in found if innovation is not None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tuned:
    """Parameters that a training part makes likeliest."""

    parameters: CurrentParameters
    cost: float
    """Negative logarithm of likelihood and prior of the chosen parameters, without constants"""
    persistence_cost: float
    """Negative logarithm for persistence"""
    legs: int
    """Legs that had a say"""


def tune(
    legs: Sequence[Leg],
    *,
    latitude: float,
    others: Sequence[Sequence[Leg]] = (),
    speed_scale: float = CurrentParameters.speed_scale,
    compass: float = CurrentParameters.compass,
    may_persist: bool = True,
) -> Tuned:
    """The most likely parameters; the prior's centre where no leg tells anything.

    Constituents of the tide are those that the longest record can tell apart.

    Args:
      legs: of the training part, in order of time.
      latitude: [degree]
      others: legs of other records in the same waters, each in order of time.
      speed_scale: [1] of the relative error of the speed through the water.
      compass: [degree] of the compass' offset.
      may_persist: whether persistence may be chosen: it says nothing of what happens in a dive.

    Raises:
      InputError: legs that are not in order of time.
    """
    from scipy.optimize import minimize

    records = [list(record) for record in (legs, *others) if record]
    for record in records:
        for k, (one, after) in enumerate(itertools.pairwise(record)):
            if after.start < one.end - 1.0:
                raise InputError(
                    f"leg {k + 1} begins {one.end - after.start:.0f} s before leg {k} ends: sort "
                    "them by time, and tune each deployment on its own"
                )
    longest = max(records, key=len, default=[])
    constituents = constituents_of(longest)
    start = likely_logarithms()

    def filled(sought: Array) -> Array:
        """All logarithms, the first of them sought."""
        return np.concatenate([sought, start[len(sought) :]])

    def parameters_at(sought: Array, field: float) -> CurrentParameters:
        found = parameters_of(filled(sought), constituents)
        return dataclasses.replace(found, speed_scale=speed_scale, compass=compass, field=field)

    def cost(sought: Array, field: float) -> float:
        found = parameters_at(sought, field)
        return surprise(found, records, latitude) + prior_cost(filled(sought))

    def cost_beside_field(sought: Array) -> float:
        """The part that counts of the field, and the logarithms."""
        away = (float(sought[0]) - FIELD) / FIELD_SPREAD
        return cost(sought[1:], float(sought[0])) + 0.5 * away**2

    def persistence_cost(logarithm: Array) -> float:
        parameters = CurrentParameters.persistence(math.exp(float(logarithm[0])))
        away = (float(logarithm[0]) - math.log(WANDER)) / WANDER_SPREAD
        return surprise(parameters, records, latitude) + 0.5 * away**2

    count = sum(len(record) for record in records)
    many = len(start) if len(longest) >= FEWEST else 2 if count >= FEWEST else 1
    options = {"maxiter": MOST_STEPS}
    found = minimize(cost, start[:many], args=(0.0,), method="L-BFGS-B", options=options)
    logarithms, field, chosen = found.x, 0.0, float(found.fun)
    if any(leg.field is not None for record in records for leg in record):
        limits = [(0.0, MOST_FIELD), *[(None, None)] * many]
        beside = minimize(
            cost_beside_field, np.concatenate([[FIELD], found.x]), method="L-BFGS-B",
            bounds=limits, options=options,
        )  # fmt: skip
        if beside.fun < chosen:
            logarithms, field, chosen = beside.x[1:], float(beside.x[0]), float(beside.fun)
    simple = minimize(persistence_cost, [math.log(WANDER)], method="L-BFGS-B", options=options)
    parameters = parameters_at(logarithms, field)
    if may_persist and simple.fun < chosen:
        chosen = float(simple.fun)
        parameters = CurrentParameters.persistence(math.exp(float(simple.x[0])))
    return Tuned(
        parameters=parameters,
        cost=chosen,
        persistence_cost=float(simple.fun),
        legs=sum(leg.through_water is not None for record in records for leg in record),
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
    parameters: CurrentParameters, records: Sequence[Sequence[Leg]], latitude: float
) -> float:
    """Negative log-likelihood of the fixes of the legs of some records, without constants.

    Innovations are currents, displacements by their durations, with Student's t of two dimensions.
    """
    total = 0.0
    for legs in records:
        cost, filter_ = 0.0, CurrentFilter(parameters, latitude=latitude, time=legs[0].start)
        for one in replay(filter_, legs):
            _, volume = np.linalg.slogdet(one.covariance / one.duration**2)
            tail = 0.5 * (DEGREES + 2.0) * math.log1p(one.distance / DEGREES)
            cost += 0.5 * float(volume) + tail
        total += cost
    return total
