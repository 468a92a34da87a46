"""Airbrake: a vehicle part that swings flaps out of the hull and slows it down."""

import dataclasses

from twin.compiled import jit
from twin.compiled.elementary import cross, scalar
from twin.vehicle.parts import Part, Quantity, register


@jit
def native_wrench(values, place, position, u, v, w, p, q, r, density, depth):
    """X, Y, Z [N] and K, M, N [N m] about the centre of buoyancy."""
    drag = -0.5 * density * values[0] * position * u * abs(u)
    return drag, 0.0, 0.0, 0.0, place[2] * drag, -place[1] * drag


@scalar
def fossen_wrench(values, place, position, u, v, w, p, q, r, density, depth):
    """Force and moment by vectors: the two models share no code."""
    force = (-0.5 * density * values[0] * position * u * abs(u), 0.0, 0.0)
    moment = cross(place, force)
    return force[0], 0.0, 0.0, moment[0], moment[1], moment[2]


@register
@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Airbrake(Part):
    """Flaps that swing out of the hull and slow it down."""

    kind = "airbrake"
    unit = "1"
    quantity = Quantity(unit="1", scale=1.0, long_name="part swung out")
    native_wrench = staticmethod(native_wrench)
    fossen_wrench = staticmethod(fossen_wrench)

    drag_area: float
    """[m2] drag coefficient times area when swung out"""

    @classmethod
    def own_parameters(cls, reader, name):
        return {"drag_area": reader.number(f"{name}.drag_area")}

    def values(self):
        return (self.drag_area,)
