"""Thruster: a ducted screw along any axis, by its command; and a tether, a drag without an axis.

A thruster's position is the command c that its controller follows, -1 to 1: pulse width from the
middle over half its range. Within the dead band d it stands. Beyond, with s = (|c| - d) / (1 - d),

    T = T_max ((1 - e) s + e s^2 - s u_a / V_0)

T_max is the thrust at full command, another one astern, and e the curvature of the published curve,
as in ArduPilot's MOT_THST_EXPO. The last term is the loss with the speed of advance u_a of a linear
open-water diagram (Fossen 2011, section 9.1.1): V_0 is the advance without thrust at full command.
Reaction torques are left out: maker's pairs turn against each other.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from twin.compiled import elementary, jit
from twin.compiled.elementary import cross, dot, scalar
from twin.vehicle.changes import Uncertainty, coefficient
from twin.vehicle.parts.base import Array, Carrier, Losses, Move, Part, Quantity

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

FIELDS = ("ahead", "astern", "dead_band", "curvature", "zero_thrust_speed", "diameter")
AHEAD, ASTERN, DEAD, CURVATURE, ZERO, DIAMETER = range(6)
AXIS = 6  # and the two that follow


@jit
def native_wrench(values, place, position, u, v, w, p, q, r, density, depth):  # type: ignore[no-untyped-def]
    """Thrust along the axis at the thruster's place, and its moment about the CB."""
    ax, ay, az = values[AXIS], values[AXIS + 1], values[AXIS + 2]
    part = max(abs(position) - values[DEAD], 0.0) / (1.0 - values[DEAD])
    advance = (u + q * place[2] - r * place[1]) * ax
    advance += (v + r * place[0] - p * place[2]) * ay
    advance += (w + p * place[1] - q * place[0]) * az
    curve = part * (1.0 - values[CURVATURE] + values[CURVATURE] * part)
    # only the part of the disc under water gives thrust
    x = min(max(2.0 * depth / values[DIAMETER], -1.0), 1.0)
    wet = 0.5 + (x * math.sqrt(1.0 - x * x) + math.asin(x)) / math.pi
    if position >= 0.0:
        thrust = values[AHEAD] * (curve - part * advance / values[ZERO])
    else:
        thrust = -values[ASTERN] * (curve + part * advance / values[ZERO])
    thrust *= wet
    x, y, z = thrust * ax, thrust * ay, thrust * az
    return (
        x, y, z,
        place[1] * z - place[2] * y, place[2] * x - place[0] * z, place[0] * y - place[1] * x,
    )  # fmt: skip


