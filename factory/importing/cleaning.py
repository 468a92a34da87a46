"""Cleaning: remove and count impossible values, spikes and positions of a log."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import Channel, DeploymentLog, LoggedFixes
from factory.importing.plausibility import (
    lone_zeros,
    runs,
    short_runs,
    sinks_in_radian,
    stale,
    unreachable,
)
from factory.importing.tally import Tally
from twin.records.schema import VARIABLES
from twin.records.schema.limits import recorded_limits

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a channel's values, in the channel's unit."""

    low: float
    high: float
    """Values outside low..high are not measurements (sentinels, sensor off)."""
    rate: float = float("inf")
    """Fastest possible change per second."""
    jump: float = float("inf")
    """Change that noise and quantisation can add to the possible change."""


LIMITS = {
    "measured_pressure": Limits(low=-20.0, high=12000.0, rate=2.0, jump=4.0),
    "measured_depth": Limits(low=-20.0, high=12000.0, rate=2.0, jump=4.0),
    "measured_pitch": Limits(low=-90.0, high=90.0, rate=20.0, jump=25.0),
    "measured_roll": Limits(low=-180.0, high=180.0, rate=60.0, jump=60.0),
    "measured_pump": Limits(low=-3000.0, high=3000.0, rate=100.0, jump=500.0),
    "measured_shift": Limits(low=-0.2, high=0.2),
    "measured_rotation": Limits(low=-180.0, high=180.0),
    "measured_fin": Limits(low=-90.0, high=90.0),
    "measured_temperature": Limits(low=-2.6, high=45.0, rate=2.0, jump=4.0),
    "measured_salinity": Limits(low=0.01, high=45.0, rate=2.0, jump=4.0),
    "measured_density": Limits(low=985.0, high=1090.0, rate=2.0, jump=5.0),
    "conductivity": Limits(low=0.02, high=9.0, rate=0.5, jump=1.0),
    "measured_charge": Limits(low=-1e4, high=1e5),
    "measured_voltage": Limits(low=2.0, high=500.0),
    "measured_battery_current": Limits(low=-100.0, high=500.0),
    "measured_pump_power": Limits(low=0.0, high=1e4),
    "measured_thruster_power": Limits(low=0.0, high=1e4),
    "measured_vacuum": Limits(low=-5e4, high=101_000.0),
    "dac_north": Limits(low=-3.0, high=3.0),
    "dac_east": Limits(low=-3.0, high=3.0),
    "latitude": Limits(low=-90.0, high=90.0),
    "longitude": Limits(low=-180.0, high=360.0),
}
"""Limits by channel. The ocean has 0 to 12 000 dbar, -2.6 to 45 degC, salinity up to 45, 985 to
1090 kg m-3. Gliders change depth by at most 2 m/s, and exceed no other rate for one sample only. A
battery is within 20 cm of its middle. A current averaged over a dive is below 3 m/s."""
CHAINED = frozenset({"measured_pressure", "measured_depth"})
"""Channels in which whole runs of unreachable samples are removed, not only single spikes."""
FRESH = frozenset({"measured_salinity", "conductivity"})
"""Channels that stay below their limits in a lake, although their unit is right."""
_MOST = 0.3
"""Fraction of unreachable samples beyond which long runs become suspect instead of removed."""
_SHORT = 20
"""Longest run [samples] that is still removed beyond `_MOST`."""
_RETURNED = 0.5
"""Largest difference between a spike's neighbours, as a fraction of the spike."""


