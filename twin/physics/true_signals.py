"""True signals: the named signals of a trajectory, made from log rows of native code.

Part variables are the entries of stores for the positions and commands of a vehicle's parts.
`LiveTruth` turns one log row into true and commanded signals while a run goes on.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError
from twin.frames import flip_quaternion, flip_vector, quaternion_to_euler, quaternion_to_matrix
from twin.numbers import Array
from twin.records.schema import SIMULATED, VARIABLES, WITH_FLOOR, Variable, declare
from twin.records.schema.limits import TABLE
from twin.records.trajectory import Trajectory, actuator_names, sample_times
from twin.vehicle.consumption import ENERGY, HOTEL, Consumption
from twin.vehicle.mjcf import MjcfReader
from twin.vehicle.vehicle import Vehicle
from twin.water.floor.lookup import floor_depth, floor_depths

SAMPLE_PERIOD = 0.5
"""[s] Time between samples: 2 Hz, as in the paper."""
ENGINES = ("mujoco", "lanes")
"""Engines that can fly a scenario; see `twin.physics.lanes` for the second."""
UNITS = frozenset(row.units for row in TABLE)
"""Units whose quantities have limits in the schema."""
ENERGIES = (0.0, 1e10)
"""[J] Limits of an energy; 1e10 exceeds the battery of a small submarine."""
LEAN = ("time", "qpos", "qvel", "act", "current")
"""Fields of a log row that a lean trajectory reads: pose, velocities, parts and current."""
_OWN = frozenset((*SIMULATED, *WITH_FLOOR))
"""Signals of the schema itself; parts must not take their names, except those of actuators."""


def part_variables(vehicle: Vehicle) -> dict[str, Variable]:
    """Variables of a vehicle's parts by name: true position, command and encoder reading of each.

    Raises:
      VehicleError: a part has the name of another signal, such as `pitch`, or an unlike unit.
    """
    found: dict[str, Variable] = {}
    shared = actuator_names(SIMULATED)
    for part in vehicle.parts:
        quantity, words = part.quantity, part.name.replace("_", " ")
        for name, text in (
            (f"true_{part.name}", f"{words}, {quantity.long_name}"),
            (f"commanded_{part.name}", f"commanded {words}, {quantity.long_name}"),
            (f"measured_{part.name}", f"{words} by its encoder, {quantity.long_name}"),
        ):
            if name in _OWN and part.name not in shared:
                raise VehicleError(
                    f"vehicle {vehicle.name!r} ({vehicle.path}): a part must not be called "
                    f"{part.name!r}, which is a signal of every vehicle; give its actuator another "
                    "name"
                )
            known = VARIABLES.get(name)
            if known is None:
                known = Variable(name, quantity.unit, text, limits=quantity.limits)
                if quantity.limits is None and quantity.unit not in UNITS:
                    raise VehicleError(
                        f"vehicle part {part.kind!r}: `quantity` has the unit {quantity.unit!r} "
                        "and no `limits`; give the lowest and highest value that one can have"
                    )
            elif known.units != quantity.unit:
                raise VehicleError(
                    f"vehicle {vehicle.name!r} ({vehicle.path}): {name} of its part {part.name!r} "
                    f"({part.kind}) would be stored in {quantity.unit}, but is "
                    f"{known.long_name!r} in {known.units} already; give its actuator another name"
                )
            found[name] = known
    return found


def energy_variables(vehicle: Vehicle) -> tuple[Variable, ...]:
    """Variables of the energy that a vehicle's electronics and parts consume."""
    of = {HOTEL: "electronics and sensors"}
    of |= {name: name.replace("_", " ") for name in vehicle.part_names}
    return tuple(
        Variable(
            ENERGY + name, "J", f"electrical energy taken since the start: {text}", limits=ENERGIES
        )
        for name, text in of.items()
    )


def declare_parts(vehicle: Vehicle) -> None:
    """Add the variables of a vehicle's parts and of its energy; raises like `part_variables`."""
    for entry in (*part_variables(vehicle).values(), *energy_variables(vehicle)):
        declare(entry)


