"""Pressure drift: a transducer whose zero wanders."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np

from twin.faults.base import Array, Condition, Fault, Readings

METRES_PER_DBAR = 0.99


@dataclasses.dataclass(frozen=True, kw_only=True)
class PressureDrift(Fault):
    """A pressure sensor whose reading grows by the day, at every depth alike."""

    kind: ClassVar[str] = "pressure_drift"
    says: ClassVar[str] = "the pressure sensor drifts"
    size_name: ClassVar[str] = "per_day"
    unit: ClassVar[str] = "dbar d-1"
    sizes: ClassVar[tuple[float, float]] = (0.1, 0.6)
    grows: ClassVar[bool] = True
    signed: ClassVar[bool] = True
    most: ClassVar[float] = 100.0
    source: ClassVar[str] = "ours: strain gauges that fail, above the 0.1 % of full scale of sound"
    shows: ClassVar[str] = "a depth at the surface that is not 0"
    otherwise: ClassVar[str] = "weather: 0.3 dbar between a high and a low"
    find_out: ClassVar[str] = "read it at the surface; compare with the CTD's own"

    per_day: float = 0.3
    """[dbar] added a day"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Guidance turns by the depth of the drifted pressure."""
        return condition.replace(depth_offset=condition.depth_offset + METRES_PER_DBAR * size)

    def readings(
        self, signals: Readings, size: Array, period: float, rng: np.random.Generator
    ) -> Readings:
        """Pressure, and the depth of it."""
        added = {"measured_depth": METRES_PER_DBAR * size, "measured_pressure": size}
        return {name: signals[name] + more for name, more in added.items() if name in signals}
