"""Water: a mission's temperature, salinity and current profile, for the figures that show them.

The profile is the current at the depths that the glider passed.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import InputError
from twin.records.coordinates import START_LATITUDE, START_LONGITUDE
from twin.records.logged import AVERAGED, LoggedTrajectory, source_of
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.figures.base import FigureKind

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Water:
    """What the water was along the way, each (time,), NaN where it is not known."""

    temperature: Array
    """[degree_Celsius] in situ"""
    salinity: Array
    """practical"""
    words: dict[str, str]
    """What temperature and salinity are: true, measured, or corrected"""


def water_of(trajectory: Trajectory) -> Water:
    """The temperature and salinity of a mission: the true ones, or those of its CTD.

    Raises:
      InputError: it has neither.
    """
    for kind, default in (("true", "true"), ("measured", "measured")):
        names = [f"{kind}_{quantity}" for quantity in ("temperature", "salinity")]
        there = [trajectory.signals.get(name) for name in names]
        if all(values is not None and np.isfinite(values).any() for values in there):
            temperature, salinity = (np.asarray(values, float) for values in there)
            words = {
                name.removeprefix(f"{kind}_"): source_of(trajectory, name, default)
                for name in names
            }
            return Water(temperature=temperature, salinity=salinity, words=words)
    raise InputError(
        "this mission has no temperature and salinity: a log has them from its CTD, a simulated "
        "mission in water that has both (`--density` names such water)"
    )


def absolute(trajectory: Trajectory, water: Water) -> tuple[Array, Array, str]:
    """Absolute salinity [g/kg] and conservative temperature [degree_Celsius], TEOS-10, and the
    salinity's name; without a place on Earth it is the reference salinity, of standard seawater.
    """
    import gsw

    depth = trajectory["true_depth" if "true_depth" in trajectory else "measured_depth"]
    about = trajectory.provenance
    known = START_LATITUDE in about
    latitude = float(about[START_LATITUDE]) if known else NOMINAL_LATITUDE
    longitude = float(about[START_LONGITUDE]) if known else 0.0
    pressure = np.maximum(np.asarray(gsw.p_from_z(-np.maximum(depth, 0.0), latitude)), 0.0)
    if known:
        salinity = np.asarray(gsw.SA_from_SP(water.salinity, pressure, longitude, latitude))
    else:
        salinity = np.asarray(gsw.SR_from_SP(water.salinity))
    conservative = np.asarray(gsw.CT_from_t(salinity, water.temperature, pressure))
    return salinity, conservative, "absolute salinity" if known else "reference salinity"


NOMINAL_LATITUDE = 45.0
"""[degree] for the pressure of a mission without a place"""


MOST_BINS = 40
"""Depth bins of the mean profile; at least BIN_LEAST metres each."""
BIN_LEAST = 1.0
"""[m]"""


def mean_profile(
    depth: Array, *values: Array, bins: int = MOST_BINS
) -> tuple[Array, tuple[Array, ...]]:
    """Means of `values` in equal depth bins; empty bins are left out, and samples without a value.

    Returns the bins' centres [m], shape (n,), and the means, each (n,).
    """
    known = np.isfinite([depth, *values]).all(axis=0)
    depth, values = depth[known], tuple(v[known] for v in values)
    deepest = max(float(depth.max(initial=0.0)), BIN_LEAST)
    count = int(np.clip(deepest / BIN_LEAST, 1, bins))
    edges = np.linspace(0.0, deepest, count + 1)
    index = np.clip(np.digitize(depth, edges) - 1, 0, count - 1)
    samples = np.bincount(index, minlength=count)
    full = samples > 0
    centres = (edges[:-1] + edges[1:]) / 2
    means = tuple(
        np.bincount(index, weights=v, minlength=count)[full] / samples[full] for v in values
    )
    return centres[full], means


def current_figure(trajectory: Trajectory) -> Figure:
    """North and east current against depth: every sample faint, the mean of each depth bold."""
    with style.styled():
        figure = style.new_figure(height=3.2)
        draw_current(figure.add_subplot(), trajectory)
    return figure


def draw_current(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the profile into `axes`."""
    if isinstance(trajectory, LoggedTrajectory) and "true_current_north" not in trajectory:
        raise InputError(
            "this log has no current: two fixes about a dive give its depth-averaged one, a "
            "profiler that of each depth"
        )
    depth = trajectory["true_depth"]
    word = source_of(trajectory, "true_current_north", "current")
    components = (
        ("true_current_north", "north", style.PALETTE["blue"]),
        ("true_current_east", "east", style.PALETTE["vermillion"]),
    )
    centres, means = mean_profile(depth, *(trajectory[name] for name, _, _ in components))
    for (name, label, colour), mean in zip(components, means, strict=True):
        values, where = style.thin(trajectory[name], depth, most=3000)
        if word == AVERAGED:  # one number of each dive is no profile
            axes.plot(values, where, ".", ms=2.0, color=colour, label=f"{label}ward")
            continue
        axes.plot(values, where, ".", ms=1.5, color=colour, alpha=0.15, rasterized=True)
        axes.plot(mean, centres, color=colour, lw=1.8, label=f"{label}ward")
    axes.axvline(0.0, color=style.GUIDE, lw=0.7, zorder=1)
    style.depth_axis(axes, float(np.nanmax(depth)))
    style.pad_limits(axes, least=0.05, which="x")
    axes.set_xlabel(f"{word} [m/s]")
    axes.legend(loc="best")


FIGURE = FigureKind(name="current", summary="the current against depth", draw=current_figure)
