"""Temperature-salinity diagram: the waters that a mission met, with lines of equal density."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.plot import style
from twin.plot.ocean_maps import ocean_map
from twin.plot.registry import FigureKind
from twin.plot.water import absolute, water_of
from twin.records.trajectory import Trajectory

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
            s,
            t,
            c=d,
            s=3.0,
            cmap=ocean_map("depth"),
            linewidths=0,
            rasterized=True,
            zorder=3,
            vmin=0.0,
            vmax=max(float(d.max()), 1.0),
        )
        axes.set_xlim(*limits[0])
        axes.set_ylim(*limits[1])
        said = water.words["salinity"]
        axes.set_xlabel(f"{name} ({said}) [g/kg]")
        axes.set_ylabel(f"conservative temperature ({water.words['temperature']}) [°C]")
        axes.set_title("grey: density, σ₀ [kg/m³]", fontweight="normal", fontsize=7.5)
        bar = figure.colorbar(dots, ax=axes, pad=0.02, aspect=25)
        bar.set_label("depth [m]")
        bar.ax.invert_yaxis()
        bar.outline.set_visible(False)
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
