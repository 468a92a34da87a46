"""Base: the class of every sea floor, and the flat floor with one depth everywhere."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from twin.errors import FloorError
from twin.numbers import Array, number
from twin.water.current.axes import Origin
from twin.water.floor.lookup import pack

SPEED = 1.5
"""[m/s] over ground; no vehicle here keeps more over a mission. Sizes the part to lay out."""
LARGEST = 4_000_000
"""Nodes of a table at most, 32 MB: they travel in the simulation's model"""


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
        return {"kind": self.kind, **_plain(dataclasses.asdict(self))}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Floor) and self.describe() == other.describe()

    __hash__ = None  # type: ignore[assignment]


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}


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
