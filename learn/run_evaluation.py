"""Run evaluation: evaluate a run's networks on the missions of a store."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from learn.data.dataset import SPLITS, MissionSequence, Selection
from learn.data.further import fly_further, longer, recipe_to_fly
from learn.evaluation.deviation import Coverage, FixConsistency
from learn.evaluation.evaluation import Evaluation, Watch, evaluate, pooled
from learn.evaluation.score import NETWORK, summarise_scores
from learn.networks.familiarity import Familiarity, ended
from learn.report.contents import RunEvaluation, Showcase
from learn.run import Run, open_run
from twin.cli.console import to_json
from twin.cli.text_table import counted
from twin.navigation.estimators.base import Estimate
from twin.navigation.flight_filter import FlightFilter
from twin.records.attributes import SETTINGS, is_logged
from twin.records.coordinates import START_LATITUDE
from twin.records.presence import is_complete, read_attributes
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath, store_path
from twin.vehicle.vehicle import Vehicle

LEAST_JUDGED = 66
"""Minimum number of missions that judge a run; a mission of 2 h takes 0.5 s of a processor."""
BEFORE = "before"
"""Entry of an evaluation: figures of the networks that the training started from"""
Say = Callable[[str], None]


def evaluate_run(
    run: Run,
    store: str | StorePath,
    *,
    split: str = "test",
    baselines: Sequence[str] | None = None,
    limit: int | None = None,
    watches: Sequence[Watch] = (),
    further: StorePath | None = None,
    start: Run | None = None,
) -> RunEvaluation:
    """Evaluate a run on a store and keep the missions that a page draws; errors as in `evaluate`.

    Logs have no true tracks: none of them are kept, and `limit` has no effect.

    Args:
      further: store of `further_missions`, whose missions are all judged together with the split's;
        `watches` do not see them, since their numbers are those of other missions.
      start: run whose networks are judged on the same missions too, as entry BEFORE.
    """
    with MissionStore(store) as reader:
        vehicle, logged = reader.vehicle, reader.logged
        run = run.at(reader.period) if run.shipped else run
        at_fixes = None if logged else _consistency(run, reader)
    networks, hulls = run.networks(vehicle), _hulls(run, vehicle)
    outside = None if hulls is None else hulls.outside
    showcase, coverage = Showcase(), Coverage(run.error_model(), run.adapted, outside)
    every: list[Watch] = [] if logged else [coverage.add]
    every += [] if at_fixes is None else [at_fixes.add]
    every += [] if hulls is None else [hulls.add]
    own = [*every, *([] if logged else [showcase.add]), *watches]

    def watch_of(seeing: Sequence[Watch]) -> Watch:
        def watch(reference: Any, estimates: Mapping[str, Estimate]) -> None:
            for see in seeing:
                see(reference, estimates)

        return watch

    labels = (
        run.labels if run.labels.source in (("dvl", "camera") if logged else ("dvl",)) else None
    )
    common: dict[str, Any] = {"baselines": baselines, "period": run.period, "labels": labels}
    also = {}
    if start is not None:
        start = start.at(run.period) if start.shipped else start
        same = start.spread == run.spread and start.adapted is None  # they read the same channels
        if same and not logged:
            also = {BEFORE: start.networks(vehicle)}
    common["also"] = also
    watch = watch_of(own)
    evaluation = evaluate(networks, store, split=split, limit=limit, watch=watch, **common)
    found: dict[str, Any] = {"run": str(run.folder)}
    if further is not None:
        more = evaluate(networks, further, split="all", watch=watch_of(every), **common)
        found["further"] = len(more.methods[NETWORK].scores)
        joined = pooled([evaluation, more])
        evaluation = dataclasses.replace(joined, store=evaluation.store, missing=evaluation.missing)
    found |= evaluation.to_json()
    if also:
        methods = dict(evaluation.methods)
        found[BEFORE] = methods.pop(BEFORE).figures
        evaluation = dataclasses.replace(evaluation, methods=methods)
    elif start is not None:
        alone = evaluate_run(start, store, split=split, baselines=(), limit=limit, further=further)
        found[BEFORE] = {name: alone.figures[name] for name in summarise_scores(())}
    if not logged:
        found["uncertainty"] = coverage.figures()
    if at_fixes is not None:
        found["fixes"] = at_fixes.figures()
    if hulls is not None:
        found["outside"] = hulls.figures()
    return RunEvaluation(evaluation=evaluation, figures=to_json(found), shown=showcase.missions)


def further_missions(
    store: str | StorePath, split: str, folder: Path, *, least: int, say: Callable[[str], None]
) -> StorePath | None:
    """Fly the missions that a split lacks to `least`, by the store's recipe and a seed of its own.

    The seed is taken from the recipe's hash: all runs on a store are judged on equal missions,
    which trained none of them.

    Args:
      folder: folder that keeps the missions, as a store named by the recipe.
      say: called with a sentence before the flights, or with the reason why there are none.

    Returns:
      The store; None if the split has enough, and for stores whose recipe cannot be flown.
    """
    if split == "all" or SETTINGS not in read_attributes(store) or is_log_store(store):
        return None
    with Selection(store, (), split=split) as selection:
        own = len(selection)
    if own >= least:
        return None
    recipe = recipe_to_fly(
        store, lambda why: say(f"judging by {counted(own, 'mission')} alone: {why}")
    )
    if recipe is None:
        return None
    more = longer(recipe, max(least - own, len(SPLITS)), seed=int(recipe.digest[:8], 16))
    say(
        f"flying {counted(len(more.plan), 'mission')} more of this recipe to judge by: the store "
        f"has {counted(own, split + ' mission')}"
    )
    return fly_further(more, folder, "judged")


def evaluate_own(
    run: Run, *, split: str, limit: int | None = None, least: int = 0, say: Say = lambda _: None
) -> RunEvaluation:
    """Evaluate a run on all stores that it was trained on; errors as in `evaluate`.

    A run on one store is judged beside the run that it started from.

    The numbers are over the missions of all stores; if there are several, `stores` has each one's
    by its path. The missions to draw are the first store's.

    Args:
      least: least number of missions over all stores, see `further_missions`.
    """
    share = math.ceil(least / len(run.stores))
    each, origin = [], run.description["settings"].get("start")
    start = open_run(origin) if origin is not None and len(run.stores) == 1 else None
    for store in run.stores:
        further = further_missions(store, split, run.folder, least=share, say=say)
        each.append(
            evaluate_run(run, store, split=split, limit=limit, further=further, start=start)
        )
    if len(each) == 1:
        return each[0]
    everything = pooled([one.evaluation for one in each])
    stores = {one.evaluation.store: one.figures for one in each}
    figures = {"run": str(run.folder), **everything.to_json(), "stores": stores}
    figures["further"] = sum(one.figures.get("further", 0) for one in each)
    return RunEvaluation(evaluation=everything, figures=to_json(figures), shown=each[0].shown)


def judge(run: Run, split: str, watch: Watch | None = None, limit: int | None = None) -> Evaluation:
    """Evaluate a run's networks without baselines on all stores that it was trained on."""
    return pooled(
        [
            evaluate(
                run.networks(), store, split=split, baselines=(), limit=limit, watch=watch,
                period=run.period,
            )
            for store in run.stores
        ]
    )  # fmt: skip


