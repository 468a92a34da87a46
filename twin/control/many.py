"""Many: vehicles side by side in one `mujoco.batch`, with the measurements of `Physics`.

All vehicles share one compiled model. Each has its own copy of the parameter block, which holds its
water and its differences from the others. A step here equals a step of `Physics` bit for bit.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike, NDArray

from twin.control.conditions import (
    OF_THE_VEHICLE,
    Conditions,
    Nominal,
    place_vehicle,
    write_conditions,
)
from twin.errors import InputError
from twin.frames import flip_vector
from twin.numbers import Array
from twin.physics.model_block import header, part_table
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.native import block as b
from twin.physics.start import Start
from twin.vehicle.vehicle import Vehicle

_VELOCITY_STAGE = mujoco.mjtStage.mjSTAGE_VEL.value
"""Stage after which positions, velocities and water belong to the new state, as in `Physics`."""
_INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION.value


class ManyPhysics:
    """`count` vehicles of one model; measurements have the vehicle as their first axis."""

    def __init__(
        self,
        model: mujoco.MjModel,
        count: int,
        *,
        threads: int = 0,
        real_vehicles: bool = False,
    ):
        """Put `count` vehicles at the model's initial state.

        Args:
          model: from `compile_model`, time-centred or not; this object keeps it for itself.
          real_vehicles: let vehicles differ in more than their water.
          threads: number of threads, 0 takes every core. Results do not depend on it.

        Raises:
          InputError: `count` is below 1. VehicleError: the model carries no parameter block.
        """
        if count < 1:
            raise InputError(f"{count} vehicles: give at least 1")
        self.model, self.count = model, count
        self._data = mujoco.MjData(model)
        varied = OF_THE_VEHICLE if real_vehicles else ()
        self.batch = Batch(model, count, threads)
        self._own = {name: self.batch.expand(name) for name in ("numeric_data", *varied)}
        self._head = header(model)
        self._hull = int(self._head["hull_body"])
        parts = part_table(model)
        self._low, self._span = parts["low"].copy(), parts["high"] - parts["low"]
        bind = self.batch.bind
        self._qpos, self._qvel, self._act = bind("qpos"), bind("qvel"), bind("act")
        self._time, self._ctrl = bind("time"), bind("ctrl")
        self._water = bind("userdata")[:, : b.STATE_WORDS].view(b.STATE)[:, 0]
        self._rotation = bind("xmat")[:, self._hull].reshape(count, 3, 3)
        self._nominal = Nominal(model)

    # --- beginning and going on ---------------------------------------------------------------

    def place(
        self,
        at: tuple[int, ...],
        start: Start,
        *,
        vehicle: Vehicle,
        conditions: Conditions | None,
        duration: float,
    ) -> None:
        """Write the start of the vehicle at (index,); call `settle` next.

        Args:
          vehicle: vehicle of the file. conditions: the real vehicle's errors, and its water.
          duration: time [s] for which the water is compiled.

        Raises:
          InputError: the water exceeds the model's room.
        """
        model, data, (index,) = self.model, self._data, at
        self._nominal.restore()
        if conditions is not None:
            write_conditions(model, data, vehicle, conditions, duration)
        mujoco.mj_resetData(model, data)
        place_vehicle(model, data, start, vehicle, conditions)
        for name, values in self._own.items():
            values[index] = getattr(model, name)
        mujoco.mj_getState(model, data, self.batch.state[index], _INTEGRATION)
        self.batch.warning[index] = 0

    def settle(self, which: NDArray[np.bool_]) -> None:
        """Update measurements after new starts of the vehicles in the mask `which`, (count,)."""
        with quiet_mujoco():
            self.batch.forward(which)

    def set_control(self, commands: ArrayLike) -> None:
        """Command the parts, in their order and units, shape (count, parts)."""
        self._ctrl[...] = commands

    def step(self, steps: int, which: NDArray[np.bool_]) -> None:
        """Advance the vehicles of the mask `which`, (count,), by `steps` physics steps."""
        with quiet_mujoco():
            self.batch.step(which, nstep=steps, stage=_VELOCITY_STAGE)

    def failed(self) -> NDArray[np.bool_]:
        """Mask of the vehicles whose state is no longer finite since their start, (count,)."""
        return (self._water["failed"] != 0.0) | self.batch.warning[:, :, 1].any(axis=1)

    # --- measurements -------------------------------------------------------------------------

    def time(self) -> Array:
        """Time since the start [s], (count,)."""
        return self._time.copy()

    def north(self) -> Array:
        """Position north of the origin [m], (count,)."""
        return self._qpos[:, 0].copy()

    def east(self) -> Array:
        """Position east of the origin [m], (count,)."""
        return -self._qpos[:, 1]

    def depth(self) -> Array:
        """Depth of the CB [m], (count,)."""
        return -self._qpos[:, 2]

    def roll(self) -> Array:
        """Roll [rad], positive starboard down, (count,)."""
        return np.arctan2(self._rotation[:, 2, 1], self._rotation[:, 2, 2])

    def pitch(self) -> Array:
        """Pitch [rad], positive nose up, (count,)."""
        return np.arcsin(np.clip(self._rotation[:, 2, 0], -1.0, 1.0))

    def heading(self) -> Array:
        """Heading [rad] in [0, 2 pi), (count,)."""
        return np.arctan2(-self._rotation[:, 1, 0], self._rotation[:, 0, 0]) % (2.0 * np.pi)

    def _centred(self, part: slice) -> Array:
        velocity = self._qvel[:, part]
        if not self._head["centred"]:
            return velocity.copy()
        known = self._water["known"][:, None]
        return velocity + 0.5 * known * (velocity - self._water["earlier"][:, part])

    def velocity_over_ground(self) -> Array:
        """Velocity over ground [m/s], NED, shape (count, 3)."""
        return flip_vector(self._centred(slice(0, 3)))

    def velocity_through_water(self) -> Array:
        """Surge, sway, heave [m/s], FRD, shape (count, 3)."""
        relative = self._centred(slice(0, 3)) - flip_vector(self._water["current"])
        return flip_vector(np.einsum("ni,nij->nj", relative, self._rotation))

    def rates(self) -> Array:
        """Roll, pitch, yaw rate [rad/s], FRD, shape (count, 3)."""
        return flip_vector(self._centred(slice(3, 6)))

    def depth_rate(self) -> Array:
        """Vertical velocity of the vehicle [m/s], positive down, (count,)."""
        return -self._centred(slice(2, 3))[:, 0]

    def speed(self) -> Array:
        """Speed through the water [m/s], (count,)."""
        return np.linalg.norm(self.velocity_through_water(), axis=1)

    def net_buoyancy(self) -> Array:
        """Net buoyancy mass [kg] of the immersed vehicle, positive = heavy, (count,)."""
        return self._water["net_mass"].copy()

    def immersion(self) -> Array:
        """Immersed fraction of the hull [1], (count,)."""
        return self._water["immersion"].copy()

    def current(self) -> Array:
        """Velocity of the water at the CB [m/s], NED, shape (count, 3)."""
        return self._water["current"].copy()

    def activation(self) -> Array:
        """Positions of the parts, in their order and units, shape (count, parts)."""
        return self._act.copy()

    def actuators(self) -> Array:
        """Positions of the parts as fractions of their travel, -1 to 1, shape (count, parts)."""
        return 2.0 * (self._act - self._low) / self._span - 1.0
