"""Modes: the parts of a current as rotating, decaying pairs of north and east, stepped exactly.

A mode is the linear stochastic equation dz = lambda z dt + dw of the complex current z = north +
i east: lambda 0 is a random walk, -1/tau a first-order Gauss-Markov process, i omega - 1/tau a
rotary component that drifts in amplitude and phase (Gelb 1974, Applied Optimal Estimation, chapter
3; rotary components after Gonella 1972, Deep-Sea Res. 19). A line of the tide is a pair that turns
both ways: together they make any ellipse.

The transition is the change of a filter's state and covariance over a time step; the innovation is
the difference of a fix from what the filter expected. A filter's answers stand here too: a
forecast, and the smoothed track, which goes backwards over recorded steps (Rauch, Tung and Striebel
1965, AIAA J. 3(8)), so that all measurements have a say in each of them. A covariance of north and
east is an ellipse on a map.
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
"""[1] added to the diagonal of a correlation, so that parts that are known exactly can stay"""
EARTH_RATE = 7.2921159e-5
"""[rad/s]"""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
LONGEST = 6.0 * HOUR
"""[s] of a step whose noise the quadrature integrates to rounding; longer ones are parted"""


@dataclasses.dataclass(frozen=True, eq=False)
class Modes:
    """Several modes side by side, each (mode,). Variances are of north and of east each."""

    rate: Complex
    """lambda [1/s]; a positive imaginary part turns clockwise, north to east"""
    density: Array
    """[m2/s3] of the noise"""
    variance: Array
    """[m2/s2] before any measurement"""
    names: tuple[str, ...]
    """`mean`, `eddy`, `inertial`, and two of each constituent"""

    def __len__(self) -> int:
        return len(self.rate)


class Passage(NamedTuple):
    """Change of modes and of the displacement by them over a time, each (mode,)."""

    kept: Complex
    """of a mode"""
    displaced: Complex
    """[s] displacement by a mode that was 1 at the start"""
    noise: Array
    """[m2/s2] gained by a mode"""
    shared: Complex
    """[m2/s] covariance gained, mode with the conjugate of its displacement"""
    scattered: Array
    """[m2] gained by the displacement"""


def modes_of(parameters: CurrentParameters, latitude: float) -> Modes:
    """The modes of a current.

    Args:
      parameters: of the current.
      latitude: [degree] for the inertial frequency 2 Omega sin(latitude).
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
    """Change of modes over a time [s] of at most `LONGEST`.

    The noise of a mode at time s before the end reaches the mode as e^(lambda s) and the
    displacement as the integral of that; their products are integrated by Gauss and Legendre.
    Passages are kept: equal steps repeat.
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
    """Multiplication by complex numbers as matrices on (north, east), (..., 2, 2)."""
    found = np.empty((*np.shape(values), 2, 2))
    found[..., 0, 0] = found[..., 1, 1] = values.real
    found[..., 1, 0] = values.imag
    found[..., 0, 1] = -values.imag
    return found


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


class Innovation(NamedTuple):
    """Difference of a fix from what the filter expected."""

    residual: Array
    """North, east [m], (2,): fix less prediction"""
    covariance: Array
    """[m2], (2, 2), of the prediction and the fix"""
    distance: float
    """[1] squared Mahalanobis distance"""
    duration: float
    """[s] since the fix before"""
    inflation: float
    """[1] by which the fixes before had taught to take the covariance"""

    @property
    def normalised(self) -> float:
        """[1] squared distance in the covariance as it was stated: 2 in the mean where it is
        right."""
        return self.distance / self.inflation


class Node(NamedTuple):
    """One step of a filter."""

    time: float
    """[s] at its end"""
    carry: Array
    """Matrix that made it of the state before, (state, state)"""
    predicted: Array
    """State before the measurements of this time, (state,)"""
    predicted_covariance: Array
    estimate: Array
    """State after them"""
    covariance: Array


class CurrentForecast(NamedTuple):
    """The current at later times and the displacement by it, with their covariances."""

    times: Array
    """[s] on the filter's clock, (time,)"""
    current: Array
    """North, east [m/s], (time, 2)"""
    current_covariance: Array
    """[m2/s2], (time, 2, 2)"""
    displacement: Array
    """North, east [m] beyond the way through the water since the filter's time, (time, 2)"""
    displacement_covariance: Array
    """[m2], (time, 2, 2)"""


class SmoothedTrack(NamedTuple):
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
    """North, east [m/s] that the dive under way adds, (node, 2)"""


def smoothed(
    nodes: Sequence[Node], *, position: slice, current: Array, dive: slice
) -> SmoothedTrack:
    """The smoothed track of a filter's steps.

    Args:
      nodes: in order of time.
      position, dive: where they are in the state.
      current: what makes the current of a state, (2, state).
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
    """Squared Mahalanobis distance within which a part of the normal points of a plane lies.

    The quantile of chi-squared with two degrees of freedom, -2 ln(1 - part).

    Args:
      part: [1] from 0 to below 1.
    """
    return -2.0 * math.log1p(-part)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ellipse:
    """An ellipse on a map; semi-axes go from the middle to the edge."""

    semi_major_m: float
    """[m] half of the longer axis"""
    semi_minor_m: float
    """[m] half of the shorter axis"""
    bearing_deg: float
    """[degree] of the longer axis, clockwise from north, 0 to 180"""

    @classmethod
    def of(cls, squares: Array) -> Ellipse:
        """The ellipse x^T squares^-1 x = 1 of north and east; `squares` [m2], (2, 2)."""
        (minor, major), axes = _axes(squares)
        return cls(
            semi_major_m=float(major),
            semi_minor_m=float(minor),
            bearing_deg=math.degrees(math.atan2(axes[1, 1], axes[0, 1])) % 180.0,
        )


def outline(squares: Array, points: int) -> Array:
    """North, east [m] around `Ellipse.of(squares)`, (points, 2), closed.

    Counterclockwise seen from above, from north over west, as GeoJSON has it.
    """
    angles = np.linspace(0.0, 2.0 * math.pi, points)
    lengths, axes = _axes(squares)
    if np.linalg.det(axes) > 0.0:
        axes = axes * [1.0, -1.0]
    return np.asarray(((axes * lengths) @ np.stack([np.cos(angles), np.sin(angles)])).T)


def _axes(squares: Array) -> tuple[Array, Array]:
    """Lengths, the shorter first, (2,), and directions, (2, 2), in columns."""
    values, vectors = np.linalg.eigh(squares)
    return np.sqrt(np.maximum(values, 0.0)), vectors
