"""Log signals: the rows that native code logs, as the named signals of a trajectory."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.frames import flip_quaternion, flip_vector, quaternion_to_euler, quaternion_to_matrix
from twin.physics.part_signals import declare_parts, state_columns
from twin.records.trajectory import Trajectory, sample_times
from twin.vehicle.consumption import Consumption
from twin.vehicle.vehicle import Vehicle
from twin.water.floor.lookup import floor_depths

Array = NDArray[np.float64]


def from_log(
    rows: NDArray[Any],
    vehicle: Vehicle,
    *,
    half_step: float = 0.0,
    sample_period: float | None = None,
    floor: Array | None = None,
    contacts: bool = False,
    **fields: Any,
) -> Trajectory:
    """Turn native log rows, records of `block.log_row`, into a `Trajectory`.

    `half_step` [s] is how long before its sample a stored velocity holds: half a step in
    time-centred runs, where velocities live between positions. With a `sample_period` [s] the
    rows are a run from its start, and times are its multiples: MuJoCo's clock adds up steps and
    drifts by nanoseconds. `floor` is the table of the sea floor, above which the altitude is;
    `contacts` says whether there is anything to touch, so that contact is a signal.
    """
    declare_parts(vehicle)
    qpos, qvel, act, ctrl = (rows[name] for name in ("qpos", "qvel", "act", "ctrl"))
    quaternion = flip_quaternion(qpos[:, 3:7])
    roll, pitch, heading = quaternion_to_euler(quaternion)
    to_ned = quaternion_to_matrix(quaternion)
    rate = rows["acceleration"]
    twist = qvel[:, :6] + half_step * rate
    position, velocity = flip_vector(qpos[:, :3]), flip_vector(twist[:, :3])
    current = rows["current"]
    v_rel = np.einsum("tji,tj->ti", to_ned, velocity - current)
    rates = flip_vector(twist[:, 3:])
    acceleration, spin = flip_vector(rate[:, :3]), flip_vector(rate[:, 3:])
    force = specific_force(to_ned, acceleration, rates, spin, vehicle)
    degrees = np.rad2deg
    signals: dict[str, Array] = {}

    def put(prefix: str, names: str, values: Array) -> None:
        for name, column in zip(names.split(), values.T, strict=True):
            signals[prefix + name] = column

    put("true_", "north east depth", position)
    put("true_", "roll pitch heading", degrees(np.stack([roll, pitch, heading], -1)))
    put("true_", "surge sway heave", v_rel)
    put("true_velocity_", "north east down", velocity)
    put("true_", "roll_rate pitch_rate yaw_rate", rates)
    put("true_specific_force_", "x y z", force)
    scale = np.array([part.quantity.scale for part in vehicle.parts])
    parts = " ".join(vehicle.part_names)
    put("true_", parts, act * scale)
    put("true_current_", "north east down", current)
    for name in ("net_mass", "density", "immersion"):
        signals[f"true_{name}"] = rows[name].copy()
    if floor is not None and floor.size:
        depths = floor_depths(floor, *(np.ascontiguousarray(x) for x in position.T[:2]))
        signals["true_altitude"] = depths - position[:, 2]
    if contacts:
        signals["true_contact"] = rows["contact"].copy()
    signals["commanded_segment"] = rows["segment"].copy()
    put("commanded_", parts, ctrl * scale)
    signals["commanded_pitch"] = degrees(rows["pitch_setpoint"])
    signals["commanded_heading"] = np.mod(degrees(rows["heading_setpoint"]), 360.0)
    states = np.concatenate([qpos, qvel, act, ctrl], axis=1)
    time = rows["time"].copy()
    if sample_period is not None:
        time = sample_times(len(rows), sample_period)
    signals |= Consumption.of(vehicle).signals(vehicle, signals, time)
    columns = state_columns(vehicle)
    return Trajectory(time=time, signals=signals, states=states, state_columns=columns, **fields)


def specific_force(
    to_ned: Array, acceleration: Array, rates: Array, spin: Array, vehicle: Vehicle
) -> Array:
    """What an accelerometer at the IMU site feels [m/s2], body FRD, shape (time, 3).

    a_CB - g in body axes plus the lever arm: spin x r + omega x (omega x r). At rest and level it
    is (0, 0, -g).

    Args:
      to_ned: body to NED, (time, 3, 3).
      acceleration: of the CB, NED [m/s2], (time, 3).
      rates: body FRD [rad/s], (time, 3).
      spin: d(rates)/dt [rad/s2], (time, 3).
    """
    gravity = np.array([0.0, 0.0, vehicle.gravity])
    felt = np.einsum("tji,tj->ti", to_ned, acceleration - gravity)
    arm = vehicle.imu_position
    return felt + np.cross(spin, arm) + np.cross(rates, np.cross(rates, arm))
