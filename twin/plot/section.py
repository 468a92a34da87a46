"""Section: depth against time, coloured by another signal."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.plot import style
from twin.plot.registry import FigureKind
from twin.records.trajectory import Trajectory

Array = NDArray[np.float64]


def _speed(trajectory: Trajectory) -> Array:
    return np.asarray(np.linalg.norm(trajectory.v_rel, axis=-1))


def _current(trajectory: Trajectory) -> Array:
    return np.hypot(trajectory["true_current_north"], trajectory["true_current_east"])


COLOURS = {
    "speed": ("speed through water [m/s]", _speed),
    "current": ("current speed [m/s]", _current),
    "density": ("density [kg/m³]", lambda t: t["true_density"]),
    "net_mass": ("net buoyancy mass [kg]", lambda t: t["true_net_mass"]),
    "pitch": ("pitch [°]", lambda t: t["true_pitch"]),
}
"""What a section can be coloured by: label and signal."""


FLOOR_IN_SIGHT = 1.5
"""A sea floor within so many times the deepest point widens the axis to show it"""


def section_figure(trajectory: Trajectory, colour: str = "speed") -> Figure:
    """Depth against time, coloured by one of COLOURS.

    Raises:
      InputError: unknown `colour`.
    """
    with style.styled():
        figure = style.new_figure(height=2.3)
        draw_section(figure.add_subplot(), trajectory, colour)
    return figure


def draw_section(axes: Axes, trajectory: Trajectory, colour: str = "speed") -> None:
    """Draw the section into `axes`, with its colour bar."""
    if colour not in COLOURS:
        raise InputError(unknown_name("section colour", colour, COLOURS))
    label, signal = COLOURS[colour]
    time, depth, values = style.thin(
        trajectory.time, trajectory["true_depth"], signal(trajectory), most=6000
    )
    seconds, unit = style.time_unit(time)
    points = np.column_stack([time / seconds, depth])
    lines = LineCollection(
        list(np.stack([points[:-1], points[1:]], axis=1)), array=values[:-1], linewidths=1.8
    )
    lines.set_capstyle("round")
    low, high = np.nanpercentile(values, [2, 98])
    # Colours that would tell noise apart tell nothing: keep at least 1 % of the value as range.
    span = max(high - low, 0.01 * max(abs(high), abs(low)), 1e-6)
    middle = (low + high) / 2
    lines.set_clim(middle - span / 2, middle + span / 2)
    axes.add_collection(lines)
    axes.set_xlim(time[0] / seconds, time[-1] / seconds)
    deepest = float(np.nanmax(depth))
    if "true_altitude" in trajectory:
        (floor,) = style.thin(trajectory["true_depth"] + trajectory["true_altitude"], most=6000)
        deepest = max(deepest, min(float(floor.max()), FLOOR_IN_SIGHT * deepest))
        ground = np.full_like(floor, 2.0 * max(deepest, float(floor.max())))
        axes.fill_between(time / seconds, floor, ground, color=style.GROUND, lw=0)
    style.depth_axis(axes, deepest)
    style.label_time(axes, unit)
    bar = axes.figure.colorbar(lines, ax=axes, pad=0.02, aspect=22)
    bar.set_label(label)
    bar.outline.set_visible(False)


FIGURE = FigureKind(
    name="section", summary="depth against time, coloured by speed", draw=section_figure
)
