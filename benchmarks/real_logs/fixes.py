"""Fixes: depth rate, and dead reckoning from one GPS fix to the next, of any buoyancy glider.

Methods are tuned by `twin identify` without options, on other dives than those that are scored: the
deployment's dives are held out in four blocks of consecutive dives. Fewer than four dives are tuned
on themselves, and the notes say so. Dead reckoning adds the depth-averaged current of the previous
dive (by the same method), if that dive ended less than an hour ago. Its error is the distance
between the reckoned and the received fix, divided by the hours between the fixes.

A Seaglider's base station writes speeds of its own flight model beside the samples. That model is
tuned to the trim of each dive, so it has seen the dives that it is scored on. Some of its speeds in
inflections are interpolated.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy.ndimage import minimum_filter1d

from benchmarks.real_logs.folds import Fitted, fit_fold, fold_of, jobs, later_job, own_trim
from benchmarks.real_logs.public import kinematic
from benchmarks.real_logs.row import Kind, Method, Row, median_rows, published_rows, rmse_rows
from benchmarks.real_logs.source import Deployment, tables_with
from benchmarks.real_logs.surge_networks import ZERO_SHOT, Pretrained, level_of
from twin.identify import Log, density_of, estimate
from twin.identify.speed import steady_parts
from twin.navigation.dead_reckoning import Array, integrate
from twin.records.store import open_store

RATE, TRACK = "depth rate", "dead reckoning between fixes"
RATE_GLIDING = "depth rate, gliding"
RATE_LATER = "depth rate, second half of the dives by the first"
RATE_FACTORY = "depth rate, where the factory's model has one"
STEADY, KINEMATIC = "steady flight model, two parameters", "w/tan(pitch + 3 deg)"
HOUR = 3600.0
COLUMN = "fm_vspeed_ms"
"""[m/s] Column of a table with the upward speed"""
VARIABLE, CLOCK = "vert_speed", "ctd_time"
"""[cm/s], [s] Upward speed and its times in a file of the base station"""
LONGEST_GAP = 30.0
"""[s] Longest time between samples with a speed that is bridged"""
LEAST_DIVES = 6
"""Fewest dives with fixes for a score of dead reckoning"""
Tracks = dict[int, Array]
"""Displacements through the water [m], north and east, (2,), or errors (time,), by row"""


def fold_jobs(deployment: Deployment) -> list[Callable[[], Fitted]]:
    """Identifications that a deployment needs."""
    rows = [log.index for log in deployment.logs()]
    held_out = [dataclasses.replace(job, blind=True) for job in jobs(deployment, rows)]
    every = [*held_out, *later_job(deployment, rows)]
    return [functools.partial(fit_fold, job) for job in every]


def rows_of(
    deployment: Deployment, fitted: Sequence[Fitted], networks: Pretrained | None
) -> list[Row]:
    """Rows of one deployment.

    Args:
      fitted: results of `fold_jobs`.
      networks: networks trained on simulation; None: no networks are scored.
    """
    logs = deployment.logs()
    return [
        *_rates(deployment, logs, fitted),
        *_later_rates(deployment, fitted),
        *_tracks(deployment, logs, fitted, networks),
    ]


# --- depth rate ---------------------------------------------------------------------------------


def _errors(log: Log, fold: Fitted) -> tuple[Array, Array]:
    """[m/s] Depth rate of the steady model and of the twin minus the log's, (time,) each."""
    where = np.where(log.use, 0.0, np.nan)
    public = fold.steady.bridged(log, log.pitch, density_of(log, fold.calibration))
    steady = log.filtered(public.sink) - log.depth_rate + where
    return steady, -estimate(log, fold.calibration).water_rise + where


def _pair(note: str, steady: Tracks, twin: Tracks) -> list[Method]:
    return [
        Method(name=STEADY, kind="public method", note=note, errors=steady),
        Method(name="twin", kind="twin", note=note, errors=twin),
    ]


