"""Expected dive: velocity through the water and duration of a dive that begins now.

A vehicle is sent to waypoints. By its own reckoning it goes straight to each waypoint, at the speed
of its recent dives. A vehicle that corrects for its current estimate heads into it. Gliders
surface after a time under water, a time after the last surfacing, or by the clock every 1, 2, 3 or
4 h. Pools weigh the models of velocity and of duration by the dives so far; `walk` uses both.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from glider_twin_ops.forecast.logged_leg import DiveTime, LoggedLeg, pair, usual_duration
from glider_twin_ops.forecast.pool import Mixture, Pool, Prior
from twin.numbers import Array

Place = tuple[float, float]

ARRIVED, STEEPEST = 20.0, 0.95
"""ARRIVED: [m] radius of arrival at a waypoint; Slocums' lists have 10 m and more. STEEPEST: [1]
largest sine of the angle from heading to course; closer to 1, no headway is made."""
FORGETTING, RECENT = 0.9, 7
"""FORGETTING: [1] of `Pool`; it is faster than the current's, since pilots change plans sooner than
the sea changes. RECENT: number of last dives whose median is the vehicle's speed"""
FASTEST, COARSE, FINE = 1.5, 0.05, 0.01
"""[m/s] Search for a dive's speed along its waypoints. FASTEST: upper end. COARSE, FINE: steps"""
STRAIGHT = 1e6
"""[s] Without a waypoint, the last dive's velocity continues for this time"""
ALONG = 0.3
"""[1] Largest misfit of a dive to the path along its waypoints, as a fraction of its length; beyond
it the dive's speed is its straight length over its duration"""


def guided_way(
    targets: Sequence[Place], speed: float, believed: Place, duration: float
) -> Place | None:
    """Displacement through the water along waypoints; beyond the last the course continues.

    Args:
      targets: north, east [m] from the start, in order.
      speed: [m/s] through the water, horizontal.
      believed: current that the vehicle corrects for, north and east [m/s].
      duration: [s]

    Returns:
      North, east [m]; None without a waypoint.
    """
    drift = complex(*believed)
    place, way, left = 0j, 0j, duration
    toward: complex | None = None
    for k, target in enumerate(targets):
        gap = complex(*target) - place
        away = abs(gap)
        if away > ARRIVED or (toward is None and k == len(targets) - 1 and away > 0.0):
            toward = gap / away
            through, advance = _leaning(toward, speed, drift)
            reached = max(away - ARRIVED, 0.0) / advance if advance > 0.0 else math.inf
            spent = min(reached, left)
            way += spent * through
            place += spent * (through + drift)
            left -= spent
    if toward is None:
        return None
    way += left * _leaning(toward, speed, drift)[0]
    return way.real, way.imag


def _leaning(toward: complex, speed: float, drift: complex) -> tuple[complex, float]:
    """Velocity through the water for a course toward a place, and speed along that course [m/s]."""
    beside = drift * toward.conjugate()  # along and across
    lean = math.copysign(min(abs(beside.imag), STEEPEST * speed), -beside.imag)
    along = math.sqrt(speed**2 - lean**2)
    return complex(along, lean) * toward, along + beside.real


def plain_way(before: Sequence[LoggedLeg], targets: Sequence[Place], duration: float) -> Array:
    """Displacement of rivals through the water: along the waypoints, else along the last dive.

    Args:
      before: the dives so far, at least one; the speed is the mean of the last three.
      targets: waypoints of the dive that begins.
      duration: [s]

    Returns:
      North, east [m], (2,).
    """
    speed = float(np.mean([np.hypot(*one.velocity) for one in before[-3:]]))
    targets = targets or [pair(before[-1].velocity * STRAIGHT)]
    return np.array(guided_way(targets, speed, (0.0, 0.0), duration) or (0.0, 0.0))


