"""Surfacings: forecasts of surfacings and currents on real deployments, with others' priors.

    python -m benchmarks.surfacings FOLDER [--shipped | --priors | --times] [--waypoints 1]
        [--json]

FOLDER holds stores of logs, or folders of logs whose names begin with their kind (slocum_...,
seaglider_..., seaexplorer_...), which are imported. Each deployment is left out once: the priors of
all models (`Priors`) are learned from the others, then every surfacing from its second dive to its
last is forecast. `--shipped` takes the shipped priors instead, for deployments that did not teach
them; `--priors` prints those learned from the whole folder. `--waypoints 1` gives forecast and
rivals the first waypoint of a dive alone, 0 none.

A row has the errors of the forecast and of all rivals, the ratio to one rival with its 95 %
bootstrap interval over dives, and the fractions that the ellipses hold. The rival is the same in
all rows: the best one over all deployments together. For currents a row also has the ratio to the
best single model of the pool, chosen in hindsight; for surfacings the error of the vehicle's own
track at the end of the dive, which knows course and duration. Groups are by the source of the
displacement through the water: satellite logs only have the vehicle's reported current.

`--times` forecasts the times of the next, second and fourth surfacing from each deployment's fifth
dive on, by surface intervals and durations so far (`Rhythm`), without those beyond a gap in the
log. A row has the fraction within the interval of 90 %, its median width, and the median error of
the middle, beside a rival without surface intervals whose dives last the median of the last five.
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
from glider_twin_ops.forecast import DeploymentHindcast, Judged, Priors, hindcast, scores_of, walk
from glider_twin_ops.forecast.expected_dive import BOTH, Rhythm, SurfacingSchedule
from glider_twin_ops.forecast.logged_leg import REPORTED, DiveTime, dive_times
from glider_twin_ops.forecast.pool import BESIDE, FIELD, FILTER, CurrentPool, Prior
from glider_twin_ops.forecast.walk import METHODS, Pair, bootstrap
from twin.errors import InputError, TwinError
from twin.navigation.current.tuning import PARTS
from twin.records.logged import LogStore
from twin.records.presence import is_store
from twin.records.store import write_store

POOLS = {"current": "pool", "way": "ways", "ground": "ground", "schedule": "schedule"}
"""Field of `Walked` by field of `Priors`"""
KINDS = ("slocum", "seaglider", "seaexplorer")
LOGS = frozenset({".sbd", ".dbd", ".nc", ".parquet", ".csv", ".gz"})
NEUTRAL = 0.1
"""[m/s], of a duration [1]: scale of every model's errors before anything is learned"""
LEAST = 5
"""Least number of dives of a deployment that teaches the priors"""
ALIVE = 0.02
"""[1] Addition to a learned weight, so that no model is ruled out"""
SAID = 20
"""Least number of scored surfacings of a deployment that is judged alone"""
CONFIDENCE = 0.99
"""[1] Confidence of the intervals of coverages"""
AHEAD = (1, 2, 4)
KNOWN, DRAWS, ASKED = 4, 400, 8
"""Number of dives before the first forecast of times, of samples, and least number of dives"""
MINUTE = 60.0


def stores_in(folder: Path, work: Path) -> list[Path]:
    """Stores of a folder, or stores that are imported from its folders of logs.

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
    """Priors that no deployment has taught: equal weights and scales."""
    shipped = Priors()

    def alike(priors: Mapping[str, Prior]) -> dict[str, Prior]:
        return {n: Prior(1.0, 1.0 if n in (FILTER, BESIDE, BOTH) else NEUTRAL) for n in priors}

    pools: dict[str, Any] = {name: alike(getattr(shipped, name)) for name in POOLS}
    return dataclasses.replace(shipped, **pools)


def learned(deployments: Sequence[DeploymentHindcast]) -> Priors:
    """Learn priors from deployments that were forecast with neutral ones.

    A model's weight is its mean posterior weight over the dives, its scale the geometric mean; each
    deployment counts once. The ellipses' radii come from forecasts with these weights and scales.
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

    pools: dict[str, Any] = {
        name: pooled(name, at, getattr(start, name)) for name, at in POOLS.items()
    }
    priors = Priors(**pools)
    again = [forecast_again(one, priors) for one in taught]
    reaches: dict[str, Any] = {
        f"{which}_reach": radii([[j.distance for j in judged(one, which)] for one in again])
        for which in ("surfacing", "current")
    }
    return dataclasses.replace(priors, **reaches)


