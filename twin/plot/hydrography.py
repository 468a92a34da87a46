"""Hydrography: temperature and salinity as sections, depth down, over time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.plot import style
from twin.plot.dates import label_time
from twin.plot.ocean_maps import ocean_map
from twin.plot.registry import FigureKind
from twin.plot.water import Water, water_of
from twin.records.trajectory import Trajectory

Array = NDArray[np.float64]

PANELS = (("temperature", "[°C]"), ("salinity", "[PSS-78]"))
MOST_POINTS = 12_000
PANEL_HEIGHT = 1.75
"""[in]"""
WIDTH = 5.4
"""[in]"""
NARROW, WIDE = 2.0, 4.5
"""[point] sides of the dots: as wide as a section of few profiles leaves room for"""
COVERED = 1.0, 99.0
"""Percentiles that the colours cover"""


def hydrography_figure(trajectory: Trajectory) -> Figure:
    """Temperature and salinity over time and depth.

    Raises:
      InputError: the mission has neither.
    """
    seconds, unit = style.time_unit(trajectory.time)
    figure = draw_sections(trajectory, trajectory.time / seconds, "")
    label_time(figure.axes[len(PANELS) - 1], trajectory, seconds, unit)
    return figure


def draw_sections(trajectory: Trajectory, along: Array, label: str) -> Figure:
    """Temperature and salinity over `along` (time,) and depth; `label` names its axis.

    Raises:
      InputError: the mission has neither.
    """
    water = water_of(trajectory)
    depth = trajectory["true_depth" if "true_depth" in trajectory else "measured_depth"]
    with style.styled():
        figure = style.new_figure(WIDTH, 0.4 + PANEL_HEIGHT * len(PANELS))
        panels = figure.subplots(len(PANELS), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (quantity, unit) in zip(panels, PANELS, strict=True):
            _draw(axes, along, depth, water, quantity, unit)
        panels[-1].set_xlabel(label)
    return figure


def _draw(axes: Axes, along: Array, depth: Array, water: Water, quantity: str, unit: str) -> None:
    values = getattr(water, quantity)
    axes.plot(*style.thin(along, depth), color=style.GUIDE, lw=0.4, zorder=1)
    x, y, shown = style.thin(along, depth, values, most=MOST_POINTS)
    known = np.isfinite(shown) & np.isfinite(y)
    y = np.maximum(y, 0.0)  # waves and a transducer's zero lift a vehicle above the surface
    room = 72.0 * 0.8 * WIDTH / max(profiles(depth), 1)
    low, high = (float(v) for v in np.percentile(shown[known], COVERED))
    dots = axes.scatter(
        x[known], y[known], c=shown[known], s=float(np.clip(0.8 * room, NARROW, WIDE)) ** 2,
        marker="s", linewidths=0, cmap=ocean_map(quantity), vmin=low, vmax=max(high, low + 1e-3),
        zorder=2, rasterized=True,
    )  # fmt: skip
    axes.set_xlim(float(np.nanmin(along)), float(np.nanmax(along)))
    style.depth_axis(axes, float(np.nanmax(depth)))
    axes.set_title(f"{quantity} ({water.words[quantity]})")
    bar = axes.figure.colorbar(dots, ax=axes, pad=0.015, aspect=18)
    bar.set_label(f"{quantity} {unit}")
    bar.outline.set_visible(False)


def profiles(depth: Array) -> int:
    """How often a vehicle passed half of its greatest depth: its profiles."""
    known = depth[np.isfinite(depth)]
    if not known.size:
        return 0
    return int(np.abs(np.diff((known > 0.5 * known.max()).astype(int))).sum())


FIGURE = FigureKind(
    name="hydrography",
    summary="temperature and salinity over time and depth",
    draw=hydrography_figure,
)
