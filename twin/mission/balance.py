"""Balance: the sum of forces and moments on a vehicle in a steady motion, which must be zero.

Kirchhoff's equations with the rigid body's (Fossen 2021, sections 3.3 and 8.1), in still water of
the reference density and far below the surface. Steady flight and turns are where they vanish.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from twin.frames import cross

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

DEEP = 1e3
"""[m] where everything is under water"""
SETTLED = 1e-9
"""Forces and moments left over, in parts of the vehicle's weight (times a metre)"""
_ITERATIONS = 40
_STEP = 1e-6
_LARGEST_STEP = 0.1
"""of any unknown: a longer one may end beyond the stall of a fin"""
_LEAST_SHARE = 1e-3
"""of a Newton step that overshoots"""


def newton(left: Callable[[Array], Array], x: Array) -> Array | None:
    """Where `left` vanishes to SETTLED, from `x` on; None: not found.

    Newton's method with central differences; a step that makes it worse is halved.
    """
    rest = left(x)
    for _ in range(_ITERATIONS):
        size = float(np.abs(rest).max())
        if size < SETTLED:
            return x
        slopes = [(left(x + d) - left(x - d)) / (2.0 * _STEP) for d in _STEP * np.eye(x.size)]
        try:
            step = np.linalg.solve(np.column_stack(slopes), -rest)
        except np.linalg.LinAlgError:
            return None
        share = min(1.0, _LARGEST_STEP / float(np.abs(step).max()))
        rest = left(x + share * step)
        while not float(np.abs(rest).max()) < size and share > _LEAST_SHARE:
            share *= 0.5
            rest = left(x + share * step)
        x = x + share * step
    return None


def imbalance(
    vehicle: Vehicle,
    position: Array,
    velocity: Array,
    *,
    pitch: float,
    roll: float = 0.0,
    turn_rate: float = 0.0,
) -> Array:
    """Force [N] and moment about the CB [N m] left over, shape (6,), body FRD.

    Args:
      position: of the parts, shape (parts,), in their units.
      velocity: through the water, shape (3,) [m/s], body FRD.
      pitch, roll: [rad]. turn_rate: about the vertical [rad/s], positive to starboard.
    """
    down = np.array(
        [-math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)]
    )
    omega = turn_rate * down
    nu = np.concatenate([velocity, omega])

    density, gravity = vehicle.reference_density, vehicle.gravity
    mass, first = vehicle.static_mass, vehicle.static_mass * vehicle.static_cg
    inertia = vehicle.static_inertia @ omega
    inertia = inertia + _point(vehicle.static_mass, vehicle.static_cg, omega)
    at = dict(zip(vehicle.part_names, position, strict=True))
    for moving in vehicle.masses:
        place = moving.position(at.get(moving.slide or "", 0.0), at.get(moving.hinge or "", 0.0))
        mass += moving.mass
        first = first + moving.mass * place
        inertia = inertia + moving.inertia @ omega + _point(moving.mass, place, omega)
    impulse = mass * velocity + cross(omega, first)
    spin = inertia + cross(first, velocity)
    water = vehicle.added_mass @ nu if vehicle.added_mass_coupling else np.zeros(6)

    wrench = vehicle.law.wrench(nu, density)
    volume = vehicle.neutral_volume
    for part, place in zip(vehicle.parts, position, strict=True):
        wrench = wrench + part.wrench(float(place), nu, density, DEEP)
        own = part.displaced(float(place))
        volume += own
        wrench[3:] -= density * own * gravity * cross(np.array(part.position), down)
    wrench[:3] += (mass - density * volume) * gravity * down - cross(omega, impulse + water[:3])
    wrench[3:] += gravity * cross(first, down) - cross(omega, spin + water[3:])
    wrench[3:] -= cross(velocity, impulse + water[:3])
    return wrench


def _point(mass: float, place: Array, omega: Array) -> Array:
    """Angular momentum [N m s] of a point mass that turns about the CB, shape (3,)."""
    return mass * cross(place, cross(omega, place))
