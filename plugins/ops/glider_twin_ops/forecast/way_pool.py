"""Way: what a pilot expects of the way through the water of a dive that begins now.

The vehicle is sent to waypoints. By its own reckoning it goes straight to each, at the speed of its
recent dives; where it steers against the current that it believes in, its heading leans into that
current. How it did so on recent dives says which of the ways below is to be believed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from glider_twin_ops.forecast.logged_leg import LoggedLeg
from glider_twin_ops.forecast.pool import Mixture, Pool, Prior
from twin.numbers import Array

Place = tuple[float, float]

ARRIVED = 20.0
"""[m] from a waypoint at which the next one is gone to: a Slocum's lists say 10 m and more"""
STEEPEST = 0.95
"""[1] sine of the most that a heading leans into a current across: beyond, no way is made"""
FORGETTING = 0.9
"""See `Pool`: where a vehicle is sent, and how, changes faster than the sea"""
RECENT = 7
"""Dives whose median is the speed"""
FASTEST, COARSE, FINE = 1.5, 0.05, 0.01
"""[m/s] up to which the speed of a dive along its waypoints is looked for, and its two steps"""
ALONG = 0.3
"""[1] of its way by which a dive may miss the way to its waypoints, for its speed to be by them"""


def guided_way(
    targets: Sequence[Place], speed: float, believed: Place, duration: float
) -> Place | None:
    """Way through the water to waypoints; beyond the last of them straight on.

    Args:
      targets: north, east [m] from the start, in order.
      speed: [m/s] through the water, level.
      believed: north, east [m/s] of the current with which the vehicle reckons.
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
    """Velocity through the water that makes way toward a place, and the speed of that way [m/s]."""
    beside = drift * toward.conjugate()  # along and across
    lean = math.copysign(min(abs(beside.imag), STEEPEST * speed), -beside.imag)
    along = math.sqrt(speed**2 - lean**2)
    return complex(along, lean) * toward, along + beside.real


def plain_velocity(before: Sequence[LoggedLeg], targets: Sequence[Place]) -> Array:
    """The speed of the last three dives toward the first waypoint, or where the last one went.

    Args:
      before: the dives so far, at least one. targets: of the dive that begins.

    Returns:
      North, east [m/s], (2,).
    """
    speed = float(np.mean([np.hypot(*_velocity(one)) for one in before[-3:]]))
    toward = np.array(targets[0]) if targets else _velocity(before[-1])
    away = float(np.hypot(*toward))
    return speed * toward / away if away > 0.0 else np.zeros(2)


def _velocity(one: LoggedLeg) -> Array:
    """Through the water, mean over a dive [m/s], (2,)."""
    assert one.leg.velocity is not None  # legs of a store have a way
    return one.leg.velocity


GUIDED, AGAIN, NOWHERE = "to its waypoints", "as the last dive", "nowhere in the mean"
PRIORS: Mapping[str, Prior] = {
    GUIDED: Prior(0.32, 0.063),
    AGAIN: Prior(0.54, 0.071),
    NOWHERE: Prior(0.2, 0.14),
}
"""Of each kind of way, as deployments have them in common (`python -m benchmarks.surfacings`);
scales in m/s"""


class WayPool:
    """Kinds of ways, mixed by what they were worth on the dives so far."""

    def __init__(self, priors: Mapping[str, Prior] = PRIORS):
        self.pool = Pool(
            {name: priors[name] for name in (GUIDED, AGAIN, NOWHERE)}, forgetting=FORGETTING
        )
        self._speeds: list[float] = []
        self._last: LoggedLeg | None = None

    @property
    def speed(self) -> float | None:
        """[m/s] level, of recent dives; None before the first."""
        return float(np.median(self._speeds[-RECENT:])) if self._speeds else None

    def steered(self, one: LoggedLeg) -> Place:
        """The current that a vehicle steers against, north and east [m/s]: what it believes, where
        on the last dive its own track held that."""
        last = self._last
        if last is None or one.believed is None or not _reckons(last):
            return 0.0, 0.0
        return one.believed

    def expect(self, one: LoggedLeg, duration: float) -> Mixture:
        """Velocity through the water [m/s], mean over a dive that begins now.

        Args:
          one: of it are read the waypoints and what the vehicle believes.
          duration: [s] expected.
        """
        return self.toward(one.targets, self.steered(one), duration)

    def toward(self, targets: Sequence[Place], steered: Place, duration: float) -> Mixture:
        """The same to targets, north and east [m] from its begin, leaning into the current
        `steered` [m/s]."""
        said = np.full((3, 2), np.nan)
        said[2] = 0.0
        if self._last is not None and self.speed is not None:
            guided = guided_way(targets, self.speed, steered, duration)
            if guided is not None:
                said[0] = np.array(guided) / duration
            said[1] = _velocity(self._last)
        return self.pool.expect(said)

    def learn(self, one: LoggedLeg) -> Array:
        """Take a dive that has ended; returns the part of each kind in explaining its way."""
        self.expect(one, one.leg.duration)
        part = self.pool.learn(_velocity(one))
        self._speeds.append(_speed_of(one))
        self._last = one
        return part


def _reckons(one: LoggedLeg) -> bool:
    """Whether a vehicle's own track held the current that it believed in."""
    if one.onboard is None or one.believed is None:
        return False
    held = np.array(one.onboard) / one.leg.duration - _velocity(one)
    return bool(np.hypot(*(held - np.array(one.believed))) < np.hypot(*held))


def _speed_of(one: LoggedLeg) -> float:
    """[m/s] through the water along the waypoints; where the way was not theirs, by its length."""
    straight = float(np.hypot(*_velocity(one)))
    if not one.targets:
        return straight
    believed = one.believed if one.believed is not None and _reckons(one) else (0.0, 0.0)
    assert one.leg.through_water is not None
    through = one.leg.through_water

    def beside(speed: float) -> float:
        way = guided_way(one.targets, speed, believed, one.leg.duration)
        return math.inf if way is None else math.dist(way, through)

    near = min(np.arange(COARSE, FASTEST, COARSE).tolist(), key=beside)
    best = min((near + FINE * np.arange(-4, 5)).tolist(), key=beside)
    return best if beside(best) < ALONG * math.hypot(*through) else straight