class Hulls:
    """Out-of-distribution scores of missions' hulls; `add` is a callback for `evaluate`."""

    def __init__(self, familiar: Familiarity, flight: FlightFilter) -> None:
        self._familiar, self._flight = familiar, flight
        self._found: list[tuple[float, str]] = []
        self._last: tuple[MissionSequence, tuple[float, str]] | None = None

    def add(self, reference: Any, estimates: Mapping[str, Estimate]) -> None:
        """Score one mission."""
        self._found.append(self._score(reference.mission))

    def outside(self, mission: MissionSequence) -> float:
        """Out-of-distribution score of one mission, see `Familiarity.outside`."""
        return self._score(mission)[0]

    def _score(self, mission: MissionSequence) -> tuple[float, str]:
        if self._last is None or self._last[0] is not mission:  # two callbacks ask for each
            found = self._familiar.outside(np.array(ended(self._flight, mission)))
            self._last = mission, found
        return self._last[1]

    def figures(self) -> dict[str, Any]:
        """Share of scores above 1, median score, and the constant that sets most of the scores."""
        far = np.array([one for one, _ in self._found])
        names = [name for _, name in self._found]
        return {
            "share": float((far > 1.0).mean()),
            "median": float(np.median(far)),
            "constant": max(sorted(set(names)), key=names.count),
        }


def _hulls(run: Run, vehicle: Vehicle) -> Hulls | None:
    """Scores of hulls; None if the networks do not read the flight filter."""
    familiar = run.familiar
    if familiar is None:
        return None
    return Hulls(familiar, FlightFilter(vehicle, run.period, run.spread))


def _consistency(run: Run, reader: MissionStore) -> FixConsistency | None:
    """Consistency check at GPS fixes; None if the store lacks its missions' latitudes."""
    if START_LATITUDE not in reader.dataset:
        return None
    latitude = float(np.median(reader.dataset[START_LATITUDE].to_numpy()))
    stated = run.velocity_deviation(reader.vehicle)
    return FixConsistency(stated, math.degrees(run.error_model().heading_sd), latitude)


def is_log_store(store: str | StorePath) -> bool:
    """True if a store holds real logs.

    Raises:
      StoreError: there is no store.
    """
    if not is_complete(path := store_path(store)):
        MissionStore(path).close()  # raises with the reason
    return is_logged(read_attributes(path))


def evaluation_split(run: Run) -> tuple[str, str]:
    """Choose the split to evaluate on, and the split to fit the error model on.

    These are test and validation; if a store lacks one, the next best of validation and train.
    """
    if run.description["settings"]["division"] == "samples":
        return "all", "all"
    parts = set(SPLITS)
    for store in run.stores:
        with Selection(store, ()) as selection:
            parts &= set(selection.splits)
    held_out = [split for split in reversed(SPLITS) if split in parts] or ["all"]
    return held_out[0], held_out[min(1, len(held_out) - 1)]
