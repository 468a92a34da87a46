"""Smoother: velocities of a vehicle from camera poses and its inertial unit, with deviations.

Two Rauch-Tung-Striebel smoothers (1965). The first estimates the slowly changing rotation from the
vehicle's attitude sensor to the camera's attitude. The second has place, velocity and error of
the acceleration as its state; the accelerometer drives it, and camera places correct it. A pose
with an improbable innovation counts less, so that the innovation becomes just probable.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
GRAVITY = 9.80665
"""[m/s2]"""
IMPROBABLE = 16.27
"""[1] Squared innovation over its variance that one in 1000 exceeds, for three numbers"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """Camera poses of a vehicle, by picture, in an earth-fixed frame: north-east-down or turned
    about the vertical."""

    time: Array
    """[s] Rising, (n,)"""
    place: Array
    """[m] Centre of buoyancy, (n, 3)"""
    turn: Array
    """Matrices from body to earth axes, (n, 3, 3)"""
    covariance: Array
    """Of a small rotation [rad] in earth axes and the place [m], (n, 6, 6)"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """Deviations that the smoother assumes; ours, chosen on simulated missions."""

    attitude_offset: float = 0.2
    """[rad] First rotation between attitude sensor and camera"""
    attitude_walk: float = 0.02
    """[rad/sqrt(s)] Growth of this rotation"""
    acceleration: float = 0.08
    """[m/s2] Error of the acceleration between two samples of the log, which are interpolated"""
    acceleration_offset: float = 0.15
    """[m/s2] First error of the acceleration: bias, and gravity by a wrong attitude"""
    acceleration_walk: float = 0.015
    """[m/s2/sqrt(s)] Growth of this error"""
    own: float = 0.0
    """[m/s] Error of the observer's own velocity"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Smoothed:
    """Velocities over ground in body axes at the log's samples."""

    velocity: Array
    """[m/s] surge, sway and heave, (n, 3)"""
    deviation: Array
    """[m/s] Their standard deviations, (n, 3)"""
    turn: Array
    """Matrices from body to the frames' axes, (n, 3, 3)"""
    place: Array
    """[m] (n, 3)"""
    used: NDArray[np.bool_]
    """True for the pictures with a probable pose, (pictures,)"""


