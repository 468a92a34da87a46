"""Run page: the HTML page of a run, or of its evaluation on another store, with figures.

The page on real logs has the errors at fixes only, since the true tracks are unknown.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from learn.evaluation.deviation import network_position_sd
from learn.evaluation.log_score import sentences
from learn.evaluation.score import NETWORK
from learn.report import result_tables
from learn.report.contents import Contents, RunEvaluation, Shown, Study
from learn.report.dot_figures import distribution_figure, dive_figure
from learn.report.track_figures import (
    BESIDE_DVL,
    doppler_error_figure,
    drawn_methods,
    error_figure,
    ground_lines,
    track_3d_figure,
    track_figure,
    water_lines,
    with_bottom_lock,
)
from learn.report.velocity_figures import (
    LABELS,
    learning_figure,
    training_figure,
    uncertainty_figure,
    velocity_figure,
)
from twin.cli.text_table import format_number
from twin.show.figures.page_layout import Page

if TYPE_CHECKING:
    from learn.run import Run

DOTS = "Every mission a dot, the median a bar."
DIVE_DOTS = "Every dive a dot, the median a bar."
IN_SPACE = "The same with the measured depth; the vertical scale is its own."
ERRORS = (
    "North and east error of the networks' dead-reckoned track, measured attitude, no fixes: "
    "through the water, and over ground with an unknown current."
)
STEADY_ERRORS = (
    " Through the water a steady current changes nothing, so that the lines cover each other; over "
    "ground its speed is their slope."
)
Drawn = tuple[Figure, str]
"""Figure and its caption in whole sentences"""


def _velocities_drawn(contents: Contents) -> Drawn | None:
    if not contents.test.shown:
        return None
    shown = contents.test.shown[0]
    return velocity_figure(shown), (
        f"Predicted against true velocity through the water, {shown.label}. The networks run free "
        "from the launch."
    )


def _by_doppler(draw: Callable[[Shown], Drawn]) -> Callable[[Contents], Drawn | None]:
    """Figure of the longest mission in which a Doppler log mostly had bottom lock; or None."""

    def drawn(contents: Contents) -> Drawn | None:
        shown = with_bottom_lock(contents.test.shown)
        return None if shown is None else draw(shown)

    return drawn


def _doppler_track(shown: Shown) -> Drawn:
    return track_figure(shown, BESIDE_DVL, ground_lines(shown, BESIDE_DVL)), (
        f"Tracks over ground, {shown.label}. Networks have one in still water, or between fixes "
        "with the current of the dive before."
    )


def _doppler_errors(shown: Shown) -> Drawn:
    return doppler_error_figure(shown), (
        f"Position errors over ground, {shown.label}. The paper had no truth and "
        "judged its networks by DVL-aided dead reckoning, whose own error stands beside."
    )


def _dives(contents: Contents) -> Drawn | None:
    figure = dive_figure(contents.test.evaluation)
    return None if figure is None else (figure, DIVE_DOTS)


def _track(contents: Contents) -> Drawn | None:
    if not contents.tracks:
        return None
    shown = contents.tracks[0]
    methods = [name for name in drawn_methods() if name in shown.estimates]
    figure = track_figure(shown, methods, water_lines(shown, methods))
    return figure, f"Dead-reckoned tracks through the water, {shown.label}."


def _track_3d(contents: Contents) -> Drawn | None:
    if not contents.tracks:
        return None
    shown = contents.tracks[0]
    return track_3d_figure(shown, water_lines(shown, drawn_methods())), IN_SPACE


def _errors(contents: Contents) -> Drawn | None:
    if not contents.tracks:
        return None
    steady = STEADY_ERRORS if contents.paper_test is not None else ""
    return error_figure(contents.tracks), ERRORS + steady


def _uncertainty(contents: Contents) -> Drawn | None:
    if contents.error_model is None or not contents.test.shown:
        return None
    shown = contents.test.shown[0]
    deviation = network_position_sd(shown.reference, shown.estimates[NETWORK], contents.error_model)
    share = contents.test.figures.get("uncertainty", {}).get("within_2sd")
    text = "" if share is None else f" {100 * share:.0f} % of the missions end within two of them."
    return uncertainty_figure(shown, deviation), (
        f"Horizontal error through the water and the predicted standard deviation, {shown.label}."
        f"{text}"
    )


def _training_data(contents: Contents) -> Drawn | None:
    mission = contents.training
    if mission is None:
        return None
    learned = "the velocities to learn in blue"
    if set(LABELS.values()) & set(mission.signals):
        learned = "the measured velocities to learn in orange, the truth in pale blue"
    return training_figure(mission), (
        f"A training mission ({mission.index}): {learned}, and what was measured."
    )


def _learning(contents: Contents) -> Drawn | None:
    if not contents.metrics:
        return None
    caption = "Error of the free run over whole validation missions during training."
    return learning_figure(contents.metrics), caption


@dataclasses.dataclass(frozen=True)
class ReportFigure:
    """Figure of the page; `draw` returns None if there is nothing to show."""

    section: str
    """Section of the page"""
    draw: Callable[[Contents], Drawn | None]
    beside: bool = False
    """True: in a wide window, the figure shares a row with the next figure that has True"""


FIGURES: Mapping[str, ReportFigure] = {
    "velocities": ReportFigure("velocities", _velocities_drawn),
    "distribution": ReportFigure(
        "dead_reckoning", lambda contents: (distribution_figure(contents.test.evaluation), DOTS)
    ),
    "doppler_track": ReportFigure("doppler", _by_doppler(_doppler_track), beside=True),
    "doppler_track_3d": ReportFigure(
        "doppler",
        _by_doppler(lambda one: (track_3d_figure(one, ground_lines(one, BESIDE_DVL)), IN_SPACE)),
        beside=True,
    ),
    "doppler_errors": ReportFigure("doppler", _by_doppler(_doppler_errors)),
    "dives": ReportFigure("over_ground", _dives),
    "track": ReportFigure("tracks", _track, beside=True),
    "track_3d": ReportFigure("tracks", _track_3d, beside=True),
    "errors": ReportFigure("tracks", _errors),
    "uncertainty": ReportFigure("uncertainty", _uncertainty),
    "training_data": ReportFigure("training", _training_data),
    "learning": ReportFigure("training", _learning),
}
"""Figures of a report, in the order of the page"""


def _draw(page: Page, contents: Contents, section: str, heading: str = "") -> None:
    """Draw the figures of a section below a heading; without any figure, there is no heading."""
    drawn = []
    for name, kind in FIGURES.items():
        if kind.section == section and (found := kind.draw(contents)) is not None:
            drawn.append((kind.beside, (name, *found)))
    if drawn and heading:
        page.section(heading)
    for beside, group in itertools.groupby(drawn, key=lambda entry: entry[0]):
        entries = [entry for _, entry in group]
        if beside:
            page.pair(entries)
            continue
        for entry in entries:
            page.figure(*entry)


def build_page(folder: Path, contents: Contents) -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path."""
    page = Page(folder, contents.title, contents.lead)
    test = contents.test
    _key_figures(page, test.figures)
    page.points([*contents.labels, *result_tables.verdicts(test.figures)])
    page.section("Velocities")
    _velocities(page, test)
    _draw(page, contents, "velocities")
    page.section("Dead reckoning")
    _dead_reckoning(page, test)
    _draw(page, contents, "dead_reckoning")
    if rows := result_tables.doppler_rows(test.figures):
        _doppler(page, rows, test.figures)
        _draw(page, contents, "doppler")
    _over_ground(page, test)
    _draw(page, contents, "over_ground")
    if contents.paper_test is not None:
        _paper_test(page, contents.paper_test)
    _draw(page, contents, "tracks")
    _draw(page, contents, "uncertainty", "Uncertainty")
    _studies(page, contents.studies)
    _draw(page, contents, "training", "Training")
    return _signed(page, contents.provenance, contents.command)


