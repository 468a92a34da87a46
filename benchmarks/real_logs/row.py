"""Row: one figure of the benchmark, and what it must be read with."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from twin.navigation.dead_reckoning import Array

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
    low: float = math.nan
    high: float = math.nan
    """95 % interval of the value, by bootstrap over dives; NaN where there is none."""
    unit: str = "m s-1"
    samples: int = 0
    """Truth samples, or dives, that it is the error over."""
    dives: int = 0
    note: str = ""
    """How it was tuned, where it was published, or why it is missing."""


def rmse(errors: Array) -> float:
    """Root of the mean square; NaN without values."""
    errors = np.asarray(errors, float)
    return float(np.sqrt(np.mean(np.square(errors)))) if errors.size else math.nan


def best(rows: Sequence[Row]) -> list[Row]:
    """Of the rows with the same task, deployment, unit and samples the one with the least error."""
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        if row.kind not in NOT_COMPARED and math.isfinite(row.value):
            groups.setdefault((row.task, row.data, row.unit, row.samples), []).append(row)
    return [min(group, key=lambda r: r.value) for group in groups.values() if len(group) > 1]


NOT_COMPARED: tuple[Kind, ...] = ("published", "floor", "skipped")


def table(rows: Sequence[Row]) -> list[dict[str, object]]:
    """Rows for a terminal; the best of those at equal samples is marked."""
    winners = best(rows)
    return [
        {
            "data": row.data,
            "method": row.method,
            "": row.kind,
            row.unit: row.value if math.isfinite(row.value) else None,
            "95 %": f"{row.low:.3g} to {row.high:.3g}" if math.isfinite(row.low) else "",
            "best": "*" if any(row is one for one in winners) else "",
            "samples": row.samples or None,
            "dives": row.dives or None,
            "note": row.note,
        }
        for row in rows
    ]
