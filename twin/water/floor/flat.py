"""Flat floor: one depth everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twin.errors import FloorError
from twin.numbers import number
from twin.water.current.origin import Origin
from twin.water.floor.base import Array, Floor
from twin.water.floor.lookup import pack

DEEPEST_M = 12_000.0
"""[m] the deepest sea has 10 935 m"""


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatFloor(Floor):
    """The same depth everywhere."""

    kind: ClassVar[str] = "flat"

    depth_m: float
    """[m] below the mean sea surface, above 0"""

    def __post_init__(self) -> None:
        depth = number(self.depth_m, "flat sea floor: depth_m [m]", FloorError)
        object.__setattr__(self, "depth_m", depth)
        if not (math.isfinite(depth) and 0.0 < depth <= DEEPEST_M):
            raise FloorError(
                f"flat sea floor: depth_m = {depth:g} m must be above 0 and at most "
                f"{DEEPEST_M:g} m, positive down"
            )

    def compile(self, duration_s: float, origin: Origin | None = None) -> Array:
        """One node."""
        return pack(np.zeros(1), np.zeros(1), np.full((1, 1), self.depth_m))