def _studies(page: Page, studies: Sequence[Study], before: str = "") -> None:
    for study in studies:
        page.section(study.title)
        page.table(study.rows, f"{before}{study.caption}")
        page.say(study.sentence)


def _signed(page: Page, provenance: Mapping[str, object], command: str) -> Path:
    """Add provenance and command to the page, and write the page."""
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
            "through the water, mean": text("dr_water_percent_mean", "%"),
            "rank among methods": result_tables.rank(found),
            "missions judged": str(found["missions"]),
            "with true attitude, mean": text("dr_velocity_percent_mean", "%"),
            "surge MSE, all samples": text("surge_mse", "(m/s)²"),
            "sway MSE, all samples": text("sway_mse", "(m/s)²"),
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
      studies: further tables of the run, such as leave-one-out results.
    """
    found = test.figures
    page = Page(
        folder,
        f"Surge and sway networks on logs: {run.name}",
        f"{found['missions']} dives ({test.evaluation.split}) of {test.evaluation.store}",
    )
    judged = sentences(test.evaluation.counts, run.labels)
    page.points([*judged, *run.label_sentences(), *result_tables.verdicts(found)])
    reference = f"the {run.labels.device}" if run.labels.device else "truth"
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
        page.figure("dives", drawn, DIVE_DOTS)
    if metrics := run.metrics():
        page.section("Training")
        page.figure(
            "learning",
            learning_figure(metrics),
            "Error of the free run over whole validation dives during training.",
        )
    return _signed(page, provenance, command)
