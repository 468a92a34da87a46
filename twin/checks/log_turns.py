"""Turns: the twin flown with the positions of the log's turning part, so that both have one input.

In closed loop a twin in calm water hardly moves its rudder, where the log's works against waves and
a compass' noise. Here pitch and pump stay in closed loop and the heading is left to itself.

It also finds a swing that does not die out, as a badly tuned control loop makes it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend

from twin.checks.heading_leg import Turning
from twin.checks.log_flight import legs_flown, mission_of, scenario_of, segment_legs
from twin.checks.replayed_dive import ReplayedDive
from twin.errors import SimulationUnstable
from twin.mission.controller import (
    MEMORY,
    Command,
    FollowedPositions,
    MissionController,
    Observation,
    followed,
)
from twin.physics.lanes import fly_in_lanes
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.simulation import Simulation
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]


FlownTurn = tuple[ReplayedDive, Trajectory, Array]
"""A dive, its flight with the log's turns, and the number of the leg at each sample, (time,)"""


class _Turned:
    """Guidance whose turning part follows the log's positions from the start of each leg."""

    def __init__(self, vehicle: Vehicle, dive: ReplayedDive, follow: FollowedPositions):
        self._guidance = MissionController(mission_of(vehicle, dive), vehicle)
        self._legs = segment_legs(dive)
        self._part = vehicle.part_names[follow.part]
        self._table, self._memory = follow.table(), np.zeros(MEMORY)
        self.begun: list[tuple[float, int]] = []
        """[s] and number of each leg, -1 for the end"""

    def __call__(self, observation: Observation) -> Command:
        command = self._guidance(observation)
        segment = self._guidance.segment
        leg = -1
        if not self._guidance.done:
            leg = self._legs[min(segment, len(self._legs) - 1)]
        if not self.begun or leg != self.begun[-1][1]:
            self.begun.append((observation.time, leg))
        if leg < 0:
            return command
        position = followed(self._table, self._memory, observation.time, segment)
        return Command(**{**command, self._part: float(position)})

    def legs(self, time: Array) -> Array:
        """Number of the leg at each time [s], (time,); -1 where none is flown."""
        times, numbers = zip(*self.begun, strict=True)
        return np.array(numbers)[np.searchsorted(times, time, side="right") - 1]


def fly_turns(
    vehicle: Vehicle,
    flown: Sequence[tuple[ReplayedDive, Trajectory]],
    turning: Turning,
    engine: str = "mujoco",
) -> tuple[list[FlownTurn], list[SimulationUnstable]]:
    """Dives with the log's turns, and what ended those that could not be flown.

    Args:
      flown: dives that have turns, with the twin's flight in closed loop, which says how long one
        takes.
      turning: whose part is of the log's kind.
      engine: as of `Scenario`; in lanes the dives fly side by side.
    """
    follow = [_followed(vehicle, dive, turning) for dive, _ in flown]
    if engine == "lanes":
        scenarios = [
            dataclasses.replace(scenario_of(vehicle, d, float(f.time[-1])), engine=engine)
            for d, f in flown
        ]
        runs = fly_in_lanes(scenarios, follow=follow)
        return (
            [
                (dive, run, legs_flown(dive, run))
                for (dive, _), run in zip(flown, runs, strict=True)
                if isinstance(run, Trajectory)
            ],
            [run for run in runs if isinstance(run, SimulationUnstable)],
        )
    found: list[FlownTurn] = []
    failed: list[SimulationUnstable] = []
    for (dive, flight), positions in zip(flown, follow, strict=True):
        controller = _Turned(vehicle, dive, positions)
        scenario = scenario_of(vehicle, dive, float(flight.time[-1]), plan=False)
        try:
            with quiet_mujoco():
                run = Simulation(scenario).run(controller, mission=dive.row)
        except SimulationUnstable as error:
            failed.append(error)
        else:
            found.append((dive, run, controller.legs(run.time)))
    return found, failed


def _followed(vehicle: Vehicle, dive: ReplayedDive, turning: Turning) -> FollowedPositions:
    """What the turning part does in place of its guidance."""
    assert dive.turning is not None
    part = vehicle.part(turning.part)
    legs = [dive.targets[k].leg for k in segment_legs(dive)]
    return FollowedPositions(
        part=vehicle.part_names.index(part.name),
        period=dive.period,
        positions=np.clip(turning.sense * dive.turning / part.quantity.scale, part.low, part.high),
        legs=tuple((leg.first, leg.last) for leg in legs),
    )


LEAST_AMPLITUDE = {"heading": 1.0, "pitch": 0.5, "roll": 1.0}
"""[deg] of a swing that counts, by the signal"""
CYCLES = 3.0
"""Periods that a leg must hold at least: of fewer nobody knows whether they go on"""
SHORTEST = 4
"""samples of a period"""
WIDTH = 0.15
"""Part of its frequency by which a swing may wander within a leg, as speed and trim do"""
SHARE = 0.5
"""Part of the variance that the swing must be: noise is spread over all periods"""
LASTING = 0.7
"""Amplitude in the second half over that in the first; less, and it dies out"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Oscillation:
    """A swing at a steady period."""

    signal: str
    """heading, pitch or roll"""
    period_s: float
    amplitude_deg: float
    growth: float
    """Amplitude in the second half of a leg over that in the first"""
    legs: float
    """Part of the legs that show it"""


def oscillation_of(name: str, values: Array, period: float) -> Oscillation | None:
    """The swing of one signal in one leg, or None.

    Args:
      name: of the signal, a key of LEAST_AMPLITUDE.
      values: deviation from the target [deg], equally spaced, (time,).
      period: [s] between samples.
    """
    count = len(values)
    if count < CYCLES * SHORTEST:
        return None
    swing = detrend(values)
    power = np.abs(np.fft.rfft(swing)) ** 2
    total = float(power[1:].sum())
    lowest, highest = int(np.ceil(CYCLES)), count // SHORTEST
    if total == 0.0 or highest < lowest:
        return None
    peak = lowest + int(np.argmax(power[lowest : highest + 1]))
    wide = max(1, round(WIDTH * peak))
    share = float(power[max(peak - wide, 1) : peak + wide + 1].sum()) / total
    half = count // 2
    early, late = (float(np.std(swing[part])) for part in (slice(half), slice(half, None)))
    amplitude = float(np.sqrt(2.0 * share * np.mean(swing**2)))
    growth = late / early if early > 0.0 else float("inf")
    if amplitude < LEAST_AMPLITUDE[name] or share < SHARE or growth < LASTING:
        return None
    return Oscillation(
        signal=name, period_s=count * period / peak, amplitude_deg=amplitude, growth=growth, legs=1
    )


def limit_cycle(
    legs: Sequence[Mapping[str, Oscillation | None]], least: float
) -> Oscillation | None:
    """The largest swing among those that at least a part of the legs show, their medians.

    Args:
      legs: of each leg, what `oscillation_of` found, by signal.
      least: that part.
    """
    found = []
    for name in LEAST_AMPLITUDE:
        mine = [one for leg in legs if (one := leg.get(name)) is not None]
        if mine and len(mine) >= least * len(legs):
            median = {
                field: float(np.median([getattr(one, field) for one in mine]))
                for field in ("period_s", "amplitude_deg", "growth")
            }
            found.append(Oscillation(signal=name, legs=len(mine) / len(legs), **median))
    return max(found, key=lambda one: one.amplitude_deg / LEAST_AMPLITUDE[one.signal], default=None)
