"""Familiarity: whether a vehicle is one that the training knew, by what its flight filter finds.

A hull with growth on it makes inputs that are all usual, and goes together as no hull of the
training did: the Mahalanobis distance of the inputs hardly tells it. The flight filter's constants
do, since their spread over training missions says which hulls those were.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, Self

import numpy as np

from learn.data.dataset import MissionSequence
from twin.errors import StoreError
from twin.navigation.c_math import table
from twin.navigation.flight_filter import FlightFilter
from twin.navigation.flight_filter_kernels import CONSTANTS, GUESS
from twin.numbers import Array

FAR = 3.0
"""Deviations from the training's mean that count as 1"""
MISSIONS = 60
"""of the training from which the spread is known, to 10 %"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Familiarity:
    """Constants of the flight filter at the end of training missions, in the order of CONSTANTS."""

    mean: tuple[float, ...]
    deviation: tuple[float, ...]

    @classmethod
    def fit(cls, known: Iterable[tuple[FlightFilter, Iterable[MissionSequence]]]) -> Self:
        """From training missions with the filter's channels, by the filters of their vehicles.

        A constant is how far a hull is from its own file, so that those of several vehicles make
        one spread.
        """
        found: list[tuple[float, ...]] = []
        prior = np.zeros(len(CONSTANTS))
        for flight, missions in known:
            found += [ended(flight, one) for one in missions]
            prior = np.maximum(prior, flight.model.prior)
        ends = np.array(found)
        # a spread of nothing is no spread: that which the filter takes for possible
        spread = np.maximum(ends.std(0), 0.1 * prior)
        return cls(mean=tuple(ends.mean(0).tolist()), deviation=tuple(spread.tolist()))

    @classmethod
    def read(cls, said: Mapping[str, Any], place: str) -> Self:
        """From the entry of a run's description; `place` is for errors.

        Raises:
          StoreError: it is not whole.
        """
        found = {}
        for name in ("mean", "deviation"):
            values = np.array(said.get(name, ()), float)
            if values.shape != (len(CONSTANTS),) or not np.isfinite(values).all():
                raise StoreError(
                    f"{place} is damaged: its familiarity has no {name} of {len(CONSTANTS)} "
                    "constants; `learn fit --resume` makes it again"
                )
            found[name] = tuple(values.tolist())
        if min(found["deviation"]) <= 0.0:
            raise StoreError(f"{place} is damaged: a deviation of its familiarity is not above 0")
        return cls(**found)

    def outside(self, constants: Array) -> tuple[float, str]:
        """How far outside of the training a hull is, and by which constant: above 1 it is.

        Args:
          constants: of the flight filter, (7,).
        """
        far = np.abs(np.asarray(constants) - self.mean) / (FAR * np.array(self.deviation))
        return float(far.max()), CONSTANTS[int(far.argmax())]

    def c_function(self, prior: Array) -> str:
        """`float glider_outside(const glider_state *state)` in C99, whose constants are counted in
        prior deviations (7,)."""
        return f"""\
/* How far the hull is outside of those of the training: above 1 it is. */
static inline float glider_outside(const glider_state *state)
{{
    {table("mean", self.mean / prior)}
    {table("reach", FAR * np.array(self.deviation) / prior)}
    float most = 0.0f;
    for (int i = 0; i < {len(CONSTANTS)}; i++)
        most = gt_most(most, fabsf(state->flight[0][{GUESS} + i] - mean[i]) / reach[i]);
    return most;
}}
"""


def ended(flight: FlightFilter, mission: MissionSequence) -> tuple[float, ...]:
    """Constants at the end of a mission, from the filter's start on."""
    flight.reset()
    flight.run(mission.signals)
    return tuple(value for value, _ in flight.constants.values())


def widened(interval: float, outside: float | None) -> float:
    """An interval that validation showed, as it is said where the hull is `outside` of training.

    Args:
      interval: [m/s] either way.
      outside: as `Familiarity.outside`, which widens it above 1; None: unknown.
    """
    return interval * max(1.0, outside or 0.0)
