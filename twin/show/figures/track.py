"""Track figures: the vehicle's path from above and in three dimensions, with dead-reckoned tracks.

The three-dimensional axes have depth down.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from twin.records.logged import LoggedTrajectory, source_of
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.figures.base import FigureKind

Array = NDArray[np.float64]

MARKS = {"start": (0, "o"), "end": (-1, "s")}  # sample and marker of a track's ends
MOST_COLUMNS, LONG_NAME = 3, 14
"""MOST_COLUMNS: of a legend at column width. LONG_NAME: length of a name that takes one away"""
ABOVE_LEGEND = 18.0  # [point] gap between title and axes, for the legend of start and end
LEGEND_ROW = 0.16  # [in] height of a legend's row
VIEW_ELEVATION, VIEW_AZIMUTH = 24, -58  # [degree] direction from which the box is seen
BOX, ZOOM = (1.25, 1.25, 0.9), 0.92
"""BOX: relative sides (east, north, depth). ZOOM: below 1, so that no label is cut"""
TICKS = 4
PANE = (0.97, 0.98, 0.99, 1.0)  # colour of the box's walls
BOTTOM, RIGHT = 0.02, 0.94
"""Edges of the axes as fractions of the figure. The depth label reaches beyond the right edge."""
BLANK = 0.15  # fraction of the axes' height that stays blank above such a flat box
LEGEND: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (0.02, 0.99), "columnspacing": 1.0}
"""Options that place `figure.legend`"""
SPACE_HEIGHT = 2.95  # [in] height of a 3-D figure with one row of names
MOST_3D = 2500  # most points of a line


def track_figure(trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> Figure:
    """Draw the horizontal track, north up, equal scales; `tracks` are drawn beside the truth."""
    with style.styled():
        columns = legend_columns(tracks)
        figure = style.new_figure(height=3.3 + LEGEND_ROW * legend_rows(tracks, columns))
        axes = figure.add_subplot()
        draw_track(axes, trajectory, tracks)
        if not tracks:
            axes.set_title(source_of(trajectory, "true_north", ""), pad=ABOVE_LEGEND)
        draw_legend(figure, axes, tracks, columns)
    return figure


def draw_track(axes: Axes, trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> None:
    """Draw the horizontal track into `axes`: coloured by time, or plain if there are `tracks`."""
    north, east, time = style.thin(
        trajectory["true_north"], trajectory["true_east"], trajectory.time
    )
    extent = [north, east, *(a for t in tracks for a in (t.north, t.east))]
    metres, unit = style.length_unit(*extent)
    if tracks:
        word = source_of(trajectory, "true_north", "truth")
        axes.plot(east / metres, north / metres, color=style.TRUTH, lw=2.4, label=word)
        for index, track in enumerate(tracks):
            n, e = style.thin(track.north, track.east)
            axes.plot(e / metres, n / metres, lw=1.1, label=track.title, **style.track_look(index))
    else:
        seconds, time_name = style.time_unit(time)
        points = np.column_stack([east, north]) / metres
        segments = np.stack([points[:-1], points[1:]], axis=1)
        lines = LineCollection(list(segments), array=time[:-1] / seconds, linewidths=1.8)
        lines.set_capstyle("round")
        axes.add_collection(lines)
        axes.autoscale_view()
        style.colour_bar(axes, lines, f"time [{time_name}]", shrink=0.85, pad=0.02, aspect=25)
    known = np.flatnonzero(np.isfinite(north) & np.isfinite(east))
    for name, (end, marker) in MARKS.items():
        x, y = east[known[end]] / metres, north[known[end]] / metres
        axes.plot(x, y, marker, ms=5, label=name, **style.END)
    names = ("measured_gps_east", "measured_gps_north")
    if isinstance(trajectory, LoggedTrajectory) and all(name in trajectory for name in names):
        east, north = (trajectory[name] / metres for name in names)  # fixes that correct the track
        axes.plot(east, north, ".", ms=3.5, color=style.COMMAND, ls="none", label="fix", zorder=2.5)
    axes.set_xlabel(f"east [{unit}]")
    axes.set_ylabel(f"north [{unit}]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)


def draw_legend(
    figure: Figure | SubFigure, axes: Axes, tracks: Sequence[NamedTrack], columns: int
) -> None:
    """Draw the legend of `draw_track`: at the corner above the axes, or above all with `tracks`.

    Args:
      columns: columns of the legend with `tracks`.
    """
    if tracks:
        handles, names = axes.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=columns, columnspacing=1.0)
        return
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=MOST_COLUMNS, borderaxespad=0.2,
        columnspacing=1.0, handletextpad=0.4,
    )  # fmt: skip


def legend_columns(tracks: Sequence[NamedTrack]) -> int:
    """Number of columns of a legend at column width for these tracks' names."""
    longest = max((len(track.title) for track in tracks), default=0)
    return MOST_COLUMNS - (longest >= LONG_NAME)


