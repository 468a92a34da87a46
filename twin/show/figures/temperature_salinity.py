"""Temperature and salinity: the diagram of both with lines of equal density, and the hydrography.

The hydrography is both as sections, depth down, over time. Each quantity has a colour map,
cmocean's where the water is shown.
"""

from __future__ import annotations

import warnings

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.dates import label_time
from twin.show.figures.base import FigureKind
from twin.show.figures.water import Water, absolute, water_of

OCEAN_MAPS = {
    "temperature": "thermal",
    "salinity": "haline",
    "density": "dense",
    "current": "speed",
    "depth": "deep",
    "vertical_velocity": "balance",
}
"""cmocean's map of each quantity; `balance` is for signed ones and belongs on symmetric limits"""
OTHER = "cividis"
"""Of what is no property of the water"""


def ocean_map(quantity: str) -> Colormap | str:
    """The colour map of a quantity of `OCEAN_MAPS`, or that of everything else."""
    if quantity not in OCEAN_MAPS:
        return OTHER
    with warnings.catch_warnings():
        # cmocean 4.0.3 hands matplotlib an argument that goes away in 3.13
        warnings.filterwarnings("ignore", "Passing 'N' to ListedColormap")
        from cmocean import cm
    found: Colormap = getattr(cm, OCEAN_MAPS[quantity])
    return found


Array = NDArray[np.float64]

MOST_POINTS = 12_000
LEAST_SPAN = (0.05, 0.5)
"""[g/kg], [degree_Celsius] that the axes have at least, so that noise stays small"""
MARGIN = 0.07
GRID = 80
LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""[kg/m3] between lines of density"""
MOST_LEVELS = 9
COVERED = 0.05, 99.95
"""Percentiles that the axes show: single spikes of a CTD lie outside"""


def ts_figure(trajectory: Trajectory) -> Figure:
    """Conservative temperature over absolute salinity, coloured by depth, with lines of sigma0.

    Raises:
      InputError: the mission has no temperature and salinity.
    """
    import gsw

    water = water_of(trajectory)
    salinity, temperature, name = absolute(trajectory, water)
    depth = trajectory["true_depth" if "true_depth" in trajectory else "measured_depth"]
    known = np.isfinite(salinity) & np.isfinite(temperature) & np.isfinite(depth)
    s, t, d = style.thin(salinity[known], temperature[known], depth[known], most=MOST_POINTS)
    with style.styled():
        figure = style.new_figure(width=4.2, height=3.6)
        axes = figure.add_subplot()
        axes.grid(visible=False)
        limits = [_limits(values, least) for values, least in zip((s, t), LEAST_SPAN, strict=True)]
        grid = np.meshgrid(*(np.linspace(*pair, GRID) for pair in limits))
        sigma = np.asarray(gsw.sigma0(*grid))
        span = float(sigma.max() - sigma.min())
        step = next((one for one in LEVELS if span / one <= MOST_LEVELS), LEVELS[-1])
        levels = np.arange(np.ceil(sigma.min() / step), np.floor(sigma.max() / step) + 1) * step
        if len(levels):
            lines = axes.contour(*grid, sigma, levels=levels, colors=style.GUIDE, linewidths=0.7)
            digits = 2 if step < 0.1 else 1 if step < 1.0 else 0
            axes.clabel(lines, fmt=f"%.{digits}f", fontsize=6.5, inline_spacing=2)
        dots = axes.scatter(
            s, t, c=d, s=3.0, cmap=ocean_map("depth"), linewidths=0, rasterized=True, zorder=3,
            vmin=0.0, vmax=max(float(d.max()), 1.0),
        )  # fmt: skip
        axes.set_xlim(*limits[0])
        axes.set_ylim(*limits[1])
        said = water.words["salinity"]
        axes.set_xlabel(f"{name} ({said}) [g/kg]")
        axes.set_ylabel(f"conservative temperature ({water.words['temperature']}) [°C]")
        axes.set_title("grey: density, σ₀ [kg/m³]", fontweight="normal", fontsize=7.5)
        style.colour_bar(axes, dots, "depth [m]", pad=0.02, aspect=25).ax.invert_yaxis()
    return figure


def _limits(values: Array, least: float) -> tuple[float, float]:
    low, high = (float(v) for v in np.percentile(values, COVERED))
    reach = (0.5 + MARGIN) * max(high - low, least)
    return 0.5 * (low + high) - reach, 0.5 * (low + high) + reach


FIGURE = FigureKind(
    name="ts",
    summary="temperature-salinity diagram with lines of density, coloured by depth",
    draw=ts_figure,
)


PANELS = (("temperature", "[°C]"), ("salinity", "[PSS-78]"))

PANEL_HEIGHT = 1.75
"""[in]"""
WIDTH = 5.4
"""[in]"""
NARROW, WIDE = 2.0, 4.5
"""[point] sides of the dots: as wide as a section of few profiles leaves room for"""
SHOWN_PERCENTILES = 1.0, 99.0
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
    low, high = (float(v) for v in np.percentile(shown[known], SHOWN_PERCENTILES))
    dots = axes.scatter(
        x[known], y[known], c=shown[known], s=float(np.clip(0.8 * room, NARROW, WIDE)) ** 2,
        marker="s", linewidths=0, cmap=ocean_map(quantity), vmin=low, vmax=max(high, low + 1e-3),
        zorder=2, rasterized=True,
    )  # fmt: skip
    axes.set_xlim(float(np.nanmin(along)), float(np.nanmax(along)))
    style.depth_axis(axes, float(np.nanmax(depth)))
    axes.set_title(f"{quantity} ({water.words[quantity]})")
    style.colour_bar(axes, dots, f"{quantity} {unit}", pad=0.015, aspect=18)


def profiles(depth: Array) -> int:
    """How often a vehicle passed half of its greatest depth: its profiles."""
    known = depth[np.isfinite(depth)]
    if not known.size:
        return 0
    return int(np.abs(np.diff((known > 0.5 * known.max()).astype(int))).sum())


HYDROGRAPHY = FigureKind(
    name="hydrography",
    summary="temperature and salinity over time and depth",
    draw=hydrography_figure,
)
