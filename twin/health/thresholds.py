"""Thresholds: how much evidence is an alarm, by the false alarms that a pilot bears.

Measured on sound simulated deployments of five gliders, none of which tuned anything else
(`python -m benchmarks.health --thresholds`): how often the evidence first passed a level.
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
