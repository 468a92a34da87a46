"""Wind-driven Ekman spiral."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from twin.errors import CurrentError
from twin.water.current import arguments as checks
from twin.water.current import program as layout
from twin.water.current.base import Current
from twin.water.current.origin import Origin, coriolis
from twin.water.current.program import Floats

LOWEST_LATITUDE = 2.0
"""[degree] Nearer to the equator f vanishes and the steady Ekman balance does not hold."""


@dataclass(frozen=True, kw_only=True)
class Ekman(Current):
    """Steady Ekman layer of constant eddy viscosity in deep water.

    Speed V0 exp(-depth/d), V0 = stress/(density sqrt(viscosity |f|)), d = sqrt(2 viscosity/|f|);
    45 degrees to the right of the wind at the surface and turning right with depth, to the left
    south of the equator (Ekman 1905). The transport stress/(density |f|) does not depend on the
    viscosity.
    """

    kind: ClassVar[str] = "ekman"

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
        return [layout.record(layout.EKMAN, [speed, 1.0 / depth, angle, sense])]

    def _latitude(self, origin: Origin) -> float:
        return origin.latitude_deg if self.latitude_deg is None else self.latitude_deg
