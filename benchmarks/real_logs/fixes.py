"""Fixes: depth rate, and dead reckoning from one GPS fix to the next, of any buoyancy glider.

Everything is tuned on other dives than those it is scored on: the deployment's dives are held out
in four blocks of consecutive ones. Dead reckoning adds the depth-averaged current of the dive
before (by the same method), if that dive ended less than an hour ago; its error is the distance
between the reckoned and the received fix, per hour between the fixes.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from benchmarks.real_logs.folds import LEAST_ROWS, Fitted, FoldJob, fold_of, jobs
from benchmarks.real_logs.public import kinematic
from benchmarks.real_logs.published import published_rows
from benchmarks.real_logs.row import Row, rmse
from benchmarks.real_logs.source import Deployment, at_times, tables_with
from benchmarks.real_logs.surge_networks import ZERO_SHOT, Pretrained, level_of
from learn.navigation.dead_reckoning import Array, integrate
from twin.identify import Log, density_of, estimate
from twin.identify.speed import steady_parts
from twin.records.store import open_store

RATE, TRACK = "depth rate", "dead reckoning between fixes"
HOUR = 3600.0
VEHICLE = "graver-2005"
"""Where identification starts, whatever the glider: the shipped file that is nearest to all."""
LEAST_DIVES = 6
"""Dives with fixes below which no dead reckoning is scored."""
FACTORY_RATE = "fm_vspeed_ms"
"""[m/s] upward, of the Seaglider's own flight model"""
LONGEST_GAP = 30.0
"""[s] between samples of a table whose slope is a depth rate."""

Tracks = dict[int, Array]
"""Displacement through the water [m], north and east, (2,), by row."""


def fold_jobs(deployment: Deployment) -> list[FoldJob]:
    """The identifications that this deployment needs; none for one with too few dives."""
    logs = deployment.logs()
    rows = [log.index for log in logs]
    return jobs(deployment, rows, VEHICLE) if len(rows) >= LEAST_ROWS else []


def rows_of(
    deployment: Deployment, fitted: Sequence[Fitted], networks: Pretrained | None
) -> list[Row]:
    """Rows of one deployment.

    Args:
      fitted: of every job of `fold_jobs`.
      networks: trained on simulation; None: no networks are judged.
    """
    logs = deployment.logs()
    return [*_rates(deployment, logs, fitted), *_tracks(deployment, logs, fitted, networks)]


# --- depth rate ---------------------------------------------------------------------------------


def _rates(deployment: Deployment, logs: list[Log], fitted: Sequence[Fitted]) -> list[Row]:
    name = deployment.name

    def row(method: str, kind: str, errors: list[Array], note: str) -> Row:
        every = np.concatenate(errors)
        return Row(
            task=RATE,
            data=name,
            method=method,
            kind=kind,  # type: ignore[arg-type]
            value=rmse(every),
            samples=int(every.size),
            note=note,
        )

    rows = published_rows(RATE, name)
    held_out = "tuned on other dives; all samples deeper than 3 m"
    steady, twin, gliding = [], [], []
    for log in logs:
        fold = fold_of(fitted, log.index)
        calibration = fold.calibration
        pitch, density = log.pitch, density_of(log, calibration)
        public = fold.steady.bridged(log, pitch, density)
        steady.append((log.filtered(public.sink) - log.depth_rate)[log.use])
        rise = -estimate(log, calibration).water_rise
        twin.append(rise[log.use])
        gliding.append(rise[log.use & steady_parts(log)])
    rows.append(row("steady flight model, two parameters", "public method", steady, held_out))
    factory = _factory(deployment, logs, fitted)
    rows.append(row("twin, flight model", "twin", twin, held_out))
    rows.append(
        row("twin, flight model, gliding only", "twin", gliding, "45 s and more off inflections")
    )
    if factory is not None:
        theirs, ours = factory
        note = "at the table's own samples where the factory's model has a speed"
        rows.append(row("factory flight model", "public method", [theirs], note))
        rows.append(row("twin, at the same samples", "twin", [ours], note))
    return rows


def _factory(
    deployment: Deployment, logs: list[Log], fitted: Sequence[Fitted]
) -> tuple[Array, Array] | None:
    """Errors [m/s] of the factory's model and of the twin at the samples of the table."""
    theirs, ours = [], []
    for table in tables_with(deployment, FACTORY_RATE, "depth_m"):
        time, depth, speed = (table.columns[n] for n in ("time", "depth_m", FACTORY_RATE))
        for log in logs:
            clock = deployment.clock(log)
            inside = (time >= clock[0]) & (time <= clock[-1]) & np.isfinite(depth)
            if inside.sum() < LEAST_DIVES:
                continue
            order = np.argsort(time[inside], kind="stable")
            t, z, w = (v[inside][order] for v in (time, depth, speed))
            t, first = np.unique(t, return_index=True)
            z, w = z[first], w[first]
            rate = np.gradient(z, t)
            sink = estimate(log, fold_of(fitted, log.index).calibration).sink_rate
            use = np.isfinite(w) & (w != 0.0) & (z > 3.0) & (np.gradient(t) < LONGEST_GAP)
            theirs.append((-w - rate)[use])
            ours.append((at_times(clock, sink, t) - rate)[use])
    if not theirs:
        return None
    first_errors, second_errors = np.concatenate(theirs), np.concatenate(ours)
    both = np.isfinite(first_errors) & np.isfinite(second_errors)
    return (first_errors[both], second_errors[both]) if both.any() else None


