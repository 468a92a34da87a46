"""Grid floor: depths made in Python, in metres north and east of the mission's start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from twin.errors import FloorError
from twin.numbers import numbers
from twin.water.current.origin import Origin
from twin.water.floor.base import Array, Floor
from twin.water.floor.flat import DEEPEST_M
from twin.water.floor.lookup import pack

HIGHEST_M = 9_000.0
"""[m] no land is higher"""
FINEST_M = 0.5
"""[m] The hull meets the plane through the floor fore and aft and on both sides of it, half a hull
away: what is smaller than a hull belongs into the vehicle file, as geoms."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GridFloor(Floor):
    """Depths on a rectilinear grid; bilinear between its nodes, its edges held beyond it."""

    kind: ClassVar[str] = "grid"

    north_m: Any
    """[m] of the start, ascending, shape (n,), n at least 2"""
    east_m: Any
    """[m] of the start, ascending, shape (m,), m at least 2"""
    depth_m: Any
    """[m] positive down, shape (n, m); negative is land"""

    def __post_init__(self) -> None:
        for name in ("north_m", "east_m", "depth_m"):
            values = numbers(getattr(self, name), f"grid sea floor: {name}", FloorError)
            if not np.isfinite(values).all():
                raise FloorError(f"grid sea floor: {name} holds values that are not finite")
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        for name in ("north_m", "east_m"):
            axis = getattr(self, name)
            if axis.ndim != 1 or axis.size < 2 or np.diff(axis).min() < FINEST_M:
                raise FloorError(
                    f"grid sea floor: {name} must be a vector of two or more values that rise by "
                    f"at least {FINEST_M:g} m each"
                )
        shape = (self.north_m.size, self.east_m.size)
        if self.depth_m.shape != shape:
            turned = " (transpose it)" if self.depth_m.T.shape == shape else ""
            raise FloorError(
                f"grid sea floor: depth_m has shape {self.depth_m.shape}, north_m and east_m say "
                f"{shape}{turned}"
            )
        check_depths("grid sea floor", self.depth_m)

    def compile(self, duration_s: float, origin: Origin | None = None) -> Array:
        """The grid as it is."""
        return pack(self.north_m, self.east_m, self.depth_m)


def check_depths(label: str, depth: Array) -> None:
    """Refuse depths [m] that no sea floor has; raises FloorError."""
    lowest, highest = float(depth.max()), float(-depth.min())
    if lowest > DEEPEST_M or highest > HIGHEST_M:
        raise FloorError(
            f"{label}: depths from {-highest:g} to {lowest:g} m: possible are {-HIGHEST_M:g} "
            f"(land) to {DEEPEST_M:g} m, positive down; wrong units, or missing values without a "
            "_FillValue"
        )
