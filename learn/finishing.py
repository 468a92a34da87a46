"""Finishing: the steps after a run's training: error model, evaluations, page and model card."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from learn.data.dataset import TARGETS, MissionSequence, load_missions
from learn.data.stores import parts_of
from learn.evaluation.deviation import ErrorModel, fit_error_model
from learn.evaluation.score import NETWORK, ReferenceVelocity, best_method
from learn.files import write_sealed
from learn.networks.familiarity import HELD_TO, MISSIONS, Familiarity, Tether, training_flights
from learn.report.card import model_card
from learn.report.contents import Contents, RunEvaluation, Study
from learn.report.result_tables import judged_missions
from learn.report.run_page import build_log_page, build_page
from learn.report.velocity_figures import LABELS, TRAINING_PANELS
from learn.run import (
    CARD,
    EVALUATION,
    FAMILIARITY,
    MORE_STORES,
    PAPER_TEST,
    REPORT,
    TETHER,
    Run,
)
from learn.run_evaluation import (
    LEAST_JUDGED,
    Say,
    evaluate_own,
    evaluate_run,
    evaluation_split,
    is_log_store,
    judge,
)
from twin.errors import StoreError
from twin.navigation.estimators.base import Estimate
from twin.navigation.features import GLIDER_PARTS, channels_of
from twin.navigation.settings import ESTIMATED
from twin.numbers import Array
from twin.records.attributes import SENSORS
from twin.records.presence import is_store, read_attributes
from twin.records.reader import MissionStore
from twin.records.storage.checksums import LIST, write_checksums
from twin.records.storage.disk import sweep, sync_tree
from twin.records.storage.whole import whole_file
from twin.sensors.suite import SensorSuite

IDEAL_SENSORS = "ideal"
"""The store's attribute `sensors` when its compass has no error."""
JUDGED = 1000
"""Largest number of missions evaluated after the training; `learn evaluate` has no limit"""
PAPER_TEST_STORE = "paper-test.zarr"


def check_finish(store: str) -> None:
    """Refuse, before training, a store whose sensors `finish` cannot simulate in the paper's test.

    Raises:
      UnknownName: a sensor of the store is not registered, such as your own sensor without its
        plugin.
    """
    if not is_store(store) or is_log_store(store):  # the training's reader raises the better error
        return
    sensors = read_attributes(store).get(SENSORS)
    if sensors is not None:
        SensorSuite.preset(str(sensors))


def finish(run: Run, *, history: str = "", say: Say = lambda _: None) -> Run:
    """Finish a trained run: fit the error model, evaluate, write page, card and checksums.

    Args:
      history: command line for the page.
      say: called with a sentence before each long step.

    Returns:
      The run with its error model.
    """
    (run.folder / LIST).unlink(missing_ok=True)
    split, others = evaluation_split(run)
    if set(channels_of(run.features)) & set(ESTIMATED) and not _knows_hulls(run):
        say("learning which hulls the training knew")
        run = run.remember(**{FAMILIARITY: dataclasses.asdict(_familiarity(run))})
    if not is_log_store(run.stores[0]):
        say("learning how far off the networks are from missions that they were not trained on")
        model, tether = _errors(run, others)
        run = run.remember(error_model=dataclasses.asdict(model), **tether)
    say(f"evaluating on {split} missions, at most {JUDGED}, with floor and baselines")
    test = evaluate_own(run, split=split, limit=JUDGED, least=LEAST_JUDGED, say=say)
    best, _ = best_method(test.figures)
    test = dataclasses.replace(test, figures={**test.figures, BEST: best})
    write_sealed(run.folder / EVALUATION, test.figures)
    paper = None if is_log_store(run.stores[0]) else _paper_test(run, say)
    if paper is not None:
        write_sealed(run.folder / PAPER_TEST, paper.figures)
    write_page(run, test, paper, history=history)
    with whole_file(run.folder / CARD) as place:
        place.write_text(model_card(run, test.figures, split), encoding="utf-8")
    sweep(run.folder)
    sync_tree(run.folder)
    write_checksums(run.folder)
    return run


BEST = "best"
"""Entry of an evaluation: the best method"""


def write_page(run: Run, test: RunEvaluation, paper: RunEvaluation | None, *, history: str) -> Path:
    """Write the run's page from its evaluations; returns the page's path."""
    settings = run.description["settings"]
    if is_log_store(run.stores[0]):
        folder = (run.folder / REPORT).parent
        return build_log_page(folder, run, test, provenance(run), history)
    contents = Contents(
        title=f"Surge and sway networks: {run.name}",
        lead=f"{settings['network']['kind']} networks, {judged_missions(test.figures)}",
        test=test,
        paper_test=paper,
        labels=run.label_sentences(),
        error_model=run.error_model(),
        metrics=run.metrics(),
        training=_training_mission(run),
        studies=_each_store(run, test),
        provenance=provenance(run),
        command=history or str(run.description.get("history", "")),
    )
    return build_page((run.folder / REPORT).parent, contents)


def write_evaluation_page(folder: Path, run: Run, found: RunEvaluation, *, history: str) -> Path:
    """Write the page of a run's evaluation on any store; `history` is the command line to show."""
    store = found.evaluation.store
    if is_log_store(store):
        return build_log_page(folder, run, found, provenance(run), history)
    contents = Contents(
        title=f"{run.name} on {Path(store).name}",
        lead=judged_missions(found.figures),
        test=found,
        labels=run.label_sentences(),
        error_model=run.error_model(),
        provenance=provenance(run),
        command=history,
    )
    return build_page(folder, contents)


