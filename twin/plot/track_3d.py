"""Track in space: where the glider went, depth down, beside dead-reckoned tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from twin.plot import style
from twin.plot.registry import FigureKind
from twin.plot.space import LEGEND, space_axes
from twin.plot.track import LEGEND_ROW, MARKS, legend_columns, line_look
from twin.records.logged_trajectory import source_of
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory

SPACE_HEIGHT = 2.95
"""[in] of a figure with one row of names"""
MOST_3D = 2500
"""Points of a line"""


def track_3d_figure(trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> Figure:
    """The track in space, depth down; the vertical scale is its own, as oceanographers plot it."""
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
        axes.plot(east / metres, north / metres, depth, color=style.TRUTH, lw=1.6, label=word)
        axes.plot(
            east / metres, north / metres, floor, color=style.GUIDE, lw=0.8, label="on the chart"
        )
        for index, track in enumerate(tracks):
            n, e, t = style.thin(track.north, track.east, track.time, most=MOST_3D)
            d = np.interp(t, time, depth)
            axes.plot(e / metres, n / metres, d, lw=0.9, label=track.title, **line_look(index))
        for name, (end, marker) in MARKS.items():
            index = known[end]
            axes.plot(
                east[index] / metres, north[index] / metres, depth[index], marker, ms=5,
                mfc="white", mec=style.COMMAND, mew=1.2, ls="none", label=name, zorder=10,
            )  # fmt: skip
        figure.legend(**LEGEND, ncols=columns)
    return figure


FIGURE = FigureKind(
    name="track_3d",
    summary="the track in space, beside dead-reckoned tracks",
    draw=track_3d_figure,
    takes_tracks=True,
)
