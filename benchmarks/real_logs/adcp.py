"""ADCP: surge of a Seaglider against its on-board acoustic Doppler current profiler.

Surge is the horizontal velocity through the water along the heading, u_ttw sin(heading) + v_ttw
cos(heading): this definition reproduces the published figures. All samples of the profiler's table
deeper than 5 m are scored, at their own times. Flight model, regression, networks and their scales
are tuned without the dive that they are scored on.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.real_logs.folds import FoldJob, fit_fold, jobs
from benchmarks.real_logs.row import Method, Row, common, published_rows, rmse, rmse_rows
from benchmarks.real_logs.samples import LEAST_DEPTH, Samples, ridge, sample
from benchmarks.real_logs.source import Deployment, at_times, tables_with
from benchmarks.real_logs.surge_networks import Pretrained, predict_dive
from twin.identify import load_logs, motion_of
from twin.navigation.dead_reckoning import Array

TASK = "surge against ADCP"
COLUMNS = ("u_ttw", "v_ttw", "depth_m")
FACTORY = "fm_hspeed_ms"
"""[m/s] Column of the horizontal speed by the factory's flight model"""
LEAST_DIVES = 4
MOST_FOLDS = 12
"""Most dives that are held out one by one; more dives are held out in blocks"""
NOISE = (0.02, 0.03)
"""[m/s] Noise of the profiler's inverse solution, as its data set states"""
PUBLIC_INPUTS = ("pitch", "roll", "pump", "rate", "depth")
"""Inputs of the public ridge regression: pitch, roll, bladder, depth rate, depth"""
ON_TWIN = (*PUBLIC_INPUTS, "twin_net_mass", "twin_level", "twin_rise")
"""Inputs of ridge regression with the twin"""


Errors = dict[str, dict[int, Array]]
"""[m/s] Errors by method and row of the dive"""


def truth_of(deployment: Deployment) -> tuple[dict[int, Array], dict[int, Array]]:
    """Times [s] since the row's start and surge [m/s] of the profiler's samples, by row."""
    times: dict[int, list[Array]] = {}
    level: dict[int, list[Array]] = {}
    tables = tables_with(deployment, *COLUMNS)
    if not tables:
        return {}, {}
    for log in deployment.logs():
        clock = deployment.clock(log)
        for table in tables:
            time, east, north, depth = (table.columns[n] for n in ("time", *COLUMNS))
            use = (time >= clock[0]) & (time <= clock[-1]) & (depth > LEAST_DEPTH)
            use &= np.isfinite(east) & np.isfinite(north)
            if not use.any():
                continue
            heading = at_times(clock, log.heading, time[use])
            value = east[use] * np.sin(heading) + north[use] * np.cos(heading)
            times.setdefault(log.index, []).append(time[use] - clock[0])
            level.setdefault(log.index, []).append(value)
    found_times, found_level = {}, {}
    for row, pieces in times.items():
        together, order = np.unique(np.concatenate(pieces), return_index=True)
        found_times[row] = together
        found_level[row] = np.concatenate(level[row])[order]
    return found_times, found_level


def fold_jobs(deployment: Deployment, networks: Pretrained | None) -> list[Callable[[], Errors]]:
    """Make one job per held-out block; none without a profiler or with too few dives."""
    times, level = truth_of(deployment)
    if len(times) < LEAST_DIVES:
        return []
    folds = jobs(deployment, sorted(times), count=min(len(times), MOST_FOLDS))
    return [
        functools.partial(run_fold, fold, times, level, networks, number)
        for number, fold in enumerate(folds)
    ]


