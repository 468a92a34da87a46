"""Figure: residuals of an identified vehicle over depth, over time and as a distribution."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.identify.answer import Identification
from twin.identify.logged_missions import Log
from twin.identify.speed import FlightModel, SpeedEstimate, estimate
from twin.show import style

Array = NDArray[np.float64]

CENTIMETRES = 100.0
DEPTH_BINS = 20
LEAST_IN_BIN = 10
"""Samples from which a depth has quartiles"""
COVERED = 97.0
"""Percentile of the quartiles that the axis of residuals over depth covers"""
SHOWN = 5.0
"""Deviations that the axes of residuals reach."""


def residual_figure(
    identification: Identification, logs: Sequence[Log], *, mission: int | None = None
) -> Figure:
    """Depth rate of one mission and residuals of all.

    Four panels: measured and modelled depth rate of a mission (the longest by default, `mission`
    is a position in `logs`), residual over depth in dives and climbs, its distribution beside the
    normal one of the stated deviation, and its autocorrelation.
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
        _rates(rates, logs[mission], estimates[mission])
        _depths(depths, logs, estimates, scale)
        _spread(spread, logs, estimates, scale)
        _correlation(correlation, logs, estimates, identification.correlation_time)
    return figure


def _rates(axes: style.Axes, log: Log, found: SpeedEstimate) -> None:
    time: Array = np.arange(len(log.depth), dtype=float) * log.period
    seconds, unit = style.time_unit(time)
    shown = np.where(log.use, 1.0, np.nan)
    model = (log.depth_rate - found.water_rise) * shown
    scaled: Array = time / seconds
    time, measured, model = style.thin(scaled, log.depth_rate * shown, model)
    axes.plot(time, CENTIMETRES * measured, color=style.TRUTH, lw=1.6, label="measured")
    axes.plot(
        time, CENTIMETRES * model, color=style.ESTIMATE, lw=0.9, ls=(0, (4, 1.5)), label="model"
    )
    axes.axhline(0.0, color=style.GUIDE, lw=0.7, zorder=1)
    axes.set_title(f"Mission {log.index}")
    axes.set_ylabel("depth rate, down [cm/s]")
    style.label_time(axes, unit)
    style.legend_above(axes, 2, 0.98, columnspacing=1.0)


def _depths(
    axes: style.Axes, logs: Sequence[Log], found: Sequence[SpeedEstimate], scale: float
) -> None:
    depth = np.concatenate([log.depth[log.use] for log in logs])
    rate = np.concatenate([log.depth_rate[log.use] for log in logs])
    residual = CENTIMETRES * np.concatenate([f.water_rise[f.use] for f in found])
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


def _spread(
    axes: style.Axes, logs: Sequence[Log], found: Sequence[SpeedEstimate], scale: float
) -> None:
    residual = CENTIMETRES * np.concatenate([f.water_rise[f.use] for f in found])
    rmse = float(np.sqrt(np.mean(residual**2)))
    reach = SHOWN * scale
    axes.hist(
        residual, bins=80, range=(-reach, reach), density=True, color=style.PALETTE["sky"], lw=0
    )
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


LONGEST_LAG = 300.0
"""[s] shown of the autocorrelation: half a dive of 100 m."""