def _each_store(run: Run, test: RunEvaluation) -> list[Study]:
    """Table with a row per store, if the run was trained on several; else no table."""
    stores = test.figures.get("stores", {})
    if not stores:
        return []
    columns = {
        "missions": "missions",
        "surge MSE [(m/s)²]": "surge_mse",
        "sway MSE [(m/s)²]": "sway_mse",
        "through the water, mean [%]": "dr_water_percent_mean",
        "true attitude, mean [%]": "dr_velocity_percent_mean",
    }
    study = Study(
        title="Each store",
        rows=[
            {"store": store} | {title: found[name] for title, name in columns.items()}
            for store, found in stores.items()
        ],
        caption=f"The same networks on the {test.evaluation.split} missions of each store, with "
        "the vehicle of its own.",
        sentence="All other tables are over the missions of all stores; the tracks and the "
        f"training mission are of {run.stores[0]}.",
    )
    return [study]


def provenance(run: Run) -> dict[str, object]:
    """Origin of a run by label, for its page: store, inputs, settings, times and versions."""
    settings = run.description["settings"]
    networks = run.description.get("networks", {}).values()
    return {
        "store": settings["store"],
        **{f"store: {name}": value for name, value in run.description["store"].items()},
        **{
            f"store {number}: {name}": value
            for number, more in enumerate(run.description.get(MORE_STORES, ()), 2)
            for name, value in more.items()
        },
        "inputs": ", ".join(settings["features"]),
        "network": ", ".join(f"{k} {v}" for k, v in settings["network"].items() if k != "inputs"),
        "training": ", ".join(f"{k} {v}" for k, v in settings["training"].items()),
        "networks per velocity": settings["members"],
        "division": settings["division"],
        "time in training": f"{sum(n.get('seconds', 0.0) for n in networks):.0f} s of networks",
        "started": run.description["created"],
        **{f"version of {name}": value for name, value in run.description["versions"].items()},
    }


def _knows_hulls(run: Run) -> bool:
    """True if the training wrote statistics of the hulls, which held-back missions were part of."""
    with contextlib.suppress(StoreError):  # damaged: made again
        return run.description["settings"].get("start") is not None and run.familiar is not None
    return False


def _familiarity(run: Run) -> Familiarity:
    return Familiarity.fit(training_flights(run.stores, run.period, run.spread, MISSIONS))


def _errors(run: Run, split: str) -> tuple[ErrorModel, dict[str, Any]]:
    """Error model from missions outside the training; and, if the networks read the flight filter,
    the entry TETHER."""
    seconds: list[float] = []
    apart: list[Array] = []
    surge: list[Array] = []
    sway: list[Array] = []

    def watch(reference: ReferenceVelocity, estimates: Mapping[str, Estimate]) -> None:
        seconds.append(reference.mission.samples * reference.mission.period)
        said = estimates[NETWORK]
        assert said.surge is not None
        assert said.sway is not None
        surge.append(said.surge - reference.surge)
        if HELD_TO[0] in reference.mission.signals:
            apart.append(said.surge - reference.mission.signals[HELD_TO[0]])
        sway.append(said.sway - reference.sway)

    found = judge(run, split, watch, JUDGED)
    ideal = all(
        one.get(SENSORS) == IDEAL_SENSORS
        for one in (found.provenance, *run.description.get(MORE_STORES, ()))
    )
    scores = found.methods[NETWORK].scores
    model = fit_error_model(scores, seconds, surge, sway, ideal_compass=ideal)
    if not apart:
        return model, {}
    models = []
    for store in run.stores:
        with MissionStore(store) as reader:
            models.append(reader.vehicle.model)
    return model, {TETHER: {"most": Tether.of(apart, run.period).most, "models": models}}


def _paper_test(run: Run, say: Say) -> RunEvaluation | None:
    """Evaluation on the paper's three missions, simulated with the sensors of the run's store.

    None for several stores, whose sensors may differ; for a store without its sensors' name, which
    the factory did not make; for a vehicle with other parts than the Sea-Wing, which flies the
    test; and for networks that read a CTD: the test's water has one density.
    """
    if len(run.stores) > 1:
        say("leaving out the paper's test: one vehicle flies it with the sensors of its store")
        return None
    sensors = run.description["store"].get("sensors")
    if sensors is None:
        return None
    parts = parts_of(run.store)
    if set(parts) != set(GLIDER_PARTS):
        say(
            "leaving out the paper's test: the Sea-Wing flies it, and its parts are "
            f"{', '.join(GLIDER_PARTS)} and not {', '.join(parts)}"
        )
        return None
    if set(channels_of(run.features)) & set(ESTIMATED):
        say(
            "leaving out the paper's test: its water has one density and no CTD, which these "
            "networks read (group flight)"
        )
        return None
    say("flying the paper's test in three currents")
    from factory.generation.generation import generate
    from factory.sampling.recipe import make_recipe

    path = run.folder / PAPER_TEST_STORE
    recipe = make_recipe(preset="paper-test", sensors=str(sensors))
    generate(recipe, path, workers=1, overwrite=True, history="learn fit")
    return evaluate_run(run, path, split="all")


def _training_mission(run: Run) -> MissionSequence | None:
    """First training mission, with those of the page's channels that the store has."""
    store = run.stores[0]
    with MissionStore(store) as reader:
        present = set(reader.dataset.data_vars)
    channels = [name for name, _ in TRAINING_PANELS if name in present]
    split = "train" if "split" in present else "all"
    labels = run.labels
    learned = () if labels.source == "truth" else labels.channels()
    missions = load_missions(store, [*channels, *learned], split=split, limit=1)
    if not missions or not learned:
        return missions[0] if missions else None
    first = missions[0]
    found = {LABELS[TARGETS[n]]: np.asarray(labels.of(first, n), float) for n in TARGETS}
    return dataclasses.replace(first, signals={**first.signals, **found})
