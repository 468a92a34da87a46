"""Uncertainty: position error against its predicted standard deviation."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from learn.evaluation.evaluation import NETWORK
from learn.evaluation.uncertainty import network_position_sd
from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from learn.report.shown import Shown
from twin.navigation.dead_reckoning import Array
from twin.plot import style


class Uncertainty(ReportFigure):
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