GUIDED, AGAIN, NOWHERE = "to its waypoints", "as the last dive", "nowhere in the mean"
WAY_PRIORS: Mapping[str, Prior] = {
    GUIDED: Prior(0.32, 0.063),
    AGAIN: Prior(0.54, 0.071),
    NOWHERE: Prior(0.2, 0.14),
}
"""Prior of each model of the velocity through the water, learned over deployments (`python -m
benchmarks.surfacings`): scale in m/s"""


class WayPool:
    """Models of the velocity through the water, weighted by the dives so far."""

    def __init__(self, priors: Mapping[str, Prior] = WAY_PRIORS):
        self.pool = Pool({name: priors[name] for name in WAY_PRIORS}, forgetting=FORGETTING)
        self._speeds: list[float] = []
        self._last: LoggedLeg | None = None

    @property
    def speed(self) -> float | None:
        """[m/s] Horizontal speed of recent dives; None before the first."""
        return float(np.median(self._speeds[-RECENT:])) if self._speeds else None

    def steered(self, one: LoggedLeg) -> Place:
        """Current that a vehicle corrects for, north and east [m/s]: its estimate, if its own track
        of the last dive contained that estimate; else zero."""
        last = self._last
        if last is None or one.believed is None or not _reckons(last):
            return 0.0, 0.0
        return one.believed

    def expect(self, one: LoggedLeg, duration: float) -> Mixture:
        """Mean velocity through the water [m/s] of a dive that begins now.

        Args:
          one: dive whose waypoints and current estimate are read.
          duration: [s] expected duration.
        """
        return self.toward(one.targets, self.steered(one), duration)

    def toward(self, targets: Sequence[Place], steered: Place, duration: float) -> Mixture:
        """Mean velocity through the water [m/s] to targets, north and east [m] from the begin, by a
        vehicle that corrects for the current `steered` [m/s]."""
        said = np.full((3, 2), np.nan)
        said[2] = 0.0
        if self._last is not None and self.speed is not None:
            guided = guided_way(targets, self.speed, steered, duration)
            if guided is not None:
                said[0] = np.array(guided) / duration
            said[1] = self._last.velocity
        return self.pool.expect(said)

    def learn(self, one: LoggedLeg) -> Array:
        """Learn from a dive that has ended; returns each model's posterior weight for it."""
        self.expect(one, one.leg.duration)
        part = self.pool.learn(one.velocity)
        self._speeds.append(_speed_of(one))
        self._last = one
        return part


BOTH, STEADY = "through the water plus current", "over ground as the last three dives"
GROUND_PRIORS: Mapping[str, Prior] = {BOTH: Prior(0.68, 0.73), STEADY: Prior(0.36, 0.1)}
"""Prior of each model of the velocity over ground, learned over deployments (`python -m
benchmarks.surfacings`): scale of `BOTH` in its own standard deviations, of `STEADY` in m/s"""
STEADY_DIVES = 3


class GroundPool:
    """Models of the velocity over ground, weighted by the dives so far."""

    def __init__(self, priors: Mapping[str, Prior] = GROUND_PRIORS):
        self.pool = Pool({name: priors[name] for name in GROUND_PRIORS})
        self._velocities: list[Array] = []

    @property
    def steady(self) -> Array:
        """Mean velocity over ground of the last three dives, north and east [m/s]; NaN before."""
        return np.mean(self._velocities[-STEADY_DIVES:] or [np.full(2, np.nan)], axis=0)

    def expect(self, through: Mixture, current: Mixture) -> Mixture:
        """Forecast the mean velocity over ground, north and east [m/s], of a dive that begins now.

        Args:
          through: velocity through the water from `WayPool`. current: from `CurrentPool`.
        """
        means = np.array([through.mean + current.mean, self.steady])
        return self.pool.expect(means, [through.covariance + current.covariance, np.eye(2)])

    def learn(self, velocity: Array) -> Array | None:
        """Learn a dive's velocity; returns each model's posterior weight, None for the first."""
        part = self.pool.learn(velocity) if self._velocities else None
        self._velocities.append(velocity)
        return part


