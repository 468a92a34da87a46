"""Physics: the glider as dm_control sees it, with its measurements by name.

The model is the one of `compile_model`, the callbacks are the native ones: a step here
is bit for bit a step of the batch. Measurements are in NED and FRD, SI units. They belong to the
present state: `step` and `after_reset` leave positions and velocities up to date.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np
from dm_control import mujoco as dm_mujoco
from dm_control.mujoco import wrapper
from dm_control.rl.control import PhysicsError
from numpy.typing import NDArray

from twin.errors import InputError, VehicleError
from twin.frames import flip_vector
from twin.physics.mujoco_model import compile_model, fluid_geoms, parameter_block, share
from twin.physics.native import block as b
from twin.physics.native import plant
from twin.physics.simulation import set_start, stagger
from twin.physics.start import Start
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle
from twin.water.current.base import Current
from twin.water.current.origin import Origin
from twin.water.current.sampler import sample

Array = NDArray[np.float64]

MEASUREMENTS = {
    "time": "s",
    "north": "m",
    "east": "m",
    "depth": "m",
    "depth_rate": "m/s",
    "roll": "rad",
    "pitch": "rad",
    "heading": "rad",
    "roll_rate": "rad/s",
    "pitch_rate": "rad/s",
    "yaw_rate": "rad/s",
    "surge": "m/s",
    "sway": "m/s",
    "heave": "m/s",
    "speed": "m/s",
    "angle_of_attack": "rad",
    "sideslip": "rad",
    "net_buoyancy": "kg",
    "immersion": "1",
    "density": "kg/m3",
    "current_north": "m/s",
    "current_east": "m/s",
    "current_down": "m/s",
    "shift": "m",
    "rotation": "rad",
    "pump": "cm3",
}
"""Every scalar measurement and its unit; each is a method of `Physics` or a part of one."""

_POINTERS = (b.P_TABLE, b.P_CURRENT, b.P_DENSITY, b.P_LOG)
"""Slots of the block that hold an address; the next slot holds the length."""


class Physics(dm_mujoco.Physics):
    """A glider in water: `dm_control.mujoco.Physics` with the twin's model and callbacks.

    Build it with `from_vehicle`. Models that `compile_model` did not make are refused, because
    they would move in vacuum. Keep the Physics alive while its model is stepped: it owns the
    tables (current, density) that the model's parameter block points into.
    """

    _tables: dict[int, Array]
    """What the block's addresses point to, by slot: it must live as long as the model."""

    # --- making one ---------------------------------------------------------------------------

    def __new__(cls, *args: Any, **keywords: Any) -> Self:
        """An instance that owns no tables yet; copies are made without `__init__`."""
        physics = super().__new__(cls, *args, **keywords)
        physics._tables = {}
        return physics

    @classmethod
    def from_vehicle(
        cls,
        vehicle: Vehicle | str = "glider",
        *,
        hydrodynamics: str = "coefficients",
        timestep: float | None = None,
        integrator: str | None = None,
    ) -> Self:
        """A glider in still water; the arguments are those of `compile_model`."""
        model = compile_model(
            vehicle, hydrodynamics=hydrodynamics, timestep=timestep, integrator=integrator
        )
        # as in the batch: RK4 evaluates between steps and is centred by itself
        staged = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        parameter_block(model)[b.P_CENTRED] = float(not staged)
        return cls.from_model(model)

    @classmethod
    def from_model(cls, model: mujoco.MjModel | wrapper.MjModel) -> Self:
        """From a model that `compile_model` made, taken as it is.

        Raises:
          VehicleError: the model does not carry the twin's parameter block.
        """
        if isinstance(model, mujoco.MjModel):
            model = wrapper.MjModel(model)
        _require_block(model.ptr)
        return super().from_model(model)

    @classmethod
    def from_xml_path(cls, file_path: str | Path) -> Self:
        """From a vehicle file; see `from_vehicle`."""
        return cls.from_vehicle(load_vehicle(file_path))

    @classmethod
    def from_xml_string(cls, xml_string: str, assets: Mapping[str, Any] | None = None) -> Self:
        """From the text of a vehicle file; `assets` must be empty: vehicle files stand alone."""
        return cls.from_vehicle(_vehicle_from_text(xml_string, assets))

    @classmethod
    def from_byte_string(cls, byte_string: bytes) -> Self:
        """From a binary model, in still water: what it pointed to stayed in another process."""
        return cls.from_model(_without_pointers(wrapper.MjModel.from_byte_string(byte_string)))

    @classmethod
    def from_binary_path(cls, file_path: str) -> Self:
        """From a file with a binary model, in still water; see `from_byte_string`."""
        return cls.from_model(_without_pointers(wrapper.MjModel.from_binary_path(file_path)))

    def reload_from_xml_path(self, file_path: str | Path) -> None:
        """Become a new instance of `from_xml_path`."""
        self._become(self.from_xml_path(file_path))

    def reload_from_xml_string(
        self, xml_string: str, assets: Mapping[str, Any] | None = None
    ) -> None:
        """Become a new instance of `from_xml_string`."""
        self._become(self.from_xml_string(xml_string, assets))

    def _become(self, other: Physics) -> None:
        self._reload_from_data(other.data)
        self._tables = other._tables

    def _reload_from_data(self, data: wrapper.MjData) -> None:
        model = data.model.ptr
        _require_block(model)
        plant.install()
        super()._reload_from_data(data)
        self._block = parameter_block(model)
        raw = data.ptr
        self._rotation = raw.xmat[int(self._block[b.P_HULL_BODY])].reshape(3, 3)
        self._qpos, self._qvel, self._act, self._water = raw.qpos, raw.qvel, raw.act, raw.userdata

    def copy(self, share_model: bool = False) -> Self:
        """An independent copy; with `share_model` both read the same current from one model."""
        twin = super().copy(share_model=share_model)
        twin._tables = self._tables if share_model else dict(self._tables)
        return twin

    def __getstate__(self) -> Any:
        return self.data, self._tables

    def __setstate__(self, state: Any) -> None:
        data, self._tables = state
        model = _without_pointers(data.model).ptr
        for slot, values in self._tables.items():
            _point(model, slot, values)
        super().__setstate__(data)

    # --- state --------------------------------------------------------------------------------

    def _physics_state_items(self) -> list[Array]:
        # userdata holds what the time-centred water remembers of the step before
        return [*super()._physics_state_items(), self.data.userdata]

    def step(self, nstep: int = 1) -> None:
        """Advance by `nstep` steps.

        Raises:
          PhysicsError: the state left the finite numbers.
        """
        super().step(nstep)
        if not self.legacy_step:
            mujoco.mj_step1(self.model.ptr, self.data.ptr)
        if self._water[b.U_FAILED]:
            raise PhysicsError(
                f"the glider's state left the finite numbers at {self._water[b.U_FAIL_TIME]:g} s; "
                "try a smaller timestep or check the vehicle's parameters"
            )

    def reset(self, keyframe_id: int | None = None) -> None:
        """Back to the model's initial state, with nothing remembered of earlier velocities."""
        super().reset(keyframe_id)
        self.data.userdata[:] = 0.0

    def after_reset(self) -> None:
        """Bring everything up to date with a new state.

        dm_control's own switches actuation off here. The stiff servos then are missing from what
        the `discrete` integrator prepares for the first step, which throws the battery away.
        """
        self.forward()

    def set_start(self, start: Start) -> None:
        """Place the glider, moving relative to the water as `start` says; call it in a reset.

        Time-centred runs keep velocities half a step back in time, and so does this, in the same
        way as `twin.physics.simulation.Simulation`.
        """
        data = self.data.ptr
        size = int(self._block[b.P_CURRENT_SIZE])
        current = np.zeros(3)
        if size:
            place = (start.north, start.east, start.depth)
            program = self._tables[b.P_CURRENT]
            current = np.array(sample(program, data.time, *place, 0.0, 0.0, 0.0)[:3])
        data.userdata[:] = 0.0
        set_start(data, start, current)
        if self._block[b.P_CENTRED]:
            stagger(self.model.ptr, self.data.ptr)

    # --- water --------------------------------------------------------------------------------

    def set_current(
        self, current: Current | None, duration: float, origin: Origin | None = None
    ) -> None:
        """Let the water flow for `duration` [s] from `origin`; None stops it.

        Raises:
          CurrentError: the current cannot be compiled for that duration.
        """
        program = None if current is None else current.compile(duration, origin)
        self._set_table(b.P_CURRENT, program)

    def set_density(self, profile: Any) -> None:
        """Stratify the water by a `twin.water.density.DensityProfile`; None makes it uniform."""
        self._set_table(b.P_DENSITY, None if profile is None else profile.compile())

    def _set_table(self, slot: int, values: Array | None) -> None:
        values = np.zeros(0) if values is None else np.array(values, float)
        _point(self.model.ptr, slot, values)  # first: the old table must outlive its use
        self._tables[slot] = values

    # --- measurements -------------------------------------------------------------------------

    def measurements(self) -> dict[str, float]:
        """Every scalar of MEASUREMENTS now, by name."""
        roll_rate, pitch_rate, yaw_rate = self.rates()
        surge, sway, heave = self.velocity_through_water()
        north, east, down = self.current()
        derived = {
            "roll_rate": roll_rate,
            "pitch_rate": pitch_rate,
            "yaw_rate": yaw_rate,
            "surge": surge,
            "sway": sway,
            "heave": heave,
            "current_north": north,
            "current_east": east,
            "current_down": down,
        }
        return {
            name: float(derived[name] if name in derived else getattr(self, name)())
            for name in MEASUREMENTS
        }

    def north(self) -> float:
        """[m] of the CB from the origin."""
        return float(self._qpos[0])

    def east(self) -> float:
        """[m] of the CB from the origin."""
        return float(-self._qpos[1])

    def depth(self) -> float:
        """[m] of the CB below the mean sea surface."""
        return float(-self._qpos[2])

    def roll(self) -> float:
        """[rad], positive starboard down."""
        return math.atan2(self._rotation[2, 1], self._rotation[2, 2])

    def pitch(self) -> float:
        """[rad], positive nose up."""
        return math.asin(min(max(self._rotation[2, 0], -1.0), 1.0))

    def heading(self) -> float:
        """[rad] true, in [0, 2 pi)."""
        return math.atan2(-self._rotation[1, 0], self._rotation[0, 0]) % (2.0 * math.pi)

    def _centred(self, part: slice) -> Array:
        """qvel now: time-centred runs store it half a step earlier."""
        velocity = self._qvel[part]
        if not self._block[b.P_CENTRED] or not self._water[b.U_KNOWN]:
            return velocity.copy()
        earlier = self._water[b.U_EARLIER + part.start : b.U_EARLIER + part.stop]
        return velocity + 0.5 * (velocity - earlier)

    def velocity_over_ground(self) -> Array:
        """[m/s], NED, shape (3,)."""
        return flip_vector(self._centred(slice(0, 3)))

    def velocity_through_water(self) -> Array:
        """Surge, sway, heave [m/s], FRD, shape (3,)."""
        relative = self._centred(slice(0, 3)) - flip_vector(self.current())
        return flip_vector(relative @ self._rotation)

    def rates(self) -> Array:
        """Roll, pitch, yaw rate [rad/s], FRD, shape (3,)."""
        return flip_vector(self._centred(slice(3, 6)))

    def depth_rate(self) -> float:
        """[m/s], positive while diving."""
        return float(-self._centred(slice(0, 3))[2])

    def surge(self) -> float:
        """[m/s] through the water, forward."""
        return float(self.velocity_through_water()[0])

    def sway(self) -> float:
        """[m/s] through the water, to starboard."""
        return float(self.velocity_through_water()[1])

    def heave(self) -> float:
        """[m/s] through the water, downward in body axes."""
        return float(self.velocity_through_water()[2])

    def speed(self) -> float:
        """[m/s] through the water."""
        return float(np.linalg.norm(self.velocity_through_water()))

    def angle_of_attack(self) -> float:
        """[rad], atan2(heave, surge)."""
        surge, _, heave = self.velocity_through_water()
        return math.atan2(heave, surge)

    def sideslip(self) -> float:
        """[rad], asin(sway / speed), 0 at rest."""
        velocity = self.velocity_through_water()
        speed = float(np.linalg.norm(velocity))
        return math.asin(velocity[1] / speed) if speed > 0.0 else 0.0

    def net_buoyancy(self) -> float:
        """Net buoyancy mass [kg] of the immersed glider, positive = heavy = dives."""
        return float(self._water[b.U_NET_MASS])

    def immersion(self) -> float:
        """Immersed fraction of the hull, 1 under water."""
        return float(self._water[b.U_IMMERSION])

    def density(self) -> float:
        """[kg/m3] of the water at the CB."""
        return float(self._water[b.U_DENSITY])

    def current(self) -> Array:
        """Velocity of the water at the CB [m/s], NED, shape (3,)."""
        return self._water[b.U_CURRENT : b.U_CURRENT + 3].copy()

    def shift(self) -> float:
        """Battery's displacement from neutral [m], positive forward (nose down)."""
        return float(self._act[0])

    def rotation(self) -> float:
        """Battery's rotation [rad], positive turns to starboard."""
        return float(self._act[1])

    def pump(self) -> float:
        """Pumped volume [cm3], positive lighter."""
        return float(self._act[2])

    def actuator_range(self) -> tuple[Array, Array]:
        """Ends of travel, each of shape (3,): shift [m], rotation [rad], pump [cm3]."""
        low = self._block[b.P_ACTUATOR_MIN : b.P_ACTUATOR_MIN + 3]
        high = self._block[b.P_ACTUATOR_MAX : b.P_ACTUATOR_MAX + 3]
        return low.copy(), high.copy()

    def actuators(self) -> Array:
        """Actuator positions as fractions of their travel, -1 to 1, shape (3,)."""
        low, high = self.actuator_range()
        return 2.0 * (self._act - low) / (high - low) - 1.0


