"""IMU: the gyroscope and accelerometer triads.

measured = (I + scale + misalignment) true + turn-on bias + bias instability + rate random walk +
white noise, per axis. The terms follow from data sheets' Allan deviation curves by the conventions
of IEEE 952-2020. White noise has N on the curve at 1 s, and rate random walk has K at 3 s. A
first-order Gauss-Markov process of standard deviation s_b peaks at GAUSS_MARKOV_PEAK s_b, 1.89
correlation times out. The sheet's bias instability (the curve's minimum) therefore gives s_b =
minimum / GAUSS_MARKOV_PEAK.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.numbers import Array
from twin.records.schema import variables
from twin.sensors.base import (
    Outset,
    Sensor,
    SensorRun,
    Signals,
    columns,
    drawn_value,
    gauss_markov_knots,
    knot_count,
    normals,
    require_non_negative,
    require_positive,
)
from twin.sensors.kernels import slow_kernel, triad_kernel

DEG = math.pi / 180.0
DEG_PER_HOUR = DEG / 3600.0
STANDARD_GRAVITY = 9.80665
"""[m/s2] Gravity "g" of data sheets."""
GAUSS_MARKOV_PEAK = 0.618
"""[1] Peak of a Gauss-Markov process's Allan deviation, divided by its standard deviation."""
GAUSS_MARKOV_PEAK_TIME = 1.89
"""[1] Averaging time of this peak, divided by the correlation time."""
DRIFT_HORIZON = 3600.0
"""[s] Averaging time at which the default rate random walk equals the bias instability. Data
sheets give no rate random walk; real MEMS curves rise again within about an hour."""

AXES = ("x", "y", "z")
GYRO_SIGNALS = ("roll_rate", "pitch_rate", "yaw_rate")
FORCE_SIGNALS = ("specific_force_x", "specific_force_y", "specific_force_z")
CONSTANTS = {
    "gyro_bias": "rad s-1", "gyro_scale": "1", "gyro_misalignment": "rad",
    "accel_bias": "m s-2", "accel_scale": "1", "accel_misalignment": "rad",
}  # fmt: skip
"""Units of the constants sampled per mission for each axis."""
DRAWS = {f"{name}_{axis}": unit for name, unit in CONSTANTS.items() for axis in AXES}


