"""Scoring: predicted surge and sway of test missions compared with the truth; without torch.

`dr_velocity_percent` is the error at the end of the track through the water in % of the path; the
attitude is the true one, so that only surge and sway count. `surge_mse` is the mean squared error.
Scores begin after the dives that a method may adapt on. The interval is a bootstrap over missions.
`worse` counts missions that adaptation makes more than 5 % worse. `within` is the fraction of
samples whose error of surge is within the interval in which a method expects 68 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.dead_reckoning.predictions import INTERVAL, velocities_of
from benchmarks.dead_reckoning.tiers import DIVES
from twin.navigation.dead_reckoning import (
    Array,
    AttitudeSeries,
    depth_rate,
    find_dives,
    horizontal_velocity,
    integrate,
    true_water_path,
    true_water_track,
)
from twin.records.reader import MissionStore

CHANNELS = (
    "true_surge", "true_sway", "true_north", "true_east", "true_roll", "true_pitch", "true_heading",
    "true_velocity_north", "true_velocity_east", "true_current_north", "true_current_east",
    "measured_depth", "measured_gps_north", "measured_gps_east",
)  # fmt: skip
DRAWS = 2000
WORSE = 1.05
"""[1] Least error of a worse mission, as a multiple of its error without adaptation"""


def score(store: Path, dives: int, said: Mapping[int, xr.Dataset]) -> dict[str, dict[str, float]]:
    """Figures by the number of dives that a method adapted on; these dives are not scored.

    Args:
      dives: dives at a mission's start that are not scored; no method adapts on more.
      said: predictions by the number of dives adapted on, see `predictions`.

    Raises:
      InputError: predictions have other missions or samples, or are not finite.
    """
    percent, squared, within = mission_errors(store, dives, said)
    found = {}
    for adapted, each in percent.items():
        low, high = interval(each)
        total, count = np.sum(squared[adapted], axis=0)
        found[str(adapted)] = {
            "dr_velocity_percent": float(each.mean()), "low": low, "high": high,
            "surge_mse": float(total / count), "missions": float(each.size),
            "worse": float(np.sum(each > WORSE * percent[0])),
        }  # fmt: skip
        if adapted in within:
            found[str(adapted)]["within"] = float(np.mean(within[adapted]))
    # a method that does not adapt predicts the same after any number of dives
    return {str(d): found.get(str(d), found["0"]) for d in DIVES if d <= dives}


def interval(each: Array, over: Array | None = None) -> tuple[float, float]:
    """95 % interval by a bootstrap over missions of a mean, or of the ratio of two methods' means.

    Args:
      each: figure of each mission.
      over: figure of each mission by the other method, in the denominator.
    """
    low, high = np.percentile(drawn(each) / (1.0 if over is None else drawn(over)), (2.5, 97.5))
    return float(low), float(high)


def drawn(each: Array, seed: int = 0) -> Array:
    """Bootstrap samples of the mean over missions, (DRAWS,); equal numbers give equal choices."""
    places = np.random.default_rng(seed).integers(0, each.size, (DRAWS, each.size))
    return np.asarray(each[places].mean(1))


def mission_errors(
    store: Path, dives: int, said: Mapping[int, xr.Dataset]
) -> tuple[dict[int, Array], dict[int, list[tuple[float, int]]], dict[int, list[float]]]:
    """Errors of each mission with more than `dives` dives, by the number of dives adapted on: error
    at the end in %; sum of the squared errors of surge and their number; fraction within the
    method's 68 % interval, if any. Arguments and errors are those of `score`."""
    percent: dict[int, list[float]] = {d: [] for d in DIVES if d in said and d <= dives}
    squared: dict[int, list[tuple[float, int]]] = {d: [] for d in percent}
    within: dict[int, list[float]] = {d: [] for d in percent if INTERVAL in said[d]}
    with MissionStore(store) as reader:
        names = [name for name in CHANNELS if name in reader]
        for mission, samples in enumerate(reader.samples.tolist()):
            signals = {n: np.asarray(reader.row(n, mission), np.float64)[:samples] for n in names}
            ends = [0, *(dive.end for dive in find_dives(signals, reader.period))]
            if dives and len(ends) < dives + 2:
                continue  # the mission has no more dives
            begin = ends[dives]
            for adapted in percent:
                surge, sway = velocities_of(said[adapted], mission, samples)
                off = surge[begin:] - signals["true_surge"][begin:]
                squared[adapted].append((float(off @ off), off.size))
                percent[adapted].append(_percent(signals, reader.period, surge, sway, begin))
                if adapted in within:
                    own = said[adapted][INTERVAL].sel(mission=mission).values[begin:]
                    within[adapted].append(float(np.mean(np.abs(off) < own[: off.size])))
    return {dives: np.array(each) for dives, each in percent.items()}, squared, within


def _percent(
    signals: Mapping[str, Array], period: float, surge: Array, sway: Array, begin: int
) -> float:
    """Error at the end of the scored samples, in % of their path."""
    attitude = AttitudeSeries.of(signals, "true")
    rate = depth_rate(signals["measured_depth"], period)
    track = integrate(horizontal_velocity(surge, sway, rate, attitude), period)
    moved = track[-1] - track[begin]
    truth, path = true_water_track(signals, period), true_water_path(signals, period)
    return float(100.0 * np.hypot(*(moved - (truth[-1] - truth[begin]))) / (path[-1] - path[begin]))
