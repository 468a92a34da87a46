"""Trajectory: what one simulated mission was, as named arrays in NED and FRD.

The names are the schema's: `true_*` is what happened, `commanded_*` what was asked for;
`measured_*` is added by the sensor models. `VARIABLES` says what each one is.
"""

from __future__ import annotations

import dataclasses
import math
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.frames import flip_quaternion, flip_vector, quaternion_to_euler, quaternion_to_matrix
from twin.native import block as b
from twin.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One mission, sampled at a fixed period.

    `signals` maps schema names to float64 arrays of shape (time,); `states` holds the MuJoCo rows
    (time, 23): qpos 9, qvel 8, act 3, ctrl 3, from which any sample can be rendered or resumed.
    """

    time: Array
    """[s] since the start, shape (time,)."""
    signals: dict[str, Array]
    states: Array
    complete: bool = True
    """False when the simulation stopped early (unstable)."""
    provenance: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __getitem__(self, name: str) -> Array:
        return self.signals[name]

    @property
    def position(self) -> Array:
        """North, east, depth [m], shape (time, 3)."""
        return np.stack([self[f"true_{n}"] for n in ("north", "east", "depth")], axis=-1)

    @property
    def v_rel(self) -> Array:
        """Surge, sway, heave through the water [m/s], body FRD, shape (time, 3)."""
        return np.stack([self[f"true_{n}"] for n in ("surge", "sway", "heave")], axis=-1)

    def distance_through_water(self) -> Array:
        """Path length through the water [m] up to each sample, shape (time,)."""
        return _cumulative(np.linalg.norm(self.v_rel, axis=-1), self.time)

    def track_through_water(self) -> Array:
        """North, east [m] that the glider moved relative to the water, shape (time, 2)."""
        north = self["true_velocity_north"] - self["true_current_north"]
        east = self["true_velocity_east"] - self["true_current_east"]
        return np.stack([_cumulative(north, self.time), _cumulative(east, self.time)], axis=-1)


def _cumulative(rate: Array, time: Array) -> Array:
    """Trapezoidal integral from 0, same shape as `rate`."""
    steps = np.diff(time) * (rate[1:] + rate[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])


def sample_times(count: int, period: float) -> Array:
    """Times [s] of samples 0, 1, 2, ... at a `period` [s], each rounded once, shape (count,).

    Whole seconds are whole numbers, also for periods such as 0.1 that no float holds exactly.
    """
    ratio = Fraction(period).limit_denominator(_FINEST_FRACTION)
    if not math.isclose(ratio, period, rel_tol=1e-15):
        return np.arange(count, dtype=float) * period
    return np.arange(count, dtype=float) * ratio.numerator / ratio.denominator


_FINEST_FRACTION = 10_000
"""Largest denominator of a sample period in seconds: physics steps are 1e-4 s or longer"""


def from_log(
    rows: Array,
    vehicle: Vehicle,
    *,
    half_step: float = 0.0,
    sample_period: float | None = None,
    **fields: Any,
) -> Trajectory:
    """Turn native log rows (time, ROW) into a `Trajectory`.

    `half_step` [s] is how long before its sample a stored velocity holds: half a step in
    time-centred runs, where velocities live between positions. With a `sample_period` [s] the
    rows are a run from its start, and times are its multiples: MuJoCo's clock adds up steps and
    drifts by nanoseconds.
    """
    qpos, qvel = rows[:, b.R_QPOS : b.R_QPOS + 9], rows[:, b.R_QVEL : b.R_QVEL + 8]
    act, ctrl = rows[:, b.R_ACT : b.R_ACT + 3], rows[:, b.R_CTRL : b.R_CTRL + 3]
    quaternion = flip_quaternion(qpos[:, 3:7])
    roll, pitch, heading = quaternion_to_euler(quaternion)
    to_ned = quaternion_to_matrix(quaternion)
    rate = rows[:, b.R_ACCELERATION : b.ROW]
    twist = qvel[:, :6] + half_step * rate
    position, velocity = flip_vector(qpos[:, :3]), flip_vector(twist[:, :3])
    current = rows[:, b.R_CURRENT : b.R_CURRENT + 3]
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
    put("true_", "shift rotation pump", act * _ACTUATOR_SCALE)
    put("true_current_", "north east down", current)
    for name, column in (
        ("true_net_mass", b.R_NET_MASS),
        ("true_density", b.R_DENSITY),
        ("true_immersion", b.R_IMMERSION),
        ("commanded_segment", b.R_SEGMENT),
    ):
        signals[name] = rows[:, column]
    put("commanded_", "shift rotation pump", ctrl * _ACTUATOR_SCALE)
    signals["commanded_pitch"] = degrees(rows[:, b.R_PITCH_SETPOINT])
    signals["commanded_heading"] = np.mod(degrees(rows[:, b.R_HEADING_SETPOINT]), 360.0)
    states = np.concatenate([qpos, qvel, act, ctrl], axis=1)
    time = rows[:, b.R_TIME].copy()
    if sample_period is not None:
        time = sample_times(len(rows), sample_period)
    return Trajectory(time=time, signals=signals, states=states, **fields)


_ACTUATOR_SCALE = np.array([1.0, 180.0 / np.pi, 1.0])
"""Stores give the rotation in degrees."""


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
