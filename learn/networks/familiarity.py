"""Familiarity: detect hulls unlike the training's, and limit the networks' bias on other vehicles.

A hull with biofouling leaves each input within its usual range. The Mahalanobis distance of all
inputs hardly shows such a hull. The flight filter's constants do, compared with their mean and
standard deviation over the training missions.

Another type of vehicle can move as no training mission did, for example glide with stalled wings.
The networks' surge can then be wrong by half, while the flight filter uses the vehicle's own
equation of motion. `Tether` limits the mean difference of the two to its median in validation.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.special import ndtr, stdtrit

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
"""Standard deviations from the training's mean at which the out-of-distribution score is 1"""
MISSIONS = 60
"""Maximum number of missions for `Familiarity.fit`; standard deviations are then known to 10 %"""
CLASSIFIED = 24
"""Maximum number of missions per store for `training_hulls`; the drag's standard deviation is then
known to 15 %"""
LARGEST_CLEAN_RMS = 0.13
"""Largest rms of ln(drag factor) at which hulls count as built as in their file. Three vehicles
have 0.06 to 0.08 with preset `field`, 0.24 to 0.36 with `family` or with 40 % more drag"""


def training_flights(
    stores: Stores, period: float | None, spread: FlightSpread | None, limit: int
) -> Iterator[tuple[FlightFilter, Iterator[MissionSequence]]]:
    """For each store, a flight filter of its vehicle and up to `limit` training missions."""
    for store in each_store(stores):
        with MissionStore(store) as reader:
            trains = SPLIT in reader and "train" in reader.splits
        part = "train" if trains else "all"
        with Selection(store, ESTIMATED, split=part, limit=limit, period=period) as selection:
            assert selection.vehicle is not None  # estimated channels are read
            yield FlightFilter(selection.vehicle, selection.period, spread), selection.each()


def training_hulls(stores: Stores, features: Sequence[str], period: float | None) -> str:
    """Classify a training's hulls as a key of `twin.navigation.flight_filter.HULLS`.

    The criterion is the drag that the flight filter for any hull finds in training missions. For
    networks that do not read the flight filter, the answer is ANY.

    Raises:
      StoreError: see `Selection`.
    """
    if not set(channels_of(features)) & set(ESTIMATED):
        return ANY
    clean = True
    for flight, missions in training_flights(stores, period, None, CLASSIFIED):
        squares = []
        for mission in missions:
            ended(flight, mission)
            value, deviation = flight.constants["drag"]
            squares.append(value**2 + deviation**2)
        clean &= math.sqrt(np.mean(squares)) < LARGEST_CLEAN_RMS
    return CLEAN if clean else ANY


@dataclasses.dataclass(frozen=True, kw_only=True)
class Familiarity:
    """Mean of the flight filter's final CONSTANTS over training missions, and their deviation."""

    mean: tuple[float, ...]
    deviation: tuple[float, ...]

    @classmethod
    def fit(cls, known: Iterable[tuple[FlightFilter, Iterable[MissionSequence]]]) -> Self:
        """Fit to pairs of a vehicle's flight filter and its training missions.

        Constants are relative to the vehicle's own file, so that several vehicles can be pooled.
        """
        found: list[tuple[float, ...]] = []
        prior = np.zeros(len(CONSTANTS))
        for flight, missions in known:
            found += [ended(flight, one) for one in missions]
            prior = np.maximum(prior, flight.model.prior)
        return cls.of(np.array(found), prior)

    @classmethod
    def of(cls, ends: Array, prior: Array) -> Self:
        """Statistics of hulls' constants (missions, 7), with the filter's prior deviations (7,).

        The deviation of another hull from the mean is by Student's t of so many missions.
        """
        count, own = len(ends), prior
        if count > 1:
            own = float(stdtrit(count - 1, ndtr(FAR))) / FAR * ends.std(0, ddof=1)
        # identical hulls would give zero: at least a tenth of the filter's prior
        deviation = np.maximum(math.sqrt(1.0 + 1.0 / count) * own, 0.1 * prior)
        return cls(mean=tuple(ends.mean(0).tolist()), deviation=tuple(deviation.tolist()))

    @classmethod
    def read(cls, said: Mapping[str, Any], place: str) -> Self:
        """Read the entry of a run's description; `place` is its file, for errors.

        Raises:
          StoreError: the entry is incomplete.
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
        """Out-of-distribution score of a hull, above 1 if outside, and the constant that sets it.

        Args:
          constants: constants of the flight filter, (7,).
        """
        far = np.abs(np.asarray(constants) - self.mean) / (FAR * np.array(self.deviation))
        return float(far.max()), CONSTANTS[int(far.argmax())]

    def c_function(self, prior: Array) -> str:
        """C99 code of `float glider_outside(const glider_state *state)`, the score of `outside`,
        for constants in units of the prior standard deviations `prior` (7,)."""
        return f"""\
