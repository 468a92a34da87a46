"""Condition: the vehicle at each time of a run, written into a compiled model; electric signals.

Faults turn a vehicle's parameters into a table over time, whose rows are conditions. An engine
applies each row from the row's time on, to MuJoCo's model or to the rows of a block. Functions that
write the start of a run into MuJoCo's model and data are here too.

Electric signals are the readings of a vehicle's charge counter, voltmeter and vacuum gauge.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from twin.faults.base import Condition, Fault, conditions
from twin.frames import euler_to_quaternion, flip_quaternion, flip_vector, quaternion_to_matrix
from twin.mission.mission_file import (
    COMPASS_OFFSET,
    DEPTH_OFFSET,
    ECHOES_LOST,
    IRON_COSINE,
    IRON_SINE,
)
from twin.numbers import Array
from twin.physics.model_block import (
    RUN_TABLES,
    fill_block,
    header,
    joint_places,
    part_names,
    part_table,
    state,
)
from twin.physics.mujoco_model import with_hydrodynamics
from twin.physics.scenario import Scenario
from twin.physics.start import Ballast, Start
from twin.records.trajectory import Trajectory
from twin.vehicle.consumption import ENERGY, Consumption, needed_signals
from twin.vehicle.parts import Pump
from twin.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from twin.water.density import DensityProfile

BODY = ("vehicle", "volume", "zeros")
"""Fields of a condition on which the body's motion depends."""
INSTRUMENTS = ("iron", "compass_offset", "depth_offset", "echoes_lost")
"""Fields of a condition with the errors of the instruments that guidance reads."""
REST_VOLTAGE, EMPTY_VOLTAGE = 15.0, 12.5
"""[V] Lithium pack, from gliders' logs. REST_VOLTAGE: fresh pack. EMPTY_VOLTAGE: empty pack."""
RESISTANCE = 0.35
"""[ohm] Resistance of all packs and their wires together."""
ENDURANCE_DAYS = 60.0
"""[d] Time that full batteries last at the flight's mean power; a sampled factor multiplies it."""
VOLTAGE_NOISE, CURRENT_NOISE = 0.02, 0.005
"""Standard deviation of a sample's noise. VOLTAGE_NOISE: [V]. CURRENT_NOISE: [A]."""
HULL_AIR = 0.35
"""[1] Fraction of the hull's volume that is air."""
VACUUM_NOISE = 40.0
"""[Pa] Standard deviation of the noise of the vacuum gauge."""
AIR_LAG = 1800.0
"""[s] Time constant with which the air in the hull follows the water's temperature."""
ZERO_C = 273.15
"""[K] Temperature of 0 degree Celsius."""
SEA_LEVEL = 101_325.0
"""[Pa] Air pressure at sea level."""


