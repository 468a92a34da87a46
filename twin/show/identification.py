"""Identification figures: residuals of an identified vehicle, and the page of its log check.

The page has a table by phase, then dives with the twin drawn over the log.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.identify.answer import Identification
from twin.identify.log_check import LogCheck
from twin.identify.log_flight import legs_flown
from twin.identify.logged_missions import Log
from twin.identify.replayed_dive import PHASES, RUDDER, USUAL_NAMES, ReplayedDive, log_signal
from twin.identify.speed import FlightModel, SpeedEstimate, estimate
from twin.records.reader import MissionStore
from twin.records.store import read_trajectory
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.figures.logged_dive import log_figure
from twin.show.figures.page_layout import Page, mission_caption
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

CENTIMETRES = 100.0
DEPTH_BINS, LEAST_IN_BIN = 20, 10  # bins of depth, and least samples of a bin with quartiles
COVERED = 97.0  # percentile of the quartiles that the axis of residuals over depth covers
SHOWN, LONGEST_LAG = 5.0, 300.0
"""SHOWN: reach of the residual's axis in standard deviations. LONGEST_LAG: [s] of the
autocorrelation, half a dive to 100 m"""
MOST_DIVES = 6  # most dives that are drawn, evenly chosen from the checked dives


def residual_figure(
    identification: Identification, logs: Sequence[Log], *, mission: int | None = None
) -> Figure:
    """Draw the depth rate of one mission and the residuals of all missions.

    The panels are: measured and modelled depth rate of a mission (`mission` is an index of `logs`,
    by default that of the longest), residual over depth in descents and climbs, its distribution
    with a normal one of the stated standard deviation, and its autocorrelation.
    """
    flight: FlightModel = "steady" if identification.model == "steady" else "flight"
    estimates = [estimate(log, identification.calibration, flight) for log in logs]
    if mission is None:
        mission = int(np.argmax([int(log.use.sum()) for log in logs]))
    scale = CENTIMETRES * identification.robust_deviation
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 4.9)
        figure.suptitle(
            f"{identification.nominal.vehicle.name} fitted to {len(logs)} missions, "
            f"{identification.hours:.1f} h: what the {identification.model} model leaves",
            x=0.01, ha="left", fontsize=8.5,
        )  # fmt: skip
        (rates, depths), (spread, correlation) = figure.subplots(2, 2)
        residual = CENTIMETRES * np.concatenate([one.water_rise[one.use] for one in estimates])
        _rates(rates, logs[mission], estimates[mission])
        _depths(depths, logs, residual, scale)
        _spread(spread, residual, scale)
        _correlation(correlation, logs, estimates, identification.correlation_time)
    return figure


def _rates(axes: style.Axes, log: Log, found: SpeedEstimate) -> None:
    time: Array = np.arange(len(log.depth), dtype=float) * log.period
    seconds, unit = style.time_unit(time)
    shown = np.where(log.use, 1.0, np.nan)
    model = (log.depth_rate - found.water_rise) * shown
    scaled: Array = time / seconds
    time, measured, model = style.thin(scaled, log.depth_rate * shown, model)
    look: dict[str, Any] = {"color": style.ESTIMATE, "lw": 0.9, "ls": (0, (4, 1.5))}
    axes.plot(time, CENTIMETRES * measured, color=style.TRUTH, lw=1.6, label="measured")
    axes.plot(time, CENTIMETRES * model, label="model", **look)
    axes.axhline(0.0, color=style.GUIDE, lw=0.7, zorder=1)
    axes.set_title(f"Mission {log.index}")
    axes.set_ylabel("depth rate, down [cm/s]")
    style.label_time(axes, unit)
    style.legend_above(axes, 2, 0.98, columnspacing=1.0)


def _depths(axes: style.Axes, logs: Sequence[Log], residual: Array, scale: float) -> None:
    depth = np.concatenate([log.depth[log.use] for log in logs])
    rate = np.concatenate([log.depth_rate[log.use] for log in logs])
    edges = np.linspace(0.0, depth.max(), DEPTH_BINS + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    widest = 0.0
    for name, mask, colour in (
        ("dive", rate > 0, style.PALETTE["blue"]),
        ("climb", rate <= 0, style.PALETTE["orange"]),
    ):
        bins = np.digitize(depth[mask], edges[1:-1])
        values = [residual[mask][bins == k] for k in range(DEPTH_BINS)]
        full = [v if len(v) >= LEAST_IN_BIN else [np.nan] for v in values]
        quartiles = np.array([np.percentile(v, [25, 50, 75]) for v in full])
        axes.plot(quartiles[:, 1], middle, color=colour, label=name)
        axes.fill_betweenx(middle, quartiles[:, 0], quartiles[:, 2], color=colour, alpha=0.2, lw=0)
        finite = np.abs(quartiles[np.isfinite(quartiles).all(axis=1)])
        widest = max(widest, float(np.percentile(finite, COVERED)) if finite.size else 0.0)
    axes.axvline(0.0, color=style.GUIDE, lw=0.7)
    style.depth_axis(axes, float(depth.max()))
    reach = 1.15 * max(widest, scale)
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("measured − model, down [cm/s]")
    axes.set_title("Median, quartiles")
    style.legend_above(axes, 2, 0.98, columnspacing=1.0)


def _spread(axes: style.Axes, residual: Array, scale: float) -> None:
    rmse = float(np.sqrt(np.mean(residual**2)))
    reach = SHOWN * scale
    sky = style.PALETTE["sky"]
    axes.hist(residual, bins=80, range=(-reach, reach), density=True, color=sky, lw=0)
    x = np.linspace(-reach, reach, 200)
    normal = np.exp(-0.5 * (x / scale) ** 2) / (scale * np.sqrt(2 * np.pi))
    axes.plot(x, normal, color=style.PALETTE["black"], lw=0.9, label="normal distribution")
    beyond = 100.0 * float(np.mean(np.abs(residual) > reach))
    axes.set_title(f"All samples fitted: RMSE {rmse:.2f} cm/s")
    axes.set_xlabel(f"measured − model, down [cm/s]; {beyond:.1f} % lie outside")
    axes.set_ylabel("density [s/cm]")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(top=1.25 * axes.get_ylim()[1])  # room for the name above the curve
    axes.legend(loc="upper right", title=f"robust deviation {scale:.2f} cm/s", alignment="right")


def _correlation(
    axes: style.Axes, logs: Sequence[Log], found: Sequence[SpeedEstimate], time: float
) -> None:
    period = logs[0].period
    lags = max(1, round(LONGEST_LAG / period))
    total, weight = np.zeros(lags + 1), 0.0
    for log, one in zip(logs, found, strict=True):
        residual = np.where(log.use, one.water_rise, 0.0)
        reach = min(lags, len(residual) - 1)
        for lag in range(reach + 1):
            total[lag] += float(residual[: len(residual) - lag] @ residual[lag:])
        weight += float(residual @ residual)
    axes.plot(np.arange(lags + 1) * period, total / max(weight, 1e-30), color=style.ESTIMATE)
    axes.axhline(0.0, color=style.GUIDE, lw=0.7)
    axes.axvspan(0.0, time, color=style.GUIDE, alpha=0.15, lw=0)
    axes.set_title(f"Autocorrelation of the residual, time {time:.0f} s")
    axes.set_xlabel("lag [s]")
    axes.set_ylabel("correlation [1]")
    axes.set_xlim(0.0, LONGEST_LAG)


UNITS = {
    "depth_rate_m_s": "depth rate, down [m/s]",
    "speed_m_s": "speed through the water [m/s]",
    "pitch_deg": "pitch [deg]",
    "turn_per_actuator": "turn rate per actuator [deg/s per deg]",
    "turning_deg": "what turns it, mean [deg]",
    "heading_sd_deg": "heading about its target [deg]",
    "heading_bias_deg": "heading less its target, mean [deg]",
}
"""Labels of the compared quantities"""


def log_check_rows(found: LogCheck) -> list[dict[str, object]]:
    """Make the table's rows, one for each quantity of each phase: log, twin, ratio, difference."""
    phases = {name: found.phases[name].describe() for name in PHASES if name in found.phases}
    return [
        {
            "phase": phase,
            "figure": label,
            "log": said["log"][name],
            "twin": said["twin"][name],
            "twin/log": said["ratio"].get(name),
            "twin-log": said["deviation"].get(name),
        }
        for phase, said in phases.items()
        for name, label in UNITS.items()
    ]


