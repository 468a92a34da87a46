"""Figure: what an identified vehicle leaves unexplained, over depth, time and chance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.identify.answer import Identification
from twin.identify.log import Log
from twin.identify.speed import FlightModel, SpeedEstimate, estimate
from twin.plot import style

Array = NDArray[np.float64]

CENTIMETRES = 100.0
DEPTH_BINS = 20
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
        figure = style.new_figure(style.PAGE_WIDTH, 4.6)
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
    axes.plot(time, CENTIMETRES * measured, color=style.GUIDE, lw=0.7, label="measured")
    axes.plot(time, CENTIMETRES * model, color=style.ESTIMATE, lw=1.0, label="model")
    axes.set_title(f"Depth rate, mission {log.index}")
    axes.set_ylabel("depth rate [cm/s]")
    style.label_time(axes, unit)
    axes.legend(loc="center right")


def _depths(
    axes: style.Axes, logs: Sequence[Log], found: Sequence[SpeedEstimate], scale: float
) -> None:
    depth = np.concatenate([log.depth[log.use] for log in logs])
    rate = np.concatenate([log.depth_rate[log.use] for log in logs])
    residual = CENTIMETRES * np.concatenate([f.water_rise[f.use] for f in found])
    edges = np.linspace(0.0, depth.max(), DEPTH_BINS + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    for name, mask, colour in (
        ("dive", rate > 0, style.PALETTE["blue"]),
        ("climb", rate <= 0, style.PALETTE["orange"]),
    ):
        bins = np.digitize(depth[mask], edges[1:-1])
        values = [residual[mask][bins == k] for k in range(DEPTH_BINS)]
        quartiles = np.array(
            [np.percentile(v, [25, 50, 75]) if len(v) else [np.nan] * 3 for v in values]
        )
        axes.plot(quartiles[:, 1], middle, color=colour, label=name)
        axes.fill_betweenx(middle, quartiles[:, 0], quartiles[:, 2], color=colour, alpha=0.2, lw=0)
    axes.axvline(0.0, color=style.GUIDE, lw=0.7)
    style.depth_axis(axes, float(depth.max()))
    axes.set_xlim(-SHOWN * scale / 2, SHOWN * scale / 2)
    axes.set_xlabel("measured − model [cm/s]")
    axes.set_title("Median and quartiles over depth")
    axes.legend(loc="lower right")


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
    axes.plot(x, normal, color=style.PALETTE["black"], lw=0.9, label=f"normal, {scale:.2f} cm/s")
    axes.set_title(f"All samples under water: RMSE {rmse:.2f} cm/s")
    axes.set_xlabel("measured − model [cm/s]")
    axes.set_ylabel("density [s/cm]")
    axes.legend(loc="upper right")


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
    axes.set_title(f"Autocorrelation (integrated: {time:.0f} s)")
    axes.set_xlabel("lag [s]")
    axes.set_ylabel("correlation [1]")
    axes.set_xlim(0.0, LONGEST_LAG)


LONGEST_LAG = 300.0
"""[s] shown of the autocorrelation: half a dive of 100 m."""
