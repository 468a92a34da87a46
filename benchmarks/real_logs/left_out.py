"""Left out: speed of a deployment by models trained on simulation and on other deployments.

Each deployment's flight models are identified on its own depth rate and fixes, which every log has.
Its velocities are not used for training. The truth is a horizontal speed along the heading, as
one-minute means: the profiler's surge (`benchmarks.real_logs.adcp`), or a Doppler log's speed
through the water without its vertical component, the depth rate.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from benchmarks.real_logs import adcp, dvl
from benchmarks.real_logs.folds import FoldJob, fit_fold, thinned
from benchmarks.real_logs.row import Method, Row, central, common, pooled_draws, rmse_rows
from benchmarks.real_logs.samples import AVERAGE, Samples, averaged, ridge, sample
from benchmarks.real_logs.source import Deployment, at_times
from benchmarks.real_logs.surge_networks import TUNED, Pretrained, fit_member, mean_of
from twin.identify import Log, density_of
from twin.navigation.dead_reckoning import Array

TASK = "one deployment left out"
RATIO = "one deployment left out, over the twin"
TOGETHER = "both"
"""Name of a table's last line: all deployments with equal weights"""
TWIN = "twin alone"
ON_TWIN = "twin "
"""Kind of network, see `surge_networks.INPUTS`"""
WHOLE = 0.5
"""[1] Least fraction of a minute with samples of a Doppler log, for its mean to count"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Labelled:
    """Deployment with velocities, and its flight models."""

    name: str
    dives: tuple[Samples, ...]
    steady: tuple[Array, ...]
    """[m/s] Horizontal speed of the steady flight model at the samples of each dive"""


def prepare(deployment: Deployment) -> Labelled | None:
    """Identify the models on the deployment's own depth rate and fixes, and sample its dives.

    The result is None without velocities.
    """
    times, level = adcp.truth_of(deployment)
    if not times:
        times, level = doppler_minutes(deployment)
    if not times:
        return None
    rows = deployment.rows
    fitted = fit_fold(FoldJob(store=deployment.store, block=rows, train=tuple(thinned(rows))))
    dives, steady = [], []
    for log in deployment.logs(sorted(times)):
        at = times[log.index]
        dives.append(sample(log, fitted.calibration, at, level[log.index]))
        public = fitted.steady.bridged(log, log.pitch, density_of(log, fitted.calibration))
        steady.append(averaged(public.level, log.period, at))
    return Labelled(name=deployment.name, dives=tuple(dives), steady=tuple(steady))


def doppler_minutes(deployment: Deployment) -> tuple[dict[int, Array], dict[int, Array]]:
    """Times [s] since the row's start and one-minute means of horizontal speed [m/s], by row."""
    truth = dvl.read_truth(deployment)
    if truth is None:
        return {}, {}
    times, level = {}, {}
    for log in deployment.logs():
        clock = deployment.clock(log)
        inside = (truth.time >= clock[0]) & (truth.time <= clock[-1])
        if inside.any():
            since = truth.time[inside] - clock[0]
            speed = level_of_speed(log, since, truth.speed[inside])
            centres, means = minute_means(since, speed)
            if centres.size:
                times[log.index], level[log.index] = centres, means
    return times, level


def level_of_speed(log: Log, since: Array, speed: Array) -> Array:
    """Horizontal component [m/s] of a speed through the water at times [s] since the row's start.
    The vertical component is the depth rate, so that the pitch sensor has no influence."""
    clock = log.period * np.arange(len(log.depth), dtype=np.float64)
    rate = at_times(clock, log.depth_rate, since)
    return np.asarray(np.sqrt(np.maximum(speed**2 - rate**2, 0.0)), float)


