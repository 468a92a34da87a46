"""Altimeter blind: an echo sounder without echoes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from twin.faults.base import Array, Condition, Fault, Readings


@dataclasses.dataclass(frozen=True, kw_only=True)
class AltimeterBlind(Fault):
    """An altimeter that hears nothing any more."""

    kind: ClassVar[str] = "altimeter_blind"
    says: ClassVar[str] = "the altimeter is blind"
    size_name: ClassVar[str] = "part"
    sizes: ClassVar[tuple[float, float]] = (0.9, 1.0)
    source: ClassVar[str] = "it fails, or its face is overgrown"
    shows: ClassVar[str] = "no echoes where there were some, above a floor within its range"
    otherwise: ClassVar[str] = "deeper water, a soft bottom"
    find_out: ClassVar[str] = (
        "ping at the surface in shallow water; keep it above the charted floor"
    )

    part: float = 1.0
    """of its echoes that are lost"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Guidance hears the other echoes alone, and flies by the last one for a while."""
        heard = (1.0 - condition.echoes_lost) * (1.0 - size)
        return condition.replace(echoes_lost=1.0 - heard)

    def expected(self, way: Array) -> Mapping[str, Array]:
        """Of the echoes that earlier dives had, its part is missing."""
        return {"echoes": -np.ones(len(way))}

    def readings(
        self, signals: Readings, size: Array, period: float, rng: np.random.Generator
    ) -> Readings:
        """Echoes that are missing; nothing where it has no altimeter."""
        height = signals.get("measured_altitude")
        if height is None:
            return {}
        return {"measured_altitude": np.where(rng.random(len(size)) < size, np.nan, height)}
