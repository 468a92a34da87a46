"""Consistency: whether a current filter errs as it says, on records that tuned nothing of it.

The sea's statistics are found in one half of the records and judged in the other, and the other way
round. A filter is consistent when its squared innovations, normalised by their stated covariances,
are 2 in the mean, and its ellipses hold what they shall (Bar-Shalom, Li and Kirubarajan 2001,
Estimation with Applications to Tracking and Navigation, section 5.4).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.navigation.current.filter import CurrentFilter
from twin.navigation.current.leg import Leg, replay
from twin.navigation.current.modes import Innovation
from twin.navigation.current.parameters import CurrentParameters
from twin.navigation.current.tuning import tune

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Consistency:
    """Of the fixes after dives; None where there is none of the kind."""

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
    speed_scale: float = CurrentParameters.speed_scale,
    compass: float = CurrentParameters.compass,
    noise: float = 0.0,
    memory: float = 60.0,
) -> Consistency:
    """Judge records of legs, each in order of time; legs without a known way are left out.

    Args:
      records: of missions or deployments in waters of one kind, each with its own current.
      latitude: [degree]
      speed_scale, compass: [1], [degree] as `tune` takes them.
      noise: [m/s], north and east each, of the velocity through the water.
      memory: [s] for which that lasts.

    Raises:
      InputError: legs that are not in order of time.
    """
    records = [[leg for leg in legs if leg.through_water is not None] for legs in records]
    said: list[tuple[Sequence[Leg], Sequence[Innovation]]] = []
    for half in (0, 1):
        parameters = tune(
            [], others=records[half::2], latitude=latitude, speed_scale=speed_scale,
            compass=compass, may_persist=False,
        ).parameters  # fmt: skip
        for legs in records[1 - half :: 2]:
            if legs:
                filter_ = CurrentFilter(
                    parameters, latitude=latitude, time=legs[0].start, memory=memory
                )
                said.append((legs, replay(filter_, legs, noise**2 * np.eye(2))))
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
        in_50=_mean([one.held(0.5) for one in every]),
        in_90=_mean([one.held(0.9) for one in every]),
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
