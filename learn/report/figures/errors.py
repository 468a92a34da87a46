"""Errors: north and east error of the networks' track over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from learn.evaluation.evaluation import NETWORK
from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from learn.report.shown import Shown
from twin.plot import style

LEAST_ERROR_M = 0.05
"""Span of an error axis that hardly varies: centimetres are noise to a navigator."""
MARGIN = 0.12
"""Of the range, above and below the lines together"""
MISSION_DASHES = ((0, ()), (0, (7, 4)), (0, (1.5, 3)))
"""Of missions: gaps leave what lies below visible"""
MISSION_COLOURS = (style.TRUTH, style.PALETTE["orange"], style.PALETTE["black"])
CAPTION = (
    "North and east error of the networks' dead-reckoned track, measured attitude, no fixes: "
    "through the water, and over ground with nothing known of the current."
)
STEADY_CAPTION = (
    " Through the water a steady current changes nothing, so that the lines cover each other; over "
    "ground its speed is their slope."
)


class Errors(ReportFigure):
    """See the module."""

    summary = "position error of the networks over time, one line per mission"
    section = "tracks"

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        return error_figure(contents.tracks) if contents.tracks else None

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        return CAPTION + (STEADY_CAPTION if contents.paper_test is not None else "")


def error_figure(missions: Sequence[Shown]) -> Figure:
    """North and east error of the networks' track against time, one line per mission.

    The paper's figure for its three currents, through the water (above) and over ground with
    nothing known of the current (below); no fixes. Both panels of a row have one scale.
    """
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 4.6)
        axes = figure.subplots(2, 2, sharex=True, sharey="row")
        seconds, unit = style.time_unit(max((s.time for s in missions), key=len))
        for k, shown in enumerate(missions):
            track = shown.water_track(NETWORK)
            assert track is not None
            for row, truth in zip(
                axes, (shown.reference.water_track, shown.reference.ground_track), strict=True
            ):
                for place, values in zip(row, (track - truth).T, strict=True):
                    time, error = style.thin(shown.time / seconds, values)
                    place.plot(
                        time, error, lw=1.5, label=shown.label,
                        color=MISSION_COLOURS[k % len(MISSION_COLOURS)],
                        ls=MISSION_DASHES[k % len(MISSION_DASHES)],
                    )  # fmt: skip
        for row in axes:
            for place in row:
                place.axhline(0.0, color=style.GUIDE, lw=0.7, zorder=0)
            values = np.concatenate([np.asarray(line.get_ydata()) for a in row for line in a.lines])
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            reach = 0.5 * max((1.0 + MARGIN) * (high - low), LEAST_ERROR_M)
            row[0].set_ylim(0.5 * (low + high) - reach, 0.5 * (low + high) + reach)
        for row, where in zip(axes, ("through the water", "over ground"), strict=True):
            for place, name in zip(row, ("north", "east"), strict=True):
                place.set_title(f"{name} error, {where}")
            row[0].set_ylabel("estimate − truth [m]")
            row[1].tick_params(labelleft=True)
        for place in axes[1]:
            style.label_time(place, unit)
        figure.suptitle("position error of the networks' dead reckoning", x=0.01, ha="left")
        figure.legend(
            *axes[0, 0].get_legend_handles_labels(), loc="outside lower left", ncols=len(missions)
        )
    return figure
