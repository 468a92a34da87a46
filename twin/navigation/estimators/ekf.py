"""EKF: extended Kalman filter of a glider's velocity, on the nominal equations of motion.

State (surge, sway, heave [m/s], depth [m], error of the net buoyancy mass [kg]). Prediction
integrates the momentum equation of the nominal vehicle (Fossen 2011, chapter 8; the coefficient
forces are the Fossen model's own) with measured attitude, rates and pump as known inputs,

    (m + M_A) dv/dt = P x omega + W(net mass, attitude) + F(v, omega),
                  P = (m + M_A) v + M_vw omega,

and the depth by the vertical row of the kinematics. The update is the measured depth. Angular
accelerations are left out: their coupling is below 1e-3 m/s2, within the process noise. The water's
velocity is not in the state: sensors that move with the water cannot observe it.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit
from twin.compiled.elementary import cross, dot, scalar
from twin.errors import InputError
from twin.fossen.equations import skew
from twin.fossen.forces import law_wrench
from twin.fossen.terms import rows_times, sum3
from twin.navigation.dead_reckoning import (
    RESTING_WINDOW_S,
    SHALLOW_DEPTH,
    SURFACE_DEPTH,
    Array,
    Mask,
    Signals,
    afloat,
    finite_channel,
    values_of,
)
from twin.navigation.estimators.base import (
    BodyVelocity,
    Estimate,
    Recent,
    State,
)
from twin.navigation.estimators.flight import GlideModel
from twin.vehicle.laws import LAWS
from twin.vehicle.steady_motion import net_mass
from twin.vehicle.vehicle import Vehicle

Matrix = tuple[float, ...]
"""(3, 3), row by row"""
STATES = 5
SURGE, SWAY, HEAVE, DEPTH, NET_ERROR = range(STATES)
SUBSTEPS = 2
"""Runge-Kutta steps per sample: heave settles within 0.6 s at 0.5 m/s; samples are 0.5 s apart."""
NUDGE = 1e-5
"""Step of the finite differences of the Jacobian."""
INPUTS = (
    "measured_depth", "measured_roll", "measured_pitch", "measured_roll_rate",
    "measured_pitch_rate", "measured_yaw_rate", "measured_pump",
)  # fmt: skip
"""Channels that the filter reads"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EkfNoise:
    """Standard deviations of the filter's noise, for coefficients that are 10 % uncertain."""

    acceleration: float = 2e-3
    """[m/s2/sqrt(Hz)] Acceleration along each axis: errors of force law and measured inputs."""
    net_mass: float = 1.2e-2
    """[kg/sqrt(s)] Drift of the net mass's error: stratification, compressibility and wrong drag.
    An error from drag changes sign between dive and climb; the drift must allow for that."""
    initial_net_mass: float = 0.03
    """[kg] Ballasting error at the start: 20 g is usual."""
    initial_velocity: float = 0.05
    """[m/s] Velocity along each axis at the start: the mission starts from rest."""
    depth: float = 0.01
    """[m] Depth sample: noise and quantisation of the transducer."""
    kinematic: float = 5e-4
    """[m/sqrt(s)] Drift of integrated vertical velocity from depth: attitude errors, waves."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"EKF {field.name} noise is {value!r}: it must be above 0")


class EkfRun(NamedTuple):
    """States and covariances after each update, and the innovations."""

    states: Array
    """(time, 5)"""
    covariances: Array
    """(time, 5, 5)"""
    innovations: Array
    """[m] measured minus predicted depth, (time,)"""
    innovation_sd: Array
    """[m] Standard deviation of the innovation by the filter, (time,)"""


class EkfModel(NamedTuple):
    """Vehicle's equations and noise, in the form that compiled code takes; matrices row by row."""

    law: int
    """Code of the type of hull law"""
    law_values: Array
    density: float
    """[kg/m3] Reference density"""
    gravity: float
    """[m/s2]"""
    inverse: Matrix
    """[1/kg] Inverse of the inertia"""
    inertia: Matrix
    """[kg]"""
    coupling: Matrix
    """[kg m] M_vw: momentum per body rate, with the moving masses in neutral position"""
    process: Array
    """Process variances per second, (5,)"""
    depth_variance: float
    """[m2]"""


