"""Surfacing schedule: when a dive that begins now will end, by when those before it ended.

Gliders surface after a time under water, a time after the last surfacing, or by the clock: every
hour, two, three or four. Which of these a pilot has ordered shows in the dives themselves.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from glider_twin_ops.forecast.logged_leg import DiveTime, usual_duration
from glider_twin_ops.forecast.pool import Mixture, Pool, Prior
from twin.numbers import Array

HOUR = 3600.0
CLOCKS = (1.0, 2.0, 3.0, 4.0)
"""[h] between surfacings by the clock"""
SHORTEST = 600.0
"""[s] of a dive"""
RECENT = 5
"""Ends from which the clock's phase is taken"""
STAYS, LONGEST_STAY = 10, 6.0 * HOUR
"""Last stays at the surface that tell of the next, and [s] of one; longer is a gap"""
SHORTENED, LENGTHENED = -0.8, 3.0
"""[1] by which a dive is drawn shorter or longer than expected at most"""
LAST, USUAL, SINCE = "as the last", "median of three", "since the last surfacing"
CLOCK_PRIORS = (Prior(0.14, 0.12), Prior(0.07, 0.16), Prior(0.06, 0.18), Prior(0.06, 0.14))
PRIORS: Mapping[str, Prior] = {
    LAST: Prior(0.4, 0.12),
    USUAL: Prior(0.22, 0.13),
    SINCE: Prior(0.19, 0.12),
    **{f"every {h:g} h": prior for h, prior in zip(CLOCKS, CLOCK_PRIORS, strict=True)},
}
"""Of each order, as deployments have them in common (`python -m benchmarks.surfacings`); scales as
part of the usual duration"""
FREEDOM, COUNTED, FORGETTING = 3.0, 2.0, 0.9
"""See `Pool`: orders are kept to the minute until a pilot gives another"""


class SurfacingSchedule:
    """Orders to surface, mixed by how well they foretold the ends so far."""

    def __init__(self, priors: Mapping[str, Prior] = PRIORS):
        self.pool = Pool(priors, freedom=FREEDOM, counted=COUNTED, forgetting=FORGETTING)
        self._dives: list[DiveTime] = []

    def expect(self, begin: float) -> Mixture:
        """Duration [s] of a dive that begins at a time [s], (1,).

        Raises:
          InputError: there was no dive before.
        """
        said = np.array([self._foretold(begin)]).T
        usual = usual_duration(self._dives) if self._dives else 1.0
        return self.pool.expect(said, np.full((len(said), 1, 1), usual**2))

    def learn(self, dive: DiveTime) -> Array | None:
        """Take a dive that has ended; returns the part of each order in explaining it."""
        part = None
        if self._dives:
            self.expect(dive.begin)
            part = self.pool.learn([dive.end - dive.begin])
        self._dives = [*self._dives, dive][-RECENT:]
        return part

    def _foretold(self, begin: float) -> list[float]:
        """[s] by each order."""
        if not self._dives:
            return [np.nan] * len(self.pool.names)
        last, usual = self._dives[-1], usual_duration(self._dives)
        ends = np.array([one.end for one in self._dives])
        every = float(np.median(np.diff(ends)[-3:])) if len(ends) > 1 else np.nan
        since = max(last.end + every - begin, SHORTEST)
        clocks = (_by_clock(ends, begin, usual, hours * HOUR) for hours in CLOCKS)
        return [last.end - last.begin, usual, since, *clocks]


def _by_clock(ends: Array, begin: float, usual: float, period: float) -> float:
    """[s] to the time of the clock next to a usual duration; NaN where dives are much shorter."""
    if usual < 0.5 * period:
        return np.nan
    turn = 2.0 * np.pi / period
    phase = float(np.angle(np.exp(1j * turn * ends).sum())) / turn
    end = phase + period * np.round((begin + usual - phase) / period)
    return float(end - begin + (period if end < begin + SHORTEST else 0.0))


def middle(mixture: Mixture) -> float:
    """The weighted median of what the orders say [s]: that of one order, not one between two."""
    order = np.argsort(mixture.means[:, 0], kind="stable")
    reached = np.searchsorted(np.cumsum(mixture.weights[order]), 0.5)
    return float(mixture.means[order[min(int(reached), len(order) - 1)], 0])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rhythm:
    """How long a vehicle stays at the surface, and how well its dives keep the time."""

    stays: Array
    """[s] of its last stays, (stay,)"""
    late: Mixture
    """[s] of the next dive, by each order"""

    @classmethod
    def of(cls, schedule: SurfacingSchedule, dives: Sequence[DiveTime]) -> Rhythm | None:
        """By all dives; None where too few of their stays are known.

        Args:
          schedule: which has learned from them.
        """
        stays = np.array([one.stay for one in dives[1:]])
        stays = stays[(stays >= 0.0) & (stays < LONGEST_STAY)][-STAYS:]
        if len(stays) < 2:
            return None
        return cls(stays=stays, late=schedule.expect(dives[-1].end + float(np.median(stays))))

    def draw(self, count: int, dives: int, waited: float, rng: np.random.Generator) -> Delays:
        """Draws for some members and dives.

        Args:
          waited: [s] that it has been at the surface when the forecast begins.
        """
        stays = _further(self.stays, (count, dives), rng)
        lasts = self.late.draw(count, FREEDOM, rng)[:, 0]
        late = lasts / middle(self.late) - 1.0
        stays[0], late[0] = np.median(self.stays), 0.0
        if waited < float(self.stays.max()):
            stays[:, 0] = np.maximum(stays[:, 0] - max(waited, 0.0), 0.0)
        return Delays(stays=stays, late=np.clip(late, SHORTENED, LENGTHENED))

    @property
    def words(self) -> str:
        """Of both."""
        deviation = math.sqrt(float(self.late.covariance[0, 0])) / middle(self.late)
        return (
            f"{np.median(self.stays) / 60.0:.0f} min at the surface ({self.stays.min() / 60.0:.0f} "
            f"to {self.stays.max() / 60.0:.0f} so far), dives +-{100.0 * deviation:.0f} %"
        )


def _further(known: Array, shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Draws of further values of the law of n known ones, which is not known.

    The next is as likely between any two neighbours of the known ones as beyond either end of them,
    1 / (n + 1) each (Vovk, Gammerman and Shafer 2005, Algorithmic Learning in a Random World,
    section 4.2): known values alone would hold a part (n - 1) / (n + 1) of the next ones at most.
    Beyond an end, by an exponential law as wide as that end is from the median; never below 0.
    """
    ordered = np.sort(known)
    rank = rng.uniform(0.0, len(ordered) + 1.0, size=shape)
    beyond = rng.standard_exponential(shape)
    low, middle_, high = ordered[0], np.median(ordered), ordered[-1]
    drawn = np.interp(rank, np.arange(1, len(ordered) + 1), ordered)
    drawn = np.where(rank < 1.0, low - beyond * (middle_ - low), drawn)
    drawn = np.where(rank > len(ordered), high + beyond * (high - middle_), drawn)
    return np.maximum(drawn, 0.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Delays:
    """By what members come up later than they flew; the first has the usual stays and no error."""

    stays: Array
    """[s] at the surface before each dive, (member, dive)"""
    late: Array
    """[1] part by which all dives of a member last longer than they were flown, (member,): another
    order of the pilot is kept, too"""
