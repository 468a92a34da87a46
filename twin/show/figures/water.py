"""Water figures: current against depth, temperature and salinity as sections and as T-S diagram.

The diagram has lines of equal density. Each quantity has a colour map; maps of water properties are
cmocean's.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import InputError
from twin.records.coordinates import START_LATITUDE, START_LONGITUDE
from twin.records.logged import AVERAGED, LoggedTrajectory, source_of
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.figures.base import FigureKind

Array = NDArray[np.float64]
NOMINAL_LATITUDE = 45.0  # [degree] latitude for the pressure of a mission without a place
MOST_BINS, BIN_LEAST = 40, 1.0  # most depth bins of the mean profile, and least height [m] of a bin
MOST_POINTS = 12_000
LEAST_SPAN, MARGIN = (0.05, 0.5), 0.07
"""LEAST_SPAN: [g/kg], [degree_Celsius] smallest spans of the axes, so that noise stays small.
MARGIN: margin relative to the span"""
GRID = 80
LEVELS, MOST_LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0), 9
"""LEVELS: [kg/m3] steps between lines of density. MOST_LEVELS: maximum number of lines"""
COVERED = 0.05, 99.95  # percentiles that the axes cover: single spikes of a CTD lie outside
PANELS = (("temperature", "[°C]"), ("salinity", "[PSS-78]"))
PANEL_HEIGHT, WIDTH = 1.75, 5.4  # [in]
NARROW, WIDE = 2.0, 4.5
"""[point] Smallest and largest side of the dots. A section of few profiles has wider dots."""
UNEXPLAINED = 0.5
"""[1] Largest fraction of a current's variance beside its mean profile in a figure over depth"""
SHOWN_PERCENTILES = 1.0, 99.0  # percentiles that the colours cover


class Water(NamedTuple):
    """Water along the track; signals have shape (time,) and NaN where unknown."""

    temperature: Array  # [degree_Celsius] in situ
    salinity: Array  # practical
    words: dict[str, str]  # sources of temperature and salinity: true, measured, corrected


def water_of(trajectory: Trajectory) -> Water:
    """Temperature and salinity of a mission: true signals, or else those of the CTD.

    Raises:
      InputError: the mission has no temperature and salinity.
    """
    quantities = ("temperature", "salinity")
    for kind in ("true", "measured"):
        names = [f"{kind}_{quantity}" for quantity in quantities]
        there = [trajectory.signals.get(name) for name in names]
        if all(values is not None and np.isfinite(values).any() for values in there):
            words = [source_of(trajectory, name, kind) for name in names]
            temperature, salinity = (np.asarray(values, float) for values in there)
            return Water(temperature, salinity, dict(zip(quantities, words, strict=True)))
    raise InputError(
        "this mission has no temperature and salinity: a log has them from its CTD, a simulated "
        "mission in water that has both (`--density` names such water)"
    )


def absolute(trajectory: Trajectory, water: Water) -> tuple[Array, Array, str]:
    """Absolute salinity [g/kg] and conservative temperature [degree_Celsius], TEOS-10, and the
    salinity's name. Without a place on Earth the salinity is the reference salinity.
    """
    import gsw

    about = trajectory.provenance
    known = START_LATITUDE in about
    latitude = float(about[START_LATITUDE]) if known else NOMINAL_LATITUDE
    longitude = float(about[START_LONGITUDE]) if known else 0.0
    pressure = np.maximum(
        np.asarray(gsw.p_from_z(-np.maximum(_depth(trajectory), 0.0), latitude)), 0.0
    )
    if known:
        salinity = np.asarray(gsw.SA_from_SP(water.salinity, pressure, longitude, latitude))
    else:
        salinity = np.asarray(gsw.SR_from_SP(water.salinity))
    conservative = np.asarray(gsw.CT_from_t(salinity, water.temperature, pressure))
    return salinity, conservative, "absolute salinity" if known else "reference salinity"


def _depth(trajectory: Trajectory) -> Array:
    return trajectory["true_depth" if "true_depth" in trajectory else "measured_depth"]


