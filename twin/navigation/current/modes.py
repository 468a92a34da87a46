"""Modes of a current: rotating, decaying pairs of north and east, stepped exactly.

A mode is the linear stochastic equation dz = lambda z dt + dw of the complex current z = north +
i east. With lambda = 0 it is a random walk; with -1/tau a first-order Gauss-Markov process; with
i omega - 1/tau a rotary component whose amplitude and phase drift (Gelb 1974, Applied Optimal
Estimation, chapter 3; rotary components after Gonella 1972, Deep-Sea Res. 19). A tidal constituent
is a pair that rotates in both senses: their sum can be any ellipse.

The transition is the change of a filter's state and covariance over a time step. The innovation is
the difference between a fix and the filter's prediction. The module also holds a filter's results:
a forecast, and the smoothed track, computed backwards over recorded steps so that every estimate
uses all measurements (Rauch, Tung and Striebel 1965, AIAA J. 3(8)). `Ellipse` shows a covariance of
north and east on a map.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.navigation.current.current_parameters import (
    CALIBRATION,
    CONSTITUENTS,
    DIVE,
    MODES,
    POSITION,
    CurrentParameters,
    relative_amplitude,
)
from twin.numbers import Array

Complex = NDArray[np.complex128]

HOUR, DAY = 3600.0, 86400.0
_JITTER = 1e-12
"""[1] Added to the diagonal of a correlation matrix: exactly known states would make it singular"""
EARTH_RATE = 7.2921159e-5
"""[rad/s] Rotation rate of the Earth"""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
LONGEST = 6.0 * HOUR
"""[s] Longest step whose noise the quadrature integrates to rounding; longer steps are split"""


@dataclasses.dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a current, each array (mode,); variances are of north and of east each."""

    rate: Complex
    """lambda [1/s]; with a positive imaginary part the mode turns clockwise, north to east"""
    density: Array
    """[m2/s3] Spectral density of the noise"""
    variance: Array
    """[m2/s2] Variance before any measurement"""
    names: tuple[str, ...]
    """`mean`, `eddy`, `inertial`, and two names for each constituent"""

    def __len__(self) -> int:
        return len(self.rate)


class Passage(NamedTuple):
    """Change of modes and of the displacement by the modes over a time step, each (mode,)."""

    kept: Complex
    """[1] Factor of a mode over the step"""
    displaced: Complex
    """[s] Displacement divided by the mode at the start"""
    noise: Array
    """[m2/s2] Variance gained by a mode"""
    shared: Complex
    """[m2/s] Covariance gained between a mode and the conjugate of its displacement"""
    scattered: Array
    """[m2] Variance gained by the displacement"""


def modes_of(parameters: CurrentParameters, latitude: float) -> Modes:
    """Build the modes of a current.

    Args:
      parameters: parameters of the current.
      latitude: [degree] gives the inertial frequency 2 Omega sin(latitude).
    """
    rows: list[tuple[str, complex, float, float]] = [
        ("mean", 0.0, parameters.wander**2 / DAY, parameters.mean**2)
    ]

    def add(name: str, deviation: float, memory: float, turn: float = 0.0) -> None:
        variance = deviation**2
        if deviation > 0.0:
            rows.append((name, complex(-1.0 / memory, turn), 2.0 * variance / memory, variance))

    add("eddy", parameters.eddy, parameters.eddy_time * HOUR)
    coriolis = 2.0 * EARTH_RATE * math.sin(math.radians(latitude))
    add("inertial", parameters.inertial, parameters.inertial_time * DAY, coriolis)
    for name in parameters.constituents:
        one = CONSTITUENTS[name]
        deviation = float(getattr(parameters, one.species)) * relative_amplitude(name)
        turn = 2.0 * math.pi / (one.period * HOUR)
        for sense, sign in (("clockwise", turn), ("counterclockwise", -turn)):
            add(f"{name} {sense}", deviation, parameters.tide_time * DAY, sign)
    names, rate, density, variance = zip(*rows, strict=True)
    return Modes(np.array(rate, complex), np.array(density), np.array(variance), names)


