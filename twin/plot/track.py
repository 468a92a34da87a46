"""Track: where the glider went, from above and in space, beside dead-reckoned tracks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from twin.plot import style
from twin.render.tracks import NamedTrack
from twin.trajectory import Trajectory

Array = NDArray[np.float64]

OTHER_COLOURS = tuple(c for name, c in style.PALETTE.items() if name not in ("blue", "black"))
"""Colours of tracks beside the truth."""


def track_figure(trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> Figure:
    """The horizontal track, north up, equal scales; `tracks` are drawn beside the truth."""
    with style.styled():
        figure = style.new_figure(height=3.3)
        draw_track(figure.add_subplot(), trajectory, tracks)
    return figure


def draw_track(axes: Axes, trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> None:
    """Draw the horizontal track into `axes`: coloured by time, or beside other tracks plain."""
    north, east, time = style.thin(
        trajectory["true_north"], trajectory["true_east"], trajectory.time
    )
    extent = [north, east, *(a for t in tracks for a in (t.north, t.east))]
    metres, unit = style.length_unit(*extent)
    if tracks:
        axes.plot(east / metres, north / metres, color=style.TRUTH, lw=1.8, label="truth")
        for index, track in enumerate(tracks):
            n, e = style.thin(track.north, track.east)
            axes.plot(
                e / metres,
                n / metres,
                color=OTHER_COLOURS[index % len(OTHER_COLOURS)],
                lw=1.1,
                ls=("-", "--", "-.", ":")[index // len(OTHER_COLOURS) % 4],
                label=track.name,
            )
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
    marks = {"start": (0, "o"), "end": (-1, "s")}
    for name, (index, marker) in marks.items():
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
    axes.set_xlabel(f"east [{unit}]")
    axes.set_ylabel(f"north [{unit}]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=3,
        borderaxespad=0.2,
        columnspacing=1.0,
        handletextpad=0.4,
    )


def track_3d_figure(trajectory: Trajectory, tracks: Sequence[NamedTrack] = ()) -> Figure:
    """The track in space, depth down; the vertical scale is its own, as oceanographers plot it."""
    with style.styled():
        figure = style.new_figure(height=3.3)
        figure.set_layout_engine("none")  # it does not know how far the labels of 3-D axes reach
        axes: Any = figure.add_axes((0.0, 0.02, 0.94, 0.90), projection="3d")
        north, east, depth, time = style.thin(
            *(trajectory[f"true_{n}"] for n in ("north", "east", "depth")),
            trajectory.time,
            most=2500,
        )
        metres, unit = style.length_unit(north, east)
        axes.plot(east / metres, north / metres, depth, color=style.TRUTH, lw=1.2, label="truth")
        floor = depth.max() * 1.1 + 1.0
        axes.plot(
            east / metres, north / metres, floor, color=style.GUIDE, lw=0.8, label="on the chart"
        )
        for index, track in enumerate(tracks):
            n, e, t = style.thin(track.north, track.east, track.time, most=2500)
            d = np.interp(t, time, depth)
            colour = OTHER_COLOURS[index % len(OTHER_COLOURS)]
            axes.plot(e / metres, n / metres, d, color=colour, lw=0.9, label=track.name)
        axes.set_zlim(floor, 0.0)
        axes.set_xlabel(f"east [{unit}]")
        axes.set_ylabel(f"north [{unit}]")
        axes.set_zlabel("depth [m]")
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_pane_color((0.97, 0.98, 0.99, 1.0))
            axis.set_major_locator(MaxNLocator(4))
        axes.view_init(elev=24, azim=-58)
        axes.set_box_aspect((1.25, 1.25, 0.9), zoom=0.92)
        figure.legend(loc="upper left", bbox_to_anchor=(0.02, 0.99), ncols=3, columnspacing=1.0)
    return figure
