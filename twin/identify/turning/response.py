"""Response: the yaw rate and the roll of the lateral model under the inputs of a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit
from twin.identify.calibration import Calibration
from twin.identify.lateral import Lateral
from twin.identify.pitch import righting_arm
from twin.identify.turning.unknowns import channel_of
from twin.identify.turning.windows import Group

Array = NDArray[np.float64]


def yaw_rates(
    group: Group, lateral: Lateral, position: Array, yaw: float, roll_offset: float
) -> Array:
    """Yaw rate [rad/s] that the group's rolls and turning part give, (samples, windows).

    Args:
      position: of the turning part, as a linear model feels it.
      yaw: constant yaw moment [N m]. roll_offset: the roll sensor's zero [rad].
    """
    step, response = lateral.turned_by_roll(group.period)
    roll = np.sin(group.roll - roll_offset)
    inputs = np.stack([roll, group.slope, position, np.full_like(roll, yaw)], axis=-1)
    driven = 0.5 * (inputs[1:] + inputs[:-1]) @ response.T
    state = np.linalg.solve(np.eye(2) - step, response @ inputs[0].T).T
    return _march(step, np.ascontiguousarray(driven), np.ascontiguousarray(state), 1)


def rolls(group: Group, lateral: Lateral, position: Array) -> Array:
    """Roll [rad] that the battery's positions give, (samples, windows)."""
    step, response = lateral.rolled_by_part(group.period)
    driven = 0.5 * (position[1:] + position[:-1])[..., None] * response[:, 0]
    state = np.linalg.solve(np.eye(4) - step, response[:, :1] * position[0]).T
    return np.arctan(_march(step, driven, np.ascontiguousarray(state), 3))


@jit
def _march(step: Array, driven: Array, state: Array, which: int) -> Array:
    """One state of x(k + 1) = step x(k) + driven(k), (samples, windows)."""
    samples, windows, n = driven.shape
    out = np.empty((samples + 1, windows))
    x, y = np.empty(n), np.empty(n)
    for w in range(windows):
        x[:] = state[w]
        out[0, w] = x[which]
        for k in range(samples):
            for i in range(n):
                y[i] = driven[k, w, i]
                for j in range(n):
                    y[i] += step[i, j] * x[j]
            x[:] = y
            out[k + 1, w] = x[which]
    return out


def felt(calibration: Calibration, position: Array) -> Array:
    """The position as the linear model feels it: of a hinge, the rotation whose small rolls would
    be the tangent of the true ones, (a + b cos x) tan(roll) = -b sin x; of a rudder, itself."""
    if channel_of(calibration) != "rotation":
        return position
    vehicle = calibration.vehicle
    battery = vehicle.battery.mass * vehicle.battery.eccentricity
    whole = vehicle.mass * righting_arm(calibration)
    return whole * np.sin(position) / (whole - battery * (1.0 - np.cos(position)))