def _require_block(model: mujoco.MjModel) -> None:
    whole = model.nnumericdata >= b.PARAMETERS and model.nuserdata >= plant.USER_SIZE
    if not whole or parameter_block(model)[b.P_MAGIC] != b.MAGIC:
        raise VehicleError(
            "this MuJoCo model carries no glider parameters, so it would move in vacuum: build it "
            "with twin.suite.physics.Physics.from_vehicle or "
            "twin.physics.mujoco_model.compile_model"
        )


def _without_pointers(model: wrapper.MjModel) -> wrapper.MjModel:
    """Make the model forget the addresses of the process that it comes from."""
    _require_block(model.ptr)
    block = parameter_block(model.ptr)
    for slot in _POINTERS:
        block[slot] = block[slot + 1] = 0.0
    block[b.P_CONTROL], block[b.P_LOG_PERIOD] = b.CONTROL_NONE, 0.0
    if block[b.P_FLUID_COUNT]:
        block[b.P_FLUID] = share(fluid_geoms(model.ptr))
    return model


def _point(model: mujoco.MjModel, slot: int, values: Array) -> None:
    block = parameter_block(model)
    block[slot + 1] = 0.0
    block[slot] = float(values.ctypes.data) if len(values) else 0.0
    block[slot + 1] = float(len(values))


def _vehicle_from_text(xml: str, assets: Mapping[str, Any] | None) -> Vehicle:
    if assets:
        raise InputError(
            f"assets {', '.join(sorted(assets))}: a vehicle file stands alone; write meshes into "
            "it with <mesh vertex=...>"
        )
    return parse_vehicle(xml, Path("vehicle.xml"))
