"""Geostrophic current with an exponential vertical shear."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from twin.water.current import arguments as checks
from twin.water.current import program as layout
from twin.water.current.base import Current
from twin.water.current.origin import Origin
from twin.water.current.program import Floats


@dataclass(frozen=True, kw_only=True)
class Geostrophic(Current):
    """U(depth) = barotropic + baroclinic exp(-depth/scale).

    A scale of 300-1000 m is usual; a north-east Atlantic profile fits about 800 m.
    """

    kind: ClassVar[str] = "geostrophic"

    baroclinic: float
    """[m/s] Surface speed of the sheared part."""

    direction_deg: float
    """[degree] Compass direction TOWARD which the sheared part flows."""

    scale_depth: float = 800.0
    """[m] Depth over which the sheared part falls by e."""

    barotropic: float = 0.0
    """[m/s] Speed of the part that does not depend on depth."""

    barotropic_direction_deg: float | None = None
    """[degree] Compass direction TOWARD which that part flows; None: as the sheared part."""

    def __post_init__(self) -> None:
        checks.speed(self.kind, "baroclinic", self.baroclinic)
        checks.speed(self.kind, "barotropic", self.barotropic)
        checks.finite(self.kind, "direction_deg", self.direction_deg, "degree")
        checks.positive(self.kind, "scale_depth", self.scale_depth, "m")
        if self.barotropic_direction_deg is not None:
            checks.finite(
                self.kind, "barotropic_direction_deg", self.barotropic_direction_deg, "degree"
            )

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record."""
        sheared = math.radians(self.direction_deg)
        other = self.barotropic_direction_deg
        constant = sheared if other is None else math.radians(other)
        payload = [
            self.barotropic * math.cos(constant),
            self.barotropic * math.sin(constant),
            self.baroclinic * math.cos(sheared),
            self.baroclinic * math.sin(sheared),
            1.0 / self.scale_depth,
        ]
        return [layout.record(layout.GEOSTROPHIC, payload)]
