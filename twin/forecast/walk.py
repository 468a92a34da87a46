"""Walk: each surfacing of a deployment forecast from what was known before its dive.

At the fix before a dive are known: all fixes so far, and with them all currents so far. From there
on the way through the water is taken as `legs` has it, and the same for every method: what is
forecast is the displacement by the current. Persistence adds the current of the dive before,
`no_current` none. Where there is a forecast field, what it foretells of the dive is known, too. The
filter goes on learning the course of the current at every fix; its
parameters stay those of the training part.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.geodesy import position
from twin.logs.logged_leg import LoggedLeg
from twin.navigation.current import CurrentFilter, CurrentParameters, begin_leg, pass_leg
from twin.navigation.dead_reckoning import chi_squared

Array = NDArray[np.float64]

HALF, NINETY = chi_squared(0.5), chi_squared(0.9)
"""Squared distances within which the parts lie that the ellipses shall hold"""
HOUR = 3600.0
"""[s]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HindcastSurfacing:
    """One surfacing, forecast and found."""

    mission: int
    """Row in the store."""
    time: float
    """[s] unix"""
    hours: float
    """[h] since the fix before"""
    method: str
    """How its way through the water was found"""
    scored: bool
    """False in the training part and where no dive before told a current"""
    places: dict[str, tuple[float, float]]
    """Latitude, longitude [degree]: `begin`, `fix`, and where each method has it"""
    missed: dict[str, tuple[float, float]]
    """North, east [m]: the fix less where each method had it; without persistence at the first"""
    covariance: Array
    """[m2] of the forecast, (2, 2)"""
    current: tuple[float, float]
    """North, east [m/s], mean over the dive"""
    expected: tuple[float, float]
    """The same as the filter forecast it"""

    def error(self, method: str) -> float:
        """[m/h] distance by which a method missed, by the time; NaN where it said nothing."""
        if method not in self.missed:
            return float("nan")
        return float(np.hypot(*self.missed[method])) / self.hours

    @property
    def distance(self) -> float:
        """[1] squared Mahalanobis distance of the fix from the forecast."""
        missed = np.array(self.missed["forecast"])
        return float(missed @ np.linalg.solve(self.covariance, missed))


def walk(
    legs: Sequence[LoggedLeg], parameters: CurrentParameters, *, latitude: float, train: int
) -> list[HindcastSurfacing]:
    """Forecast every leg's end.

    Args:
      legs: of one deployment, in order of time.
      parameters: of the current.
      latitude: [degree] of the deployment.
      train: legs at the beginning that are not scored.
    """
    if not legs:
        return []
    filter_ = CurrentFilter(parameters, latitude=latitude, time=legs[0].leg.start)
    found: list[HindcastSurfacing] = []
    before: Array | None = None
    for k, one in enumerate(legs):
        leg = one.leg
        begin_leg(filter_, leg)
        field = leg.foretold(parameters)
        ahead = filter_.forecast([leg.end], leg.velocity, field=field)
        way, ground = np.array(leg.through_water), np.array(leg.over_ground)
        reached = {"forecast": way + ahead.displacement[0], "no_current": way}
        if before is not None:
            reached["persistence"] = way + leg.duration * before
        if one.onboard is not None:
            reached["onboard"] = np.array(one.onboard)
        found.append(
            HindcastSurfacing(
                mission=one.mission,
                time=leg.end,
                hours=leg.duration / HOUR,
                method=one.method,
                scored=k >= train and before is not None,
                places={
                    "begin": one.begin,
                    **{
                        name: _place(metres, one.begin)
                        for name, metres in {"fix": ground, **reached}.items()
                    },
                },
                missed={name: _pair(ground - metres) for name, metres in reached.items()},
                covariance=ahead.displacement_covariance[0],
                current=_pair(leg.current),
                expected=_pair(ahead.displacement[0] / leg.duration),
            )
        )
        pass_leg(filter_, leg)
        before = leg.current
    return found


def _place(metres: Array, begin: tuple[float, float]) -> tuple[float, float]:
    latitude, longitude = position(metres[:1], metres[1:], *begin)
    return float(latitude[0]), float(longitude[0])


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])
