"""Noise: seeded random streams and the correlated processes that the devices share."""

from __future__ import annotations

import hashlib
import math

import numpy as np
from numpy.typing import NDArray

from twin.numbers import Array

Normals = NDArray[np.float32]

PLACES = (
    "imu", "attitude", "compass", "pressure", "gps", "dvl", "encoders", "onboard", "ctd",
    "altimeter",
)  # fmt: skip
"""Places of the shipped sensors in the seed tree: append, never reorder. Any other sensor has the
place that its name hashes to."""

DRAWN_STREAM, NOISE_STREAM = 0, 1

KNOTS = 20
"""per correlation time at least: slow processes are drawn there and are linear in between"""


def sensor_generator(
    seed: np.random.SeedSequence, sensor: str, stream: int = NOISE_STREAM
) -> np.random.Generator:
    """The own generator of the sensor of that name below `seed`, which is left as it was.

    Two streams per sensor, `DRAWN_STREAM` for the constants of a mission and `NOISE_STREAM`,
    so that neither another sensor nor a constant given by hand changes the noise.
    """
    if sensor in PLACES:
        place = PLACES.index(sensor)
    else:
        place = int.from_bytes(hashlib.sha256(sensor.encode()).digest()[:8])
    key = (*seed.spawn_key, place, stream)
    child = np.random.SeedSequence(seed.entropy, spawn_key=key, pool_size=seed.pool_size)
    return np.random.Generator(np.random.SFC64(child))


def normals(rng: np.random.Generator, *shape: int) -> Normals:
    """Standard normal float32: 1e-7 of a sigma of rounding, for less than the float64 price."""
    return rng.standard_normal(shape, dtype=np.float32)


def knot_stride(dt: float, correlation_time: float) -> int:
    """Samples between the knots of a slow process: at most 1/KNOTS of its correlation time."""
    return max(1, int(correlation_time / (KNOTS * dt)))


def knot_count(n: int, stride: int) -> int:
    """Knots that span `n` samples."""
    return (n - 1) // stride + 2


def gauss_markov_knots(std: float, dt: float, correlation_time: float) -> tuple[float, float, int]:
    """Standard deviation at the knots, decay from knot to knot and stride of a process.

    decay = exp(-h / correlation_time) is the exact step. Linear interpolation lowers the mean
    variance to 2/3 + decay/3; the knots make up for it, so that `std` is the RMS of the result.
    """
    stride = knot_stride(dt, correlation_time)
    decay = math.exp(-stride * dt / correlation_time)
    if stride > 1:
        std /= math.sqrt((2.0 + decay) / 3.0)
    return std, decay, stride


def gauss_markov(
    rng: np.random.Generator, n: int, *, std: float, dt: float, correlation_time: float
) -> Array:
    """Stationary first-order Gauss-Markov process of RMS `std`, shape (n,), every `dt` [s]."""
    from twin.sensors.kernels import gauss_markov_kernel

    std, decay, stride = gauss_markov_knots(std, dt, correlation_time)
    out = np.empty(n)
    gauss_markov_kernel(normals(rng, knot_count(n, stride)), std, decay, stride, out)
    return out
