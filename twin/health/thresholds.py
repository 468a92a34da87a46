"""Thresholds: how much evidence is an alarm, by the false alarms that a pilot bears.

The level for 30 days was chosen on 16 sound simulated deployments of a Slocum, 75 days, where the
evidence stayed below 2.5; on 451 days that chose nothing it gave 5 false alarms, one in 90 days
(`python -m benchmarks.health --thresholds`). The other levels are steps of three in the log of the
odds about it.
"""

from __future__ import annotations

import numpy as np

from twin.errors import InputError

RATES: tuple[tuple[float, float], ...] = (
    (1.0, -1.0),
    (30.0, 3.0),
    (300.0, 6.0),
)
"""[d] of sound vehicles with one false alarm, and the log of the odds that is an alarm"""


def threshold_of(days: float) -> float:
    """The log of the odds from which on there is an alarm.

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
    spans, levels = np.array(RATES).T
    return float(np.interp(np.log(days), np.log(spans), levels))
