"""Overview: one page that says what a mission was."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from twin.records.logged import source_of
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.dates import label_time
from twin.show.figures.base import FigureKind
from twin.show.figures.section import draw_section
from twin.show.figures.signals import ATTITUDE, draw_actuators, draw_attitude, thinned_time
from twin.show.figures.track import LEGEND_ROW, draw_legend, draw_track, legend_rows
from twin.show.figures.water import draw_current

HEIGHTS = (1.9, 2.75)
"""[in] of section and track"""
PANEL_HEIGHT = 0.87
"""[in] of each signal below them"""
LEGEND_COLUMNS = 4
"""Of dead-reckoned tracks"""


def overview_figure(trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> Figure:
    """Depth section, track, current profile, attitude and actuators on one page."""
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
            draw_current(right, trajectory)
            right.set_title("current met on the way")
        else:
            right.set_axis_off()
            right.text(0.5, 0.5, "the log has no current", transform=right.transAxes, ha="center")
        grid = bottom.subplots(panels, 1, sharex=True)
        draw_attitude(grid[: len(ATTITUDE)], trajectory)
        draw_actuators(grid[len(ATTITUDE) :], trajectory)
        label_time(grid[-1], trajectory, *thinned_time(trajectory)[1:])
        bottom.align_ylabels()
    return figure


def _headline(trajectory: Trajectory) -> str:
    seconds, unit = style.time_unit(trajectory.time)
    span = (trajectory.time[-1] - trajectory.time[0]) / seconds
    distance = float(trajectory.distance_through_water()[-1])
    deepest = float(np.nanmax(trajectory["true_depth"]))
    through = f"{distance / 1000:.1f} km" if distance >= 2000 else f"{distance:.0f} m"
    return f"{span:.3g} {unit}, {through} through the water, down to {deepest:.0f} m"


FIGURE = FigureKind(
    name="overview",
    summary="section, track, current, attitude and actuators on a page",
    draw=overview_figure,
    takes_tracks=True,
)
