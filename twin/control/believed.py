"""Believed: a vehicle's state as estimated on board, by methods named as those of `Physics`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from twin.navigation.navigator import NavigationState
from twin.navigation.settings import Navigation
from twin.numbers import Array
from twin.physics.model_block import header, table
from twin.physics.native import block
from twin.physics.navigated import OnBoard
from twin.physics.scenario import Scenario
from twin.physics.start import Start
from twin.physics.true_signals import LiveTruth
from twin.vehicle.steady_motion import net_mass
from twin.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from twin.control.physics import Physics


LARGEST_SEED = 2**31


class Believed:
    """State estimate from which observations of a navigated environment are made.

    Methods of `Physics` whose values cannot be known on board are missing.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        navigation: Navigation,
        *,
        period: float,
        samples: int,
    ):
        """Prepare for episodes of at most `samples` samples, one every `period` [s].

        Raises:
          InputError: the estimator does not suit the vehicle.
        """
        self.vehicle, self._navigation = vehicle, navigation
        self._period, self._samples = period, samples
        navigation.open(vehicle, period)
        self.restart(np.random.RandomState(0))

    def restart(self, random: np.random.RandomState) -> None:
        """End the episode; the next `look` starts another, with sensor errors from `random`."""
        self._random = random
        self._on_board: OnBoard | None = None
        self._time = -math.inf

    def look(self, physics: Physics) -> None:
        """Take a sample of the sensors, at most one for each time."""
        time = physics.time()
        if self._on_board is not None and time <= self._time:
            return
        raw, model = physics.mj_data, physics.mj_model
        if self._on_board is None:
            row = block.log_row(model.nq, model.nv, model.nu)
            floor = table(model, "floor")
            half = 0.5 * float(header(model)["centred"]) * float(model.opt.timestep)
            self._truth = LiveTruth(self.vehicle, row, half_step=half, floor=floor)
            self._row = np.zeros(1, row)[0]
            self._on_board = self._begin(physics, floor, table(model, "current"))
        water = block_state(physics)
        row = self._row
        row["qpos"], row["qvel"], row["act"], row["ctrl"] = raw.qpos, raw.qvel, raw.act, raw.ctrl
        for name in ("current", "density", "immersion", "net_mass"):
            row[name] = water[name]
        change = np.zeros(6)
        if water["known"]:
            change = (raw.qvel[:6] - water["earlier"]) / float(model.opt.timestep)
        self._on_board.take(self._truth.sample(row, change))
        self._time = time
        self._seen = self._on_board.observe(time)

    def _begin(self, physics: Physics, floor: Array, current: Array) -> OnBoard:
        seed = int(self._random.randint(LARGEST_SEED))
        depth = max(physics.depth(), 0.1)  # a `Start` needs a depth above 0
        scenario = Scenario(
            vehicle=self.vehicle,
            navigate=dataclasses.replace(self._navigation, seed=seed),
            start=Start(north=physics.north(), east=physics.east(), depth=depth),
            duration=self._samples * self._period,
            sample_period=self._period,
        )
        return OnBoard(scenario, self._truth.names, self._samples, floor=floor, current=current)

    @property
    def _belief(self) -> NavigationState:
        assert self._on_board is not None
        assert self._on_board.belief is not None
        return self._on_board.belief

    def time(self) -> float:
        """Time of the last sample [s]."""
        return self._time

    def __getattr__(self, name: str) -> Callable[[], float]:
        """Measure north, east, depth [m] or roll, pitch, heading in [0, 2 pi) [rad]."""
        if name not in ("north", "east", "depth", "roll", "pitch", "heading"):
            raise AttributeError(name)
        return lambda: float(getattr(self._seen, name))

    def rates(self) -> Array:
        """Roll, pitch, yaw rate [rad/s], (3,)."""
        return np.array([self._seen.roll_rate, self._seen.pitch_rate, self._seen.yaw_rate])

    def velocity_through_water(self) -> Array:
        """Estimated surge, sway, heave [m/s], (3,)."""
        belief = self._belief
        return np.array([belief.surge, belief.sway, belief.heave])

    def surge(self) -> float:
        """Estimated surge [m/s] through the water."""
        return float(self.velocity_through_water()[0])

    def speed(self) -> float:
        """Estimated speed [m/s] through the water."""
        return float(np.linalg.norm(self.velocity_through_water()))

    def depth_rate(self) -> float:
        """Estimated vertical velocity of the vehicle [m/s], positive down."""
        return self._belief.depth_rate

    def current(self) -> Array:
        """Estimated current, NED [m/s], (3,); its vertical component is taken as zero."""
        return np.array([self._seen.current_north, self._seen.current_east, 0.0])

    def actuators(self) -> Array:
        """Measured positions of the parts as fractions of their travel, -1 to 1, (parts,)."""
        positions = np.array([self._seen.parts[name] for name in self.vehicle.part_names])
        low, high = self.vehicle.actuator_min, self.vehicle.actuator_max
        return np.asarray(2.0 * (positions - low) / (high - low) - 1.0)

    def net_buoyancy(self) -> float:
        """Net buoyancy mass [kg] from measured pump and depth, positive = heavy."""
        pump = self.vehicle.steered("buoyancy")
        if pump is None:
            return 0.0
        volume, depth = np.array([self._seen.parts[pump.name]]), np.array([self._seen.depth])
        return float(net_mass(self.vehicle, volume, np.maximum(depth, 0.0))[0])


def block_state(physics: Physics) -> np.void:
    """State that native code keeps of the water at the vehicle, a record of `block.STATE`."""
    found: np.void = physics.mj_data.userdata[: block.STATE_WORDS].view(block.STATE)[0]
    return found
