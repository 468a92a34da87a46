"""Near-inertial oscillation of the mixed layer."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from twin.compiled import borrowing
from twin.water.current import checks
from twin.water.current.axes import Origin, coriolis
from twin.water.current.base import Current
from twin.water.current.sampler import Floats


@borrowing
def slab(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Speed, signed angular rate (clockwise from above is +), angle at t 0, layer depth,
    1/decay depth below the layer."""
    angle = program[start + 2] + program[start + 1] * t
    below = depth - program[start + 3]
    speed = program[start]
    rate = 0.0
    if below >= 0.0:
        speed *= math.exp(-below * program[start + 4])
        rate = -r_d * program[start + 4]
    v_north = speed * math.cos(angle)
    v_east = speed * math.sin(angle)
    omega = r_t * program[start + 1]
    return (
        v_north,
        v_east,
        0.0,
        rate * v_north - omega * v_east,
        rate * v_east + omega * v_north,
        0.0,
    )


@dataclass(frozen=True, kw_only=True)
class Inertial(Current):
    """A slab that turns at the Coriolis frequency: clockwise in the north, period 12 h/sin(lat).

    Uniform in the mixed layer, falling by e over `decay_depth` below it. 0.05-0.1 m/s is usual
    after a storm (Pollard & Millard 1970).
    """

    kind: ClassVar[str] = "inertial"
    code: ClassVar[int] = 6
    payload_size: ClassVar[int] = 5
    directional: ClassVar[Any] = slab
    depends_on: ClassVar[tuple[str, ...]] = ("time", "depth")
    usage: ClassVar[Mapping[str, str]] = {
        "inertial:speed=0.08,layer=40": "near-inertial oscillation of the mixed layer"
    }
    settings: ClassVar[Mapping[str, str]] = {
        "speed": "speed",
        "layer": "layer_depth",
        "decay": "decay_depth",
        "direction": "direction_deg",
        "lat": "latitude_deg",
    }

    speed: float
    """[m/s] Speed in the mixed layer."""
    layer_depth: float = 40.0
    """[m] Depth of the mixed layer."""
    decay_depth: float = 10.0
    """[m] Depth over which the speed falls by e below the layer."""
    direction_deg: float = 0.0
    """[degree] Compass direction TOWARD which it flows at mission start."""
    latitude_deg: float | None = None
    """[degree] Latitude of the Coriolis parameter; None: the mission's origin."""

    def __post_init__(self) -> None:
        checks.speed(self.kind, "speed", self.speed)
        checks.not_negative(self.kind, "layer_depth", self.layer_depth, "m")
        checks.positive(self.kind, "decay_depth", self.decay_depth, "m")
        checks.finite(self.kind, "direction_deg", self.direction_deg, "degree")
        if self.latitude_deg is not None:
            checks.finite(self.kind, "latitude_deg", self.latitude_deg, "degree")

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Inertial:
        """With the latitude written out."""
        return replace(self, latitude_deg=self._latitude(origin or Origin()))

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record."""
        payload = [
            self.speed,
            coriolis(self._latitude(origin)),
            math.radians(self.direction_deg),
            self.layer_depth,
            1.0 / self.decay_depth,
        ]
        return [self.record(payload)]

    def _latitude(self, origin: Origin) -> float:
        return origin.latitude_deg if self.latitude_deg is None else self.latitude_deg
