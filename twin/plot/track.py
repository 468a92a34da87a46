"""Track: where the glider went, from above, beside dead-reckoned tracks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from twin.plot import style
from twin.plot.registry import FigureKind
from twin.records.logged_trajectory import LoggedTrajectory, source_of
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory

Array = NDArray[np.float64]

OTHER_COLOURS = tuple(c for name, c in style.PALETTE.items() if name not in ("blue", "black"))
"""Colours of tracks beside the truth."""


MARKS = {"start": (0, "o"), "end": (-1, "s")}
"""Sample and marker of a track's ends"""
MOST_COLUMNS = 3
"""Columns of a legend at column width"""
LONG_NAME = 14
"""Letters of a name from which a legend at column width has one column less"""
ABOVE_LEGEND = 18.0
"""[point] of a title above the axes, so that start and end are named below it"""
LEGEND_ROW = 0.16
"""[in] height of a legend's row"""


def track_figure(trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> Figure:
    """The horizontal track, north up, equal scales; `tracks` are drawn beside the truth."""
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
    """Draw the horizontal track into `axes`: coloured by time, or beside other tracks plain."""
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
            axes.plot(e / metres, n / metres, lw=1.1, label=track.title, **line_look(index))
    else:
        seconds, time_name = style.time_unit(time)
        points = np.column_stack([east, north]) / metres
        segments = np.stack([points[:-1], points[1:]], axis=1)
        lines = LineCollection(list(segments), array=time[:-1] / seconds, linewidths=1.8)
        lines.set_capstyle("round")
        axes.add_collection(lines)
        axes.autoscale_view()
        bar = axes.figure.colorbar(lines, ax=axes, shrink=0.85, pad=0.02, aspect=25)
        bar.set_label(f"time [{time_name}]")
        bar.outline.set_visible(False)
    known = np.flatnonzero(np.isfinite(north) & np.isfinite(east))
    for name, (end, marker) in MARKS.items():
        index = known[end]
        axes.plot(
            east[index] / metres,
            north[index] / metres,
            marker,
            ms=5,
            mfc="white",
            mec=style.COMMAND,
            mew=1.2,
            ls="none",
            label=name,
        )
    if isinstance(trajectory, LoggedTrajectory):
        _draw_fixes(axes, trajectory, metres)
    axes.set_xlabel(f"east [{unit}]")
    axes.set_ylabel(f"north [{unit}]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)


def _draw_fixes(axes: Axes, trajectory: LoggedTrajectory, metres: float) -> None:
    """The fixes of a log, which its track was corrected at."""
    names = ("measured_gps_east", "measured_gps_north")
    if all(name in trajectory for name in names):
        east, north = (trajectory[name] / metres for name in names)
        axes.plot(east, north, ".", ms=3.5, color=style.COMMAND, ls="none", label="fix", zorder=2.5)


def draw_legend(
    figure: Figure | SubFigure,
    axes: Axes,
    tracks: Sequence[NamedTrack],
    columns: int,
) -> None:
    """Name what `draw_track` drew: in the corner above the axes, or beside other tracks above all.

    Args:
      columns: of the legend beside other tracks.
    """
    if tracks:
        handles, names = axes.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=columns, columnspacing=1.0)
        return
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=MOST_COLUMNS,
        borderaxespad=0.2,
        columnspacing=1.0,
        handletextpad=0.4,
    )


def legend_columns(tracks: Sequence[NamedTrack]) -> int:
    """Columns of a legend at column width that the tracks' names leave room for."""
    longest = max((len(track.title) for track in tracks), default=0)
    return MOST_COLUMNS - (longest >= LONG_NAME)


def legend_rows(tracks: Sequence[NamedTrack], columns: int) -> int:
    """Rows of the legend beside other tracks: truth, start and end, and the tracks; 0 without."""
    return -(-(len(tracks) + 3) // columns) if tracks else 0


def line_look(index: int) -> dict[str, Any]:
    """Colour and dashes of a track beside the truth; no two of the first 28 are alike."""
    return {
        "color": OTHER_COLOURS[index % len(OTHER_COLOURS)],
        "ls": ("-", "--", "-.", ":")[index // len(OTHER_COLOURS) % 4],
    }


FIGURE = FigureKind(
    name="track",
    summary="the track from above, beside dead-reckoned tracks (`--tracks`, `--only`)",
    draw=track_figure,
    takes_tracks=True,
)
