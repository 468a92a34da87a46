"""Track 3-D: tracks through the water in space."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from learn.report.figures.lines import MARKS, drawn_methods, look, water_lines
from learn.report.shown import Shown
from twin.navigation.dead_reckoning import Array
from twin.plot import style
from twin.plot.space import LEGEND, space_axes


class Track3d(ReportFigure):
    """See the module."""

    summary = "the same tracks in space"
    section = "tracks"
    beside = True

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        if not contents.tracks:
            return None
        shown = contents.tracks[0]
        return track_3d_figure(shown, water_lines(shown, drawn_methods()))

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        return "The same with the measured depth; the vertical scale is its own."


def track_3d_figure(shown: Shown, lines: dict[str, Array]) -> Figure:
    """Tracks in space, depth down, and the truth on the floor; its own vertical scale.

    Args:
      lines: tracks [m], (time, 2), of the truth and of methods.
    """
    with style.styled():
        figure = style.new_figure(style.COLUMN_WIDTH * 1.25, 3.5)
        metres, unit = style.length_unit(*(line[:, k] for line in lines.values() for k in (0, 1)))
        depth = shown.reference.mission.signals["measured_depth"]
        floor = float(np.max(depth)) * 1.1 + 1.0
        axes = space_axes(figure, floor=floor, unit=unit, top=0.86)
        truth = lines["truth"] / metres
        for place, (name, line) in enumerate(lines.items()):
            north, east, down = style.thin(line[:, 0], line[:, 1], depth, most=2500)
            axes.plot(east / metres, north / metres, down, **look(name, place))
        north, east = style.thin(truth[:, 0], truth[:, 1], most=2500)
        axes.plot(east, north, floor, color=style.GUIDE, lw=0.8, label="truth on the floor")
        for name, (index, marker) in MARKS.items():
            axes.plot(
                truth[index, 1], truth[index, 0], depth[index], marker, ms=5, mfc="white",
                mec=style.COMMAND, mew=1.2, ls="none", label=name, zorder=10,
            )  # fmt: skip
        figure.legend(**LEGEND, ncols=3)
    return figure
