"""Pump of a Slocum: of the two that its software knows, the one that this vehicle has."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from factory.importing.reading.deployment_log import Channel
from factory.importing.reading.tally import Tally
from factory.importing.reading.unread_names import leave_out
from factory.importing.repairs.cleaning import clean, to_cm3

PUMPS = (("m_ballast_pumped", "c_ballast_pumped"), ("m_de_oil_vol", "c_de_oil_vol"))
"""[cm3] Measured and commanded: shallow gliders have a ballast pump, deep ones an oil bladder;
both + = lighter."""
_MOVES = 1e-6
"""A range below it is none, in any unit from cm3 to m3."""
_PART = 0.05
"""A pump that moves by less than this part of the other's range stands still and is noisy."""


def slocum_pump(native: Mapping[str, Channel], tally: Tally) -> dict[str, Channel]:
    """Measured and commanded volume [cm3] of the pump that moves; of two, the fuller record.

    The software writes a sensor of the pump that a vehicle has not: once at the start, or as 0 in
    every cycle. Nothing is returned for a log with neither; the report calls it missing.
    """
    there = [pair for pair in PUMPS if any(len(native.get(name, ())) for name in pair)]
    if not there:
        return {}
    weights = {pair: _weight(native, pair) for pair in there}
    most = max(moved for moved, _ in weights.values())
    best = max(there, key=lambda pair: (weights[pair][0] >= _PART * most, weights[pair][1]))
    others = [pair for pair in there if pair is not best]
    channels: dict[str, Channel] = {}
    for name, target in zip(best, ("measured_pump", "commanded_pump"), strict=True):
        one = native.get(name)
        if one is not None and len(one):
            volume = to_cm3(one.values, name, tally)
            channels[target] = clean(target, one.time, volume, tally, subject=name)
    for pair in others:
        for name in pair:
            if len(native.get(name, ())):
                why = f"another pump's: {best[0]} has the samples and moves"
                leave_out([name], why, tally, samples=len(native[name]))
    if others:
        found = ", ".join(
            f"{pair[0]} {len(native.get(pair[0], ()))} samples, {weights[pair][0]:.4g} cm3"
            for pair in others
        )
        tally.add(
            "note", "measured_pump", len(native.get(best[0], ())),
            f"from {best[0]}, moves by {weights[best][0]:.4g} cm3 (not {found})",
        )  # fmt: skip
    return channels


def _weight(native: Mapping[str, Channel], pair: tuple[str, str]) -> tuple[float, int]:
    """How far a pump moves, 0 when it stands, and how many samples say so."""
    one = native.get(pair[0])
    if one is None or not len(one):
        return 0.0, len(native.get(pair[1], ()))
    moved = float(np.ptp(np.percentile(one.values, [1.0, 99.0])))
    return (moved if moved > _MOVES else 0.0), len(one)
