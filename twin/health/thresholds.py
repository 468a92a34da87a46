"""Thresholds: how much evidence is an alarm, by the false alarms that a pilot bears.

Measured on simulated deployments of preset `faulty` that were sound, and on what came before the
fault in others: 247 days of Slocum 200, Sea-Wing, SeaExplorer and Seaglider (seed 2003, of each
vehicle `--each 1 --sound 6`), by

    python -m benchmarks.health --judge FILE ... --thresholds

Deployments of other seeds tell whether the rate holds: docs/results/health.md.
"""

from __future__ import annotations

import numpy as np

from twin.errors import InputError

RATES: tuple[tuple[float, float, int, float], ...] = (
    (3.0, -6.69, 51, 154.0),
    (10.0, -4.22, 21, 215.0),
    (30.0, -2.88, 7, 232.0),
    (100.0, -0.71, 2, 246.0),
    (300.0, 0.46, 0, 247.0),
)
"""[d] of sound vehicles with one false alarm, the log of the odds that is an alarm, how many there
were, and in how many days [d] until the first of each deployment"""


def threshold_of(days: float) -> float:
    """The log of the odds from which on there is an alarm, by straight lines over log(days).

    Args:
      days: [d] of sound vehicles in which one false alarm is borne.

    Raises:
      InputError: not a time that the simulated deployments tell.
    """
    least, most = RATES[0][0], RATES[-1][0]
    if not least <= days <= most:
        raise InputError(
            f"--false-alarm-days {days:g} must be within {least:g} and {most:g}: more and fewer "
            "false alarms were not measured"
        )
    spans, levels = np.array(RATES).T[:2]
    return float(np.interp(np.log(days), np.log(spans), levels))
