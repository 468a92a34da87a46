"""Propeller: thrust and torque of a screw by its open-water diagram, in all four quadrants.

With the rate n [rad/s], the speed of advance u_a at the screw and J = u_a / (n D),

    T = rho D^4 (C_T n |n| - s_T |n| u_a / D - S_T u_a |u_a| / D^2)
    Q = rho D^5 (C_Q n |n| - s_Q |n| u_a / D - S_Q u_a |u_a| / D^2)

The first two terms are the linear part of a diagram (Fossen 2011, section 9.1.1, with n in rad/s as
in the LRAUV simulator). The third is its curvature: ahead K_T = C_T - s_T J - S_T J^2, as in the
polynomials of open-water series (Oosterveld and van Oossanen 1975). For a standing screw the third
term alone remains, the drag S_T rho D^2 u_a |u_a| of its blades. Files give the advance ratios J_0
of zero thrust and J_1 of zero torque instead of the slopes, s = C / J_0 - S J_0. Beyond J_1 the
water turns the screw (windmilling). Astern, n and u_a have the other sign and all is mirrored.
Without J_0 the thrust, and without J_1 the torque, does not fall with speed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from twin.compiled import elementary, jit
from twin.compiled.elementary import scalar
from twin.vehicle.changes import Uncertainty, coefficient
from twin.vehicle.parts.base import Array, Carrier, Losses, Move, Part, Quantity

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

FIELDS = (
    "diameter", "thrust_coefficient", "torque_coefficient", "zero_thrust_advance",
    "standing_drag", "zero_torque_advance", "standing_torque",
)  # fmt: skip
"""Fields that kernels read, in the order of DIAMETER to STANDING_TORQUE."""
DIAMETER, THRUST, TORQUE, ADVANCE, STANDING, TORQUE_ADVANCE, STANDING_TORQUE = range(7)
ADVANCES = np.concatenate([-np.geomspace(30.0, 1e-3, 200), [0.0], np.geomspace(1e-3, 30.0, 200)])
"""[1/rad] Advance ratios at which the diagram is checked for power that it must not create."""
GIVEN = 0.02
"""Largest power, relative to thrust and shaft power, that a rounded diagram may create."""


@jit
def native_wrench(values, place, position, u, v, w, p, q, r, density, depth):  # type: ignore[no-untyped-def]
    """Thrust along the hull at the screw's place and the reaction of its torque, about the CB."""
    diameter = values[DIAMETER]
    turning = abs(position)
    advance = u + q * place[2] - r * place[1]
    loading = values[THRUST] * position * turning
    if values[ADVANCE] > 0.0:
        loading -= values[THRUST] / values[ADVANCE] * turning * advance / diameter
    twisting = values[TORQUE] * position * turning
    if values[TORQUE_ADVANCE] > 0.0:
        twisting -= values[TORQUE] / values[TORQUE_ADVANCE] * turning * advance / diameter
    if values[STANDING] > 0.0 or values[STANDING_TORQUE] != 0.0:
        flow = advance / diameter
        loading -= values[STANDING] * flow * (abs(flow) - values[ADVANCE] * turning)
        twisting -= values[STANDING_TORQUE] * flow * (abs(flow) - values[TORQUE_ADVANCE] * turning)
    # only the part of the disc under water gives thrust
    x = min(max(2.0 * depth / diameter, -1.0), 1.0)
    wet = 0.5 + (x * math.sqrt(1.0 - x * x) + math.asin(x)) / math.pi
    thrust = wet * density * diameter**4 * loading
    torque = wet * density * diameter**5 * twisting
    return thrust, 0.0, 0.0, -torque, place[2] * thrust, -place[1] * thrust


@scalar
def diagram(first, zero, standing, n, flow):  # type: ignore[no-untyped-def]
    """C n|n| - s |n| u_a/D - S u_a|u_a|/D^2 [rad2/s2], numbers or arrays; `flow` is u_a/D [1/s]."""
    slope = first / zero - standing * zero if zero > 0.0 else 0.0
    return first * np.abs(n) * n - slope * np.abs(n) * flow - standing * np.abs(flow) * flow


