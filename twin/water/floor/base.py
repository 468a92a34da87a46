"""Sea floors made from numbers (flat, rough, a grid of depths), and their base class."""

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
"""[m/s] Speed over ground that no vehicle here exceeds over a mission; it sizes the table."""
LARGEST = 4_000_000
"""Maximum number of nodes of a table (32 MB), because the simulation's model holds a copy."""
DEEPEST_M = 12_000.0
"""[m] Largest depth of a floor; the deepest sea has 10 935 m."""
HIGHEST_M = 9_000.0
"""[m] Largest height of a floor above the sea; no land is higher."""
FINEST_M = 0.5
"""[m] Smallest spacing of nodes. The hull touches the plane through four floor points half a hull
away, fore, aft and on both sides. Smaller obstacles belong into the vehicle file, as geoms."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Floor:
    """A sea floor about a mission's start; subclasses are frozen dataclasses."""

    kind: ClassVar[str] = ""
    """Name in descriptions."""
    needs_place: ClassVar[bool] = False
    """True: the floor needs the start's latitude and longitude."""

    def compile(self, duration_s: float, origin: Origin | None = None) -> Array:
        """Make the table for `twin.water.floor.lookup` and a mission of this duration [s].

        Raises:
          FloorError: the floor's file is missing or cannot be read.
        """
        raise NotImplementedError

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Self:
        """Return the floor with every setting written out that decides its table.
        A stored floor is rebuilt from these settings, or refused when its file has changed."""
        return self

    def other_sense(self, duration_s: float, origin: Origin | None = None) -> str:
        """Setting that swaps up and down in the floor's file; empty: there is none."""
        return ""

    def describe(self) -> dict[str, Any]:
        """Return the settings as JSON values; `bathymetry.floor_from_dict` is the inverse."""
        values = dataclasses.asdict(self).items()
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values}
        return {"kind": self.kind, **plain}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Floor) and self.describe() == other.describe()

    __hash__ = None  # type: ignore[assignment]


def check_depths(label: str, depth: Array) -> None:
    """Raise FloorError for depths [m] that no sea floor has."""
    lowest, highest = float(depth.max()), float(-depth.min())
    if lowest > DEEPEST_M or highest > HIGHEST_M:
        raise FloorError(
            f"{label}: depths from {-highest:g} to {lowest:g} m: possible are {-HIGHEST_M:g} "
            f"(land) to {DEEPEST_M:g} m, positive down; wrong units, or missing values without a "
            "_FillValue"
        )


def check_reach(label: str, reach_m: float | None) -> None:
    """Raise FloorError for a half-width [m] that is not above 0 and finite."""
    if reach_m is None:
        return
    reach = number(reach_m, f"{label}: reach_m", FloorError)
    if not (math.isfinite(reach) and reach > 0.0):
        raise FloorError(f"{label}: reach_m = {reach} m must be above 0 and finite")


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatFloor(Floor):
    """A floor of one depth everywhere."""

    kind: ClassVar[str] = "flat"

    depth_m: float
    """[m] Depth below the mean sea surface, above 0."""

    def __post_init__(self) -> None:
        depth = number(self.depth_m, "flat sea floor: depth_m [m]", FloorError)
        object.__setattr__(self, "depth_m", depth)
        if not (math.isfinite(depth) and 0.0 < depth <= DEEPEST_M):
            raise FloorError(
                f"flat sea floor: depth_m = {depth:g} m must be above 0 and at most "
                f"{DEEPEST_M:g} m, positive down"
            )

    def compile(self, duration_s: float, origin: Origin | None = None) -> Array:
        """Make a table of one node."""
        return pack(np.zeros(1), np.zeros(1), np.full((1, 1), self.depth_m))


@dataclass(frozen=True, kw_only=True, eq=False)
class GridFloor(Floor):
    """Depths on a rectilinear grid: bilinear between nodes, constant beyond the edges."""

    kind: ClassVar[str] = "grid"

    north_m: Any
    """[m] Nodes north of the start, ascending, shape (n,), n at least 2."""
    east_m: Any
    """[m] Nodes east of the start, ascending, shape (m,), m at least 2."""
    depth_m: Any
    """[m] Depths, positive down, shape (n, m); negative is land."""

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
        """Make a table of the whole grid."""
        return pack(self.north_m, self.east_m, self.depth_m)


WAVES = 64
"""Number of plane waves in the relief; more cost time and hardly change its look."""
NODES = 4
"""Nodes per correlation length and per shortest wave."""
FIELDS = (
    "depth_m", "height_m", "length_m", "slope", "slope_direction_deg", "shallowest_m", "deepest_m",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class RoughFloor(Floor):
    """A tilted floor with hills: depths on a grid, bilinear between its nodes.

    The relief has the covariance of Goff and Jordan (1988, J. Geophys. Res. 93, 13589) with the
    Hurst exponent 1: H^2 (r/L) K_1(r/L) at a distance r, with K_1 the modified Bessel function. H
    is the standard deviation and L the correlation length; the correlation is 0.60 at L and 0.28
    at 2 L. The relief is a sum of plane waves with random directions and phases. Their wave
    numbers follow that spectrum, down to waves of length L. Floors of one seed agree wherever
    both have nodes.
    """

    kind: ClassVar[str] = "rough"

    depth_m: float
    """[m] Mean depth at the mission's start."""
    height_m: float = 2.0
    """[m] Standard deviation of the relief; 0: no relief."""
    length_m: float = 400.0
    """[m] Correlation length of the relief."""
    slope: float = 0.0
    """[1] Slope of the mean depth, at least 0; continental shelves: 0.002 (Shepard 1963)."""
    slope_direction_deg: float = 0.0
    """[deg true] Direction in which the floor gets deeper."""
    seed: int = 0
    """Seed of the relief, at least 0."""
    shallowest_m: float = 5.0
    """[m] Smallest depth; higher parts of the relief are cut off."""
    deepest_m: float = DEEPEST_M
    """[m] Greatest depth; lower parts of the relief are cut off."""
    reach_m: float | None = None
    """[m] Half-width of the table; None: the distance a mission can cover in its duration. The edge
    depth holds beyond the table."""

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
        """Make the table around the start, with NODES nodes per correlation length."""
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
        """Depth [m] relative to the slope, shape (n, n), north by east; `axis`: nodes [m]."""
        rng = np.random.Generator(np.random.PCG64(self.seed))
        # the spectrum k / (k^2 + 1/L^2)^2, cut off at the shortest wave, in WAVES bands of equal
        # variance with one wave each
        shortest = (2.0 * math.pi) ** 2
        share = (np.arange(WAVES) + rng.random(WAVES)) / WAVES * shortest / (1.0 + shortest)
        number = np.sqrt(share / (1.0 - share)) / self.length_m
        toward, phase = rng.uniform(0.0, 2.0 * math.pi, (2, WAVES))
        relief = np.zeros((axis.size, axis.size))
        part = np.empty_like(relief)
        # cos(a + b) = cos a cos b - sin a sin b: two vectors of cosines instead of a grid of them
        for k, angle, start in zip(number, toward, phase, strict=True):
            along, across = k * math.cos(angle) * axis, k * math.sin(angle) * axis + start
            relief += np.multiply.outer(np.cos(along), np.cos(across), out=part)
            relief -= np.multiply.outer(np.sin(along), np.sin(across), out=part)
        relief *= self.height_m * math.sqrt(2.0 / WAVES)
        return relief
