"""Stored: what files of our own export say of the grid that they were written from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.quality import ESTIMATED
from factory.exporting.og1.terms import ASCENT, DESCENT, INFLECTION, SURFACING
from factory.importing.repairs.seawater import pressure_of

Array = NDArray[np.float64]

STORED = ("gap_stored", "phase_stored")
"""Columns that are made here"""
_PHASES = {SURFACING: 0.0, DESCENT: 1.0, ASCENT: 2.0, INFLECTION: 3.0}
"""The format's codes and those of `measured_phase`"""


def stored_columns(columns: Mapping[str, Array], flags: Mapping[str, Array]) -> dict[str, Array]:
    """Gaps and phases of the store, and pressure where only the depth beside a gap is written.

    Args:
      columns: of the file, (samples,) each.
      flags: of the variables that have some.
    """
    found = {}
    depth = columns.get("DEPTH")
    if "DEPTH" in flags:
        found["gap_stored"] = (flags["DEPTH"] == ESTIMATED).astype(float)
    if "PHASE" in columns:
        phase = np.full(len(columns["PHASE"]), np.nan)
        for code, flag in _PHASES.items():
            phase[columns["PHASE"] == code] = flag
        found["phase_stored"] = phase
    pressure, latitude = columns.get("PRES"), columns.get("LATITUDE_GPS")
    if depth is not None and pressure is not None and np.isnan(pressure).any():
        known = latitude[np.isfinite(latitude)] if latitude is not None else np.zeros(0)
        place = float(np.median(known)) if known.size else 0.0
        found["PRES"] = np.where(np.isnan(pressure), pressure_of(depth, place), pressure)
    return found
