"""Rough floor: a slope with a random relief on it, laid out from a few numbers.

The relief has the covariance of Goff and Jordan (1988, J. Geophys. Res. 93, 13589) with the Hurst
exponent 1: H^2 (r/L) K_1(r/L) at a distance r, with K_1 the modified Bessel function. H is the
standard deviation and L the correlation length; the correlation is 0.60 at L and 0.28 at 2 L. It is
a sum of plane waves whose wave numbers follow that spectrum, down to waves as long as L, with
random directions and phases: two floors of one seed agree wherever both are laid out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twin.errors import FloorError
from twin.numbers import Array, number
from twin.water.current.axes import Origin
from twin.water.floor.base import DEEPEST_M, LARGEST, SPEED, Floor
from twin.water.floor.bathymetry import FINEST_M
from twin.water.floor.lookup import pack

WAVES = 64
"""Of the relief; more change its look little and cost as much again"""
NODES = 4
"""In a correlation length and in the shortest wave"""
FIELDS = (
    "depth_m", "height_m", "length_m", "slope", "slope_direction_deg", "shallowest_m", "deepest_m",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class RoughFloor(Floor):
    """A tilted floor with hills: depths on a grid, bilinear between its nodes."""

    kind: ClassVar[str] = "rough"

    depth_m: float
    """[m] mean depth at the mission's start"""
    height_m: float = 2.0
    """[m] standard deviation of the relief; 0: none"""
    length_m: float = 400.0
    """[m] correlation length of the relief"""
    slope: float = 0.0
    """[1] of the mean depth, at least 0; continental shelves have about 0.002 (Shepard 1963)"""
    slope_direction_deg: float = 0.0
    """[deg true] in which it gets deeper"""
    seed: int = 0
    """Of the relief, from 0 on"""
    shallowest_m: float = 5.0
    """[m] what would reach higher is cut off here"""
    deepest_m: float = DEEPEST_M
    """[m] what would reach lower is cut off here"""
    reach_m: float | None = None
    """[m] half-width of the part that is laid out; None: what the mission can cover in its
    duration. Beyond it the depth at its edge holds."""

    def __post_init__(self) -> None:
        for name in FIELDS:
            value = number(getattr(self, name), f"rough sea floor: {name}", FloorError)
            if not math.isfinite(value):
                raise FloorError(f"rough sea floor: {name} = {value} must be finite")
            object.__setattr__(self, name, value)
        if not (isinstance(self.seed, int | np.integer) and self.seed >= 0):
            raise FloorError(
                f"rough sea floor: seed = {self.seed!r} must be a whole number from 0 on"
            )
        if self.height_m < 0.0 or self.slope < 0.0:
            raise FloorError(
                f"rough sea floor: height_m = {self.height_m:g} m and slope = {self.slope:g} must "
                "not be negative (turn slope_direction_deg instead)"
            )
        if self.length_m < NODES * FINEST_M:
            raise FloorError(
                f"rough sea floor: length_m = {self.length_m:g} m must be at least "
                f"{NODES * FINEST_M:g} m: what is smaller than a hull belongs into the vehicle file"
            )
        if not 0.0 < self.shallowest_m <= self.depth_m <= self.deepest_m <= DEEPEST_M:
            raise FloorError(
                f"rough sea floor: depth_m = {self.depth_m:g} m must lie between shallowest_m = "
                f"{self.shallowest_m:g} m, above 0, and deepest_m = {self.deepest_m:g} m, at most "
                f"{DEEPEST_M:g} m"
            )
        if self.reach_m is None:
            return
        reach = number(self.reach_m, "rough sea floor: reach_m", FloorError)
        if not (math.isfinite(reach) and reach > 0.0):
            raise FloorError(f"rough sea floor: reach_m = {reach} m must be above 0 and finite")

    def compile(self, duration_s: float, origin: Origin | None = None) -> Array:
        """The part around the start, nodes NODES to a correlation length."""
        reach = SPEED * duration_s if self.reach_m is None else self.reach_m
        spacing = self.length_m / NODES
        nodes = math.ceil(reach / spacing)
        if (2 * nodes + 1) ** 2 > LARGEST:
            raise FloorError(
                f"rough sea floor: {2 * nodes + 1} times as many nodes of {spacing:g} m about the "
                f"start are more than {LARGEST:,}: give a longer length_m, or a smaller reach_m "
                f"(now {reach:.0f} m)"
            )
        axis = np.asarray(spacing * np.arange(-nodes, nodes + 1), dtype=np.float64)
        direction = math.radians(self.slope_direction_deg)
        north = self.depth_m + self.slope * math.cos(direction) * axis
        east = self.slope * math.sin(direction) * axis
        depth = np.add.outer(north, east)
        if self.height_m > 0.0:
            depth += self._relief(axis)
        return pack(axis, axis, np.clip(depth, self.shallowest_m, self.deepest_m))

    def _relief(self, axis: Array) -> Array:
        """Depth [m] below the slope, shape (n, n), north by east, on the nodes of `axis` [m]."""
        rng = np.random.Generator(np.random.PCG64(self.seed))
        # the spectrum k / (k^2 + 1/L^2)^2, cut off at the shortest wave, one wave in each of
        # WAVES parts of equal variance
        shortest = (2.0 * math.pi) ** 2
        share = (np.arange(WAVES) + rng.random(WAVES)) / WAVES * shortest / (1.0 + shortest)
        number = np.sqrt(share / (1.0 - share)) / self.length_m
        toward, phase = rng.uniform(0.0, 2.0 * math.pi, (2, WAVES))
        relief = np.zeros((axis.size, axis.size))
        part = np.empty_like(relief)
        # cos(a + b) by parts, so that a wave takes two rows of cosines and no grid of them
        for k, angle, start in zip(number, toward, phase, strict=True):
            along, across = k * math.cos(angle) * axis, k * math.sin(angle) * axis + start
            relief += np.multiply.outer(np.cos(along), np.cos(across), out=part)
            relief -= np.multiply.outer(np.sin(along), np.sin(across), out=part)
        relief *= self.height_m * math.sqrt(2.0 / WAVES)
        return relief
