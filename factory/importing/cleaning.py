"""Repairs of one channel: impossible values and spikes removed, wrong units converted, counted."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import Channel
from factory.importing.plausibility import (
    FASTEST,
    SLOWEST,
    lone_zeros,
    short_runs,
    speed_along_pitch,
    stale,
    unreachable,
)
from factory.importing.tally import Tally
from twin.errors import InputError

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limits:
    """What a channel can be. All in the channel's unit."""

    low: float
    high: float
    """Values outside low..high are not measurements (sentinels, sensor off)."""
    rate: float = float("inf")
    """Fastest possible change per second."""
    jump: float = float("inf")
    """Change that noise and quantisation can add to the rate."""


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
    "latitude": Limits(low=-90.0, high=90.0),
    "longitude": Limits(low=-180.0, high=360.0),
}
"""The ocean is 0 to 12 000 dbar, -2.6 to 45 degC, up to 45 in salinity, 985 to 1090 kg m-3; no
glider changes depth faster than 2 m/s nor turns faster than these rates for one sample only; no
battery is shifted by more than 20 cm from its middle."""
CHAINED = frozenset({"measured_pressure", "measured_depth"})
"""Channels in which not only single samples go, but whole runs that the rest cannot reach."""
_MOST = 0.3
"""With more than this part of its samples out of reach of the others, a sensor is not repaired."""
_SHORT = 20
"""Of such a sensor, runs of so few samples out of reach still go."""
_RETURNED = 0.5
"""A spike's neighbours differ by less than this part of the spike."""


def clean(name: str, time: Array, values: Array, tally: Tally, *, subject: str = "") -> Channel:
    """A channel of the finite, possible values; the rest counted.

    `time` increases strictly (see `reading.columns.tidy`).
    """
    subject = subject or name
    there = np.isfinite(values)
    limits = LIMITS.get(name)
    if limits is not None:
        possible = (values >= limits.low) & (values <= limits.high)
        tally.add(
            "removed",
            subject,
            int((there & ~possible).sum()),
            f"outside {limits.low:g} to {limits.high:g}",
        )
        there &= possible
    time, values = time[there], values[there]
    if limits is not None and np.isfinite(limits.rate):
        if name in CHAINED:
            for find, what in (
                (stale, "the last value again after a hole: no new one yet"),
                (lone_zeros, "0 in the middle of a dive: no value yet"),
            ):
                unset = find(time, values, rate=limits.rate, jump=limits.jump)
                tally.add("removed", subject, int(unset.sum()), what)
                time, values = time[~unset], values[~unset]
            bad = unreachable(time, values, rate=limits.rate, jump=limits.jump)
            why = f"changes faster than {limits.rate:g} m/s"
            if bad.sum() > _MOST * len(bad):
                long = bad & ~short_runs(bad, _SHORT)
                tally.add("suspect", subject, int(long.sum()), f"{why}; too many to be removed")
                bad &= ~long
        else:
            bad = spikes(time, values, rate=limits.rate, jump=limits.jump)
            why = "single spikes"
        tally.add("removed", subject, int(bad.sum()), why)
        time, values = time[~bad], values[~bad]
    return Channel(time, values)


