"""Learning of health: what `twin health` takes from simulated deployments with a pilot.

    python -m benchmarks.health --preset piloted --vehicle seaglider --seed 4002 --keep FILE ...
    python -m benchmarks.health_learning FILE ...

Prints the noise, walk and ordered steps of each channel (`glider_twin_ops.health.channels`), the
levels of alarms by false alarms, and the probability of a fault over the evidence
(`glider_twin_ops.health.judgement`). Other seeds and vehicles tell whether they hold.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, nnls
from scipy.special import expit

from benchmarks import command
from benchmarks.command import markdown
from benchmarks.health import (
    OURS,
    Alarms,
    Case,
    Judged,
    _vehicle,
    judged_case,
    level_of,
    load,
    named,
    sound_days,
    weights,
)
from glider_twin_ops.health.assessment import flown_signatures
from glider_twin_ops.health.channels import CHANNELS, NAMES, groups_of, standing, steps_in_shear
from glider_twin_ops.health.judgement import SURE, follow, sure
from glider_twin_ops.health.judgement import judge as weigh
from glider_twin_ops.health.signatures import TypicalDive, usual_dive

Array = NDArray[np.float64]
DAYS = (3.0, 10.0, 30.0, 100.0, 300.0)
"""[d] of sound vehicles with one false alarm"""
LAGS, LONGEST = (1, 2, 4), 6
"""Numbers of values between two that are compared, and the most dives between them"""
EVIDENCE = (-np.inf, -9.0, -7.0, -5.0, -3.0, -1.0, 1.0, 4.0, 10.0, 25.0, np.inf)
"""Edges of the evidence at which the part with a fault is printed"""


def differences(case: Case) -> list[Array]:
    """Differences of each channel between sound dives: (pairs, 6) for each.

    Columns: difference, dives between, squares of the ordered changes of depth, pitch and volume,
    and the variance by shear and by what the log lacks.
    """
    values, days = np.array(case["values"], float), np.array(case["time"]) / 86400.0
    dive = TypicalDive(**case["dive"])
    sheared = flown_signatures(_vehicle(case["vehicle"]), dive).sheared
    steps = steps_in_shear(sheared, np.array(case["ways"]), days - days[0], dive.depth)
    known = np.cumsum(steps**2 + np.array(case["wander"]) ** 2, axis=0)
    ordered = np.cumsum(groups_of(np.array(case["changes"])) ** 2, axis=0)
    end = case["numbers"].index(int(case["onset"])) if case["onset"] in case["numbers"] else None
    found = []
    for k in range(len(NAMES)):
        at = np.flatnonzero(np.isfinite(values[:end, k]))
        pairs = [(a, b) for lag in LAGS for a, b in zip(at[:-lag], at[lag:], strict=True)
                 if b - a <= LONGEST]  # fmt: skip
        a, b = np.array(pairs, int).reshape(-1, 2).T
        columns = [values[b, k] - values[a, k], b - a, *(ordered[b] - ordered[a]).T]
        found.append(np.column_stack([*columns, (known[b] - known[a])[:, k]]))
    return found


def of_channels(cases: Sequence[Case]) -> str:
    """Noise, walk, and steps per ordered change over the stated noise, of each channel."""
    every = [differences(case) for case in cases]
    rows = []
    for k, channel in enumerate(CHANNELS):
        one = np.concatenate([each[k] for each in every])
        if len(one) < 100:
            continue
        square = np.minimum(one[:, 0] ** 2, np.quantile(one[:, 0] ** 2, 0.995))
        terms = np.column_stack([np.full(len(one), 2.0), one[:, 1:5]])
        found = np.array([channel.noise**2, channel.walk**2, *3 * [channel.noise**2]])
        for _ in range(12):  # variances of normal numbers: weights by the variance itself
            weight = 1.0 / (terms @ found + one[:, 5] + 1e-12)
            found, _ = nnls(terms * weight[:, None], (square - one[:, 5]) * weight)
        noise, walk, *steps = np.sqrt(found)
        rows.append([channel.name, len(one), f"{noise:.4f}", f"{walk:.4f}",
                     *(f"{step / channel.noise:.2f}" for step in steps)])  # fmt: skip
    return markdown(["channel", "pairs", "noise", "walk", "depth", "pitch", "volume"], rows)


def by_law(count: int = 400, dives: int = 40, seed: int = 0) -> list[Judged]:
    """Sample sound deployments of a Slocum with the noise that `CHANNELS` states.

    Channels walk, and are noisy, by normal numbers; eight dives a day on one heading. Simulated
    deployments are quieter in most channels, real ones are not.
    """
    vehicle, rng = _vehicle("slocum-200"), np.random.default_rng(seed)
    shape, days = usual_dive(vehicle), np.arange(dives) / 8.0
    hypotheses = flown_signatures(vehicle, shape).in_dives(np.full((dives, 2), 0.2))
    walk, noise = (np.array([getattr(c, name) for c in CHANNELS]) for name in ("walk", "noise"))
    found = []
    for _ in range(count):
        steps, noises = rng.standard_normal((2, dives, len(CHANNELS)))
        levels = follow(np.cumsum(walk * steps, axis=0) + noise * noises)
        odds = weigh(levels, days, hypotheses, standing(np.full((dives, 2), 0.2), days)).evidence
        found.append(Judged({}, days, None, None, None, {OURS: Alarms(sure(odds), "")}))
    return found


def of_levels(ones: Sequence[Judged], rates: Sequence[float]) -> str:
    """The levels that give so many days for one false alarm."""
    rows, drawn = [], by_law()
    for days in rates:
        row = [f"{days:g}"]
        for sound in (ones, drawn):
            level = level_of(sound, OURS, days)
            alarms, at_risk = sound_days(sound, OURS, level)
            row += [f"{level:.2f}", str(alarms), f"{at_risk:.0f}"]
        rows.append(row)
    told = ["level", "alarms", "days"]
    return markdown(["one in days", *told, *(f"{word} by the law" for word in told)], rows)


def fitted_chance(ones: Sequence[Judged]) -> tuple[float, float]:
    """Logistic regression of a true name on the evidence after the last dive: level and slope.

    Evidence from `SURE` on counts as `SURE`: nearly all is true there.
    """
    said = np.minimum([one.alarms[OURS].statistic[-1] for one in ones], SURE)
    true, weight = np.array([named(one) for one in ones]), weights(ones)
    kept = np.isfinite(said)
    said, sign, weight = said[kept], np.where(true, -1.0, 1.0)[kept], weight[kept]

    def loss(line: Array) -> float:
        off = np.logaddexp(0.0, sign * (line[0] + line[1] * said))
        return float(weight @ off + 0.5 * line[1] ** 2)

    level, slope = minimize(loss, np.array([0.0, 0.5])).x
    return float(level), float(slope)


def of_chance(ones: Sequence[Judged]) -> str:
    """Table of the part of the deployments whose fault is named by the evidence after the last
    dive, beside the fitted probability."""
    level, slope = fitted_chance(ones)
    said = np.array([one.alarms[OURS].statistic[-1] for one in ones])
    true, weight = np.array([named(one) for one in ones]), weights(ones)
    rows = []
    for low, high in itertools.pairwise(EVIDENCE):
        inside = (said > low) & (said <= high)
        if inside.any():
            fitted = expit(level + slope * np.minimum(said[inside], SURE))
            parts = [np.average(part, weights=weight[inside]) for part in (true[inside], fitted)]
            rows.append([int(inside.sum()), f"{np.median(said[inside]):.1f}",
                         *(f"{part:.3f}" for part in parts)])  # fmt: skip
    table = markdown(["deployments", "evidence", "part named", "fitted"], rows)
    return f"{table}\n\nlevel {level:.2f}, slope {slope:.3f}"


def main(files: command.Positional[tuple[Path, ...]]) -> None:
    """Print what is learned.

    Args:
      files: kept deployments.
    """
    cases = load(files)
    ones = [judged_case(case) for case in cases]
    print(of_channels(cases), of_levels(ones, DAYS), of_chance(ones), sep="\n\n")


if __name__ == "__main__":
    sys.exit(command.run(main))
