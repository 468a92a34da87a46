"""Base: what every sea floor can do."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from twin.water.current.origin import Origin

Array = NDArray[np.float64]

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

    def describe(self) -> dict[str, Any]:
        """JSON-able; `spec.floor_from_dict` is the inverse."""
        return {"kind": self.kind, **_plain(dataclasses.asdict(self))}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Floor) and self.describe() == other.describe()

    __hash__ = None  # type: ignore[assignment]


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}
