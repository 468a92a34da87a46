"""Rotation of a Seaglider's battery from the counts of its roll axis, without C_ROLL and ROLL_CNV.

Tables of samples often carry the counts alone. The axis rests at C_ROLL_DIVE or C_ROLL_CLIMB
between turns, most of the time, so that the counts that a phase holds longest are its centre.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factory.importing.reading.tally import Tally

Array = NDArray[np.float64]

ROLL_CNV = 0.02827
"""[deg] per count: the value that basestations and vehicles' files give for most Seagliders."""
LEAST_SAMPLES = 20
"""of a phase, from which its centre is taken"""
PITCHED = 5.0
"""[deg] of pitch from which a sample is of a dive or of a climb"""


def rotation_from_counts(
    counts: Array, pitch_deg: Array, known: Array | None, subject: str, tally: Tally
) -> Array:
    """Rotation [deg], + to port, (time,): `known` where it is, elsewhere from the counts.

    Args:
      counts: `gc_roll_ad`, (time,), zero or less where there was none.
      pitch_deg: [deg], (time,). known: [deg] from files with the calibration, or None.
    """
    rotation = np.full(len(counts), np.nan) if known is None else known.copy()
    moved = np.where(counts > 0.0, counts, np.nan)
    wanted = ~np.isfinite(rotation) & np.isfinite(moved)
    filled = 0
    for side in (-1.0, 1.0):
        phase = wanted & (side * pitch_deg > PITCHED)
        if phase.sum() >= LEAST_SAMPLES:
            centre = float(np.median(moved[phase]))
            # more counts roll the glider to starboard: the mass has gone there
            rotation[phase] = -ROLL_CNV * (moved[phase] - centre)
            filled += int(phase.sum())
    if filled:
        tally.add(
            "note", f"{subject} rotation", filled,
            f"from gc_roll_ad with {ROLL_CNV} deg a count, from the counts at which each phase "
            "rests: the log has no C_ROLL_DIVE, C_ROLL_CLIMB, ROLL_CNV",
        )  # fmt: skip
    return rotation
