"""Thresholds: how much evidence is an alarm, by the false alarms that a pilot bears.

A level is the higher of two. One is that of simulated deployments of preset `faulty` that were
sound, and of what came before the fault in others: 1073 days of Slocum 200, Sea-Wing, SeaExplorer
and Seaglider (of each vehicle `--each 1 --sound 6 --seed 2003` and `--each 2 --sound 24 --seed
2004`). They are quieter in most channels than real ones. The other is that of channels as loud, all
of them, as `channels` states their noise and walks: 400 deployments of five days. Both
are by

    python -m benchmarks.health --judge FILE ... --thresholds

Deployments of other seeds and real logs tell whether the rate holds: docs/results/health.md and
docs/results/health_real.md.
"""

from __future__ import annotations

import numpy as np

from twin.errors import InputError

RATES: tuple[tuple[float, float, float], ...] = (
    (3.0, -8.58, -5.38),
    (10.0, -6.07, -3.86),
    (30.0, -4.49, -2.86),
    (100.0, -2.83, -1.75),
    (300.0, -0.43, -0.52),
)
"""[d] of sound vehicles with one false alarm, the log of the odds that is an alarm on simulated
deployments, and that of channels as loud as they are stated to be"""


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
    spans, simulated, stated = np.array(RATES).T
    return float(np.interp(np.log(days), np.log(spans), np.maximum(simulated, stated)))