def clean(name: str, time: Array, values: Array, tally: Tally, *, subject: str = "") -> Channel:
    """Make a channel of the finite and possible values; count the others.

    Depths and pressures that count upward are negated and counted. `time` increases strictly (see
    `factory.importing.columns.tidy`).
    """
    subject = subject or name
    if name in CHAINED:
        values = downward(values, subject, tally)
    if name == "measured_temperature":
        values = kelvin_to_celsius(values, subject, tally)
    there = np.isfinite(values)
    limits = LIMITS.get(name)
    if limits is None:
        return Channel(time[there], values[there])
    possible = (values >= limits.low) & (values <= limits.high)
    beyond = values > limits.high if name in FRESH else ~possible
    _doubt_unit(subject, time, values, there & beyond, there, tally)

    def keep(kept: NDArray[np.bool_], why: str) -> tuple[Array, Array]:
        tally.add("removed", subject, ~kept, why)
        return time[kept], values[kept]

    time, values = time[there], values[there]
    time, values = keep(possible[there], f"outside {limits.low:g} to {limits.high:g}")
    rate = {"rate": limits.rate, "jump": limits.jump}
    if not np.isfinite(limits.rate):
        return Channel(time, values)
    if name not in CHAINED:
        return Channel(*keep(~spikes(time, values, **rate), "single spikes"))
    why = "the last value again after a hole: no new one yet"
    time, values = keep(~stale(time, values, **rate), why)
    why = "0 in the middle of a dive: no value yet"
    time, values = keep(~lone_zeros(time, values, **rate), why)
    bad = unreachable(time, values, **rate)
    why = f"changes faster than {limits.rate:g} m/s"
    if bad.sum() > _MOST * len(bad):
        long = bad & ~short_runs(bad, _SHORT)
        for first, last in runs(long):
            tally.doubt(
                subject, f"{why}; too many to be removed", int(last - first),
                start=float(time[first]), end=float(time[last - 1]),
            )  # fmt: skip
        bad &= ~long
    time, values = keep(~bad, why)
    return Channel(*keep(~above_sea(values), f"more than {_WAVES:g} m above the sea"))


_WAVES = 5.0
"""[m], [dbar] Largest height above the sea of a sensor on a floating vehicle."""
_RARE, _OFTEN = 0.01, 0.05
"""Fractions of samples above the sea. Up to _RARE, all of them are removed; up to _OFTEN, only
short runs. Beyond, the sensor has an offset: it is subtracted if the log shows when the vehicle
floats, else reported."""
_RUN = 3
"""Longest short run [samples]."""
_UPWARD, _ABOVE = 2.0, 0.1
"""[m], [dbar] A column that counts upward spans more than `_UPWARD`. It rises above the sea by at
most half of `_UPWARD` plus the fraction `_ABOVE` of its greatest depth."""
_SENTINELS = 2
"""Minimum number of extreme values that are ignored at either end of a column as sentinels."""
_DIFFERENT = 10
"""Minimum number of different values that show in which direction a column counts."""


def above_sea(values: Array) -> NDArray[np.bool_]:
    """True for depths [m] or pressures [dbar] above the sea, unless the sensor has an offset."""
    high = values < -_WAVES
    few = short_runs(high, _RUN)
    if high.sum() <= max(1.0, _RARE * len(high)):
        return high
    return few if few.sum() <= _OFTEN * len(high) else np.zeros(len(high), bool)


def counts_upward(values: Array) -> bool:
    """True if depths or pressures count upward: hardly any of the values is positive.

    Each value counts once, so that a sentinel weighs no more than a measurement.
    """
    possible = np.abs(values) <= LIMITS["measured_depth"].high
    found = np.unique(values[np.isfinite(values) & possible])
    if found.size < _DIFFERENT:
        return False
    wrong = max(_SENTINELS, round(_RARE * found.size))
    low, high = found[wrong], found[-1 - wrong]
    return bool(high - low > _UPWARD and high < 0.5 * _UPWARD - _ABOVE * low and low < -_UPWARD)


def downward(values: Array, subject: str, tally: Tally) -> Array:
    """Depths or pressures that count down; a column that counts upward is negated and counted."""
    if not counts_upward(values):
        return values
    tally.add("repaired", subject, np.isfinite(values), "was positive up")
    return -values


_KELVIN, _COLDEST, _WARMEST = 273.15, 268.0, 318.0
"""[K] _KELVIN: 0 degC. _COLDEST, _WARMEST: limits of water temperature."""
_MEASURED = 0.9
"""Fraction of the different values that must be possible in kelvin; the rest may be sentinels."""
_FEWEST = 20


def kelvin_to_celsius(values: Array, subject: str, tally: Tally) -> Array:
    """Temperatures [degC]; values labelled degC that can only be kelvin are converted, counted."""
    different = np.unique(values[np.isfinite(values)])
    if different.size < _FEWEST:
        return values
    if np.mean((different > _COLDEST) & (different < _WARMEST)) < _MEASURED:
        return values
    tally.add("repaired", subject, np.isfinite(values), "was in K, not in degC")
    return values - _KELVIN


def _doubt_unit(
    subject: str,
    time: Array,
    values: Array,
    impossible: NDArray[np.bool_],
    there: NDArray[np.bool_],
    tally: Tally,
) -> None:
    """Mark a stretch as suspect if most of its different values are impossible: another unit."""
    wrong = np.unique(values[impossible]).size
    if wrong >= _FEWEST and wrong > 0.5 * np.unique(values[there]).size:
        _doubt_impossible(subject, time[impossible], "", tally)


