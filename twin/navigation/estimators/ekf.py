"""EKF: an extended Kalman filter on the dynamic model.

State (surge, sway, heave [m/s], depth [m], error of the net buoyancy mass [kg]). Prediction
integrates the momentum equation of the nominal vehicle (Fossen 2011, chapter 8; the coefficient
forces are the Fossen model's own) with measured attitude, rates and pump as known inputs,

    (m + M_A) dv/dt = P x omega + W(net mass, attitude) + F(v, omega),
                  P = (m + M_A) v + M_vw omega,

and the depth by the vertical row of the kinematics; the update is the measured depth. Angular
accelerations are left out: their coupling is below 1e-3 m/s2 and the process noise covers it. The
water's velocity is not in the state: no relative sensor sees it.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.fossen.equations import skew
from twin.fossen.forces import ForceParameters, parameters_of
from twin.identify.start_values import net_mass
from twin.navigation.dead_reckoning import Array, Signals, finite_channel
from twin.navigation.estimators.base import (
    BodyVelocity,
    Estimate,
    State,
    VelocityDeviation,
    VelocityEstimator,
)
from twin.navigation.estimators.ekf_kernels import DEPTH, STATES, SURGE, SWAY, filtered
from twin.navigation.estimators.glide_deviation import glide_deviation
from twin.navigation.estimators.series import (
    RESTING_WINDOW_S,
    SHALLOW_DEPTH,
    SURFACE_DEPTH,
    Mask,
    afloat,
    no_glider,
)
from twin.navigation.estimators.windowed import Recent
from twin.vehicle.vehicle import Vehicle


@dataclasses.dataclass(frozen=True, kw_only=True)
class EkfNoise:
    """What the filter believes; set for a vehicle whose coefficients are 10 % uncertain."""

    acceleration: float = 2e-3
    """[m/s2/sqrt(Hz)] each axis: what the force law and the measured inputs get wrong."""
    net_mass: float = 1.2e-2
    """[kg/sqrt(s)] drift of the net mass's error: stratification, compressibility and wrong drag.
    The last one changes its sign between dive and climb, so the drift must follow an inflection."""
    initial_net_mass: float = 0.03
    """[kg] ballasting error at the start: 20 g is usual."""
    initial_velocity: float = 0.05
    """[m/s] each axis: the mission starts from rest."""
    depth: float = 0.01
    """[m] of a depth sample: noise and quantisation of the transducer."""
    kinematic: float = 5e-4
    """[m/sqrt(s)] drift between depth and integrated vertical velocity: attitude errors, internal
    waves."""

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
    """[m] what the filter expected, (time,)"""


_INPUTS = (
    "measured_depth", "measured_roll", "measured_pitch", "measured_roll_rate",
    "measured_pitch_rate", "measured_yaw_rate", "measured_pump",
)  # fmt: skip


class Ekf(VelocityEstimator):
    """Model-based observer with the nominal parameters; on board with the last seconds' depths."""

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
        """Begin before the first sample; see `VelocityEstimator`."""
        super().__init__(vehicle, period)
        self.noise = EkfNoise() if noise is None else noise
        self.recent = Recent(("measured_depth",), max(2, round(RESTING_WINDOW_S / period) + 2))
        self.reset()

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """It needs a glider with one moving mass."""
        why = no_glider(vehicle)
        if not why and len(vehicle.masses) != 1:
            why = f"vehicle {vehicle.name!r} has {len(vehicle.masses)} moving masses, not one"
        return why

    @property
    def deviation(self) -> VelocityDeviation:
        """See `VelocityEstimator`."""
        return glide_deviation(self.vehicle)

    def reset(self) -> None:
        """See `VelocityEstimator`."""
        self.recent.reset()
        self._carried = np.zeros(0)

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`.

        Raises:
          InputError: a channel is missing or not finite.
        """
        self.recent.add(sample)
        try:
            rows = np.array([[sample[name]] for name in _INPUTS], np.float64)
        except KeyError as lost:
            raise InputError(f"the sample has no channel {lost}, which the EKF reads") from None
        if not np.isfinite(rows).all():
            bad = _INPUTS[int(np.isfinite(rows[:, 0]).argmin())]
            raise InputError(f"channel {bad} of the sample is not finite: the EKF needs it")
        depth = rows[0]
        still = depth < SURFACE_DEPTH
        if depth[0] < SHALLOW_DEPTH and self.recent.count > 1:
            still = afloat(self.recent.signals()["measured_depth"], self.period)[-1:]
        if not self._carried.size:
            self._carried = first_carried(self.noise, depth[0])
        run = self.model.run(self.inputs(rows, still), depth, self.period, self._carried)
        surge, sway, heave = run.states[0, :3].tolist()
        return BodyVelocity(
            surge=surge, sway=sway, heave=heave, covariance=run.covariances[0, :3, :3]
        )

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
        """The whole filter on one mission."""
        rows = np.stack([finite_channel(signals, name) for name in _INPUTS])
        inputs = self.inputs(rows, afloat(rows[0], self.period))
        return self.model.run(inputs, rows[0], self.period, first_carried(self.noise, rows[0, 0]))

    def inputs(self, rows: Array, still: Mask) -> Array:
        """Down axis (3), rates (3) and net mass (1) of rows of `_INPUTS` (7, time); (time, 7)."""
        depth, roll, pitch, *rates, pump = rows
        roll, pitch = np.deg2rad(roll), np.deg2rad(pitch)
        # Afloat, the surface carries what the pump takes off: the hull comes out of the water. How
        # far it does, a pressure gauge that is off by a metre cannot say.
        net = np.where(still, 0.0, net_mass(self.vehicle, pump, np.maximum(depth, 0.0)))
        down = (-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll))
        return np.stack([*down, *rates, net], axis=1)

    def state(self) -> dict[str, NDArray[Any]]:
        """See `VelocityEstimator`."""
        return {**self.recent.state(), "carried": self._carried.copy()}

    def restore(self, state: State) -> None:
        """See `VelocityEstimator`."""
        self.recent.restore(state)
        self._carried = np.array(state["carried"], np.float64)

    @functools.cached_property
    def model(self) -> EkfModel:
        """The vehicle's equations, as compiled code takes them."""
        table = np.array([self.vehicle.reference_density])
        q = self.noise
        inertia = _inertia(self.vehicle)
        return EkfModel(
            parameters_of(self.vehicle, np.zeros(1), table),
            np.asarray(np.linalg.inv(inertia), np.float64),
            inertia,
            _coupling(self.vehicle),
            np.array([q.acceleration**2] * 3 + [q.kinematic**2, q.net_mass**2]),
            q.depth**2,
        )


class EkfModel(NamedTuple):
    """What the filter predicts with."""

    parameters: ForceParameters
    inverse: Array
    """of the inertia, (3, 3)"""
    inertia: Array
    coupling: Array
    process: Array
    """variances per second, (5,)"""
    depth_variance: float

    def run(self, inputs: Array, depth: Array, period: float, carried: Array) -> EkfRun:
        """Go on over samples; `carried` is changed to go on from there."""
        p = self
        return EkfRun(
            *filtered(
                p.parameters, p.inverse, p.inertia, p.coupling, inputs, depth, p.process,
                p.depth_variance, period, carried,
            )
        )  # fmt: skip


def first_carried(noise: EkfNoise, depth: float) -> Array:
    """What the filter carries from sample to sample, before the first one, (37,).

    The inputs of the sample before (7), NaN at the first one, the state (5), the covariance (25).
    """
    q = noise
    first = np.array([q.initial_velocity**2] * 3 + [q.depth**2, q.initial_net_mass**2])
    state = np.zeros(STATES)
    state[DEPTH] = depth
    return np.concatenate([np.full(7, np.nan), state, np.diag(first).ravel()])


def _inertia(vehicle: Vehicle) -> Array:
    return vehicle.mass * np.eye(3) + vehicle.added_mass[:3, :3]


def _coupling(vehicle: Vehicle) -> Array:
    """M_vw, (3, 3): momentum per body rate, with the moving masses in their neutral places."""
    moment = vehicle.static_mass * vehicle.static_cg
    for moving in vehicle.masses:
        moment = moment + moving.mass * moving.position(0.0, 0.0)
    return vehicle.added_mass[:3, 3:] - skew(moment)
