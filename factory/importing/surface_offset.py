"""Zero error of a depth sensor: what it shows at the surface is subtracted from the whole log."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import Channel, DeploymentLog
from factory.importing.gps_fixes import coasting, nearest
from factory.importing.plausibility import DiveRules
from factory.importing.seawater import pressure_of
from factory.importing.tally import Tally

Array = NDArray[np.float64]

_NEAR = 30.0
"""[s] A depth sample belongs to a fix so near to it."""
_PAUSE = 1800.0
"""[s] A longer time between fixes ends a stay at the surface."""
_FEWEST = 3
"""Depths that make a stay's median."""
_SPREAD = 0.5
"""[m] The middle half of a stay's depths, and stays that follow each other, agree so well."""
_WINDOW = 5
"""Stays whose median a stay is compared with."""
_PART = 0.5
"""More than this part of the stays must agree, or there is no offset."""
_LEAST, _MOST = 0.5, 15.0
"""[m] Smaller offsets are waves and the antenna's height; larger ones are another fault."""


@dataclasses.dataclass(frozen=True)
class Stay:
    """One stay at the surface."""

    time: float
    """[s] its middle"""
    depth: float
    """[m] median of what the log shows"""
    spread: float
    """[m] between the quartiles"""


def zeroed(log: DeploymentLog, rules: DiveRules, tally: Tally) -> DeploymentLog:
    """The log with depth and pressure below its own surface; what was taken off is counted.

    A sensor that was never zeroed, or drifts, shows some metres while the vehicle floats. The
    medians of the stays at the surface, known by GPS fixes or by the vehicle's own state, are
    joined by straight lines and taken off, when they agree with each other.

    Args:
      log: with `measured_depth`; `afloat` holds times at which the vehicle says that it floats.
    """
    depth = log.channel("measured_depth")
    if log.station or not len(depth):
        return log
    every = stays(log, depth, rules)
    if not every:
        return log
    shown = np.array([stay.depth for stay in every])
    if len(shown) > 1 and np.median(np.abs(np.diff(shown))) > _SPREAD:
        return log
    half = _WINDOW // 2
    around = np.array(
        [np.median(shown[max(0, k - half) : k + half + 1]) for k in range(len(shown))]
    )
    steady = np.array([stay.spread <= _SPREAD for stay in every])
    agree = steady & (np.abs(shown - around) <= _SPREAD)
    if agree.mean() <= _PART:
        return log
    offsets = shown[agree]
    middle = float(np.median(offsets))
    if not _LEAST <= abs(middle) <= _MOST:
        return log
    times = np.array([stay.time for stay in every])[agree]
    corrected = depth.values - np.interp(depth.time, times, offsets)
    low, high = float(offsets.min()), float(offsets.max())
    size = f"{middle:.2f} m" if high - low < 0.1 else f"{low:.2f} to {high:.2f} m"
    tally.add(
        "repaired", "measured_depth", len(depth),
        f"{log.deployment}: depth offset {size} at the surface, taken off",
    )  # fmt: skip
    pressure = pressure_of(
        corrected, float(np.median(log.fixes.latitude)) if len(log.fixes) else 0.0
    )
    channels = {
        **log.channels,
        "measured_depth": Channel(depth.time, corrected),
        "measured_pressure": Channel(depth.time, pressure),
    }
    return dataclasses.replace(log, channels=channels)


def stays(log: DeploymentLog, depth: Channel, rules: DiveRules) -> list[Stay]:
    """Stays at the surface with enough depths, in time order."""
    fixes = log.fixes.keep(~coasting(log.fixes, rules.coast_speed))
    times = np.unique(np.concatenate([fixes.time, log.channel("afloat").time]))
    at = nearest(depth.time, times)
    times = np.unique(at[np.abs(at - times) <= _NEAR])
    if not times.size:
        return []
    index = np.searchsorted(depth.time, times)
    shown = depth.values[index]
    breaks = [
        k + 1
        for k in range(len(times) - 1)
        if times[k + 1] - times[k] > _PAUSE
        or depth.values[index[k] : index[k + 1] + 1].max()
        > max(shown[k], shown[k + 1]) + rules.min_depth
    ]
    found = []
    for part in np.split(np.arange(len(times)), breaks):
        if len(part) < _FEWEST:
            continue
        low, high = np.percentile(shown[part], [25.0, 75.0])
        found.append(
            Stay(
                time=float(np.median(times[part])),
                depth=float(np.median(shown[part])),
                spread=float(high - low),
            )
        )
    return found
