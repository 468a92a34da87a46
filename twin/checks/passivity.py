"""Passivity: still water takes energy from a vehicle and never gives any.

A neutral vehicle without gravity, its parts held and its screws stopped, starts with motions
ahead, astern, sideways and tumbling. Its kinetic energy, including that of the added mass,

    E = nu^T (M_RB + M_A) nu / 2,    (M_RB + M_A) dnu/dt = -C(nu) nu + hull law + parts,

must never rise above its initial value. Inertia and Kirchhoff's coupling (Lamb 1932, article 124)
do no work, so a gain comes from a law or a part, in the code of either model. The check applies to
any law and any part, including those of plugins.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit
from twin.fossen import FossenModel
from twin.fossen.equations import mass_distribution, rigid_body_mass
from twin.fossen.forces import damping_wrench, parts_wrench
from twin.physics.native.effects import law_wrench, part_wrench
from twin.vehicle.laws import LAWS
from twin.vehicle.parts import PARTS
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import Vehicle, load_vehicle

Array = NDArray[np.float64]
Wrenches = Callable[[Array], Array]
"""Function from motions nu_r (n, 6) to forces [N] and moments [N m] of hull and parts, (n, 6)."""

MODELS = ("mujoco", "fossen")
SPEEDS = (0.1, 0.3, 1.0)
"""[m/s] Initial speeds: below the lower bound of rate damping, of gliders, under propeller."""
DIRECTIONS = {
    "ahead": (1.0, 0.0, 0.0),
    "astern": (-1.0, 0.0, 0.0),
    "sideways": (0.0, 1.0, 0.0),
    "downward": (0.0, 0.0, 1.0),
    "upward": (0.0, 0.0, -1.0),
    "obliquely": (0.7, 0.5, 0.5),
    "obliquely astern": (-0.7, 0.5, -0.5),
}
SPINS = {
    "": (0.0, 0.0, 0.0),
    "rolling": (1.0, 0.0, 0.0),
    "pitching": (0.0, 1.0, 0.0),
    "yawing": (0.0, 0.0, -1.0),
    "tumbling": (0.6, 0.8, -0.5),
}
SLOW, FAST = 0.3, 3.0
"""[1] Initial rates: hull lengths that the tip moves sideways per hull length of motion."""
ROLLS = 3.0
"""[1] Factor on roll rates: a slender hull rolls faster than it pitches."""
STEP = 0.3
"""[1] Step as a fraction of the fastest decay time; Runge-Kutta's energy is then right to 1e-6."""
ROUNDS, RENEWED = 320, 16
"""ROUNDS: maximum number of steps in a decay. RENEWED: steps until the step length is renewed"""
SPENT = 0.5
"""[1] Fraction of the initial energy below which a decay ends."""
LARGEST_GAIN = 1e-5
"""[1] Gain, as a fraction of the initial energy, up to which it counts as rounding."""
DEEP = 1e3
"""[m] Depth of every part."""
PLACED = 5
"""Count of numbers of a part before its values: code, place, position."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Decay:
    """Initial motion whose energy rises the most, or falls the least, and its gain."""

    model: str
    """Model whose code is checked, one of MODELS."""
    motion: str
    """Initial motion in words: direction, spin, speed."""
    gain: float
    """[1] Largest energy divided by the initial energy, minus 1; 0: the energy never rose."""

    @property
    def ok(self) -> bool:
        """True if the gain is no more than rounding."""
        return self.gain <= LARGEST_GAIN

    def text(self, vehicle: Vehicle) -> str:
        """Text about a vehicle that is not passive: the gain, its motion, and what to check."""
        return (
            f"vehicle {vehicle.name!r} gains {100.0 * self.gain:.3g} % of its energy from still "
            f"water when it moves {self.motion} ({self.model}): its hull law ({vehicle.law.kind}) "
            "or a part drives it; look at coefficients that drive in reversed or cross flow"
        )


def check_passivity(vehicle: Vehicle) -> list[Decay]:
    """Find the worst decay with each model's code of the law and the parts."""
    labels, starts = zip(*_starts(vehicle), strict=True)
    found = []
    for model in MODELS:
        gains = energy_gains(vehicle, np.array(starts), model)
        worst = int(np.argmax(gains))
        found.append(Decay(model=model, motion=labels[worst], gain=float(gains[worst])))
    return found


def check_still_water(vehicle: Vehicle | None = None) -> list[tuple[Vehicle, Decay]]:
    """Find the worst decays of a vehicle, or of every shipped one."""
    checked = [vehicle] if vehicle else [load_vehicle(name) for name in vehicle_names()]
    return [(one, decay) for one in checked for decay in check_passivity(one)]


def _starts(vehicle: Vehicle) -> Iterator[tuple[str, Array]]:
    """Yield every start in words, with its nu_r (6,)."""
    for speed, (way, direction), (turn, axis), rate in itertools.product(
        SPEEDS, DIRECTIONS.items(), SPINS.items(), (SLOW, FAST)
    ):
        if not turn and rate == FAST:
            continue
        spin = rate * speed / vehicle.hull_length * np.array(axis) * (ROLLS, 1.0, 1.0)
        motion = np.concatenate([speed * np.array(direction) / np.linalg.norm(direction), spin])
        turning = f" and {'slowly ' * (rate == SLOW)}{turn}" if turn else ""
        yield f"{way}{turning} at {speed:g} m/s", motion


