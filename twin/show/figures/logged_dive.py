"""Figure of a logged dive: measured signals of one dive, for stores without simulated truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.records.schema import variable
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.figures import signals
from twin.show.figures.base import FigureKind

Array = NDArray[np.float64]
GAP_COLOUR = "#F3E3B5"
"""Background colour of gaps: the log has no sample, and values are interpolated linearly"""
DEPTH_HEIGHT = 1.7  # [in] height of the panel that spans the page
RATE_WINDOW = 20.0
"""[s] Window of the vertical velocity: pressure steps vanish, inflections stay"""
UNDER_WATER = 2.0
"""[m] Smallest depth of samples that set the axes; above it, waves roll and pitch the vehicle."""
SHOWN, MARGIN = (0.3, 99.7), 0.08
"""SHOWN: percentiles under water that an axis covers. MARGIN: as a fraction of the axis"""
LOG, TWIN = "log", "twin"  # labels of the lines where both are drawn


class Panel(NamedTuple):
    """One panel: a signal, drawn with its command if there is one, and the look of its axis."""

    signal: str
    title: str
    unit: str
    least: float = 0.0
    """Smallest span of the axis, in the shown unit, so that noise stays small."""
    factor: float = 1.0
    circular: bool = False


PANELS = (
    Panel("measured_pitch", "pitch", "[°]", 4.0),
    Panel("measured_pump", "pumped volume", "[cm³]", 10.0),
    Panel("measured_roll", "roll, starboard down", "[°]", 4.0),
    Panel("measured_shift", "battery shift", "[mm]", 1.0, factor=1e3),
    Panel("measured_heading", "heading from true north", "[°]", 10.0, circular=True),
    Panel("measured_rotation", "battery rotation", "[°]", 4.0),
    Panel("measured_fin", "rudder", "[°]", 4.0),
    Panel("measured_temperature", "temperature", "[°C]", 0.5),
    Panel("measured_salinity", "salinity (PSS-78)", "[1]", 0.2),
    Panel("measured_density", "density", "[kg/m³]", 0.5),
    Panel("true_speed", "speed through the water (DVL or ADCP)", "[m/s]", 0.1),
)
"""Panels in order of importance; panels without a value are left out."""
PHASE_COLOURS = {
    0.0: ("surface", style.GUIDE),
    1.0: ("descent", style.PALETTE["blue"]),
    2.0: ("climb", style.PALETTE["vermillion"]),
    3.0: ("inflection or level", style.PALETTE["black"]),
}
"""Name and colour of each flag of `measured_phase`."""


def log_figure(trajectory: Trajectory, beside: Trajectory | None = None) -> Figure:
    """Depth by phase over the page; below it vertical velocity and all logged signals, in pairs.

    Gaps of the log are shaded in every panel. Axes cover the samples under water.

    Args:
      trajectory: the log.
      beside: a flight of the twin to draw over the log; its signals have the log's names
        (measured_*), and its time is on the log's clock.
    """
    both = [trajectory] if beside is None else [trajectory, beside]
    shown = [
        panel
        for panel in (*PANELS, *_other_parts(trajectory))
        if any(has_values(one, panel.signal) for one in both)
    ]
    rows = -(-(len(shown) + 1) // 2)
    with style.styled():
        height = 0.45 + DEPTH_HEIGHT + signals.STACK_HEIGHT * rows
        figure = style.new_figure(style.PAGE_WIDTH, height)
        ratios = [DEPTH_HEIGHT, *[signals.STACK_HEIGHT] * rows]
        grid = figure.add_gridspec(rows + 1, 2, height_ratios=ratios)
        top = figure.add_subplot(grid[0, :])
        _depth(top, trajectory, beside)
        places = [figure.add_subplot(grid[1 + k // 2, k % 2], sharex=top)
                  for k in range(len(shown) + 1)]  # fmt: skip
        _vertical_speed(places[0], trajectory, beside)
        for place, panel in zip(places[1:], shown, strict=True):
            _draw(place, trajectory, panel, beside)
        _, seconds, unit = signals.thinned_time(trajectory)
        time, gap = trajectory.time, trajectory.signals.get("measured_gap", np.zeros(0))
        half = 0.5 * float(np.median(np.diff(time))) if len(gap) > 1 else 0.0
        for first, last in gap_spans(gap):
            ends = (time[first] - half) / seconds, (time[last] + half) / seconds
            for place in (top, *places):
                place.axvspan(*ends, color=GAP_COLOUR, lw=0, zorder=0)
        for place in places[:-2]:
            place.tick_params(labelbottom=False)
        for place in (top, *places[-2:]):  # the wide panel has a time axis of its own length
            style.label_mission_time(place, trajectory, seconds, unit)
        figure.align_ylabels()
    return figure


def _other_parts(trajectory: Trajectory) -> list[Panel]:
    """Panels for the vehicle's parts that are measured and commanded but missing from PANELS."""
    known = {panel.signal for panel in PANELS} | {"measured_depth"}
    found = [
        variable(name)
        for name in trajectory
        if name.startswith("measured_")
        and name not in known
        and name.replace("measured_", "commanded_", 1) in trajectory
    ]
    return [
        Panel(one.name, one.long_name.partition(",")[0], signals.unit_text(one.units))
        for one in found
    ]


def has_values(trajectory: Trajectory, name: str) -> bool:
    """Return True if the dive has any value of a signal."""
    values = trajectory.signals.get(name)
    return values is not None and bool(np.isfinite(values).any())


