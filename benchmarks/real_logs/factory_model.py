"""Factory model: the speeds that a Seaglider's base station writes beside its samples.

Its flight model is tuned by the base station, trim on each dive by itself: what it is scored on
has been seen. Some of its speeds in inflections are straight lines between those before and after.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import minimum_filter1d

from benchmarks.real_logs.source import Deployment, tables_with
from twin.identify import Log
from twin.navigation.dead_reckoning import Array

COLUMN = "fm_vspeed_ms"
"""[m/s] upward, of a table"""
VARIABLE, CLOCK = "vert_speed", "ctd_time"
"""[cm/s] upward, and its times, of a file of the base station"""
LONGEST_GAP = 30.0
"""[s] between samples with a speed that are taken for neighbours"""


def factory_sink(deployment: Deployment, log: Log) -> Array | None:
    """Downward speed [m/s] of the factory's model at a log's samples, (time,), filtered as the
    log's depth rate is; NaN where it has no speed close by. None for a dive without any."""
    clock = deployment.clock(log)
    for time, rate in _speeds(deployment):
        known = np.isfinite(time) & np.isfinite(rate) & (rate != 0.0)  # 0: it found none
        known &= (time >= clock[0] - LONGEST_GAP) & (time <= clock[-1] + LONGEST_GAP)
        if known.sum() < log.window:
            continue
        when, first = np.unique(time[known], return_index=True)
        after = np.clip(np.searchsorted(when, clock), 1, len(when) - 1)
        close = (when[after] - when[after - 1] <= LONGEST_GAP) & (clock >= when[0])
        close &= clock <= when[-1]
        whole = minimum_filter1d(close.astype(np.int8), log.window) > 0
        sink = log.filtered(-np.interp(clock, when, rate[known][first]))
        return np.where(whole, sink, np.nan)
    return None


def _speeds(deployment: Deployment) -> Iterator[tuple[Array, Array]]:
    """Times [s] and upward speeds [m/s] of the deployment's tables and files."""
    for table in tables_with(deployment, COLUMN):
        yield table.columns["time"], table.columns[COLUMN]
    number = "".join(c for c in deployment.name if c.isdigit())
    for path in sorted(deployment.folder.glob(f"p{number}*.nc")):
        from netCDF4 import Dataset

        with Dataset(path) as file:
            if VARIABLE in file.variables and CLOCK in file.variables:
                time, rate = (
                    np.ma.filled(file[name][:].astype(float), np.nan) for name in (CLOCK, VARIABLE)
                )
                yield time, rate / 100.0
