"""Kinds of one's own in one new file: a part, a hull law and a kind of mission segment."""

import dataclasses
from typing import ClassVar

import numpy as np

from twin.compiled import jit
from twin.compiled.elementary import cross, scalar
from twin.mission.segments import Hold
from twin.mission.segments import register as register_segment
from twin.vehicle.laws import HullLaw
from twin.vehicle.laws import register as register_law
from twin.vehicle.parts import Part
from twin.vehicle.parts import register as register_part
from twin.vehicle.parts.base import Quantity


@jit
def native_push(values, place, position, u, v, w, p, q, r, density, depth):
    return position, 0.0, 0.0, 0.0, place[2] * position, -place[1] * position


@scalar
def fossen_push(values, place, position, u, v, w, p, q, r, density, depth):
    force = (position, 0.0, 0.0)
    k, m, n = cross(place, force)
    return force[0], force[1], force[2], k, m, n


@register_part
@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Waterjet(Part):
    """A force along the hull."""

    kind: ClassVar[str] = "waterjet"
    unit: ClassVar[str] = "N"
    quantity: ClassVar[Quantity] = Quantity(
        unit="N", scale=1.0, long_name="thrust", limits=(-1e3, 1e3)
    )
    native_wrench = staticmethod(native_push)
    fossen_wrench = staticmethod(fossen_push)

    def controls(self):
        return ("speed",)


@jit
def native_drag(c, density, u, v, w, p, q, r):
    return -c[0] * u, -c[1] * v, -c[1] * w, -c[2] * p, -c[2] * q, -c[2] * r


@jit
def native_damping(c, timestep, density, u, v, w, p, q, r):
    return -timestep * c[2], -timestep * c[2], -timestep * c[2]


@scalar
def fossen_drag(c, density, u, v, w, p, q, r):
    return -(c[0] * u), -(c[1] * v), -(c[1] * w), -(c[2] * p), -(c[2] * q), -(c[2] * r)


@register_law
@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class LinearDrag(HullLaw):
    """Drag in proportion to the velocity."""

    kind: ClassVar[str] = "linear-drag"
    native_wrench = staticmethod(native_drag)
    native_rate_damping = staticmethod(native_damping)
    fossen_wrench = staticmethod(fossen_drag)

    drag: tuple[float, float, float]

    @classmethod
    def read(cls, reader):
        return cls(drag=reader.numeric("linear_drag", 3))

    def values(self):
        return np.array(self.drag)


@register_segment
@dataclasses.dataclass(frozen=True, kw_only=True)
class Push(Hold):
    """A hold with a thrust."""

    kind: ClassVar[str] = "push"
    thrust_n: float = 0.0

    def row(self, vehicle, label):
        return dataclasses.replace(self, parts={"jet": self.thrust_n}).held(vehicle, label)

    def held(self, vehicle, label):
        return Hold.row(self, vehicle, label)
