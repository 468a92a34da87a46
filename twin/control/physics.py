"""Physics: a vehicle in water on MuJoCo, with its measurements by name.

The model comes from `compile_model`, with the native callbacks, so a step here equals a step of
the batch bit for bit. Measurements are in NED and FRD, SI units. They belong to the present state:
`step` and `reset_context` update positions and velocities.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, ClassVar, Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.control.conditions import Conditions, Nominal, place_vehicle, write_conditions
from twin.control.pictures import Pictures
from twin.errors import InputError, SimulationUnstable, unknown_name
from twin.frames import flip_vector
from twin.numbers import Array
from twin.physics.model_block import (
    Tables,
    header,
    part_names,
    part_table,
    room,
    state,
    table,
    write_tables,
)
from twin.physics.mujoco_model import compile_model, quiet_mujoco
from twin.physics.native.install import install
from twin.physics.start import Start
from twin.vehicle.vehicle import Vehicle
from twin.water.current.axes import Origin
from twin.water.current.base import Current

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
}
"""Units of all scalar measurements besides the positions of the parts; each measurement is a
method of `Physics` or a component of one."""

ROOM = 4096
"""Count of numbers of a current and a density profile that fit a model without recompiling."""


class Physics:
    """Vehicle in water; build it with `from_vehicle`.

    Models from elsewhere than `compile_model` are refused, because they would move in vacuum.
    Copies and pickles carry their water with them. The subclass in `twin.control.dm_suite` makes,
    steps and draws a model with dm_control; its water and measurements are from here.
    """

    unstable: ClassVar[type[Exception]] = SimulationUnstable
    """Error that `step` raises when the state is no longer finite."""

    # --- making one ---------------------------------------------------------------------------

    def __init__(self, data: mujoco.MjData):
        """Take the data of a model, without changing them.

        Raises:
          VehicleError: the model does not carry the twin's parameter block.
        """
        self._attach(data.model, data)
        self._pictures: Pictures | None = None

    @classmethod
    def from_model(cls, model: mujoco.MjModel) -> Self:
        """Make the physics of a model from `compile_model`, without changing it.

        Raises:
          VehicleError: the model does not carry the twin's parameter block.
        """
        header(model)
        made = cls(mujoco.MjData(model))
        with made.reset_context():
            pass
        return made

    def __getstate__(self) -> mujoco.MjData:
        return self.data

    def __setstate__(self, data: mujoco.MjData) -> None:
        Physics.__init__(self, data)

    @classmethod
    def from_vehicle(
        cls,
        vehicle: Vehicle | str = "glider",
        *,
        hydrodynamics: str = "coefficients",
        timestep: float | None = None,
        integrator: str | None = None,
    ) -> Self:
        """Make a vehicle in still water; the arguments are those of `compile_model`."""
        return cls.from_model(
            compile_model(
                vehicle, hydrodynamics=hydrodynamics, timestep=timestep, integrator=integrator,
                reserve=ROOM, centred=True,
            )
        )  # fmt: skip

    def _attach(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Measure this model and these data from now on."""
        head = header(model)  # raises for models without a block
        install(current=head["current"]["size"] > 0.0, floor=head["floor"]["size"] > 0.0)
        self.mj_model, self.mj_data = model, data
        """MuJoCo's own model and data."""
        self._nominal: Nominal | None = None
        self._head, self._parts = head, part_table(model)
        self._names = part_names(model)
        self._rotation = data.xmat[int(head["hull_body"])].reshape(3, 3)
        self._qpos, self._qvel, self._act = data.qpos, data.qvel, data.act
        self._water = state(data)

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's own model."""
        return self.mj_model

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's own data."""
        return self.mj_data

    # --- state --------------------------------------------------------------------------------

    @contextmanager
    def reset_context(self) -> Iterator[Self]:
        """Return to the model's initial state; update all quantities after the block.

        Raises:
          SimulationUnstable: the state that the block wrote is not finite.
        """
        mujoco.mj_resetData(self.mj_model, self.mj_data)
        self.mj_data.userdata[:] = 0.0
        yield self
        self.forward()

    def forward(self) -> None:
        """Update all quantities to the state.

        Raises:
          SimulationUnstable: the state is not finite.
        """
        with self._watched():
            mujoco.mj_forward(self.mj_model, self.mj_data)

    def step(self, nstep: int = 1) -> None:
        """Advance by `nstep` steps.

        Raises:
          SimulationUnstable: the state is no longer finite.
        """
        model, data = self.mj_model, self.mj_data
        with self._watched():  # the first half of a step is already done
            mujoco.mj_step2(model, data)
            if nstep > 1:
                mujoco.mj_step(model, data, nstep - 1)
            mujoco.mj_step1(model, data)

    def set_control(self, control: ArrayLike) -> None:
        """Command the parts, in their order and units, shape (parts,)."""
        self.mj_data.ctrl[:] = control

    @contextmanager
    def _watched(self) -> Iterator[None]:
        """Raise if MuJoCo warns, or if native code finds numbers that are not finite."""
        warned = self.mj_data.warning.number
        before = warned.copy()
        with quiet_mujoco():
            yield
        found = self._failure()
        if found is None and (warned > before).any():
            kinds = [mujoco.mjtWarning(int(kind)).name for kind in np.flatnonzero(warned > before)]
            found = f"MuJoCo warns at {self.time():g} s: {', '.join(kinds)}"
        if found is not None:
            raise SimulationUnstable(found, mission=0, time_s=self.time())

    def time(self) -> float:
        """Time since the start [s]."""
        return float(self.mj_data.time)

    def timestep(self) -> float:
        """Step of the physics [s]."""
        return float(self.mj_model.opt.timestep)

    def control(self) -> Array:
        """Commanded positions of the parts, in their order and units, shape (parts,)."""
        return self.mj_data.ctrl.copy()

    def activation(self) -> Array:
        """Positions of the parts, in their order and units, shape (parts,)."""
        return self._act.copy()

    def _failure(self) -> str | None:
        """Reason why the present state is unusable; None if it is usable."""
        if not self._water["failed"]:
            return None
        return (
            f"the vehicle's state left the finite numbers at {self._water['fail_time']:g} s; "
            "try a smaller timestep or check the vehicle's parameters"
        )

    def set_start(self, start: Start) -> None:
        """Place the glider, moving relative to the water as in `start`; call it in a reset.

        Time-centred runs store velocities half a step back in time, as
        `twin.physics.simulation.Simulation` does.

        Raises:
          InputError: the start has a place or a time, which have no effect here.
        """
        if start.latitude is not None or start.time is not None:
            raise InputError(
                "a start's place and time have no effect here: give them to "
                "set_current(current, duration, origin=Origin(...)), which reads the water there"
            )
        model, data = self.mj_model, self.mj_data
        place_vehicle(model, data, start)

    def place(
        self,
        at: tuple[int, ...],
        start: Start,
        *,
        vehicle: Vehicle,
        conditions: Conditions | None,
        duration: float,
    ) -> None:
        """Start an episode of a task, as `twin.control.many.ManyPhysics.place` does; `at` is ()."""
        model, data = self.mj_model, self.mj_data
        if conditions is not None and conditions.only_current:
            self.set_current(conditions.current, duration, conditions.origin)
        elif conditions is not None:
            if self._nominal is None:
                self._nominal = Nominal(model)
            self._nominal.restore()
            write_conditions(model, data, vehicle, conditions, duration)
            mujoco.mj_resetData(model, data)
        place_vehicle(model, data, start, vehicle, conditions)

    # --- water --------------------------------------------------------------------------------

    def set_current(
        self, current: Current | None, duration: float, origin: Origin | None = None
    ) -> None:
        """Let the water flow for `duration` [s] from `origin`; None stops it.

        Raises:
          CurrentError: the current cannot be compiled for that duration.
        """
        program = None if current is None else current.compile(duration, origin)
        self._set_tables(current=np.zeros(0) if program is None else program)

    def set_density(self, profile: Any) -> None:
        """Stratify the water with a `twin.water.density.DensityProfile`; None makes it uniform."""
        self._set_tables(density=np.zeros(0) if profile is None else profile.compile())

    def _set_tables(self, **changed: Array) -> None:
        """Write tables into the model and keep its others.

        Raises:
          InputError: they exceed the model's room; the message says how to make room.
        """
        model = self.mj_model
        tables = {name: table(model, name).copy() for name in ("current", "density", "floor")}
        tables.update(changed)
        needed = sum(values.size for values in tables.values())
        if needed > room(model):
            raise InputError(
                f"the water of this environment takes {needed} numbers, its model has room for "
                f"{room(model)}: build it with Physics.from_model(compile_model(vehicle, "
                f"reserve={needed})), or use a coarser current"
            )
        current, density, floor = (tables[name] for name in ("current", "density", "floor"))
        write_tables(model, Tables(current=current, density=density, floor=floor))
        install(current=current.size > 0, floor=floor.size > 0)

    # --- measurements -------------------------------------------------------------------------

    def measurements(self) -> dict[str, float]:
        """Values of MEASUREMENTS now, and the position of each part, by name."""
        vectors = {
            ("roll_rate", "pitch_rate", "yaw_rate"): self.rates(),
            ("surge", "sway", "heave"): self.velocity_through_water(),
            ("current_north", "current_east", "current_down"): self.current(),
        }
        derived = {
            name: value
            for names, values in vectors.items()
            for name, value in zip(names, values, strict=True)
        }
        found = {
            name: float(derived[name] if name in derived else getattr(self, name)())
            for name in MEASUREMENTS
        }
        return {**found, **dict(zip(self._names, self._act.tolist(), strict=True))}

    def north(self) -> float:
        """Position of the CB north of the origin [m]."""
        return float(self._qpos[0])

    def east(self) -> float:
        """Position of the CB east of the origin [m]."""
        return float(-self._qpos[1])

    def depth(self) -> float:
        """Depth of the CB below the mean sea surface [m]."""
        return float(-self._qpos[2])

    def roll(self) -> float:
        """Roll [rad], positive starboard down."""
        return math.atan2(self._rotation[2, 1], self._rotation[2, 2])

    def pitch(self) -> float:
        """Pitch [rad], positive nose up."""
        return math.asin(min(max(self._rotation[2, 0], -1.0), 1.0))

    def heading(self) -> float:
        """True heading [rad], in [0, 2 pi)."""
        return math.atan2(-self._rotation[1, 0], self._rotation[0, 0]) % (2.0 * math.pi)

    def _centred(self, part: slice) -> Array:
        """Velocity now, from `qvel`, which time-centred runs store half a step earlier."""
        velocity = self._qvel[part]
        if not self._head["centred"] or not self._water["known"]:
            return velocity.copy()
        earlier = self._water["earlier"][part]
        return velocity + 0.5 * (velocity - earlier)

    def velocity_over_ground(self) -> Array:
        """Velocity over ground [m/s], NED, shape (3,)."""
        return flip_vector(self._centred(slice(0, 3)))

    def velocity_through_water(self) -> Array:
        """Surge, sway, heave [m/s], FRD, shape (3,)."""
        relative = self._centred(slice(0, 3)) - flip_vector(self.current())
        return flip_vector(relative @ self._rotation)

    def rates(self) -> Array:
        """Roll, pitch, yaw rate [rad/s], FRD, shape (3,)."""
        return flip_vector(self._centred(slice(3, 6)))

    def depth_rate(self) -> float:
        """Vertical velocity of the vehicle [m/s], positive down."""
        return float(-self._centred(slice(0, 3))[2])

    def surge(self) -> float:
        """Surge [m/s]: velocity through the water, forward."""
        return float(self.velocity_through_water()[0])

    def sway(self) -> float:
        """Sway [m/s]: velocity through the water, to starboard."""
        return float(self.velocity_through_water()[1])

    def heave(self) -> float:
        """Heave [m/s]: velocity through the water, downward in body axes."""
        return float(self.velocity_through_water()[2])

    def speed(self) -> float:
        """Speed through the water [m/s]."""
        return float(np.linalg.norm(self.velocity_through_water()))

    def angle_of_attack(self) -> float:
        """Angle of attack [rad], atan2(heave, surge)."""
        surge, _, heave = self.velocity_through_water()
        return math.atan2(heave, surge)

    def sideslip(self) -> float:
        """Sideslip [rad], asin(sway / speed), 0 at rest."""
        velocity = self.velocity_through_water()
        speed = float(np.linalg.norm(velocity))
        return math.asin(velocity[1] / speed) if speed > 0.0 else 0.0

    def net_buoyancy(self) -> float:
        """Net buoyancy mass [kg] of the immersed glider, positive = heavy."""
        return float(self._water["net_mass"])

    def immersion(self) -> float:
        """Immersed fraction of the hull [1], 1 under water."""
        return float(self._water["immersion"])

    def density(self) -> float:
        """Density of the water at the CB [kg/m3]."""
        return float(self._water["density"])

    def current(self) -> Array:
        """Velocity of the water at the CB [m/s], NED, shape (3,)."""
        return self._water["current"].copy()

    def part_names(self) -> tuple[str, ...]:
        """Names of the vehicle's parts, in the order of commands and activations."""
        return self._names

    def part(self, name: str) -> float:
        """Position of a part in its own unit: a glider's shift [m], rotation [rad], pump [cm3].

        Raises:
          InputError: the vehicle has no part of that name; the nearest name is offered.
        """
        if name not in self._names:
            raise InputError(unknown_name("part of the vehicle", name, self._names))
        return float(self._act[self._names.index(name)])

    def actuator_range(self) -> tuple[Array, Array]:
        """Ends of travel, each of shape (parts,), in the parts' units."""
        return self._parts["low"].copy(), self._parts["high"].copy()

    def actuators(self) -> Array:
        """Actuator positions as fractions of their travel, -1 to 1, shape (parts,)."""
        low, high = self.actuator_range()
        return 2.0 * (self._act - low) / (high - low) - 1.0

    # --- pictures -----------------------------------------------------------------------------

    def render(self, **settings: Any) -> NDArray[Any]:
        """Draw the image of a camera; arguments are those of `twin.control.pictures.Pictures.draw`.

        Raises:
          NoOpenGL: this machine cannot draw. InputError: an unknown camera or impossible size.
        """
        if self._pictures is None:
            self._pictures = Pictures(self.model)
        return self._pictures.draw(self.data, **settings)

    def free(self) -> None:
        """Release the renderer; `render` makes it again."""
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None
