"""Log: what a vehicle at sea measured during one dive, for stores without simulated truth."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin.plot import style
from twin.plot.signals import PANEL_HEIGHT, draw_lines, thinned_time
from twin.trajectory import Trajectory

PANELS = (
    (("measured_pitch", "measured_roll"), "attitude", "[°]", False),
    (("measured_heading",), "heading from true north", "[°]", True),
    (("measured_pump",), "pumped volume", "[cm³]", False),
    (("measured_density",), "density", "[kg/m³]", False),
    (("true_speed",), "speed through the water (DVL or ADCP)", "[m/s]", False),
)
"""Signals, title, unit, and whether it is on a circle; panels without a signal are left out."""
PHASE_COLOURS = {
    0.0: ("surface", style.GUIDE),
    1.0: ("descent", style.PALETTE["blue"]),
    2.0: ("climb", style.PALETTE["vermillion"]),
    3.0: ("inflection or level", style.PALETTE["black"]),
}
"""Flag of `measured_phase`: name and colour."""


def log_figure(trajectory: Trajectory) -> Figure:
    """Depth by phase, attitude, heading, pump, density and measured speed of one row."""
    shown = []
    for wanted, title, unit, unwrap in PANELS:
        names = [name for name in wanted if name in trajectory.signals]
        if names:
            shown.append((names, title, unit, unwrap))
    with style.styled():
        count = 1 + len(shown)
        figure = style.new_figure(style.PAGE_WIDTH, 0.45 + PANEL_HEIGHT * count)
        axes = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
        _depth(axes[0], trajectory)
        for panel, (names, title, unit, unwrap) in zip(axes[1:], shown, strict=True):
            colours = (style.TRUTH, style.ESTIMATE)
            entries = [
                (name, name.split("_", 1)[1], colour)
                for name, colour in zip(names, colours, strict=False)
            ]
            draw_lines(panel, trajectory, entries, unwrap=unwrap)
            if len(entries) > 1:
                panel.legend(loc="upper right", ncols=2)
            panel.set_title(title)
            panel.set_ylabel(unit)
        style.label_time(axes[-1], thinned_time(trajectory)[2])
        figure.align_ylabels()
    return figure


def _depth(axes: Axes, trajectory: Trajectory) -> None:
    time, seconds, _ = thinned_time(trajectory)
    (depth,) = style.thin(trajectory["measured_depth"])
    phase = trajectory.signals.get("measured_phase")
    axes.plot(time / seconds, depth, color=style.GUIDE, linewidth=0.6)
    if phase is not None:
        (flags,) = style.thin(phase)
        for flag, (name, colour) in PHASE_COLOURS.items():
            there = flags == flag
            if there.any():
                axes.plot(time / seconds, np.where(there, depth, np.nan), color=colour, label=name)
        axes.legend(loc="upper right", bbox_to_anchor=(1.0, 1.35), ncols=len(PHASE_COLOURS))
    axes.invert_yaxis()
    axes.set_title("depth")
    axes.set_ylabel("[m]")