def _rates(deployment: Deployment, logs: list[Log], fitted: Sequence[Fitted]) -> list[Row]:
    name = deployment.name
    seen = any(fold.seen for fold in fitted)
    tuned = "tuned on the same dives" if seen else "tuned on other dives"
    steady, twin, calm, model, own = {}, {}, {}, {}, {}
    for log in logs:
        fold = fold_of(fitted, log.index)
        steady[log.index], twin[log.index] = _errors(log, fold)
        calm[log.index] = np.where(steady_parts(log), 0.0, np.nan)
        if (sink := factory_sink(deployment, log)) is not None:
            where = np.where(log.use, 0.0, np.nan)
            model[log.index] = sink - log.depth_rate + where
            trimmed = own_trim(log, fold.calibration)
            own[log.index] = -estimate(log, trimmed).water_rise + where
    every, off = f"{tuned}; deeper than 3 m", f"{tuned}; 45 s and more off inflections"
    still = ({row: e + calm[row] for row, e in one.items()} for one in (steady, twin))
    rows = [
        *published_rows(RATE, name), *rmse_rows(RATE, name, _pair(every, steady, twin)),
        *rmse_rows(RATE_GLIDING, name, _pair(off, *still)),
    ]  # fmt: skip
    if model:
        note = "tuned by the base station, trim on each dive itself"
        dive = f"{tuned}, trim on the dive itself"
        rows += rmse_rows(RATE_FACTORY, name, [
            Method(name="factory model", kind="public method", note=note, errors=model),
            Method(name="twin, trim of the dive", kind="twin", note=dive, errors=own),
            Method(name="twin", kind="twin", note=tuned, errors=twin),
        ])  # fmt: skip
    return rows


def _later_rates(deployment: Deployment, fitted: Sequence[Fitted]) -> list[Row]:
    """Rows of the second half of the dives, by models tuned on the first half."""
    rows: list[Row] = []
    for fold in fitted:
        if fold.later:
            found = {log.index: _errors(log, fold) for log in deployment.logs(fold.block)}
            steady, twin = ({row: one[k] for row, one in found.items()} for k in (0, 1))
            note = "tuned on the first half of the dives; deeper than 3 m"
            rows += rmse_rows(RATE_LATER, deployment.name, _pair(note, steady, twin))
    return rows


# --- dead reckoning -----------------------------------------------------------------------------


def pairs(logs: Sequence[Log]) -> list[tuple[Log, Log]]:
    """Pairs of successive dives with fixes and a short time between."""
    return [
        (before, log)
        for before, log in itertools.pairwise(logs)
        if log.follows and log.displacement is not None and before.displacement is not None
    ]


def errors_per_hour(couples: Sequence[tuple[Log, Log]], tracks: Tracks) -> dict[int, Array]:
    """[m/h] Errors with the previous dive's current by the same method, (1,), by row."""
    found = {}
    for before, log in couples:
        current = (np.array(before.displacement) - tracks[before.index]) / before.duration
        reckoned = tracks[log.index] + current * log.duration
        missed = np.hypot(*(np.array(log.displacement) - reckoned))
        found[log.index] = np.array([missed / (log.duration / HOUR)])
    return found


def level_track(log: Log, level: Array) -> Array:
    """Displacement [m], (2,), of a horizontal speed along the measured heading."""
    velocity = np.stack([level * np.cos(log.heading), level * np.sin(log.heading)], axis=1)
    return integrate(velocity, log.period)[-1]


