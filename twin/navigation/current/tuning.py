"""Tuning: dives between fixes, maximum-likelihood parameters of a current, filter consistency.

The likelihood is that of a filter's innovations (Schweppe 1965, IEEE Trans. Inf. Theory 11), times
the prior of the parameters. Student's t replaces the normal distribution, so that a single front
does not set the scale. A forecast field gets a weight if the fixes are more likely with it, and
none otherwise. Persistence is a special case with one parameter; it is chosen if it is more likely.
In this comparison, the prior of the other parameters counts against the larger model.

A filter is consistent on records outside its tuning if two things hold (Bar-Shalom, Li and
Kirubarajan 2001, Estimation with Applications to Tracking and Navigation, section 5.4). The mean of
its squared innovations, normalised by the stated covariances, is 2; and its ellipses hold their
stated fractions of fixes. The ellipses assume no distribution: currents of many missions have a
narrower centre and wider tails than a normal or Student's t distribution of the same variance.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Self

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
"""Maximum number of search steps; after them, some dozen dives hardly raise the likelihood."""
FEWEST = 8
"""Minimum number of legs of one record for fitting all parameters. With as many legs in all
records, the scale and `dive` are fitted; with fewer, the scale. Other parameters keep the prior."""
WANDER, WANDER_SPREAD = 0.14, 1.0
"""Prior of persistence's `wander`. WANDER: [m/s] in a day. WANDER_SPREAD: [1] of its logarithm"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Leg:
    """Leg of one dive between two fixes."""

    start: float
    """[s] Time of the fix before the dive, on the clock of the deployment"""
    duration: float
    """[s] Time from the fix before to the fix after the dive"""
    over_ground: tuple[float, float]
    """North, east [m] displacement from fix to fix"""
    through_water: tuple[float, float] | None
    """North, east [m] displacement through the water; None if unknown"""
    field: tuple[float, float] | None = None
    """North, east [m/s] current of a forecast field, mean over the leg; None without a field"""

    @property
    def end(self) -> float:
        """[s] Time of the fix after the dive."""
        return self.start + self.duration

    @property
    def velocity(self) -> Array | None:
        """North, east through the water [m/s], mean over the leg, (2,); None if unknown."""
        return None if self.through_water is None else np.array(self.through_water) / self.duration

    @property
    def current(self) -> Array:
        """Current north, east [m/s], mean over the leg, (2,); NaN if unknown."""
        through = (math.nan, math.nan) if self.through_water is None else self.through_water
        return (np.array(self.over_ground) - np.array(through)) / self.duration

    def foretold(self, parameters: CurrentParameters) -> Array:
        """North, east [m/s] of the field times its weight, (2,); 0 without a field."""
        return parameters.field * np.array((0.0, 0.0) if self.field is None else self.field)


def begin_leg(filter_: CurrentFilter, leg: Leg) -> None:
    """Bring a filter to the fix before a leg; that fix is the origin of positions."""
    if leg.start > filter_.time:
        filter_.step(leg.start - filter_.time, None)
    filter_.locate((0.0, 0.0))


def pass_leg(
    filter_: CurrentFilter, leg: Leg, covariance: Array | None = None
) -> Innovation | None:
    """Step a filter over a leg after `begin_leg`, and update it with the fix after the leg.

    covariance: [m2/s2], (2, 2), of the velocity through the water, mean over the leg.
    """
    field = leg.foretold(filter_.parameters)
    filter_.step(leg.duration, leg.velocity, covariance, field=field)
    return filter_.fix(leg.over_ground)