@scalar
def fossen_wrench(values, place, position, u, v, w, p, q, r, density, depth):  # type: ignore[no-untyped-def]
    """Thrust and moment by vectors, with the curve as a polynomial of the command."""
    axis = (values[AXIS], values[AXIS + 1], values[AXIS + 2])
    turning = cross((p, q, r), place)
    ahead = dot(axis, (u + turning[0], v + turning[1], w + turning[2]))
    sign = math.copysign(1.0, position)
    largest = 0.5 * ((1.0 + sign) * values[AHEAD] + (1.0 - sign) * values[ASTERN])
    beyond = max(sign * position - values[DEAD], 0.0) / (1.0 - values[DEAD])
    slope = 1.0 - values[CURVATURE] - sign * ahead / values[ZERO]
    cosine = min(max(-2.0 * depth / values[DIAMETER], -1.0), 1.0)
    half, sine = elementary.acos(cosine), math.sqrt(abs((1.0 - cosine) * (1.0 + cosine)))
    wet = (half - sine * cosine) / math.pi
    size = wet * sign * largest * beyond * (slope + values[CURVATURE] * beyond)
    force = (size * axis[0], size * axis[1], size * axis[2])
    moment = cross(place, force)
    return force[0], force[1], force[2], moment[0], moment[1], moment[2]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Thruster(Part):
    """A ducted screw; its position is its command, positive pushes the hull along its axis."""

    kind: ClassVar[str] = "thruster"
    unit: ClassVar[str] = "1"
    quantity: ClassVar[Quantity] = Quantity(
        unit="1", scale=1.0, long_name="command, along its axis positive", limits=(-1.0, 1.0)
    )
    turn: ClassVar[int] = 45

    axis: tuple[float, float, float]
    """Unit vector of the thrust on the hull at a positive command, body FRD."""
    ahead: float
    """[N] Thrust at rest and full command."""
    astern: float
    """[N] Magnitude of the thrust at rest and full reverse."""
    dead_band: float
    """[1] Command below which the screw stands."""
    curvature: float
    """[1] Share of the curve that is quadratic, 0 to 1."""
    zero_thrust_speed: float
    """[m/s] Speed of advance without thrust at full command."""
    diameter: float
    """[m] Diameter of the screw."""
    power: float = 0.0
    """[W] Electrical power at full command; it goes as the thrust at rest to the power 1.5."""

    native_wrench = staticmethod(native_wrench)
    fossen_wrench = staticmethod(fossen_wrench)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Fields `NAME.axis`, in the file's axes; others as `NAME.field`, else `thruster.field`."""

        def one(field: str) -> float:
            own = f"{name}.{field}"
            default = 0.0 if field == "power" else None
            if own in reader.numerics:
                return reader.number(own)
            return reader.number(f"{cls.kind}.{field}", default=default)

        axis = reader.flipped(f"{name}.axis", 3)
        size = float(np.linalg.norm(axis))
        if not size > 0.0:
            reader.fail(f"<numeric name='{name}.axis'>", "a direction: at least one number not 0")
        return {"axis": tuple((axis / size).tolist())} | {f: one(f) for f in (*FIELDS, "power")}

    def problems(self) -> list[tuple[str, str]]:
        """Report also thrusts and sizes that no thruster has."""
        found = super().problems()
        sizes = ("ahead", "astern", "zero_thrust_speed", "diameter")
        found += [(name, "positive") for name in sizes if not getattr(self, name) > 0.0]
        if not 0.0 <= self.dead_band < 1.0:
            found.append(("dead_band", "at least 0 and below 1"))
        if not 0.0 <= self.curvature <= 1.0:
            found.append(("curvature", "0 (linear) to 1 (quadratic)"))
        if not (-1.0 <= self.low <= 0.0 <= self.high <= 1.0):
            found.append(("actrange", "within '-1 1' and around 0"))
        return found

    def values(self) -> tuple[float, ...]:
        """Values in the order of AHEAD to AXIS."""
        return (*(getattr(self, name) for name in FIELDS), *self.axis)

    def mirrored(self) -> float | None:
        """None: the mirror image of a thruster is another thruster."""
        return None

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Base uncertainties and the thrust each way, which falls as the battery empties."""
        return (
            *super().uncertainties(),
            *(
                coefficient(f"thrust_{way}", f"thrust {way} of the {self.name}", field=way)
                for way in ("ahead", "astern")
            ),
        )

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Electrical energy [J] by the command alone: the maker's curve at rest."""
        command = np.abs(0.5 * np.add(move.before, move.after, dtype=float))
        part = np.maximum(command - self.dead_band, 0.0) / (1.0 - self.dead_band)
        thrust = part * (1.0 - self.curvature + self.curvature * part)
        return np.asarray(self.power * thrust**1.5 * np.asarray(move.duration))

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Sample a command of at most a quarter; pushed harder at random, the hull tumbles."""
        return float(0.25 * rng.uniform(self.low, self.high))


@jit
def native_drag(values, place, position, u, v, w, p, q, r, density, depth):  # type: ignore[no-untyped-def]
    """Drag against the motion of the tether's end, and its moment about the CB."""
    a = u + q * place[2] - r * place[1]
    b = v + r * place[0] - p * place[2]
    c = w + p * place[1] - q * place[0]
    pull = -0.5 * density * values[0] * position * math.sqrt(a * a + b * b + c * c)
    x, y, z = pull * a, pull * b, pull * c
    return (
        x, y, z,
        place[1] * z - place[2] * y, place[2] * x - place[0] * z, place[0] * y - place[1] * x,
    )  # fmt: skip


@scalar
def fossen_drag(values, place, position, u, v, w, p, q, r, density, depth):  # type: ignore[no-untyped-def]
    """Drag of the tether's end and its moment, by vectors."""
    turning = cross((p, q, r), place)
    end = (u + turning[0], v + turning[1], w + turning[2])
    size = 0.5 * density * values[0] * position * math.sqrt(dot(end, end))
    force = (-size * end[0], -size * end[1], -size * end[2])
    moment = cross(place, force)
    return force[0], force[1], force[2], moment[0], moment[1], moment[2]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Tether(Part):
    """A neutrally buoyant cable; its position is the length in the water, by hand or winch.

    To first order it is straight. Its upper end stands and each piece moves in proportion to its
    distance from there, so a quarter of 0.5 rho C_D d L U^2 pulls at the vehicle (moments about the
    upper end). In a current that all of it meets, the share is half.
    """

    kind: ClassVar[str] = "tether"
    unit: ClassVar[str] = "m"
    quantity: ClassVar[Quantity] = Quantity(
        unit="m", scale=1.0, long_name="length in the water", limits=(0.0, 1e4)
    )
    turn: ClassVar[int] = 55

    diameter: float
    """[m] Diameter of the cable."""
    drag_coefficient: float
    """[1] C_D across a cylinder."""
    share: float
    """[1] Share of the whole cable's drag at the vehicle: 0.25 in still water, 0.5 in a current."""

    native_wrench = staticmethod(native_drag)
    fossen_wrench = staticmethod(fossen_drag)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Fields `NAME.diameter`, `.drag_coefficient` and `.share`."""
        fields = ("diameter", "drag_coefficient", "share")
        return {field: reader.number(f"{name}.{field}") for field in fields}

    def problems(self) -> list[tuple[str, str]]:
        """Report also a drag that would drive, and a negative length."""
        found = super().problems()
        fields = ("diameter", "drag_coefficient", "share")
        found += [(name, "at least 0") for name in fields if getattr(self, name) < 0.0]
        return found + ([("actrange", "at least 0")] if self.low < 0.0 else [])

    def values(self) -> tuple[float, ...]:
        """Drag width [m] at the vehicle's end for each length in the water."""
        return (self.share * self.drag_coefficient * self.diameter,)

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Base uncertainties and the drag."""
        drag = coefficient("drag", f"drag of the {self.name}", field="drag_coefficient")
        return (*super().uncertainties(), drag)