def run_fold(
    fold: FoldJob, times: Mapping[int, Array], level: Mapping[int, Array],
    networks: Pretrained | None, seed: int,
) -> Errors:  # fmt: skip
    """Tune all methods without the block, and predict the block.

    Args:
      times: [s] of the profiler's samples since the row's start, by row.
      level: [m/s] truth at these times.
      networks: networks trained on simulation; None: no networks are scored.
    """
    calibration = fit_fold(fold).calibration
    dives: dict[int, Samples] = {}
    errors: Errors = {}
    for log in load_logs(fold.store, sorted(times)):
        at, truth = times[log.index], level[log.index]
        dives[log.index] = sample(log, calibration, at, truth)
        if log.index in fold.block:
            own, _ = motion_of(log, calibration).level(log.roll, calibration.true_pitch(log.pitch))
            clock = log.period * np.arange(len(own), dtype=np.float64)
            errors.setdefault("twin", {})[log.index] = at_times(clock, own, at) - truth
    train = [dive for row, dive in dives.items() if row not in fold.block]
    tests = [dives[row] for row in fold.block if row in dives]
    wanted = np.concatenate([dive.level for dive in train])
    said = {}
    for name, columns in (("ridge", PUBLIC_INPUTS), ("ridge twin", ON_TWIN)):
        matrix = np.concatenate([dive.matrix(columns) for dive in train])
        said[name] = [ridge(matrix, wanted, dive.matrix(columns)) for dive in tests]
    if networks is not None:
        said |= predict_dive(train, tests, networks, seed)
    for name, found in said.items():
        errors[name] = {d.row: one - d.level for d, one in zip(tests, found, strict=True)}
    return errors


TITLES = {
    "twin": ("twin, flight model", "twin", "identified on depth rate and fixes, no ADCP"),
    "ridge": ("ridge regression", "public method", "public inputs, means over a minute, products"),
    "ridge twin": ("ridge regression on the twin", "twin", "the same with the twin's inputs"),
    "zero shot": ("network, zero shot", "network", "trained on simulation only; inputs of a log"),
    "real": ("network, real only", "network", "inputs of a log"),
    "sim real": ("network, simulation then real", "network", "inputs of a log"),
    "twin zero shot": ("network on the twin, zero shot", "network", "trained on simulation only"),
    "twin real": ("network on the twin, real only", "network", "inputs of a log and the twin's"),
    "twin sim real": (
        "network on the twin, simulation then real", "network", "inputs of a log and the twin's",
    ),
}  # fmt: skip
"""Name, kind and note of each method of `run_fold`."""


def rows_of(deployment: Deployment, held: Sequence[Errors]) -> list[Row]:
    """Rows of one deployment from all of its folds."""
    dives = sum(len(part["twin"]) for part in held)
    scheme = "leave one dive out" if dives == len(held) else f"{len(held)} blocks held out"
    methods = []
    factory = _factory(deployment)
    if factory:
        methods.append(
            Method(name="factory model", kind="public method", note="as logged", errors=factory)
        )
    for name, (title, kind, note) in TITLES.items():
        errors = {row: e for part in held for row, e in part.get(name, {}).items()}
        if errors:
            methods.append(Method(name=title, kind=kind, note=f"{note}; {scheme}", errors=errors))
    rows = [*published_rows(TASK, deployment.name), *rmse_rows(TASK, deployment.name, methods)]
    equal = common(methods)
    best = min(equal, key=lambda one: rmse(np.concatenate(list(one.errors.values()))))
    rows.append(_floor(deployment, list(best.errors.values())))
    return rows


def _floor(deployment: Deployment, pieces: Sequence[Array]) -> Row:
    """Lower bound of the error of any estimate: the profiler's noise.

    The noise is half the variance of differences of neighbouring errors, because an estimate's own
    error is smooth over minutes.
    """
    steps = np.concatenate([np.diff(piece[np.isfinite(piece)]) for piece in pieces])
    return Row(
        task=TASK,
        data=deployment.name,
        method="noise of the ADCP between neighbours",
        kind="floor",
        value=rmse(steps) / np.sqrt(2.0),
        samples=int(steps.size),
        note=f"from the best method's errors; the data states {NOISE[0]:g} to {NOISE[1]:g} m/s",
    )


def _factory(deployment: Deployment) -> dict[int, Array]:
    """Errors [m/s] of the factory's flight model at the same samples, by row."""
    times, level = truth_of(deployment)
    errors = {}
    for table in tables_with(deployment, FACTORY):
        time, speed = table.columns["time"], table.columns[FACTORY]
        for log in deployment.logs():
            clock = deployment.clock(log)
            use = (time >= clock[0]) & (time <= clock[-1]) & np.isfinite(speed)
            if log.index in times and use.sum() > 1:
                order = np.argsort(time[use])
                since = (time[use] - clock[0])[order]
                found = np.interp(times[log.index], since, speed[use][order])
                errors[log.index] = found - level[log.index]
    return errors