def mean_profile(depth: Array, *values: Array) -> tuple[Array, tuple[Array, ...]]:
    """Means of `values` in equal depth bins, without empty bins and samples with a NaN.

    Returns the bins' centres [m], shape (n,), and the means, each (n,).
    """
    known = np.isfinite([depth, *values]).all(axis=0)
    depth, values = depth[known], tuple(v[known] for v in values)
    deepest = max(float(depth.max(initial=0.0)), BIN_LEAST)
    count = int(np.clip(deepest / BIN_LEAST, 1, MOST_BINS))
    edges = np.linspace(0.0, deepest, count + 1)
    index = np.clip(np.digitize(depth, edges) - 1, 0, count - 1)
    samples = np.bincount(index, minlength=count)
    full = samples > 0
    sums = [np.bincount(index, weights=v, minlength=count)[full] for v in values]
    centres = (edges[:-1] + edges[1:]) / 2
    return centres[full], tuple(one / samples[full] for one in sums)


def current_figure(trajectory: Trajectory) -> Figure:
    """Draw north and east current against depth: samples faint, the mean of each depth bold."""
    with style.styled():
        figure = style.new_figure(height=3.2)
        draw_current(figure.add_subplot(), trajectory)
    return figure


def draw_current(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the current's profile into `axes`."""
    if isinstance(trajectory, LoggedTrajectory) and "true_current_north" not in trajectory:
        raise InputError(
            "this log has no current: two fixes about a dive give its depth-averaged one, a "
            "profiler that of each depth"
        )
    depth = trajectory["true_depth"]
    word = source_of(trajectory, "true_current_north", "current")
    colours = {"north": style.PALETTE["blue"], "east": style.PALETTE["vermillion"]}
    components = [trajectory[f"true_current_{name}"] for name in colours]
    centres, means = mean_profile(depth, *components)
    for (name, colour), component, mean in zip(colours.items(), components, means, strict=True):
        values, where = style.thin(component, depth, most=3000)
        if word == AVERAGED:  # one value for each dive gives no profile
            axes.plot(values, where, ".", ms=2.0, color=colour, label=f"{name}ward")
        else:
            axes.plot(values, where, ".", ms=1.5, color=colour, alpha=0.15, rasterized=True)
            axes.plot(mean, centres, color=colour, lw=1.8, label=f"{name}ward")
    axes.axvline(0.0, color=style.GUIDE, lw=0.7, zorder=1)
    style.depth_axis(axes, float(np.nanmax(depth)))
    style.pad_limits(axes, least=0.05, which="x")
    axes.set_xlabel(f"{word} [m/s]")
    axes.legend(loc="best")


def draw_met_current(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the current against depth, or over time where it changes less with depth than sideways.

    Against depth, a current that changes along the track is a zigzag of dive after dive.
    """
    word = source_of(trajectory, "true_current_north", "current")
    components = np.stack([trajectory[f"true_current_{name}"] for name in ("north", "east")])
    depth = trajectory["true_depth"]
    centres, means = mean_profile(depth, *components)
    known = np.isfinite([depth, *components]).all(axis=0)
    left = components - [np.interp(depth, centres, mean) for mean in means]
    varies, remains = (one[:, known].var(axis=1).sum() for one in (components, left))
    if word == AVERAGED or not known.any() or remains <= UNEXPLAINED * varies:
        draw_current(axes, trajectory)
        return
    seconds, unit = style.time_unit(trajectory.time)
    for name, colour, component in zip(("north", "east"), ("blue", "vermillion"), components,
                                       strict=True):  # fmt: skip
        time, values = style.thin(trajectory.time / seconds, component)
        axes.plot(time, values, color=style.PALETTE[colour], lw=1.2, label=f"{name}ward")
    axes.axhline(0.0, color=style.GUIDE, lw=0.7, zorder=1)
    style.pad_limits(axes, least=0.05)
    style.label_mission_time(axes, trajectory, seconds, unit)
    axes.set_ylabel(f"{word} [m/s]")
    axes.legend(loc="best")


CURRENT = FigureKind(name="current", summary="the current against depth", draw=current_figure)


OCEAN_MAPS = {
    "temperature": "thermal",
    "salinity": "haline",
    "density": "dense",
    "current": "speed",
    "depth": "deep",
    "vertical_velocity": "balance",
}
"""cmocean's map of each quantity; `balance` is for signed quantities and symmetric limits"""


def ocean_map(quantity: str) -> Colormap | str:
    """Colour map of a quantity: cmocean's if it is in `OCEAN_MAPS`, else the general map."""
    if quantity not in OCEAN_MAPS:
        return style.SEQUENTIAL_MAP
    with warnings.catch_warnings():
        # cmocean 4.0.3 uses an argument that matplotlib 3.13 removes
        warnings.filterwarnings("ignore", "Passing 'N' to ListedColormap")
        from cmocean import cm
    found: Colormap = getattr(cm, OCEAN_MAPS[quantity])
    return found


def ts_figure(trajectory: Trajectory) -> Figure:
    """Draw conservative temperature over absolute salinity, coloured by depth, and sigma0 lines.

    Raises:
      InputError: the mission has no temperature and salinity.
    """
    import gsw

    water = water_of(trajectory)
    salinity, temperature, name = absolute(trajectory, water)
    values = np.stack([salinity, temperature, _depth(trajectory)])
    s, t, d = style.thin(*values[:, np.isfinite(values).all(axis=0)], most=MOST_POINTS)
    with style.styled():
        figure = style.new_figure(width=4.2, height=3.6)
        axes = figure.add_subplot()
        axes.grid(visible=False)
        limits = []
        for shown, least in zip((s, t), LEAST_SPAN, strict=True):
            low, high = (float(v) for v in np.percentile(shown, COVERED))
            reach = (0.5 + MARGIN) * max(high - low, least)
            limits.append((0.5 * (low + high) - reach, 0.5 * (low + high) + reach))
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


DIAGRAM = FigureKind(
    "ts", "temperature-salinity diagram with lines of density, coloured by depth", ts_figure
)


def hydrography_figure(trajectory: Trajectory) -> Figure:
    """Draw temperature and salinity over time and depth.

    Raises:
      InputError: the mission has no temperature and salinity.
    """
    seconds, unit = style.time_unit(trajectory.time)
    figure = draw_sections(trajectory, trajectory.time / seconds, "")
    style.label_mission_time(figure.axes[len(PANELS) - 1], trajectory, seconds, unit)
    return figure


def draw_sections(trajectory: Trajectory, along: Array, label: str) -> Figure:
    """Draw temperature and salinity over `along` (time,) and depth; `label` is the x axis's.

    Raises:
      InputError: the mission has no temperature and salinity.
    """
    water, depth = water_of(trajectory), _depth(trajectory)
    known = depth[np.isfinite(depth)]  # count profiles: each crosses half of the greatest depth
    profiles = int(np.count_nonzero(np.diff(known > 0.5 * known.max(initial=0.0))))
    side = float(np.clip(0.8 * 72.0 * 0.8 * WIDTH / max(profiles, 1), NARROW, WIDE))
    with style.styled():
        figure = style.new_figure(WIDTH, 0.4 + PANEL_HEIGHT * len(PANELS))
        panels = figure.subplots(len(PANELS), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (quantity, unit) in zip(panels, PANELS, strict=True):
            values = getattr(water, quantity)
            axes.plot(*style.thin(along, depth), color=style.GUIDE, lw=0.4, zorder=1)
            x, y, shown = style.thin(along, depth, values, most=MOST_POINTS)
            seen = np.isfinite(shown) & np.isfinite(y)
            y = np.maximum(y, 0.0)  # waves and pressure offsets give depths above the surface
            low, high = (float(v) for v in np.percentile(shown[seen], SHOWN_PERCENTILES))
            dots = axes.scatter(
                x[seen], y[seen], c=shown[seen], s=side**2, marker="s", linewidths=0,
                cmap=ocean_map(quantity), vmin=low, vmax=max(high, low + 1e-3), zorder=2,
                rasterized=True,
            )  # fmt: skip
            axes.set_xlim(float(np.nanmin(along)), float(np.nanmax(along)))
            style.depth_axis(axes, float(np.nanmax(depth)))
            axes.set_title(f"{quantity} ({water.words[quantity]})")
            style.colour_bar(axes, dots, f"{quantity} {unit}", pad=0.015, aspect=18)
        panels[-1].set_xlabel(label)
    return figure


HYDROGRAPHY = FigureKind(
    "hydrography", "temperature and salinity over time and depth", hydrography_figure
)
