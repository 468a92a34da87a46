"""DVL beam dead: three beams are left, and none to spare."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np

from twin.faults.base import Array, Fault, Readings

OUTPUTS = ("measured_dvl_surge", "measured_dvl_sway", "measured_dvl_heave")


@dataclasses.dataclass(frozen=True, kw_only=True)
class DvlBeam(Fault):
    """A Doppler log with a dead beam: it loses lock wherever another beam finds nothing."""

    kind: ClassVar[str] = "dvl_beam"
    says: ClassVar[str] = "a beam of the Doppler log is dead"
    size_name: ClassVar[str] = "part"
    sizes: ClassVar[tuple[float, float]] = (0.3, 0.8)
    source: ClassVar[str] = "ours: how often one of three beams finds nothing"
    shows: ClassVar[str] = "fewer samples with lock"
    otherwise: ClassVar[str] = "a floor out of range, clear water without scatterers"
    find_out: ClassVar[str] = "read the echo of each beam"

    part: float = 0.5
    """of its samples that lose their lock"""

    def readings(
        self, signals: Readings, size: Array, period: float, rng: np.random.Generator
    ) -> Readings:
        """Velocities and lock that are missing; nothing where it has no Doppler log."""
        if "measured_dvl_mode" not in signals:
            return {}
        lost = rng.random(len(size)) < size
        found = {name: np.where(lost, np.nan, signals[name]) for name in OUTPUTS}
        return {**found, "measured_dvl_mode": np.where(lost, 0.0, signals["measured_dvl_mode"])}
