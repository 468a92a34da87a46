"""Compass deviation: heading error by the vehicle's own iron, estimated from turns and the gyros.

With a hard iron b (body axes, in units of the horizontal field) and a soft iron D, E, a levelled
compass shows the heading too small by

    a = b_x cos(pitch) sin(psi) + b_y (cos(roll) cos(psi) + sin(pitch) sin(roll) sin(psi))
        + b_z (sin(pitch) cos(roll) sin(psi) - sin(roll) cos(psi)) + D sin(2 psi) + E cos(2 psi),

to first order. This error depends on the heading; the heading integrated from the gyros lacks it.
Their difference is a, plus a constant, plus the effect of the gyros' bias and scale: in a turn it
changes like a. A Kalman filter estimates all of these. Measured pitch gives the bias of the
pitch gyro, which enters the heading when the vehicle rolls in a turn. Only fixes give the mean of a
over all headings, the compass' offset (`twin.navigation.current`).

An estimate after a turn also corrects the track before the turn: the navigator keeps the position's
sensitivity to the five iron parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.navigation.dead_reckoning import LEAST_COSINE
from twin.numbers import Array

DEG = math.pi / 180.0
IRON = 5
"""Number of iron parameters: b_x, b_y, b_z, D, E [rad]"""
ANGLE, YAW, PITCH, WANDER, SCALE = range(IRON, IRON + 5)
"""Indices of other states. ANGLE: [rad] offset of the gyros' heading. YAW, PITCH: [rad/s] biases of
these gyros. WANDER: [rad/s] varying bias of the yaw gyro. SCALE: [1] error of the gyros' scale"""
STATES = IRON + 5
ARRAYS = ("mean", "covariance", "sums", "passed", "before")
"""Arrays of a filter's state, by name"""
HARD, SOFT = 0.75 * DEG, 0.3 * DEG
"""[rad] Prior standard deviations of hard and soft iron after a calibration: about 1 degree or less
(OceanGliders' procedure for depth-averaged currents)"""
TURN_ON = 0.1 * DEG
"""[rad/s] Prior standard deviation of the gyros' constant bias"""
INSTABILITY, INSTABILITY_TIME = 13.0 * DEG / 3600.0, 100.0
"""Varying bias. INSTABILITY: [rad/s] standard deviation; MEMS: 8 degree/h. INSTABILITY_TIME: [s]"""
BIAS_WALK = 1e-4 * DEG
"""[rad/s/sqrt(s)] Random walk of the constant biases"""
ANGLE_WALK = 0.01 * DEG
"""[rad/sqrt(s)] Random walk of the angle: twice the data sheets' value, for sampling errors"""
SCALE_ERROR = 2e-3
"""[1] Prior standard deviation of a gyro's scale, with its misalignment to the vehicle's axes"""
NOISE = 1.0 * DEG
"""[rad] Standard deviation of the compass heading's mean over `STEP_S`. The error is 0.3 degree
(soft iron, battery, tilt) but lasts two minutes; this value treats the means as independent."""
PITCH_NOISE = 0.4 * DEG
"""[rad] Standard deviation of the pitch change over `STEP_S`, with the gyro's misalignment"""
STEP_S = 20.0
"""[s] Time between updates"""


def sensitivities(roll: float, pitch: float, heading: float) -> Array:
    """Sensitivities of true minus compass heading to the five iron parameters, (5,) [1].

    Args:
      roll, pitch, heading: measured [rad].
    """
    s_roll, c_roll = math.sin(roll), math.cos(roll)
    s_pitch, c_pitch = math.sin(pitch), math.cos(pitch)
    s_head, c_head = math.sin(heading), math.cos(heading)
    return np.array(
        [
            c_pitch * s_head,
            c_roll * c_head + s_pitch * s_roll * s_head,
            s_pitch * c_roll * s_head - s_roll * c_head,
            2.0 * s_head * c_head,
            c_head * c_head - s_head * s_head,
        ]
    )


