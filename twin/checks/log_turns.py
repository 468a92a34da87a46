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
from twin.checks.log_flight import mission_of, scenario_of
from twin.checks.replayed_dive import ReplayedDive
from twin.mission.controller import Command, MissionController, Observation
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.simulation import Simulation
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]


class _Turned:
    """Guidance whose turning part follows the log's positions from the start of each leg."""

    def __init__(self, vehicle: Vehicle, dive: ReplayedDive, part: str, positions: Array):
        self._guidance = MissionController(mission_of(vehicle, dive), vehicle)
        self._legs = [k for k, target in enumerate(dive.targets) for _ in target.pieces]
        self._dive, self._part, self._positions = dive, part, positions
        self.begun: list[tuple[float, int]] = []
        """[s] and number of each leg, -1 for the end"""

    def __call__(self, observation: Observation) -> Command:
        command = self._guidance(observation)
        leg = -1
        if not self._guidance.done:
            leg = self._legs[min(self._guidance.segment, len(self._legs) - 1)]
        if not self.begun or leg != self.begun[-1][1]:
            self.begun.append((observation.time, leg))
        if leg < 0:
            return command
        logged = self._dive.targets[leg].leg
        since = round((observation.time - self.begun[-1][0]) / self._dive.period)
        position = float(self._positions[min(logged.first + since, logged.last)])
        return Command(**{**command, self._part: position})

    def legs(self, time: Array) -> Array:
        """Number of the leg at each time [s], (time,); -1 where none is flown."""
        times, numbers = zip(*self.begun, strict=True)
        return np.array(numbers)[np.searchsorted(times, time, side="right") - 1]


def fly_turns(
    vehicle: Vehicle, dive: ReplayedDive, flown: Trajectory, turning: Turning
) -> tuple[Trajectory, Array]:
    """A dive with the log's turns, and the number of the leg at each sample, (time,).

    Args:
      flown: the twin's flight of the dive in closed loop, which says how long it takes.
      turning: whose part is of the log's kind.

    Raises:
      SimulationUnstable: with the trajectory up to that time as `partial`.
    """
    assert dive.turning is not None
    part = vehicle.part(turning.part)
    positions = np.clip(turning.sense * dive.turning / part.quantity.scale, part.low, part.high)
    controller = _Turned(vehicle, dive, part.name, positions)
    scenario = scenario_of(vehicle, dive, float(flown.time[-1]), plan=False)
    with quiet_mujoco():
        trajectory = Simulation(scenario).run(controller, mission=dive.row)
    return trajectory, controller.legs(trajectory.time)


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
