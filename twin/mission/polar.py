"""Polar: drag, lift and pitch moment of a hull over the angle of attack, per speed squared."""

from __future__ import annotations

import abc
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from twin.errors import MissionError, VehicleError
from twin.vehicle.laws import FlowFrame

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

WIDEST = math.radians(20.0)
"""[rad] angle of attack up to which a steady glide is looked for: beyond it wings stall"""
UNIT_SPEED = 0.3
"""[m/s] at which a law that is not purely quadratic is evaluated: a glider's"""


class Polar(abc.ABC):
    """Drag and lift [N s2/m2], pitch moment [N m s2/m2] over the angle of attack [rad]."""

    zero_lift: float
    """[rad]"""
    valid_angle: float
    """[rad] largest angle of attack"""

    @abc.abstractmethod
    def at(self, alpha: float) -> tuple[float, float, float]:
        """Drag, lift and pitch moment over speed squared."""

    def drag_over_lift(self, alpha: Array) -> Array:
        """Their ratio at several angles, same shape."""
        found = np.array([self.at(float(a))[:2] for a in alpha])
        return np.asarray(found[:, 0] / found[:, 1])


class FlowFramePolar(Polar):
    """Of the printed coefficients, inside the identified angles."""

    def __init__(self, name: str, law: FlowFrame):
        self._drag, self._lift, self._moment = law.drag, law.lift, law.pitch_moment
        if not (self._drag[0] > 0.0 and self._drag[1] >= 0.0 and self._lift[1] > 0.0):
            raise VehicleError(
                f"vehicle {name!r} cannot glide: drag {self._drag[0]:g}, {self._drag[1]:g} and "
                f"lift slope {self._lift[1]:g} must be positive for a closed-loop mission"
            )
        self.zero_lift = -self._lift[0] / self._lift[1]
        self.valid_angle = law.linear_angle

    def at(self, alpha: float) -> tuple[float, float, float]:
        """K_D0 + K_D alpha^2, K_L0 + K_alpha alpha, K_M0 + K_M alpha."""
        return (
            self._drag[0] + self._drag[1] * alpha**2,
            self._lift[0] + self._lift[1] * alpha,
            self._moment[0] + self._moment[1] * alpha,
        )

    def drag_over_lift(self, alpha: Array) -> Array:
        """Their ratio at several angles, same shape."""
        drag = self._drag[0] + self._drag[1] * alpha**2
        return np.asarray(drag / (self._lift[0] + self._lift[1] * alpha))


class LawPolar(Polar):
    """Of any hull law with the vehicle's fins at rest, evaluated at a glider's speed."""

    def __init__(self, vehicle: Vehicle):
        self._vehicle = vehicle
        self.valid_angle = min(vehicle.law.valid_angle, WIDEST)
        low, high = -self.valid_angle, self.valid_angle
        if not self.at(low)[1] < 0.0 < self.at(high)[1]:
            raise MissionError(
                f"vehicle {vehicle.name!r} has no lift to glide with: its lift does not change "
                f"sign within {math.degrees(high):.0f} deg of angle of attack"
            )
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.at(middle)[1] < 0.0 else (low, middle)
        self.zero_lift = 0.5 * (low + high)

    def at(self, alpha: float) -> tuple[float, float, float]:
        """Drag along the flow, lift across it, and the pitch moment, over speed squared."""
        ca, sa = math.cos(alpha), math.sin(alpha)
        nu_r = np.array([ca, 0.0, sa, 0.0, 0.0, 0.0]) * UNIT_SPEED
        density = self._vehicle.reference_density
        wrench = self._vehicle.law.wrench(nu_r, density)
        for part in self._vehicle.parts:
            wrench = wrench + part.wrench(part.rest, nu_r, density, 1e3)
        x, z, m = wrench[[0, 2, 4]] / UNIT_SPEED**2
        return float(-x * ca - z * sa), float(x * sa - z * ca), float(m)


def polar_of(vehicle: Vehicle) -> Polar:
    """The polar of a vehicle; raises VehicleError or MissionError when it cannot glide."""
    if isinstance(vehicle.law, FlowFrame):
        return FlowFramePolar(vehicle.name, vehicle.law)
    return LawPolar(vehicle)
