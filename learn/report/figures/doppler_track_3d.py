"""Doppler track 3-D: networks and DVL-aided dead reckoning over ground in space."""

from __future__ import annotations

from matplotlib.figure import Figure

from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from learn.report.figures.lines import BESIDE_DVL, ground_lines, with_bottom_lock
from learn.report.figures.track_3d import track_3d_figure


class DopplerTrack3d(ReportFigure):
    """See the module."""

    summary = "the same tracks in space"
    section = "doppler"
    beside = True

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        shown = with_bottom_lock(contents.test.shown)
        if shown is None:
            return None
        return track_3d_figure(shown, ground_lines(shown, BESIDE_DVL))

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        return "The same with the measured depth; the vertical scale is its own."