def replay(
    filter_: CurrentFilter, legs: Iterable[Leg], covariance: Array | None = None
) -> Sequence[Innovation]:
    """Innovations at the fixes of legs in order of time; `covariance` as in `pass_leg`."""
    found = []
    for leg in legs:
        begin_leg(filter_, leg)
        found.append(pass_leg(filter_, leg, covariance))
    return [innovation for innovation in found if innovation is not None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tuned:
    """Maximum-likelihood parameters of a training set."""

    parameters: CurrentParameters
    cost: float
    """Negative log of likelihood times prior, for the chosen parameters, without constants"""
    persistence_cost: float
    """Negative log of likelihood times prior for persistence, without constants"""
    legs: int
    """Number of legs with a known displacement through the water"""


def tune(
    legs: Sequence[Leg],
    *,
    latitude: float,
    others: Sequence[Sequence[Leg]] = (),
    speed_scale: float = CurrentParameters.speed_scale,
    compass: float = CurrentParameters.compass,
    may_persist: bool = True,
) -> Tuned:
    """Fit the most likely parameters; without informative legs, return the prior's centre.

    The tidal constituents are those that the longest record can separate.

    Args:
      legs: legs of the training set, in order of time.
      latitude: [degree]
      others: legs of other records in the same waters, each in order of time.
      speed_scale: [1] standard deviation of the relative error of the speed through the water.
      compass: [degree] standard deviation of the compass' offset.
      may_persist: persistence may be chosen; it describes no current within a dive.

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
        """Logarithms of all parameters: the fitted ones, then the prior's."""
        return np.concatenate([sought, start[len(sought) :]])

    def parameters_at(sought: Array, field: float) -> CurrentParameters:
        found = parameters_of(filled(sought), constituents)
        return dataclasses.replace(found, speed_scale=speed_scale, compass=compass, field=field)

    def cost(sought: Array, field: float) -> float:
        found = parameters_at(sought, field)
        return surprise(found, records, latitude) + prior_cost(filled(sought))

    def cost_beside_field(sought: Array) -> float:
        """Cost of a vector with the field's weight first, then the logarithms."""
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
    """Names of the tidal constituents that legs can separate."""
    if not legs:
        return chosen_constituents(0.0, 0.0)
    hours = (legs[-1].end - legs[0].start) / 3600.0
    starts = np.array([leg.start for leg in legs])
    usual = float(np.median(np.diff(starts))) if len(legs) > 1 else legs[0].duration
    return chosen_constituents(hours, usual / 3600.0)


def surprise(
    parameters: CurrentParameters, records: Sequence[Sequence[Leg]], latitude: float
) -> float:
    """Compute the negative log-likelihood of the fixes of some records, without constants.

    Innovations are divided by durations to give currents; their distribution is a bivariate t.
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


PARTS = (0.5, 0.9)
"""[1] Fractions of the fixes that the two ellipses must hold"""
FOLLOWING = 0.3
"""[1] Step size for the log of an ellipse's squared distance after each fix, inside or outside"""
NORMAL_REACH = (1.386, 4.605)
"""[1] Squared distances for normal errors, -2 ln(1 - part), used without other records"""


class Reaches:
    """Squared distances of two ellipses, adapted so that each holds its fraction of fixes (adaptive
    conformal inference, Gibbs and Candes 2021, NeurIPS 34)."""

    def __init__(self, first: tuple[float, float] = NORMAL_REACH):
        self._logarithms = [math.log(value) for value in first]

    @classmethod
    def of(cls, distances: Iterable[float]) -> Self:
        """Start with ellipses that would have held their fractions of earlier fixes.

        The start is the k-th smallest of n squared distances, with k = (n + 1) part rounded up. A
        new distance is below it with that probability (split conformal prediction: Vovk, Gammerman
        and Shafer 2005, Algorithmic Learning in a Random World, section 4.2).

        Args:
          distances: [1] squared, of other records; if too few, the normal distribution's is used.
        """
        known = sorted(distances)
        first = []
        for part, usual in zip(PARTS, NORMAL_REACH, strict=True):
            place = math.ceil((len(known) + 1) * part)
            first.append(known[place - 1] if 0 < place <= len(known) else usual)
        return cls((first[0], first[1]))

    @property
    def now(self) -> tuple[float, float]:
        """Squared distances of the 50 and 90 % ellipses; the second is at least the first."""
        half, ninety = (math.exp(value) for value in self._logarithms)
        return half, max(half, ninety)

    def held(self, distance: float) -> tuple[bool, bool]:
        """True for each ellipse, 50 and 90 %, that holds a fix at this squared distance [1]."""
        half, ninety = self.now
        return distance <= half, distance <= ninety

    def learn(self, distance: float) -> None:
        """Adapt both ellipses to the squared distance [1] of a fix."""
        for k, (part, held) in enumerate(zip(PARTS, self.held(distance), strict=True)):
            self._logarithms[k] += FOLLOWING * (part - float(held))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Consistency:
    """Consistency statistics of the fixes after dives; None without any such fix."""

    fixes: int
    nis: float | None
    """[1] Mean normalised squared innovation; 2 for a consistent filter"""
    in_50: float | None
    """[1] Fraction of the fixes within the 50 % ellipse"""
    in_90: float | None
    first_dive_m: float | None
    """[m] Mean error of the prediction at the fix after a record's first dive"""
    first_dive_no_current_m: float | None
    """[m] Mean error at that fix of the track through the water alone"""
    later_m: float | None
    """[m] Mean error of the prediction at the fixes after later dives"""
    later_persistence_m: float | None
    """[m] Mean error at those fixes with the mean current of the previous dive"""


def consistency_of(
    records: Sequence[Sequence[Leg]],
    *,
    latitude: float,
    others: Sequence[Sequence[Leg]] = (),
    speed_scale: float = CurrentParameters.speed_scale,
    compass: float = CurrentParameters.compass,
    noise: float = 0.0,
    memory: float = 60.0,
) -> Consistency:
    """Test a filter on records of legs, each in order of time; legs of unknown motion are left out.

    Args:
      records: legs of missions or deployments in similar waters, each with its own current.
      latitude: [degree]
      others: records for tuning parameters and ellipses; by default each half of `records` is
        tested with the other half.
      speed_scale, compass: [1], [degree] as `tune` takes them.
      noise: [m/s] standard deviation, north and east each, of the velocity through the water.
      memory: [s] correlation time of that noise.

    Raises:
      InputError: legs that are not in order of time.
    """
    every_record, learned_from = (
        [
            known
            for legs in some
            if (known := [leg for leg in legs if leg.through_water is not None])
        ]
        for some in (records, others)
    )
    parts = [(learned_from, every_record)] if others else [
        (every_record[half::2], every_record[1 - half :: 2]) for half in (0, 1)
    ]  # fmt: skip

    def innovations_of(legs: Sequence[Leg], parameters: CurrentParameters) -> Sequence[Innovation]:
        filter_ = CurrentFilter(parameters, latitude=latitude, time=legs[0].start, memory=memory)
        return replay(filter_, legs, noise**2 * np.eye(2))

    results: list[tuple[Sequence[Leg], Sequence[Innovation]]] = []
    held: list[tuple[bool, bool]] = []
    for taught, judged in parts:
        parameters = tune(
            [], others=taught, latitude=latitude, speed_scale=speed_scale,
            compass=compass, may_persist=False,
        ).parameters  # fmt: skip
        distances = [one.normalised for legs in taught for one in innovations_of(legs, parameters)]
        for legs in judged:
            found, reaches = innovations_of(legs, parameters), Reaches.of(distances)
            results.append((legs, found))
            for one in found:
                held.append(reaches.held(one.normalised))
                reaches.learn(one.normalised)
    every = [one for _, innovations in results for one in innovations]
    first = [(legs[0], innovations[0]) for legs, innovations in results]
    later = [
        (legs[k - 1], legs[k], innovations[k])
        for legs, innovations in results
        for k in range(1, len(legs))
    ]
    return Consistency(
        fixes=len(every),
        nis=_mean([one.normalised for one in every]),
        in_50=_mean([half for half, _ in held]),
        in_90=_mean([ninety for _, ninety in held]),
        first_dive_m=_mean([_length(one.residual) for _, one in first]),
        first_dive_no_current_m=_mean([_length(leg.duration * leg.current) for leg, _ in first]),
        later_m=_mean([_length(one.residual) for *_, one in later]),
        later_persistence_m=_mean(
            [_length(leg.duration * (leg.current - before.current)) for before, leg, _ in later]
        ),
    )


def _length(metres: Array) -> float:
    return float(np.hypot(*metres))


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
