"""Report: the page of a run, or of an evaluation on another store."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from learn.report import tables
from learn.report.contents import Contents, RunEvaluation
from learn.report.drawings import Drawings
from twin.cli.text_table import format_number
from twin.plot.page import Page


def build_page(folder: Path, contents: Contents) -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path."""
    page = Page(folder, contents.title, contents.lead)
    test = contents.test
    drawn = Drawings(page, contents)
    _key_figures(page, test.figures)
    page.points(tables.verdicts(test.figures))
    page.section("Velocities")
    _velocities(page, test)
    drawn.place("velocities")
    page.section("Dead reckoning")
    _dead_reckoning(page, test)
    drawn.place("dead_reckoning")
    _over_ground(page, test)
    drawn.place("over_ground")
    if contents.paper_test is not None:
        _paper_test(page, contents.paper_test)
    drawn.place("tracks")
    drawn.place("uncertainty", "Uncertainty")
    if contents.ablation:
        page.section("Ablation over inputs")
        page.table(
            tables.ablation_rows(test.figures, contents.ablation),
            "Networks of the same kind and training budget, for a vehicle without that sensor.",
        )
    drawn.place("training", "Training")
    if contents.provenance:
        page.section("Where this comes from")
        page.facts(contents.provenance)
    if contents.command:
        page.say("Made with")
        page.code(contents.command)
    return page.write()


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


def _velocities(page: Page, evaluated: RunEvaluation) -> None:
    rows = tables.velocity_rows(evaluated.figures)
    rows.append(
        {
            "method": "the paper's networks, as printed",
            "surge MSE [(m/s)²]": tables.PAPER["surge_mse"],
            "sway MSE [(m/s)²]": tables.PAPER["sway_mse"],
        }
    )
    page.table(rows, "Mean squared errors, all samples of the free run from launch to end.")


def _dead_reckoning(page: Page, evaluated: RunEvaluation) -> None:
    captions = {
        "water": "Through the water, measured attitude. Error at mission end over the horizontal "
        "path through the water; the floor has the true surge and sway, so that only attitude and "
        "depth are wrong.",
        "velocity": "The same with the true attitude, which leaves surge and sway alone.",
        "ground": "Over ground without any knowledge of the current, no fixes: the current "
        "decides. The on-board track is missing where it was reset at fixes.",
    }
    for track, caption in captions.items():
        rows = tables.track_rows(evaluated.figures, track)
        if rows:
            page.table(rows, caption)
    absent = tables.without_track(evaluated.figures, "water")
    if absent:
        page.say(absent)


def _over_ground(page: Page, evaluated: RunEvaluation) -> None:
    rows = tables.dive_rows(evaluated.figures)
    if not rows:
        page.say("No mission has two dives between GPS fixes, so nothing is known of a current.")
        return
    page.section("Over ground between GPS fixes")
    page.table(
        rows,
        "Error just before the fix at a dive's end in % of its path through the water. Corrected "
        "afterwards the end is pinned to the fix: there it is the largest error on the way. Dives "
        "that no other came before are left out.",
    )


def _paper_test(page: Page, evaluated: RunEvaluation) -> None:
    page.section("The paper's test: two spirals and a level part in three currents")
    page.table(tables.velocity_rows(evaluated.figures))
    page.table(tables.track_rows(evaluated.figures, "water"), "Through the water.")
