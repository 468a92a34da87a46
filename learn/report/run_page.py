"""Report: the page of a run, or of an evaluation on another store, with its figures.

Of real logs the true tracks are unknown: their page has what is judged between fixes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from learn.evaluation.log_score import sentences
from learn.report import result_tables
from learn.report.contents import Contents, ReportFigure, RunEvaluation, Study
from learn.report.error_figures import DopplerErrors, ErrorDistribution, Errors
from learn.report.lines import Learning, learning_figure
from learn.report.track_figures import DopplerTrack, DopplerTrack3d, Track3d, TrackFigure
from learn.report.training_data import TrainingData
from learn.report.velocities import Dives, UncertaintyFigure, Velocities, dive_figure
from twin.cli.text_table import format_number
from twin.show.figures.page_layout import Page

if TYPE_CHECKING:
    from learn.run import Run

FIGURES: Mapping[str, type[ReportFigure]] = {
    "velocities": Velocities,
    "distribution": ErrorDistribution,
    "doppler_track": DopplerTrack,
    "doppler_track_3d": DopplerTrack3d,
    "doppler_errors": DopplerErrors,
    "dives": Dives,
    "track": TrackFigure,
    "track_3d": Track3d,
    "errors": Errors,
    "uncertainty": UncertaintyFigure,
    "training_data": TrainingData,
    "learning": Learning,
}
"""Figures of a report, in the order of the page."""


class Drawings:
    """Puts the figures of a section on a page when its turn comes."""

    def __init__(self, page: Page, contents: Contents) -> None:
        self._page, self._contents = page, contents

    def place(self, section: str, heading: str = "") -> None:
        """Draw what has something to show.

        Args:
          section: one of `learn.report.contents.SECTIONS`.
          heading: stands above the first figure.
        """
        drawn = []
        for name, kind in FIGURES.items():
            if kind.section != section:
                continue
            figure = kind()
            drawing = figure.draw(self._contents)
            if drawing is not None:
                drawn.append((kind.beside, (name, drawing, figure.caption(self._contents))))
        if drawn and heading:
            self._page.section(heading)
        for beside, group in itertools.groupby(drawn, key=lambda entry: entry[0]):
            entries = [entry for _, entry in group]
            if beside:
                self._page.pair(entries)
                continue
            for entry in entries:
                self._page.figure(*entry)


def build_page(folder: Path, contents: Contents) -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path."""
    page = Page(folder, contents.title, contents.lead)
    test = contents.test
    drawn = Drawings(page, contents)
    _key_figures(page, test.figures)
    page.points([*contents.labels, *result_tables.verdicts(test.figures)])
    page.section("Velocities")
    _velocities(page, test)
    drawn.place("velocities")
    page.section("Dead reckoning")
    _dead_reckoning(page, test)
    drawn.place("dead_reckoning")
    if rows := result_tables.doppler_rows(test.figures):
        _doppler(page, rows, test.figures)
        drawn.place("doppler")
    _over_ground(page, test)
    drawn.place("over_ground")
    if contents.paper_test is not None:
        _paper_test(page, contents.paper_test)
    drawn.place("tracks")
    drawn.place("uncertainty", "Uncertainty")
    _studies(page, contents.studies)
    drawn.place("training", "Training")
    return _signed(page, contents.provenance, contents.command)


def _studies(page: Page, studies: Sequence[Study], before: str = "") -> None:
    for study in studies:
        page.section(study.title)
        page.table(study.rows, f"{before}{study.caption}")
        page.say(study.sentence)


def _signed(page: Page, provenance: Mapping[str, object], command: str) -> Path:
    """The page with what it was made from and with, written."""
    if provenance:
        page.section("Where this comes from")
        page.facts(provenance)
    if command:
        page.say("Made with")
        page.code(command)
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
    rows = result_tables.velocity_rows(evaluated.figures)
    paper = result_tables.PAPER_PROPELLED if evaluated.evaluation.propelled else result_tables.PAPER
    rows.append(result_tables.printed_row(paper))
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
        rows = result_tables.track_rows(evaluated.figures, track)
        if rows:
            page.table(rows, caption)
    absent = result_tables.without_track(evaluated.figures, "water")
    if absent:
        page.say(absent)


def _doppler(page: Page, rows: list[result_tables.Row], figures: Mapping[str, Any]) -> None:
    page.section("Beside DVL-aided dead reckoning")
    page.table(
        rows,
        "Over ground, no fixes: distance between two tracks at mission end over the horizontal "
        "path through the water. The Doppler log sees the bottom and so the current; the networks "
        "do not.",
    )
    velocities = figures["against_dvl"]
    if velocities["surge_mse"] is not None:
        page.say(
            f"From the cleaned velocities of the log, at the {velocities['samples']} samples that "
            f"have one, the networks differ by {format_number(velocities['surge_mse'], 3)} (m/s)² "
            f"in surge and {format_number(velocities['sway_mse'], 3)} (m/s)² in sway (mean "
            "squares); part of that is the log's own error."
        )


def _over_ground(page: Page, evaluated: RunEvaluation) -> None:
    rows = result_tables.dive_rows(evaluated.figures)
    if not rows:
        page.say("No mission has two dives between GPS fixes, so the current is unknown.")
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
    page.table(
        [
            *result_tables.velocity_rows(evaluated.figures),
            result_tables.printed_row(result_tables.PAPER),
        ]
    )
    page.table(result_tables.track_rows(evaluated.figures, "water"), "Through the water.")


def build_log_page(
    folder: Path,
    run: Run,
    test: RunEvaluation,
    provenance: Mapping[str, object],
    command: str,
    studies: Sequence[Study] = (),
) -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path.

    Args:
      studies: of the run, such as leave one out.
    """
    found = test.figures
    page = Page(
        folder,
        f"Surge and sway networks on logs: {run.name}",
        f"{found['missions']} dives ({test.evaluation.split}) of {test.evaluation.store}",
    )
    judged = sentences(test.evaluation.counts, run.labels)
    page.points([*judged, *run.label_sentences(), *result_tables.verdicts(found)])
    reference = "the Doppler log" if run.labels.source == "dvl" else "truth"
    if rows := result_tables.velocity_rows(found):
        page.section("Velocities")
        page.table(rows, f"Mean squared errors of the free run against {reference}, where it is.")
    _studies(page, studies, f"Against {reference}. ")
    if rows := result_tables.track_rows(found, "ground"):
        page.section("Dead reckoning")
        page.table(rows, "Over ground from fix to fix, the current unknown.")
    rows, drawn = result_tables.dive_rows(found), dive_figure(test.evaluation)
    if rows and drawn is not None:
        page.table(
            rows,
            "Error at the fix that ends a dive, in % of its path through the water by depth rate "
            "and pitch. Between fixes the truth is unknown, so that a track that is corrected "
            "afterwards shows no error.",
        )
        page.figure("dives", drawn, "Every dive a dot, the median a bar.")
    if metrics := run.metrics():
        page.section("Training")
        page.figure(
            "learning",
            learning_figure(metrics),
            "Error of the free run over whole validation dives during training.",
        )
    return _signed(page, provenance, command)
