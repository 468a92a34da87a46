"""Surfacings: forecasts of surfacings and currents on real deployments, with others' priors.

    python -m benchmarks.surfacings FOLDER [--shipped | --priors | --times] [--waypoints 1]
        [--json]

FOLDER holds stores of logs, or folders of logs whose names begin with their format (slocum_...,
seaglider_..., seaexplorer_...), which are imported. The priors before the first dive (`Priors`) are
learned for each deployment from the others. The deployment is then forecast dive by dive, from the
second to the last. `--shipped` takes the shipped priors instead, for deployments that did not train
them; `--priors` prints those of all in the folder. `--waypoints 1` uses only the first of a dive's
waypoints.

A row has the forecast's error, that of the deployment's best rival, their ratio with its 95 %
bootstrap interval over dives, and the fraction of fixes inside the ellipses. For currents there is
also the ratio to the best single model of the pool, chosen in hindsight. For surfacings it has the
error of the vehicle's own track at the end of the dive, which uses the dive's flight and duration.
Groups are by the source of the track through the water; a satellite log has the current alone.

`--times` forecasts, from the fifth dive on, the times of the next, the second and the fourth
surfacing of each deployment. It uses surface intervals and the regularity of the dives so far
(`Rhythm`). Surfacings after a gap in the log are left out. Printed are the fraction of times within
the 90 % interval, its median width, and the median error of its middle. The rival has dives without
surface intervals, of the median duration of the last five.
"""

from __future__ import annotations

import dataclasses
import functools
import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

from benchmarks import command
from factory.importing import import_logs
from glider_twin_ops.forecast import DeploymentHindcast, Judged, Priors, Scores, hindcast, scores_of
from glider_twin_ops.forecast.expected_dive import Rhythm, SurfacingSchedule
from glider_twin_ops.forecast.logged_leg import REPORTED, DiveTime, dive_times
from glider_twin_ops.forecast.pool import BESIDE, FIELD, FILTER, CurrentPool, Prior
from glider_twin_ops.forecast.walk import Pair, bootstrap
from twin.errors import InputError, TwinError
from twin.navigation.current import Reaches
from twin.records.logged import LogStore
from twin.records.presence import is_store
from twin.records.store import write_store

KINDS = ("slocum", "seaglider", "seaexplorer")
LOGS = frozenset({".sbd", ".dbd", ".nc", ".parquet", ".csv", ".gz"})
NEUTRAL = 0.1
"""[m/s], or [1] of a duration: scale of every model's errors before anything is learned"""
LEAST = 5
"""Fewest dives of a deployment that contributes to the priors"""
ALIVE = 0.02
"""[1] Addition to a learned weight, so that no model is excluded"""
SAID = 20
"""Scored surfacings from which a deployment has its own row"""
CONFIDENCE = 0.99
"""[1] Confidence of the intervals that must contain the coverages"""
AHEAD = (1, 2, 4)
KNOWN, DRAWS, ASKED = 4, 400, 8
"""Dives before the first forecast, sample count, and number of forecasts per deployment"""
MINUTE = 60.0


def stores_in(folder: Path, work: Path) -> list[Path]:
    """Stores of a folder, or imported from its folders of logs.

    Raises:
      InputError: the folder has neither.
    """
    if not folder.is_dir():
        raise InputError(f"no folder {folder}: give one that holds stores of logs, or logs")
    stores = sorted(path for path in folder.iterdir() if is_store(path))
    if stores:
        return stores
    shelf = work / "caches"
    shelf.mkdir()
    for path in sorted(folder.rglob("*.cac")):  # one deployment may need another's sensor list
        shutil.copyfile(path, shelf / path.name)
    for top in sorted(path for path in folder.iterdir() if path.is_dir()):
        kind = top.name.split("_")[0].lower()
        if kind not in KINDS:
            continue
        holding = {path.parent for path in top.rglob("*") if path.suffix.lower() in LOGS}
        if top in holding:
            holding = {top}  # its subfolders have raw files of the same dives
        for number, place in enumerate(sorted(holding)):
            try:
                dataset, _ = import_logs(kind, [place], cache=shelf if kind == "slocum" else None)
            except TwinError as error:
                print(f"left out: {place}: {error}", file=sys.stderr)
                continue
            stores.append(work / f"{top.name}-{number}.zarr")
            write_store(dataset, stores[-1])
    if not stores:
        raise InputError(f"{folder} holds neither stores of logs nor folders {KINDS}_...")
    return stores


def neutral() -> Priors:
    """Priors before any deployment: equal weights and neutral scales."""
    shipped = Priors()

    def alike(priors: Mapping[str, Prior]) -> dict[str, Prior]:
        return {n: Prior(1.0, 1.0 if n in (FILTER, BESIDE) else NEUTRAL) for n in priors}

    pools = {name: alike(getattr(shipped, name)) for name in ("current", "way", "schedule")}
    return dataclasses.replace(shipped, **pools)


