"""Turbulent bottom layer with a logarithmic profile."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from twin.compiled import borrowing
from twin.errors import CurrentError
from twin.water.current import checks
from twin.water.current.axes import Origin
from twin.water.current.base import Current
from twin.water.current.sampler import Floats

VON_KARMAN = 0.41
"""Von Karman's constant."""


@borrowing
def wall_layer(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """(u*/kappa) north, east; water depth; roughness length; layer thickness."""
    height = program[start + 2] - depth
    rate = 0.0
    if height <= program[start + 3]:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if height < program[start + 4]:
        rate = -r_d / height
    else:
        height = program[start + 4]
    log = math.log(height / program[start + 3])
    v_north = program[start]
    v_east = program[start + 1]
    return v_north * log, v_east * log, 0.0, v_north * rate, v_east * rate, 0.0


@dataclass(frozen=True, kw_only=True)
class LogLayer(Current):
    """U = (u*/0.41) ln(h/z0) with h the height above the bottom, at most `thickness`.

    Above the layer the speed at its top is held; below the roughness length it is zero.
    """

    kind: ClassVar[str] = "log-layer"
    code: ClassVar[int] = 7
    payload_size: ClassVar[int] = 5
    directional: ClassVar[Any] = wall_layer
    depends_on: ClassVar[tuple[str, ...]] = ("depth",)
    usage: ClassVar[Mapping[str, str]] = {
        "log-layer:friction=0.01,direction=0,bottom=100": "turbulent layer above the sea floor, m"
    }
    settings: ClassVar[Mapping[str, str]] = {
        "friction": "friction_velocity",
        "direction": "direction_deg",
        "bottom": "water_depth",
        "roughness": "roughness",
        "thickness": "thickness",
    }

    friction_velocity: float
    """[m/s] u*; about 1/25 of the speed above the layer."""
    direction_deg: float
    """[degree] Compass direction TOWARD which the water flows."""
    water_depth: float
    """[m] Depth of the bottom."""
    roughness: float = 1e-3
    """[m] Roughness length z0; 1e-4 mud to 6e-3 gravel (Soulsby 1997)."""
    thickness: float = 20.0
    """[m] Height of the layer's top above the bottom."""

    def __post_init__(self) -> None:
        checks.not_negative(self.kind, "friction_velocity", self.friction_velocity, "m/s")
        checks.finite(self.kind, "direction_deg", self.direction_deg, "degree")
        checks.positive(self.kind, "water_depth", self.water_depth, "m")
        checks.positive(self.kind, "roughness", self.roughness, "m")
        checks.positive(self.kind, "thickness", self.thickness, "m")
        if self.thickness <= self.roughness:
            raise CurrentError(
                f"log-layer: thickness {self.thickness:g} m must exceed the roughness length"
                f" {self.roughness:g} m"
            )
        top = self.friction_velocity / VON_KARMAN * math.log(self.thickness / self.roughness)
        checks.speed(self.kind, "speed at the layer's top", top)

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record."""
        angle = math.radians(self.direction_deg)
        scale = self.friction_velocity / VON_KARMAN
        payload = [
            scale * math.cos(angle),
            scale * math.sin(angle),
            self.water_depth,
            self.roughness,
            self.thickness,
        ]
        return [self.record(payload)]
