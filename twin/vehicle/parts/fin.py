"""Fin: a rudder or elevator that turns about its span, with lift, drag and stall.

A fin of area A at r meets the flow v_rel + omega x r, taken in the plane of its section. Up to the
stall, C_L is C_La a at the angle of attack a; beyond, C_L changes with another slope, but not below
zero. C_D is C_D0 + C_Da |a|, with another slope beyond the stall, plus the induced drag
C_L^2 / (pi e AR) of a finite span (Prandtl). Lift is across the flow and drag along it:
F = rho A V^2 / 2 (C_L, C_D). Without the induced drag these are the formulas of the Gazebo plug-in
LiftDrag (gz-sim, Apache-2.0), for flow from any side.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from twin.compiled import elementary, jit
from twin.compiled.elementary import cross, dot, scalar
from twin.vehicle.changes import Uncertainty, coefficient, turned_encoder
from twin.vehicle.parts.base import Carrier, Part, Quantity

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

AREA, LIFT, STALL, LIFT_STALLED, DRAG0, DRAG, DRAG_STALLED, IN_HULL = range(8)
AXIS = 8  # and the two that follow
INDUCED, NEUTRAL = 11, 12
ASKEW = 0.2
"""Smallest ratio of a fin's smaller to its larger moment at which the fin serves both controls."""


@jit
def _section(values, along, across, density):  # type: ignore[no-untyped-def]
    """Force (along the chord, along its normal) [N] at the flow (along, across) [m/s]."""
    square = along * along + across * across
    if square < 1e-18:
        return 0.0, 0.0
    speed = math.sqrt(square)
    angle = math.atan2(across, abs(along))
    size = abs(angle)
    lift, drag = values[LIFT] * size, values[DRAG0] + values[DRAG] * size
    if size > values[STALL]:
        beyond = size - values[STALL]
        lift = max(values[LIFT] * values[STALL] + values[LIFT_STALLED] * beyond, 0.0)
        drag = values[DRAG0] + values[DRAG] * values[STALL] + values[DRAG_STALLED] * beyond
    drag += values[INDUCED] * lift * lift
    pressure = 0.5 * density * values[AREA] * square
    if angle < 0.0:
        lift = -lift
    if along < 0.0:
        lift = -lift
    cosine, sine = along / speed, across / speed
    return pressure * (lift * sine - drag * cosine), pressure * (-lift * cosine - drag * sine)


@jit
def _deflected(values, place, position, u, v, w, p, q, r, density):  # type: ignore[no-untyped-def]
    """Force [N] in body axes of the fin turned by `position` [rad]."""
    ax, ay, az = values[AXIS], values[AXIS + 1], values[AXIS + 2]
    # motion of the fin through the water
    fu = u + q * place[2] - r * place[1]
    fv = v + r * place[0] - p * place[2]
    fw = w + p * place[1] - q * place[0]
    # chord: forward turned about the span; normal: span x chord
    c, s = math.cos(position), math.sin(position)
    cx = c + (1.0 - c) * ax * ax
    cy = s * az + (1.0 - c) * ax * ay
    cz = -s * ay + (1.0 - c) * ax * az
    nx, ny, nz = ay * cz - az * cy, az * cx - ax * cz, ax * cy - ay * cx
    along = fu * cx + fv * cy + fw * cz
    across = fu * nx + fv * ny + fw * nz
    tangential, normal = _section(values, along, across, density)
    return (
        tangential * cx + normal * nx,
        tangential * cy + normal * ny,
        tangential * cz + normal * nz,
    )


@jit
def native_wrench(values, place, position, u, v, w, p, q, r, density, depth):  # type: ignore[no-untyped-def]
    """Force of the fin at its place and its moment about the CB."""
    turned = position - values[NEUTRAL]
    x, y, z = _deflected(values, place, turned, u, v, w, p, q, r, density)
    if values[IN_HULL] != 0.0:
        x0, y0, z0 = _deflected(values, place, 0.0, u, v, w, p, q, r, density)
        x, y, z = x - x0, y - y0, z - z0
    l = place[1] * z - place[2] * y
    m = place[2] * x - place[0] * z
    n = place[0] * y - place[1] * x
    return x, y, z, l, m, n