class Ekf(GlideModel):
    """Kalman filter with the nominal parameters; `step` detects floating by the last depths."""

    kind = "ekf"
    title = "EKF, dynamic model"
    summary = (
        "extended Kalman filter on the nominal momentum equations with measured attitude, rates "
        "and pump, updated with depth; estimates the error of the net buoyancy on the way"
    )
    colour = "sky"
    channels = (
        *("measured_depth", "measured_roll", "measured_pitch", "measured_heading"),
        *("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate"),
        *("measured_pump", "measured_shift", "measured_rotation"),
    )

    def __init__(self, vehicle: Vehicle, period: float, noise: EkfNoise | None = None):
        """Create the estimator; see `VelocityEstimator`."""
        super().__init__(vehicle, period)
        self.noise = EkfNoise() if noise is None else noise
        self.recent = self._memory = Recent(
            ("measured_depth",), max(2, round(RESTING_WINDOW_S / period) + 2)
        )
        self.reset()

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """Reason if the vehicle is no glider with one moving mass; empty otherwise."""
        why = super().unsuited(vehicle)
        if not why and len(vehicle.masses) != 1:
            why = f"vehicle {vehicle.name!r} has {len(vehicle.masses)} moving masses, not one"
        return why

    def reset(self) -> None:
        """See `VelocityEstimator`."""
        super().reset()
        self._carried = np.zeros(0)

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`."""
        self.recent.add(sample)
        wrong = " of the sample is not finite: the EKF needs it"
        given = values_of(sample, INPUTS, ", which the EKF reads", wrong)
        rows = np.array(given)[:, None]
        depth = rows[0]
        still = depth < SURFACE_DEPTH
        if depth[0] < SHALLOW_DEPTH and self.recent.count > 1:
            still = afloat(self.recent.signals()["measured_depth"], self.period)[-1:]
        if not self._carried.size:
            self._carried = self._begin(depth[0])
        run = self._go_on(rows, still, self._carried)
        surge, sway, heave = run.states[0, :3].tolist()
        covariance = run.covariances[0, :3, :3]
        return BodyVelocity(surge=surge, sway=sway, heave=heave, covariance=covariance)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        run = self.run(signals)
        return Estimate(
            surge=run.states[:, SURGE],
            sway=run.states[:, SWAY],
            surge_sd=np.sqrt(run.covariances[:, SURGE, SURGE]),
            sway_sd=np.sqrt(run.covariances[:, SWAY, SWAY]),
        )

    def run(self, signals: Signals) -> EkfRun:
        """Filter one whole mission."""
        rows = np.stack([finite_channel(signals, name) for name in INPUTS])
        return self._go_on(rows, afloat(rows[0], self.period), self._begin(rows[0, 0]))

    def _begin(self, depth: float) -> Array:
        """Initial numbers that are carried from sample to sample, (37,).

        They are the inputs of the previous sample (7), NaN before the first, the state (5) and the
        covariance (25).
        """
        q = self.noise
        first = np.array([q.initial_velocity**2] * 3 + [q.depth**2, q.initial_net_mass**2])
        return np.concatenate(
            [np.full(7, np.nan), [0.0] * DEPTH, [depth, 0.0], np.diag(first).ravel()]
        )

    def _go_on(self, rows: Array, still: Mask, carried: Array) -> EkfRun:
        """Filter rows of `INPUTS` (7, time); `carried` is updated in place."""
        depth, roll, pitch, *rates, pump = rows
        roll, pitch = np.deg2rad(roll), np.deg2rad(pitch)
        # Afloat, the hull emerges until buoyancy and weight balance: the net mass is 0. A pressure
        # gauge with an error of a metre cannot measure how far the hull emerges.
        net = np.where(still, 0.0, net_mass(self.vehicle, pump, np.maximum(depth, 0.0)))
        down = (-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll))
        inputs = np.stack([*down, *rates, net], axis=1)
        return EkfRun(*_filtered(self.model, inputs, depth, self.period, carried))

    def state(self) -> dict[str, NDArray[Any]]:
        """See `VelocityEstimator`."""
        return {**super().state(), "carried": self._carried.copy()}

    def restore(self, state: State) -> None:
        """See `VelocityEstimator`."""
        super().restore(state)
        self._carried = np.array(state["carried"], np.float64)

    @functools.cached_property
    def model(self) -> EkfModel:
        """Vehicle's equations and noise for the compiled code."""
        q, vehicle = self.noise, self.vehicle
        inertia = vehicle.mass * np.eye(3) + vehicle.added_mass[:3, :3]
        moment = vehicle.static_mass * vehicle.static_cg
        for moving in vehicle.masses:
            moment = moment + moving.mass * moving.position(0.0, 0.0)
        coupling = vehicle.added_mass[:3, 3:] - skew(moment)
        matrices = np.linalg.inv(inertia), inertia, coupling
        inverse, whole, moments = (tuple(one.ravel().tolist()) for one in matrices)
        return EkfModel(
            law=LAWS.code(vehicle.law.kind),
            law_values=np.array(vehicle.law.values(), np.float64),
            density=float(vehicle.reference_density),
            gravity=float(vehicle.gravity),
            inverse=inverse,
            inertia=whole,
            coupling=moments,
            process=np.array([q.acceleration**2] * 3 + [q.kinematic**2, q.net_mass**2]),
            depth_variance=q.depth**2,
        )


# The state and the inputs are tuples: arrays would be allocated forty times a sample.
@scalar
def _rates(model, x, given):  # type: ignore[no-untyped-def]
    """dx/dt, 5 numbers, for inputs (down axis 3, rates 3, net mass)."""
    v, w, down = x[:3], given[3:6], given[:3]
    momentum = sum3(rows_times(model.inertia, v), rows_times(model.coupling, w))
    # at its reference density a law's coefficients count as they are
    force = law_wrench(model.law, model.law_values, model.density, *v, *w)
    weight, turning = model.gravity * (given[6] + x[4]), cross(momentum, w)
    total = (
        force[0] + weight * down[0] + turning[0],
        force[1] + weight * down[1] + turning[1],
        force[2] + weight * down[2] + turning[2],
    )
    ax, ay, az = rows_times(model.inverse, total)
    return ax, ay, az, dot(down, v), 0.0


@scalar
def _moved(x, rate, step):  # type: ignore[no-untyped-def]
    """x + step rate, of 5 numbers."""
    return (
        x[0] + step * rate[0], x[1] + step * rate[1], x[2] + step * rate[2],
        x[3] + step * rate[3], x[4] + step * rate[4],
    )  # fmt: skip


@scalar
def _between(before, after, part):  # type: ignore[no-untyped-def]
    """Inputs, 7 numbers, at a part of the time from one sample to the next."""
    return (
        before[0] + part * (after[0] - before[0]), before[1] + part * (after[1] - before[1]),
        before[2] + part * (after[2] - before[2]), before[3] + part * (after[3] - before[3]),
        before[4] + part * (after[4] - before[4]), before[5] + part * (after[5] - before[5]),
        before[6] + part * (after[6] - before[6]),
    )  # fmt: skip


@jit
def _predict(model, x, before, after, period):  # type: ignore[no-untyped-def]
    """State one sample later; inputs change linearly between two samples."""
    h = period / SUBSTEPS
    for step in range(SUBSTEPS):
        middle = _between(before, after, (step + 0.5) / SUBSTEPS)
        k1 = _rates(model, x, _between(before, after, step / SUBSTEPS))
        k2 = _rates(model, _moved(x, k1, 0.5 * h), middle)
        k3 = _rates(model, _moved(x, k2, 0.5 * h), middle)
        k4 = _rates(model, _moved(x, k3, h), _between(before, after, (step + 1.0) / SUBSTEPS))
        mean = _moved(_moved(_moved(k1, k2, 2.0), k3, 2.0), k4, 1.0)
        x = _moved(x, mean, h / 6.0)
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
def _filtered(  # type: ignore[no-untyped-def]
    model: EkfModel, inputs: Array, depth: Array, period: float, carried: Array
):
    """Predict and update over all samples; return the fields of `EkfRun`."""
    n = depth.size
    states = np.zeros((n, 5))
    covariances = np.zeros((n, 5, 5))
    innovations = np.zeros(n)
    expected = np.zeros(n)
    unit, jacobian, gains = np.eye(5), np.eye(5), np.zeros(5)
    keep = np.zeros((5, 5))
    before = carried[:7].copy()
    x = (carried[7], carried[8], carried[9], carried[10], carried[11])
    cov = carried[12:37].copy().reshape((5, 5))
    for k in range(n):
        after = inputs[k]
        if not math.isnan(before[0]):
            ahead = _predict(model, x, before, after, period)
            for j in range(5):
                if j == DEPTH:  # no rate depends on the depth
                    continue
                there = _predict(model, _moved(x, unit[j], NUDGE), before, after, period)
                for i in range(5):
                    jacobian[i, j] = (there[i] - ahead[i]) / NUDGE
            x = ahead
            cov = _congruent(jacobian, cov)
            for i in range(5):
                cov[i, i] += model.process[i] * period
        before = after
        innovation = depth[k] - x[3]
        variance = cov[3, 3] + model.depth_variance
        # Joseph form keeps the covariance symmetric and positive.
        for i in range(5):
            for j in range(5):
                keep[i, j] = 1.0 if i == j else 0.0
            gains[i] = cov[i, 3] / variance
            keep[i, 3] -= gains[i]
        x = _moved(x, gains, innovation)
        cov = _congruent(keep, cov)
        for i in range(5):
            for j in range(5):
                # The gain of row i is the identity's column 3 minus keep's.
                gain_i = (1.0 if i == 3 else 0.0) - keep[i, 3]
                gain_j = (1.0 if j == 3 else 0.0) - keep[j, 3]
                cov[i, j] += model.depth_variance * gain_i * gain_j
                covariances[k, i, j] = cov[i, j]
            states[k, i] = x[i]
        innovations[k] = innovation
        expected[k] = np.sqrt(variance)
    # element by element: numba takes seconds to compile an assignment of arrays
    for i in range(7):
        carried[i] = before[i]
    for i in range(5):
        carried[7 + i] = x[i]
        for j in range(5):
            carried[12 + 5 * i + j] = cov[i, j]
    return states, covariances, innovations, expected
