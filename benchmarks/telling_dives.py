"""Telling dives: standard deviations after three proposed dives, relative to those before.

    python -m benchmarks.telling_dives

Three vehicles fly five usual dives, then three proposed ones, or three more usual ones. The figure
is the geometric mean, over parameters, of the ratio of standard deviations by Fisher information,
after and before these three.
"""

from __future__ import annotations

import json
import sys

import numpy as np

from benchmarks import command
from glider_twin_ops.health.signatures import usual_dive
from glider_twin_ops.watching.learning_dives import (
    LEARNED,
    NOISE,
    flown_logs,
    most_telling,
    slopes_of,
    turned,
)
from twin.identify import load_calibration
from twin.identify.unknowns import choose

VEHICLES = {"slocum-1000": 400.0, "seaglider": 400.0, "slocum-200": 120.0}
"""Usual depth [m]"""
USUAL = 5
PERIOD = 4.0
"""[s] between samples"""


def measure(name: str, depth: float) -> dict[str, object]:
    """Shrinking of one vehicle's standard deviations by three usual and three proposed dives."""
    calibration = load_calibration(name)
    usual = usual_dive(calibration.vehicle, PERIOD, depth)
    log = flown_logs(calibration, [usual])[0]
    chosen = choose(list(LEARNED))
    alone = slopes_of(turned(log, 0.0), calibration, chosen, NOISE)
    information = np.eye(len(chosen)) + USUAL * alone.depth_rates
    found = most_telling(calibration, usual, information)
    ordinary, proposed = found.shrinks
    return {
        "vehicle": name,
        "deviations after three usual": round(ordinary, 2),
        "after three proposed": round(proposed, 2),
        "proposed": [one.words(usual) for one in found.chosen],
    }


def main(*, vehicles: tuple[str, ...] = tuple(VEHICLES)) -> None:
    """Print a line for each vehicle."""
    for name in vehicles:
        print(json.dumps(measure(name, VEHICLES[name])), flush=True)


if __name__ == "__main__":
    sys.exit(command.run(main))