def learned(deployments: Sequence[DeploymentHindcast]) -> Priors:
    """Fit priors to deployments that were forecast with neutral priors.

    A model's weight is its share in explaining the dives, its scale the geometric mean, with equal
    weight for each deployment. The reaches are quantiles over all scored dives.
    """
    taught = [one for one in deployments if len(one.legs) >= LEAST]
    start = neutral()

    def pooled(pool: str, kept: str, before: Mapping[str, Prior]) -> dict[str, Prior]:
        found = {}
        for name, prior in before.items():
            weights = [one.walked.weights[pool].get(name) for one in taught]
            scales = [getattr(one.walked, kept).pool.scales.get(name) for one in taught]
            known = [value for value in weights if value is not None]
            if name in (FIELD, BESIDE) or not known:
                found[name] = prior
                continue
            scale = float(np.exp(np.mean(np.log([value for value in scales if value is not None]))))
            found[name] = Prior(round(float(np.mean(known)) + ALIVE, 2), float(f"{scale:.2g}"))
        return found

    def reach(which: str) -> Pair:
        distances = [j.distance for one in taught for j in judged(one, which)]
        half, ninety = Reaches.of(distances).now
        return float(f"{half:.2g}"), float(f"{ninety:.2g}")

    kept = {"current": "pool", "way": "ways", "schedule": "schedule"}
    pools = {name: pooled(name, at, getattr(start, name)) for name, at in kept.items()}
    reaches = {f"{which}_reach": reach(which) for which in ("surfacing", "current")}
    return Priors(**pools, **reaches)


def judged(one: DeploymentHindcast, which: str) -> list[Judged]:
    """Scored forecasts of a deployment."""
    return [getattr(each, which) for each in one.surfacings if each.scored]


@functools.cache
def alone(one: DeploymentHindcast) -> dict[str, float]:
    """Mean error [m/h] of each single model of the current, over the scored dives."""
    legs = [each.leg for each in one.legs]
    latitude = float(np.median([each.begin[0] for each in one.legs]))
    pool, missed = CurrentPool(latitude=latitude, time=legs[0].start), []
    for k, leg in enumerate(legs):
        if k >= max(one.train, 1):
            off = [pool.alone(name, leg)[0] - leg.current for name in pool.pool.names]
            missed.append(3600.0 * np.hypot(*np.array(off).T))
        pool.learn(leg)
    return dict(zip(pool.pool.names, np.mean(missed, axis=0).tolist(), strict=True))


def label(one: DeploymentHindcast) -> str:
    """Name, year and month of a deployment, since a vehicle has several."""
    month = str(np.datetime64(round(one.legs[0].leg.start), "s"))[:7]
    return f"{one.name} {month}"


def row(
    name: str, scores: Scores, ones: Sequence[DeploymentHindcast], which: str
) -> dict[str, Any]:
    """Table row of some deployments, by name."""
    runs = [judged(one, which) for one in ones]
    found = {"deployment": name, **scores.describe()}
    found |= {"rival": scores.rival, "ratio": scores.ratio, "interval": scores.ratio_interval}
    tail = 0.5 * (1.0 - CONFIDENCE)
    for k, part in ((0, 0.5), (1, 0.9)):
        low, high = binom.interval(CONFIDENCE, scores.segments, part)
        found[f"binomial_{100 * part:.0f}"] = [low / scores.segments, high / scores.segments]
        held = np.array([each.held[k] for run in runs for each in run], float)
        found[f"resampled_{100 * part:.0f}"] = bootstrap(
            [len(run) for run in runs],
            lambda rows, held=held: float(held[rows].mean()),
            (100.0 * tail, 100.0 * (1.0 - tail)),
        )
    if which == "surfacing":
        own = [j.error("onboard") for one in ones for j in judged(one, "current")]
        own = [value for value in own if np.isfinite(value)]
        found["own_track_afterwards"] = float(np.mean(own)) if own else None
    else:
        counts = [len(run) for run in runs]
        singles = {
            model: float(np.average([each[model] for each in map(alone, ones)], weights=counts))
            for model in alone(ones[0])
        }
        best = min(singles, key=lambda model: singles[model])
        forecast = scores.mean["forecast"] or 0.0
        found |= {"single": best, "by_single": forecast / singles[best]}
    return found


def table(ones: Sequence[DeploymentHindcast], which: str) -> list[dict[str, Any]]:
    """Rows for each deployment, for each group, and for all."""
    satellite = [one for one in ones if {leg.method for leg in one.legs} == {REPORTED}]
    groups = {
        "satellite logs": satellite,
        "logs with attitude": [one for one in ones if one not in satellite],
        "all": list(ones),
    }
    rows = [row(label(one), getattr(one, which), [one], which) for one in ones]
    for name, members in groups.items():
        if len(members) > 1:
            scores = scores_of([judged(one, which) for one in members])
            rows.append(row(name, scores, members, which))
    return rows