def spikes(time: Array, values: Array, *, rate: float, jump: float) -> NDArray[np.bool_]:
    """Single samples that leave both neighbours faster than `rate` [unit/s] beyond `jump`.

    The neighbours agree with each other, so that a step is not taken for a spike.
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


def from_degrees(values: Array, subject: str, tally: Tally, *, flying: bool) -> Array:
    """Native degrees. A pitch that never leaves 1.5 in flight was in radian: converted, counted."""
    good = np.abs(values[np.isfinite(values)])
    good = good[good <= 90.0]  # sentinels have no say
    if flying and good.size > 20 and 0.01 < np.percentile(good, 99.0) < 0.5 * np.pi:
        tally.add("repaired", subject, good.size, "was in radian where degrees are native")
        return np.degrees(values)
    return values


def heading_degrees(values: Array, subject: str, tally: Tally) -> Array:
    """Heading in degrees; one that turns and never leaves 0 to 2 pi was in radian, counted."""
    impossible = np.isfinite(values) & ~((values >= -_TURN) & (values <= _TURN))
    tally.add("removed", subject, int(impossible.sum()), f"no heading: beyond {_TURN:g} degree")
    values = np.where(impossible, np.nan, values)
    good = values[np.isfinite(values)]
    if good.size > 20 and np.ptp(np.percentile(good, [5.0, 95.0])) > 1.0:
        inside = np.abs(good) < 1.01 * 2.0 * np.pi
        if inside.mean() > _NEARLY_ALL:
            tally.add("repaired", subject, good.size, "was in radian where degrees are native")
            return np.where(np.abs(values) < 1.01 * 2.0 * np.pi, np.degrees(values), np.nan)
    return values


_TURN = 378.0
"""[degree] Nothing beyond a full turn and a twentieth is a heading."""
_NEARLY_ALL = 0.95
"""Part of the values that a unit must fit; the rest can be sentinels."""


_LITRES = 5.0
"""[cm3] No pump moves so little in a log: a range below is litres, a thousandth of it m3."""
_STILL = 1e-5
"""A pump that does not move says nothing about its unit."""


def to_cm3(values: Array, subject: str, tally: Tally) -> Array:
    """Pumped volume in cm3; litres and m3 by their range are converted, counted."""
    good = values[np.isfinite(values)]
    good = good[np.abs(good) <= LIMITS["measured_pump"].high]  # sentinels have no say
    if good.size < 20:
        return values
    span = float(np.ptp(np.percentile(good, [1.0, 99.0])))
    if _STILL < span < _LITRES:
        factor, unit = (1e3, "litres") if span > _LITRES * 1e-3 else (1e6, "m3")
        tally.add("repaired", subject, good.size, f"was in {unit} where cm3 is native")
        return values * factor
    return values


_DBAR_PER = {"bar": 10.0, "dbar": 1.0, "Pa": 1e-4, "kPa": 0.1, "psi": 0.689476}
_NEAR = 0.12
"""A pressure unit is recognised when the ratio to depth is within this of 1."""
_DEEP = 5.0
"""[m] Shallower, the ratio of pressure to depth says nothing."""


def to_dbar(
    values: Array, depth: Array | None, subject: str, tally: Tally, *, native: str
) -> Array:
    """Pressure in dbar. `depth` [m] at the same samples tells when the unit was swapped.

    Raises:
      InputError: pressure and depth fit no unit.
    """
    unit = native
    if depth is not None:
        use = np.isfinite(values) & np.isfinite(depth) & (depth > _DEEP) & (values > 0.0)
        if use.sum() >= 10:
            ratio = float(np.median(depth[use] / np.maximum(values[use], 1e-30)))
            near = {u: abs(np.log(ratio / f)) for u, f in _DBAR_PER.items()}
            unit = min(near, key=lambda u: near[u])
            if near[unit] > _NEAR * 2.5:
                raise InputError(
                    f"{subject}: pressure and depth do not belong together ({ratio:.3g} m for each"
                    f" unit of pressure; {native} would be {_DBAR_PER[native]:g}); other vehicle's"
                    " columns or unknown unit"
                )
            if unit != native:
                tally.add(
                    "repaired", subject, int(np.isfinite(values).sum()),
                    f"was in {unit} where {native} is native",
                )  # fmt: skip
    return values * _DBAR_PER[unit]


def pressure_by_flight(pressure: Channel, pitch: Channel, subject: str, tally: Tally) -> Channel:
    """Pressure [dbar] whose scale the flight contradicts by a factor of ten, corrected; counted.

    Without a depth beside it, bar and dbar are told apart by the speed that depth and pitch give.
    """
    speed = speed_along_pitch(pressure, pitch)
    for factor, unit in ((0.1, "dbar where bar"), (10.0, "bar where dbar")):
        wrong = speed > FASTEST if factor < 1.0 else speed < SLOWEST
        if wrong and SLOWEST < factor * speed < FASTEST:
            tally.add("repaired", subject, len(pressure), f"was in {unit} is native, by its speed")
            return Channel(pressure.time, pressure.values * factor)
    return pressure


def degrees_minutes(values: Array) -> Array:
    """Decimal degrees of NMEA ddmm.mmm positions."""
    whole = np.trunc(values / 100.0)
    return whole + (values - 100.0 * whole) / 60.0


def positions(latitude: Array, longitude: Array, subject: str, tally: Tally) -> tuple[Array, Array]:
    """Decimal degrees; NMEA ddmm.mmm where decimal degrees are native is converted, counted."""
    usual = np.abs(latitude) < 1e6  # Slocum marks a position without fix by 69696969
    usual &= np.abs(longitude) < 1e6
    tally.add(
        "removed", subject, int((~usual & np.isfinite(latitude)).sum()), "no position (sentinel)"
    )
    latitude, longitude = np.where(usual, latitude, np.nan), np.where(usual, longitude, np.nan)
    good = np.isfinite(latitude) & np.isfinite(longitude)
    if good.any() and (
        np.percentile(np.abs(latitude[good]), 90) > 90.0
        or np.percentile(np.abs(longitude[good]), 90) > 360.0
    ):
        tally.add("repaired", subject, int(good.sum()), "was ddmm.mmm where degrees are native")
        latitude, longitude = degrees_minutes(latitude), degrees_minutes(longitude)
    impossible = good & ((np.abs(latitude) > 90.0) | (np.abs(longitude) > 360.0))
    tally.add("removed", subject, int(impossible.sum()), "no position on Earth")
    latitude = np.where(impossible, np.nan, latitude)
    longitude = np.where(impossible, np.nan, longitude)
    return latitude, (longitude + 180.0) % 360.0 - 180.0