def stagger(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Move the velocities back by half a step, to the time at which a time-centred run stores them.

    This evaluates the forward dynamics once and clears `userdata`: guidance and log begin again.
    """
    command = data.ctrl.copy()
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    # the battery's screws hold it, so it moves with the hull
    change = np.linalg.solve(mass[:6, :6], data.qfrc_smooth[:6]) * model.opt.timestep
    data.qvel[:6] -= 0.5 * change
    data.ctrl[:], data.userdata[:] = command, 0.0
    ours = state(data)
    ours["twist"], ours["earlier"] = data.qvel[:6], data.qvel[:6] - change
    ours["time"], ours["known"] = data.time, 1.0


def set_start(model: mujoco.MjModel, data: mujoco.MjData, start: Start, current: Array) -> None:
    """Write a start into MuJoCo's data; `current` is the water's velocity there, NED [m/s]."""
    quaternion = euler_to_quaternion(start.roll, start.pitch, start.heading)
    velocity = quaternion_to_matrix(quaternion) @ np.array(start.v_rel) + current
    data.qpos[:3] = flip_vector([start.north, start.east, start.depth])
    data.qpos[3:7] = flip_quaternion(quaternion)
    data.qvel[:3] = flip_vector(velocity)
    data.qvel[3:6] = flip_vector(start.rates)
    positions = start.positions(part_names(model), part_table(model)["rest"])
    data.act[:] = data.ctrl[:] = positions
    for index, place in joint_places(model):
        data.qpos[place] = positions[index]


def apply_real_vehicle(
    model: mujoco.MjModel,
    vehicle: Vehicle,
    *,
    ballast: Ballast | None,
    density: DensityProfile | None,
    encoder_zeros: Mapping[str, float],
) -> None:
    """Put the ballasting and the encoders' zero errors of a vehicle into its model.

    Args:
      density: density of the ballast's water. encoder_zeros: true positions at a reading of 0.
    """
    head, rows = header(model), part_table(model)
    if ballast is not None:
        head["neutral_volume"] = ballast.neutral_volume(vehicle, density)
    driven = dict(joint_places(model))
    for name, zero in encoder_zeros.items():
        index = vehicle.part_names.index(name)
        if index in driven:
            # the joint is at the offset when its encoder reads 0
            model.qpos0[driven[index]] -= zero
        else:
            rows[index]["zero"] = zero


def differs(fault: Fault, before: Condition, fields: Sequence[str]) -> bool:
    """Tell whether a fault changes one of `fields` of a healthy vehicle's condition."""
    changed = fault.change(before, fault.size)
    return any(getattr(changed, name) is not getattr(before, name) for name in fields)


def conditions_of(scenario: Scenario, duration: float) -> tuple[tuple[float, Condition], ...]:
    """Conditions of a scenario's vehicle, each with its first time [s]; empty without faults."""
    if not scenario.faults:
        return ()
    return conditions(scenario.faults, healthy(scenario), duration)


def healthy(scenario: Scenario) -> Condition:
    """Condition of a scenario's vehicle without its faults."""
    vehicle = with_hydrodynamics(scenario.vehicle, scenario.hydrodynamics)
    volume = vehicle.neutral_volume
    if scenario.ballast is not None:
        volume = scenario.ballast.neutral_volume(vehicle, scenario.density)
    return Condition(
        vehicle=vehicle,
        volume=volume,
        zeros=scenario.encoder_zeros,
        consumption=Consumption.of(vehicle),
        compass_offset=scenario.compass_offset if scenario.mission is not None else 0.0,
    )


def become(model: mujoco.MjModel, before: Vehicle, zeros: Array, condition: Condition) -> None:
    """Change a compiled model to match a condition, in the middle of a run or at its start.

    The run's tables, log and state stay unchanged.

    Args:
      before: vehicle that the model was compiled for.
      zeros: `qpos0` of the model as compiled, shape (nq,).
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
    """Write the errors of guidance's instruments into its gains, shape (GAINS,)."""
    gains[IRON_SINE], gains[IRON_COSINE] = condition.iron
    gains[COMPASS_OFFSET] = condition.compass_offset
    gains[DEPTH_OFFSET], gains[ECHOES_LOST] = condition.depth_offset, condition.echoes_lost


def _write_hull(model: mujoco.MjModel, vehicle: Vehicle) -> None:
    """Write mass, centre of gravity and inertia of the rigid hull into a compiled model."""
    hull = model.body("hull").id
    signs = np.outer(flip_vector(np.ones(3)), flip_vector(np.ones(3)))
    moments, axes = np.linalg.eigh(vehicle.static_inertia * signs)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    model.body_mass[hull] = vehicle.static_mass
    model.body_ipos[hull] = flip_vector(vehicle.static_cg)
    model.body_inertia[hull] = moments
    mujoco.mju_mat2Quat(model.body_iquat[hull], np.ascontiguousarray(axes).ravel())
    mujoco.mj_setConst(model, mujoco.MjData(model))


def electric_signals(
    scenario: Scenario, flown: Trajectory, rng: np.random.Generator | None = None
) -> dict[str, Array]:
    """Charge [A h], voltage [V], current [A], pump power [W] and vacuum [Pa] by signal name.

    Each has shape (n,).

    Args:
      scenario: the flown scenario with its faults. flown: its trajectory.
      rng: samples the batteries and the noise; None: mean batteries and no noise.
    """
    time = flown.time
    period = scenario.sample_period
    table = conditions_of(scenario, float(time[-1]) + period) or ((0.0, healthy(scenario)),)
    taken, pump = np.zeros(len(time)), np.zeros(len(time))
    packs, water = np.ones(len(time)), np.zeros(len(time))
    pumps = [part.name for part in scenario.vehicle.parts if isinstance(part, Pump)]
    needed = needed_signals(scenario.vehicle)
    begins = np.searchsorted(time, [begin for begin, _ in table]).tolist()
    for (first, last), (_, condition) in zip(
        itertools.pairwise([*begins, len(time)]), table, strict=True
    ):
        if last <= first:
            continue
        signals = {name: flown[name][max(first - 1, 0) : last] for name in needed}
        span = time[max(first - 1, 0) : last]
        energy = condition.consumption.signals(condition.vehicle, signals, span)
        own = np.sum([np.diff(values, prepend=0.0) for values in energy.values()], axis=0)
        moved = sum(np.diff(energy[f"{ENERGY}{name}"], prepend=0.0) for name in pumps)
        keep = slice(1 if first else 0, None)
        taken[first:last] = own[keep]
        if pumps:
            pump[first:last] = np.asarray(moved)[keep]
        packs[first:last], water[first:last] = condition.packs, condition.taken
    power = taken / period
    power[0] = power[1] if len(power) > 1 else 0.0
    capacity = ENDURANCE_DAYS * 24.0 * float(np.mean(power)) / REST_VOLTAGE
    more, share = (1.0, 0.2) if rng is None else (rng.uniform(0.8, 1.5), rng.uniform(0.05, 0.4))
    capacity *= float(more)
    used = float(share) * capacity
    current = power / REST_VOLTAGE
    charge = np.cumsum(current) * period / 3600.0
    spent = used / capacity + np.cumsum(current / packs) * period / 3600.0 / capacity
    rest = REST_VOLTAGE + (EMPTY_VOLTAGE - REST_VOLTAGE) * np.minimum(spent, 1.0)
    voltage = rest - RESISTANCE / packs * current
    noise = np.zeros((3, len(time))) if rng is None else rng.standard_normal((3, len(time)))
    # the air of the hull follows the water's temperature with a lag
    warmth = flown.signals.get("true_temperature")
    air = np.full(len(time), ZERO_C + 10.0)
    if warmth is not None:
        air = ZERO_C + _lagged(np.asarray(warmth, float), AIR_LAG / period)
    room = HULL_AIR * scenario.vehicle.neutral_volume
    inside = (SEA_LEVEL - healthy(scenario).consumption.hull_vacuum) * (air / (ZERO_C + 10.0))
    inside = inside * room / (room - np.minimum(water, 0.9 * room))
    return {
        "measured_charge": used + charge,
        "measured_voltage": voltage + VOLTAGE_NOISE * noise[0],
        "measured_battery_current": np.maximum(current + CURRENT_NOISE * noise[1], 0.0),
        "measured_pump_power": pump / period,
        "measured_vacuum": SEA_LEVEL - inside + VACUUM_NOISE * noise[2],
    }


def _lagged(values: Array, lag: float) -> Array:
    """Filter values with a first-order lag of `lag` samples."""
    from scipy.signal import lfilter

    share = 1.0 - math.exp(-1.0 / lag)
    found, _ = lfilter([share], [1.0, share - 1.0], values, zi=[values[0] * (1.0 - share)])
    return np.asarray(found)
