"""Track figures: dead-reckoned tracks from above and in space, and their position errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learn.data.labels import MODE
from learn.evaluation.judged_tracks import ground_tracks
from learn.evaluation.score import DVL, FLOOR, NETWORK
from learn.report.contents import Shown, colour_of, title_of
from twin.navigation.dead_reckoning import Array, horizontal_error
from twin.navigation.estimators.base import baselines
from twin.navigation.estimators.dvl import BOTTOM
from twin.show import style
from twin.show.figures.track import LEGEND, space_axes

DASHES = ((0, (6, 2)), (0, (1, 1.4)), (0, (6, 2, 1, 2)), (0, (3, 1.5)))
"""Line styles of methods in their order, distinct without colour"""
TRUTH_LINE: dict[str, Any] = {"color": style.TRUTH, "lw": 4.0, "alpha": 0.35, "label": "truth"}
"""Line of the truth, wide and pale so that lines above it stay visible"""
MARKS = {"start": (0, "o"), "end": (-1, "s")}
BESIDE_DVL = (NETWORK, DVL)
LEAST_BOTTOM_SHARE = 0.5
"""[1] Smallest fraction of samples with bottom lock for a figure of the Doppler log's track"""
LEAST_DISTANCE_M = 0.01
"""[m] Lower end of logarithmic axes of distance"""
LEAST_ERROR_M = 0.05
"""[m] Smallest span of an error axis: errors of centimetres do not matter to a navigator."""
MARGIN = 0.12
"""[1] Margin above and below the lines together, relative to their range"""
MISSION_DASHES = ((0, ()), (0, (7, 4)), (0, (1.5, 3)))
"""Line styles of missions, with gaps that show the lines below"""
MISSION_COLOURS = (style.TRUTH, style.PALETTE["orange"], style.PALETTE["black"])
PAIRS: tuple[tuple[str, str, str, dict[str, Any]], ...] = (
    (NETWORK, "truth", "networks − truth", {"color": colour_of(NETWORK), "lw": 1.6}),
    (
        NETWORK, DVL, "networks − DVL-aided, as the paper",
        {"color": style.PALETTE["sky"], "lw": 1.4, "ls": (0, (6, 2))},
    ),
    (DVL, "truth", "DVL-aided − truth", {"color": colour_of(DVL), "lw": 1.1, "ls": (0, (1, 1.4))}),
)  # fmt: skip
"""Pairs of tracks to compare, with label and line"""
LEAST_SHARE = 0.02
"""[1] Fraction of the whole path after which errors are drawn in % of the path so far"""


def drawn_methods() -> tuple[str, ...]:
    """Names of the methods whose tracks are drawn: more tracks would hide each other."""
    return (NETWORK, *(name for name, kind in baselines().items() if kind.drawn))


def water_lines(shown: Shown, methods: Sequence[str]) -> dict[str, Array]:
    """[m] Tracks through the water, (time, 2), of the truth and of methods that have one."""
    lines = {"truth": shown.reference.water_track}
    for name in methods:
        track = shown.water_track(name) if name in shown.estimates else None
        if track is not None and name != FLOOR:
            lines[name] = track
    return lines


def ground_lines(shown: Shown, methods: Sequence[str]) -> dict[str, Array]:
    """[m] Tracks over ground, (time, 2), of the truth and of methods that know the current.

    A method that reckons through the water knows it in still water, and between fixes from the dive
    before. Elsewhere its track over ground would be the one through the water.
    """
    reference = shown.reference
    lines = {"truth": reference.ground_track}
    drift = horizontal_error(reference.ground_track, reference.water_track)
    for name in methods:
        estimate = shown.estimates[name]
        track = reference.tracks(estimate).get("ground")
        if estimate.ground_track is None and drift.max() > LEAST_DISTANCE_M:
            signals = reference.mission.signals
            start = [signals["true_north"][0], signals["true_east"][0]]
            known = ground_tracks(reference, estimate).get("") if reference.dives else None
            track = None if known is None else known - start
        if track is not None:
            lines[name] = track
    return lines


def with_bottom_lock(missions: Sequence[Shown]) -> Shown | None:
    """Longest mission with bottom lock in at least LEAST_BOTTOM_SHARE of the samples, or None."""
    seen = [
        shown
        for shown in missions
        if DVL in shown.estimates
        and shown.estimates[DVL].ground_track is not None
        and np.mean(shown.reference.mission.signals[MODE] == BOTTOM) >= LEAST_BOTTOM_SHARE
    ]
    return max(seen, key=lambda shown: float(shown.reference.path[-1]), default=None)


def look(name: str, place: int) -> dict[str, Any]:
    """Line style of a method at index `place` of the drawn lines; index 0 is the truth."""
    if name == "truth":
        return TRUTH_LINE
    dashes = DASHES[(place - 1) % len(DASHES)]
    return {"color": colour_of(name), "lw": 1.4, "ls": dashes, "label": title_of(name)}


