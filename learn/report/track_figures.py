"""Track: tracks through the water from above, and how far they are from the truth.

Track 3-D: tracks through the water in space.
Doppler track: networks and DVL-aided dead reckoning over ground from above, and the truth.
Doppler track 3-D: networks and DVL-aided dead reckoning over ground in space.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learn.report.contents import Contents, ReportFigure, Shown, colour_of, title_of
from learn.report.lines import (
    BESIDE_DVL,
    MARKS,
    drawn_methods,
    ground_lines,
    look,
    water_lines,
    with_bottom_lock,
)
from twin.navigation.dead_reckoning import Array
from twin.show import style
from twin.show.figures.track import LEGEND, space_axes

LEAST_DISTANCE_M = 0.01
"""Lower end of logarithmic distances: a centimetre"""


class TrackFigure(ReportFigure):
    """See the module."""

    summary = "dead-reckoned tracks of a mission from above"
    section = "tracks"
    beside = True

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        if not contents.tracks:
            return None
        shown = contents.tracks[0]
        methods = [name for name in drawn_methods() if name in shown.estimates]
        return track_figure(shown, methods, water_lines(shown, methods))

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        return f"Dead-reckoned tracks through the water, {contents.tracks[0].label}."


def track_figure(shown: Shown, methods: Sequence[str], lines: dict[str, Array]) -> Figure:
    """North-east tracks from above, and how far each method is from the truth.

    Args:
      methods: those that could be drawn; a legend says which of them has no track.
      lines: tracks [m], (time, 2), of the truth and of methods.
    """
    with style.styled():
        figure = style.new_figure(style.COLUMN_WIDTH * 1.25, 5.2)
        axes, below = figure.subplots(2, 1, height_ratios=(3.0, 1.0))
        metres, unit = style.length_unit(*(line[:, k] for line in lines.values() for k in (0, 1)))
        for place, (name, line) in enumerate(lines.items()):
            north, east = style.thin(line[:, 0], line[:, 1])
            axes.plot(east / metres, north / metres, **look(name, place))
        for name, line in lines.items():
            _ends(axes, line / metres, name)
        axes.set_xlabel(f"east [{unit}]")
        axes.set_ylabel(f"north [{unit}]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.06)
        _distances(below, shown, lines)
        _legend(figure, axes, methods, lines)
    return figure


def _distances(axes: Axes, shown: Shown, lines: dict[str, Array]) -> None:
    """Distance of each method from the truth over time, on a logarithmic axis."""
    seconds, unit = style.time_unit(shown.time)
    for place, (name, line) in enumerate(lines.items()):
        if name == "truth":
            continue
        away = np.maximum(np.hypot(*(line - lines["truth"]).T), LEAST_DISTANCE_M)
        time, distance = style.thin(shown.time / seconds, away)
        axes.plot(time, distance, **look(name, place))
    axes.set_yscale("log")
    axes.set_ylabel("[m]")
    axes.set_title("distance from the truth")
    style.label_time(axes, unit)


def _legend(figure: Figure, axes: Axes, methods: Sequence[str], lines: dict[str, Array]) -> None:
    handles, names = axes.get_legend_handles_labels()
    missing = [title_of(name) for name in methods if name not in lines]
    if missing:
        handles = [*handles, axes.plot([], [], ls="none")[0]]
        names = [*names, f"no track: {', '.join(missing)}"]
    figure.legend(handles, names, loc="outside upper left", ncols=2, columnspacing=1.0)


def _ends(axes: Axes, track: Array, name: str) -> None:
    """Start and end of the truth, the end of a method in its colour."""
    for label, (index, marker) in MARKS.items():
        if name != "truth" and label == "start":
            continue
        truth = name == "truth"
        axes.plot(
            track[index, 1], track[index, 0], marker, ms=6.5 if truth else 4.0, mfc="white",
            mec=style.COMMAND if truth else colour_of(name), mew=1.2, ls="none",
            label=label if truth else None, zorder=5 if truth else 6,
        )  # fmt: skip


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
            x, y = truth[index, 1], truth[index, 0]
            axes.plot(x, y, depth[index], marker, ms=5, label=name, zorder=10, **style.END)
        figure.legend(**LEGEND, ncols=3)
    return figure


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
            "the water, since they do not know the current."
        )


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
