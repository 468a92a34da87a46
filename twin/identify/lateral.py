"""Lateral: how a glide answers small turns, from the Fossen equations linearised about it.

About a straight glide the sway, roll rate, yaw rate and roll of a vehicle with a plane of symmetry
part from the rest (Fossen 2011, section 7.5). The coefficients are central differences of the
same equations that the Fossen model integrates, so that every part, fin, added mass and lever of
a vehicle counts. Two things are asked of them:

- sway and yaw rate while the roll is the log's: what turns the vehicle, whoever rolled it;
- roll while the battery's rotation is the log's.

Both are linear in the sine of the roll and in what the turning part does, and are integrated
exactly between samples.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from twin.fossen.equations import mass_distribution, rigid_body_mass
from twin.fossen.forces import ForceParameters, parameters_of
from twin.fossen.steady import SteadyProblem
from twin.vehicle.parts import BatteryHinge, Fin
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

SWAY, ROLL_RATE, YAW_RATE, ROLL = 1, 3, 5, 6
"""Places in the state of `SteadyProblem.rate`: (u, v, w, p, q, r, roll, pitch)."""
LATERAL = (SWAY, ROLL_RATE, YAW_RATE, ROLL)
TERMS = 10
"""Of the series, at a norm below 1/8: the rest is below 1e-17"""
STEP = 1e-4
"""[SI] of the central differences of rates, roll and part's position."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Glide:
    """A straight glide, as a log flew it."""

    surge: float
    """[m/s]"""
    heave: float
    """[m/s]"""
    pitch: float
    """[rad]"""
    net_mass: float
    """[kg], + = heavy"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Lateral:
    """d(v, p, r, roll)/dt = matrix @ (v, p, r, roll) + drive * position + yaw * yaw moment."""

    matrix: Array
    """(4, 4)"""
    drive: Array
    """(4,) per unit of the turning part's position"""
    yaw: Array
    """(4,) per N m of a constant yaw moment"""
    inertia: Array
    """(3, 3) of sway, roll rate and yaw rate, with added mass"""
    pitch: float
    """[rad]"""

    def gains(self) -> tuple[float, float]:
        """Steady yaw rate [rad/s] and roll [rad] per unit of the turning part's position."""
        steady = -np.linalg.solve(self.matrix, self.drive)
        return float(steady[2]), float(steady[3])

    def turned_by_roll(self, period: float) -> tuple[Array, Array]:
        """One step of (sway, yaw rate) with the roll known.

        Returns the transition (2, 2) and the response (2, 4) to roll, roll's slope, the part's
        position and a yaw moment, each linear between samples taken at their mean.
        """
        # what rolls it is known to be balanced: side force and yaw moment alone move the two
        keep = [0, 2]
        free_inertia = np.linalg.inv(self.inertia[np.ix_(keep, keep)])

        def moved(accelerations: Array) -> Array:
            return free_inertia @ (self.inertia @ accelerations[:3])[keep]

        a, drive, yaw = moved(self.matrix), moved(self.drive), moved(self.yaw)
        # roll rate is not free: d(roll)/dt = p + r tan(pitch)
        free = a[:, keep].copy()
        free[:, 1] -= a[:, 1] * math.tan(self.pitch)
        return _discrete(free, np.stack([a[:, 3], a[:, 1], drive, yaw], axis=1), period)

    def rolled_by_part(self, period: float) -> tuple[Array, Array]:
        """One step of (v, p, r, roll): transition (4, 4), response (4, 2) to position and yaw."""
        return _discrete(self.matrix, np.stack([self.drive, self.yaw], axis=1), period)


def _discrete(a: Array, b: Array, period: float) -> tuple[Array, Array]:
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a * period, b * period
    whole = exponential(block)
    return whole[:n, :n], whole[:n, n:]


