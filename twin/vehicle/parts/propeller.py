"""Propeller: thrust and torque of a screw from its rate and the speed through the water.

F = rho D^4 (C_T n |n| - C_T / J_0 |n| u_a / D), with n the rate [rad/s], u_a the speed of advance
at the screw and J_0 the advance ratio u_a / (n D) of zero thrust: the linear part of an open-water
diagram (Fossen 2011, section 9.1.1, with n in rad/s as the LRAUV simulator has it). Without J_0
the thrust depends on the rate alone.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from twin.compiled import jit
from twin.vehicle.changes import Uncertainty, coefficient
from twin.vehicle.parts.base import Array, Carrier, Losses, Part, Quantity

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

DIAMETER, THRUST, TORQUE, ADVANCE = 0, 1, 2, 3  # places in the values


@jit
def native_wrench(values, place, position, u, v, w, p, q, r, density, depth):  # type: ignore[no-untyped-def]
    """Thrust along the hull at its place and the reaction of its torque, about the CB."""
    diameter = values[DIAMETER]
    turning = abs(position)
    advance = u + q * place[2] - r * place[1]
    loading = values[THRUST] * position * turning
    if values[ADVANCE] > 0.0:
        loading -= values[THRUST] / values[ADVANCE] * turning * advance / diameter
    # the part of the disc that is under water carries
    x = min(max(2.0 * depth / diameter, -1.0), 1.0)
    wet = 0.5 + (x * math.sqrt(1.0 - x * x) + math.asin(x)) / math.pi
    thrust = wet * density * diameter**4 * loading
    torque = wet * density * diameter**5 * values[TORQUE] * position * turning
    return thrust, 0.0, 0.0, -torque, place[2] * thrust, -place[1] * thrust


@jit
def fossen_wrench(values, place, position, nu_r, density, depth):  # type: ignore[no-untyped-def]
    """(6,): T along the screw's axis with T_nn n|n| + T_nu |n| u_a (Fossen 2011, eq. 9.5)."""
    d = values[DIAMETER]
    inflow = nu_r[0] - nu_r[5] * place[1] + nu_r[4] * place[2]
    t_nn = density * d**4 * values[THRUST]
    t_nu = -density * d**3 * values[THRUST] / values[ADVANCE] if values[ADVANCE] > 0.0 else 0.0
    force = t_nn * abs(position) * position + t_nu * abs(position) * inflow
    moment = density * d**5 * values[TORQUE] * abs(position) * position
    if depth < 0.5 * d:
        half = np.arccos(min(-2.0 * depth / d, 1.0))
        share = (half - np.sin(half) * np.cos(half)) / np.pi
        force *= share
        moment *= share
    tau = np.zeros(6)
    tau[0] = force
    tau[3] = -moment
    tau[4] = force * place[2]
    tau[5] = -force * place[1]
    return tau


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Propeller(Part):
    """A screw on the hull; its position is its rate, positive drives forward."""

    kind: ClassVar[str] = "propeller"
    unit: ClassVar[str] = "rad/s"
    quantity: ClassVar[Quantity] = Quantity(
        unit="rad s-1", scale=1.0, long_name="rate, ahead positive", limits=(-1000.0, 1000.0)
    )
    spins: ClassVar[bool] = True
    turn: ClassVar[int] = 40

    diameter: float
    """[m]"""
    thrust_coefficient: float
    """C_T [1/rad2]: thrust at rest = rho D^4 C_T n^2 with n in rad/s"""
    torque_coefficient: float = 0.0
    """C_Q [1/rad2]: torque = rho D^5 C_Q n^2; it rolls the hull the other way, to port, or below 0
    to starboard: a left-handed screw"""
    zero_thrust_advance: float = 0.0
    """J_0 [rad-1]: u_a / (n D) at which the thrust vanishes; 0: no loss with speed"""

    native_wrench = staticmethod(native_wrench)
    fossen_wrench = staticmethod(fossen_wrench)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """`NAME.diameter`, `.thrust_coefficient`; also `.torque_coefficient`, ...advance."""
        return {
            "diameter": reader.number(f"{name}.diameter"),
            "thrust_coefficient": reader.number(f"{name}.thrust_coefficient"),
            "torque_coefficient": reader.number(f"{name}.torque_coefficient", default=0.0),
            "zero_thrust_advance": reader.number(f"{name}.zero_thrust_advance", default=0.0),
        }

    def problems(self) -> list[tuple[str, str]]:
        """Also: sizes and coefficients that no screw has."""
        found = super().problems()
        if not self.diameter > 0.0:
            found.append(("diameter", "positive"))
        if not self.thrust_coefficient > 0.0:
            found.append(("thrust_coefficient", "positive"))
        if self.zero_thrust_advance < 0.0:
            found.append(("zero_thrust_advance", "at least 0 (0: none)"))
        return found

    def values(self) -> tuple[float, ...]:
        """In the order of DIAMETER, THRUST, TORQUE, ADVANCE."""
        return (
            self.diameter,
            self.thrust_coefficient,
            self.torque_coefficient,
            self.zero_thrust_advance,
        )

    def mirrored(self) -> float | None:
        """It is in the middle; its torque, which would turn round, is small."""
        return 1.0 if abs(self.position[1]) < 1e-9 else None

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Also: its thrust."""
        thrust = coefficient("thrust", f"thrust of the {self.name}", field="thrust_coefficient")
        return (*super().uncertainties(), thrust)

    def controls(self) -> tuple[str, ...]:
        """It drives."""
        return ("speed",)

    @property
    def drawn_axis(self) -> tuple[float, float, float]:
        """Its shaft, along the hull."""
        return (1.0, 0.0, 0.0)

    def thrust(self, rate: float, speed: float, density: float) -> float:
        """Thrust [N] at `rate` [rad/s] and `speed` [m/s] of advance, deep under water."""
        still = np.zeros(3)
        motion = (speed, 0.0, 0.0, 0.0, 0.0, 0.0)
        wrench = native_wrench(np.array(self.values()), still, rate, *motion, density, 1e3)
        return float(wrench[0])

    def energy(
        self,
        vehicle: Carrier,
        before: ArrayLike,
        after: ArrayLike,
        losses: Losses,
        *,
        depth: ArrayLike,
        pitch: ArrayLike,
        duration: ArrayLike,
    ) -> Array:
        """Shaft power of its torque, over the efficiency of its motor [J]."""
        rate = 0.5 * np.add(before, after, dtype=float)
        size = abs(self.torque_coefficient)
        torque = vehicle.reference_density * self.diameter**5 * size * rate**2
        return np.asarray(
            torque * np.abs(rate) * np.asarray(duration) / losses.propeller_efficiency
        )

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Ahead, from a quarter of its largest rate to three quarters."""
        return float(self.high * rng.uniform(0.25, 0.75))