@functools.lru_cache(256)
def passage(modes: Modes, duration: float) -> Passage:
    """Compute the change of modes over a time [s] of at most `LONGEST`.

    Noise at time s before the end reaches the mode as e^(lambda s) and the displacement as the
    integral of e^(lambda s). Their products are integrated by Gauss-Legendre quadrature. Equal
    steps repeat, so results are cached.
    """
    rate = modes.rate
    still = np.abs(rate) * duration < 1e-7
    divisor = np.where(still, 1.0, rate)
    kept = np.exp(rate * duration)
    displaced = np.where(still, duration, (kept - 1.0) / divisor)
    ages = 0.5 * duration * (_NODES + 1.0)
    grown = np.exp(np.outer(rate, ages))
    moved = np.where(still[:, None], ages, (grown - 1.0) / divisor[:, None])
    weight = 0.5 * duration * _WEIGHTS * modes.density[:, None]
    return Passage(
        kept=kept,
        displaced=displaced,
        noise=(weight * np.abs(grown) ** 2).sum(axis=1),
        shared=(weight * grown * moved.conj()).sum(axis=1),
        scattered=(weight * np.abs(moved) ** 2).sum(axis=1),
    )


def turns(values: Complex) -> Array:
    """Matrices on (north, east), (..., 2, 2), that multiply by complex numbers."""
    found = np.empty((*np.shape(values), 2, 2))
    found[..., 0, 0] = found[..., 1, 1] = values.real
    found[..., 1, 0] = values.imag
    found[..., 0, 1] = -values.imag
    return found


ELSEWHERE = 1.0
"""[m/s] Growth of the position's standard deviation while the motion is unknown"""


def transition(
    gone: Passage, dt: float, through: Array | None, spread: Array, memory: float
) -> tuple[Array, Array]:
    """Transition matrix of a state over a time step, and the covariance gained in the step.

    Args:
      gone: change of the modes over the step.
      dt: [s]
      through: north, east through the water [m/s], (2,); None if unknown.
      spread: [m2/s2], (2, 2), covariance of the error of `through`.
      memory: [s] correlation time of that error.

    Returns:
      Transition matrix and covariance, both (state, state).
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
    # an integrated first-order error has variance 2 memory dt; in one step the error is constant
    alike = max(2.0 * memory, dt)
    noise[POSITION, POSITION] = gone.scattered.sum() * np.eye(2) + spread * dt * alike
    return carry, noise


@dataclasses.dataclass(frozen=True, kw_only=True)
class Innovation:
    """Difference between a fix and the filter's prediction."""

    residual: Array
    """North, east [m], (2,): fix minus prediction"""
    covariance: Array
    """[m2], (2, 2), covariance of prediction and fix together"""
    distance: float
    """[1] Squared Mahalanobis distance"""
    duration: float
    """[s] Time since the previous fix"""
    inflation: float
    """[1] Factor of the covariance, estimated from the earlier fixes"""

    @property
    def normalised(self) -> float:
        """[1] Squared distance relative to the stated covariance; its mean is 2 for a correct
        covariance."""
        return self.distance / self.inflation


class Node(NamedTuple):
    """Recorded step of a filter."""

    time: float
    """[s] Time at the end of the step"""
    carry: Array
    """Transition matrix from the previous state, (state, state)"""
    predicted: Array
    """State before the measurements at this time, (state,)"""
    predicted_covariance: Array
    estimate: Array
    """State after the measurements, (state,)"""
    covariance: Array