def markdown(rows: Sequence[Mapping[str, Any]], which: str) -> str:
    """Make a page's table in Markdown."""
    last = "own track afterwards" if which == "surfacing" else "by the best single model"
    head = [which, "scored", "forecast", "best rival", "its error", "ratio (95 %)", "in 50 %",
            "in 90 %", last]  # fmt: skip
    lines = []
    for one in rows:
        interval = "({:.2f} to {:.2f})".format(*one["interval"]) if one["interval"] else ""
        own = one.get("own_track_afterwards")
        end = "" if own is None else f"{own:.0f}"
        end = f"{one['by_single']:.2f}" if which == "current" else end
        lines.append([
            one["deployment"], one["segments"], f"{one['mean_m_per_h']['forecast']:.0f}",
            one["rival"].replace("_", " "), f"{one['mean_m_per_h'][one['rival']]:.0f}",
            f"{one['ratio']:.2f} {interval}".strip(), f"{one['coverage_50']:.2f}",
            f"{one['coverage_90']:.2f}", end,
        ])  # fmt: skip
    return command.markdown(head, lines)


# --- times ----------------------------------------------------------------------------------------


def told(dives: Sequence[DiveTime]) -> list[tuple[int, bool, float, float, float]]:
    """Score forecasts: surfacings ahead, whether the interval held the time, its width [s], error
    of its middle [s] and that of the rival [s]."""
    schedule, rng = SurfacingSchedule(), np.random.default_rng(0)
    found = []
    for k, dive in enumerate(dives):
        rhythm = Rhythm.of(schedule, dives[:k]) if k >= KNOWN else None
        if rhythm is not None:
            drawn = rhythm.draw(DRAWS, max(AHEAD), 0.0, rng)
            usual = float(np.median([one.end - one.begin for one in dives[max(0, k - 5) : k]]))
            ends = np.cumsum(drawn.stays + usual * (1.0 + drawn.late[:, None]), axis=1)
            for ahead in AHEAD:
                stays = [one.stay for one in dives[k : k + ahead]]
                if len(stays) < ahead or not np.isfinite(stays).all():
                    continue  # after the log, or after a gap with a possible surfacing
                came = dives[k + ahead - 1].end - dives[k - 1].end
                low, middle, high = np.quantile(ends[:, ahead - 1], [0.05, 0.5, 0.95])
                off, rival = abs(came - middle), abs(came - ahead * usual)
                found.append((ahead, bool(low <= came <= high), high - low, off, rival))
        schedule.learn(dive)
    return found


def rows_of(name: str, found: Sequence[tuple[int, bool, float, float, float]]) -> dict[str, Any]:
    """Row of the table of times."""
    row: dict[str, Any] = {"deployment": name}
    for ahead in AHEAD:
        some = np.array([one[1:] for one in found if one[0] == ahead])
        held, width, off, rival = (
            (some[:, 0].mean(), *np.median(some[:, 1:], axis=0) / MINUTE)
            if len(some)
            else [float("nan")] * 4
        )
        row |= {
            f"{ahead}: in 90 %": round(float(held), 2),
            "width [min]" if ahead == 1 else f"width {ahead}": round(float(width)),
            "off [min]" if ahead == 1 else f"off {ahead}": round(float(off), 1),
            "rival [min]" if ahead == 1 else f"rival {ahead}": round(float(rival), 1),
        }
    return {**row, "surfacings": sum(one[0] == 1 for one in found)}


def times_of(stores: Sequence[Path]) -> list[dict[str, Any]]:
    """Rows of times for each deployment, and for all."""
    rows, every = [], []
    for store in stores:
        with LogStore(store) as logs:
            for name in dict.fromkeys(logs.deployments):
                dives = dive_times(logs, name).dives
                if len(dives) >= ASKED:
                    found = told(dives)
                    every += found
                    rows.append(rows_of(name, found))
    return [*rows, rows_of("all", every)]


def main(
    folder: command.Positional[Path],
    *,
    shipped: bool = False,
    waypoints: int | None = None,
    priors: bool = False,
    times: bool = False,
    json: bool = False,
) -> None:
    """Print the tables, the priors of all deployments, or the times alone."""
    with tempfile.TemporaryDirectory() as work:
        stores = stores_in(folder, Path(work))
        if times:
            rows = times_of(stores)
            command.say(rows, rows, json=json)
            return
        first = hindcast(
            stores, priors=None if shipped else neutral(), waypoints=waypoints
        ).deployments
        if priors:
            print(learned(first))
            return
        second = first
        if not shipped:
            second = tuple(
                again
                for one in first
                for again in hindcast(
                    [one.store],
                    priors=learned([each for each in first if each is not one]),
                    waypoints=waypoints,
                ).deployments
                if again.name == one.name
            )
        second = tuple(one for one in second if one.surfacing.segments)
    tables = {which: table(second, which) for which in ("surfacing", "current")}
    if json:
        print(dumps(tables))
        return
    for which, rows in tables.items():
        lost = [f"{one['deployment']} {one['ratio']:.2f}" for one in rows if one["ratio"] > 1.0]
        worse = f"{which}: worse than the best rival on {', '.join(lost) or 'none of them'}"
        print(markdown(rows, which), worse, sep="\n\n", end="\n\n")


if __name__ == "__main__":
    sys.exit(command.run(main))
