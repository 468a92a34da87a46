"""Velocities: predicted against true surge and sway over a mission.

Dives: errors over ground between GPS fixes by method.
Uncertainty: position error against its predicted standard deviation.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from learn.evaluation.deviation import network_position_sd
from learn.evaluation.evaluation import Evaluation
from learn.evaluation.score import LAUNCH_S, NETWORK
from learn.report.contents import (
    KNOWLEDGE_TITLES,
    Contents,
    ReportFigure,
    Shown,
    colour_of,
    title_of,
)
from learn.report.lines import dots, explain, plain_decades
from twin.navigation.dead_reckoning import Array
from twin.navigation.dives import KNOWLEDGE
from twin.show import style

MILLIMETRES_PER_METRE = 1e3
SHOWN_PERCENT = 99.5
"""Of the errors after the launch that the axes cover"""


class Velocities(ReportFigure):
    """See the module."""

    summary = "predicted against true surge and sway of a mission"
    section = "velocities"

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        return velocity_figure(contents.test.shown[0]) if contents.test.shown else None

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        return (
            f"Predicted against true velocity through the water, {contents.test.shown[0].label}. "
            "The networks run free from the launch."
        )


def velocity_figure(shown: Shown) -> Figure:
    """Predicted against true surge and sway over a mission, with the errors below.

    The errors' axes cover what comes after the launch from rest, whose spike would hide the rest.
    """
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 4.2)
        axes = figure.subplots(2, 2, sharex=True, height_ratios=(2, 1))
        seconds, unit = style.time_unit(shown.time)
        estimate = shown.estimates[NETWORK]
        clipped = False
        for column, name in enumerate(("surge", "sway")):
            truth = getattr(shown.reference, name)
            predicted = np.asarray(getattr(estimate, name), float)
            time, true, guess = style.thin(shown.time / seconds, truth, predicted)
            top, bottom = axes[:, column]
            top.plot(time, guess, color=style.ESTIMATE, lw=1.8, label="predicted")
            # above the other one, and thin: where both agree both are seen
            top.plot(time, true, color=style.TRUTH, lw=0.8, label="true", zorder=3)
            spread = getattr(estimate, f"{name}_sd")
            if spread is not None:
                (sd,) = style.thin(np.asarray(spread, float))
                top.fill_between(
                    time, guess - 2 * sd, guess + 2 * sd, color=style.ESTIMATE, alpha=0.2, lw=0,
                    label="2 standard deviations of the ensemble",
                )  # fmt: skip
            top.set_title(name)
            bottom.axhline(0.0, color=style.GUIDE, lw=0.8, zorder=1)
            bottom.plot(time, MILLIMETRES_PER_METRE * (guess - true), color=style.ESTIMATE, lw=0.8)
            reach = after_launch(MILLIMETRES_PER_METRE * (predicted - truth), shown.time)
            bottom.set_ylim(-reach, reach)
            worst = float(np.max(np.abs(predicted - truth))) * MILLIMETRES_PER_METRE
            clipped |= worst > reach
            style.label_time(bottom, unit)
        for bottom in axes[1]:
            what = "predicted − true" + (", launch and spikes clipped" if clipped else "")
            bottom.set_title(what, fontweight="normal")
        axes[0, 0].set_ylabel("through the water [m/s]")
        axes[1, 0].set_ylabel("error [mm/s]")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
        figure.suptitle(shown.label, x=0.01, ha="left", fontsize=8.5)
    return figure


def after_launch(error: Array, time: Array) -> float:
    """Half range of an axis about zero that shows the errors after the launch, spikes left out.

    Args:
      error: (time,), any unit.
      time: [s], (time,).
    """
    late = np.abs(error[time > LAUNCH_S])
    late = late[np.isfinite(late)]
    reach = float(np.percentile(late, SHOWN_PERCENT)) if late.size else 0.0
    return 1.25 * reach or 1.0


LABEL_SIZE = 8.0
"""[pt]"""


class Dives(ReportFigure):
    """See the module."""

    summary = "error over ground of every dive by what is known of the current"
    section = "over_ground"

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        return dive_figure(contents.test.evaluation)

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        return "Every dive a dot, the median a bar."


def dive_figure(evaluation: Evaluation) -> Figure | None:
    """Error over ground at the end of a dive, by what is known of the current; None without dives.

    Panels without any value are left out: between the fixes of a log nothing is known, so that a
    track that is corrected afterwards has no error.

    Corrected afterwards the end is pinned to the fix, so there it is the largest error on the way.
    """
    kept: dict[str, dict[str, Array]] = {}
    for name, method in evaluation.methods.items():
        for knowledge in KNOWLEDGE:
            errors = [e for score in method.scores for e in score.dives.get(knowledge, ())]
            if errors:
                values = [e.max_percent if knowledge == "corrected" else e.percent for e in errors]
                kept.setdefault(name, {})[knowledge] = np.array(values)
    if not kept:
        return None
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 0.36 * len(kept) + 1.3)
        known = [name for name in KNOWLEDGE if any(name in found for found in kept.values())]
        axes = figure.subplots(1, len(known), sharey=True, sharex=True, squeeze=False)[0]
        for place, knowledge in zip(axes, known, strict=True):
            for row, (name, found) in enumerate(reversed(kept.items())):
                if knowledge in found:
                    dots(place, row, found[knowledge], colour_of(name))
            place.set_title(KNOWLEDGE_TITLES[knowledge])
            plain_decades(place)
            place.grid(visible=False, axis="y")
        axes[0].set_yticks(range(len(kept)), [title_of(name) for name in reversed(kept)])
        figure.supxlabel(
            "error over ground [% of the dive's path through the water]", fontsize=LABEL_SIZE
        )
        explain(figure, "a dive", [])
    return figure


class UncertaintyFigure(ReportFigure):
    """See the module."""

    summary = "position error of a mission and its predicted deviation"
    section = "uncertainty"

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        if contents.error_model is None or not contents.test.shown:
            return None
        shown = contents.test.shown[0]
        deviation = network_position_sd(
            shown.reference, shown.estimates[NETWORK], contents.error_model
        )
        return uncertainty_figure(shown, deviation)

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        share = contents.test.figures.get("uncertainty", {}).get("within_2sd")
        text = ""
        if share is not None:
            text = f" {100 * share:.0f} % of the missions end within two of them."
        return (
            "Horizontal error through the water and the predicted standard deviation, "
            f"{contents.test.shown[0].label}.{text}"
        )


def uncertainty_figure(shown: Shown, deviation: Array) -> Figure:
    """Horizontal error through the water against two standard deviations as predicted.

    Args:
      deviation: standard deviation [m] of the horizontal position, (time,).
    """
    track = shown.water_track(NETWORK)
    assert track is not None
    with style.styled():
        figure = style.new_figure(style.COLUMN_WIDTH * 1.25, 2.6)
        axes = figure.add_subplot()
        seconds, unit = style.time_unit(shown.time)
        error = np.hypot(*(track - shown.reference.water_track).T)
        time, wrong, sd = style.thin(shown.time / seconds, error, deviation)
        axes.fill_between(
            time,
            0.0,
            2.0 * sd,
            color=style.GUIDE,
            alpha=0.3,
            lw=0,
            label="2 predicted standard deviations",
        )
        axes.plot(time, wrong, color=style.ESTIMATE, label="error of the networks")
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel("horizontal position error [m]")
        style.label_time(axes, unit)
        inside = error[-1] <= 2.0 * deviation[-1]
        place = "inside" if inside else "outside"
        axes.set_title(f"{shown.label}:\nthe end lies {place} 2 deviations")
        axes.set_ylim(top=1.3 * axes.get_ylim()[1])  # room for the legend above the curves
        axes.legend(loc="upper left")
    return figure
