"""A current that is the same everywhere and always."""

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
class Uniform(Current):
    """Constant velocity of the water in NED."""

    kind: ClassVar[str] = "uniform"

    north: float = 0.0
    """[m/s] Toward north."""

    east: float = 0.0
    """[m/s] Toward east."""

    down: float = 0.0
    """[m/s] Toward the bottom."""

    def __post_init__(self) -> None:
        for name in ("north", "east", "down"):
            value = checks.speed(self.kind, name, getattr(self, name))
            object.__setattr__(self, name, value)

    @classmethod
    def toward(cls, speed: float, direction_deg: float) -> Uniform:
        """Horizontal flow of `speed` [m/s] toward the compass direction [degree]."""
        angle = math.radians(direction_deg)
        return cls(north=speed * math.cos(angle), east=speed * math.sin(angle))

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record."""
        return [layout.record(layout.UNIFORM, [self.north, self.east, self.down])]
