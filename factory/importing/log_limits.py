"""Limits of a whole log, whatever its kind: what no place, sea or vehicle has is removed and told.

Readers clean the channels that they know; here are all the others, the reported currents, the
positions, and what the flight says of the unit of the pitch.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import LIMITS
from factory.importing.deployment_log import Channel, DeploymentLog, LoggedFixes
from factory.importing.plausibility import sinks_in_radian
from factory.importing.tally import Tally
from twin.records.schema import VARIABLES
from twin.records.schema.limits import recorded_limits

CURRENTS = (
    ("dac_north", "dac_east"),
    ("measured_current_north", "measured_current_east"),
)
"""Currents that vehicles report, as pairs"""
_OTHERS = {
    "onboard_north": "true_north", "onboard_east": "true_east",
    **{f"velocity_{axis}": "true_surge" for axis in ("north", "east", "down")},
}  # fmt: skip
"""Channels that a store does not hold as they are, and signals with the same limits"""
_WORDS = 3
"""Values by which sensors say that they have none"""
_MOST = 0.5
"""With more impossible values than this part, the rest is suspect too."""


def within_limits(log: DeploymentLog, tally: Tally) -> DeploymentLog:
    """The log as its reader made it, without impossible values; what is left of them is suspect."""
    _doubt_pitch(log, tally)
    log = _without_impossible_currents(log, tally)
    wrapped = {n: _wrapped(c) for n, c in log.auxiliary.items() if n.endswith("longitude")}
    fixes = log.fixes
    return dataclasses.replace(
        log,
        channels={
            name: kept
            for name, one in log.channels.items()
            if len(kept := _possible(name, one, log.deployment, tally))
        },
        auxiliary={
            n: _possible(n, c, log.deployment, tally)
            for n, c in {**log.auxiliary, **wrapped}.items()
        },
        magnetic_variation=_possible(
            "magnetic_variation", log.magnetic_variation, log.deployment, tally
        ),
        fixes=_on_earth(
            LoggedFixes(fixes.time, fixes.latitude, _east_of_greenwich(fixes.longitude)),
            log.deployment, tally,
        ),
    )  # fmt: skip


def _east_of_greenwich(longitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """Longitudes up to 360 degree as those of a store, from -180."""
    turned = (longitude > 180.0) & (longitude <= 360.0)
    return np.where(turned, longitude - 360.0, longitude) if turned.any() else longitude


def _wrapped(channel: Channel) -> Channel:
    return Channel(channel.time, _east_of_greenwich(channel.values))


def _limits(name: str) -> tuple[float, float]:
    """Lowest and highest value of a channel; without limits for what is no quantity."""
    for axis in ("latitude", "longitude"):
        if name.endswith(axis):
            return LIMITS[axis].low, LIMITS[axis].high
    if name == "magnetic_variation":
        return -180.0, 180.0
    if name in LIMITS:
        return LIMITS[name].low, LIMITS[name].high
    name = _OTHERS.get(name, name)
    return recorded_limits(name) if name in VARIABLES else (-np.inf, np.inf)


def _possible(name: str, channel: Channel, deployment: str, tally: Tally) -> Channel:
    low, high = _limits(name)
    bad = ~((channel.values >= low) & (channel.values <= high))
    if not bad.any():
        return channel
    tally.add("removed", name, int(bad.sum()), f"outside {low:g} to {high:g}")
    _doubt_rest(name, channel.time, channel.values, bad, deployment, tally)
    return Channel(channel.time[~bad], channel.values[~bad])


def _on_earth(fixes: LoggedFixes, deployment: str, tally: Tally) -> LoggedFixes:
    bad = np.zeros(len(fixes), bool)
    for axis, values in (("latitude", fixes.latitude), ("longitude", fixes.longitude)):
        bad |= ~((values >= LIMITS[axis].low) & (values <= LIMITS[axis].high))
    if not bad.any():
        return fixes
    tally.add("removed", "GPS fixes", int(bad.sum()), "no position on Earth")
    _doubt_rest("GPS fixes", fixes.time, fixes.latitude, bad, deployment, tally)
    return fixes.keep(~bad)


def _doubt_rest(
    subject: str,
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    bad: NDArray[np.bool_],
    deployment: str,
    tally: Tally,
) -> None:
    # a sensor that is off says one value, a wrong unit many
    if bad.mean() > _MOST and np.unique(values[bad]).size > _WORDS:
        tally.doubt(
            subject, "most of its values are impossible: another unit or quantity?",
            int(bad.sum()), deployment=deployment, start=float(time[bad].min()),
            end=float(time[bad].max()),
        )  # fmt: skip


def _doubt_pitch(log: DeploymentLog, tally: Tally) -> None:
    """Mark a log as suspect whose flight is that of its pitch in radian."""
    depth, pitch = log.channel("measured_depth"), log.channel("measured_pitch")
    depth = depth if len(depth) else log.channel("measured_pressure")  # a dbar is a metre here
    if not len(pitch) or not len(depth):
        return
    if np.percentile(np.abs(pitch.values), 99.0) > 0.5 * np.pi:
        return
    if sinks_in_radian(pitch.time, depth.at(pitch.time), pitch.values):
        tally.doubt(
            "measured_pitch", "the vehicle sinks and rises by its pitch in radian: another unit?",
            len(pitch), deployment=log.deployment,
        )  # fmt: skip


def _without_impossible_currents(log: DeploymentLog, tally: Tally) -> DeploymentLog:
    """The log without reported currents that no sea has; the dives that they are of are suspect."""
    channels, auxiliary = dict(log.channels), dict(log.auxiliary)
    limits = LIMITS["dac_north"]
    for pair in CURRENTS:
        bad = np.zeros(0)
        for name in pair:
            one = log.channel(name)
            wrong = ~((one.values >= limits.low) & (one.values <= limits.high))
            bad = np.union1d(bad, one.time[wrong])
        if not bad.size:
            continue
        for name in pair:
            one = log.channel(name)
            kept = ~np.isin(one.time, bad)
            place = channels if name in channels else auxiliary
            if name in place:
                place[name] = Channel(one.time[kept], one.values[kept])
        times = np.union1d(log.channel(pair[0]).time, log.channel(pair[1]).time)
        wrong = np.isin(times, bad)
        before = np.concatenate([[-np.inf], times[:-1]])[wrong]
        for k, (start, end) in enumerate(zip(before, times[wrong], strict=True)):
            tally.doubt(
                " and ".join(pair), f"a current of more than {limits.high:g} m/s: no sea has it",
                0 if k else len(bad), deployment=log.deployment, start=start, end=end,
            )  # fmt: skip
    return dataclasses.replace(log, channels=channels, auxiliary=auxiliary)