def _walk(bias_instability: float) -> float:
    """Rate random walk K whose Allan deviation at DRIFT_HORIZON is `bias_instability`."""
    return bias_instability / math.sqrt(DRIFT_HORIZON / 3.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Imu(Sensor):
    """Errors of one IMU; the defaults are the Microstrain 3DM-GX5-25 (LORD data sheet 8400-0093).

    Turn-on bias, scale factor and misalignment are sampled once per mission from normal
    distributions with the standard deviations below.
    """

    name = "imu"
    reads = tuple(f"true_{name}" for name in GYRO_SIGNALS + FORCE_SIGNALS)
    writes = variables(*(f"measured_{name}" for name in GYRO_SIGNALS + FORCE_SIGNALS))
    draws = DRAWS
    ideal_is_truth = True

    gyro_noise_density: float = 0.005 * DEG
    """[rad/s/sqrt(Hz)] Angular random walk N"""
    gyro_bias_instability: float = 8.0 * DEG_PER_HOUR
    """[rad/s] Minimum of the Allan deviation"""
    gyro_rate_random_walk: float = _walk(8.0 * DEG_PER_HOUR)
    """[rad/s/sqrt(s)] Rate random walk K; our estimate, see DRIFT_HORIZON"""
    gyro_turn_on_bias: float = 0.04 * DEG
    """[rad/s] Standard deviation; the sheet's +-0.04 deg/s read as one sigma"""
    gyro_scale: float = 0.0005
    """[1] Standard deviation of the scale factor error (0.05 %)"""
    accel_noise_density: float = 25e-6 * STANDARD_GRAVITY
    """[m/s2/sqrt(Hz)] Velocity random walk N (25 ug at +-8 g)"""
    accel_bias_instability: float = 0.04e-3 * STANDARD_GRAVITY
    """[m/s2] Minimum of the Allan deviation (0.04 mg)"""
    accel_rate_random_walk: float = _walk(0.04e-3 * STANDARD_GRAVITY)
    """[m/s2/sqrt(s)] Rate random walk K; our estimate, see DRIFT_HORIZON"""
    accel_turn_on_bias: float = 0.002 * STANDARD_GRAVITY
    """[m/s2] Standard deviation (0.002 g)"""
    accel_scale: float = 0.0003
    """[1] Standard deviation of the scale factor error (0.03 %)"""
    misalignment_deg: float = 0.05
    """[deg] Standard deviation of the three angles by which each triad is turned"""
    correlation_time: float = 100.0
    """[s] Correlation time of the bias instability; not in sheets, whose minima lie at 1-5 min"""

    def __post_init__(self) -> None:
        names = [f.name for f in dataclasses.fields(self) if f.name != "correlation_time"]
        require_non_negative(self, *names)
        require_positive(self, "correlation_time")

    @classmethod
    def ideal(cls) -> Imu:
        """Make an IMU without errors."""
        names = (f.name for f in dataclasses.fields(cls) if f.name != "correlation_time")
        return cls(**dict.fromkeys(names, 0.0))

    @classmethod
    def preset(cls, name: str) -> Imu:
        """Return an IMU of `IMU_PRESETS` by name."""
        if name not in IMU_PRESETS:
            raise InputError(unknown_name("IMU", name, IMU_PRESETS))
        return IMU_PRESETS[name]

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample the mission's constants per axis: bias [SI], scale [1], misalignment [rad]."""
        turn = self.misalignment_deg * DEG
        gyro = (self.gyro_turn_on_bias, self.gyro_scale, turn)
        accel = (self.accel_turn_on_bias, self.accel_scale, turn)
        return self.draw_normal(rng, np.repeat((*gyro, *accel), len(AXES)).tolist())

    def begin(self, outset: Outset) -> ImuRun:
        """Begin to measure rates [rad/s] and specific force [m/s2] at the IMU site, body FRD."""
        return ImuRun(
            self._triad(outset, GYRO_SIGNALS, "gyro"), self._triad(outset, FORCE_SIGNALS, "accel")
        )

    def _triad(self, outset: Outset, names: tuple[str, ...], triad: str) -> TriadRun:
        """Begin three axes of one type, whose settings begin with `triad`."""
        density, instability, walk = (
            getattr(self, f"{triad}_{name}")
            for name in ("noise_density", "bias_instability", "rate_random_walk")
        )
        n, dt, drawn, rng = outset.samples, outset.dt, outset.drawn, outset.rng
        bias, scale, turn = (
            np.array([drawn_value(drawn, f"{triad}_{what}_{axis}") for axis in AXES])
            for what in ("bias", "scale", "misalignment")
        )
        # I + diag(scale) - turn x: rotation of the triad by small angles
        matrix = np.diag(1.0 + scale) + np.array(
            [[0.0, turn[2], -turn[1]], [-turn[2], 0.0, turn[0]], [turn[1], -turn[0], 0.0]]
        )
        std, decay, stride = gauss_markov_knots(
            instability / GAUSS_MARKOV_PEAK, dt, self.correlation_time
        )
        white = normals(rng, 3, n)
        knots = normals(rng, 3, 2, knot_count(n, stride))
        slow = np.empty((3, knots.shape[2]))
        slow_kernel(bias, knots, std, decay, walk * math.sqrt(stride * dt), slow)
        return TriadRun(names, matrix, white, density / math.sqrt(dt), slow, stride)


@dataclasses.dataclass
class TriadRun(SensorRun):
    """Three axes of one type."""

    names: tuple[str, ...]
    matrix: Array
    """Scale factors and misalignment, (3, 3)."""
    white: NDArray[np.float32]
    """Standard normals, (3, n)."""
    white_std: float
    slow: Array
    """Bias and its slow changes at the knots, (3, m)."""
    stride: int
    """Number of samples from knot to knot."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        out = np.empty((3, last - first))
        triad_kernel(
            *columns(signals, [f"true_{name}" for name in self.names], slice(first, last)),
            self.matrix, self.white, self.white_std, self.slow, self.stride, first, out,
        )  # fmt: skip
        return {f"measured_{name}": out[i] for i, name in enumerate(self.names)}


@dataclasses.dataclass
class ImuRun(SensorRun):
    """Gyroscope and accelerometer in one mission."""

    gyro: TriadRun
    force: TriadRun

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        return self.gyro.measure(signals, first, last) | self.force.measure(signals, first, last)


IMU_PRESETS: dict[str, Imu] = {
    "ideal": Imu.ideal(),
    "3DM-GX5-25": Imu(),
    # the paper's table with the sheet's noise: the filter has removed turn-on biases, and there are
    # neither scale factors nor misalignments
    "3DM-GX5-25-table": Imu(
        gyro_turn_on_bias=0.0,
        gyro_scale=0.0,
        accel_turn_on_bias=0.0,
        accel_scale=0.0,
        misalignment_deg=0.0,
    ),
    # a second source gives a higher accelerometer noise for the same device
    "3DM-GX5-25-80ug": Imu(accel_noise_density=80e-6 * STANDARD_GRAVITY),
    # the osrf/lrauv simulation of the Tethys class
    "AHRS-M2": Imu(
        gyro_noise_density=0.04 * DEG,
        gyro_bias_instability=6.415 * DEG_PER_HOUR,
        gyro_rate_random_walk=_walk(6.415 * DEG_PER_HOUR),
        accel_noise_density=250e-6 * STANDARD_GRAVITY,
        accel_bias_instability=0.07441e-3 * STANDARD_GRAVITY,
        accel_rate_random_walk=_walk(0.07441e-3 * STANDARD_GRAVITY),
    ),
    "MTi-630": Imu(gyro_noise_density=0.007 * DEG, accel_noise_density=60e-6 * STANDARD_GRAVITY),
    "MV5-AR": Imu(gyro_noise_density=0.0075 * DEG, accel_noise_density=85e-6 * STANDARD_GRAVITY),
}
"""IMUs by name. A number that a device's source lacks is the 3DM-GX5-25's."""