def robust_limits(values: Array, depth: Array, least: float) -> tuple[float, float] | None:
    """Range of an axis that covers the samples under water; None without a value.

    Args:
      values: samples in the shown unit, (time,).
      depth: [m] depth of the samples, (time,).
      least: least span of the range.
    """
    finite = np.isfinite(values)
    under = finite & (depth > UNDER_WATER)
    chosen = values[under] if under.any() else values[finite]
    if not chosen.size:
        return None
    low, high = (float(v) for v in np.percentile(chosen, SHOWN))
    span = max(high - low, least)
    middle = 0.5 * (low + high)
    reach = (0.5 + MARGIN) * span
    return middle - reach, middle + reach


def gap_spans(gap: Array) -> list[tuple[int, int]]:
    """First and last sample of each run of samples with a gap."""
    flag = np.concatenate([[False], gap > 0.0, [False]])
    edges = np.flatnonzero(np.diff(flag.astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _draw(axes: Axes, trajectory: Trajectory, panel: Panel, beside: Trajectory | None) -> None:
    entries = []
    if has_values(trajectory, panel.signal):
        entries.append((panel.signal, "measured" if beside is None else LOG, style.TRUTH))
    command = panel.signal.replace("measured_", "commanded_", 1)
    if command != panel.signal and not panel.circular and has_values(trajectory, command):
        entries.append((command, "command", style.COMMAND))
    if entries:
        signals.draw_lines(axes, trajectory, entries, factor=panel.factor, unwrap=panel.circular)
    if beside is not None and has_values(beside, panel.signal):
        values = panel.factor * beside[panel.signal]
        if panel.circular and entries:
            values = signals.centred_line(values, signals.circular_mean(trajectory[panel.signal]))
        _draw_beside(axes, trajectory, beside, values)
    if panel.circular:
        style.pad_limits(axes, least=panel.least)
    else:  # cover the samples under water of the log and of the twin's flight
        limits = [
            robust_limits(panel.factor * one[panel.signal], one["measured_depth"], panel.least)
            for one in (trajectory, beside)
            if one is not None and has_values(one, panel.signal)
        ]
        if known := [pair for pair in limits if pair is not None]:
            axes.set_ylim(min(low for low, _ in known), max(high for _, high in known))
    if len(axes.get_lines()) > 1 and not any(a.get_legend() for a in axes.figure.axes[1:]):
        style.legend_above(axes, 3)
    axes.set_title(panel.title)
    axes.set_ylabel(panel.unit)


def _draw_beside(axes: Axes, log: Trajectory, beside: Trajectory, values: Array) -> None:
    """Draw the twin's line over the log's, on the log's time scale."""
    seconds, _ = style.time_unit(log.time)
    time, shown = style.thin(beside.time, values)
    axes.plot(time / seconds, shown, color=style.ESTIMATE, lw=1.0, label=TWIN, zorder=2.5)


def _vertical_speed(axes: Axes, trajectory: Trajectory, beside: Trajectory | None) -> None:
    """Draw the rate of the measured depth, positive down, over a moving window."""
    time, seconds, _ = signals.thinned_time(trajectory)
    (shown,) = style.thin(100.0 * _depth_rate(trajectory))
    axes.plot(time / seconds, shown, color=style.TRUTH, label=LOG)
    if beside is not None:
        _draw_beside(axes, trajectory, beside, 100.0 * _depth_rate(beside))
        style.legend_above(axes, 2)
    axes.axhline(0.0, color=style.GUIDE, lw=0.7, zorder=1)
    axes.set_title("vertical speed, down")
    axes.set_ylabel("[cm/s]")
    style.pad_limits(axes, least=2.0)


def _depth_rate(trajectory: Trajectory) -> Array:
    """[m/s] Rate of the measured depth over RATE_WINDOW, (time,); NaN at the ends."""
    depth = trajectory["measured_depth"]
    period = float(np.median(np.diff(trajectory.time))) if len(depth) > 1 else 1.0
    half = max(1, round(0.5 * RATE_WINDOW / period))
    rate = np.full(len(depth), np.nan)
    if len(depth) > 2 * half:
        rate[half:-half] = (depth[2 * half :] - depth[: -2 * half]) / (2 * half * period)
    return rate


def _depth(axes: Axes, trajectory: Trajectory, beside: Trajectory | None) -> None:
    time, seconds, _ = signals.thinned_time(trajectory)
    (depth,) = style.thin(trajectory["measured_depth"])
    deepest = float(np.nanmax(depth))
    phase = trajectory.signals.get("measured_phase")
    axes.plot(time / seconds, depth, color=style.GUIDE, linewidth=0.6)
    if phase is not None and beside is not None:
        axes.plot(time / seconds, depth, color=style.TRUTH, label=LOG)
    elif phase is not None:
        (flags,) = style.thin(phase)
        for flag, (name, colour) in PHASE_COLOURS.items():
            there = flags == flag
            if there.any():
                axes.plot(time / seconds, np.where(there, depth, np.nan), color=colour, label=name)
    gap = trajectory.signals.get("measured_gap")
    if gap is not None and (gap > 0.0).any():
        axes.fill_between([], [], color=GAP_COLOUR, lw=0, label="gap of the log, bridged")
    axes.set_xlim(time[0] / seconds, time[-1] / seconds)
    if beside is not None:
        _draw_beside(axes, trajectory, beside, beside["measured_depth"])
        deepest = max(deepest, float(np.nanmax(beside["measured_depth"])))
    if axes.get_legend_handles_labels()[0]:
        style.legend_above(axes, 6, 1.0, columnspacing=1.0)
    style.depth_axis(axes, deepest, label=False)
    axes.set_title("depth")
    axes.set_ylabel("[m]")


FIGURE = FigureKind(
    "log",
    "what a real vehicle measured; drawn for `overview` where the truth is missing",
    log_figure,
)
