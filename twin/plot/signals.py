"""Signals against time: velocities, actuators, attitude and its setpoints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MultipleLocator
from numpy.typing import NDArray

from twin.plot import style
from twin.records.trajectory import Trajectory

Array = NDArray[np.float64]

PANEL_HEIGHT = 1.0
"""[in] of one panel in a stack that shares its time axis"""


def stack(panels: int, *, height: float = PANEL_HEIGHT) -> tuple[Figure, list[Axes]]:
    """A column of panels that share the time axis; call it inside `style.styled()`."""
    figure = style.new_figure(height=0.45 + height * panels)
    axes = figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0]
    return figure, list(axes)


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
            panel.set_title(f"{title}, through the water")
            panel.set_ylabel("[m/s]")
            style.pad_limits(panel, least=0.01)
        over_ground = np.hypot(trajectory["true_velocity_north"], trajectory["true_velocity_east"])
        time, seconds, unit = thinned_time(trajectory)
        (speed,) = style.thin(over_ground)
        axes[-1].plot(time / seconds, speed, color=style.PALETTE["green"])
        axes[-1].set_title("horizontal speed over ground")
        axes[-1].set_ylabel("[m/s]")
        style.label_time(axes[-1], unit)
        figure.align_ylabels()
    return figure


ACTUATORS = (
    ("shift", "battery shift [mm]", 1000.0),
    ("rotation", "battery rotation [°]", 1.0),
    ("pump", "pumped volume [cm³]", 1.0),
)
"""Signal, title and factor from the schema's unit to the shown one."""


def actuator_figure(trajectory: Trajectory) -> Figure:
    """Actuators and control: command and position, attitude and its setpoints."""
    with style.styled():
        figure, axes = stack(5, height=0.92)
        draw_actuators(axes[:3], trajectory)
        draw_attitude(axes[3:], trajectory)
        style.label_time(axes[-1], thinned_time(trajectory)[2])
        figure.align_ylabels()
    return figure


def draw_actuators(axes: Sequence[Axes], trajectory: Trajectory) -> None:
    """Commanded and true shift, rotation and pump into three axes."""
    for panel, (name, title, factor) in zip(axes, ACTUATORS, strict=True):
        draw_lines(
            panel,
            trajectory,
            [
                (f"commanded_{name}", "command", style.COMMAND),
                (f"true_{name}", "position", style.TRUTH),
            ],
            factor=factor,
        )
        label, _, unit = title.partition(" [")
        panel.set_title(label)
        panel.set_ylabel(f"[{unit}")
    _legend_above(axes[0], 2)


def draw_attitude(axes: Sequence[Axes], trajectory: Trajectory) -> None:
    """Pitch and heading with their setpoints into two axes."""
    for panel, name in zip(axes, ("pitch", "heading"), strict=True):
        entries = [(f"true_{name}", name, style.TRUTH)]
        setpoint = trajectory.signals.get(f"commanded_{name}")
        if setpoint is not None and np.isfinite(setpoint).any():
            entries.insert(0, (f"commanded_{name}", "setpoint", style.COMMAND))
        draw_lines(panel, trajectory, entries, unwrap=name == "heading")
        panel.set_title(f"{name}" + (" and its setpoint" if len(entries) > 1 else ""))
        panel.set_ylabel("[°]")
        style.pad_limits(panel, least=2.0)


def draw_lines(
    axes: Axes,
    trajectory: Trajectory,
    entries: Sequence[tuple[str, str, str]],
    *,
    factor: float = 1.0,
    unwrap: bool = False,
) -> None:
    """Signals against time: `entries` are (signal name, label, colour); setpoints are dashed."""
    time, seconds, _ = thinned_time(trajectory)
    centre = circular_mean(trajectory[entries[-1][0]]) if unwrap else 0.0
    for name, label, colour in entries:
        (values,) = style.thin(trajectory[name])
        values = centred_line(values, centre) if unwrap else values
        dashed = name.startswith("commanded_")
        axes.plot(
            time / seconds,
            values * factor,
            color=colour,
            label=label,
            lw=0.9 if dashed else 1.2,
            ls=(0, (4, 2)) if dashed else "-",
            zorder=3 if dashed else 2,
        )
    axes.set_xlim(time[0] / seconds, time[-1] / seconds)
    if unwrap:
        low, high = axes.get_ylim()
        step = next((s for s in HEADING_STEPS if (high - low) / s <= MOST_TICKS), HEADING_STEPS[-1])
        axes.yaxis.set_major_locator(MultipleLocator(step))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value % 360.0:g}"))


HEADING_STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0)
"""[degree] between ticks of a heading"""
MOST_TICKS = 4


def circular_mean(heading: Array) -> float:
    """Mean direction [degree] of the finite values; 0 without any."""
    finite = np.radians(heading[np.isfinite(heading)])
    if not finite.size:
        return 0.0
    return float(np.degrees(np.arctan2(np.sin(finite).mean(), np.cos(finite).mean())))


def centred_line(heading: Array, centre: float) -> Array:
    """Heading [degree] within 180 of `centre`, so that a vehicle that flies north draws one line.

    NaN where it still jumps, on the far side of the centre.
    """
    values = centre + (np.asarray(heading, float) - centre + 180.0) % 360.0 - 180.0
    values[1:][np.abs(np.diff(values)) > 180.0] = np.nan
    return values


def thinned_time(trajectory: Trajectory) -> tuple[Array, float, str]:
    """The time [s] of thinned signals, seconds per shown unit and the unit's name."""
    (time,) = style.thin(trajectory.time)
    seconds, unit = style.time_unit(time)
    return time, seconds, unit


def _legend_above(axes: Axes, columns: int) -> None:
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 0.98),
        ncols=columns,
        borderaxespad=0.1,
        columnspacing=1.0,
    )
