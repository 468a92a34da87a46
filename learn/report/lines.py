"""Lines: tracks of the methods through the water and how they look.

Dots: every mission or dive a dot, the median a bar.
Learning: validation error during the training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from learn.data.labels import MODE
from learn.evaluation.score import DVL, FLOOR, NETWORK
from learn.report.contents import Contents, ReportFigure, Shown, colour_of, title_of
from twin.navigation.dead_reckoning import Array
from twin.navigation.estimators.base import baselines
from twin.navigation.estimators.dvl import BOTTOM
from twin.show import style

DASHES = ((0, (6, 2)), (0, (1, 1.4)), (0, (6, 2, 1, 2)), (0, (3, 1.5)))
"""Of methods in their order: each tells itself from the others without its colour"""
TRUTH_LINE: dict[str, Any] = {"color": style.TRUTH, "lw": 4.0, "alpha": 0.35, "label": "truth"}
"""Wide and pale, so that what lies on it is seen"""
MARKS = {"start": (0, "o"), "end": (-1, "s")}


def drawn_methods() -> tuple[str, ...]:
    """Those whose tracks are drawn; more would hide each other."""
    return (NETWORK, *(name for name, kind in baselines().items() if kind.drawn))


def water_lines(shown: Shown, methods: Sequence[str]) -> dict[str, Array]:
    """Tracks through the water [m], (time, 2), of the truth and of methods that have one."""
    lines = {"truth": shown.reference.water_track}
    for name in methods:
        track = shown.water_track(name) if name in shown.estimates else None
        if track is not None and name != FLOOR:
            lines[name] = track
    return lines


BESIDE_DVL = (NETWORK, DVL)
LEAST_BOTTOM_SHARE = 0.5
"""Of the samples of a mission that is drawn beside a Doppler log's track over ground"""


def with_bottom_lock(missions: Sequence[Shown]) -> Shown | None:
    """The longest of the missions in which a Doppler log saw the bottom most of the time."""
    seen = [
        shown
        for shown in missions
        if DVL in shown.estimates
        and shown.estimates[DVL].ground_track is not None
        and np.mean(shown.reference.mission.signals[MODE] == BOTTOM) >= LEAST_BOTTOM_SHARE
    ]
    return max(seen, key=lambda shown: float(shown.reference.path[-1]), default=None)


def ground_lines(shown: Shown, methods: Sequence[str]) -> dict[str, Array]:
    """Tracks over ground [m], (time, 2), of the truth and of methods that have one."""
    lines = {"truth": shown.reference.ground_track}
    for name in methods:
        track = shown.reference.tracks(shown.estimates[name]).get("ground")
        if track is not None:
            lines[name] = track
    return lines


def look(name: str, place: int) -> dict[str, Any]:
    """Line of a method, `place` in the order of those drawn; the truth is the first."""
    if name == "truth":
        return TRUTH_LINE
    dashes = DASHES[(place - 1) % len(DASHES)]
    return {"color": colour_of(name), "lw": 1.4, "ls": dashes, "label": title_of(name)}


FEW_DECADES = 2.0
"""Below, a logarithmic axis has 2 and 5 written beside the powers of ten."""
MOST_TICKS = 6
MOST_MINOR_TICKS = 60
LEAST_PERCENT = 1e-4
"""Left end of logarithmic axes: a metre in a thousand kilometres."""
GOLDEN = 0.6180339887
"""Fractional part of the golden ratio, whose multiples spread evenly."""


def explain(figure: Figure, dots: str, notes: Sequence[str]) -> None:
    """What dots and bars are, and what is missing, above the axes."""
    dot = Line2D([], [], marker="o", ms=3.2, ls="none", color=style.GUIDE, label=dots)
    bar = Line2D([], [], marker="|", ms=9, mew=2.2, ls="none", color=style.GUIDE, label="median")
    blank = [Line2D([], [], ls="none", label=note) for note in notes]
    figure.legend(handles=[dot, bar, *blank], loc="outside upper left", ncols=3)


def dots(axes: Axes, row: int, values: Array, colour: str) -> None:
    """Each value a dot, the median a bar; jittered by rank so that equal ones stay visible."""
    values = np.maximum(values[np.isfinite(values)], LEAST_PERCENT)
    jitter = 0.22 * (np.mod(np.arange(len(values)) * GOLDEN, 1.0) - 0.5)
    axes.plot(values, row + jitter, "o", ms=3.2, color=colour, alpha=0.55, mew=0)
    median = float(np.median(values))
    axes.plot([median, median], [row - 0.3, row + 0.3], color=colour, lw=2.2)


def plain_decades(axes: Axes) -> None:
    """A logarithmic x axis whose few numbers are written out: 2, 5, 10, 20."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    decades = np.log10(high / low)
    steps = (1.0, 2.0, 5.0) if decades < FEW_DECADES else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(subs=steps, numticks=MOST_TICKS))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(LogLocator(subs=range(2, 10), numticks=MOST_MINOR_TICKS))
    axes.xaxis.set_minor_formatter(NullFormatter())


class Learning(ReportFigure):
    """See the module."""

    summary = "validation error of each network during its training"
    section = "training"

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        return learning_figure(contents.metrics) if contents.metrics else None

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        return "Error of the free run over whole validation missions during training."


def learning_figure(metrics: Sequence[Mapping[str, Any]]) -> Figure:
    """Validation error against time of each network."""
    with style.styled():
        figure = style.new_figure(style.COLUMN_WIDTH * 1.25, 2.6)
        axes = figure.add_subplot()
        for name in dict.fromkeys(row["network"] for row in metrics):
            rows = [row for row in metrics if row["network"] == name]
            key = "train_mse" if rows[0]["validation_mse"] is None else "validation_mse"
            colour = style.ESTIMATE if name.startswith("surge") else style.TRUTH
            label = name.removesuffix("-0")
            member = not name.endswith("-0")
            axes.plot(
                [row["seconds"] for row in rows],
                [row[key] for row in rows],
                color=colour,
                alpha=0.5 if member else 1.0,
                label=None if member else label,
            )
        axes.set_yscale("log")
        axes.set_xlabel("time in training [s]")
        axes.set_ylabel("validation MSE [(m/s)²]")
        axes.legend()
    return figure
