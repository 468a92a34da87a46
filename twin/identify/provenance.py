"""Provenance: what a vehicle file says about the identification that made it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from twin.identify.answer import Identification
from twin.records.content import store_hash
from twin.version import __version__

DIGITS = 6
"""Significant digits: a deviation is not known to more than two."""


def provenance_of(found: Identification, store: str | Path) -> dict[str, Any]:
    """What was fitted, from what, and how surely; JSON-able, no times, no paths."""

    def short(value: float) -> float | None:
        return float(f"{value:.{DIGITS}g}") if value == value else None

    return {
        "program": f"glider-twin {__version__}",
        "started_from": found.nominal.vehicle.name,
        "store": Path(store).name,
        "store_sha256": store_hash(store),
        "model": found.model,
        "missions": found.missions,
        "samples": found.samples,
        "depth_rate_rmse_m_s": short(found.depth_rate_rmse),
        "correlation_time_s": short(found.correlation_time),
        "parameters": {
            e.name: {
                "value": short(e.value),
                "deviation": short(e.deviation) if e.determined else None,
                "unit": e.unit,
                "determined": e.determined,
            }
            for e in found.estimates
        },
        "correlation": {
            "parameters": list(found.determined),
            "matrix": [[short(value) for value in row] for row in found.correlation.tolist()],
        },
    }
