"""Signals against time: shared helpers, and figures of sensors, moving parts and velocities.

The sensor figure has measured and true signals and their differences. The actuator figure has
command and position of the parts, attitude and setpoints. The velocity figure has surge, sway and
heave through the water, and the speed over ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MultipleLocator
from numpy.typing import NDArray

from twin.errors import InputError, UnknownName
from twin.records.logged import MEASURED, LoggedTrajectory, source_of
from twin.records.schema import HYDROGRAPHY, LOGGED_ONLY, SIMULATED, variable
from twin.records.trajectory import Trajectory
from twin.sensors import SENSORS, Sensor
from twin.show import style
from twin.show.figures.base import FigureKind

Array = NDArray[np.float64]

STACK_HEIGHT = 1.0  # [in] height of one panel in a stack that shares its time axis
HEADING_STEPS, MOST_TICKS = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0), 4
"""HEADING_STEPS: [degree] between ticks of a heading. MOST_TICKS: maximum number of steps"""
UNIT_TEXT = {
    "degree": "°", "m s-1": "m/s", "m s-2": "m/s²", "rad s-1": "rad/s", "cm3": "cm³",
    "kg m-3": "kg/m³", "degree_Celsius": "°C",
}  # fmt: skip
"""Units of the schema and their texts in figures."""
WORDS = {"dvl": "DVL", "gps": "GPS", "onboard": "on-board"}  # words of signals and their titles
DEFAULT = (
    *("pitch", "roll", "heading", "depth", "yaw_rate", "specific_force_x", "temperature"),
    *("dvl_surge", "onboard_north", "onboard_east"),
)
"""Signals shown by default, if the trajectory has them."""
MOST_SHOWN = 6  # most signals shown if the trajectory has no signal of DEFAULT
ABOVE_TITLE = 1.2
"""Lower edge of the legend, in heights of the first axes: above the title of a narrow figure"""
ATTITUDE = ("pitch", "heading")


def stack(panels: int, *, height: float) -> tuple[Figure, list[Axes]]:
    """Make a column of panels that share the time axis; call this inside `style.styled()`."""
    figure = style.new_figure(height=0.45 + height * panels)
    return figure, list(figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0])


def draw_lines(
    axes: Axes,
    trajectory: Trajectory,
    entries: Sequence[tuple[str, str, str]],
    *,
    factor: float = 1.0,
    unwrap: bool = False,
) -> None:
    """Draw signals against time: `entries` are (signal, label, colour); commands are dashed."""
    time, seconds, _ = thinned_time(trajectory)
    centre = circular_mean(trajectory[entries[-1][0]]) if unwrap else 0.0
    for name, label, colour in entries:
        (values,) = style.thin(trajectory[name])
        values = centred_line(values, centre) if unwrap else values
        look: dict[str, Any] = {"lw": 1.2, "ls": "-", "zorder": 2}
        if name.startswith("commanded_"):
            look = {"lw": 0.9, "ls": (0, (4, 2)), "zorder": 3}
        axes.plot(time / seconds, values * factor, color=colour, label=label, **look)
    axes.set_xlim(time[0] / seconds, time[-1] / seconds)
    if unwrap:
        low, high = axes.get_ylim()
        step = next((s for s in HEADING_STEPS if (high - low) / s <= MOST_TICKS), HEADING_STEPS[-1])
        axes.yaxis.set_major_locator(MultipleLocator(step))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value % 360.0:g}"))


def circular_mean(heading: Array) -> float:
    """[degree] Mean direction of the finite values; 0 without any."""
    finite = np.radians(heading[np.isfinite(heading)])
    if not finite.size:
        return 0.0
    return float(np.degrees(np.arctan2(np.sin(finite).mean(), np.cos(finite).mean())))


def centred_line(heading: Array, centre: float) -> Array:
    """Wrap headings [degree] to within 180 of `centre`, so that a northward flight has no jumps.

    A sample after a remaining jump, opposite to the centre, becomes NaN.
    """
    values = centre + (np.asarray(heading, float) - centre + 180.0) % 360.0 - 180.0
    values[1:][np.abs(np.diff(values)) > 180.0] = np.nan
    return values


def thinned_time(trajectory: Trajectory) -> tuple[Array, float, str]:
    """Time [s] of thinned signals, seconds per shown unit, and the unit's name."""
    (time,) = style.thin(trajectory.time)
    return time, *style.time_unit(time)


