"""Sections: a mission's depth against time in the colours of a signal, and transects.

A transect is temperature and salinity, depth down, over the distance along the track.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.records.logged import source_of
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.dates import label_time
from twin.show.figures.base import FigureKind
from twin.show.figures.water import draw_sections, ocean_map, water_of

Array = NDArray[np.float64]


def _speed(trajectory: Trajectory) -> Array:
    return np.asarray(np.linalg.norm(trajectory.v_rel, axis=-1))


def _current(trajectory: Trajectory) -> Array:
    return np.hypot(trajectory["true_current_north"], trajectory["true_current_east"])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Colour:
    """What a section can be coloured by."""

    label: str
    unit: str
    source: str
    """The signal that says, in logs, what it is"""
    values: Callable[[Trajectory], Array]


COLOURS = {
    "speed": Colour(label="speed through water", unit="m/s", source="true_surge", values=_speed),
    "current": Colour(label="current speed", unit="m/s", source="true_current_north",
                      values=_current),
    "density": Colour(label="density", unit="kg/m³", source="true_density",
                      values=lambda t: t["true_density"]),
    "temperature": Colour(label="temperature", unit="°C", source="true_temperature",
                          values=lambda t: water_of(t).temperature),
    "salinity": Colour(label="salinity", unit="PSS-78", source="true_salinity",
                       values=lambda t: water_of(t).salinity),
    "net_mass": Colour(label="net buoyancy mass", unit="kg", source="true_net_mass",
                       values=lambda t: t["true_net_mass"]),
    "pitch": Colour(label="pitch", unit="°", source="true_pitch",
                    values=lambda t: t["true_pitch"]),
}  # fmt: skip
"""What a section can be coloured by, by name"""


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
    chosen = COLOURS[colour]
    word = source_of(trajectory, chosen.source, "")
    time, depth, values = style.thin(
        trajectory.time, trajectory["true_depth"], chosen.values(trajectory), most=6000
    )
    if not np.isfinite(values).any():
        raise InputError(f"this mission has no value of the {chosen.label}: colour by another")
    seconds, unit = style.time_unit(time)
    points = np.column_stack([time / seconds, depth])
    lines = LineCollection(
        list(np.stack([points[:-1], points[1:]], axis=1)), array=values[:-1], linewidths=1.8,
        cmap=ocean_map(colour),
    )  # fmt: skip
    lines.set_capstyle("round")
    low, high = np.nanpercentile(values, [2, 98])
    # Colours that would tell noise apart tell nothing: keep at least 1 % of the value as range.
    span = max(high - low, 0.01 * max(abs(high), abs(low)), 1e-6)
    middle = (low + high) / 2
    lines.set_clim(middle - span / 2, middle + span / 2)
    if word:  # of a log some values may be unknown
        axes.plot(time / seconds, depth, color=style.GUIDE, lw=0.6, zorder=1)
    axes.add_collection(lines)
    axes.set_xlim(time[0] / seconds, time[-1] / seconds)
    deepest = float(np.nanmax(depth))
    if "true_altitude" in trajectory:
        (floor,) = style.thin(trajectory["true_depth"] + trajectory["true_altitude"], most=6000)
        deepest = max(deepest, min(float(floor.max()), FLOOR_IN_SIGHT * deepest))
        ground = np.full_like(floor, 2.0 * max(deepest, float(floor.max())))
        axes.fill_between(time / seconds, floor, ground, color=style.GROUND, lw=0)
    style.depth_axis(axes, deepest)
    label_time(axes, trajectory, seconds, unit)
    label = f"{chosen.label} [{chosen.unit}]" + (f"\n{word}" if word else "")
    style.colour_bar(axes, lines, label, pad=0.02, aspect=22)


FIGURE = FigureKind(
    name="section", summary="depth against time, coloured by speed", draw=section_figure
)


def transect_figure(trajectory: Trajectory) -> Figure:
    """Temperature and salinity over the way along the track and depth.

    Raises:
      InputError: the mission has neither.
    """
    distance = along_track(trajectory)
    metres, unit = style.length_unit(distance)
    word = source_of(trajectory, "true_north", "true track")
    return draw_sections(trajectory, distance / metres, f"distance along the {word} [{unit}]")


def along_track(trajectory: Trajectory) -> Array:
    """Horizontal way over ground [m] up to each sample, (time,); straight over unknown samples."""
    place = np.stack([trajectory["true_north"], trajectory["true_east"]], axis=1)
    known = np.isfinite(place).all(axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(place[known], axis=0).T))])
    return np.interp(trajectory.time, trajectory.time[known], way)


TRANSECT = FigureKind(
    name="transect",
    summary="temperature and salinity over the distance along the track and depth",
    draw=transect_figure,
)
