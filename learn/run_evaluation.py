"""Run evaluation: evaluate a run's networks on the missions of a store."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from learn.data.dataset import SPLITS, MissionSequence, Selection, any_channel
from learn.evaluation.deviation import Coverage, FixConsistency
from learn.evaluation.evaluation import Evaluation, Watch, evaluate, pooled
from learn.networks.familiarity import Familiarity, ended
from learn.report.contents import RunEvaluation, Showcase
from learn.run import Run
from twin.cli.console import to_json
from twin.navigation.estimators.base import Estimate
from twin.navigation.flight_filter import FlightFilter
from twin.records.coordinates import START_LATITUDE
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath
from twin.vehicle.vehicle import Vehicle


def evaluate_run(
    run: Run,
    store: str | StorePath,
    *,
    split: str = "test",
    baselines: Sequence[str] | None = None,
    limit: int | None = None,
    watches: Sequence[Watch] = (),
) -> RunEvaluation:
    """Evaluate a run on a store and keep the missions that a page draws; errors as in `evaluate`.

    Logs have no true tracks: none of them are kept, and `limit` has no effect.
    """
    logged = is_log_store(store)
    with MissionStore(store) as reader:
        vehicle = reader.vehicle
    networks, hulls = run.networks(vehicle), _hulls(run, vehicle)
    outside = None if hulls is None else hulls.outside
    showcase, coverage = Showcase(), Coverage(run.error_model(), run.adapted, outside)
    at_fixes = None if logged else _consistency(run, store)
    seeing = watches if logged else (showcase.add, coverage.add, *watches)
    if at_fixes is not None:
        seeing = (at_fixes.add, *seeing)
    if hulls is not None:
        seeing = (hulls.add, *seeing)

    def watch(reference: Any, estimates: Mapping[str, Estimate]) -> None:
        for see in seeing:
            see(reference, estimates)

    evaluation = evaluate(
        networks,
        store,
        split=split,
        baselines=baselines,
        limit=limit,
        watch=watch,
        period=run.period,
        labels=run.labels if run.labels.source == "dvl" else None,
    )
    found = {"run": str(run.folder), **evaluation.to_json()}
    if not logged:
        found["uncertainty"] = coverage.figures()
    if at_fixes is not None:
        found["fixes"] = at_fixes.figures()
    if hulls is not None:
        found["outside"] = hulls.figures()
    return RunEvaluation(evaluation=evaluation, figures=to_json(found), shown=showcase.missions)


def evaluate_own(run: Run, *, split: str, limit: int | None = None) -> RunEvaluation:
    """Evaluate a run on all stores that it was trained on; errors as in `evaluate`.

    The numbers are over the missions of all stores; if there are several, `stores` has each one's
    by its path. The missions to draw are the first store's.
    """
    each = [evaluate_run(run, store, split=split, limit=limit) for store in run.stores]
    if len(each) == 1:
        return each[0]
    everything = pooled([one.evaluation for one in each])
    stores = {one.evaluation.store: one.figures for one in each}
    figures = {"run": str(run.folder), **everything.to_json(), "stores": stores}
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

    def add(self, reference: Any, estimates: Mapping[str, Estimate]) -> None:
        """Score one mission."""
        self._found.append(self._score(reference.mission))

    def outside(self, mission: MissionSequence) -> float:
        """Out-of-distribution score of one mission, see `Familiarity.outside`."""
        return self._score(mission)[0]

    def _score(self, mission: MissionSequence) -> tuple[float, str]:
        return self._familiar.outside(np.array(ended(self._flight, mission)))

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


def _consistency(run: Run, store: str | StorePath) -> FixConsistency | None:
    """Consistency check at GPS fixes; None if the store lacks its missions' latitudes."""
    with MissionStore(store) as reader:
        if START_LATITUDE not in reader.dataset:
            return None
        latitude = float(np.median(reader.dataset[START_LATITUDE].to_numpy()))
        stated = run.velocity_deviation(reader.vehicle)
    return FixConsistency(stated, math.degrees(run.error_model().heading_sd), latitude)


def is_log_store(store: str | StorePath) -> bool:
    """True if a store holds real logs."""
    with MissionStore(store) as reader:
        return reader.logged


def evaluation_split(run: Run) -> tuple[str, str]:
    """Choose the split to evaluate on, and the split to fit the error model on.

    These are test and validation; if a store lacks one, the next best of validation and train.
    """
    if run.description["settings"]["division"] == "samples":
        return "all", "all"
    parts = set(SPLITS)
    for store in run.stores:
        with Selection(store, any_channel(store)) as selection:
            parts &= set(selection.splits)
    held_out = [split for split in reversed(SPLITS) if split in parts] or ["all"]
    return held_out[0], held_out[min(1, len(held_out) - 1)]
