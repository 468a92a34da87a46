"""Doppler errors: position errors of networks and DVL-aided dead reckoning, and between them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learn.evaluation.evaluation import DVL, NETWORK
from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from learn.report.figures.lines import ground_lines, with_bottom_lock
from learn.report.names import colour_of
from learn.report.shown import Shown
from twin.plot import style

PAIRS: tuple[tuple[str, str, str, dict[str, Any]], ...] = (
    (NETWORK, "truth", "networks − truth", {"color": colour_of(NETWORK), "lw": 1.6}),
    (
        NETWORK, DVL, "networks − DVL-aided, as the paper",
        {"color": style.PALETTE["sky"], "lw": 1.4, "ls": (0, (6, 2))},
    ),
    (DVL, "truth", "DVL-aided − truth", {"color": colour_of(DVL), "lw": 1.1, "ls": (0, (1, 1.4))}),
)  # fmt: skip
"""Which track is compared with which, in words, and its line"""
LEAST_SHARE = 0.02
"""Of the whole path: a share of the distance so far means nothing before that"""


class DopplerErrors(ReportFigure):
    """See the module."""

    summary = "position errors of networks and DVL-aided dead reckoning"
    section = "doppler"

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        shown = with_bottom_lock(contents.test.shown)
        return None if shown is None else doppler_error_figure(shown)

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        shown = with_bottom_lock(contents.test.shown)
        assert shown is not None
        return (
            f"Position errors over ground without fixes, {shown.label}. The paper had no truth and "
            "judged its networks by DVL-aided dead reckoning, whose own error stands beside."
        )


def doppler_error_figure(shown: Shown) -> Figure:
    """North and east error over time, and the horizontal error in % of the path so far."""
    lines = ground_lines(shown, (NETWORK, DVL))
    path = shown.reference.path
    travelled = path >= LEAST_SHARE * path[-1]
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 2.9)
        axes = figure.subplots(1, 3)
        seconds, unit = style.time_unit(shown.time)
        for name, other, label, look in PAIRS:
            error = lines[name] - lines[other]
            for place, values in zip(axes[:2], error.T, strict=True):
                time, drawn = style.thin(shown.time / seconds, values)
                place.plot(time, drawn, label=label, **look)
            share = 100.0 * np.hypot(*error.T)[travelled] / path[travelled]
            time, drawn = style.thin(shown.time[travelled] / seconds, share)
            axes[2].plot(time, drawn, **look)
        for place in axes[:2]:
            place.axhline(0.0, color=style.GUIDE, lw=0.7, zorder=0)
        axes[2].set_ylim(bottom=0.0)
        for place, title in zip(
            axes,
            ("north error [m]", "east error [m]", "error [% of the path so far]"),
            strict=True,
        ):
            place.set_title(title)
            style.label_time(place, unit)
        figure.legend(
            *axes[0].get_legend_handles_labels(), loc="outside lower left", ncols=len(PAIRS)
        )
    return figure