def _reckons(one: LoggedLeg) -> bool:
    """True if a vehicle's own track contained its current estimate."""
    if one.onboard is None or one.believed is None:
        return False
    held = np.array(one.onboard) / one.leg.duration - one.velocity
    return bool(np.hypot(*(held - np.array(one.believed))) < np.hypot(*held))


def _speed_of(one: LoggedLeg) -> float:
    """[m/s] Speed along the waypoints; off the waypoints' path, straight length over time."""
    straight, through = float(np.hypot(*one.velocity)), one.leg.through_water
    believed = one.believed if one.believed is not None and _reckons(one) else (0.0, 0.0)
    assert through is not None

    def beside(speed: float) -> float:
        way = guided_way(one.targets, speed, believed, one.leg.duration)
        return math.inf if way is None else math.dist(way, through)

    near = min(np.arange(COARSE, FASTEST, COARSE).tolist(), key=beside)
    best = min((near + FINE * np.arange(-4, 5)).tolist(), key=beside)
    return best if beside(best) < ALONG * math.hypot(*through) else straight


HOUR = 3600.0
CLOCKS, ENDS = (1.0, 2.0, 3.0, 4.0), 5
"""CLOCKS: [h] intervals of surfacings by the clock. ENDS: number of last ones for the phase"""
SHORTEST = 600.0
"""[s] Shortest expected dive"""
STAYS, LONGEST_STAY = 10, 6.0 * HOUR
"""STAYS: number of last surface intervals to sample. LONGEST_STAY: [s] a longer one is a gap."""
SHORTENED, LENGTHENED = -0.8, 3.0
"""[1] Limits of a sampled dive's relative change of duration"""
CLOCK_PRIORS = (Prior(0.14, 0.12), Prior(0.07, 0.16), Prior(0.06, 0.18), Prior(0.06, 0.14))
SCHEDULE_PRIORS: Mapping[str, Prior] = {
    "as the last": Prior(0.4, 0.12),
    "median of three": Prior(0.22, 0.13),
    "since the last surfacing": Prior(0.19, 0.12),
    **{f"every {h:g} h": prior for h, prior in zip(CLOCKS, CLOCK_PRIORS, strict=True)},
}
"""Prior of each model of the duration, learned over deployments (`python -m
benchmarks.surfacings`): scale as a fraction of the usual duration"""
FREEDOM, COUNTED = 3.0, 2.0
"""Arguments of `Pool`: dives keep an order to the minute until a pilot gives another one"""


class SurfacingSchedule:
    """Models of a dive's duration, weighted by how well they forecast the ends so far."""

    def __init__(self, priors: Mapping[str, Prior] = SCHEDULE_PRIORS):
        self.pool = Pool(priors, freedom=FREEDOM, counted=COUNTED, forgetting=FORGETTING)
        self._dives: list[DiveTime] = []

    def expect(self, begin: float) -> Mixture:
        """Forecast the duration [s], (1,), of a dive that begins at a time [s].

        Raises:
          InputError: there was no dive before.
        """
        said, usual = [np.nan] * len(self.pool.names), 1.0
        if self._dives:
            last, usual = self._dives[-1], usual_duration(self._dives)
            ends = np.array([one.end for one in self._dives])
            every = float(np.median(np.diff(ends)[-3:])) if len(ends) > 1 else np.nan
            since = max(last.end + every - begin, SHORTEST)
            clocks = (_by_clock(ends, begin, usual, hours * HOUR) for hours in CLOCKS)
            said = [last.end - last.begin, usual, since, *clocks]
        return self.pool.expect(np.array([said]).T, np.full((len(said), 1, 1), usual**2))

    def learn(self, dive: DiveTime) -> Array | None:
        """Learn from a dive that has ended; returns each model's posterior weight for it."""
        part = None
        if self._dives:
            self.expect(dive.begin)
            part = self.pool.learn([dive.end - dive.begin])
        self._dives = [*self._dives, dive][-ENDS:]
        return part