def simulated_signals(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the true and commanded signals of every simulated mission, in storage order."""
    parts = part_variables(vehicle)
    none = {f"{kind}_{name}" for kind in _KINDS for name in actuator_names(SIMULATED)}
    names = [name for name in SIMULATED if name not in none or name in parts]
    return tuple(
        name for name in dict.fromkeys((*names, *parts)) if not name.startswith("measured_")
    )


_KINDS = ("true", "commanded", "measured")


def state_columns(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the columns of a trajectory's `states`: qpos, qvel, act, ctrl (SI, rad, cm3)."""
    return _columns(vehicle.xml, vehicle.path, vehicle.part_names)


@functools.lru_cache(maxsize=16)
def _columns(xml: str, path: Path, parts: tuple[str, ...]) -> tuple[str, ...]:
    joints = [
        f"{body.get('name')}_{joint.get('name')}"
        for body in MjcfReader(xml, path).moving_bodies()
        for joint in body.findall("joint")
    ]
    return (
        *("x", "y", "z", "qw", "qx", "qy", "qz", *joints),
        *("vx", "vy", "vz", "wx", "wy", "wz", *(f"{joint}_rate" for joint in joints)),
        *(f"act_{part}" for part in parts),
        *(f"ctrl_{part}" for part in parts),
    )


def from_log(
    rows: NDArray[Any],
    vehicle: Vehicle,
    *,
    half_step: float = 0.0,
    sample_period: float | None = None,
    floor: Array | None = None,
    contacts: bool = False,
    lean: bool = False,
    **fields: Any,
) -> Trajectory:
    """Turn native log rows, records of `block.log_row`, into a `Trajectory`.

    `half_step` [s] is the time by which a stored velocity is older than its sample: half a step in
    time-centred runs, otherwise 0. With a `sample_period` [s] the rows start a run and times are
    its multiples, because MuJoCo's clock adds up steps and drifts by nanoseconds. `floor` is the
    table of the sea floor, from which the altitude is found. `contacts` adds the signal of contact,
    for a model that can touch something. `lean` reads the fields `LEAN` alone and gives position,
    attitude, velocities, parts and energy.
    """
    declare_parts(vehicle)
    qpos, qvel, act = (rows[name] for name in ("qpos", "qvel", "act"))
    quaternion = flip_quaternion(qpos[:, 3:7])
    roll, pitch, heading = quaternion_to_euler(quaternion)
    to_ned = quaternion_to_matrix(quaternion)
    twist = qvel[:, :6]
    if half_step:
        twist = twist + half_step * rows["acceleration"]
    position, velocity = flip_vector(qpos[:, :3]), flip_vector(twist[:, :3])
    current = rows["current"]
    v_rel = np.einsum("tji,tj->ti", to_ned, velocity - current)
    degrees = np.rad2deg
    signals: dict[str, Array] = {}

    def put(prefix: str, names: str, values: Array) -> None:
        for name, column in zip(names.split(), values.T, strict=True):
            signals[prefix + name] = column

    put("true_", "north east depth", position)
    put("true_", "roll pitch heading", degrees(np.stack([roll, pitch, heading], -1)))
    put("true_", "surge sway heave", v_rel)
    put("true_velocity_", "north east down", velocity)
    scale = np.array([part.quantity.scale for part in vehicle.parts])
    parts = " ".join(vehicle.part_names)
    time = rows["time"].copy()
    if sample_period is not None:
        time = sample_times(len(rows), sample_period)
    if lean:
        put("true_", parts, act * scale)
        signals |= Consumption.of(vehicle).signals(vehicle, signals, time)
        return Trajectory(time=time, signals=signals, states=np.zeros((len(rows), 0)), **fields)
    rate, ctrl = rows["acceleration"], rows["ctrl"]
    rates = flip_vector(twist[:, 3:])
    acceleration, spin = flip_vector(rate[:, :3]), flip_vector(rate[:, 3:])
    put("true_", "roll_rate pitch_rate yaw_rate", rates)
    put("true_specific_force_", "x y z",
        specific_force(to_ned, acceleration, rates, spin, vehicle))  # fmt: skip
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
    signals |= Consumption.of(vehicle).signals(vehicle, signals, time)
    columns = state_columns(vehicle)
    return Trajectory(time=time, signals=signals, states=states, state_columns=columns, **fields)


def specific_force(
    to_ned: Array, acceleration: Array, rates: Array, spin: Array, vehicle: Vehicle
) -> Array:
    """Specific force at the IMU site [m/s2], body FRD, shape (time, 3).

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


class LiveTruth:
    """True and commanded signals of one vehicle, one log row at a time."""

    def __init__(self, vehicle: Vehicle, row: np.dtype[Any], *, half_step: float, floor: Array):
        """Take `row`, the dtype of a log row; `half_step` [s] and `floor` are as in `from_log`, but
        `floor` is empty without a sea floor."""
        self._half, self._floor = half_step, floor
        self._scales = [(p.name, p.quantity.scale, k) for k, p in enumerate(vehicle.parts)]
        self._gravity, self._arm = vehicle.gravity, [float(x) for x in vehicle.imu_position]
        still = np.zeros(1, row)[0]
        still["qpos"][3] = 1.0
        self.names = tuple(self.sample(still, np.zeros(6)))
        """Names of the signals that `sample` returns."""

    def sample(self, row: Any, acceleration: Array) -> dict[str, float]:
        """Signals by schema name, angles in degrees.

        Args:
          row: a record of `block.log_row`.
          acceleration: d(qvel)/dt over the step after the sample, (6,).
        """
        x, y, z, w, i, j, k = row["qpos"][:7].tolist()
        j, k = -j, -k  # z-up axes to north, east, down, on both sides
        rate = acceleration.tolist()
        stored = row["qvel"][:6].tolist()
        twist = [v + self._half * a for v, a in zip(stored, rate, strict=True)]
        north, east, depth = x, -y, -z
        # body to NED, columns forward, starboard, down
        xx, xy, xz = 1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j - w * k), 2.0 * (i * k + w * j)
        yx, yy, yz = 2.0 * (i * j + w * k), 1.0 - 2.0 * (i * i + k * k), 2.0 * (j * k - w * i)
        zx, zy, zz = 2.0 * (i * k - w * j), 2.0 * (j * k + w * i), 1.0 - 2.0 * (i * i + j * j)
        v_n, v_e, v_d = twist[0], -twist[1], -twist[2]
        p, q, r = twist[3], -twist[4], -twist[5]
        c_n, c_e, c_d = row["current"].tolist()
        r_n, r_e, r_d = v_n - c_n, v_e - c_e, v_d - c_d
        felt = (rate[0], -rate[1], -rate[2] - self._gravity)
        spin = (rate[3], -rate[4], -rate[5])
        a, b, c = self._arm
        f = (q * c - r * b, r * a - p * c, p * b - q * a)  # rates x arm
        signals = {
            "true_north": north,
            "true_east": east,
            "true_depth": depth,
            "true_roll": math.degrees(math.atan2(zy, zz)),
            "true_pitch": math.degrees(math.asin(min(max(-zx, -1.0), 1.0))),
            "true_heading": math.degrees(math.atan2(yx, xx)) % 360.0,
            "true_surge": xx * r_n + yx * r_e + zx * r_d,
            "true_sway": xy * r_n + yy * r_e + zy * r_d,
            "true_heave": xz * r_n + yz * r_e + zz * r_d,
            "true_velocity_north": v_n,
            "true_velocity_east": v_e,
            "true_velocity_down": v_d,
            "true_roll_rate": p,
            "true_pitch_rate": q,
            "true_yaw_rate": r,
            "true_specific_force_x": (
                xx * felt[0] + yx * felt[1] + zx * felt[2]
                + spin[1] * c - spin[2] * b + q * f[2] - r * f[1]
            ),
            "true_specific_force_y": (
                xy * felt[0] + yy * felt[1] + zy * felt[2]
                + spin[2] * a - spin[0] * c + r * f[0] - p * f[2]
            ),
            "true_specific_force_z": (
                xz * felt[0] + yz * felt[1] + zz * felt[2]
                + spin[0] * b - spin[1] * a + p * f[1] - q * f[0]
            ),
            "true_current_north": c_n,
            "true_current_east": c_e,
            "true_current_down": c_d,
            "true_net_mass": float(row["net_mass"]),
            "true_density": float(row["density"]),
            "true_immersion": float(row["immersion"]),
        }  # fmt: skip
        positions, commands = row["act"].tolist(), row["ctrl"].tolist()
        for name, scale, index in self._scales:
            signals[f"true_{name}"] = positions[index] * scale
            signals[f"commanded_{name}"] = commands[index] * scale
        if self._floor.size:
            signals["true_altitude"] = float(floor_depth(self._floor, north, east)) - depth
        return signals
