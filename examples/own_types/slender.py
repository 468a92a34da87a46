"""Slender: a hull law of lift, drag and cross-flow drag of a body of revolution."""

import dataclasses
import math

import numpy as np

from twin.compiled import jit
from twin.compiled.elementary import scalar
from twin.vehicle.laws import HullLaw, register


@jit
def native_wrench(c, density, u, v, w, p, q, r):
    """X, Y, Z [N] and K, M, N [N m] about the centre of buoyancy."""
    side = c[1] * abs(u) + c[2] * np.sqrt(v * v + w * w)
    return (
        -c[0] * u * abs(u),
        -side * v,
        -side * w,
        -c[4] * p,
        -c[3] * u * w - c[5] * q,
        c[3] * u * v - c[5] * r,
    )


@jit
def native_rate_damping(c, timestep, density, u, v, w, p, q, r):
    """timestep * dK/dp, dM/dq, dN/dr [kg m2]."""
    return -timestep * c[4], -timestep * c[5], -timestep * c[5]


@scalar
def fossen_wrench(c, density, u, v, w, p, q, r):
    """Force and moment as a matrix times the motion."""
    along = c[0] * abs(u)
    across = c[1] * abs(u) + c[2] * math.sqrt(v * v + w * w)
    turn = c[3] * u
    return (
        -along * u,
        -across * v,
        -across * w,
        -c[4] * p,
        -turn * w - c[5] * q,
        turn * v - c[5] * r,
    )


@register
@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Slender(HullLaw):
    """A body of revolution: drag along it, lift and cross-flow drag across it, damped rates."""

    kind = "slender"
    native_wrench = staticmethod(native_wrench)
    native_rate_damping = staticmethod(native_rate_damping)
    fossen_wrench = staticmethod(fossen_wrench)

    coefficients: tuple[float, ...]
    """drag, lift, cross-flow drag [kg/m], static moment [kg], damping of roll and of pitch and
    yaw [N m s]"""

    @classmethod
    def read(cls, reader):
        return cls(coefficients=reader.numeric("slender", 6))

    def values(self):
        return np.array(self.coefficients)
