"""Distribution: dead-reckoning errors of all missions by method."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from learn.evaluation.evaluation import Evaluation
from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from learn.report.figures.dots import dots, explain, plain_decades
from learn.report.names import colour_of, title_of
from twin.plot import style


class Distribution(ReportFigure):
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
