"""Flights: members flown side by side on all cores, each told as its track and its surfacings."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import SimulationUnstable
from twin.mission.segments.base import SURFACED_MARGIN_M
from twin.physics.fleet import Fleet
from twin.physics.quiet import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.records.trajectory import Trajectory
from twin.vehicle.consumption import Consumption

Array = NDArray[np.float64]

PER_CORE = 12
"""Members of a fleet for each core: enough to keep the cores busy, few enough to show progress"""
UNDER = 3.0
"""Times the depth that counts as surfaced, beyond which the vehicle has dived"""
THINNED = 30
"""Samples of a track for one point that is kept"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flight:
    """One member."""

    time: Array
    """[s] since the start of each surfacing, (surfacing,)"""
    place: Array
    """North, east [m] there, (surfacing, 2)"""
    energy: Array
    """[J] taken until then, (surfacing,)"""
    track: Array
    """North, east [m], thinned, (point, 2)"""
    duration: float
    """[s] of the flight"""
    taken: float
    """[J] in all"""


def fly(
    scenarios: Sequence[Scenario], *, threads: int = 0
) -> Iterator[list[Flight | SimulationUnstable]]:
    """Fly the first member alone, then the others in fleets; yields what each fleet found.

    Args:
      threads: of a fleet; 0 takes every core.
    """
    cores = threads or os.cpu_count() or 1
    rest = len(scenarios) - 1
    fleets = max(1, math.ceil(rest / (PER_CORE * cores)))
    ends = [1 + rest * k // fleets for k in range(fleets + 1)]
    chunks = [scenarios[:1], *(scenarios[a:b] for a, b in itertools.pairwise(ends) if b > a)]
    for chunk in chunks:
        with quiet_mujoco():
            results = Fleet(chunk, threads=threads).run()
        yield [
            result if isinstance(result, SimulationUnstable) else told(result, scenario)
            for result, scenario in zip(results, chunk, strict=True)
        ]


def told(run: Trajectory, scenario: Scenario) -> Flight:
    """The surfacings of a run."""
    vehicle = scenario.vehicle
    found = surfacings(run["true_depth"], 0.5 * vehicle.hull_length + SURFACED_MARGIN_M)
    energy = sum(Consumption.of(vehicle).signals(vehicle, run, run.time).values())
    assert isinstance(energy, np.ndarray)
    return Flight(
        time=run.time[found],
        place=run.position[found, :2],
        energy=energy[found],
        track=run.position[::THINNED, :2],
        duration=float(run.time[-1]),
        taken=float(energy[-1]),
    )


def surfacings(depth: Array, afloat: float) -> NDArray[np.int64]:
    """Indices of the samples at which a vehicle has come up from a dive.

    Args:
      depth: [m], (time,). afloat: [m] above which it counts as surfaced.
    """
    found, dived = [], False
    for k, below in enumerate(depth.tolist()):
        if below > UNDER * afloat:
            dived = True
        elif dived and below <= afloat:
            found.append(k)
            dived = False
    return np.array(found, dtype=np.int64)