# --- dead reckoning -----------------------------------------------------------------------------


def pairs(logs: Sequence[Log]) -> list[tuple[Log, Log]]:
    """Dives with fixes and the one before each, where it ended shortly before."""
    return [
        (before, log)
        for before, log in itertools.pairwise(logs)
        if log.follows and log.displacement is not None and before.displacement is not None
    ]


def errors_per_hour(couples: Sequence[tuple[Log, Log]], tracks: Tracks) -> Array:
    """[m/h], (pairs,): the previous dive's current, by the same method."""
    found = []
    for before, log in couples:
        current = (np.array(before.displacement) - tracks[before.index]) / before.duration
        reckoned = tracks[log.index] + current * log.duration
        missed = np.hypot(*(np.array(log.displacement) - reckoned))
        found.append(missed / (log.duration / HOUR))
    return np.array(found)


def level_track(log: Log, level: Array) -> Array:
    """Displacement [m], (2,), of a horizontal speed along the measured heading."""
    velocity = np.stack([level * np.cos(log.heading), level * np.sin(log.heading)], axis=1)
    return integrate(velocity, log.period)[-1]


def track_row(
    deployment: Deployment,
    couples: Sequence[tuple[Log, Log]],
    tracks: Tracks,
    method: str,
    kind: str,
    note: str,
) -> Row:
    """Median over dives of the error per hour."""
    errors = errors_per_hour(couples, tracks)
    return Row(
        task=TRACK,
        data=deployment.name,
        method=method,
        kind=kind,  # type: ignore[arg-type]
        value=float(np.median(errors)),
        unit="m h-1",
        samples=errors.size,
        note=f"{note}; {_spread(errors)}",
    )


def _tracks(
    deployment: Deployment,
    logs: list[Log],
    fitted: Sequence[Fitted],
    networks: Pretrained | None,
) -> list[Row]:
    couples = pairs(logs)
    if len(couples) < LEAST_DIVES - 1:
        return []
    rows = published_rows(TRACK, deployment.name)
    own = _onboard(deployment, couples)
    if own is not None:
        rows.append(own)
    simple = {log.index: level_track(log, kinematic(log, log.pitch).level) for log in logs}
    rows.append(
        track_row(
            deployment, couples, simple, "w/tan(pitch + 3 deg)", "public method", "nothing tuned"
        )
    )
    steady: Tracks = {}
    for log in logs:
        fold = fold_of(fitted, log.index)
        density = density_of(log, fold.calibration)
        public = fold.steady.bridged(log, log.pitch, density).level
        steady[log.index] = level_track(log, np.where(log.depth > 1.0, public, 0.0))
    rows.append(
        track_row(
            deployment, couples, steady, "steady flight model, two parameters", "public method",
            "tuned on other dives",
        )
    )  # fmt: skip
    errors = []
    for couple in couples:
        # the dive before is reckoned with the same calibration: neither has seen this dive
        calibration = fold_of(fitted, couple[1].index).calibration
        twin = {log.index: estimate(log, calibration).track()[-1] for log in couple}
        errors.append(errors_per_hour([couple], twin)[0])
    found = np.array(errors)
    rows.append(
        Row(
            task=TRACK,
            data=deployment.name,
            method="twin, flight model and compass",
            kind="twin",
            value=float(np.median(found)),
            unit="m h-1",
            samples=found.size,
            note=f"tuned on other dives; {_spread(found)}",
        )
    )
    for kind in networks or {}:
        assert networks is not None
        learned: Tracks = {}
        for log in logs:
            level = level_of(log, fold_of(fitted, log.index).calibration, networks, kind)
            learned[log.index] = level_track(log, np.where(log.depth > 1.0, level, 0.0))
        note = "trained on simulation only; compass as logged"
        rows.append(track_row(deployment, couples, learned, ZERO_SHOT[kind], "network", note))
    return rows


def _spread(errors: Array) -> str:
    return f"mean {errors.mean():.0f}, p90 {np.percentile(errors, 90):.0f}"


def _onboard(deployment: Deployment, couples: Sequence[tuple[Log, Log]]) -> Row | None:
    """The vehicle's own reckoning: its last position before the fix that ends the dive."""
    dataset = open_store(deployment.store)
    names = ("measured_onboard_north", "measured_onboard_east")
    if any(name not in dataset for name in names):
        return None
    errors = []
    for _, log in couples:
        track = np.stack([dataset[n].values[log.index] for n in names], axis=1)
        known = np.flatnonzero(np.isfinite(track).all(axis=1))
        if known.size:
            missed = np.hypot(*(np.array(log.displacement) - track[known[-1]]))
            errors.append(missed / (log.duration / HOUR))
    dataset.close()
    if not errors:
        return None
    return Row(
        task=TRACK,
        data=deployment.name,
        method="on-board",
        kind="public method",
        value=float(np.median(errors)),
        unit="m h-1",
        samples=len(errors),
        note=f"its own current; mean {np.mean(errors):.0f}",
    )
