"""Consistency: stated against found errors of forecasts, on records that tuned nothing of it.

The sea's statistics and the reaches of the ellipses are found in other records, or in one half of
the records for the other and the other way round. A filter is consistent when its squared
innovations, normalised by their stated covariances, are 2 in the mean, and its ellipses hold what
they shall (Bar-Shalom, Li and Kirubarajan 2001, Estimation with Applications to Tracking and
Navigation, section 5.4).

No law of the errors is assumed for the ellipses. Currents of many missions are calmer in the
middle and wilder at the ends than a normal law or Student's t of the same variance.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Self

import numpy as np

from twin.navigation.current.current_parameters import CurrentParameters
from twin.navigation.current.filter import CurrentFilter
from twin.navigation.current.modes import Innovation
from twin.navigation.current.tuning import Leg, replay, tune
from twin.numbers import Array

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
