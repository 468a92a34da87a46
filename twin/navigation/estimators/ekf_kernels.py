"""EKF kernels: the model of a glider's motion and the filter's recursion, compiled."""

from __future__ import annotations

import math

import numpy as np

from twin.compiled import jit
from twin.fossen.forces import ForceParameters, damping_wrench
from twin.navigation.dead_reckoning import Array

STATES = 5
SURGE, SWAY, HEAVE, DEPTH, NET_ERROR = range(STATES)
SUBSTEPS = 2
"""Runge-Kutta steps per sample: heave settles within 0.6 s at 0.5 m/s, samples are 0.5 s apart."""


# Plain loops below: they compile several times faster than array expressions and BLAS calls, and
# at five rows they run as fast.
@jit
def _rates(  # type: ignore[no-untyped-def]
    p: ForceParameters, inverse: Array, inertia: Array, coupling: Array, x: Array, given: Array
):
    """dx/dt (5,) for inputs (down axis 3, rates 3, net mass)."""
    nu = np.empty(6)
    momentum = np.zeros(3)
    for i in range(3):
        nu[i] = x[i]
        nu[i + 3] = given[i + 3]
        for j in range(3):
            momentum[i] += inertia[i, j] * x[j] + coupling[i, j] * given[j + 3]
    force = damping_wrench(p, nu, p.reference_density)
    weight = p.gravity * (given[6] + x[4])
    out = np.zeros(5)
    for j in range(3):
        one, two = (j + 1) % 3, (j + 2) % 3
        turning = momentum[one] * nu[3 + two] - momentum[two] * nu[3 + one]
        total = force[j] + weight * given[j] + turning
        for i in range(3):
            out[i] += inverse[i, j] * total
        out[3] += given[j] * x[j]
    return out


@jit
def _between(start: Array, end: Array, part: float) -> Array:
    """start + part (end - start), element by element."""
    out = np.empty(start.size)
    for i in range(start.size):
        out[i] = start[i] + part * (end[i] - start[i])
    return out


@jit
def _moved(x: Array, rate: Array, step: float) -> Array:
    """x + step rate, element by element."""
    out = np.empty(x.size)
    for i in range(x.size):
        out[i] = x[i] + step * rate[i]
    return out


@jit
def _predict(  # type: ignore[no-untyped-def]
    p: ForceParameters,
    inverse: Array,
    inertia: Array,
    coupling: Array,
    x: Array,
    before: Array,
    after: Array,
    period: float,
):
    """State after one sample; inputs change linearly between two samples."""
    h = period / SUBSTEPS
    for step in range(SUBSTEPS):
        start = _between(before, after, step / SUBSTEPS)
        middle = _between(before, after, (step + 0.5) / SUBSTEPS)
        end = _between(before, after, (step + 1.0) / SUBSTEPS)
        k1 = _rates(p, inverse, inertia, coupling, x, start)
        k2 = _rates(p, inverse, inertia, coupling, _moved(x, k1, 0.5 * h), middle)
        k3 = _rates(p, inverse, inertia, coupling, _moved(x, k2, 0.5 * h), middle)
        k4 = _rates(p, inverse, inertia, coupling, _moved(x, k3, h), end)
        x = x.copy()
        for i in range(x.size):
            x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
    return x


@jit
def _congruent(a: Array, matrix: Array) -> Array:
    """A M A^T."""
    n = a.shape[0]
    half = np.zeros((n, n))
    out = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            for j in range(n):
                half[i, j] += a[i, k] * matrix[k, j]
    for i in range(n):
        for j in range(n):
            for k in range(n):
                out[i, j] += half[i, k] * a[j, k]
    return out


@jit
def filtered(  # type: ignore[no-untyped-def]
    p: ForceParameters,
    inverse: Array,
    inertia: Array,
    coupling: Array,
    inputs: Array,
    depth: Array,
    process: Array,
    depth_variance: float,
    period: float,
    carried: Array,
):
    """Predict and update over all samples; the Jacobian is by one-sided differences."""
    n = depth.size
    states = np.zeros((n, 5))
    covariances = np.zeros((n, 5, 5))
    innovations = np.zeros(n)
    expected = np.zeros(n)
    nudge = 1e-5
    jacobian = np.empty((5, 5))
    keep = np.zeros((5, 5))
    before = carried[:7].copy()
    x = carried[7:12].copy()
    cov = carried[12:37].copy().reshape((5, 5))
    for k in range(n):
        after = inputs[k]
        if not math.isnan(before[0]):
            ahead = _predict(p, inverse, inertia, coupling, x, before, after, period)
            for j in range(5):
                nudged = x.copy()
                nudged[j] += nudge
                there = _predict(p, inverse, inertia, coupling, nudged, before, after, period)
                for i in range(5):
                    jacobian[i, j] = (there[i] - ahead[i]) / nudge
            x = ahead
            cov = _congruent(jacobian, cov)
            for i in range(5):
                cov[i, i] += process[i] * period
        before = after
        innovation = depth[k] - x[3]
        variance = cov[3, 3] + depth_variance
        # Joseph form keeps the covariance symmetric and positive.
        for i in range(5):
            for j in range(5):
                keep[i, j] = 1.0 if i == j else 0.0
            gain = cov[i, 3] / variance
            keep[i, 3] -= gain
            x[i] += gain * innovation
        cov = _congruent(keep, cov)
        for i in range(5):
            for j in range(5):
                # The gain of row i is the identity's column 3 less keep's.
                gain_i = (1.0 if i == 3 else 0.0) - keep[i, 3]
                gain_j = (1.0 if j == 3 else 0.0) - keep[j, 3]
                cov[i, j] += depth_variance * gain_i * gain_j
                covariances[k, i, j] = cov[i, j]
            states[k, i] = x[i]
        innovations[k] = innovation
        expected[k] = np.sqrt(variance)
    # number by number: numba takes seconds to compile what puts one array into another
    for i in range(7):
        carried[i] = before[i]
    for i in range(5):
        carried[7 + i] = x[i]
        for j in range(5):
            carried[12 + 5 * i + j] = cov[i, j]
    return states, covariances, innovations, expected
