"""Transition: how the state of a current filter and its covariance change over a time step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.navigation.current.layout import CALIBRATION, DIVE, MODES, POSITION
from twin.navigation.current.modes import Passage, turns

Array = NDArray[np.float64]

ELSEWHERE = 1.0
"""[m/s] at which a position is lost while the motion is not known"""


def transition(
    gone: Passage, dt: float, through: Array | None, spread: Array, memory: float
) -> tuple[Array, Array]:
    """The matrix that carries a state over a time, and the covariance that is gained meanwhile.

    Args:
      gone: what the time does to the modes.
      dt: [s]
      through: north, east through the water [m/s], (2,); None: not known.
      spread: [m2/s2], (2, 2), of its error.
      memory: [s] over which that error lasts.

    Returns:
      Both (state, state).
    """
    count = len(gone.kept)
    size = MODES + 2 * count
    carry, noise = np.eye(size), np.zeros((size, size))
    blocks = MODES + 2 * np.arange(count)[:, None] + np.arange(2)
    rows, columns = blocks[:, :, None], blocks[:, None, :]
    carry[rows, columns] = turns(gone.kept)
    noise[rows, columns] = gone.noise[:, None, None] * np.eye(2)
    if through is None:
        noise[POSITION, POSITION] = (ELSEWHERE * dt) ** 2 * np.eye(2)
        return carry, noise
    carry[POSITION, MODES:] = turns(gone.displaced).transpose(1, 0, 2).reshape(2, -1)
    carry[POSITION, DIVE] = dt * np.eye(2)
    carry[POSITION, CALIBRATION] = dt * turns(np.array(complex(*through)))
    noise[MODES:, POSITION] = turns(gone.shared).reshape(-1, 2)
    noise[POSITION, MODES:] = noise[MODES:, POSITION].T
    # an error of first order adds up to 2 memory dt; that of a long step is its mean's
    alike = max(2.0 * memory, dt)
    noise[POSITION, POSITION] = gone.scattered.sum() * np.eye(2) + spread * dt * alike
    return carry, noise