def write_log_check(folder: Path, found: LogCheck, command: str = "") -> Path:
    """Write `index.html` and its figures as PNG into `folder`; return the page's path.

    Raises:
      InputError: the folder cannot be made.
    """
    page = Page(
        folder,
        f"{found.vehicle.name} beside its logs",
        f"{len(found.dives)} dives of {found.store.name}, flown by the twin in closed loop on the "
        "log's pitch, pump, turning depths and headings",
    )
    page.points(found.beyond or ["All figures are within their limits."])
    page.section("By phase")
    page.table(log_check_rows(found), "Means away from inflections and the surface.", first=False)
    if found.notes:
        page.points(found.notes)
    page.section("Dives")
    pairs = [
        (d, f) for d, f in zip(found.dives, found.flights, strict=True) if isinstance(f, Trajectory)
    ]
    step = max(1, -(-len(pairs) // MOST_DIVES))
    with MissionStore(found.store) as store:
        for dive, flight in pairs[::step]:
            flown = as_logged(dive, flight, found.vehicle, store)
            drawn = log_figure(read_trajectory(found.store, dive.row), flown)
            page.figure(f"dive-{dive.row}", drawn, mission_caption(store, dive.row))
    if command:
        page.section("Command")
        page.code(command)
    return page.write()


def as_logged(
    dive: ReplayedDive, flight: Trajectory, vehicle: Vehicle, names: Container[str]
) -> Trajectory:
    """Convert a flight of the twin to the log's clock and to the log's signal names, `names`."""
    begin = dive.period * dive.targets[0].leg.first
    signals = {
        f"measured_{name}": flight[f"true_{name}"] for name in ("depth", "pitch", "roll", "heading")
    }
    for part in vehicle.parts:
        name = log_signal(vehicle, part, names) or log_signal(vehicle, part, USUAL_NAMES)
        sense = part.sense("heading") if name == RUDDER else 1.0
        signals[name or f"measured_{part.name}"] = sense * flight[f"true_{part.name}"]
    flown = legs_flown(dive, flight) >= 0
    return Trajectory(
        time=flight.time[flown] + begin,
        signals={name: values[flown] for name, values in signals.items()},
        states=flight.states[flown, :0],
    )