@scalar
def _coefficients(values, attack):  # type: ignore[no-untyped-def]
    """Coefficients (C_L, C_D) at an angle of attack within +-90 deg."""
    a, stall = abs(attack), values[STALL]
    c_l, c_d = values[LIFT] * a, values[DRAG0] + values[DRAG] * a
    if a > stall:
        c_l = max(values[LIFT] * stall + values[LIFT_STALLED] * (a - stall), 0.0)
        c_d = values[DRAG0] + values[DRAG] * stall + values[DRAG_STALLED] * (a - stall)
    return math.copysign(c_l, attack), c_d + values[INDUCED] * c_l * c_l


@scalar
def _fossen_force(values, place, position, velocity, rates, density):  # type: ignore[no-untyped-def]
    """Force by angles: drag against the flow in the plane of the section, lift across it."""
    span = (values[AXIS], values[AXIS + 1], values[AXIS + 2])
    turning = cross(rates, place)
    x, y, z = velocity[0] + turning[0], velocity[1] + turning[1], velocity[2] + turning[2]
    along = span[0] * x + span[1] * y + span[2] * z
    flow = (x - span[0] * along, y - span[1] * along, z - span[2] * along)
    square = dot(flow, flow)
    # chord of the fin at rest: forward in the plane of the section
    chord = math.sqrt(max(1.0 - span[0] * span[0], 1e-30))
    forward = (chord, -span[1] * span[0] / chord, -span[2] * span[0] / chord)
    side = cross(span, forward)
    # direction of the flow in the section, relative to the deflected chord
    course = elementary.atan2(dot(flow, side), dot(flow, forward)) - position
    if course > math.pi:
        course -= 2.0 * math.pi
    elif course < -math.pi:
        course += 2.0 * math.pi
    backward = abs(course) > 0.5 * math.pi
    attack = math.copysign(math.pi, course) - course if backward else course
    c_l, c_d = _coefficients(values, attack)
    if backward:
        c_l = -c_l
    speed = math.sqrt(square)
    pressure = 0.5 * density * values[AREA] * speed
    across = cross(span, flow)
    return (
        -pressure * (c_d * flow[0] + c_l * across[0]),
        -pressure * (c_d * flow[1] + c_l * across[1]),
        -pressure * (c_d * flow[2] + c_l * across[2]),
    )


