"""Live truth: one log row as the true and commanded signals of a sample, while a run goes on.

The signals are those of `twin.physics.log_signals.from_log`, to rounding, one sample at a time and
some hundred times faster.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.vehicle.vehicle import Vehicle
from twin.water.floor.lookup import floor_depth

Array = NDArray[np.float64]


class LiveTruth:
    """The samples of a run of one vehicle."""

    def __init__(self, vehicle: Vehicle, row: np.dtype[Any], *, half_step: float, floor: Array):
        """`row` is the type of a log row, the others are as of `from_log`; `floor` is empty without
        a sea floor."""
        self._half, self._floor = half_step, floor
        self._scales = [(p.name, p.quantity.scale, k) for k, p in enumerate(vehicle.parts)]
        self._gravity, self._arm = vehicle.gravity, [float(x) for x in vehicle.imu_position]
        still = np.zeros(1, row)[0]
        still["qpos"][3] = 1.0
        self.names = tuple(self.sample(still, np.zeros(6)))
        """Of the signals."""

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
