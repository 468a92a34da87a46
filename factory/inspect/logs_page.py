"""Logs page: a page on a deployment that a pilot reads: where, how deep, and how it flew."""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.plot import style
from twin.records.attributes import DIVE_DURATION
from twin.records.logs import LogStore

Array = NDArray[np.float64]

POINTS = 400
"""Samples of a dive that are drawn"""
HEIGHTS = (3.5, 1.9, 1.25, 1.25, 1.25)
"""[in] of map, depth, and three rows of figures of dives"""
NO_MAP = 0.6
"""[in] of the line that says that there is no map"""
ROUND_SPEEDS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""[m/s] lengths that the key of the arrows may have"""
HEADROOM = 1.12
"""Of axes that begin at 0, above the largest value"""
DIVE, CLIMB = style.PALETTE["blue"], style.PALETTE["vermillion"]


def deployment_page(logs: LogStore, deployment: str) -> Figure:
    """Map with depth-averaged currents, all depths over time, and figures of each dive."""
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
        _draw_map(top.add_subplot(), logs, missions)
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
        f"{deployment}{simulated}, {logs.platform}\n{len(missions)} dives, {hours:.4g} h logged, "
        f"{begin:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M} UTC"
    )


def _draw_map(axes: Axes, logs: LogStore, missions: list[int]) -> None:
    """Fixes and dives in longitude and latitude, arrows for the currents."""
    fixes = {k: logs.fixes(k) for k in missions}
    places = np.array([fix for pair in fixes.values() for fix in pair])
    known = np.isfinite(places).all(axis=1)
    axes.set_title("GPS fixes and dives")
    if not known.any():
        axes.text(0.5, 0.5, "no GPS fixes", transform=axes.transAxes, ha="center", va="center")
        axes.set_axis_off()
        return
    for k in missions:
        latitude, longitude, _ = logs.positions(k)
        if np.isfinite(latitude).any():
            la, lo = style.thin(latitude, longitude, most=POINTS)
            axes.plot(lo, la, color=style.GUIDE, lw=0.8, zorder=1)
        (a, b), (c, d) = fixes[k]
        if np.isfinite([a, b, c, d]).all():
            axes.plot([b, d], [a, c], color=DIVE, lw=1.0, ls=(0, (3, 2)), zorder=2.5)
    axes.plot(places[known, 1], places[known, 0], ".", ms=3.5, color=style.COMMAND, label="fix")
    first = int(np.argmax(known))
    last = len(known) - 1 - int(np.argmax(known[::-1]))
    for index, marker, label in ((first, "o", "start"), (last, "s", "end")):
        axes.plot(
            places[index, 1], places[index, 0], marker, ms=6, mfc="white", mec=style.COMMAND,
            mew=1.2, ls="none", label=label, zorder=4,
        )  # fmt: skip
    axes.plot([], [], color=DIVE, lw=0.8, ls=(0, (3, 2)), label="dive, fix to fix")
    axes.plot([], [], color=style.GUIDE, lw=0.8, label="dive, corrected at the fixes")
    middle = float(np.mean(places[known, 0]))
    axes.set_aspect(1.0 / np.cos(np.radians(middle)), adjustable="datalim")
    axes.margins(0.08)
    axes.set_xlabel("longitude [°]")
    axes.set_ylabel("latitude [°]")
    _draw_currents(axes, logs, missions)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


def _draw_currents(axes: Axes, logs: LogStore, missions: list[int]) -> None:
    """Depth-averaged current of each dive at the middle of its fixes, with a key."""
    rows = []
    for k in missions:
        start, end = logs.fixes(k)
        current = logs.current(k)
        ends = [fix for fix in (start, end) if np.isfinite(fix).all()]
        if ends and np.isfinite(current).all():
            place = np.mean(ends, axis=0)
            rows.append((place[1], place[0], current[1], current[0]))
    if not rows:
        return
    longitude, latitude, east, north = np.array(rows).T
    speeds = np.hypot(east, north)
    typical = max(float(np.percentile(speeds, 90)), ROUND_SPEEDS[0])
    # in degrees, so that the map's limits can make room for the tips
    shrink = np.cos(np.radians(float(np.mean(latitude))))
    limits = axes.dataLim
    length = max(limits.width * shrink, limits.height, LEAST_MAP) / ARROWS_ACROSS / typical
    along, up = length * east / shrink, length * north
    arrows = axes.quiver(
        longitude, latitude, along, up, color=CLIMB, angles="xy", scale_units="xy", scale=1.0,
        width=0.0028, zorder=3,
    )  # fmt: skip
    axes.update_datalim(np.column_stack([longitude + along, latitude + up]))
    axes.autoscale_view()
    key = max((s for s in ROUND_SPEEDS if s <= 1.5 * typical), default=ROUND_SPEEDS[0])
    axes.quiverkey(
        arrows, 1.11, 0.38, key * length / shrink, f"{key:g} m/s", labelpos="S", coordinates="axes",
        fontproperties={"size": 7.5},
    )  # fmt: skip
    axes.text(
        1.01, 0.44, "depth-averaged current", transform=axes.transAxes, fontsize=7.5, color=CLIMB
    )


LEAST_MAP = 1e-3
"""[degree of latitude] that arrows are measured against at least, where all fixes are one"""
ARROWS_ACROSS = 14.0
"""Arrows of the typical speed that would fit side by side"""


def _dates(logs: LogStore, mission: int) -> Array:
    moments = np.round(logs.time(mission) * 1e3).astype("datetime64[ms]")
    return np.asarray(date2num(moments))


def _draw_depths(axes: Axes, logs: LogStore, missions: list[int]) -> None:
    deepest = 0.0
    known = [k for k in missions if np.isfinite(logs.signal("measured_depth", k)).any()]
    axes.set_title("depth of all dives")
    if not known:  # a log whose rows are no dives may have none
        axes.text(0.5, 0.5, "not in the log", transform=axes.transAxes, ha="center", va="center")
        axes.set_axis_off()
        return
    for k in known:
        depth, gap = logs.signal("measured_depth", k), logs.signal("measured_gap", k) > 0.0
        deepest = max(deepest, float(np.nanmax(depth)))
        date = _dates(logs, k)
        axes.plot(*style.thin(date, depth, most=POINTS), color=DIVE, lw=0.7)
        if gap.any():
            bridged = np.where(gap, depth, np.nan)
            axes.plot(date, bridged, color=CLIMB, lw=1.3)
    style.depth_axis(axes, deepest)
    if any((logs.signal("measured_gap", k) > 0.0).any() for k in missions):
        axes.plot([], [], color=CLIMB, lw=1.3, label="bridged gap of the log")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    locator = AutoDateLocator(minticks=4, maxticks=10)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    axes.margins(x=0.01)
    axes.set_xlabel("time [UTC]")


def _draw_figures(grid: NDArray[Any], logs: LogStore, missions: list[int]) -> None:
    """Six small panels over the number of the dive."""
    dive = logs.number("dive")[missions]
    if len(set(dive)) < len(dive):  # several dives under one of the vehicle's numbers
        dive = np.arange(len(missions), dtype=float)
    columns = dive_figures(logs, missions)
    panels = (
        ("deepest", "[m]", (("deepest", "", DIVE),)),
        ("duration", "[min]", (("duration", "", DIVE),)),
        ("vertical speed, median", "[cm/s]", (("sink", "dive", DIVE), ("rise", "climb", CLIMB))),
        ("pitch, median", "[°]", (("pitch_down", "dive", DIVE), ("pitch_up", "climb", CLIMB))),
        ("speed between fixes", "[m/s]", (("over_ground", "over ground", DIVE),)),
        ("current, depth average", "[m/s]", (("current", "", CLIMB),)),
    )
    for axes, (title, unit, entries) in zip(grid.flat, panels, strict=True):
        shown = [e for e in entries if np.isfinite(columns[e[0]]).any()]
        for name, label, colour in shown:
            axes.plot(dive, columns[name], "o-", ms=2.5, lw=0.7, color=colour, label=label)
        if not shown:
            axes.text(0.5, 0.5, "not in the log", transform=axes.transAxes, ha="center",
                      va="center", color=style.GUIDE)  # fmt: skip
            axes.set_yticks([])
        elif len(shown) > 1:
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=2, borderaxespad=0.1)
        if shown and all(np.nanmin(columns[e[0]]) >= 0.0 for e in shown):
            axes.set_ylim(
                0.0, HEADROOM * max(float(np.nanmax(columns[e[0]])) for e in shown) or 1.0
            )
        axes.set_title(title)
        axes.set_ylabel(unit)
        axes.margins(x=0.03)
    for axes in grid[-1]:
        axes.set_xlabel("dive [number]")
        axes.xaxis.get_major_locator().set_params(integer=True)


def dive_figures(logs: LogStore, missions: list[int]) -> dict[str, Array]:
    """Figures of dives, each (dives,); NaN where the log cannot say.

    Returns:
      deepest [m], duration [min], sink and rise [cm/s] and pitch_down, pitch_up [degree] as
      medians over descent and climb, over_ground [m/s] between the fixes, current [m/s].
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
            found[speed].append(100.0 * abs(_median(rate[there])))
            found[angle].append(_median(pitch[there]))
    duration = logs.number(DIVE_DURATION)[missions]
    moved = [logs.number(f"displacement_{axis}")[missions] for axis in ("north", "east")]
    currents = np.array([logs.current(k) for k in missions])
    return {
        **{name: np.array(values) for name, values in found.items()},
        "duration": duration / 60.0,
        "over_ground": np.hypot(*moved) / duration,
        "current": np.hypot(*currents.T),
    }


def _median(values: Array) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else float("nan")