@scalar
def fossen_wrench(values, place, position, u, v, w, p, q, r, density, depth):  # type: ignore[no-untyped-def]
    """Force of the fin and its moment about the CB."""
    velocity, rates = (u, v, w), (p, q, r)
    turned = position - values[NEUTRAL]
    x, y, z = _fossen_force(values, place, turned, velocity, rates, density)
    a, b, c = _fossen_force(values, place, 0.0, velocity, rates, density)
    if values[IN_HULL] != 0.0:
        x, y, z = x - a, y - b, z - c
    k, m, n = cross(place, (x, y, z))
    return x, y, z, k, m, n


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Fin(Part):
    """A fin on the hull; its position is the deflection, right-handed about its axis."""

    kind: ClassVar[str] = "fin"
    unit: ClassVar[str] = "rad"
    quantity: ClassVar[Quantity] = Quantity(
        unit="degree",
        scale=180.0 / np.pi,
        long_name="deflection, right-handed about its axis",
        limits=(-180.0, 180.0),
    )

    axis: tuple[float, float, float]
    """Unit vector of the span and hinge, body FRD, across the hull."""
    area: float
    """[m2] Area of all blades together."""
    lift_slope: float
    """[1/rad] Lift slope C_La up to the stall."""
    stall_angle: float = 0.35
    """[rad] Angle of attack at the stall."""
    stalled_lift_slope: float = -1.0
    """[1/rad] Slope of C_L beyond the stall."""
    zero_lift_drag: float = 0.0
    """Drag coefficient C_D0 without lift."""
    drag_slope: float = 0.0
    """[1/rad] Slope C_Da of the drag up to the stall."""
    stalled_drag_slope: float = 0.0
    """[1/rad] Slope of C_D beyond the stall."""
    induced_drag: float = 0.0
    """C_D per C_L^2: 1 / (pi e aspect ratio)."""
    neutral: float = 0.0
    """[rad] Position without deflection, from which deflections count; not 0 for a fin set to steer
    a slightly uneven hull straight."""
    in_hull: bool = False
    """True: the hull law contains the fin at rest, so only the deflection's force is added."""

    native_wrench = staticmethod(native_wrench)
    fossen_wrench = staticmethod(fossen_wrench)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Fields `NAME.axis` (forward, port, up as in MJCF), `.area`, `.lift_slope` and others."""
        axis = reader.flipped(f"{name}.axis", 3)
        size = math.sqrt(sum(x * x for x in axis))
        if not size > 0.0:
            reader.fail(f"<numeric name={name + '.axis'!r}>", "a vector along the fin's span")
        numbers = {
            field: reader.number(f"{name}.{field}", default=float(getattr(cls, field)))
            for field in _OPTIONAL
        }
        return {
            "axis": tuple(float(x) / size for x in axis),
            "area": reader.number(f"{name}.area"),
            "lift_slope": reader.number(f"{name}.lift_slope"),
            **numbers,
            "in_hull": reader.number(f"{name}.in_hull", default=0.0) != 0.0,
        }

    def problems(self) -> list[tuple[str, str]]:
        """Report also sizes, slopes and axes that no fin has."""
        positive = ("area", "lift_slope", "stall_angle")
        drags = ("zero_lift_drag", "drag_slope", "stalled_drag_slope", "induced_drag")
        found = super().problems()
        found += [(name, "positive") for name in positive if not getattr(self, name) > 0.0]
        rule = "at least 0: drag never drives"
        found += [(name, rule) for name in drags if getattr(self, name) < 0.0]
        if abs(self.axis[0]) > 1e-9:
            found.append(("axis", "across the hull: no part along x"))
        return found

    def values(self) -> tuple[float, ...]:
        """Values in the order of AREA to IN_HULL, then the axis, INDUCED and NEUTRAL."""
        names = ("area", "lift_slope", *_OPTIONAL[:-2], "in_hull")
        numbers = [float(getattr(self, name)) for name in names]
        return (*numbers, *self.axis, self.induced_drag, self.neutral)

    @property
    def rest(self) -> float:
        """Neutral position [rad], within the travel."""
        return min(max(self.neutral, self.low), self.high)

    def mirrored(self) -> float | None:
        """Factor -1 for rudders, 1 for elevators; None off the middle, askew or with `neutral`."""
        _, y, z = (abs(x) > 1e-9 for x in self.axis)
        if self.neutral or (y and z) or abs(self.position[1]) > 1e-9:
            return None
        return -1.0 if z else 1.0

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Base uncertainties, the zero of the encoder and the lift slope."""
        offset = turned_encoder(self.name, "fin")
        slope = coefficient("lift_slope", f"lift slope of the {self.name}", field="lift_slope")
        return (offset, *super().uncertainties(), slope)

    def controls(self) -> tuple[str, ...]:
        """Pitch for an elevator, heading for a rudder, both for a fin of an X tail."""
        pitch, yaw = np.abs(self.effectiveness()[4:])
        able = {"pitch": pitch >= ASKEW * yaw and pitch > 0.0, "heading": yaw >= ASKEW * pitch}
        return tuple(control for control, does in able.items() if does)

    def sense(self, axis: str) -> float:
        """Sign of the fin's moment at its place and axis."""
        return math.copysign(1.0, self.effectiveness()[4 if axis == "pitch" else 5])

    @property
    def drawn_axis(self) -> tuple[float, float, float]:
        """Hinge axis of the fin."""
        return self.axis

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Sample a deflection up to half of the travel to either side."""
        return float(0.5 * min(self.high, -self.low) * rng.uniform(-1.0, 1.0))


_OPTIONAL = (
    "stall_angle", "stalled_lift_slope", "zero_lift_drag", "drag_slope", "stalled_drag_slope",
    "induced_drag", "neutral",
)  # fmt: skip
