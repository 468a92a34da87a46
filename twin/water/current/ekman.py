"""Wind-driven Ekman spiral."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from twin.compiled import borrowing
from twin.errors import CurrentError
from twin.water.current import checks
from twin.water.current.axes import Origin, coriolis
from twin.water.current.base import Current
from twin.water.current.sampler import Floats

LOWEST_LATITUDE = 2.0
"""[degree] Nearer to the equator f vanishes and the steady Ekman balance does not hold."""


@borrowing
def spiral(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Surface speed, 1/depth scale, surface angle from north, sense (+1 N, -1 S hemisphere)."""
    inverse = program[start + 1]
    decay = program[start] * math.exp(-depth * inverse)
    angle = program[start + 2] + program[start + 3] * depth * inverse
    v_north = decay * math.cos(angle)
    v_east = decay * math.sin(angle)
    rate = r_d * inverse
    turn = program[start + 3] * rate
    return (
        v_north,
        v_east,
        0.0,
        -rate * v_north - turn * v_east,
        -rate * v_east + turn * v_north,
        0.0,
    )


@dataclass(frozen=True, kw_only=True)
class Ekman(Current):
    """Steady Ekman layer of constant eddy viscosity in deep water.

    Speed V0 exp(-depth/d), V0 = stress/(density sqrt(viscosity |f|)), d = sqrt(2 viscosity/|f|);
    45 degrees to the right of the wind at the surface and turning right with depth, to the left
    south of the equator (Ekman 1905). The transport stress/(density |f|) does not depend on the
    viscosity.
    """

    kind: ClassVar[str] = "ekman"
    code: ClassVar[int] = 3
    payload_size: ClassVar[int] = 4
    directional: ClassVar[Any] = spiral
    depends_on: ClassVar[tuple[str, ...]] = ("depth",)
    usage: ClassVar[Mapping[str, str]] = {
        "ekman:tau=0.1,direction=90": "wind stress Pa, degrees the wind blows toward"
    }
    settings: ClassVar[Mapping[str, str]] = {
        "tau": "stress",
        "stress": "stress",
        "direction": "direction_deg",
        "viscosity": "viscosity",
        "az": "viscosity",
        "density": "density",
        "lat": "latitude_deg",
    }

    stress: float
    """[Pa] Wind stress; about 0.1 for a wind of 8 m/s."""
    direction_deg: float
    """[degree] Compass direction TOWARD which the wind blows."""
    viscosity: float = 0.02
    """[m2/s] Vertical eddy viscosity."""
    density: float = 1025.0
    """[kg/m3] Density of the water."""
    latitude_deg: float | None = None
    """[degree] Latitude of the Coriolis parameter; None: the mission's origin."""

    def __post_init__(self) -> None:
        checks.not_negative(self.kind, "stress", self.stress, "Pa")
        checks.finite(self.kind, "direction_deg", self.direction_deg, "degree")
        checks.positive(self.kind, "viscosity", self.viscosity, "m2/s")
        checks.positive(self.kind, "density", self.density, "kg/m3")
        if self.latitude_deg is not None:
            checks.finite(self.kind, "latitude_deg", self.latitude_deg, "degree")

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Ekman:
        """With the latitude written out."""
        return replace(self, latitude_deg=self._latitude(origin or Origin()))

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record."""
        latitude = self._latitude(origin)
        if abs(latitude) < LOWEST_LATITUDE:
            raise CurrentError(
                f"ekman: latitude_deg {latitude:g} is within {LOWEST_LATITUDE:g} degree of the"
                " equator, where no Ekman balance exists; use a profile"
            )
        f = coriolis(latitude)
        speed = self.stress / (self.density * math.sqrt(self.viscosity * abs(f)))
        depth = math.sqrt(2.0 * self.viscosity / abs(f))
        sense = math.copysign(1.0, f)
        angle = math.radians(self.direction_deg) + sense * math.pi / 4.0
        checks.speed(self.kind, "surface speed", speed)
        return [self.record(speed, 1.0 / depth, angle, sense)]

    def _latitude(self, origin: Origin) -> float:
        return origin.latitude_deg if self.latitude_deg is None else self.latitude_deg
