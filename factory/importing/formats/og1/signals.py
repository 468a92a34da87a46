"""Signals: attitude, pressure, actuators and whatever else an OG1.0 file has of a store's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.formats.og1.derived import Variation, true_heading
from factory.importing.formats.og1.vocabulary import ALIASES, OURS
from factory.importing.reading.deployment_log import EMPTY, Channel
from factory.importing.reading.tally import Tally
from factory.importing.repairs.angles import REACH, to_degrees
from factory.importing.repairs.cleaning import clean, from_degrees, to_dbar
from twin.records.schema import VARIABLES, declare_stored

Array = NDArray[np.float64]

_RADIAN = frozenset({"rad", "radian", "radians"})
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": 0.0254}
_FLYING = 20.0
"""[m] A glider that was deeper has pitched."""


def own_signals(attributes: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Names of signals that an export writes as the store has them, and the store's names.

    A part or a payload that is not known here is declared as the file describes it.
    """
    found = {}
    for name, described in attributes.items():
        if "signal_group" in described and name not in OURS:
            stored = name.lower()
            declare_stored(stored, described)
            if stored in VARIABLES and VARIABLES[stored].units == described.get("units"):
                found[name] = stored
    return found


def signals_in(
    time: Array,
    columns: Mapping[str, Array],
    attributes: Mapping[str, Mapping[str, Any]],
    variation: Variation,
    path: Path,
    tally: Tally,
) -> tuple[dict[str, Channel], set[str], Channel]:
    """Channels, the names that they come from, and the variation that was added."""
    applied = EMPTY
    sources = {target: name for name, target in OURS.items() if name in columns}
    sources |= {target: name for name, target in own_signals(attributes).items()}
    for target, names in ALIASES.items():
        found = next((n for n in names if n in columns and np.isfinite(columns[n]).any()), None)
        if found is not None:
            sources[target] = found
    channels: dict[str, Channel] = {}
    depth = columns.get(sources.get("measured_depth", ""))
    flying = depth is not None and bool(np.nanmax(depth, initial=0.0) > _FLYING)
    for target, name in sources.items():
        values, units = columns[name], str(attributes[name].get("units", ""))
        if VARIABLES[target].units == "degree":
            if units.lower() in _RADIAN:
                part = target.split("_")[-1]
                kind = part if part in REACH else "roll"
                values = to_degrees(values, name, tally, kind=kind)
            elif target == "measured_pitch":
                values = from_degrees(values, name, tally, flying=flying)
        elif target == "measured_shift":
            values = values * _LENGTHS.get(units, 1.0)
        elif target == "measured_pressure":
            values = to_dbar(values, depth, name, tally, native="bar" if units == "bar" else "dbar")
        if target == "measured_heading":
            values, applied = true_heading(values, time, attributes[name], variation, path, tally)
        channels[target] = clean(target, time, values, tally, subject=name)
    if depth is not None and "measured_pressure" in channels:
        channels.pop("measured_depth", None)  # computed from pressure, as for every log
    return channels, set(sources.values()), applied
