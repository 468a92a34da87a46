"""Placing: a model's vehicle put at the start of an episode, under the conditions of it."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.control.conditions import Conditions
from twin.errors import InputError
from twin.numbers import Array
from twin.physics.condition import apply_real_vehicle, set_start, stagger
from twin.physics.model_block import Tables, header, room, table, write_tables
from twin.physics.mujoco_model import refit
from twin.physics.native.install import install
from twin.physics.start import Start
from twin.vehicle.vehicle import Vehicle
from twin.water.current.sampler import sample

OF_THE_VEHICLE = ("qpos0", "body_ipos", "dof_invweight0", "dof_M0", "body_invweight0")
"""Fields of a model beside the block that a real vehicle has of its own"""


class Nominal:
    """What conditions change in a model, as it was compiled."""

    def __init__(self, model: mujoco.MjModel):
        """Remember a model that has no water of its own yet."""
        self._model = model
        self._values = {
            name: getattr(model, name).copy() for name in ("numeric_data", *OF_THE_VEHICLE)
        }

    def restore(self) -> None:
        """Make the model so again."""
        for name, values in self._values.items():
            getattr(self._model, name)[...] = values


def write_conditions(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    vehicle: Vehicle,
    conditions: Conditions,
    duration: float,
) -> None:
    """Put the vehicle and the water of an episode of `duration` [s] into a model as compiled.

    `data` are the model's and are overwritten.

    Raises:
      InputError: the water takes more room than the model has. VehicleError: a vehicle that needs
        a model of its own.
    """
    real = conditions.vehicle
    if real is not None:
        refit(model, data, vehicle, real)
    tables = water_of(conditions, real or vehicle, duration)
    if tables.words > room(model):
        raise InputError(
            f"the water of an episode takes {tables.words} numbers, the model has room for "
            f"{room(model)}: draw a coarser current, or shorten the episodes"
        )
    write_tables(model, tables)
    install(current=tables.current.size > 0)


def water_of(conditions: Conditions, vehicle: Vehicle, duration: float) -> Tables:
    """The water of an episode of `duration` [s] around the real vehicle."""
    return Tables(
        current=_compiled(conditions, duration),
        density=np.zeros(0) if conditions.density is None else conditions.density.compile(),
        temperature=_temperature(vehicle, conditions),
    )


def _compiled(conditions: Conditions, duration: float) -> Array:
    if conditions.current is None:
        return np.zeros(0)
    return conditions.current.compile(duration, conditions.origin)


def _temperature(vehicle: Vehicle, conditions: Conditions) -> Array:
    if conditions.density is None or not vehicle.hull_thermal_expansion:
        return np.zeros(0)
    return conditions.density.compile_temperature()


def place_vehicle(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    start: Start,
    vehicle: Vehicle | None = None,
    conditions: Conditions | None = None,
) -> None:
    """Write a start into data that were reset, with the water that the model carries.

    The start is the vehicle's of the file; the errors of a real one act from there on.
    """
    program, water = table(model, "current"), np.zeros(3)
    if program.size:
        at = (data.time, start.north, start.east, start.depth, 0.0, 0.0, 0.0)
        water = np.array(sample(program, *at)[:3])
    data.userdata[:] = 0.0
    set_start(model, data, start, water)
    if header(model)["centred"]:
        stagger(model, data)
    if conditions is not None and vehicle is not None:
        apply_real_vehicle(
            model,
            conditions.vehicle or vehicle,
            ballast=conditions.ballast,
            density=conditions.density,
            encoder_zeros=conditions.encoder_zeros,
        )
