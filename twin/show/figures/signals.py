"""Signals against time: what the figures of velocities, parts, attitude and logs share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MultipleLocator
from numpy.typing import NDArray

from twin.records.trajectory import Trajectory
from twin.show import style

Array = NDArray[np.float64]

STACK_HEIGHT = 1.0
"""[in] of one panel in a stack that shares its time axis"""


def stack(panels: int, *, height: float = STACK_HEIGHT) -> tuple[Figure, list[Axes]]:
    """A column of panels that share the time axis; call it inside `style.styled()`."""
    figure = style.new_figure(height=0.45 + height * panels)
    axes = figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0]
    return figure, list(axes)


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


UNIT_TEXT = {
    "degree": "°", "m s-1": "m/s", "m s-2": "m/s²", "rad s-1": "rad/s", "cm3": "cm³",
    "kg m-3": "kg/m³", "degree_Celsius": "°C",
}  # fmt: skip
"""How figures write the schema's units."""


def unit_text(units: str) -> str:
    """A unit of the schema as figures write it, in brackets."""
    return f"[{UNIT_TEXT.get(units, units)}]"
