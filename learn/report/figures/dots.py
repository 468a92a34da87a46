"""Dots: every mission or dive a dot, the median a bar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from twin.navigation.dead_reckoning import Array
from twin.plot import style

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
