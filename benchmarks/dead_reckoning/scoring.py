"""Scoring: predicted surge and sway of test missions beside the truth. It needs no torch.

Scored are `dr_velocity_percent`, the error of the track through the water at the end over the path,
with the true attitude so that surge and sway alone count, and `surge_mse`; from where the dives
that a method may adapt on have ended. The interval is a bootstrap over missions. `worse` are the
missions that are more than 5 % worse than without adaptation; `within` is the share of a mission's
samples whose surge is as near to the truth as a method says of 68 %.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
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
"""times the error without adaptation"""


@dataclasses.dataclass(frozen=True)
class TestMission:
    """What one test mission truly did, and where its scored part begins."""

    index: int
    period: float
    signals: Mapping[str, Array]
    ends: tuple[int, ...]
    """Samples at which its dives ended, by a fix"""

    def begin(self, dives: int) -> int | None:
        """First sample after so many dives; None: it has no more than these."""
        if not dives:
            return 0
        return self.ends[dives - 1] if len(self.ends) > dives else None


def missions(store: Path) -> Iterator[TestMission]:
    """The test missions, one at a time."""
    with MissionStore(store) as reader:
        names = [name for name in CHANNELS if name in reader]
        for index, samples in enumerate(reader.samples.tolist()):
            signals = {n: np.asarray(reader.row(n, index), np.float64)[:samples] for n in names}
            dives = find_dives(signals, reader.period)
            yield TestMission(index, reader.period, signals, tuple(one.end for one in dives))


def score(store: Path, dives: int, said: Mapping[int, xr.Dataset]) -> dict[str, dict[str, float]]:
    """Figures by the dives that a method adapted on, of which none is scored.

    Args:
      dives: that a mission begins with before it is scored; more are not adapted on.
      said: predictions by those dives, as `predictions` has them.

    Raises:
      InputError: they are of other missions or samples, or not finite.
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
    # what did not adapt says the same after any dives
    return {str(d): found.get(str(d), found["0"]) for d in DIVES if d <= dives}


def interval(each: Array, over: Array | None = None) -> tuple[float, float]:
    """95 % of a bootstrap over missions: of the mean, or of its ratio to that of another method.

    Args:
      each: figure of each mission.
      over: of the other method, of the same missions.
    """
    low, high = np.percentile(drawn(each) / (1.0 if over is None else drawn(over)), (2.5, 97.5))
    return float(low), float(high)


def drawn(each: Array, seed: int = 0) -> Array:
    """Means over missions, (DRAWS,), of a bootstrap: of as many missions always the same ones."""
    places = np.random.default_rng(seed).integers(0, each.size, (DRAWS, each.size))
    return np.asarray(each[places].mean(1))


def mission_errors(
    store: Path, dives: int, said: Mapping[int, xr.Dataset]
) -> tuple[dict[int, Array], dict[int, list[tuple[float, int]]], dict[int, list[float]]]:
    """By the dives that a method adapted on, of each mission that has more than `dives`: the error
    at its end in %, the squared errors of surge with their number, and the share within what the
    method says of 68 %, if it does; arguments and errors as of `score`."""
    percent: dict[int, list[float]] = {d: [] for d in DIVES if d in said and d <= dives}
    squared: dict[int, list[tuple[float, int]]] = {d: [] for d in percent}
    within: dict[int, list[float]] = {d: [] for d in percent if INTERVAL in said[d]}
    for mission in missions(store):
        begin = mission.begin(dives)
        if begin is None:
            continue
        for adapted in percent:
            samples = len(mission.signals["true_surge"])
            surge, sway = velocities_of(said[adapted], mission.index, samples)
            off = surge[begin:] - mission.signals["true_surge"][begin:]
            squared[adapted].append((float(off @ off), off.size))
            percent[adapted].append(_percent(mission, surge, sway, begin))
            if adapted in within:
                own = said[adapted][INTERVAL].sel(mission=mission.index).values[begin:]
                within[adapted].append(float(np.mean(np.abs(off) < own[: off.size])))
    return {dives: np.array(each) for dives, each in percent.items()}, squared, within


def _percent(mission: TestMission, surge: Array, sway: Array, begin: int) -> float:
    """Error at the end of the scored part over its path, %."""
    signals, period = mission.signals, mission.period
    attitude = AttitudeSeries.of(signals, "true")
    rate = depth_rate(signals["measured_depth"], period)
    track = integrate(horizontal_velocity(surge, sway, rate, attitude), period)
    moved = track[-1] - track[begin]
    truth, path = true_water_track(signals, period), true_water_path(signals, period)
    return float(100.0 * np.hypot(*(moved - (truth[-1] - truth[begin]))) / (path[-1] - path[begin]))