def exponential(matrix: Array) -> Array:
    """exp of a small square matrix: Taylor's series of a small part of it, squared again.

    The matrices of one fit are many and small: scipy's takes a hundred times as long on them.
    """
    norm = float(np.max(np.sum(np.abs(matrix), axis=1), initial=0.0))
    halvings = max(0, math.ceil(math.log2(max(norm, 1e-300))) + 3)
    part = matrix / 2.0**halvings
    unit = np.eye(len(matrix))
    out = unit
    for order in range(TERMS, 0, -1):
        out = unit + part @ out / order
    for _ in range(halvings):
        out = out @ out
    return out


def turning_part(vehicle: Vehicle) -> BatteryHinge | Fin | None:
    """The hinge or rudder that guidance turns it with; None: it has neither."""
    part = vehicle.steered("heading")
    return part if isinstance(part, BatteryHinge | Fin) else None


def jacobians(vehicle: Vehicle, state: Array, positions: Array) -> tuple[Array, Array]:
    """Rates of `SteadyProblem.rate` per state, (8, 8), and per position of a part, (8, parts).

    Args:
      state: (u, v, w, p, q, r, roll, pitch), (8,). positions: of the parts, (parts,).
    """
    parameters = _parameters(vehicle)
    place = vehicle.steered_index("heading")

    def problem(positions: Array) -> SteadyProblem:
        return SteadyProblem(parameters, positions, place, driven=False)

    here = problem(positions)
    by_state = [
        (here.rate(state + step) - here.rate(state - step)) / (2.0 * STEP)
        for step in STEP * np.eye(8)
    ]
    by_part = []
    for k, part in enumerate(vehicle.parts):
        step = np.zeros(len(positions))
        step[k] = STEP * min(part.high - part.low, 1.0)
        ahead, behind = (problem(positions + s * step).rate(state) for s in (1.0, -1.0))
        by_part.append((ahead - behind) / (2.0 * step[k]))
    return np.stack(by_state, axis=1), np.stack(by_part, axis=1)


def linearised(vehicle: Vehicle, glide: Glide) -> Lateral:
    """The lateral motion about a glide, with the turning part at rest."""
    positions = vehicle.rest.copy()
    pump = vehicle.steered_index("buoyancy")
    assert pump is not None
    positions[pump] = vehicle.pump_for_net_mass(glide.net_mass)
    state = np.array([glide.surge, 0.0, glide.heave, 0.0, 0.0, 0.0, 0.0, glide.pitch])
    slide = vehicle.steered_index("pitch")
    if slide is not None:
        positions[slide] += _balancing(vehicle, state, positions, slide)
    by_state, by_part = jacobians(vehicle, state, positions)
    keep = list(LATERAL)
    place = vehicle.steered_index("heading")
    inertia = _inertia(vehicle, positions)
    return Lateral(
        matrix=by_state[np.ix_(keep, keep)],
        drive=by_part[keep, place] if place is not None else np.zeros(4),
        yaw=np.append(np.linalg.solve(inertia, [0.0, 0.0, 1.0]), 0.0),
        inertia=inertia,
        pitch=glide.pitch,
    )


def _balancing(vehicle: Vehicle, state: Array, positions: Array, slide: int) -> float:
    """Change of the pitching part at which the pitch moments balance: the place of the weight
    along the hull turns a rolled glider too."""
    parameters = _parameters(vehicle)
    place = vehicle.steered_index("heading")
    step = np.zeros(len(positions))
    step[slide] = STEP
    here, there = (
        SteadyProblem(parameters, x, place, driven=False).rate(state)[4]
        for x in (positions, positions + step)
    )
    return float(-here * STEP / (there - here)) if there != here else 0.0


def _parameters(vehicle: Vehicle) -> ForceParameters:
    """In water of the reference density."""
    return parameters_of(vehicle, np.array([0.0, 1e4]), np.full(2, vehicle.reference_density))


def _inertia(vehicle: Vehicle, positions: Array) -> Array:
    """Mass matrix of sway, roll rate and yaw rate, with added mass, (3, 3)."""
    mass, moment, inertia = mass_distribution(_parameters(vehicle), positions)
    whole = np.asarray(rigid_body_mass(mass, moment / mass, inertia)) + vehicle.added_mass
    keep = [SWAY, ROLL_RATE, YAW_RATE]
    return np.asarray(whole[np.ix_(keep, keep)])
