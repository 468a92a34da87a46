"""Dives: errors over ground between GPS fixes by method."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from learn.evaluation.evaluation import Evaluation
from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from learn.report.figures.dots import dots, explain, plain_decades
from learn.report.names import KNOWLEDGE_TITLES, colour_of, title_of
from twin.navigation.dead_reckoning import Array
from twin.navigation.dives import KNOWLEDGE
from twin.plot import style

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
