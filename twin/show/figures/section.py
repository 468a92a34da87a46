"""Section (depth against time, coloured by a signal), overview page and transect of a mission.

A transect is temperature and salinity against depth and distance along the track.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.records.logged import source_of
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.figures.base import FigureKind
from twin.show.figures.signals import ATTITUDE, draw_actuators, draw_attitude, thinned_time
from twin.show.figures.track import LEGEND_ROW, draw_legend, draw_track, legend_rows
from twin.show.figures.water import draw_met_current, draw_sections, ocean_map, water_of

Array = NDArray[np.float64]
FLOOR_IN_SIGHT = 1.5
"""Limit of the depth axis, as a multiple of the deepest point; a deeper sea floor is not shown"""
HEIGHTS, PANEL_HEIGHT = (1.9, 2.75), 0.87
"""[in] HEIGHTS: of section and track in an overview. PANEL_HEIGHT: of each signal below them"""
LEGEND_COLUMNS = 4  # columns of the names of dead-reckoned tracks


class Colour(NamedTuple):
    """Quantity that can colour a section."""

    label: str
    unit: str
    source: str  # the signal whose attribute names the quantity's source in logs
    values: Callable[[Trajectory], Array]


COLOURS = {
    "speed": Colour("speed through water", "m/s", "true_surge",
                    lambda t: np.asarray(np.linalg.norm(t.v_rel, axis=-1))),
    "current": Colour("current speed", "m/s", "true_current_north",
                      lambda t: np.hypot(t["true_current_north"], t["true_current_east"])),
    "density": Colour("density", "kg/m³", "true_density", lambda t: t["true_density"]),
    "temperature": Colour("temperature", "°C", "true_temperature",
                          lambda t: water_of(t).temperature),
    "salinity": Colour("salinity", "PSS-78", "true_salinity", lambda t: water_of(t).salinity),
    "net_mass": Colour("net buoyancy mass", "kg", "true_net_mass", lambda t: t["true_net_mass"]),
    "pitch": Colour("pitch", "°", "true_pitch", lambda t: t["true_pitch"]),
}  # fmt: skip
"""Quantities that can colour a section, by name"""


def section_figure(trajectory: Trajectory, colour: str = "speed") -> Figure:
    """Draw depth against time, coloured by one of COLOURS.

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
    # Colours must not resolve noise: keep a range of at least 1 % of the value.
    span = max(high - low, 0.01 * max(abs(high), abs(low)), 1e-6)
    middle = (low + high) / 2
    lines.set_clim(middle - span / 2, middle + span / 2)
    if word:  # in a log some values may be unknown: draw the whole depth thin in grey
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
    style.label_mission_time(axes, trajectory, seconds, unit)
    label = f"{chosen.label} [{chosen.unit}]" + (f"\n{word}" if word else "")
    style.colour_bar(axes, lines, label, pad=0.02, aspect=22)


FIGURE = FigureKind("section", "depth against time, coloured by speed", section_figure)


def transect_figure(trajectory: Trajectory) -> Figure:
    """Draw temperature and salinity over distance along the track and depth.

    Raises:
      InputError: the mission has no temperature and salinity.
    """
    distance = along_track(trajectory)
    metres, unit = style.length_unit(distance)
    word = source_of(trajectory, "true_north", "true track")
    return draw_sections(trajectory, distance / metres, f"distance along the {word} [{unit}]")


def along_track(trajectory: Trajectory) -> Array:
    """[m] Horizontal distance over ground at each sample, (time,); linear over unknown samples."""
    place = np.stack([trajectory["true_north"], trajectory["true_east"]], axis=1)
    known = np.isfinite(place).all(axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(place[known], axis=0).T))])
    return np.interp(trajectory.time, trajectory.time[known], way)


TRANSECT = FigureKind(
    "transect",
    "temperature and salinity over the distance along the track and depth",
    transect_figure,
)


def overview_figure(trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> Figure:
    """Draw depth section, track, current profile, attitude and actuators on one page."""
    with style.styled():
        names = LEGEND_ROW * legend_rows(tracks, LEGEND_COLUMNS)
        panels = len(ATTITUDE) + len(trajectory.actuators)
        heights = [HEIGHTS[0], HEIGHTS[1] + names, PANEL_HEIGHT * panels]
        figure = style.new_figure(style.PAGE_WIDTH, sum(heights))
        rows = figure.subfigures(3, 1, squeeze=False, height_ratios=heights)
        top, middle, bottom = rows[:, 0]
        section = top.add_subplot()
        draw_section(section, trajectory)
        section.set_title(_headline(trajectory))
        left, right = middle.subplots(1, 2, width_ratios=[1.45, 1.0])
        draw_track(left, trajectory, tracks)
        draw_legend(middle, left, tracks, LEGEND_COLUMNS)
        left.set_title(source_of(trajectory, "true_north", "track over ground"))
        if all(f"true_current_{name}" in trajectory for name in ("north", "east")):
            draw_met_current(right, trajectory)
            right.set_title("current met on the way")
        else:
            right.set_axis_off()
            right.text(0.5, 0.5, "the log has no current", transform=right.transAxes, ha="center")
        grid = bottom.subplots(panels, 1, sharex=True)
        draw_attitude(grid[: len(ATTITUDE)], trajectory)
        draw_actuators(grid[len(ATTITUDE) :], trajectory)
        style.label_mission_time(grid[-1], trajectory, *thinned_time(trajectory)[1:])
        bottom.align_ylabels()
    return figure


def _headline(trajectory: Trajectory) -> str:
    seconds, unit = style.time_unit(trajectory.time)
    span = (trajectory.time[-1] - trajectory.time[0]) / seconds
    distance = float(trajectory.distance_through_water()[-1])
    deepest = float(np.nanmax(trajectory["true_depth"]))
    through = f"{distance / 1000:.1f} km" if distance >= 2000 else f"{distance:.0f} m"
    return f"{span:.3g} {unit}, {through} through the water, down to {deepest:.0f} m"


WHOLE = FigureKind(
    "overview",
    "section, track, current, attitude and actuators on a page",
    overview_figure,
    takes_tracks=True,
)