@dataclasses.dataclass(frozen=True, kw_only=True)
class CurrentForecast:
    """Forecast of the current and of the displacement by it, with their covariances."""

    times: Array
    """[s] on the filter's clock, (time,)"""
    current: Array
    """North, east [m/s], (time, 2)"""
    current_covariance: Array
    """[m2/s2], (time, 2, 2)"""
    displacement: Array
    """North, east [m] minus the track through the water since the filter's time, (time, 2)"""
    displacement_covariance: Array
    """[m2], (time, 2, 2)"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SmoothedTrack:
    """Positions and currents at the end of each recorded step; several may share a time."""

    times: Array
    """[s], (node,)"""
    position: Array
    """North, east [m], (node, 2)"""
    position_covariance: Array
    """[m2], (node, 2, 2)"""
    current: Array
    """North, east [m/s], (node, 2)"""
    current_covariance: Array
    """[m2/s2], (node, 2, 2)"""
    dive: Array
    """North, east [m/s] error of the current dive, (node, 2)"""


def smoothed(
    nodes: Sequence[Node], *, position: slice, current: Array, dive: slice
) -> SmoothedTrack:
    """Smooth the recorded steps of a filter.

    Args:
      nodes: recorded steps in order of time.
      position, dive: slices of the state.
      current: matrix that gives the current from a state, (2, state).
    """
    count, size = len(nodes), len(nodes[-1].estimate)
    mean, spread = nodes[-1].estimate, nodes[-1].covariance
    states, spreads = np.empty((count, size)), np.empty((count, size, size))
    states[-1], spreads[-1] = mean, spread
    for k in range(count - 2, -1, -1):
        one, after = nodes[k], nodes[k + 1]
        deviation = np.sqrt(np.maximum(np.diag(after.predicted_covariance), 0.0))
        unit = np.where(deviation > 0.0, deviation, 1.0)
        known = after.predicted_covariance / np.outer(unit, unit) + _JITTER * np.eye(size)
        cross = (after.carry @ one.covariance) / unit[:, None]
        gain = np.linalg.solve(known, cross).T / unit[None, :]
        mean = one.estimate + gain @ (mean - after.predicted)
        spread = one.covariance + gain @ (spread - after.predicted_covariance) @ gain.T
        spread = 0.5 * (spread + spread.T)
        states[k], spreads[k] = mean, spread
    return SmoothedTrack(
        times=np.array([node.time for node in nodes]),
        position=states[:, position],
        position_covariance=spreads[:, position, position],
        current=states @ current.T,
        current_covariance=current @ spreads @ current.T,
        dive=states[:, dive],
    )


def chi_squared(part: float) -> float:
    """Squared Mahalanobis distance that holds a fraction of normally distributed points of a plane.

    The quantile of chi-squared with two degrees of freedom, -2 ln(1 - part).

    Args:
      part: [1] fraction, from 0 to below 1.
    """
    return -2.0 * math.log1p(-part)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ellipse:
    """Ellipse on a map."""

    semi_major_m: float
    """[m] Half of the longer axis"""
    semi_minor_m: float
    """[m] Half of the shorter axis"""
    bearing_deg: float
    """[degree] Bearing of the longer axis, clockwise from north, 0 to 180"""

    @classmethod
    def of(cls, squares: Array) -> Ellipse:
        """Build the ellipse x^T squares^-1 x = 1 of north and east; `squares` [m2], (2, 2)."""
        (minor, major), axes = _axes(squares)
        return cls(
            semi_major_m=float(major),
            semi_minor_m=float(minor),
            bearing_deg=math.degrees(math.atan2(axes[1, 1], axes[0, 1])) % 180.0,
        )


def outline(squares: Array, points: int) -> Array:
    """North, east [m] of points around `Ellipse.of(squares)`, (points, 2), closed.

    Counterclockwise seen from above, from north over west, as in GeoJSON.
    """
    angles = np.linspace(0.0, 2.0 * math.pi, points)
    lengths, axes = _axes(squares)
    if np.linalg.det(axes) > 0.0:
        axes = axes * [1.0, -1.0]
    return np.asarray(((axes * lengths) @ np.stack([np.cos(angles), np.sin(angles)])).T)


def _axes(squares: Array) -> tuple[Array, Array]:
    """Semi-axes, the shorter first, (2,), and their directions as columns, (2, 2)."""
    values, vectors = np.linalg.eigh(squares)
    return np.sqrt(np.maximum(values, 0.0)), vectors
