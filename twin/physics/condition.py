"""Condition: the vehicle as it is at each time of a run, and how a compiled model becomes it.

A vehicle's numbers are a table over time, which faults make. An engine flies each row from its time
on: MuJoCo's model is given other numbers, a lane other rows of its block.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from twin.faults.base import Condition, Fault, conditions
from twin.frames import flip_vector
from twin.mission.mission_file import DEPTH_OFFSET, ECHOES_LOST, IRON_COSINE, IRON_SINE
from twin.numbers import Array
from twin.physics.ballast import Ballast
from twin.physics.initial_state import apply_real_vehicle
from twin.physics.model_block import RUN_TABLES, fill_block, header
from twin.physics.mujoco_model import with_hydrodynamics
from twin.physics.scenario import Scenario
from twin.vehicle.consumption import Consumption
from twin.vehicle.vehicle import Vehicle

BODY = ("vehicle", "volume", "zeros")
"""Fields of a condition that say how the body flies"""
INSTRUMENTS = ("iron", "depth_offset", "echoes_lost")
"""Fields that say how guidance's instruments err"""


def differs(fault: Fault, sound: Condition, fields: Sequence[str]) -> bool:
    """Whether a fault changes one of some fields of a sound vehicle's condition."""
    changed = fault.change(sound, fault.size)
    return any(getattr(changed, name) is not getattr(sound, name) for name in fields)


def conditions_of(scenario: Scenario, duration: float) -> tuple[tuple[float, Condition], ...]:
    """The vehicle of a scenario over its run: from when on [s] it is how; () without faults."""
    if not scenario.faults:
        return ()
    return conditions(scenario.faults, healthy(scenario), duration)


def healthy(scenario: Scenario) -> Condition:
    """The vehicle of a scenario without its faults."""
    vehicle = with_hydrodynamics(scenario.vehicle, scenario.hydrodynamics)
    ballast = scenario.ballast
    return Condition(
        vehicle=vehicle,
        volume=(
            vehicle.neutral_volume
            if ballast is None
            else ballast.neutral_volume(vehicle, scenario.density)
        ),
        zeros=scenario.encoder_zeros,
        consumption=Consumption.of(vehicle),
    )


def become(model: mujoco.MjModel, before: Vehicle, zeros: Array, condition: Condition) -> None:
    """Change a compiled model to match a condition, in the middle of a run or at its start.

    The tables of the run, the log and the state of the simulation stay.

    Args:
      before: the vehicle that the model was compiled for.
      zeros: its `qpos0` as it was compiled, shape (nq,).
    """
    vehicle, head = condition.vehicle, header(model)
    kept = {name: head[name].copy() for name in RUN_TABLES}
    kept_numbers = {name: float(head[name]) for name in ("words", "log_ring", "control_period")}
    hull = model.body("hull").id
    if (
        vehicle.static_mass != model.body_mass[hull]
        or np.any(flip_vector(vehicle.static_cg) != model.body_ipos[hull])
        or np.any(vehicle.static_inertia != before.static_inertia)
    ):
        _write_hull(model, vehicle)
    fill_block(model, vehicle, int(kept_numbers["words"]), ring=int(kept_numbers["log_ring"]))
    for name, value in kept.items():
        head[name] = value
    head["control_period"] = kept_numbers["control_period"]
    write_instruments(head["gains"], condition)
    model.qpos0[:] = zeros
    apply_real_vehicle(
        model, vehicle, ballast=Ballast(volume=condition.volume), density=None,
        encoder_zeros=condition.zeros,
    )  # fmt: skip


def write_instruments(gains: Array, condition: Condition) -> None:
    """Write the errors of the instruments that guidance reads among its gains, shape (GAINS,)."""
    gains[IRON_SINE], gains[IRON_COSINE] = condition.iron
    gains[DEPTH_OFFSET], gains[ECHOES_LOST] = condition.depth_offset, condition.echoes_lost


def _write_hull(model: mujoco.MjModel, vehicle: Vehicle) -> None:
    """Mass, centre of gravity and inertia of the fixed block, of a model that is compiled."""
    hull = model.body("hull").id
    signs = np.outer(flip_vector(np.ones(3)), flip_vector(np.ones(3)))
    moments, axes = np.linalg.eigh(vehicle.static_inertia * signs)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    model.body_mass[hull] = vehicle.static_mass
    model.body_ipos[hull] = flip_vector(vehicle.static_cg)
    model.body_inertia[hull] = moments
    mujoco.mju_mat2Quat(model.body_iquat[hull], np.ascontiguousarray(axes).ravel())
    mujoco.mj_setConst(model, mujoco.MjData(model))