def unit_text(units: str) -> str:
    """Text of a unit of the schema for figures, in brackets."""
    return f"[{UNIT_TEXT.get(units, units)}]"


def truth_of(name: str, trajectory: Trajectory) -> Array | None:
    """True signal that `measured_<name>` observes; None if there is none.

    The sensor's class names its true signal; a signal of real vehicles only has `true_<name>`.
    None too where a log takes the measured signal itself as the true one, so that a comparison
    would mean nothing.
    """
    if source_of(trajectory, f"true_{name}", "") == MEASURED:
        return None
    return _sensor_of(name).observed(name, trajectory)


def _sensor_of(name: str) -> type[Sensor]:
    written = f"measured_{name}"
    found = (s for s in SENSORS.values() if any(entry.name == written for entry in s.writes))
    return next(found, Sensor)


def _of_ones_own(name: str, trajectory: Trajectory) -> bool:
    """Return True if a user's own sensor measures a signal, which is then always shown.

    A store keeps such signals; the sensor itself need not be registered in this process.
    """
    sensor = _sensor_of(name)
    if sensor is not Sensor:
        return sensor.name not in SENSORS.shipped()
    shipped = {*SIMULATED, *HYDROGRAPHY, *LOGGED_ONLY}
    return f"measured_{name}" not in shipped and f"true_{name}" not in trajectory


def sensor_figure(trajectory: Trajectory, names: tuple[str, ...] = ()) -> Figure:
    """Draw measured and true signals, and beside them their difference, one row per signal.

    Args:
      names: signals without their prefix, e.g. ("pitch", "depth"); empty shows DEFAULT.

    Raises:
      InputError: the trajectory has no measured signals. UnknownName: it lacks a named signal.
    """
    have = [n.removeprefix("measured_") for n in trajectory.signals if n.startswith("measured_")]
    have = [n for n in have if truth_of(n, trajectory) is not None or _of_ones_own(n, trajectory)]
    logged = isinstance(trajectory, LoggedTrajectory)
    if logged:  # a log's track goes through its fixes: a difference would mean nothing
        have = [n for n in have if not n.startswith("gps_")]
    if not have:
        raise InputError(
            "a log has no truth to compare its sensors with; the log figure shows what it measured"
            if logged
            else "this trajectory has no measured signals: simulate it with sensors"
        )
    for name in names:
        if name not in have:
            raise UnknownName("measured signal", name, have)
    usual = [n for n in have if _of_ones_own(n, trajectory)]
    shown = list(names) or [n for n in DEFAULT if n in have] + usual or have[:MOST_SHOWN]
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 0.5 + 0.95 * len(shown))
        axes = figure.subplots(len(shown), 2, sharex=True, squeeze=False)
        time, seconds, unit = thinned_time(trajectory)
        time = time / seconds
        for (left, right), name in zip(axes, shown, strict=True):
            values, truth = trajectory[f"measured_{name}"], truth_of(name, trajectory)
            measured, true = style.thin(values, values if truth is None else np.asarray(truth))
            error = np.full(len(measured), np.nan) if truth is None else measured - true
            units = variable(f"measured_{name}").units
            if units == "degree":  # the short way round
                error = (error + 180.0) % 360.0 - 180.0
            sparse = bool(np.isnan(measured).mean() > 0.5)
            mark = {"marker": ".", "ms": 2.5, "ls": "none"} if sparse else {"lw": 0.8}
            if truth is not None:  # in a log, the label names the signal that replaces the truth
                bare = name.removeprefix("gps_").removeprefix("onboard_").removeprefix("dvl_")
                word = source_of(trajectory, f"true_{bare}", "true")
                left.plot(time, true, color=style.TRUTH, lw=2.2, label=word)
            left.plot(time, measured, color=style.ESTIMATE, label="measured", **mark)
            right.axhline(0.0, color=style.GUIDE, lw=0.7)
            right.plot(time, error, color=style.ESTIMATE, **mark)
            for panel in (left, right):
                panel.set_ylabel(unit_text(units))
            left.set_title(" ".join(WORDS.get(w, w) for w in name.split("_")))
            finite = error[np.isfinite(error)]
            spread = "none" if truth is not None else "no true signal"
            if len(finite):
                spread = f"mean {finite.mean():.3g}, std {finite.std():.3g}"
            what = "difference" if logged else "measured − true"
            right.set_title(f"{what}: {spread}", fontweight="normal")
            if logged or left is axes[0, 0]:  # in logs each row may have another reference
                style.legend_above(left, 2, 1.2 if logged else 0.98)
        axes[0, 0].set_xlim(time[0], time[-1])
        for panel in axes[-1]:
            style.label_mission_time(panel, trajectory, seconds, unit)
        figure.align_ylabels()
    return figure