def _doubt_impossible(subject: str, time: Array, deployment: str, tally: Tally) -> None:
    """Mark the stretch from the first to the last of these times [s] as suspect."""
    tally.doubt(
        subject, "most of its values are impossible: another unit or quantity?", len(time),
        deployment=deployment, start=float(time.min()), end=float(time.max()),
    )  # fmt: skip


def spikes(time: Array, values: Array, *, rate: float, jump: float) -> NDArray[np.bool_]:
    """True for single samples that differ too much from both neighbours.

    The differences exceed `rate` [unit/s] times the interval plus `jump`, and the neighbours agree
    with each other, so that a step is not taken for a spike.
    """
    bad = np.zeros(len(values), bool)
    if len(values) < 3:
        return bad
    step, gap = np.diff(values), np.diff(time)
    excess = np.abs(step) > jump + rate * gap
    out, back = step[:-1], step[1:]
    size = np.minimum(np.abs(out), np.abs(back))
    bad[1:-1] = (
        excess[:-1] & excess[1:] & (out * back < 0) & (np.abs(out + back) < _RETURNED * size)
    )
    return bad


def degrees_minutes(values: Array) -> Array:
    """Convert NMEA ddmm.mmm positions to decimal degrees."""
    whole = np.trunc(values / 100.0)
    return whole + (values - 100.0 * whole) / 60.0


_TURN = 360.0
"""[degree] One full turn."""


def _degrees_and_minutes(latitude: Array, longitude: Array) -> bool:
    """True if most positions are impossible as degrees and possible as ddmm.mmm.

    Each position counts once, so that a sentinel weighs no more than a fix.
    """
    places = np.unique(np.abs(np.stack([latitude, longitude])), axis=1)
    north, east = places
    written = (north <= 9000.0) & (east <= 18000.0) & (np.mod(places, 100.0) < 60.0).all(axis=0)
    beyond = (north > 90.0) | (east > 2.0 * _TURN)
    return bool(places.size and np.mean(beyond & written) > 0.5)


def positions(latitude: Array, longitude: Array, subject: str, tally: Tally) -> tuple[Array, Array]:
    """Positions in decimal degrees; NMEA ddmm.mmm in place of degrees is converted, counted."""
    # Slocum marks a position without fix by 69696969
    usual = (np.abs(latitude) < 1e6) & (np.abs(longitude) < 1e6)
    tally.add("removed", subject, ~usual & np.isfinite(latitude), "no position (sentinel)")
    latitude, longitude = np.where(usual, latitude, np.nan), np.where(usual, longitude, np.nan)
    unset = (latitude == 0.0) & (longitude == 0.0)
    latitude = tally.removed(latitude, unset, subject, "no position yet (0, 0)")
    good = np.isfinite(latitude) & np.isfinite(longitude)
    if _degrees_and_minutes(latitude[good], longitude[good]):
        tally.add("repaired", subject, good, "was ddmm.mmm where degrees are native")
        latitude, longitude = degrees_minutes(latitude), degrees_minutes(longitude)
    # some vehicles count longitude on past Greenwich: that is possible
    impossible = good & ((np.abs(latitude) > 90.0) | (np.abs(longitude) > 2.0 * _TURN))
    latitude = tally.removed(latitude, impossible, subject, "no position on Earth")
    return latitude, (np.where(impossible, np.nan, longitude) + 180.0) % 360.0 - 180.0


CURRENTS = (
    ("dac_north", "dac_east"),
    ("measured_current_north", "measured_current_east"),
)
"""Pairs of channels with currents that vehicles report."""
_OTHERS = {
    "onboard_north": "true_north", "onboard_east": "true_east",
    **{f"velocity_{axis}": "true_surge" for axis in ("north", "east", "down")},
}  # fmt: skip
"""Auxiliary channels, each with the signal of a store that has the same limits."""
_WORDS = 3
"""Largest number of different values that sensors write for "no value"."""
_HALF = 0.5
"""Fraction of impossible values beyond which the other values are suspect too."""


