"""Sensors against truth: what was measured, what was true, and the difference."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import InputError
from twin.plot import style
from twin.plot.signals import thinned_time
from twin.records.schema import VARIABLES
from twin.records.trajectory import Trajectory

Array = NDArray[np.float64]

CIRCULAR = ("heading", "roll")
"""Signals [degree] whose differences are taken the short way round."""
UNIT_TEXT = {"degree": "°", "m s-1": "m/s", "m s-2": "m/s²", "rad s-1": "rad/s", "cm3": "cm³"}
"""How figures write the schema's units."""
TITLES = {
    "dvl_surge": "DVL surge",
    "dvl_sway": "DVL sway",
    "dvl_heave": "DVL heave",
    "gps_north": "GPS north",
    "gps_east": "GPS east",
    "onboard_north": "on-board north",
    "onboard_east": "on-board east",
}
DEFAULT = (
    "pitch",
    "roll",
    "heading",
    "depth",
    "yaw_rate",
    "specific_force_x",
    "dvl_surge",
    "onboard_north",
    "onboard_east",
)
"""Signals shown when none are named, those that the trajectory has."""


def truth_of(name: str, trajectory: Trajectory) -> Array | None:
    """The true signal that `measured_<name>` observes, or None when truth has no such signal."""
    axis = name.removeprefix("dvl_")
    if axis != name and f"true_{axis}" in trajectory.signals:
        through_water = trajectory[f"true_{axis}"]
        mode = trajectory.signals.get("measured_dvl_mode")
        if mode is None:
            return through_water
        return np.where(mode == 2, through_water, _over_ground(trajectory, axis))
    plain = name.removeprefix("gps_").removeprefix("onboard_")
    return trajectory.signals.get(f"true_{plain}")


def _over_ground(trajectory: Trajectory, axis: str) -> Array:
    from twin.frames import euler_to_matrix

    angles = (np.deg2rad(trajectory[f"true_{n}"]) for n in ("roll", "pitch", "heading"))
    velocity = np.stack(
        [trajectory[f"true_velocity_{n}"] for n in ("north", "east", "down")], axis=-1
    )
    body = np.einsum("tji,tj->ti", euler_to_matrix(*angles), velocity)
    return body[:, ("surge", "sway", "heave").index(axis)]


def sensor_figure(trajectory: Trajectory, names: tuple[str, ...] = ()) -> Figure:
    """Measured over true, and measured minus true beside it, one row per sensor.

    Args:
      names: signals without their prefix, e.g. ("pitch", "depth"); empty shows DEFAULT.

    Raises:
      InputError: the trajectory has no measured signals, or not the named one.
    """
    have = [n.removeprefix("measured_") for n in trajectory.signals if n.startswith("measured_")]
    have = [n for n in have if truth_of(n, trajectory) is not None]
    if not have:
        raise InputError("this trajectory has no measured signals: simulate it with sensors")
    for name in names:
        if name not in have:
            raise InputError(f"no measured signal {name!r} (present: {', '.join(sorted(have))})")
    shown = list(names) or [n for n in DEFAULT if n in have] or have[:6]
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 0.5 + 0.95 * len(shown))
        axes = figure.subplots(len(shown), 2, sharex=True, squeeze=False)
        time, seconds, unit = thinned_time(trajectory)
        time = time / seconds
        for (left, right), name in zip(axes, shown, strict=True):
            measured, true = style.thin(
                trajectory[f"measured_{name}"], np.asarray(truth_of(name, trajectory))
            )
            error = measured - true
            if name in CIRCULAR:
                error = (error + 180.0) % 360.0 - 180.0
            sparse = bool(np.isnan(measured).mean() > 0.5)
            mark = {"marker": ".", "ms": 2.5, "ls": "none"} if sparse else {"lw": 0.8}
            left.plot(time, true, color=style.TRUTH, lw=2.2, label="true")
            left.plot(time, measured, color=style.ESTIMATE, label="measured", **mark)
            right.axhline(0.0, color=style.GUIDE, lw=0.7)
            right.plot(time, error, color=style.ESTIMATE, **mark)
            units = VARIABLES[f"measured_{name}"].units
            for panel in (left, right):
                panel.set_ylabel(f"[{UNIT_TEXT.get(units, units)}]")
            left.set_title(TITLES.get(name, name.replace("_", " ")))
            finite = error[np.isfinite(error)]
            spread = f"mean {finite.mean():.2g}, std {finite.std():.2g}" if len(finite) else "none"
            right.set_title(f"measured − true: {spread}", fontweight="normal")
        axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, borderaxespad=0.1)
        axes[0, 0].set_xlim(time[0], time[-1])
        for panel in axes[-1]:
            style.label_time(panel, unit)
        figure.align_ylabels()
    return figure
