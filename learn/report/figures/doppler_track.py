"""Doppler track: networks and DVL-aided dead reckoning over ground from above, and the truth."""

from __future__ import annotations

from matplotlib.figure import Figure

from learn.report.contents import Contents
from learn.report.figures.base import ReportFigure
from learn.report.figures.lines import BESIDE_DVL, ground_lines, with_bottom_lock
from learn.report.figures.track import track_figure


class DopplerTrack(ReportFigure):
    """See the module."""

    summary = "networks and DVL-aided dead reckoning over ground from above"
    section = "doppler"
    beside = True

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        shown = with_bottom_lock(contents.test.shown)
        if shown is None:
            return None
        return track_figure(shown, BESIDE_DVL, ground_lines(shown, BESIDE_DVL))

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        shown = with_bottom_lock(contents.test.shown)
        assert shown is not None
        return (
            f"Tracks over ground without fixes, {shown.label}: the networks' is the one through "
            "the water, since they know nothing of the current."
        )
