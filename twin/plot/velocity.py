"""Velocity: surge, sway and heave through the water, and the speed over ground."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from twin.plot import style
from twin.plot.dates import label_time
from twin.plot.registry import FigureKind
from twin.plot.signals import draw_lines, stack, thinned_time
from twin.records.logged_trajectory import source_of
from twin.records.trajectory import Trajectory


def velocity_figure(trajectory: Trajectory) -> Figure:
    """Surge, sway and heave through the water, and the speed over ground."""
    with style.styled():
        figure, axes = stack(4, height=0.95)
        for panel, (name, title) in zip(
            axes,
            (("surge", "surge"), ("sway", "sway (starboard)"), ("heave", "heave (down)")),
            strict=False,
        ):
            draw_lines(panel, trajectory, [(f"true_{name}", name, style.TRUTH)])
            word = source_of(trajectory, f"true_{name}", "through the water")
            panel.set_title(f"{title}, {word}")
            panel.set_ylabel("[m/s]")
            style.pad_limits(panel, least=0.01)
        over_ground = np.hypot(trajectory["true_velocity_north"], trajectory["true_velocity_east"])
        time, seconds, unit = thinned_time(trajectory)
        (speed,) = style.thin(over_ground)
        axes[-1].plot(time / seconds, speed, color=style.PALETTE["green"])
        track = source_of(trajectory, "true_velocity_north", "")
        axes[-1].set_title(
            f"speed over ground, {track}" if track else "horizontal speed over ground"
        )
        axes[-1].set_ylabel("[m/s]")
        label_time(axes[-1], trajectory, seconds, unit)
        figure.align_ylabels()
    return figure


FIGURE = FigureKind(
    name="velocity", summary="surge, sway, heave and the speed over ground", draw=velocity_figure
)
