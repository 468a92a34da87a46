"""Run evaluation: the networks of a run on the missions of a store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from learn.data.dataset import SPLITS, Selection, any_channel
from learn.evaluation.deviation import Coverage
from learn.evaluation.evaluation import Evaluation, Watch, evaluate
from learn.report.contents import RunEvaluation, Showcase
from learn.run import Run
from twin.cli.console import to_json
from twin.navigation.estimators.baseline import Estimate
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath


def evaluate_run(
    run: Run,
    store: str | StorePath,
    *,
    split: str = "test",
    baselines: Sequence[str] | None = None,
    watches: Sequence[Watch] = (),
) -> RunEvaluation:
    """Evaluate a run on a store, with the missions that a page draws; errors as `evaluate`."""
    if is_log_store(store):
        return _evaluate_on_logs(run, store, split=split, baselines=baselines, watches=watches)
    showcase, coverage = Showcase(), Coverage(run.error_model())

    evaluation = _evaluate(run, store, split, baselines, (showcase.add, coverage.add, *watches))
    found = {
        "run": str(run.folder),
        **evaluation.to_json(),
        "uncertainty": coverage.figures(),
    }
    return RunEvaluation(evaluation=evaluation, figures=to_json(found), shown=showcase.missions)


def is_log_store(store: str | StorePath) -> bool:
    """Whether it holds real logs."""
    with MissionStore(store) as reader:
        return reader.logged


def _evaluate_on_logs(
    run: Run,
    store: str | StorePath,
    *,
    split: str,
    baselines: Sequence[str] | None,
    watches: Sequence[Watch],
) -> RunEvaluation:
    """As `evaluate_run`: no missions to draw, since a log's true track is not known."""
    evaluation = _evaluate(run, store, split, baselines, watches)
    found = {"run": str(run.folder), **evaluation.to_json()}
    return RunEvaluation(evaluation=evaluation, figures=to_json(found), shown=())


def _evaluate(
    run: Run,
    store: str | StorePath,
    split: str,
    baselines: Sequence[str] | None,
    watches: Sequence[Watch],
) -> Evaluation:
    """The run's networks on a store, every mission shown to all `watches`."""

    def watch(reference: Any, estimates: Mapping[str, Estimate]) -> None:
        for see in watches:
            see(reference, estimates)

    return evaluate(
        run.networks(),
        store,
        split=split,
        baselines=baselines,
        watch=watch,
        period=run.period,
        labels=run.labels if run.labels.source == "dvl" else None,
    )


def evaluation_split(run: Run) -> tuple[str, str]:
    """The split to evaluate on, and the one to learn the size of errors from.

    Test and validation missions; where a store has none, what comes nearest to unseen missions.
    """
    if run.description["settings"]["division"] == "samples":
        return "all", "all"
    with Selection(run.store, any_channel(run.store)) as selection:
        parts = set(selection.splits)
    held_out = [split for split in reversed(SPLITS) if split in parts] or ["all"]
    return held_out[0], held_out[min(1, len(held_out) - 1)]
