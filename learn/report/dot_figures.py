"""Dot figures: errors by method, with a dot for each mission or dive and a bar for the median."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from learn.evaluation.evaluation import Evaluation
from learn.report.contents import KNOWLEDGE_TITLES, colour_of, title_of
from twin.navigation.dead_reckoning import KNOWLEDGE, Array
from twin.show import style

FEW_DECADES = 2.0
"""A logarithmic axis over fewer decades also has labels at 2 and 5 times powers of ten."""
MOST_TICKS = 6
MOST_MINOR_TICKS = 60
LEAST_PERCENT = 1e-4
"""[%] Lower bound of errors on logarithmic axes: a metre in a thousand kilometres."""
GOLDEN = 0.6180339887
"""Fractional part of the golden ratio, whose multiples spread evenly."""
LABEL_SIZE = 8.0
"""[pt] Font size of a figure's common axis label."""


def distribution_figure(evaluation: Evaluation) -> Figure:
    """Draw dead-reckoning errors through the water, a dot per mission, on a logarithmic axis."""
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


def dive_figure(evaluation: Evaluation) -> Figure | None:
    """Draw errors over ground at the end of dives, a panel per current; None without dives.

    Panels without any value are left out. A track corrected afterwards ends at the fix, so its
    panel has the largest error along the dive. Logs have no such panel: the truth between fixes is
    unknown.
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


def explain(figure: Figure, dots: str, notes: Sequence[str]) -> None:
    """Draw a legend of dots and bars above the axes, with notes on missing methods."""
    dot = Line2D([], [], marker="o", ms=3.2, ls="none", color=style.GUIDE, label=dots)
    bar = Line2D([], [], marker="|", ms=9, mew=2.2, ls="none", color=style.GUIDE, label="median")
    blank = [Line2D([], [], ls="none", label=note) for note in notes]
    figure.legend(handles=[dot, bar, *blank], loc="outside upper left", ncols=3)


def dots(axes: Axes, row: int, values: Array, colour: str) -> None:
    """Draw a dot per value and a bar at the median; vertical jitter keeps equal values visible."""
    values = np.maximum(values[np.isfinite(values)], LEAST_PERCENT)
    jitter = 0.22 * (np.mod(np.arange(len(values)) * GOLDEN, 1.0) - 0.5)
    axes.plot(values, row + jitter, "o", ms=3.2, color=colour, alpha=0.55, mew=0)
    median = float(np.median(values))
    axes.plot([median, median], [row - 0.3, row + 0.3], color=colour, lw=2.2)


def plain_decades(axes: Axes) -> None:
    """Make the x axis logarithmic, with a few labels written as plain numbers: 2, 5, 10, 20."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    decades = np.log10(high / low)
    steps = (1.0, 2.0, 5.0) if decades < FEW_DECADES else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(subs=steps, numticks=MOST_TICKS))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(LogLocator(subs=range(2, 10), numticks=MOST_MINOR_TICKS))
    axes.xaxis.set_minor_formatter(NullFormatter())
