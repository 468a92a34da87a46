"""Propelled filter: a Kalman filter of a velocity with each method as a measurement.

The velocity differs from the constant one, 0 where the vehicle stands, by d. Thrust, drag and
inertia take d back to 0. Each method's error e has a memory of its own. From sample to sample,

    d' = a d + w,   e_i' = b_i e_i + w_i,   m_i = d + e_i.

Factors and covariances of the noise are those of held-out training runs (Kalman 1960).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twin.navigation.dead_reckoning import Array

LONGEST, ALONE, READING = 0.995, 0.1, 0.01
"""[1] Largest factor of a sample, three minutes of memory; [1] part of each covariance that is
diagonal, since few runs correlate by chance; [m/s] error of a measurement without memory"""


class VelocityFilter(NamedTuple):
    """Filter of the velocity and of the methods' errors, the state, (1 + methods,)."""

    keep: Array
    """[1] Factors a and b_i"""
    start: Array
    """[m2/s2] Covariance of the state before the first measurement"""
    noise: Array
    """[m2/s2] Covariance of w and w_i"""

    @classmethod
    def fit(cls, wanted: Sequence[Array], found: Sequence[Array]) -> VelocityFilter:
        """Fit to runs with a measured velocity, d of each run in `wanted`, (time,), NaN without.

        Args:
          found: m_i of each run, (methods, time); all [m/s].
        """
        states = [np.vstack([d, m - d]) for d, m in zip(wanted, found, strict=True)]
        old = np.concatenate([one[:, :-1] for one in states], axis=1)
        new = np.concatenate([one[:, 1:] for one in states], axis=1)
        both = np.isfinite(old[0] + new[0])
        old, new = old[:, both], new[:, both]
        keep = (old * new).sum(axis=1) / np.maximum((old * old).sum(axis=1), 1e-12)
        keep = np.clip(keep, 0.0, LONGEST)
        return cls(keep, _covariance(old), _covariance(new - keep[:, None] * old))

    def velocity(self, found: Array) -> Array:
        """Estimate d [m/s] of a run, (time,), each sample by the m_i up to it, (methods, time)."""
        count = len(found)
        sees = np.hstack([np.ones((count, 1)), np.eye(count)])
        state, spread = np.zeros(1 + count), self.start
        velocity = np.empty(found.shape[1])
        for k, measured in enumerate(found.T):
            seen = sees @ spread
            gain = np.linalg.solve(seen @ sees.T + READING**2 * np.eye(count), seen).T
            state = state + gain @ (measured - sees @ state)
            velocity[k], state = state[0], self.keep * state
            spread = self.keep[:, None] * (spread - gain @ seen) * self.keep + self.noise
        return velocity


def _covariance(states: Array) -> Array:
    """Covariance about zero, (1 + methods, 1 + methods); errors know nothing of the velocity."""
    found = states @ states.T / max(states.shape[1], 1)
    found = (1.0 - ALONE) * found + ALONE * np.diag(np.diag(found))
    found[0, 1:] = found[1:, 0] = 0.0
    return np.asarray(found)
