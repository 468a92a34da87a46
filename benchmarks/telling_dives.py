"""Telling dives: what three proposed dives leave of the deviations that five usual dives left.

    python -m benchmarks.telling_dives

Three vehicles fly five usual dives, then three proposed ones, or three usual ones more. Told are
the deviations by Fisher information, and the errors of fits (`twin.identify`) to simulated dives:
vehicles with parameters drawn within their spreads, a depth rate with waves of 1 cm/s that last a
minute and a current that changes by 5 cm/s from dive to dive. Both are over what five usual dives
left, as a geometric mean over parameters; errors are root mean squares over the draws.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.signal import lfilter

from glider_twin_ops.health.signatures import TypicalDive, usual_dive
from glider_twin_ops.watching.learning_dives import (
    LEARNED,
    NOISE,
    Manoeuvre,
    MostTelling,
    flown_logs,
    most_telling,
    slopes_of,
    turned,
)
from twin.identify import load_calibration
from twin.identify.calibration import Calibration
from twin.identify.logged_missions import Log
from twin.identify.residuals import DepthRates
from twin.identify.speed import horizontal, motion_of
from twin.identify.unknowns import choose

VEHICLES = {"slocum-1000": 400.0, "seaglider": 400.0, "slocum-200": 120.0}
"""Usual depth [m]"""
USUAL = 5
PERIOD = 4.0
"""[s] between samples"""
ENDS: dict[str, Any] = {"max_nfev": 8, "xtol": 1e-3, "ftol": 1e-4}
"""Of a fit's search: offsets are in spreads"""
CURRENT = 0.1
"""[m/s] deviation of a first dive's current"""


def simulated(log: Log, truth: Calibration, current: np.ndarray, rng: np.random.Generator) -> Log:
    """A dive with the depth rate and the way of another vehicle, waves and a current."""
    motion = motion_of(log, truth)
    sink = log.filtered(motion.sink_rate(log.roll, truth.true_pitch(log.pitch)))
    noise = NOISE["depth_rate"]
    keep = (noise.samples - 1.0) / (noise.samples + 1.0)
    white = rng.standard_normal(len(sink)) * noise.deviation * np.sqrt(1.0 - keep**2)
    waves = lfilter([1.0], [1.0, -keep], white)
    moved = [log.period * float(np.sum(v)) for v in horizontal(log, truth, motion)]
    north, east = np.array(moved) + current * log.duration
    return dataclasses.replace(
        log, depth_rate=sink + waves, displacement=(float(north), float(east)), follows=True
    )


def error_of(
    logs: Sequence[Log], calibration: Calibration, true: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Errors of a fit over the spreads, (parameters,)."""
    chosen = choose(list(LEARNED))
    first = DepthRates(logs, calibration, chosen)
    true = np.maximum(true, first.lowest)  # no hull grows under pressure
    draw = first.calibration(true)
    current = CURRENT * rng.standard_normal(2)
    flown = []
    for log in logs:
        current = current + NOISE["current"].deviation * rng.standard_normal(2)
        flown.append(simulated(log, draw, current, rng))
    problem = DepthRates(flown, calibration, chosen, fixes=True)
    found, _ = problem.fit(np.zeros(len(chosen)), 2, first=NOISE, **ENDS)
    return np.asarray(found - true)


def measure(name: str, depth: float, draws: int) -> dict[str, object]:
    """Of one vehicle."""
    calibration = load_calibration(name)
    usual = usual_dive(calibration.vehicle, PERIOD, depth)
    log = flown_logs(calibration, [usual])[0]
    assert log is not None
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
        "errors of fits": _errors(calibration, usual, found, draws) if draws else {},
    }


def _errors(
    calibration: Calibration, usual: TypicalDive, found: MostTelling, draws: int
) -> dict[str, float]:
    """Of fits to simulated dives, over those of five usual ones."""
    chosen = choose(list(LEARNED))
    several = {
        "five usual": [], "and three usual": [Manoeuvre(dive=usual, turn_deg=0.0)] * 3,
        "and three proposed": list(found.chosen),
    }  # fmt: skip
    dives = dict.fromkeys([usual, *(one.dive for each in several.values() for one in each)])
    logs = dict(zip(dives, flown_logs(calibration, list(dives)), strict=True))
    errors = {}
    for what, more in several.items():
        every = [turned(logs[usual], 0.0)] * USUAL  # type: ignore[arg-type]
        every += [turned(logs[one.dive], one.turn_deg) for one in more]  # type: ignore[arg-type]
        rng = np.random.default_rng(7)
        missed = [
            error_of(every, calibration, 0.5 * rng.standard_normal(len(chosen)), rng)
            for _ in range(draws)
        ]
        errors[what] = np.sqrt(np.mean(np.square(missed), axis=0))
    of_five = errors.pop("five usual")
    return {
        what: round(float(np.exp(np.mean(np.log(each / of_five)))), 2)
        for what, each in errors.items()
    }


def main() -> None:
    """Print a line for each vehicle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=6, help="of the fits; 0: none")
    parser.add_argument("--vehicles", nargs="+", default=list(VEHICLES), choices=list(VEHICLES))
    asked = parser.parse_args()
    for name in asked.vehicles:
        print(json.dumps(measure(name, VEHICLES[name], asked.draws)), flush=True)


if __name__ == "__main__":
    main()
