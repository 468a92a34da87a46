"""Forecasts of surfacings and of currents on real deployments, each left out of what it is told.

    python -m benchmarks.surfacings FOLDER [--shipped | --priors] [--waypoints 1] [--json]

FOLDER holds stores of logs, or folders of logs whose names begin with their kind (slocum_...,
seaglider_..., seaexplorer_...), which are imported. What is believed before the first dive
(`Priors`) is learned for each deployment from the others, and the deployment is then
walked through from its second dive to its last. `--shipped` takes the shipped ones instead, for
deployments that did not teach them; `--priors` prints those of all in the folder. `--waypoints 1`
knows no more of a dive's list of waypoints than the first.

A row has the forecast's error, that of the best rival of this deployment, their ratio with its 95 %
bootstrap interval over dives, and what the ellipses hold; for currents the ratio to the best single
model of the pool, chosen in hindsight, too, and for surfacings the error of the vehicle's own track
at the end of the dive, which knows how it flew and how long. Groups are by how the way through the
water is known: a satellite log only has the current that the vehicle reported.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

from factory.importing import import_logs
from glider_twin_ops.forecast import DeploymentHindcast, Judged, Priors, Scores, hindcast, scores_of
from glider_twin_ops.forecast.logged_leg import REPORTED
from glider_twin_ops.forecast.pool import BESIDE, FIELD, FILTER, CurrentPool, Prior
from glider_twin_ops.forecast.walk import Pair, bootstrap
from twin.errors import InputError, TwinError
from twin.navigation.current import Reaches
from twin.records.presence import is_store
from twin.records.store import write_store

KINDS = ("slocum", "seaglider", "seaexplorer")
LOGS = frozenset({".sbd", ".dbd", ".nc", ".parquet", ".csv", ".gz"})
NEUTRAL = 0.1
"""[m/s], or of a duration: scale of every model's errors before anything is learned of it"""
LEAST = 5
"""Dives of a deployment that has a say in the priors"""
ALIVE = 0.02
"""[1] added to a learned weight, so that no model is ruled out"""
SAID = 20
"""Scored surfacings from which a deployment is judged alone"""
CONFIDENCE = 0.99
"""[1] of the intervals in which coverages shall lie"""


def stores_in(folder: Path, work: Path) -> list[Path]:
    """Stores of a folder, or those that its folders of logs become.

    Raises:
      InputError: neither is there.
    """
    if not folder.is_dir():
        raise InputError(f"no folder {folder}: give one that holds stores of logs, or logs")
    stores = sorted(path for path in folder.iterdir() if is_store(path))
    if stores:
        return stores
    shelf = work / "caches"
    shelf.mkdir()
    for path in sorted(folder.rglob("*.cac")):  # a deployment may need the list of another
        shutil.copyfile(path, shelf / path.name)
    for top in sorted(path for path in folder.iterdir() if path.is_dir()):
        kind = top.name.split("_")[0].lower()
        if kind not in KINDS:
            continue
        holding = {path.parent for path in top.rglob("*") if path.suffix.lower() in LOGS}
        if top in holding:
            holding = {top}  # folders below it are raw files of the same dives
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
    """What is believed where no deployment has taught anything."""
    shipped = Priors()

    def alike(priors: Mapping[str, Prior]) -> dict[str, Prior]:
        return {n: Prior(1.0, 1.0 if n in (FILTER, BESIDE) else NEUTRAL) for n in priors}

    return dataclasses.replace(
        shipped,
        current=alike(shipped.current),
        way=alike(shipped.way),
        schedule=alike(shipped.schedule),
    )


def learned(deployments: Sequence[DeploymentHindcast]) -> Priors:
    """The priors that some deployments, walked through with neutral ones, have in common.

    A model's weight is the part that it had in explaining the dives, its scale the geometric mean,
    each deployment counting once; the reaches are quantiles over all scored dives.
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

    return Priors(
        current=pooled("current", "pool", start.current),
        way=pooled("way", "ways", start.way),
        schedule=pooled("schedule", "schedule", start.schedule),
        surfacing_reach=reach("surfacing"),
        current_reach=reach("current"),
    )


def judged(one: DeploymentHindcast, which: str) -> list[Judged]:
    """What was scored of a deployment."""
    return [getattr(each, which) for each in one.surfacings if each.scored]


@functools.cache
def alone(one: DeploymentHindcast) -> dict[str, float]:
    """Mean error [m/h] of each model of the current alone, over the scored dives."""
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
    """Name and year and month of a deployment: a vehicle has several."""
    month = str(np.datetime64(round(one.legs[0].leg.start), "s"))[:7]
    return f"{one.name} {month}"


def row(
    name: str, scores: Scores, ones: Sequence[DeploymentHindcast], which: str
) -> dict[str, Any]:
    """One line of a table."""
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
            lambda rows, held=held: float(held[rows].mean()),  # type: ignore[misc]
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
    """A line for each deployment, for each group of them, and for all."""
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
    """The table of a page."""
    last = "own track afterwards" if which == "surfacing" else "by the best single model"
    lines = [
        f"| {which} | scored | forecast | best rival | its error | ratio (95 %) | in 50 % "
        f"| in 90 % | {last} |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in rows:
        low, high = one["interval"] or (np.nan, np.nan)
        interval = f" ({low:.2f} to {high:.2f})" if one["interval"] else ""
        own = one.get("own_track_afterwards")
        end = (
            f"{one['by_single']:.2f}" if which == "current" else "" if own is None else f"{own:.0f}"
        )
        cells = [
            one["deployment"],
            str(one["segments"]),
            f"{one['mean_m_per_h']['forecast']:.0f}",
            one["rival"].replace("_", " "),
            f"{one['mean_m_per_h'][one['rival']]:.0f}",
            f"{one['ratio']:.2f}{interval}",
            f"{one['coverage_50']:.2f}",
            f"{one['coverage_90']:.2f}",
            end,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def losses(rows: Sequence[Mapping[str, Any]], which: str) -> str:
    """Where the forecast is worse than the best rival."""
    lost = [f"{one['deployment']} {one['ratio']:.2f}" for one in rows if one["ratio"] > 1.0]
    return f"{which}: worse than the best rival on {', '.join(lost) or 'none of them'}"


def main(words: Sequence[str] | None = None) -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shipped", action="store_true")
    parser.add_argument("--waypoints", type=int, default=None)
    parser.add_argument("--priors", action="store_true")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as work:
        stores = stores_in(asked.folder, Path(work))
        first = hindcast(
            stores, priors=None if asked.shipped else neutral(), waypoints=asked.waypoints
        ).deployments
        if asked.priors:
            print(learned(first))
            return
        second = first
        if not asked.shipped:
            second = tuple(
                again
                for one in first
                for again in hindcast(
                    [one.store],
                    priors=learned([each for each in first if each is not one]),
                    waypoints=asked.waypoints,
                ).deployments
                if again.name == one.name
            )
        second = tuple(one for one in second if one.surfacing.segments)
    tables = {which: table(second, which) for which in ("surfacing", "current")}
    if asked.json:
        print(json.dumps(tables))
        return
    for which, rows in tables.items():
        print(markdown(rows, which), losses(rows, which), sep="\n\n", end="\n\n")


if __name__ == "__main__":
    main()
