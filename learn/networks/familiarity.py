"""Familiarity: whether a vehicle is one that the training knew, by what its flight filter finds.

A hull with growth on it makes inputs that are all usual, and goes together as no hull of the
training did: the Mahalanobis distance of the inputs hardly tells it. The flight filter's constants
do, since their spread over training missions says which hulls those were.

A kind of vehicle that no training mission was of may do what none of these did, such as begin its
dives stalled. There networks can be wrong by half, and the filter, which has the vehicle's own
equation of motion, is not. So a tether holds what lasts of their difference to what it was in
validation.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from learn.data.dataset import MissionSequence, Selection
from learn.data.stores import Stores, each_store
from twin.errors import StoreError
from twin.navigation.c_math import number, table
from twin.navigation.features import channels_of
from twin.navigation.flight_filter import ANY, CLEAN, FlightFilter, FlightSpread
from twin.navigation.flight_filter_kernels import CONSTANTS, GUESS
from twin.navigation.settings import ESTIMATED
from twin.numbers import Array
from twin.records.attributes import SPLIT
from twin.records.reader import MissionStore

FAR = 3.0
"""Deviations from the training's mean that count as 1"""
MISSIONS = 60
"""of the training from which the spread is known, to 10 %"""
TRIED = 24
"""of each store, from which the spread of the drag is known to 15 %"""
CLEAN_MOST = 0.13
"""of ln(factor) on the drag: hulls that are off by less are as their file. Stores of preset `field`
have 0.06 to 0.08, of three vehicles; those of `family`, or with 40 % more drag, 0.24 to 0.36"""


def training_flights(
    stores: Stores, period: float | None, spread: FlightSpread | None, limit: int
) -> Iterator[tuple[FlightFilter, Iterator[MissionSequence]]]:
    """Of each store a filter of its vehicle, and up to `limit` missions that train."""
    for store in each_store(stores):
        with MissionStore(store) as reader:
            trains = SPLIT in reader and "train" in reader.splits
        part = "train" if trains else "all"
        with Selection(store, ESTIMATED, split=part, limit=limit, period=period) as selection:
            assert selection.vehicle is not None  # estimated channels are read
            yield FlightFilter(selection.vehicle, selection.period, spread), selection.each()


def training_hulls(stores: Stores, features: Sequence[str], period: float | None) -> str:
    """Which of `twin.navigation.flight_filter.HULLS` those of a training are.

    By the drag that the filter for any hull finds in the training missions. Networks that do not
    read the filter have no use for it.

    Raises:
      StoreError: see `Selection`.
    """
    if not set(channels_of(features)) & set(ESTIMATED):
        return ANY
    clean = True
    for flight, missions in training_flights(stores, period, None, TRIED):
        squares = []
        for mission in missions:
            ended(flight, mission)
            value, deviation = flight.constants["drag"]
            squares.append(value**2 + deviation**2)
        clean &= math.sqrt(np.mean(squares)) < CLEAN_MOST
    return CLEAN if clean else ANY


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


HELD_TO = ("estimated_surge", "adapted_surge")
"""The filter's surge that networks are held to, without an adapted one and with it"""
LASTS_S = 60.0
"""[s] exponential mean of the difference: longer than an inflection, shorter than a glide"""
SHARE = 0.5
"""of the validation samples that are within the reach. Chosen of 0.5, 0.68 and 0.9, as LASTS_S of
20, 60 and 200 s, on Slocums and Seagliders that networks of three other kinds had not seen."""


@dataclasses.dataclass(frozen=True)
class Tether:
    """What networks' surge, in the mean of a minute, may be off the flight filter's."""

    most: float
    """[m/s] either way"""

    @classmethod
    def of(cls, apart: Sequence[Array], period: float) -> Tether:
        """From differences [m/s] of networks and filter on validation missions, each (time,)."""
        lasting = np.concatenate([_lasting(one, period) for one in apart])
        return cls(float(np.quantile(np.abs(lasting), SHARE)))

    def held(self, surge: NDArray[Any], filtered: Array, period: float) -> Array:
        """Surge [m/s] within reach of the filter's, both (time,) from the launch on."""
        lasting = _lasting(surge - filtered, period)
        return surge - (lasting - np.clip(lasting, -self.most, self.most))

    def step(self, lasting: float, apart: float, period: float) -> tuple[float, float]:
        """One sample: the mean so far, 0 before the first, and the difference [m/s] at it to the
        next mean and what is to be taken off the surge."""
        lasting += share(period) * (apart - lasting)
        return lasting, lasting - min(max(lasting, -self.most), self.most)

    def c_statements(self, surge: str, filtered: str, period: float) -> list[str]:
        """The same in C: a line that follows the mean in `state->lasting`."""
        return [
            f"state->lasting += {number(share(period))} * ({surge} - {filtered} - state->lasting);"
        ]

    def c_off(self) -> str:
        """What to take off the surge then, in C."""
        return f"(state->lasting - gt_bounded(state->lasting, {number(self.most)}))"


def share(period: float) -> float:
    """Of a sample in the mean, one every `period` [s]."""
    return -math.expm1(-period / LASTS_S)


def _lasting(apart: Array, period: float) -> Array:
    """From 0 on: a filter that begins under way takes some seconds to know its speed."""
    part = share(period)
    return np.asarray(lfilter([part], [1.0, part - 1.0], apart), np.float64)
