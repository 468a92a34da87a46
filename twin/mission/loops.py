"""Loops: the arithmetic of guidance's control loops, compiled, without any memory of their own."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit

Array = NDArray[np.float64]


@jit
def pid(
    kp: float,
    ki: float,
    kd: float,
    error: float,
    rate: float,
    feedforward: float,
    low: float,
    high: float,
    period: float,
    zone: float,
    state: Array,
    slot: int,
) -> float:
    """One PID tick with the derivative on the measured rate; returns the clamped output.

    The integral of the error, limited to `zone`, is kept in state[slot] and stands still while
    the output is clamped and the error pushes further out.
    """
    output = feedforward + kp * error + ki * state[slot] - kd * rate
    clamped = min(max(output, low), high)
    if (output - clamped) * error * ki <= 0.0:
        state[slot] += period * min(max(error, -zone), zone)
    return clamped


@jit
def wrapped(angle: float) -> float:
    """`angle` [rad] in [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@jit
def compass(angle: float) -> float:
    """`angle` [rad] in [0, 2 pi), as headings are."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi))