class CompassDeviation:
    """Filter for one compass' deviation, stepped sample by sample."""

    def __init__(self, period: float):
        """Create the filter; `period` [s] is the time between samples."""
        self.period = period
        self._samples = max(1, round(STEP_S / period))
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample, with the prior of a calibrated compass."""
        self._mean = np.zeros(STATES)
        deviations = [HARD] * 3 + [SOFT] * 2 + [math.pi, TURN_ON, TURN_ON, INSTABILITY, SCALE_ERROR]
        self._covariance = np.diag(np.square(deviations))
        # heading and pitch, and their rates by the gyros
        self._before = np.full(4, math.nan)
        self._parted = self._turned = 0.0  # gyros minus compass, and turn by the gyros
        self._begin()

    def _begin(self) -> None:
        """Start the next mean over `STEP_S`."""
        self._count = 0
        self._from = self._turned
        # sums over a mean: sensitivities to the iron, `_parted`, `_turned`, and the two effects
        # of gyro biases at the start of `_passed`
        self._sums = np.zeros(IRON + 4)
        # since the start of the mean: heading added by unit biases of both gyros [s]; pitch by the
        # gyros minus measured pitch [rad], and pitch added by the unit biases [s]
        self._passed = np.zeros(5)

    @property
    def iron(self) -> Array:
        """Estimates of b_x, b_y, b_z, D, E [rad], (5,)."""
        return self._mean[:IRON].copy()

    @property
    def iron_deviation(self) -> Array:
        """Standard deviation of each iron parameter [rad], (5,)."""
        return np.sqrt(np.diag(self._covariance)[:IRON])

    def step(self, roll: float, pitch: float, heading: float, rates: Array) -> Array:
        """Process a sample and return its `sensitivities`.

        Args:
          roll, pitch, heading: measured [rad].
          rates: pitch and yaw rate by the gyros [rad/s], (2,); NaN without gyros, which leaves the
            estimate unchanged.
        """
        found = sensitivities(roll, pitch, heading)
        s_roll, c_roll, c_pitch = math.sin(roll), math.cos(roll), math.cos(pitch)
        level = c_pitch / max(c_pitch**2, LEAST_COSINE**2)
        by_pitch, by_yaw = s_roll * level, c_roll * level
        q, r = rates.tolist()
        seen = np.array([heading, pitch, by_pitch * q + by_yaw * r, q * c_roll - r * s_roll])
        if not math.isfinite(seen[2] + self._before[2]):  # the gyros' heading is lost
            self._covariance[ANGLE, :] = self._covariance[:, ANGLE] = 0.0
            self._covariance[ANGLE, ANGLE] = math.pi**2
            self._begin()
        else:
            turned, raised = (0.5 * self.period * (seen + self._before)[2:]).tolist()
            self._parted += turned - math.remainder(heading - self._before[0], 2.0 * math.pi)
            self._turned += turned
            self._passed += (
                self.period * by_yaw,
                self.period * by_pitch,
                raised - (pitch - self._before[1]),
                -self.period * s_roll,
                self.period * c_roll,
            )
            self._count += 1
            self._sums[:IRON] += found
            self._sums[IRON:] += self._parted, self._turned, *self._passed[:2]
            if self._count == self._samples:
                self._update()
                self._begin()
        self._before = seen
        return found

    def _update(self) -> None:
        """Propagate the filter over a mean; update with compass heading and measured pitch."""
        count = self._count
        time, turned = count * self.period, self._turned - self._from
        yawed, pitched, off, off_by_yaw, off_by_pitch = self._passed.tolist()
        kept = math.exp(-time / INSTABILITY_TIME)
        carry = np.eye(STATES)
        carry[WANDER, WANDER] = kept
        carry[ANGLE, [YAW, PITCH, SCALE]] = yawed, pitched, turned
        carry[ANGLE, WANDER] = (1.0 - kept) * INSTABILITY_TIME
        gained = INSTABILITY**2 * (1.0 - kept**2)
        noise = np.zeros((STATES, STATES))
        noise[WANDER, WANDER] = gained
        noise[WANDER, ANGLE] = noise[ANGLE, WANDER] = 0.5 * time * gained
        noise[ANGLE, ANGLE] = ANGLE_WALK**2 * time + time**2 * gained / 3.0
        noise[YAW, YAW] = noise[PITCH, PITCH] = BIAS_WALK**2 * time
        self._mean = carry @ self._mean
        self._covariance = carry @ self._covariance @ carry.T + noise
        means = self._sums / count
        observed = np.zeros(STATES)
        observed[:IRON] = means[:IRON]
        observed[ANGLE] = 1.0
        observed[SCALE] = means[IRON + 1] - self._turned
        observed[[YAW, PITCH]] = means[IRON + 2] - yawed, means[IRON + 3] - pitched
        observed[WANDER] = observed[YAW]
        self._observe(observed, means[IRON], NOISE)
        observed = np.zeros(STATES)
        observed[[YAW, WANDER, PITCH]] = off_by_yaw, off_by_yaw, off_by_pitch
        self._observe(observed, off, PITCH_NOISE)

    def _observe(self, observed: Array, value: float, deviation: float) -> None:
        cross = self._covariance @ observed
        gain = cross / (observed @ cross + deviation**2)
        self._mean = self._mean + gain * (value - observed @ self._mean)
        left = np.eye(STATES) - np.outer(gain, observed)
        covariance = left @ self._covariance @ left.T
        self._covariance = covariance + deviation**2 * np.outer(gain, gain)

    def state(self) -> dict[str, NDArray[Any]]:
        """State as arrays by name, for `restore`."""
        own = np.array([self._parted, self._turned, self._from, self._count])
        return {name: getattr(self, f"_{name}").copy() for name in ARRAYS} | {"own": own}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from the state that `state` returned."""
        for name in ARRAYS:
            setattr(self, f"_{name}", np.array(state[name], np.float64))
        self._parted, self._turned, self._from, count = (float(x) for x in state["own"])
        self._count = round(count)
