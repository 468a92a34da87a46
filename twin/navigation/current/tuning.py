"""Tuning: legs between fixes, a current's likeliest parameters, and the filter's consistency.

The likelihood of a filter's innovations (Schweppe 1965, IEEE Trans. Inf. Theory 11), with Student's
t in place of the normal distribution, so that a front crossed once does not set the scale, times
the prior of `parameters`. A forecast field counts as far as it makes the fixes more likely, and not
at all where they are more likely without it. Persistence is a special case with one parameter; it
is taken where it is the more likely of the two: the prior of the rest is what the larger model pays
for its freedom.

A filter is consistent when its squared innovations, normalised by their stated covariances, are 2
in the mean, and its ellipses hold what they shall (Bar-Shalom, Li and Kirubarajan 2001, Estimation
with Applications to Tracking and Navigation, section 5.4), on records that tuned nothing of it. No
law of the errors is assumed for the ellipses: currents of many missions are calmer in the middle
and wilder at the ends than a normal law or Student's t of the same variance.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple, Self

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


class Tuned(NamedTuple):
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


PARTS = (0.5, 0.9)
"""[1] of the fixes that the two ellipses shall hold"""
FOLLOWING = 0.3
"""[1] gain by which the logarithm of an ellipse's squared reach follows whether it held"""
NORMAL_REACH = (1.386, 4.605)
"""[1] of normal errors, -2 ln(1 - part): where no other record tells"""


class Reaches:
    """Squared distances of two ellipses, which follow how many fixes they held (adaptive conformal
    inference, Gibbs and Candes 2021, NeurIPS 34)."""

    def __init__(self, first: tuple[float, float] = NORMAL_REACH):
        self._logarithms = [math.log(value) for value in first]

    @classmethod
    def of(cls, distances: Iterable[float]) -> Self:
        """Begin where the ellipses would have held their parts of earlier fixes.

        The k-th smallest of n squared distances, k the whole number from (n + 1) part on: a further
        one of the same law is within it with that probability (split conformal prediction: Vovk,
        Gammerman and Shafer 2005, Algorithmic Learning in a Random World, section 4.2).

        Args:
          distances: [1] squared, of other records; too few for a part leave the normal law's.
        """
        known = sorted(distances)
        first = []
        for part, usual in zip(PARTS, NORMAL_REACH, strict=True):
            place = math.ceil((len(known) + 1) * part)
            first.append(known[place - 1] if 0 < place <= len(known) else usual)
        return cls((first[0], first[1]))

    @property
    def now(self) -> tuple[float, float]:
        """Reaches of 50 and 90 %, the second at least the first."""
        half, ninety = (math.exp(value) for value in self._logarithms)
        return half, max(half, ninety)

    def held(self, distance: float) -> tuple[bool, bool]:
        """Whether the ellipses of 50 and 90 % hold a fix at this squared distance [1]."""
        half, ninety = self.now
        return distance <= half, distance <= ninety

    def learn(self, distance: float) -> None:
        """Take the squared distance [1] of a fix."""
        for k, (part, held) in enumerate(zip(PARTS, self.held(distance), strict=True)):
            self._logarithms[k] += FOLLOWING * (part - float(held))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Consistency:
    """Figures of the fixes after dives; None where there is no such fix."""

    fixes: int
    nis: float | None
    """[1] mean squared normalised innovation; 2 is right"""
    in_50: float | None
    """[1] part of the fixes within the ellipse of 50 %"""
    in_90: float | None
    first_dive_m: float | None
    """[m] mean miss at the fix after the first dive of a record, before it was taken"""
    first_dive_no_current_m: float | None
    """[m] the same of the way through the water alone"""
    later_m: float | None
    """[m] mean miss at the fixes after later dives"""
    later_persistence_m: float | None
    """[m] the same with the mean current of the dive before"""


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
    """Judge records of legs, each in order of time; legs without a known way are left out.

    Args:
      records: of missions or deployments in waters of one kind, each with its own current.
      latitude: [degree]
      others: records that tell what the sea and its ellipses are like; by default half of
        `records` tells it for the other half.
      speed_scale, compass: [1], [degree] as `tune` takes them.
      noise: [m/s], north and east each, of the velocity through the water.
      memory: [s] for which that lasts.

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

    said: list[tuple[Sequence[Leg], Sequence[Innovation]]] = []
    held: list[tuple[bool, bool]] = []
    for taught, judged in parts:
        parameters = tune(
            [], others=taught, latitude=latitude, speed_scale=speed_scale,
            compass=compass, may_persist=False,
        ).parameters  # fmt: skip
        distances = [one.normalised for legs in taught for one in innovations_of(legs, parameters)]
        for legs in judged:
            found, reaches = innovations_of(legs, parameters), Reaches.of(distances)
            said.append((legs, found))
            for one in found:
                held.append(reaches.held(one.normalised))
                reaches.learn(one.normalised)
    every = [one for _, innovations in said for one in innovations]
    first = [(legs[0], innovations[0]) for legs, innovations in said]
    later = [
        (legs[k - 1], legs[k], innovations[k])
        for legs, innovations in said
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