def track_figure(shown: Shown, methods: Sequence[str], lines: dict[str, Array]) -> Figure:
    """Draw tracks from above, and the distance of each method from the truth.

    Args:
      methods: methods to draw; the legend names those without a track.
      lines: [m] tracks, (time, 2), of the truth and of methods.
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
    """Draw each method's distance from the truth over time, on a logarithmic axis."""
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
    """Mark start and end of the truth, or the end of a method in its colour."""
    for label, (index, marker) in MARKS.items():
        if name != "truth" and label == "start":
            continue
        truth = name == "truth"
        axes.plot(
            track[index, 1], track[index, 0], marker, ms=6.5 if truth else 4.0, mfc="white",
            mec=style.COMMAND if truth else colour_of(name), mew=1.2, ls="none",
            label=label if truth else None, zorder=5 if truth else 6,
        )  # fmt: skip


def track_3d_figure(shown: Shown, lines: dict[str, Array]) -> Figure:
    """Draw tracks in space and the truth's projection below, with another scale for depth.

    Args:
      lines: [m] tracks, (time, 2), of the truth and of methods.
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


def error_figure(missions: Sequence[Shown]) -> Figure:
    """Draw north and east error of the networks' track over time, one line per mission.

    This is the paper's figure for its three currents: through the water (above) and over ground
    without knowledge of the current or fixes (below). Both panels of a row have one scale.
    """
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 4.6)
        axes = figure.subplots(2, 2, sharex=True, sharey="row")
        seconds, unit = style.time_unit(max((s.time for s in missions), key=len))
        for k, shown in enumerate(missions):
            track = shown.water_track(NETWORK)
            assert track is not None
            for row, truth in zip(
                axes, (shown.reference.water_track, shown.reference.ground_track), strict=True
            ):
                for place, values in zip(row, (track - truth).T, strict=True):
                    time, error = style.thin(shown.time / seconds, values)
                    place.plot(
                        time, error, lw=1.5, label=shown.label,
                        color=MISSION_COLOURS[k % len(MISSION_COLOURS)],
                        ls=MISSION_DASHES[k % len(MISSION_DASHES)],
                    )  # fmt: skip
        for row in axes:
            for place in row:
                place.axhline(0.0, color=style.GUIDE, lw=0.7, zorder=0)
            values = np.concatenate([np.asarray(line.get_ydata()) for a in row for line in a.lines])
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            reach = 0.5 * max((1.0 + MARGIN) * (high - low), LEAST_ERROR_M)
            row[0].set_ylim(0.5 * (low + high) - reach, 0.5 * (low + high) + reach)
        for row, where in zip(axes, ("through the water", "over ground"), strict=True):
            for place, name in zip(row, ("north", "east"), strict=True):
                place.set_title(f"{name} error, {where}")
            row[0].set_ylabel("estimate − truth [m]")
            row[1].tick_params(labelleft=True)
        for place in axes[1]:
            style.label_time(place, unit)
        figure.suptitle("position error of the networks' dead reckoning", x=0.01, ha="left")
        figure.legend(
            *axes[0, 0].get_legend_handles_labels(), loc="outside lower left", ncols=len(missions)
        )
    return figure


def doppler_error_figure(shown: Shown) -> Figure:
    """Draw north and east error over time, and the horizontal error in % of the path so far."""
    lines = ground_lines(shown, (NETWORK, DVL))
    path = shown.reference.path
    travelled = path >= LEAST_SHARE * path[-1]
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 2.9)
        axes = figure.subplots(1, 3)
        seconds, unit = style.time_unit(shown.time)
        for name, other, label, look in PAIRS:
            if not {name, other} <= set(lines):
                continue
            error = lines[name] - lines[other]
            for place, values in zip(axes[:2], error.T, strict=True):
                time, drawn = style.thin(shown.time / seconds, values)
                place.plot(time, drawn, label=label, **look)
            share = 100.0 * np.hypot(*error.T)[travelled] / path[travelled]
            time, drawn = style.thin(shown.time[travelled] / seconds, share)
            axes[2].plot(time, drawn, **look)
        for place in axes[:2]:
            place.axhline(0.0, color=style.GUIDE, lw=0.7, zorder=0)
        axes[2].set_ylim(bottom=0.0)
        for place, title in zip(
            axes,
            ("north error [m]", "east error [m]", "error [% of the path so far]"),
            strict=True,
        ):
            place.set_title(title)
            style.label_time(place, unit)
        figure.legend(
            *axes[0].get_legend_handles_labels(), loc="outside lower left", ncols=len(PAIRS)
        )
    return figure
