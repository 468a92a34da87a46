"""Logs: what a store of real logs says beside its signals, and what its missing values mean.

A row is one dive. Truth is there only where a current profiler or a Doppler log was: elsewhere it
is missing, and a missing value is no sample to learn from or to be judged by. In simulated stores
a missing value stays an error.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError

Array = NDArray[np.float64]

REAL_ATTRIBUTE = "source_format"
"""Attribute of stores that `factory import` wrote."""
FOLLOWS_WITHIN = 3600.0
"""[s] between the end of a row and the start of the next for its current to be carried over."""
VEHICLE = "slocum"
"""Shipped vehicle that stands for the vehicles of logs, whose own file nobody has."""
SPEED = "true_speed"
"""Truth of a log with a Doppler log only."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogRow:
    """One dive of a log."""

    deployment: str
    start: float
    """[s] unix time of its first sample"""
    duration: float
    """[s] between its ends"""
    displacement: tuple[float, float] | None
    """North, east [m] over ground between its fixes; None without both."""

    def follows(self, before: LogRow) -> bool:
        """Whether it belongs to the same deployment and starts shortly after the other ends."""
        gap = self.start - (before.start + before.duration)
        return self.deployment == before.deployment and -1.0 <= gap < FOLLOWS_WITHIN


def is_real(attributes: Mapping[str, Any]) -> bool:
    """Whether these are the attributes of a store of real logs."""
    return REAL_ATTRIBUTE in attributes


def log_rows(dataset: Any, store: str | Path) -> list[LogRow]:
    """The rows of a store of logs.

    Raises:
      StoreError: it does not say which deployment a row belongs to or when it starts.
    """
    for name in ("deployment", "start_time"):
        if name not in dataset:
            raise StoreError(f"store {store} of logs has no array {name}; import the logs anew")

    def numbers(name: str) -> Array:
        if name not in dataset:
            return np.full(count, np.nan)
        return np.asarray(dataset[name].values, float)

    count = dataset.sizes["mission"]
    names = [str(name) for name in dataset["deployment"].values]
    start = dataset["start_time"].values.astype("datetime64[ns]").astype("i8") * 1e-9
    duration = numbers("dive_duration")
    moved = np.stack([numbers("displacement_north"), numbers("displacement_east")], axis=1)
    return [
        LogRow(
            deployment=names[k],
            start=float(start[k]),
            duration=float(duration[k]),
            displacement=(
                (float(moved[k, 0]), float(moved[k, 1])) if np.isfinite(moved[k]).all() else None
            ),
        )
        for k in range(count)
    ]


def filled(name: str, values: Array) -> Array:
    """A channel with holes bridged by straight lines; truth and fixes stay as they are.

    A channel without any value stays without.
    """
    if not name.startswith(("measured_", "commanded_")) or name.startswith("measured_gps"):
        return values
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    index = np.arange(len(values))
    if name.endswith("heading"):
        turned = np.unwrap(np.deg2rad(values[known]))
        return np.mod(np.rad2deg(np.interp(index, index[known], turned)), 360.0)
    return np.interp(index, index[known], values[known])


def nearest(values: Array, step: int) -> Array:
    """Every `step`-th sample or, where that is missing, the nearest one that is not nearer to
    another: a truth that comes every ten seconds is not lost between the samples."""
    kept = values[::step].copy()
    places = np.arange(0, len(values), step)
    for offset in sorted(range(-((step - 1) // 2), step // 2 + 1), key=abs):
        there = places + offset
        inside = (there >= 0) & (there < len(values)) & ~np.isfinite(kept)
        kept[inside] = values[there[inside]]
    return kept
