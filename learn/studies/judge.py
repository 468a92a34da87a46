"""Judge: evaluate a run, draw its page and write its card."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from learn.data.dataset import SPLITS, Mission, load_missions
from learn.evaluation.evaluation import NETWORK, Evaluation, Watch, evaluate
from learn.evaluation.score import Reference
from learn.evaluation.uncertainty import Coverage, ErrorModel, fit_error_model
from learn.files import read_json, write_json
from learn.navigation.baselines import BASELINES, Estimate
from learn.report.build import Contents, Judged, build_page
from learn.report.card import model_card
from learn.report.figures import TRAINING_PANELS
from learn.report.log_page import build_log_page
from learn.report.shown import Showcase
from learn.runs.run import ABLATION, CARD, EVALUATION, PAPER_TEST, REPORT, Run
from twin.cli.console import to_json
from twin.records.reader import MissionStore

IDEAL_SENSORS = "ideal"
"""The store's attribute `sensors` when its compass has no error."""
PAPER_TEST_STORE = "paper-test.zarr"

Say = Callable[[str], None]


def judge(
    run: Run,
    store: str | Path,
    *,
    split: str = "test",
    baselines: Sequence[str] = tuple(BASELINES),
    watches: Sequence[Watch] = (),
) -> Judged:
    """Evaluate a run on a store, with the missions that a page draws; errors as `evaluate`."""
    if is_log_store(store):
        return _judge_logs(run, store, split=split, baselines=baselines, watches=watches)
    showcase, coverage = Showcase(), Coverage(run.error_model())

    def watch(reference: Reference, estimates: Mapping[str, Estimate]) -> None:
        for see in (showcase.add, coverage.add, *watches):
            see(reference, estimates)

    evaluation = evaluate(
        run.networks(), store, split=split, baselines=baselines, watch=watch, period=run.period
    )
    found = {
        "run": str(run.path),
        **evaluation.to_json(),
        "uncertainty": coverage.figures(),
    }
    return Judged(evaluation=evaluation, figures=to_json(found), shown=showcase.missions)


def is_log_store(store: str | Path) -> bool:
    """Whether it holds real logs."""
    with MissionStore(store) as reader:
        return reader.logged


def _judge_logs(
    run: Run,
    store: str | Path,
    *,
    split: str,
    baselines: Sequence[str],
    watches: Sequence[Watch],
) -> Judged:
    """As `judge`: no missions to draw, since a log's true track is not known."""

    def watch(reference: Any, estimates: Mapping[str, Estimate]) -> None:
        for see in watches:
            see(reference, estimates)

    evaluation = evaluate(
        run.networks(), store, split=split, baselines=baselines, watch=watch, period=run.period
    )
    found = {"run": str(run.path), **evaluation.to_json()}
    return Judged(evaluation=evaluation, figures=to_json(found), shown=())


def finish(run: Run, *, history: str = "", say: Say = lambda _: None) -> Run:
    """Everything of a run that follows its training: error model, evaluations, page and card.

    Args:
      history: command line for the page.
      say: told what is being done.

    Returns:
      The run with its error model.
    """
    split, others = judged_split(run)
    if not is_log_store(run.store):
        say("learning how far off the networks are from missions that they were not trained on")
        run = run.remember(error_model=dataclasses.asdict(_error_model(run, others)))
    say(f"evaluating on {split} missions, with floor and baselines")
    test = judge(run, run.store, split=split)
    write_json(run.path / EVALUATION, test.figures)
    paper = None if is_log_store(run.store) else _paper_test(run, say)
    if paper is not None:
        write_json(run.path / PAPER_TEST, paper.figures)
    write_page(run, test, paper, history=history)
    (run.path / CARD).write_text(model_card(run, test.figures, split), encoding="utf-8")
    return run