def minute_means(since: Array, values: Array) -> tuple[Array, Array]:
    """Centres [s] of the whole minutes after the first sample, and the mean of each; minutes with
    gaps are left out."""
    minute = ((since - since[0]) / AVERAGE).astype(int)
    counts = np.bincount(minute)[: int((since[-1] - since[0]) / AVERAGE)]
    sums = np.bincount(minute, values)[: counts.size]
    step = float(np.median(np.diff(since))) if since.size > 1 else AVERAGE
    whole = counts * step >= WHOLE * AVERAGE
    centres = since[0] + AVERAGE * (np.arange(counts.size) + 0.5)
    return centres[whole], sums[whole] / counts[whole]


@dataclasses.dataclass(frozen=True)
class LeftOutJob:
    """One left-out deployment, in a form that can be sent to a process."""

    train: tuple[Samples, ...]
    """Dives of the other deployments"""
    tested: Labelled
    networks: Pretrained | None
    """Networks trained on simulation; None: no networks are scored"""
    seed: int = 0


def jobs(labelled: Sequence[Labelled], networks: Pretrained | None) -> list[LeftOutJob]:
    """Make one job per deployment; none if there is no other deployment to train on."""
    if len(labelled) < 2:
        return []
    return [
        LeftOutJob(
            tuple(dive for other in labelled if other is not one for dive in other.dives),
            one,
            networks,
            number,
        )
        for number, one in enumerate(labelled)
    ]


def run(job: LeftOutJob) -> list[Method]:
    """Errors [m/s] of every method on the left-out deployment."""
    tests = job.tested.dives
    methods = []

    def put(name: str, kind: str, note: str, found: Sequence[Array]) -> None:
        errors = {d.row: f - d.level for d, f in zip(tests, found, strict=True)}
        methods.append(Method(name=name, kind=kind, note=note, errors=errors))

    own = "identified on the deployment's own depth rate"
    put("steady flight model", "public method", own, job.tested.steady)
    put(TWIN, "twin", f"{own} and fixes", [dive.inputs["twin_level"] for dive in tests])
    matrix = np.concatenate([dive.matrix(adcp.ON_TWIN) for dive in job.train])
    wanted = np.concatenate([dive.level for dive in job.train])
    regressed = [ridge(matrix, wanted, dive.matrix(adcp.ON_TWIN)) for dive in tests]
    put("ridge on the twin", "twin", "trained on the other deployment", regressed)
    if job.networks is not None:
        first = job.networks[ON_TWIN]
        zero = mean_of(first, tests)
        put("network on the twin, zero shot", "network", "trained on simulation only", zero)
        tuned = [
            fit_member(job.train, ON_TWIN, member, TUNED, seed=job.seed, start=start)
            for member, start in enumerate(first)
        ]
        name = "network on the twin, simulation then the other"
        put(name, "network", "simulation, then the other deployment", mean_of(tuned, tests))
    return methods


def rows_of(names: Sequence[str], found: Sequence[Sequence[Method]]) -> list[Row]:
    """Rows of each deployment, of all with equal weights, and of ratios to the twin's error."""
    rows = [
        r
        for name, methods in zip(names, found, strict=True)
        for r in rmse_rows(TASK, name, methods)
    ]
    equal = [common(methods) for methods in found]
    pooled = {
        methods[0].name: pooled_draws([list(one.errors.values()) for one in methods])
        for methods in zip(*equal, strict=True)
    }
    for one in equal[0]:
        sizes = [e.size for methods in equal for e in methods[0].errors.values()]
        whole = Row(
            task=TASK, data=TOGETHER, method=one.name, kind=one.kind,
            samples=sum(sizes), dives=len(sizes), note=f"{one.note}; deployments weigh the same",
        )  # fmt: skip
        draws = pooled[one.name]
        low, high = central(draws[1:])
        rows.append(dataclasses.replace(whole, value=float(draws[0]), low=low, high=high))
        if one.name != TWIN:
            over = draws / pooled[TWIN]
            low, high = central(over[1:])
            rows.append(
                dataclasses.replace(
                    whole, task=RATIO, unit="1", value=float(over[0]), low=low, high=high
                )
            )
    return rows
