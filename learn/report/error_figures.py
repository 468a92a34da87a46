"""Errors: north and east error of the networks' track over time.

Distribution: dead-reckoning errors of all missions by method.
Doppler errors: position errors of networks and DVL-aided dead reckoning, and between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learn.evaluation.evaluation import Evaluation
from learn.evaluation.score import DVL, NETWORK
from learn.report.contents import Contents, ReportFigure, Shown, colour_of, title_of
from learn.report.lines import dots, explain, ground_lines, plain_decades, with_bottom_lock
from twin.show import style

LEAST_ERROR_M = 0.05
"""Span of an error axis that hardly varies: centimetres are noise to a navigator."""
MARGIN = 0.12
"""Of the range, above and below the lines together"""
MISSION_DASHES = ((0, ()), (0, (7, 4)), (0, (1.5, 3)))
"""Of missions: gaps leave what lies below visible"""
MISSION_COLOURS = (style.TRUTH, style.PALETTE["orange"], style.PALETTE["black"])
CAPTION = (
    "North and east error of the networks' dead-reckoned track, measured attitude, no fixes: "
    "through the water, and over ground with an unknown current."
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


class ErrorDistribution(ReportFigure):
    """See the module."""

    summary = "error through the water of every mission by method"
    section = "dead_reckoning"

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        return distribution_figure(contents.test.evaluation)

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        return "Every mission a dot, the median a bar."


def distribution_figure(evaluation: Evaluation) -> Figure:
    """Dead-reckoning error through the water over missions, each a dot, on a logarithmic axis."""
    rows = [
        (name, [s.tracks["water"].percent for s in method.scores if "water" in s.tracks])
        for name, method in evaluation.methods.items()
    ]
    rows = [(name, values) for name, values in rows if values]
    missing = [name for name in evaluation.methods if name not in {row for row, _ in rows}]
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH * 0.75, 0.42 * len(rows) + 1.15)
        axes = figure.add_subplot()
        for place, (name, values) in enumerate(reversed(rows)):
            dots(axes, place, np.array(values), colour_of(name))
        axes.set_yticks(range(len(rows)), [title_of(name) for name, _ in reversed(rows)])
        plain_decades(axes)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("error at mission end [% of the path through the water]")
        axes.set_title("through the water, measured attitude")
        explain(
            figure,
            "a mission",
            [f"no track through the water: {', '.join(map(title_of, missing))}"] if missing else [],
        )
    return figure


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
