"""Actuator: command and position of every moving part, attitude and its setpoints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin.plot import style
from twin.plot.dates import label_time
from twin.plot.registry import FigureKind
from twin.plot.signals import draw_lines, stack, thinned_time, unit_text
from twin.records.logged_trajectory import source_of
from twin.records.schema import variable
from twin.records.trajectory import Trajectory

MILLIMETRES = 1000.0
"""[mm/m] parts slide by millimetres"""
ABOVE_TITLE = 1.2
"""Of the first axes' height, where in a narrow figure title and legend have no room side by side"""
ATTITUDE = ("pitch", "heading")


def actuator_figure(trajectory: Trajectory) -> Figure:
    """Command and position of every part of the vehicle, attitude and its setpoints."""
    parts = len(trajectory.actuators)
    with style.styled():
        figure, axes = stack(parts + len(ATTITUDE), height=0.92)
        draw_actuators(axes[:parts], trajectory, legend_at=ABOVE_TITLE)
        draw_attitude(axes[parts:], trajectory)
        label_time(axes[-1], trajectory, *thinned_time(trajectory)[1:])
        figure.align_ylabels()
    return figure


def draw_actuators(axes: Sequence[Axes], trajectory: Trajectory, legend_at: float = 0.98) -> None:
    """Command and true position of each of the trajectory's parts into one axes each.

    Args:
      legend_at: lower edge of the legend over the height of the first axes.
    """
    for panel, part in zip(axes, trajectory.actuators, strict=True):
        position = variable(f"true_{part}")
        slides = position.units == "m"
        word = source_of(trajectory, f"true_{part}", "")
        entries = [
            (f"commanded_{part}", "command", style.COMMAND),
            (f"true_{part}", word or "position", style.TRUTH),
        ]
        present = [entry for entry in entries if entry[0] in trajectory]  # logs lack some commands
        draw_lines(panel, trajectory, present, factor=MILLIMETRES if slides else 1.0)
        panel.set_title(position.long_name.partition(",")[0])
        panel.set_ylabel("[mm]" if slides else unit_text(position.units))
    if len(axes):
        axes[0].legend(
            loc="lower right", bbox_to_anchor=(1.0, legend_at), ncols=2, borderaxespad=0.1,
            columnspacing=1.0,
        )  # fmt: skip


def draw_attitude(axes: Sequence[Axes], trajectory: Trajectory) -> None:
    """Pitch and heading with their setpoints into two axes."""
    for panel, name in zip(axes, ATTITUDE, strict=True):
        entries = [(f"true_{name}", name, style.TRUTH)]
        setpoint = trajectory.signals.get(f"commanded_{name}")
        if setpoint is not None and np.isfinite(setpoint).any():
            entries.insert(0, (f"commanded_{name}", "setpoint", style.COMMAND))
        draw_lines(panel, trajectory, entries, unwrap=name == "heading")
        word = source_of(trajectory, f"true_{name}", "")
        panel.set_title(
            f"{word} {name}".strip() + (" and its setpoint" if len(entries) > 1 else "")
        )
        panel.set_ylabel("[°]")
        style.pad_limits(panel, least=2.0)


FIGURE = FigureKind(
    name="actuator",
    summary="commands and positions of the vehicle's parts, attitude and its setpoints",
    draw=actuator_figure,
)
