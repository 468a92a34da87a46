"""Computer of a vehicle: when it runs, by what it logs; science often has another one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import EMPTY, Channel, DeploymentLog
from factory.importing.dives.segments import LogSegment

Array = NDArray[np.float64]

ATTITUDE = ("measured_pitch", "measured_heading", "measured_roll")
DEEP = 10.0
"""[m], [dbar] No vehicle with a fix is so deep."""


def computer_of(log: DeploymentLog, segment: LogSegment) -> Channel:
    """What of a row shows that the vehicle's computer runs: what it logs, or an attitude that comes
    all the time; empty where nothing shows it."""
    for name in ("awake", *ATTITUDE):
        one = log.channel(name).within(segment.start, segment.end)
        if len(one) >= _FEWEST and not one.on_change:
            return one
    return EMPTY


def running(log: DeploymentLog, segment: LogSegment, times: Array) -> NDArray[np.bool_]:
    """When the vehicle's computer runs; always, where nothing shows it."""
    shown = computer_of(log, segment)
    if not len(shown):
        return np.ones(len(times), bool)
    return shown.covers(times) | floating(shown, log, segment, times)


def floating(
    channel: Channel, log: DeploymentLog, segment: LogSegment, times: Array
) -> NDArray[np.bool_]:
    """When a vehicle waits at the surface for the fix of a row's end, and says little: before the
    first and after the last sample of a channel."""
    floats = np.zeros(len(times), bool)
    depth = log.channel("measured_depth").within(segment.start, segment.end)
    inside = channel.within(segment.start, segment.end)
    if not len(depth) or not len(inside):
        return floats
    first, last = inside.time[0], inside.time[-1]
    if segment.start_fix is not None and depth.at(first) < DEEP:
        floats |= times < first
    if segment.end_fix is not None and depth.at(last) < DEEP:
        floats |= times > last
    return floats


_FEWEST = 20
"""Samples without which a channel shows nothing."""
