"""Physics: a vehicle in water on MuJoCo, with its measurements by name.

The model is the one of `compile_model`, the callbacks are the native ones: a step here
is bit for bit a step of the batch. Measurements are in NED and FRD, SI units. They belong to the
present state: `step` and `reset_context` leave positions and velocities up to date.
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
"""Every scalar measurement and its unit, besides the positions of the vehicle's parts; each is a
method of `Physics` or a part of one."""

ROOM = 4096
"""Numbers of a current and a density profile that fit a model without compiling it again."""


class Physics:
    """A vehicle in water; build it with `from_vehicle`.

    Models that `compile_model` did not make are refused, because they would move in vacuum. Copies
    and pickles carry their water with them. That of `twin.control.dm_suite` has dm_control's own
    way to make, step and draw a model, and water and measurements from here.
    """

    unstable: ClassVar[type[Exception]] = SimulationUnstable
    """Raised by `step` when the state leaves the finite numbers"""

    # --- making one ---------------------------------------------------------------------------

    def __init__(self, data: mujoco.MjData):
        """Of a model's data, which are taken as they are.

        Raises:
          VehicleError: the model does not carry the twin's parameter block.
        """
        self._attach(data.model, data)
        self._pictures: Pictures | None = None

    @classmethod
    def from_model(cls, model: mujoco.MjModel) -> Self:
        """From a model that `compile_model` made, taken as it is.

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
        """A vehicle in still water; the arguments are those of `compile_model`."""
        return cls.from_model(
            compile_model(
                vehicle, hydrodynamics=hydrodynamics, timestep=timestep, integrator=integrator,
                reserve=ROOM, centred=True,
            )
        )  # fmt: skip

    def _attach(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Measure these from now on."""
        head = header(model)  # raises for models without a block
        install(current=head["current"]["size"] > 0.0, floor=head["floor"]["size"] > 0.0)
        self.mj_model, self.mj_data = model, data
        """MuJoCo's own"""
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
        """Back to the model's initial state; after the block everything is up to date.

        Raises:
          SimulationUnstable: the state that the block wrote is not finite.
        """
        mujoco.mj_resetData(self.mj_model, self.mj_data)
        self.mj_data.userdata[:] = 0.0
        yield self
        self.forward()

    def forward(self) -> None:
        """Bring everything up to date with the state.

        Raises:
          SimulationUnstable: the state is not finite.
        """
        with self._watched():
            mujoco.mj_forward(self.mj_model, self.mj_data)

    def step(self, nstep: int = 1) -> None:
        """Advance by `nstep` steps.

        Raises:
          SimulationUnstable: the state left the finite numbers.
        """
        model, data = self.mj_model, self.mj_data
        with self._watched():  # the first half of a step is always done: see `reset_context`
            mujoco.mj_step2(model, data)
            if nstep > 1:
                mujoco.mj_step(model, data, nstep - 1)
            mujoco.mj_step1(model, data)

    def set_control(self, control: ArrayLike) -> None:
        """Command the parts, in their order and units, shape (parts,)."""
        self.mj_data.ctrl[:] = control

    @contextmanager
    def _watched(self) -> Iterator[None]:
        """Raise where MuJoCo warns, or where native code found numbers that are not finite."""
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
        """[s] since the start."""
        return float(self.mj_data.time)

    def timestep(self) -> float:
        """[s] of a step."""
        return float(self.mj_model.opt.timestep)

    def control(self) -> Array:
        """Commanded positions of the parts, in their order and units, shape (parts,)."""
        return self.mj_data.ctrl.copy()

    def activation(self) -> Array:
        """Positions of the parts, in their order and units, shape (parts,)."""
        return self._act.copy()

    def _failure(self) -> str | None:
        """Why the present state cannot be used, None when it can."""
        if not self._water["failed"]:
            return None
        return (
            f"the vehicle's state left the finite numbers at {self._water['fail_time']:g} s; "
            "try a smaller timestep or check the vehicle's parameters"
        )

    def set_start(self, start: Start) -> None:
        """Place the glider, moving relative to the water as `start` says; call it in a reset.

        Time-centred runs keep velocities half a step back in time, and so does this, in the same
        way as `twin.physics.simulation.Simulation`.

        Raises:
          InputError: the start has a place or a time, which nothing here would use.
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
        """Begin an episode of a task, as `twin.control.many.ManyPhysics.place`; `at` is ()."""
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
        """Stratify the water by a `twin.water.density.DensityProfile`; None makes it uniform."""
        self._set_tables(density=np.zeros(0) if profile is None else profile.compile())

    def _set_tables(self, **changed: Array) -> None:
        """Put tables into the model, whose others stay.

        Raises:
          InputError: they do not fit; the message says how to make room.
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
        """Every scalar of MEASUREMENTS now, and the position of each part, by name."""
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
        if not self._head["centred"] or not self._water["known"]:
            return velocity.copy()
        earlier = self._water["earlier"][part]
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
        return float(self._water["net_mass"])

    def immersion(self) -> float:
        """Immersed fraction of the hull, 1 under water."""
        return float(self._water["immersion"])

    def density(self) -> float:
        """[kg/m3] of the water at the CB."""
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
          InputError: the vehicle has no part of that name; the nearest is offered.
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
        """What a camera sees now; the arguments are those of `twin.control.pictures.Pictures.draw`.

        Raises:
          NoOpenGL: this machine cannot draw. InputError: a camera or size that cannot be.
        """
        if self._pictures is None:
            self._pictures = Pictures(self.model)
        return self._pictures.draw(self.data, **settings)

    def free(self) -> None:
        """Release what draws; `render` takes it up again."""
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None