/* Out-of-distribution score: above 1, the hull is unlike those of the training, or a channel was
 * without a good value for more than 30 s. */
static inline float glider_outside(const glider_state *state)
{{
    {table("mean", self.mean / prior)}
    {table("reach", FAR * np.array(self.deviation) / prior)}
    float most = state->lost;
    for (int i = 0; i < {len(CONSTANTS)}; i++)
        most = gt_most(most, fabsf(state->flight[0][{GUESS} + i] - mean[i]) / reach[i]);
    return most;
}}
"""


def ended(flight: FlightFilter, mission: MissionSequence) -> tuple[float, ...]:
    """Constants of the flight filter at the end of a mission; the filter is reset first."""
    flight.reset()
    flight.run(mission.signals)
    return tuple(value for value, _ in flight.constants.values())


def widened(interval: float, outside: float | None) -> float:
    """Widen an interval from validation in proportion to the hull's score.

    Args:
      interval: [m/s] half-width of the interval.
      outside: score of `Familiarity.outside`, with effect above 1; None: unknown.
    """
    return interval * max(1.0, outside or 0.0)


HELD_TO = ("estimated_surge", "adapted_surge")
"""Channels of the flight filter's surge that the bias limit refers to: not adapted, adapted"""
LASTS_S = 60.0
"""[s] Time constant of the mean difference: longer than an inflection, shorter than a glide"""
SHARE = 0.5
"""[1] Fraction of validation samples within the bias limit: chosen from 0.5, 0.68 and 0.9, as
LASTS_S from 20, 60 and 200 s, on Slocums and Seagliders with networks of three other vehicles."""


@dataclasses.dataclass(frozen=True)
class Tether:
    """Bias limit of the mean difference, over a minute, of networks' surge from the filter's."""

    most: float
    """[m/s] Limit of the mean difference: the median of its size over the validation samples"""

    @classmethod
    def of(cls, apart: Sequence[Array], period: float) -> Tether:
        """Fit to differences [m/s] of networks and filter on validation missions, each (time,)."""
        lasting = np.concatenate([_lasting(one, period) for one in apart])
        return cls(float(np.quantile(np.abs(lasting), SHARE)))

    def held(self, surge: NDArray[Any], filtered: Array, period: float) -> Array:
        """[m/s] Surge with its bias limited, (time,); both arguments begin at the launch."""
        lasting = _lasting(surge - filtered, period)
        return surge - (lasting - np.clip(lasting, -self.most, self.most))

    def step(self, lasting: float, apart: float, period: float) -> tuple[float, float]:
        """Update the mean difference `lasting` [m/s], 0 at the start, with a sample's difference
        `apart`; returns the new mean and the correction to subtract from surge."""
        lasting += share(period) * (apart - lasting)
        return lasting, lasting - min(max(lasting, -self.most), self.most)

    def c_statements(self, surge: str, filtered: str, period: float) -> list[str]:
        """C line that updates the mean difference `state->lasting`."""
        return [
            f"state->lasting += {number(share(period))} * ({surge} - {filtered} - state->lasting);"
        ]

    def c_off(self) -> str:
        """C expression of the correction to subtract from surge."""
        return f"(state->lasting - gt_bounded(state->lasting, {number(self.most)}))"


def share(period: float) -> float:
    """Weight of one sample in the exponential mean, for a sample period [s]."""
    return -math.expm1(-period / LASTS_S)


def _lasting(apart: Array, period: float) -> Array:
    """Exponential mean of a difference (time,). The mean starts from 0, because a flight filter
    needs some seconds to find the speed of a vehicle under way."""
    part = share(period)
    return np.asarray(lfilter([part], [1.0, part - 1.0], apart), np.float64)