SENSOR_FIGURE = FigureKind(
    "sensor", "each measured signal over the true one, and the difference", sensor_figure
)


def actuator_figure(trajectory: Trajectory) -> Figure:
    """Draw command and position of every part of the vehicle, attitude and its setpoints."""
    parts = len(trajectory.actuators)
    with style.styled():
        figure, axes = stack(parts + len(ATTITUDE), height=0.92)
        draw_actuators(axes[:parts], trajectory, legend_at=ABOVE_TITLE)
        draw_attitude(axes[parts:], trajectory)
        style.label_mission_time(axes[-1], trajectory, *thinned_time(trajectory)[1:])
        figure.align_ylabels()
    return figure


def draw_actuators(axes: Sequence[Axes], trajectory: Trajectory, legend_at: float = 0.98) -> None:
    """Draw command and true position of the trajectory's parts, each part into its own axes.

    Args:
      legend_at: lower edge of the legend over the height of the first axes.
    """
    for panel, part in zip(axes, trajectory.actuators, strict=True):
        position = variable(f"true_{part}")
        slides = position.units == "m"
        word = source_of(trajectory, f"true_{part}", "")
        entries = [
            (f"commanded_{part}", "command", style.COMMAND),
            (f"true_{part}", word or "position", style.TRUTH),
        ]
        present = [entry for entry in entries if entry[0] in trajectory]  # logs lack some commands
        draw_lines(panel, trajectory, present, factor=1000.0 if slides else 1.0)
        panel.set_title(position.long_name.partition(",")[0])
        panel.set_ylabel("[mm]" if slides else unit_text(position.units))
    if len(axes):
        style.legend_above(axes[0], 2, legend_at, columnspacing=1.0)


def draw_attitude(axes: Sequence[Axes], trajectory: Trajectory) -> None:
    """Draw pitch and heading with their setpoints into two axes."""
    for panel, name in zip(axes, ATTITUDE, strict=True):
        entries = [(f"true_{name}", name, style.TRUTH)]
        setpoint = trajectory.signals.get(f"commanded_{name}")
        if setpoint is not None and np.isfinite(setpoint).any():
            entries.insert(0, (f"commanded_{name}", "setpoint", style.COMMAND))
        draw_lines(panel, trajectory, entries, unwrap=name == "heading")
        title = f"{source_of(trajectory, f'true_{name}', '')} {name}".strip()
        panel.set_title(title + " and its setpoint" * (len(entries) > 1))
        panel.set_ylabel("[°]")
        style.pad_limits(panel, least=2.0)


ACTUATORS = FigureKind(
    "actuator",
    "commands and positions of the vehicle's parts, attitude and its setpoints",
    actuator_figure,
)


def velocity_figure(trajectory: Trajectory) -> Figure:
    """Draw surge, sway and heave through the water, and the speed over ground."""
    titles = {"surge": "surge", "sway": "sway (starboard)", "heave": "heave (down)"}
    with style.styled():
        figure, axes = stack(4, height=0.95)
        for panel, (name, title) in zip(axes, titles.items(), strict=False):
            draw_lines(panel, trajectory, [(f"true_{name}", name, style.TRUTH)])
            word = source_of(trajectory, f"true_{name}", "through the water")
            panel.set_title(f"{title}, {word}")
            style.pad_limits(panel, least=0.01)
        over_ground = np.hypot(trajectory["true_velocity_north"], trajectory["true_velocity_east"])
        time, seconds, unit = thinned_time(trajectory)
        (speed,) = style.thin(over_ground)
        axes[-1].plot(time / seconds, speed, color=style.PALETTE["green"])
        track = source_of(trajectory, "true_velocity_north", "")
        title = f"speed over ground, {track}" if track else "horizontal speed over ground"
        axes[-1].set_title(title)
        for panel in axes:
            panel.set_ylabel("[m/s]")
        style.label_mission_time(axes[-1], trajectory, seconds, unit)
        figure.align_ylabels()
    return figure


VELOCITIES = FigureKind("velocity", "surge, sway, heave and the speed over ground", velocity_figure)