def _by_clock(ends: Array, begin: float, usual: float, period: float) -> float:
    """[s] Duration to the clock time nearest to the usual end; NaN if dives are much shorter."""
    if usual < 0.5 * period:
        return np.nan
    turn = 2.0 * np.pi / period
    phase = float(np.angle(np.exp(1j * turn * ends).sum())) / turn
    end = phase + period * np.round((begin + usual - phase) / period)
    return float(end - begin + (period if end < begin + SHORTEST else 0.0))


def middle(mixture: Mixture) -> float:
    """[s] Weighted median of the models' durations: always the duration of one model."""
    order = np.argsort(mixture.means[:, 0], kind="stable")
    reached = np.searchsorted(np.cumsum(mixture.weights[order]), 0.5)
    return float(mixture.means[order[min(int(reached), len(order) - 1)], 0])


class Delays(NamedTuple):
    """Timing errors of members; the first member has the usual surface interval and no error."""

    stays: Array
    """[s] surface interval before each dive, (member, dive)"""
    late: Array
    """[1] relative change of the duration of all dives of a member, (member,): one value for all,
    since a pilot's new order holds for all following dives"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rhythm:
    """Statistics from which surface intervals and durations of later dives are sampled."""

    stays: Array
    """[s] last surface intervals, (stay,)"""
    late: Mixture
    """[s] duration of the next dive, by each model"""

    @classmethod
    def of(cls, schedule: SurfacingSchedule, dives: Sequence[DiveTime]) -> Rhythm | None:
        """Collect the statistics of all dives; None if fewer than two intervals are known.

        Args:
          schedule: pool that has learned from these dives.
        """
        stays = np.array([one.stay for one in dives[1:]])
        stays = stays[(stays >= 0.0) & (stays < LONGEST_STAY)][-STAYS:]
        if len(stays) < 2:
            return None
        return cls(stays=stays, late=schedule.expect(dives[-1].end + float(np.median(stays))))

    def draw(self, count: int, dives: int, waited: float, rng: np.random.Generator) -> Delays:
        """Sample surface intervals and changes of duration for `count` members.

        Args:
          waited: [s] time at the surface before the forecast begins.
        """
        stays = _further(self.stays, (count, dives), rng)
        lasts = self.late.draw(count, FREEDOM, rng)[:, 0]
        late = lasts / middle(self.late) - 1.0
        stays[0], late[0] = np.median(self.stays), 0.0
        if waited < float(self.stays.max()):
            stays[:, 0] = np.maximum(stays[:, 0] - max(waited, 0.0), 0.0)
        return Delays(stays, np.clip(late, SHORTENED, LENGTHENED))

    @property
    def words(self) -> str:
        """Surface interval and scatter of durations in words."""
        deviation = math.sqrt(float(self.late.covariance[0, 0])) / middle(self.late)
        return (
            f"{np.median(self.stays) / 60.0:.0f} min at the surface ({self.stays.min() / 60.0:.0f} "
            f"to {self.stays.max() / 60.0:.0f} so far), dives +-{100.0 * deviation:.0f} %"
        )


def _further(known: Array, shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Sample the predictive distribution of the next value, given n observed ones (exchangeable).

    Each gap between ordered known values and each of the two tails has a probability of 1 / (n + 1)
    (Vovk, Gammerman and Shafer 2005, Algorithmic Learning in a Random World, section 4.2). A tail
    is exponential; its mean is the distance of its end from the median. No value is below 0.
    """
    ordered = np.sort(known)
    rank = rng.uniform(0.0, len(ordered) + 1.0, size=shape)
    beyond = rng.standard_exponential(shape)
    low, middle_, high = ordered[0], np.median(ordered), ordered[-1]
    drawn = np.interp(rank, np.arange(1, len(ordered) + 1), ordered)
    drawn = np.where(rank < 1.0, low - beyond * (middle_ - low), drawn)
    drawn = np.where(rank > len(ordered), high + beyond * (high - middle_), drawn)
    return np.maximum(drawn, 0.0)