def energy_gains(
    vehicle: Vehicle, starts: Array, model: str, positions: Array | None = None
) -> Array:
    """Largest energy divided by the initial one, minus 1, of each decay; shape (n,), 0 or more.

    Args:
      starts: nu_r, shape (n, 6). model: whose code is used, one of MODELS.
      positions: held positions of the parts, shape (parts,); None: at rest, screws stopped.
    """
    at = _rest_positions(vehicle) if positions is None else positions
    mass, moment, inertia = mass_distribution(FossenModel(vehicle).parameters, at)
    rigid = rigid_body_mass(mass, moment / mass, inertia)
    total = rigid + vehicle.added_mass
    coupled = total if vehicle.added_mass_coupling else rigid
    inverse = np.linalg.inv(total)
    wrenches = _WRENCHES[model](vehicle, at)

    def rate(nu: Array) -> Array:
        return np.asarray((wrenches(nu) - _coriolis(coupled, nu)) @ inverse.T)

    def energy(nu: Array) -> Array:
        return np.asarray(0.5 * np.einsum("ni,ij,nj->n", nu, total, nu))

    gains, first = np.zeros(len(starts)), energy(starts)
    nu, left = np.array(starts, dtype=float), np.arange(len(starts))
    step = np.zeros((len(starts), 1))
    for round_ in range(ROUNDS):
        if round_ % RENEWED == 0:
            step = STEP / _fastest_rate(rate, nu)[:, None]
        k1 = rate(nu)
        k2 = rate(nu + 0.5 * step * k1)
        k3 = rate(nu + 0.5 * step * k2)
        nu = nu + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(nu + step * k3))
        now = energy(nu) / first[left]
        gains[left] = np.maximum(gains[left], np.nan_to_num(now, nan=np.inf) - 1.0)
        going = (now > SPENT) & np.isfinite(now)
        nu, left, step = nu[going], left[going], step[going]
        if not left.size:
            break
    return gains


def _rest_positions(vehicle: Vehicle) -> Array:
    """Positions of the parts at rest, with screws stopped whatever their travel."""
    return np.where([part.spins for part in vehicle.parts], 0.0, vehicle.rest)


def _coriolis(inertia: Array, nu: Array) -> Array:
    """Product C(nu) nu, shape (n, 6), of Kirchhoff's equations for an inertia (6, 6)."""
    impulse = nu @ inertia
    force = np.cross(nu[:, 3:], impulse[:, :3])
    moment = np.cross(nu[:, 3:], impulse[:, 3:]) + np.cross(nu[:, :3], impulse[:, :3])
    return np.concatenate([force, moment], axis=1)


def _fastest_rate(rate, nu: Array) -> Array:  # type: ignore[no-untyped-def]
    """Size [1/s] of the fastest eigenvalue of the accelerations at each motion, shape (n,)."""
    size = np.linalg.norm(nu, axis=1)
    jacobian = np.empty((len(nu), 6, 6))
    for k in range(6):
        moved = np.zeros_like(nu)
        moved[:, k] = 1e-6 * (1.0 + size)
        jacobian[:, :, k] = (rate(nu + moved) - rate(nu - moved)) / (2.0 * moved[:, k : k + 1])
    return np.maximum(np.abs(np.linalg.eigvals(jacobian)).max(axis=1), 1e-3)


def _native_wrenches(vehicle: Vehicle, at: Array) -> Wrenches:
    """Make the function of wrenches of hull and parts in the MuJoCo twin's code."""
    parts = [
        (PARTS.code(part.kind), *part.position, position, *part.values())
        for part, position in zip(vehicle.parts, at.tolist(), strict=True)
        if type(part).native_wrench is not None
    ]
    rows = np.zeros((len(parts), max(map(len, parts), default=PLACED)))
    for row, numbers in zip(rows, parts, strict=True):
        row[: len(numbers)] = numbers
    law, values = LAWS.code(vehicle.law.kind), np.array(vehicle.law.values())
    density = float(vehicle.reference_density)
    return lambda nu: np.asarray(_native(law, values, rows, density, nu))


@jit
def _native(law, values, parts, density, motions):  # type: ignore[no-untyped-def]
    """Wrench of the hull and of rows (code, place 3, position, values) at each motion, (n, 6)."""
    found = np.empty((len(motions), 6))
    for n in range(len(motions)):
        u, v, w, p, q, r = motions[n]
        hull = law_wrench(law, values, density, u, v, w, p, q, r)
        for axis in range(6):
            found[n, axis] = hull[axis]
        for k in range(len(parts)):
            place, own = parts[k, 1:4], parts[k, PLACED:]
            wrench = part_wrench(
                int(parts[k, 0]), own, place, parts[k, 4], u, v, w, p, q, r, density, DEEP
            )
            for axis in range(6):
                found[n, axis] += wrench[axis]
    return found


def _fossen_wrenches(vehicle: Vehicle, at: Array) -> Wrenches:
    """Make the function of wrenches of hull and parts in the Fossen model's code."""
    parameters = FossenModel(vehicle).parameters
    density = float(vehicle.reference_density)
    return lambda nu: np.asarray(_fossen(parameters, at, density, nu))


@jit
def _fossen(parameters, at, density, motions):  # type: ignore[no-untyped-def]
    found, level = np.empty((len(motions), 6)), np.zeros(3)
    for n in range(len(motions)):
        wrench = damping_wrench(parameters, motions[n], density)
        wrench += parts_wrench(parameters, at, motions[n], density, DEEP, level)
        for axis in range(6):
            found[n, axis] = wrench[axis]
    return found


_WRENCHES = {"mujoco": _native_wrenches, "fossen": _fossen_wrenches}
