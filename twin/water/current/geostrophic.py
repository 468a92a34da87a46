"""Geostrophic current with an exponential vertical shear."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from twin.compiled import borrowing
from twin.water.current import checks
from twin.water.current.axes import Origin
from twin.water.current.base import Current
from twin.water.current.sampler import Floats


@borrowing
def shear(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Barotropic north, east; baroclinic surface north, east; 1/scale depth."""
    inverse = program[start + 4]
    decay = math.exp(-depth * inverse)
    v_north = program[start + 2] * decay
    v_east = program[start + 3] * decay
    rate = -r_d * inverse
    return (
        program[start] + v_north,
        program[start + 1] + v_east,
        0.0,
        rate * v_north,
        rate * v_east,
        0.0,
    )


@dataclass(frozen=True, kw_only=True)
class Geostrophic(Current):
    """U(depth) = barotropic + baroclinic exp(-depth/scale).

    A scale of 300-1000 m is usual; a north-east Atlantic profile fits about 800 m.
    """

    kind: ClassVar[str] = "geostrophic"
    code: ClassVar[int] = 4
    payload_size: ClassVar[int] = 5
    directional: ClassVar[Any] = shear
    depends_on: ClassVar[tuple[str, ...]] = ("depth",)
    usage: ClassVar[Mapping[str, str]] = {
        "geostrophic:surface=0.2,direction=45,scale=800,barotropic=0.05": "m/s, degrees toward, m"
    }
    settings: ClassVar[Mapping[str, str]] = {
        "surface": "baroclinic",
        "speed": "baroclinic",
        "direction": "direction_deg",
        "scale": "scale_depth",
        "barotropic": "barotropic",
        "barotropic_direction": "barotropic_direction_deg",
    }

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
        return [self.record(payload)]
