"""Logs page: one page of figures on a deployment: map, depths and flight of each dive."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import date2num
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from twin.bounded import file_names
from twin.cli.text_table import counted
from twin.records.attributes import DIVE_DURATION
from twin.records.coordinates import METHODS
from twin.records.logged import LogStore
from twin.show import style
from twin.show.figures.map import (
    Currents,
    arrow_scale,
    draw_arrows,
    draw_base,
    draw_key,
    draw_locator,
    joined,
)
from twin.show.figures.map_ground import box_around
from twin.show.style import DAY, LABEL, draw_dates

Array = NDArray[np.float64]

POINTS = 400
"""Maximum number of samples of a dive in a figure"""
HEIGHTS = (3.5, 1.9, 1.25, 1.25, 1.25)
"""[in] Heights of map, depths and three rows of figures of dives"""
NO_MAP = 0.6
"""[in] Height of the message in place of a map"""
HEADROOM = 1.12
"""[1] Upper end of an axis that begins at 0, relative to the largest value"""
ERROR_HEADROOM = 1.25
"""[1] Factor on the upper end of an axis that makes room for a line of text"""
DIVE, CLIMB = style.PALETTE["blue"], style.PALETTE["vermillion"]

OURS, THEIRS, PROFILER = "ours", "theirs", "profiler"
"""Sources of depth-averaged currents in a store of logs, see `averaged`"""
BASE_STATION, VEHICLE = "base station's", "vehicle's own"
OURS_COLOUR, THEIRS_COLOUR = style.PALETTE["green"], style.PALETTE["vermillion"]
AXES = ("north", "east")
MAP_TITLE = "GPS fixes and dives"
SHAPE = 1.45
"""[1] Width / height of the map"""


def page_names(deployments: Iterable[str]) -> dict[str, str]:
    """Make a unique part of a file name for each deployment, by deployment."""
    return file_names(deployments, "deployment")


def deployment_page(logs: LogStore, deployment: str) -> Figure:
    """Plot a map with depth-averaged currents, depths over time, and figures of each dive."""
    missions = logs.missions_of(deployment)
    fixed = any(np.isfinite(fix).all() for k in missions for fix in logs.fixes(k))
    heights = (HEIGHTS[0] if fixed else NO_MAP, *HEIGHTS[1:])
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, sum(heights) + 0.5)
        ratios = [heights[0], heights[1], sum(heights[2:])]
        top, middle, bottom = figure.subfigures(3, 1, squeeze=False, height_ratios=ratios)[:, 0]
        figure.suptitle(
            _headline(logs, deployment, missions), fontsize=9.0, fontweight="bold", x=0.01,
            ha="left",
        )  # fmt: skip
        _draw_map(top, logs, missions)
        _draw_depths(middle.add_subplot(), logs, missions)
        _draw_figures(bottom.subplots(3, 2, sharex=True), logs, missions)
        bottom.align_ylabels()
    return figure


def _headline(logs: LogStore, deployment: str, missions: list[int]) -> str:
    begin, end = (
        datetime.datetime.fromtimestamp(float(unix), datetime.UTC)
        for unix in (logs.starts[missions[0]], logs.time(missions[-1])[-1])
    )
    hours = sum(float(logs.samples[k]) for k in missions) * logs.period / 3600.0
    simulated = " (simulated)" if logs.simulated else ""
    return (
        f"{deployment}{simulated}, {logs.platform}\n"
        f"{counted(len(missions), 'dive')}, {hours:.4g} h logged, "
        f"{begin:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M} UTC"
    )


def _draw_map(figure: SubFigure, logs: LogStore, missions: list[int]) -> None:
    """Draw the map with fixes, dives and current arrows, and the key beside it."""
    fixes = {k: logs.fixes(k) for k in missions}
    places = np.array([fix for pair in fixes.values() for fix in pair])
    known = np.isfinite(places).all(axis=1)
    if not known.any():
        axes = figure.add_subplot()
        axes.set_title(MAP_TITLE)
        style.say_instead(axes, "no GPS fixes")
        return
    grid = figure.add_gridspec(2, 2, width_ratios=[3.1, 1.0], height_ratios=[1.0, 1.5])
    axes = figure.add_subplot(grid[:, 0])
    axes.set_title(MAP_TITLE)
    longitude = joined(np.where(known, places[:, 1], np.nan))
    turns = dict(zip(missions, (longitude - places[:, 1]).reshape(-1, 2), strict=True))
    box = box_around(places[:, 0], longitude, SHAPE)
    draw_base(axes, box)
    reckoned = False
    for k in missions:
        latitude, along, how = logs.positions(k)
        if np.isfinite(latitude).any() and np.isfinite(turns[k]).any():
            turn = turns[k][np.isfinite(turns[k])][0]
            la, lo = style.thin(latitude, joined(along) + turn, most=POINTS)
            axes.plot(lo, la, color=style.GUIDE, lw=0.8, zorder=1)
            reckoned |= how != METHODS["straight_line"]
        (a, b), (c, d) = fixes[k]
        if np.isfinite([a, b, c, d]).all():
            ends = [b + turns[k][0], d + turns[k][1]]
            axes.plot(ends, [a, c], color=DIVE, lw=1.0, ls=(0, (3, 2)), zorder=2.5)
    axes.plot(longitude[known], places[known, 0], ".", ms=3.5, color=style.COMMAND, label="fix")
    first = int(np.argmax(known))
    last = len(known) - 1 - int(np.argmax(known[::-1]))
    for index, marker, label in ((first, "o", "start"), (last, "s", "end")):
        axes.plot(
            longitude[index], places[index, 0], marker, ms=6, label=label, zorder=4, **style.END
        )
    axes.plot([], [], color=DIVE, lw=0.8, ls=(0, (3, 2)), label="dive, fix to fix")
    if reckoned:
        axes.plot([], [], color=style.GUIDE, lw=0.8, label="dive, corrected at the fixes")
    currents = _currents(logs, missions, turns)
    arrows = [(one, arrow_scale(currents)) for one in currents]
    for one, scale in arrows:
        draw_arrows(axes, one, scale)
    draw_locator(figure.add_subplot(grid[0, 1]), box)
    draw_key(figure.add_subplot(grid[1, 1]), axes, arrows, "depth-averaged current")


def _currents(logs: LogStore, missions: list[int], turns: dict[int, Array]) -> tuple[Currents, ...]:
    """Depth-averaged currents of each source at the middles of the dives."""
    found = []
    for kind, colour in ((OURS, OURS_COLOUR), (THEIRS, THEIRS_COLOUR)):
        rows = []
        for k, (north, east) in zip(missions, averaged(logs, missions, kind), strict=True):
            ends = [
                np.add(fix, (0.0, turn)) for fix, turn in zip(logs.fixes(k), turns[k], strict=True)
            ]
            ends = [fix for fix in ends if np.isfinite(fix).all()]
            if ends and np.isfinite(north) and np.isfinite(east):
                rows.append((*np.mean(ends, axis=0), north, east))
        if rows:
            latitude, longitude, north, east = np.array(rows).T
            found.append(
                Currents(latitude=latitude, longitude=longitude, north=north, east=east,
                         name=_label(logs, kind), colour=colour)
            )  # fmt: skip
    return tuple(found)


def averaged(logs: LogStore, missions: list[int], kind: str) -> Array:
    """Read depth-averaged currents of dives, north and east [m/s], (dives, 2); NaN if unknown.

    Args:
      kind: OURS, computed from sink rate, pitch and fixes; THEIRS, reported by the vehicle or its
        base station; or PROFILER, the mean of a current profiler over the dive.
    """
    if kind == PROFILER:
        names = [f"true_current_{name}" for name in AXES]
        return np.array([[_average(logs.signal(n, k), np.mean) for n in names] for k in missions])
    prefix = {OURS: "dac", THEIRS: "vehicle_dac"}[kind]
    return np.stack([logs.number(f"{prefix}_{name}")[missions] for name in AXES], axis=1)


def current_errors(logs: LogStore, missions: list[int]) -> dict[str, float]:
    """Compute the RMS error [m/s] of each source of current, relative to the profiler.

    Only dives with currents of all sources count; the result is empty without a profiler.
    """
    truth = averaged(logs, missions, PROFILER)
    kinds = {kind: averaged(logs, missions, kind) for kind in (OURS, THEIRS)}
    kinds = {kind: values for kind, values in kinds.items() if np.isfinite(values).any()}
    common = np.isfinite([truth, *kinds.values()]).all(axis=(0, 2))
    if not common.any():
        return {}
    return {
        _label(logs, kind): float(np.sqrt(np.mean(np.sum((values - truth)[common] ** 2, axis=1))))
        for kind, values in kinds.items()
    }


def _label(logs: LogStore, kind: str) -> str:
    """Name of a source of currents for labels."""
    if kind == THEIRS:
        return BASE_STATION if "seaglider" in logs.source else VEHICLE
    return kind


def _draw_depths(axes: Axes, logs: LogStore, missions: list[int]) -> None:
    deepest = 0.0
    known = [k for k in missions if np.isfinite(logs.signal("measured_depth", k)).any()]
    axes.set_title("depth of all dives")
    if not known:  # a log whose rows are no dives may lack depths
        style.say_instead(axes, "not in the log")
        return
    for k in known:
        depth, gap = logs.signal("measured_depth", k), logs.signal("measured_gap", k) > 0.0
        deepest = max(deepest, float(np.nanmax(depth)))
        date = np.asarray(date2num(np.round(logs.time(k) * 1e3).astype("datetime64[ms]")))
        axes.plot(*style.thin(date, depth, most=POINTS), color=DIVE, lw=0.7)
        if gap.any():
            axes.plot(date, np.where(gap, depth, np.nan), color=CLIMB, lw=1.3)
    style.depth_axis(axes, deepest)
    if any((logs.signal("measured_gap", k) > 0.0).any() for k in missions):
        axes.plot([], [], color=CLIMB, lw=1.3, label="bridged gap of the log")
        style.legend_above(axes, 1, 1.0)
    draw_dates(axes, 0.0, DAY)
    axes.margins(x=0.01)
    axes.set_xlabel(LABEL)


def _draw_figures(grid: NDArray[Any], logs: LogStore, missions: list[int]) -> None:
    """Draw six small panels over the number of the dive."""
    dive = logs.number("dive")[missions]
    if len(set(dive)) < len(dive):  # the vehicle's own numbers repeat: count the dives
        dive = np.arange(len(missions), dtype=float)
    columns = dive_figures(logs, missions)
    panels = (
        ("deepest", "[m]", (("deepest", "", DIVE),)),
        ("duration", "[min]", (("duration", "", DIVE),)),
        ("vertical speed, median", "[cm/s]", (("sink", "dive", DIVE), ("rise", "climb", CLIMB))),
        ("pitch, median", "[°]", (("pitch_down", "dive", DIVE), ("pitch_up", "climb", CLIMB))),
        ("speed between fixes", "[m/s]", (("over_ground", "over ground", DIVE),)),
        ("current", "[m/s]", (
            ("current_ours", "ours", OURS_COLOUR),
            ("current_theirs", _label(logs, THEIRS), THEIRS_COLOUR),
            ("current_profiler", PROFILER, style.COMMAND),
        )),
    )  # fmt: skip
    for axes, (title, unit, entries) in zip(grid.flat, panels, strict=True):
        shown = [e for e in entries if np.isfinite(columns[e[0]]).any()]
        for name, label, colour in shown:
            axes.plot(dive, columns[name], "o-", ms=2.5, lw=0.7, color=colour, label=label)
        if not shown:
            axes.text(0.5, 0.5, "not in the log", transform=axes.transAxes, ha="center",
                      va="center", color=style.GUIDE)  # fmt: skip
            axes.set_yticks([])
        elif len(shown) > 1:
            style.legend_above(axes, len(shown), columnspacing=1.0)
        values = np.concatenate([columns[name] for name, _, _ in shown] or [np.array([np.nan])])
        if shown and np.nanmin(values) >= 0.0:
            axes.set_ylim(0.0, HEADROOM * float(np.nanmax(values)) or 1.0)
        axes.set_title(title)
        axes.set_ylabel(unit)
        axes.margins(x=0.03)
    errors, last = current_errors(logs, missions), grid[-1, -1]
    if errors:
        text = ", ".join(f"{name} {value:.3f}" for name, value in errors.items())
        last.set_ylim(top=ERROR_HEADROOM * last.get_ylim()[1])
        last.text(
            0.99, 0.94, f"error against the profiler [m/s]: {text}", ha="right", va="top",
            transform=last.transAxes, fontsize=6.5,
        )  # fmt: skip
    for axes in grid[-1]:
        axes.set_xlabel("dive [number]")
        axes.xaxis.get_major_locator().set_params(integer=True)


def dive_figures(logs: LogStore, missions: list[int]) -> dict[str, Array]:
    """Compute figures of dives, each (dives,); NaN if the log lacks the data.

    Returns:
      deepest [m], duration [min], sink and rise [cm/s] and pitch_down, pitch_up [degree] as
      medians over descent and climb, over_ground [m/s] between the fixes, current_ours,
      current_theirs and current_profiler [m/s] as in `averaged`.
    """
    names = "deepest", "sink", "rise", "pitch_down", "pitch_up"
    found: dict[str, list[float]] = {name: [] for name in names}
    for k in missions:
        depth, phase = logs.signal("measured_depth", k), logs.signal("measured_phase", k)
        known = logs.signal("measured_gap", k) == 0.0
        rate = np.gradient(depth, logs.period)
        pitch = logs.signal("measured_pitch", k)
        deepest = float(np.nanmax(depth)) if np.isfinite(depth).any() else np.nan
        found["deepest"].append(deepest)
        for flag, speed, angle in ((1.0, "sink", "pitch_down"), (2.0, "rise", "pitch_up")):
            there = (phase == flag) & known
            found[speed].append(100.0 * abs(_average(rate[there])))
            found[angle].append(_average(pitch[there]))
    duration = logs.number(DIVE_DURATION)[missions]
    moved = [logs.number(f"displacement_{axis}")[missions] for axis in ("north", "east")]
    return {
        **{name: np.array(values) for name, values in found.items()},
        "duration": duration / 60.0,
        "over_ground": np.hypot(*moved) / duration,
        **{
            f"current_{kind}": np.hypot(*averaged(logs, missions, kind).T)
            for kind in (OURS, THEIRS, PROFILER)
        },
    }


def _average(values: Array, of: Callable[[Array], Any] = np.median) -> float:
    """Median or mean of the finite values; NaN without any."""
    values = values[np.isfinite(values)]
    return float(of(values)) if values.size else float("nan")
