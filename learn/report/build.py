"""Build: the page of a run, or of an evaluation on another store."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from learn.data.dataset import Mission
from learn.evaluation.evaluation import NETWORK, Evaluation
from learn.evaluation.score import Reference
from learn.evaluation.uncertainty import ErrorModel, network_position_sd
from learn.report import figures, spread_figures, tables, track_figures
from learn.report.page import Page
from learn.report.shown import Shown
from twin.cli.text_table import format_number

DRAWN_METHODS = (NETWORK, "pitch_plus_alpha", "steady_flight")
"""Tracks of the north-east figures; more would hide each other."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Judged:
    """One evaluation with what a page needs of it."""

    evaluation: Evaluation
    figures: Mapping[str, Any]
    """What `Evaluation.to_json` said."""
    shown: tuple[Shown, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Contents:
    """Everything that a page is made of; what is missing is left out."""

    title: str
    lead: str
    test: Judged
    paper_test: Judged | None = None
    """The paper's three missions."""
    error_model: ErrorModel | None = None
    metrics: Sequence[Mapping[str, Any]] = ()
    training: Mission | None = None
    ablation: Mapping[str, Mapping[str, Any]] = dataclasses.field(default_factory=dict)
    """Figures of networks without some inputs, by what they lack."""
    provenance: Mapping[str, object] = dataclasses.field(default_factory=dict)
    command: str = ""


def build_page(folder: Path, contents: Contents) -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path."""
    page = Page(folder, contents.title, contents.lead)
    test = contents.test
    _key_figures(page, test.figures)
    page.points(tables.verdicts(test.figures))
    page.section("Velocities")
    _velocities(page, test)
    page.section("Dead reckoning")
    _dead_reckoning(page, test)
    _over_ground(page, test)
    if contents.paper_test is not None:
        _paper_test(page, contents.paper_test)
    elif test.shown:
        _tracks(page, test.shown[0])
        page.figure("errors", track_figures.error_figure(test.shown), ERROR_CAPTION)
    if contents.error_model is not None and test.shown:
        _uncertainty(page, test.shown[0], contents.error_model, test.figures)
    if contents.ablation:
        page.section("Ablation over inputs")
        page.table(
            tables.ablation_rows(test.figures, contents.ablation),
            "Networks of the same kind and training budget, for a vehicle without that sensor.",
        )
    _training(page, contents)
    if contents.provenance:
        page.section("Where this comes from")
        page.facts(contents.provenance)
    if contents.command:
        page.say("Made with")
        page.code(contents.command)
    return page.write()


ERROR_CAPTION = (
    "North and east error of the networks' dead-reckoned track, measured attitude, no fixes: "
    "through the water, and over ground with nothing known of the current."
)
STEADY_CAPTION = (
    " Through the water a steady current changes nothing, so that the lines cover each other; over "
    "ground its speed is their slope."
)


def _key_figures(page: Page, found: Mapping[str, Any]) -> None:
    def text(key: str, unit: str) -> str:
        return f"{format_number(found[key], 3)} {unit}" if found[key] is not None else "-"

    page.numbers(
        {
            "missions": str(found["missions"]),
            "surge MSE, all samples": text("surge_mse", "(m/s)²"),
            "sway MSE, all samples": text("sway_mse", "(m/s)²"),
            "through the water, mean": text("dr_water_percent_mean", "%"),
            "with true attitude, mean": text("dr_velocity_percent_mean", "%"),
            "over ground, no current known, mean": text("dr_ground_percent_mean", "%"),
        }
    )


def _velocities(page: Page, judged: Judged) -> None:
    rows = tables.velocity_rows(judged.figures)
    rows.append(
        {
            "method": "the paper's networks, as printed",
            "surge MSE [(m/s)²]": tables.PAPER["surge_mse"],
            "sway MSE [(m/s)²]": tables.PAPER["sway_mse"],
        }
    )
    page.table(rows, "Mean squared errors, all samples of the free run from launch to end.")
    if judged.shown:
        first = judged.shown[0]
        page.figure(
            "velocities",
            figures.velocity_figure(first),
            f"Predicted against true velocity through the water, {first.label}. "
            "The networks run free from the launch.",
        )


def _dead_reckoning(page: Page, judged: Judged) -> None:
    captions = {
        "water": "Through the water, measured attitude. Error at mission end over the horizontal "
        "path through the water; the floor has the true surge and sway, so that only attitude and "
        "depth are wrong.",
        "velocity": "The same with the true attitude, which leaves surge and sway alone.",
        "ground": "Over ground without any knowledge of the current, no fixes: the current "
        "decides. The on-board track is missing where it was reset at fixes.",
    }
    for track, caption in captions.items():
        rows = tables.track_rows(judged.figures, track)
        if rows:
            page.table(rows, caption)
    absent = tables.without_track(judged.figures, "water")
    if absent:
        page.say(absent)
    page.figure(
        "distribution",
        spread_figures.distribution_figure(judged.evaluation),
        "Every mission a dot, the median a bar.",
    )


def _over_ground(page: Page, judged: Judged) -> None:
    rows = tables.dive_rows(judged.figures)
    drawn = spread_figures.dive_figure(judged.evaluation)
    if not rows or drawn is None:
        page.say("No mission has two dives between GPS fixes, so nothing is known of a current.")
        return
    page.section("Over ground between GPS fixes")
    page.table(
        rows,
        "Error just before the fix at a dive's end in % of its path through the water. Corrected "
        "afterwards the end is pinned to the fix: there it is the largest error on the way. Dives "
        "that no other came before are left out.",
    )
    page.figure("dives", drawn, "Every dive a dot, the median a bar.")


def _paper_test(page: Page, judged: Judged) -> None:
    page.section("The paper's test: two spirals and a level part in three currents")
    page.table(tables.velocity_rows(judged.figures))
    page.table(tables.track_rows(judged.figures, "water"), "Through the water.")
    _tracks(page, judged.shown[0])
    page.figure("errors", track_figures.error_figure(judged.shown), ERROR_CAPTION + STEADY_CAPTION)


def _tracks(page: Page, shown: Shown) -> None:
    page.pair(
        [
            (
                "track",
                track_figures.track_figure(shown, DRAWN_METHODS),
                f"Dead-reckoned tracks through the water, {shown.label}.",
            ),
            (
                "track_3d",
                track_figures.track_3d_figure(shown, DRAWN_METHODS),
                "The same with the measured depth; the vertical scale is its own.",
            ),
        ]
    )


def _uncertainty(page: Page, shown: Shown, model: ErrorModel, found: Mapping[str, Any]) -> None:
    page.section("Uncertainty")
    reference: Reference = shown.reference
    deviation = network_position_sd(reference, shown.estimates[NETWORK], model)
    share = found.get("uncertainty", {}).get("within_2sd")
    text = ""
    if share is not None:
        text = f" {100 * share:.0f} % of the missions end within two of them."
    page.figure(
        "uncertainty",
        figures.uncertainty_figure(shown, deviation),
        f"Horizontal error through the water and the predicted standard deviation, "
        f"{shown.label}.{text}",
    )


def _training(page: Page, contents: Contents) -> None:
    drawn = []
    if contents.training is not None:
        page.section("Training")
        page.figure(
            "training_data",
            figures.training_figure(contents.training),
            f"A training mission ({contents.training.index}): the targets in blue, and inputs.",
        )
        drawn.append("training_data")
    if contents.metrics:
        if not drawn:
            page.section("Training")
        page.figure(
            "learning",
            figures.learning_figure(contents.metrics),
            "Error of the free run over whole validation missions during training.",
        )
