"""Log page: an evaluation on real logs, whose true tracks nobody knows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from learn.evaluation.log_score import sentences
from learn.report import tables
from learn.report.contents import RunEvaluation
from learn.report.figures.dives import dive_figure
from learn.report.figures.learning import learning_figure
from twin.plot.page import Page

if TYPE_CHECKING:
    from learn.runs.run import Run


def build_log_page(
    folder: Path, run: Run, test: RunEvaluation, provenance: Mapping[str, object], command: str
) -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path."""
    found = test.figures
    page = Page(
        folder,
        f"Surge and sway networks on logs: {run.name}",
        f"{found['missions']} dives ({test.evaluation.split}) of {test.evaluation.store}",
    )
    page.points([*sentences(test.evaluation.counts), *tables.verdicts(found)])
    if rows := tables.velocity_rows(found):
        page.section("Velocities")
        page.table(rows, "Mean squared errors of the free run, samples with truth only.")
    if rows := tables.track_rows(found, "ground"):
        page.section("Dead reckoning")
        page.table(rows, "Over ground from fix to fix, nothing known of the current.")
    rows, drawn = tables.dive_rows(found), dive_figure(test.evaluation)
    if rows and drawn is not None:
        page.table(
            rows,
            "Error at the fix that ends a dive, in % of its path through the water by depth rate "
            "and pitch. Between fixes nothing is known, so that a track that is corrected "
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
    page.section("Where this comes from")
    page.facts(provenance)
    if command:
        page.say("Made with")
        page.code(command)
    return page.write()
