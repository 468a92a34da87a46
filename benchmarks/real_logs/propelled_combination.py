"""Propelled combination: methods shrunk towards the constant speed, then weighed together.

Shrinkage and weights come from held-out training runs, never from a scored run.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from benchmarks.real_logs.propelled_runs import Run
from benchmarks.real_logs.propelled_speeds import CONSTANT
from twin.navigation.dead_reckoning import Array

FEW = 4
"""Fewest runs for a bootstrap or a split over runs; fewest moving samples for a default"""
EQUAL = 0.02
"""[1] Pull of the combination's weights towards equal ones, as a fraction of the variance"""
PLAIN = "constant speed, never standing"
COMBINED, SHRUNK = "combination", ", shrunk"
Found = dict[str, Array]
"""Surge and sway [m/s] of a run, (2, time), by method"""
Parts = list[tuple[list[Run], list[Run]]]
"""Training runs, divided into used and held-out ones"""


def splits(train: Sequence[Run]) -> Parts:
    """Divide training runs: each vehicle is held out in turn, every fourth run of a vehicle, each
    of few, or each half of a single one."""
    vehicles = dict.fromkeys(run.vehicle for run in train)
    if len(train) == 1:
        half = train[0].surge.size // 2
        train = [train[0].part(slice(0, half)), train[0].part(slice(half, None))]
    if len(vehicles) > 1:
        held = [[run for run in train if run.vehicle == name] for name in vehicles]
    else:
        held = [[run] for run in train] if len(train) < FEW else [list(train[3::4])]
    return [([run for run in train if run not in some], some) for some in held]


def gain(found: Sequence[Array], wanted: Sequence[Array], units: Sequence[int]) -> float:
    """Part of a method's difference from the constant speed to keep, 0 to 1.

    The factor is of least squared error on held-out runs, times 1 - (s / f)^2, where s is its
    standard error by the scatter between units and f the factor itself (James and Stein 1961).

    Args:
      found: the method less the constant [m/s] in each run. wanted: the truth less the constant.
        units: number of each run's unit, a run or a vehicle.
    """
    products = np.bincount(units, [x @ y for x, y in zip(found, wanted, strict=True)])
    squares = np.bincount(units, [x @ x for x in found])
    total, size, count = float(products.sum()), float(squares.sum()), np.count_nonzero(squares)
    if count < 2 or total <= 0.0:
        return 0.0
    scatter = float(np.sum((products - total / size * squares) ** 2)) * count / (count - 1)
    return min(1.0, max(0.0, 1.0 - scatter / total**2) * total / size)


def weigh(each: Array, truth: Array) -> Array:
    """Weights of methods [m/s], (methods, samples), at least 0 and 1 together, of least error."""
    size = len(each)
    pull = np.sqrt(EQUAL * truth.size) * (truth.std() if truth.size else 1.0)
    matrix = np.concatenate([each.T, pull * np.eye(size), 1e3 * np.ones((1, size))])
    weights, _ = nnls(matrix, np.concatenate([truth, np.full(size, pull / size), [1e3]]))
    return np.asarray(weights / weights.sum())


def combine(held: Sequence[Run], early: Sequence[Found], answers: Sequence[Found]) -> list[Found]:
    """Each method shrunk, and the combination of these, for each answer.

    A method without a held-out answer takes no part. A held-out run without its channels has the
    constant speed instead.

    Args:
      early: velocities of the held-out runs. answers: those of the left-out runs.
    """
    names = [name for name in answers[0] if all(name in one for one in answers)]
    others = [n for n in names if n not in (PLAIN, CONSTANT) and any(n in one for one in early)]
    every, count = [*early, *answers], len(held)
    vehicles = [run.vehicle for run in held]
    several = len(set(vehicles)) > 1
    units = [vehicles.index(name) if several else k for k, name in enumerate(vehicles)]
    both = []
    for axis in (0, 1):
        rest = [one[CONSTANT][axis] for one in every]
        off = [np.stack([o.get(n, o[CONSTANT])[axis] for n in (CONSTANT, *others)]) for o in every]
        off = [one - base for one, base in zip(off, rest, strict=True)]
        wanted = [(r.surge, r.sway)[axis] - base for r, base in zip(held, rest, strict=False)]
        rows = [run.moving & np.isfinite(one) for run, one in zip(held, wanted, strict=True)]
        truth = [one[good] for one, good in zip(wanted, rows, strict=True)]
        known = [one[:, good] for one, good in zip(off, rows, strict=False)]
        gains = np.array(
            [gain([x[k] for x in known], truth, units) for k in range(1 + len(others))]
        )
        shrunk = [gains[:, None] * one for one in off]
        weights = weigh(gains[:, None] * np.concatenate(known, axis=1), np.concatenate(truth))
        both.append([
            base + np.vstack([one, weights @ one])
            for base, one in zip(rest[count:], shrunk[count:], strict=True)
        ])  # fmt: skip
    labels = [CONSTANT, *(name + SHRUNK for name in others), COMBINED]
    return [
        dict(zip(labels, np.stack(pair, axis=1), strict=True)) for pair in zip(*both, strict=True)
    ]