def legend_rows(tracks: Sequence[NamedTrack], columns: int) -> int:
    """Number of rows of the legend of truth, start, end and tracks; 0 without tracks."""
    return -(-(len(tracks) + 3) // columns) if tracks else 0


FIGURE = FigureKind(
    "track",
    "the track from above, beside dead-reckoned tracks (`--tracks`, `--only`)",
    track_figure,
    takes_tracks=True,
)


def space_axes(figure: Figure, *, floor: float, unit: str, top: float) -> Any:
    """Make 3-D axes that fill a figure; call this inside `style.styled()`.

    Args:
      floor: [m] depth of the box's floor.
      unit: unit of east and north.
      top: upper edge of the axes over the figure's height; the legend goes above.

    Returns:
      matplotlib's Axes3D, which takes east, north and depth in this order.
    """
    figure.set_layout_engine("none")  # the engine ignores the labels of 3-D axes
    # extend the axes above `top`, so that their blank lies under the legend
    height = (top - BOTTOM) / (1.0 - BLANK)
    axes: Any = figure.add_axes((0.0, BOTTOM, RIGHT, height), projection="3d")
    axes.set_zlim(floor, 0.0)
    axes.set_xlabel(f"east [{unit}]")
    axes.set_ylabel(f"north [{unit}]")
    axes.set_zlabel("depth [m]")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color(PANE)
        axis.set_major_locator(MaxNLocator(TICKS))
    axes.view_init(elev=VIEW_ELEVATION, azim=VIEW_AZIMUTH)
    axes.set_box_aspect(BOX, zoom=ZOOM)
    return axes


def track_3d_figure(trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> Figure:
    """Draw the track in three dimensions, depth down, with a vertical scale of its own."""
    with style.styled():
        columns = legend_columns(tracks)
        rows = -(-(len(tracks) + 4) // columns)
        height = SPACE_HEIGHT + LEGEND_ROW * (rows - 1)
        figure = style.new_figure(height=height)
        north, east, depth, time = style.thin(
            *(trajectory[f"true_{n}"] for n in ("north", "east", "depth")),
            trajectory.time,
            most=MOST_3D,
        )
        metres, unit = style.length_unit(north, east)
        word = source_of(trajectory, "true_north", "truth")
        known = np.flatnonzero(np.isfinite(north) & np.isfinite(depth))
        floor = float(np.nanmax(depth)) * 1.1 + 1.0
        top = 1.0 - (LEGEND_ROW * rows + 0.12) / height
        axes = space_axes(figure, floor=floor, unit=unit, top=top)
        x, y = east / metres, north / metres
        axes.plot(x, y, depth, color=style.TRUTH, lw=1.6, label=word)
        axes.plot(x, y, floor, color=style.GUIDE, lw=0.8, label="on the chart")
        for index, track in enumerate(tracks):
            n, e, t = style.thin(track.north, track.east, track.time, most=MOST_3D)
            place = (e / metres, n / metres, np.interp(t, time, depth))
            axes.plot(*place, lw=0.9, label=track.title, **style.track_look(index))
        for name, (end, marker) in MARKS.items():
            place = (x[known[end]], y[known[end]], depth[known[end]])
            axes.plot(*place, marker, ms=5, label=name, zorder=10, **style.END)
        figure.legend(**LEGEND, ncols=columns)
    return figure


TRACK_3D = FigureKind(
    "track_3d",
    "the track in space, beside dead-reckoned tracks",
    track_3d_figure,
    takes_tracks=True,
)