@scalar
def fossen_wrench(values, place, position, u, v, w, p, q, r, density, depth):  # type: ignore[no-untyped-def]
    """Thrust T along the screw's axis and torque -Q about it (Fossen 2011, section 9.1.1)."""
    d = values[DIAMETER]
    inflow = (u - r * place[1] + q * place[2]) / d
    force = diagram(values[THRUST], values[ADVANCE], values[STANDING], position, inflow)
    moment = diagram(
        values[TORQUE], values[TORQUE_ADVANCE], values[STANDING_TORQUE], position, inflow
    )
    # only the part of the disc under water gives thrust
    cosine = min(max(-2.0 * depth / d, -1.0), 1.0)
    half, sine = elementary.acos(cosine), math.sqrt(abs((1.0 - cosine) * (1.0 + cosine)))
    scale = density * d * d * d * d * (half - sine * cosine) / math.pi
    force, moment = scale * force, scale * d * moment
    return force, 0.0, 0.0, -moment, force * place[2], -force * place[1]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Propeller(Part):
    """A screw on the hull; its position is its rate, positive propels forward."""

    kind: ClassVar[str] = "propeller"
    physics: ClassVar[int] = 4
    unit: ClassVar[str] = "rad/s"
    quantity: ClassVar[Quantity] = Quantity(
        unit="rad s-1", scale=1.0, long_name="rate, ahead positive", limits=(-1000.0, 1000.0)
    )
    spins: ClassVar[bool] = True
    turn: ClassVar[int] = 40

    diameter: float
    """[m] Diameter of the screw."""
    thrust_coefficient: float
    """C_T [1/rad2]: thrust at rest = rho D^4 C_T n^2 with n in rad/s"""
    torque_coefficient: float = 0.0
    """C_Q [1/rad2]: torque = rho D^5 C_Q n^2. Its reaction rolls the hull to port; a negative C_Q
    (a left-handed screw) rolls it to starboard."""
    zero_thrust_advance: float = 0.0
    """J_0 [rad-1]: u_a / (n D) at which the thrust vanishes; 0: no loss with speed"""
    standing_drag: float = 0.0
    """S_T [1]: drag of the standing screw = rho D^2 S_T u_a^2"""
    zero_torque_advance: float = 0.0
    """J_1 [rad-1]: u_a / (n D) at which the torque vanishes; 0: no fall with speed"""
    standing_torque: float = 0.0
    """S_Q [1]: torque of the water on the standing screw = rho D^3 S_Q u_a^2, with the sign of the
    torque coefficient."""

    native_wrench = staticmethod(native_wrench)
    fossen_wrench = staticmethod(fossen_wrench)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Fields `NAME.diameter`, `.thrust_coefficient`; the others are 0 where not in the file."""
        needed = ("diameter", "thrust_coefficient")
        return {
            field: reader.number(f"{name}.{field}", default=None if field in needed else 0.0)
            for field in FIELDS
        }

    def problems(self) -> list[tuple[str, str]]:
        """Report also sizes and coefficients that no screw has, and diagrams that create energy."""
        found = super().problems()
        sizes = ("diameter", "thrust_coefficient")
        found += [(name, "positive") for name in sizes if not getattr(self, name) > 0.0]
        others = ("zero_thrust_advance", "zero_torque_advance", "standing_drag")
        found += [(name, "at least 0 (0: none)") for name in others if getattr(self, name) < 0.0]
        if self.standing_torque * self.torque_coefficient < 0.0:
            found.append(("standing_torque", "of the sign of torque_coefficient"))
        if self.zero_torque_advance > 0.0 and not found and self.power_given > GIVEN:
            rule = (
                "such that no more power leaves the water than the shaft takes, ahead or "
                f"windmilling: at most 2 % of it, not {100.0 * self.power_given:.3g} %"
            )
            found.append(("zero_torque_advance, standing_torque", rule))
        return found

    @property
    def power_given(self) -> float:
        """Largest excess of thrust power over shaft power, relative to both; below 0: none.

        Covers every advance ratio, ahead and astern, of the screw turning ahead. Without a torque
        that falls with speed the number has no meaning.
        """
        size = abs(self.torque_coefficient)
        thrust = diagram(
            self.thrust_coefficient, self.zero_thrust_advance, self.standing_drag, 1.0, ADVANCES
        )
        torque = diagram(size, self.zero_torque_advance, abs(self.standing_torque), 1.0, ADVANCES)
        return float(np.max((thrust * ADVANCES - torque) / (size + np.abs(thrust * ADVANCES))))

    def values(self) -> tuple[float, ...]:
        """Values in the order of DIAMETER to STANDING_TORQUE."""
        return tuple(getattr(self, name) for name in FIELDS)

    def mirrored(self) -> float | None:
        """Factor 1 for a screw in the middle (the mirrored torque is small), else None."""
        return 1.0 if abs(self.position[1]) < 1e-9 else None

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Base uncertainties and the thrust."""
        thrust = coefficient("thrust", f"thrust of the {self.name}", field="thrust_coefficient")
        return (*super().uncertainties(), thrust)

    def controls(self) -> tuple[str, ...]:
        """Speed: the screw propels the vehicle."""
        return ("speed",)

    @property
    def working(self) -> float:
        """Half of the largest rate [rad/s]."""
        return 0.5 * self.high

    @property
    def drawn_axis(self) -> tuple[float, float, float]:
        """Shaft axis, along the hull."""
        return (1.0, 0.0, 0.0)

    def thrust(self, rate: float, speed: float, density: float) -> float:
        """Thrust [N] at `rate` [rad/s] and `speed` [m/s] of advance, deep under water."""
        still = np.zeros(3)
        motion = (speed, 0.0, 0.0, 0.0, 0.0, 0.0)
        wrench = native_wrench(np.array(self.values()), still, rate, *motion, density, 1e3)
        return float(wrench[0])

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Shaft energy of the torque, divided by the efficiency of the motor [J].

        A screw that the water turns recovers no energy.
        """
        rate = 0.5 * np.add(move.before, move.after, dtype=float)
        flow = np.asarray(move.speed, dtype=float) / self.diameter
        twisting = diagram(
            self.torque_coefficient, self.zero_torque_advance, self.standing_torque, rate, flow
        )
        power = vehicle.reference_density * self.diameter**5 * twisting * rate
        power *= math.copysign(1.0, self.torque_coefficient)
        return np.asarray(np.maximum(power, 0.0) * move.duration / losses.propeller_efficiency)

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Sample a rate ahead, from a quarter to three quarters of the largest rate."""
        return float(self.high * rng.uniform(0.25, 0.75))
