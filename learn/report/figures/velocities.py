"""Velocities: predicted against true surge and sway over a mission."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from learn.evaluation.evaluation import NETWORK
from learn.evaluation.score import LAUNCH_S
from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from learn.report.shown import Shown
from twin.navigation.dead_reckoning import Array
from twin.plot import style

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