def radii(distances: Sequence[Sequence[float]]) -> Pair:
    """[1] Squared radii of the 50 and 90 % ellipses at the begin of a further deployment.

    Quantiles of the squared distances, each of n deployments counting once, at (n + 1) / n of the
    part: a further deployment is held with that probability if it is exchangeable with these
    (conformal prediction in two layers: Dunn, Wasserman and Ramdas 2023, J. Am. Stat. Assoc. 118).
    """
    known = [run for run in distances if len(run)]
    every = np.concatenate(known)
    order = np.argsort(every)
    share = np.concatenate([np.full(len(run), 1.0 / len(run) / len(known)) for run in known])
    parts = np.array(PARTS) * (len(known) + 1) / len(known)
    rank = np.minimum(np.searchsorted(np.cumsum(share[order]), parts), len(every) - 1)
    half, ninety = every[order][rank].tolist()
    return float(f"{half:.2g}"), float(f"{ninety:.2g}")


@functools.cache
def dives_of(store: Path, name: str) -> tuple[DiveTime, ...]:
    """Times of the dives of a deployment."""
    with LogStore(store) as logs:
        return dive_times(logs, name).dives


def forecast_again(one: DeploymentHindcast, priors: Priors) -> DeploymentHindcast:
    """Forecast a deployment's surfacings with other priors; its own `Scores` stay the old ones."""
    dives = dives_of(one.store, one.name)
    return dataclasses.replace(
        one, walked=walk(one.legs, dives=dives, train=one.train, priors=priors)
    )


def judged(one: DeploymentHindcast, which: str) -> list[Judged]:
    """Scored surfacings of a deployment."""
    return [getattr(each, which) for each in one.surfacings if each.scored]


def alone(one: DeploymentHindcast) -> dict[str, float]:
    """Mean error [m/h] of each single model of the current over the scored dives."""
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
    """Name, year and month of a deployment: one vehicle has several."""
    month = str(np.datetime64(round(one.legs[0].leg.start), "s"))[:7]
    return f"{one.name} {month}"


def row(
    name: str, ones: Sequence[DeploymentHindcast], which: str, rival: str | None
) -> dict[str, Any]:
    """Row of a table: scores of some deployments together beside a rival."""
    runs = [judged(one, which) for one in ones]
    scores = scores_of(runs, rival)
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
    """Rows for each deployment, for each group of them, and for all, beside one rival."""
    rival = scores_of([judged(one, which) for one in ones]).rival
    satellite = [one for one in ones if {leg.method for leg in one.legs} == {REPORTED}]
    groups = {
        "satellite logs": satellite,
        "logs with attitude": [one for one in ones if one not in satellite],
        "all": list(ones),
    }
    rows = [row(label(one), [one], which, rival) for one in ones]
    groups = {name: members for name, members in groups.items() if len(members) > 1}
    return rows + [row(name, members, which, rival) for name, members in groups.items()]


def markdown(rows: Sequence[Mapping[str, Any]], which: str) -> str:
    """Table of a page."""
    last = "own track afterwards" if which == "surfacing" else "by the best single model"
    methods = [name for name in METHODS if any(one["mean_m_per_h"][name] for one in rows)]
    rival = rows[-1]["rival"].replace("_", " ")
    head = [which, "scored", *(name.replace("_", " ") for name in methods),
            f"ratio to {rival} (95 %)", "in 50 %", "in 90 %", last]  # fmt: skip
    lines = []
    for one in rows:
        interval = "({:.2f} to {:.2f})".format(*one["interval"]) if one["interval"] else ""
        own = one.get("own_track_afterwards")
        end = "" if own is None else f"{own:.0f}"
        end = f"{one['by_single']:.2f}" if which == "current" else end
        lines.append([
            one["deployment"], one["segments"],
            *("" if (mean := one["mean_m_per_h"][name]) is None else f"{mean:.0f}"
              for name in methods),
            f"{one['ratio']:.2f} {interval}".strip(), f"{one['coverage_50']:.2f}",
            f"{one['coverage_90']:.2f}", end,
        ])  # fmt: skip
    return command.markdown(head, lines)


# --- times ----------------------------------------------------------------------------------------


def told(dives: Sequence[DiveTime]) -> list[tuple[int, bool, float, float, float]]:
    """Rows of forecasts: number of surfacings ahead, True if the interval held the time, its width
    [s], error of its middle [s], error of the rival [s]."""
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
                    continue  # beyond the log, or beyond a gap in which it may have surfaced
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
    """Rows of times for each deployment and for all."""
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
    """Print the tables, the priors learned from all deployments, or the times alone."""
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
                forecast_again(one, learned([each for each in first if each is not one]))
                for one in first
            )
        second = tuple(one for one in second if one.surfacing.segments)
    tables = {which: table(second, which) for which in ("surfacing", "current")}
    if json:
        print(dumps(tables))
        return
    for which, rows in tables.items():
        lost = [
            one["deployment"]
            for one in rows
            if one["segments"] >= SAID and one["interval"] and one["interval"][0] > 1.0
        ]
        said = ", ".join(lost) or "none"
        worse = f"{which}: significantly worse than the rival, of {SAID} fixes and more: {said}"
        print(markdown(rows, which), worse, sep="\n\n", end="\n\n")


if __name__ == "__main__":
    sys.exit(command.run(main))