def _tracks(
    deployment: Deployment,
    logs: list[Log],
    fitted: Sequence[Fitted],
    networks: Pretrained | None,
) -> list[Row]:
    couples = pairs(logs)
    if len(couples) < LEAST_DIVES - 1:
        return []
    methods = []

    def put(name: str, kind: Kind, note: str, errors: dict[int, Array]) -> None:
        methods.append(Method(name=name, kind=kind, note=note, errors=errors))

    own = _onboard(deployment, couples)
    if own:
        put("on-board", "public method", "with the vehicle's own current", own)
    simple = {log.index: level_track(log, kinematic(log, log.pitch).level) for log in logs}
    put(KINEMATIC, "public method", "nothing tuned", errors_per_hour(couples, simple))
    steady: Tracks = {}
    for log in logs:
        fold = fold_of(fitted, log.index)
        public = fold.steady.bridged(log, log.pitch, density_of(log, fold.calibration)).level
        steady[log.index] = level_track(log, np.where(log.depth > 1.0, public, 0.0))
    put(STEADY, "public method", "tuned on other dives", errors_per_hour(couples, steady))
    for name, blind in (("twin, without fixes", True), ("twin, with fixes of other dives", False)):
        errors: dict[int, Array] = {}
        for couple in couples:
            # the previous dive has the same calibration, which was fitted without this dive
            fold = fold_of(fitted, couple[1].index)
            calibration = fold.blind if blind else fold.calibration
            twin = {log.index: estimate(log, calibration).track()[-1] for log in couple}
            errors |= errors_per_hour([couple], twin)
        note = "depth rate of other dives" if blind else "depth rate and fixes of other dives"
        put(name, "twin", f"tuned on {note}", errors)
    for kind in networks or {}:
        learned: Tracks = {}
        for log in logs:
            level = level_of(log, fold_of(fitted, log.index).calibration, networks, kind)
            learned[log.index] = level_track(log, np.where(log.depth > 1.0, level, 0.0))
        note = "trained on simulation only; compass as logged"
        put(ZERO_SHOT[kind], "network", note, errors_per_hour(couples, learned))
    published = published_rows(TRACK, deployment.name)
    return [*published, *median_rows(TRACK, deployment.name, "m h-1", methods)]


def _onboard(deployment: Deployment, couples: Sequence[tuple[Log, Log]]) -> dict[int, Array]:
    """Errors of the vehicle's own reckoning: its last position before the fix after the dive."""
    dataset = open_store(deployment.store)
    names = ("measured_onboard_north", "measured_onboard_east")
    errors: dict[int, Array] = {}
    for _, log in couples if all(name in dataset for name in names) else ():
        track = np.stack([dataset[n].values[log.index] for n in names], axis=1)
        known = np.flatnonzero(np.isfinite(track).all(axis=1))
        missed = np.nan
        if known.size:
            missed = float(np.hypot(*(np.array(log.displacement) - track[known[-1]])))
        errors[log.index] = np.array([missed / (log.duration / HOUR)])
    dataset.close()
    return errors if any(np.isfinite(e).any() for e in errors.values()) else {}


# --- speeds of the base station ------------------------------------------------------------------


def factory_sink(deployment: Deployment, log: Log) -> Array | None:
    """Downward speed [m/s] of the factory's model at a log's samples, (time,), filtered like the
    log's depth rate; NaN far from its speeds. None for a dive without any."""
    clock = deployment.clock(log)
    for time, rate in _speeds(deployment):
        known = np.isfinite(time) & np.isfinite(rate) & (rate != 0.0)  # 0: the model found no speed
        known &= (time >= clock[0] - LONGEST_GAP) & (time <= clock[-1] + LONGEST_GAP)
        if known.sum() < log.window:
            continue
        when, first = np.unique(time[known], return_index=True)
        after = np.clip(np.searchsorted(when, clock), 1, len(when) - 1)
        close = (when[after] - when[after - 1] <= LONGEST_GAP) & (clock >= when[0])
        close &= clock <= when[-1]
        whole = minimum_filter1d(close.astype(np.int8), log.window) > 0
        sink = log.filtered(-np.interp(clock, when, rate[known][first]))
        return np.where(whole, sink, np.nan)
    return None


def _speeds(deployment: Deployment) -> Iterator[tuple[Array, Array]]:
    """Times [s] and upward speeds [m/s] of the deployment's tables and files."""
    for table in tables_with(deployment, COLUMN):
        yield table.columns["time"], table.columns[COLUMN]
    number = "".join(c for c in deployment.name if c.isdigit())
    for path in sorted(deployment.folder.glob(f"p{number}*.nc")):
        from netCDF4 import Dataset

        with Dataset(path) as file:
            if VARIABLE in file.variables and CLOCK in file.variables:
                time, rate = (
                    np.ma.filled(file[name][:].astype(float), np.nan) for name in (CLOCK, VARIABLE)
                )
                yield time, rate / 100.0
