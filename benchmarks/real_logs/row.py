"""Row: one figure of the benchmark, and what it must be read with."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from learn.navigation.dead_reckoning import Array

Kind = Literal["published", "public method", "twin", "network", "floor", "skipped"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
    """One method on one task."""

    task: str
    data: str
    """Deployment, or folder where there is none."""
    method: str
    kind: Kind
    value: float = math.nan
    """In `unit`; NaN where there is none, see `note`."""
    unit: str = "m s-1"
    samples: int = 0
    """Truth samples, or dives, that it is the error over."""
    note: str = ""
    """How it was tuned, where it was published, or why it is missing."""


def rmse(errors: Array) -> float:
    """Root of the mean square; NaN without values."""
    errors = np.asarray(errors, float)
    return float(np.sqrt(np.mean(np.square(errors)))) if errors.size else math.nan


def table(rows: Sequence[Row]) -> list[dict[str, object]]:
    """Rows for a terminal."""
    return [
        {
            "data": row.data,
            "method": row.method,
            "": row.kind,
            row.unit: row.value if math.isfinite(row.value) else None,
            "samples": row.samples or None,
            "note": row.note,
        }
        for row in rows
    ]
