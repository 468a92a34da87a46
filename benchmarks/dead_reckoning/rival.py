"""Rival: what a method of the benchmark is, and the table of its predictions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from benchmarks.dead_reckoning.predictions import INTERVAL, VELOCITIES, Predicted

ALL_DIVES = "all dives"
"""What a method adapts on that has seen the depths and fixes of the scored dives too"""
LABELS = ("none", "dvl", ALL_DIVES)


class Rival(NamedTuple):
    """A method."""

    predict: Callable[..., Predicted]
    labels: str = "none"
    """what it adapts on beside the glider's own sensors, of LABELS"""
    trained: bool = False
    """whether it reads the training store, and depends on the seed"""


def table(rows: Mapping[int, Mapping[str, Any]]) -> xr.Dataset:
    """Surge, sway and its interval, if any, by mission; shorter missions end in NaN."""
    longest = max(len(row["surge"]) for row in rows.values())
    names = [name for name in (*VELOCITIES, INTERVAL) if all(name in row for row in rows.values())]
    filled = {
        name: np.stack([np.pad(np.asarray(row[name], np.float32), (0, longest - len(row[name])),
                               constant_values=np.nan) for row in rows.values()])
        for name in names
    }  # fmt: skip
    data = {name: (("mission", "time"), values) for name, values in filled.items()}
    return xr.Dataset(data, coords={"mission": list(rows)})
