"""Sea floors that are laid out from numbers: flat, rough, and a grid of depths; and their base."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from twin.errors import FloorError
from twin.numbers import Array, number, numbers
from twin.water.current.axes import Origin
from twin.water.floor.lookup import pack

SPEED = 1.5
"""[m/s] over ground; no vehicle here keeps more over a mission. Sizes the part to lay out."""
LARGEST = 4_000_000
"""Nodes of a table at most, 32 MB: they travel in the simulation's model"""
DEEPEST_M = 12_000.0
"""[m] the deepest sea has 10 935 m"""
HIGHEST_M = 9_000.0
"""[m] no land is higher"""
FINEST_M = 0.5
"""[m] The hull meets the plane through the floor fore and aft and on both sides of it, half a hull
away: what is smaller than a hull belongs into the vehicle file, as geoms."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Floor:
    """A sea floor about a mission's start; subclasses are frozen dataclasses."""

    kind: ClassVar[str] = ""
    """Name in descriptions."""
    needs_place: ClassVar[bool] = False
    """True when only a place on Earth says where the start lies on it"""

    def compile(self, duration_s: float, origin: Origin | None = None) -> Array:
        """The table that `twin.water.floor.lookup` reads, for a mission of that duration [s].

        Raises:
          FloorError: the floor cannot be read, or not there.
        """
        raise NotImplementedError

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Self:
        """The same floor with everything written out that decides its table, so that it can be
        laid out once more, or refused when a file has changed."""
        return self

    def other_sense(self, duration_s: float, origin: Origin | None = None) -> str:
        """Setting that turns the floor upside down; empty where none does."""
        return ""

    def describe(self) -> dict[str, Any]:
        """JSON-able; `spec.floor_from_dict` is the inverse."""
        values = dataclasses.asdict(self).items()
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values}
        return {"kind": self.kind, **plain}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Floor) and self.describe() == other.describe()

    __hash__ = None  # type: ignore[assignment]


def check_depths(label: str, depth: Array) -> None:
    """Refuse depths [m] that no sea floor has; raises FloorError."""
    lowest, highest = float(depth.max()), float(-depth.min())
    if lowest > DEEPEST_M or highest > HIGHEST_M:
        raise FloorError(
            f"{label}: depths from {-highest:g} to {lowest:g} m: possible are {-HIGHEST_M:g} "
            f"(land) to {DEEPEST_M:g} m, positive down; wrong units, or missing values without a "
            "_FillValue"
        )


def check_reach(label: str, reach_m: float | None) -> None:
    """Refuse a half-width [m] that is not above 0 and finite; raises FloorError."""
    if reach_m is None:
        return
    reach = number(reach_m, f"{label}: reach_m", FloorError)
    if not (math.isfinite(reach) and reach > 0.0):
        raise FloorError(f"{label}: reach_m = {reach} m must be above 0 and finite")


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


WAVES = 64
"""Plane waves of the relief; more change its look little and cost as much again"""
NODES = 4
"""Nodes in a correlation length and in the shortest wave"""
FIELDS = (
    "depth_m", "height_m", "length_m", "slope", "slope_direction_deg", "shallowest_m", "deepest_m",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class RoughFloor(Floor):
    """A tilted floor with hills: depths on a grid, bilinear between its nodes.

    The relief has the covariance of Goff and Jordan (1988, J. Geophys. Res. 93, 13589) with the
    Hurst exponent 1: H^2 (r/L) K_1(r/L) at a distance r, with K_1 the modified Bessel function. H
    is the standard deviation and L the correlation length; the correlation is 0.60 at L and 0.28
    at 2 L. It is a sum of plane waves whose wave numbers follow that spectrum, down to waves as
    long as L, with random directions and phases. Two floors of one seed agree wherever both are
    laid out.
    """

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
    """Seed of the relief, from 0 on"""
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
        check_reach("rough sea floor", self.reach_m)

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