def write_page(run: Run, test: Judged, paper: Judged | None, *, history: str) -> Path:
    """The run's page from its evaluations."""
    settings = run.description["settings"]
    if is_log_store(run.store):
        return build_log_page((run.path / REPORT).parent, run, test, provenance(run), history)
    contents = Contents(
        title=f"Surge and sway networks: {run.name}",
        lead=f"{settings['network']['kind']} networks, {test.figures['missions']} "
        f"{test.evaluation.split} missions of {test.evaluation.store}",
        test=test,
        paper_test=paper,
        error_model=run.error_model(),
        metrics=run.metrics(),
        training=_training_mission(run),
        ablation=_ablation(run),
        provenance=provenance(run),
        command=history or str(run.description.get("history", "")),
    )
    return build_page((run.path / REPORT).parent, contents)


def _ablation(run: Run) -> dict[str, Any]:
    """What `ablation.json` holds; empty without one."""
    path = run.path / ABLATION
    remedy = f"`learn fit --name {run.name} --resume --ablation` writes it anew"
    return read_json(path, remedy) if path.is_file() else {}


def provenance(run: Run) -> dict[str, object]:
    """What a run was made from and with."""
    settings = run.description["settings"]
    networks = run.description.get("networks", {}).values()
    return {
        "store": settings["store"],
        **{f"store: {name}": value for name, value in run.description["store"].items()},
        "inputs": ", ".join(settings["features"]),
        "network": ", ".join(f"{k} {v}" for k, v in settings["network"].items() if k != "inputs"),
        "training": ", ".join(f"{k} {v}" for k, v in settings["training"].items()),
        "networks per velocity": settings["members"],
        "division": settings["division"],
        "time in training": f"{sum(n.get('seconds', 0.0) for n in networks):.0f} s of networks",
        "started": run.description["created"],
        **{f"version of {name}": value for name, value in run.description["versions"].items()},
    }


def judged_split(run: Run) -> tuple[str, str]:
    """The split to judge on, and the one to learn the size of errors from.

    Test and validation missions; where a store has none, what comes nearest to unseen missions.
    """
    if run.description["settings"]["division"] == "samples":
        return "all", "all"
    parts = {m.split for m in load_missions(run.store, ("measured_depth",), split="all")}
    held_out = [split for split in reversed(SPLITS) if split in parts] or ["all"]
    return held_out[0], held_out[min(1, len(held_out) - 1)]


def _error_model(run: Run, split: str) -> ErrorModel:
    seconds: list[float] = []

    def watch(reference: Reference, estimates: Mapping[str, Estimate]) -> None:
        seconds.append(reference.mission.samples * reference.mission.period)

    found: Evaluation = evaluate(
        run.networks(), run.store, split=split, baselines=(), watch=watch, period=run.period
    )
    ideal = found.provenance.get("sensors") == IDEAL_SENSORS
    return fit_error_model(found.methods[NETWORK].scores, seconds, ideal_compass=ideal)


def _paper_test(run: Run, say: Say) -> Judged | None:
    """The run on the paper's three missions, flown with the sensors of its store.

    None for a store that the factory did not make: its sensors are not known.
    """
    sensors = run.description["store"].get("sensors")
    if sensors is None:
        return None
    say("flying the paper's test in three currents")
    from factory.generation.bulk import generate
    from factory.recipe.recipe import make_recipe

    path = run.path / PAPER_TEST_STORE
    recipe = make_recipe(preset="paper-test", sensors=str(sensors))
    generate(recipe, path, workers=1, overwrite=True, history="learn fit")
    return judge(run, path, split="all")


def _training_mission(run: Run) -> Mission | None:
    """One training mission with the channels that the page draws and the store has."""
    with MissionStore(run.store) as reader:
        present = set(reader.dataset.data_vars)
    channels = [name for name, _ in TRAINING_PANELS if name in present]
    split = "train" if "split" in present else "all"
    missions = load_missions(run.store, channels, split=split, limit=1)
    return missions[0] if missions else None
