"""Parity: an exported network against the trained one."""

from __future__ import annotations

import dataclasses
from pathlib import Path

TOLERANCE = 1e-5
"""[m/s] largest difference to the trained network over a mission."""


@dataclasses.dataclass(frozen=True)
class Parity:
    """An exported model against the trained network on one mission."""

    path: Path
    mission: int
    samples: int
    largest: float
    """[m/s] largest difference."""
    step_us: float
    """[us] per step, one thread."""
