"""Leg: the way of a vehicle from one fix to the next, as tuning and scoring take it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.navigation.current.current_parameters import CurrentParameters
from twin.navigation.current.filter import FIX_DEVIATION, CurrentFilter
from twin.navigation.current.modes import Innovation

Array = NDArray[np.float64]


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
        if self.through_water is None:
            return np.full(2, np.nan)
        return (np.array(self.over_ground) - np.array(self.through_water)) / self.duration

    def foretold(self, parameters: CurrentParameters) -> Array:
        """North, east [m/s] of the field as far as it is believed, (2,); 0 without."""
        return parameters.field * np.array((0.0, 0.0) if self.field is None else self.field)


def begin_leg(filter_: CurrentFilter, leg: Leg, sigma: float = FIX_DEVIATION) -> None:
    """Bring a filter to the fix before a leg; positions count from there."""
    if leg.start > filter_.time:
        filter_.step(leg.start - filter_.time, None)
    filter_.locate((0.0, 0.0), sigma)


def pass_leg(
    filter_: CurrentFilter,
    leg: Leg,
    sigma: float = FIX_DEVIATION,
    covariance: Array | None = None,
) -> Innovation | None:
    """Let a filter make a leg, which it has begun, and take the fix after it.

    Args:
      sigma: [m] of the fix.
      covariance: [m2/s2], (2, 2), of the velocity through the water, mean over the leg.
    """
    field = leg.foretold(filter_.parameters)
    filter_.step(leg.duration, leg.velocity, covariance, field=field)
    return filter_.fix(leg.over_ground, sigma)


def replay(
    filter_: CurrentFilter, legs: Iterable[Leg], covariance: Array | None = None
) -> Sequence[Innovation]:
    """What the fixes of legs, in order of time, said to a filter; `covariance` as `pass_leg`."""
    found = []
    for leg in legs:
        begin_leg(filter_, leg)
        innovation = pass_leg(filter_, leg, covariance=covariance)
        if innovation is not None:
            found.append(innovation)
    return found
