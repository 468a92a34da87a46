"""Compass deviation: the error of the heading by the vehicle's own iron, learned from its turns.

A hard iron b (body axes, in units of the horizontal field) and a soft iron D, E make a levelled
compass show too little by

    a = b_x cos(pitch) sin(psi) + b_y (cos(roll) cos(psi) + sin(pitch) sin(roll) sin(psi))
        + b_z (sin(pitch) cos(roll) sin(psi) - sin(roll) cos(psi)) + D sin(2 psi) + E cos(2 psi),

to first order. It depends on the heading; the heading by the gyros alone does not. Their difference
is a, plus a constant, plus what bias and scale of the gyros add up to: in a turn it changes by the
change of a. A Kalman filter holds all of these; measured pitch tells the bias of the pitch gyro,
which a roll in a turn brings into the heading. The mean of a over all headings, the compass'
offset, cannot be told from the constant: only fixes tell it (`twin.navigation.current`).

What a turn teaches holds for the way before it, too: the navigator keeps how its position depends
on each of the five numbers.
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
"""Numbers of the deviation: b_x, b_y, b_z, D, E [rad]"""
ANGLE, YAW, PITCH, WANDER, SCALE = range(IRON, IRON + 5)
"""Behind them: offset of the gyros' heading [rad]; biases that stay of the yaw and the pitch gyro,
and that of the yaw gyro that comes and goes [rad/s]; error of their scale [1]"""
STATES = IRON + 5
ARRAYS = ("mean", "covariance", "sums", "passed", "before")
"""Arrays of a filter's state, by name"""
HARD, SOFT = 0.75 * DEG, 0.3 * DEG
"""[rad] standard deviations of a calibrated compass: about 1 degree or less (OceanGliders'
procedure for depth-averaged currents)"""
TURN_ON = 0.1 * DEG
"""[rad/s] of the gyros' bias before anything is known"""
INSTABILITY, INSTABILITY_TIME = 13.0 * DEG / 3600.0, 100.0
"""[rad/s], [s] of the bias that comes and goes: MEMS gyros with a floor of 8 degree an hour"""
BIAS_WALK = 1e-4 * DEG
"""[rad/s/sqrt(s)]"""
ANGLE_WALK = 0.01 * DEG
"""[rad/sqrt(s)] twice that of their data sheets, for what sampled rates miss"""
SCALE_ERROR = 2e-3
"""[1] of a gyro, and of its axis that is not the vehicle's"""
NOISE = 1.0 * DEG
"""[rad] of the compass' heading, mean over `STEP_S`: 0.3 degree, by what dives and climbs make of
soft iron, battery and tilt, that last for two minutes, as if each mean had an error of its own"""
PITCH_NOISE = 0.4 * DEG
"""[rad] of the change of the measured pitch in that time, with what a gyro off its axis sees"""
STEP_S = 20.0
"""[s] between updates"""


def sensitivities(roll: float, pitch: float, heading: float) -> Array:
    """Change of the true heading less the shown one with each of the five numbers, (5,) [1].

    Args:
      roll, pitch, heading: as they are measured [rad].
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
    """The deviation of one vehicle's compass, sample by sample."""

    def __init__(self, period: float):
        """Begin before the first sample; `period` [s] between samples."""
        self.period = period
        self._samples = max(1, round(STEP_S / period))
        self.reset()

    def reset(self) -> None:
        """Begin before the first sample again, with a compass as it is usual."""
        self._mean = np.zeros(STATES)
        deviations = [HARD] * 3 + [SOFT] * 2 + [math.pi, TURN_ON, TURN_ON, INSTABILITY, SCALE_ERROR]
        self._covariance = np.diag(np.square(deviations))
        # heading and pitch, and their rates by the gyros
        self._before = np.full(4, math.nan)
        self._parted = self._turned = 0.0  # gyros less compass, and turned by the gyros, so far
        self._begin()

    def _begin(self) -> None:
        """Begin the next mean."""
        self._count = 0
        self._from = self._turned
        # sums over a mean: sensitivities to the iron, `_parted`, `_turned`, and the two effects
        # of gyro biases that `_passed` begins with
        self._sums = np.zeros(IRON + 4)
        # so far: what unit biases of both gyros add to the heading [s]; the gyros' pitch less the
        # measured one [rad], and what the unit biases add to it [s]
        self._passed = np.zeros(5)

    @property
    def iron(self) -> Array:
        """b_x, b_y, b_z, D, E as they are known [rad], (5,)."""
        return self._mean[:IRON].copy()

    @property
    def iron_deviation(self) -> Array:
        """Standard deviation of each [rad], (5,)."""
        return np.sqrt(np.diag(self._covariance)[:IRON])

    def step(self, roll: float, pitch: float, heading: float, rates: Array) -> Array:
        """Take a sample; the `sensitivities` of it.

        Args:
          roll, pitch, heading: as they are measured [rad].
          rates: pitch and yaw rate that the gyros measure [rad/s], (2,); NaN: there are none, and
            nothing is learned.
        """
        found = sensitivities(roll, pitch, heading)
        s_roll, c_roll, c_pitch = math.sin(roll), math.cos(roll), math.cos(pitch)
        level = c_pitch / max(c_pitch**2, LEAST_COSINE**2)
        by_pitch, by_yaw = s_roll * level, c_roll * level
        q, r = rates.tolist()
        seen = np.array([heading, pitch, by_pitch * q + by_yaw * r, q * c_roll - r * s_roll])
        if not math.isfinite(seen[2] + self._before[2]):  # where the gyros' heading is, is lost
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
        """Pass the time of a mean, and compare gyros with compass and pitch."""
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
        """Arrays by name on which the next step depends."""
        own = np.array([self._parted, self._turned, self._from, self._count])
        return {name: getattr(self, f"_{name}").copy() for name in ARRAYS} | {"own": own}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from where `state` was called."""
        for name in ARRAYS:
            setattr(self, f"_{name}", np.array(state[name], np.float64))
        self._parted, self._turned, self._from, count = (float(x) for x in state["own"])
        self._count = round(count)
