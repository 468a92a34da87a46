"""Log page: an evaluation on real logs, whose true tracks nobody knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from learn.evaluation.log_score import sentences
from learn.report import result_tables
from learn.report.contents import RunEvaluation, Study
from learn.report.lines import learning_figure
from learn.report.velocities import dive_figure
from twin.show.figures.page_layout import Page

if TYPE_CHECKING:
    from learn.run import Run


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
    for study in studies:
        page.section(study.title)
        page.table(study.rows, f"Against {reference}. {study.caption}")
        page.say(study.sentence)
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
    page.section("Where this comes from")
    page.facts(provenance)
    if command:
        page.say("Made with")
        page.code(command)
    return page.write()