def within_limits(log: DeploymentLog, tally: Tally) -> DeploymentLog:
    """Remove impossible values of a log; mark the rest as suspect if most are impossible."""
    _doubt_pitch(log, tally)
    log = _without_impossible_currents(log, tally)
    fixes, auxiliary = log.fixes, dict(log.auxiliary)
    for name in [name for name in auxiliary if name.endswith("longitude")]:
        one = auxiliary[name]
        auxiliary[name] = Channel(one.time, _east_of_greenwich(one.values))

    def possible(channels: Mapping[str, Channel]) -> dict[str, Channel]:
        return {n: _possible(n, one, log.deployment, tally) for n, one in channels.items()}

    channels, auxiliary = possible(log.channels), possible(auxiliary)
    variation = possible({"magnetic_variation": log.magnetic_variation})
    fixes = LoggedFixes(fixes.time, fixes.latitude, _east_of_greenwich(fixes.longitude))
    return dataclasses.replace(
        log,
        channels={name: one for name, one in channels.items() if len(one)},
        auxiliary=auxiliary,
        magnetic_variation=variation["magnetic_variation"],
        fixes=_on_earth(fixes, log.deployment, tally),
    )


def _east_of_greenwich(longitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert longitudes up to 360 degree to a store's range, from -180 degree."""
    turned = (longitude > 180.0) & (longitude <= 360.0)
    return np.where(turned, longitude - 360.0, longitude) if turned.any() else longitude


def _limits(name: str) -> tuple[float, float]:
    """Lowest and highest value of a channel; infinite for a channel that is no quantity."""
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
    tally.add("removed", name, bad, f"outside {low:g} to {high:g}")
    _doubt_rest(name, channel.time, channel.values, bad, deployment, tally)
    return Channel(channel.time[~bad], channel.values[~bad])


def _on_earth(fixes: LoggedFixes, deployment: str, tally: Tally) -> LoggedFixes:
    bad = np.zeros(len(fixes), bool)
    for axis, values in (("latitude", fixes.latitude), ("longitude", fixes.longitude)):
        bad |= ~((values >= LIMITS[axis].low) & (values <= LIMITS[axis].high))
    if not bad.any():
        return fixes
    tally.add("removed", "GPS fixes", bad, "no position on Earth")
    _doubt_rest("GPS fixes", fixes.time, fixes.latitude, bad, deployment, tally)
    return fixes.keep(~bad)


def _doubt_rest(
    subject: str, time: Array, values: Array, bad: NDArray[np.bool_], deployment: str, tally: Tally
) -> None:
    # a sensor that is off writes one value, a wrong unit gives many
    if bad.mean() > _HALF and np.unique(values[bad]).size > _WORDS:
        _doubt_impossible(subject, time[bad], deployment, tally)


def _doubt_pitch(log: DeploymentLog, tally: Tally) -> None:
    """Mark a log as suspect if its sink and climb rates fit its pitch only in radian."""
    pitch = log.channel("measured_pitch")
    depth = log.channel("measured_depth") or log.channel("measured_pressure")  # 1 dbar is about 1 m
    if not len(pitch) or not len(depth) or np.percentile(np.abs(pitch.values), 99.0) > 0.5 * np.pi:
        return
    if sinks_in_radian(pitch.time, depth.at(pitch.time), pitch.values):
        why = "the vehicle sinks and rises by its pitch in radian: another unit?"
        tally.doubt("measured_pitch", why, len(pitch), deployment=log.deployment)


def _without_impossible_currents(log: DeploymentLog, tally: Tally) -> DeploymentLog:
    """Remove reported currents that no sea has; mark the dives they belong to as suspect."""
    channels, auxiliary = dict(log.channels), dict(log.auxiliary)
    fastest = LIMITS["dac_north"].high
    for pair in CURRENTS:
        both = [log.channel(name) for name in pair]
        bad = np.union1d(*(one.time[~(np.abs(one.values) <= fastest)] for one in both))
        if not bad.size:
            continue
        for name, one in zip(pair, both, strict=True):
            kept = ~np.isin(one.time, bad)
            place = channels if name in channels else auxiliary
            if name in place:
                place[name] = Channel(one.time[kept], one.values[kept])
        times = np.union1d(*(one.time for one in both))
        wrong = np.isin(times, bad)
        before = np.concatenate([[-np.inf], times[:-1]])[wrong]
        for k, (start, end) in enumerate(zip(before, times[wrong], strict=True)):
            tally.doubt(
                " and ".join(pair), f"a current of more than {fastest:g} m/s: no sea has it",
                0 if k else len(bad), deployment=log.deployment, start=start, end=end,
            )  # fmt: skip
    return dataclasses.replace(log, channels=channels, auxiliary=auxiliary)
