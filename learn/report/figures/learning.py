"""Learning: validation error during the training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from twin.plot import style


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
