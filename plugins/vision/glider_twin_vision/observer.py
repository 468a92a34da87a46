"""Observer: who carries the camera, how it moves, and how well it knows its own motion.

A frame stands on the floor. A second vehicle keeps a distance and measures its own velocity by a
Doppler log. A diver keeps it too, by hand, and its velocity is the visual odometry of the floor.
Observers look at the vehicle's place of a moment ago. All numbers are ours.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from glider_twin_vision.smoother import Frames
from twin.errors import InputError

Array = NDArray[np.float64]
SIGNALS = (
    *(f"true_{name}" for name in ("north", "east", "depth", "roll", "pitch", "heading")),
    *(f"true_velocity_{name}" for name in ("north", "east", "down")),
)
"""Signals of the vehicle that its picture depends on"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Observer:
    """Motion of a camera's carrier and errors of what it knows of this motion."""

    moves: bool
    """True if it follows the vehicle"""
    jitter: float
    """[m] Deviation of its place from where it wants to be"""
    sway_deg: float
    """[degree] Deviation of its view from where it wants to look"""
    attitude_deg: float
    """[degree] Error of its attitude, which changes within a minute"""
    velocity: float
    """[m/s] Constant error of its own velocity, each axis"""
    velocity_scale: float
    """[1] Error of its velocity in proportion"""


OBSERVERS: Mapping[str, Observer] = {
    "frame": Observer(moves=False, jitter=0.0, sway_deg=0.0, attitude_deg=0.0, velocity=0.0,
                      velocity_scale=0.0),
    "vehicle": Observer(moves=True, jitter=0.05, sway_deg=2.0, attitude_deg=0.5, velocity=0.003,
                        velocity_scale=0.005),
    "diver": Observer(moves=True, jitter=0.12, sway_deg=5.0, attitude_deg=1.0, velocity=0.01,
                      velocity_scale=0.02),
}  # fmt: skip
"""Observers by name"""


def observer(name: str) -> Observer:
    """Return an observer by name; raises InputError, which lists the names."""
    if name not in OBSERVERS:
        raise InputError(f"observer {name!r} is unknown: choose among {', '.join(OBSERVERS)}")
    return OBSERVERS[name]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """Vehicle and camera at each picture; places [m] north-east-down, matrices to these axes."""

    time: Array
    """[s] of the pictures, (n,)"""
    body: Array
    """(n, 3)"""
    body_turn: Array
    """From body axes, (n, 3, 3)"""
    body_velocity: Array
    """[m/s] (n, 3)"""
    eye: Array
    """(n, 3)"""
    eye_turn: Array
    """From camera axes, (n, 3, 3)"""
    known_eye: Array
    """Place of the camera as its carrier knows it, (n, 3)"""
    known_turn: Array
    """Attitude of the camera as its carrier knows it, (n, 3, 3)"""

    def seen(self) -> tuple[Array, Array]:
        """Place [m], (n, 3), and matrix from body axes, (n, 3, 3), of the vehicle in the camera."""
        back = self.eye_turn.swapaxes(1, 2)
        return np.einsum("nij,nj->ni", back, self.body - self.eye), back @ self.body_turn

    def frames(
        self, kept: NDArray[np.int64], place: Array, turn: Array, covariance: Array
    ) -> Frames:
        """Turn poses of the pictures `kept`, in camera axes, into axes that the carrier knows."""
        known = self.known_turn[kept]
        six = np.zeros((len(kept), 6, 6))
        six[:, :3, :3] = six[:, 3:, 3:] = known
        return Frames(
            time=self.time[kept],
            place=self.known_eye[kept] + np.einsum("nij,nj->ni", known, place),
            turn=known @ turn, covariance=six @ covariance @ six.swapaxes(1, 2),
        )  # fmt: skip


def drift(rng: np.random.Generator, count: int, step: float, spread: float, tau: float,
          width: int = 3) -> Array:  # fmt: skip
    """Gauss-Markov process of a deviation and a correlation time [s], (count, width)."""
    keep = math.exp(-step / tau)
    noise = rng.standard_normal((count, width))
    noise[1:] *= math.sqrt(1.0 - keep**2)
    return np.asarray(spread * lfilter([1.0], [1.0, -keep], noise, axis=0))


def watch(
    truth: Mapping[str, Array], period: float, rng: np.random.Generator, *, name: str, rate: float,
    distance: float,
) -> View:  # fmt: skip
    """Move an observer beside a vehicle.

    Args:
      truth: the signals SIGNALS, every `period` [s].
      name: key of OBSERVERS.
      rate: [1/s] pictures.
      distance: [m] from the vehicle; of a frame, from the middle of the vehicle's path.

    Raises:
      InputError: the observer is unknown.
    """
    its = observer(name)
    known = np.arange(len(truth["true_depth"])) * period
    time = np.arange(0.0, known[-1] + 1e-9, 1.0 / rate)
    track = np.stack([truth[one] for one in SIGNALS[:3]], axis=-1).astype(float)
    speed = np.stack([truth[one] for one in SIGNALS[6:]], axis=-1).astype(float)
    path = CubicHermiteSpline(known, track, speed)
    body, velocity = path(time), path(time, 1)
    angles = np.unwrap(np.radians([truth[one] for one in SIGNALS[3:6]]), axis=1).T
    body_turn = Rotation.from_euler("ZYX", CubicSpline(known, angles)(time)[:, ::-1]).as_matrix()
    count, step = len(time), 1.0 / rate
    bearing = np.full(count, rng.uniform(0.0, 2.0 * math.pi))
    if its.moves:
        bearing = bearing + drift(rng, count, step, 0.5, 60.0, 1)[:, 0]
        lag = 1.0 - math.exp(-step / 1.0)
        aim = lfilter([lag], [1.0, lag - 1.0], body - body[0], axis=0) + body[0]
    else:
        aim = np.tile(0.5 * (body.min(axis=0) + body.max(axis=0)), (count, 1))
    rise = math.radians(20.0)
    aside = np.stack(
        [math.cos(rise) * np.cos(bearing), math.cos(rise) * np.sin(bearing),
         np.full(count, -math.sin(rise))], axis=-1,
    )  # fmt: skip
    eye = aim + distance * aside
    eye += its.jitter * smooth_noise(rng, count, step)
    eye_turn = looking(aim - eye)
    wobble = np.radians(its.sway_deg) * smooth_noise(rng, count, step)
    eye_turn = eye_turn @ Rotation.from_rotvec(wobble).as_matrix()
    wrong = np.radians(drift(rng, count, step, its.attitude_deg, 60.0))
    own = np.gradient(eye, step, axis=0)
    error = its.velocity * rng.standard_normal(3) + its.velocity_scale * rng.standard_normal() * own
    return View(
        time=time, body=body, body_turn=body_turn, body_velocity=velocity, eye=eye,
        eye_turn=eye_turn, known_eye=eye + np.cumsum(error, axis=0) * step,
        known_turn=Rotation.from_rotvec(wrong).as_matrix() @ eye_turn,
    )  # fmt: skip


def smooth_noise(rng: np.random.Generator, count: int, step: float) -> Array:
    """Motion of a body in water: deviation 1, three axes, smooth over two seconds, (count, 3)."""
    found = drift(rng, count, step, 1.0, 2.0)
    lag = 1.0 - math.exp(-step / 1.0)
    found = lfilter([lag], [1.0, lag - 1.0], found, axis=0)
    return np.asarray(found / max(math.sqrt(2.0 / 3.0), 1e-9))


def looking(ahead: Array) -> Array:
    """Matrices from camera axes of level cameras that look along vectors, (n, 3), to (n, 3, 3)."""
    z = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)