def smooth(
    time: Array, attitude: Array, force: Array, frames: Frames, settings: Settings | None = None
) -> Smoothed:
    """Smooth camera poses with a log's attitude and specific force.

    Args:
      time: [s] of the log's samples, (n,).
      attitude: [rad] roll, pitch and heading by the vehicle, (n, 3).
      force: [m/s2] specific force by the accelerometer, body axes, (n, 3).
    """
    its = settings or Settings()
    grid = np.unique(np.concatenate([time, frames.time]))
    at_log, at_frame = np.searchsorted(grid, time), np.searchsorted(grid, frames.time)
    given = CubicSpline(time, np.unwrap(attitude, axis=0))(np.clip(grid, time[0], time[-1]))
    given = Rotation.from_euler("ZYX", given[:, ::-1])
    step = np.diff(grid)
    there = np.zeros(len(grid), bool)
    there[at_frame] = True

    # rotation from the log's attitude to the camera's, in earth axes
    offset = np.zeros((len(grid), 3))
    offset[at_frame] = (Rotation.from_matrix(frames.turn) * given[at_frame].inv()).as_rotvec()
    noise = np.tile(np.eye(3), (len(grid), 1, 1))
    noise[at_frame] = frames.covariance[:, :3, :3]
    still = np.tile(np.eye(3), (len(step), 1, 1))
    turned, spread, likely = _both_ways(
        still, np.zeros((len(step), 3)), step[:, None, None] * its.attitude_walk**2 * np.eye(3),
        offset, noise, there, its.attitude_offset**2 * np.eye(3),
    )  # fmt: skip
    attitudes = Rotation.from_rotvec(turned) * given

    forced = Rotation.from_matrix(attitudes.as_matrix()[at_log]).apply(force)
    forced[:, 2] += GRAVITY
    spacing = float(np.median(np.diff(time)))
    middle = np.clip(grid[:-1] + 0.5 * step, time[0], time[-1])
    driving = CubicSpline(time, forced)(middle)
    place = np.zeros((len(grid), 3))
    place[at_frame], noise[at_frame] = frames.place, frames.covariance[:, 3:, 3:]
    move = np.zeros((len(step), 9, 9))
    push, grow = np.zeros((len(step), 9)), np.zeros((len(step), 9, 9))
    density = its.acceleration**2 * spacing
    for k in range(3):
        p, v, b = k, 3 + k, 6 + k
        move[:, p, p] = move[:, v, v] = move[:, b, b] = 1.0
        move[:, p, v] = move[:, v, b] = step
        move[:, p, b] = 0.5 * step**2
        push[:, p], push[:, v] = 0.5 * step**2 * driving[:, k], step * driving[:, k]
        grow[:, p, p], grow[:, v, v] = density * step**3 / 3.0, density * step
        grow[:, p, v] = grow[:, v, p] = density * step**2 / 2.0
        grow[:, b, b] = its.acceleration_walk**2 * step
    first = np.diag(np.repeat([1e4, 1.0, its.acceleration_offset**2], 3))
    state, cover, used = _both_ways(move, push, grow, place, noise, there, first)

    turn = attitudes.as_matrix()[at_log]
    world = state[at_log, 3:6]
    velocity = np.einsum("nji,nj->ni", turn, world)
    # the attitude's error turns the velocity: v_body changes by R^T [v x] theta
    cross = -np.cross(np.eye(3)[None], world[:, None]).swapaxes(1, 2)
    tilt = cross @ spread[at_log] @ cross.swapaxes(1, 2)
    total = turn.swapaxes(1, 2) @ (cover[at_log, 3:6, 3:6] + tilt) @ turn
    deviation = np.sqrt(np.diagonal(total, axis1=1, axis2=2) + its.own**2)
    return Smoothed(
        velocity=velocity, deviation=deviation, turn=turn, place=state[at_log, :3],
        used=(used & likely)[at_frame],
    )  # fmt: skip


@numba.njit(cache=True)
def _both_ways(
    move: Any, push: Any, grow: Any, seen: Any, noise: Any, there: Any, first: Any
) -> tuple[Any, Any, Any]:
    """Filter forwards and smooth backwards a linear system whose first numbers are measured.

    x[i+1] = move[i] x[i] + push[i] + w, cov(w) = grow[i]; seen[i] = x[i, :m] + r, cov(r) = noise[i]
    where `there`. The state before is 0 with covariance `first`.

    Returns:
      States (n, k), their covariances (n, k, k), and a mask of the probable measurements, (n,).
    """
    count, size, m = seen.shape[0], first.shape[0], seen.shape[1]
    x, p = np.zeros((count, size)), np.zeros((count, size, size))
    ahead_x, ahead_p = np.zeros((count, size)), np.zeros((count, size, size))
    used = np.zeros(count, np.bool_)
    now, cover = np.zeros(size), first.copy()
    for i in range(count):
        if i > 0:
            now = move[i - 1] @ now + push[i - 1]
            cover = move[i - 1] @ cover @ move[i - 1].T + grow[i - 1]
        ahead_x[i], ahead_p[i] = now, cover
        if there[i]:
            gap = seen[i] - now[:m]
            both = np.ascontiguousarray(cover[:m, :m]) + noise[i]
            excess = gap @ np.linalg.solve(both, gap) / IMPROBABLE
            used[i] = excess < 1.0
            inverse = np.linalg.inv(both * max(excess, 1.0))
            gain = np.ascontiguousarray(cover[:, :m]) @ inverse
            now = now + gain @ gap
            cover = cover - gain @ np.ascontiguousarray(cover[:m, :])
            cover = 0.5 * (cover + cover.T)
        x[i], p[i] = now, cover
    for i in range(count - 2, -1, -1):
        gain = np.linalg.solve(ahead_p[i + 1], move[i] @ p[i]).T
        x[i] += gain @ (x[i + 1] - ahead_x[i + 1])
        back = p[i] + gain @ (p[i + 1] - ahead_p[i + 1]) @ gain.T
        p[i] = 0.5 * (back + back.T)
    return x, p, used
