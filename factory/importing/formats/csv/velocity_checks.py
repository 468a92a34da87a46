"""Velocity checks: whether a column that a mapping calls a velocity can be one.

Tables of other people hold, under the same name, a distance run so far, the metres of one sample, a
sensor that was off, or port where another file has starboard. What cannot be a velocity is refused;
a sign that the track contradicts is reported.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import Channel, DeploymentLog
from factory.importing.tally import Tally
from twin.errors import InputError
from twin.geodesy import offset
from twin.records.schema.limits import recorded_limits

Array = NDArray[np.float64]

FORWARD = ("measured_dvl_surge", "true_surge", "true_speed")
SIDEWAYS = ("measured_dvl_sway", "true_sway")
VELOCITIES = frozenset((*FORWARD, *SIDEWAYS, "measured_dvl_heave", "true_heave"))
_MOST = 0.3
"""A column with more impossible values than this part is no velocity with a few wild ones."""
_ONE_VALUE = 0.1
"""A single value, of either sign, that makes up more than this part is a sentinel."""
_FEWEST = 100
"""Values without which a column that never changes proves nothing."""
_WINDOW = 10.0
"""[s] Track and velocity are compared over so long: a GPS's metre is then 0.1 m/s."""
_HOLE = 5.0
"""[s] A window whose velocity has a longer hole says nothing."""
_MOVING = 0.3
"""[m/s] Slower, the track's noise decides."""
_WINDOWS = 5
"""Windows that a comparison needs."""
SCALE = (0.4, 2.5)
"""Track speed over velocity: a current of half the vehicle's speed either way, and noise."""
_CURRENT = 1.5
"""[m/s] Stronger currents are rare where vehicles go: a larger difference is no current."""
_AGREES = 0.5
"""Correlation from which the sign of sway is judged."""


def check_values(
    name: str,
    values: Array,
    written: Array,
    unit: str,
    possible: tuple[float, float] | None,
    subject: str,
) -> None:
    """Refuse a column of velocities if most of them are impossible for a vehicle.

    Args:
      values: [m/s] without the mapping's sentinels.
      written: the same samples as the file has them, in `unit`.
      possible: [m/s] lowest and highest by the mapping, which removes a sentinel beyond them; None:
        those of the schema.

    Raises:
      InputError: it is a distance, or has a sentinel that the mapping does not name.
    """
    there = np.isfinite(values)
    good, written = values[there], written[there]
    if name not in VELOCITIES or not good.size:
        return
    low, high = possible or recorded_limits(name)
    wild = (good < low) | (good > high)
    repeats = wild & np.isin(np.abs(written), _often(np.abs(written[wild]), good.size))
    if possible is not None:
        wild, good = wild[~repeats], good[~repeats]
    if not good.size or wild.mean() <= _MOST:
        return
    if possible is None and repeats.any():
        found, counts = np.unique(written[repeats], return_counts=True)
        words = [repr(value).removesuffix(".0") for value in found.tolist()]
        shares = " and ".join(
            f"{word} {unit} in {100.0 * count / good.size:.0f} %"
            for word, count in zip(words, counts, strict=True)
        )
        raise InputError(
            f"{subject} is to be {name} and is {shares} of its samples: a sentinel? Name it as the "
            f"file has it, sentinels = [{', '.join(words)}], or give what is possible, in m/s, "
            "possible = [LOW, HIGH]"
        )
    raise InputError(
        f"{subject} is to be {name} and is beyond {low:g} to {high:g} m/s in "
        f"{100.0 * wild.mean():.0f} % of its samples (median size {np.median(np.abs(good)):.4g}), "
        "no two alike: a distance, not a velocity. Leave the file out, or the column: [ignored]"
    )


def _often(sizes: Array, samples: int) -> Array:
    """The sizes that each make up more than `_ONE_VALUE` of so many samples."""
    found, counts = np.unique(sizes, return_counts=True)
    return np.asarray(found[counts > _ONE_VALUE * samples], float)


def check_track(log: DeploymentLog, tally: Tally) -> None:
    """Compare the velocities of a log with its track, where it has one and a heading.

    A forward velocity that is the same in every sample is left to the report as suspect, as is a
    sway of the other sign than the track's.

    Raises:
      InputError: the track moves many times faster or slower than the forward velocity says.
    """
    for name in (*FORWARD, *SIDEWAYS):
        channel = log.channel(name)
        if len(channel) >= _FEWEST and np.ptp(channel.values) == 0.0:
            tally.doubt(
                name,
                f"{log.deployment}: {channel.values[0]:g} in every sample; was the sensor off?",
                len(channel),
            )
    ahead = next((n for n in FORWARD if len(log.channel(n)) > 1), None)
    heading = log.channel("measured_heading")
    if ahead is None or not len(heading):
        return
    times, north, east = _track(log)
    if not len(times):
        return
    middle = 0.5 * (times[1:] + times[:-1])
    turn = np.unwrap(np.radians(heading.values))
    angle = np.interp(middle, heading.time, turn)
    v_north, v_east = np.diff(north) / np.diff(times), np.diff(east) / np.diff(times)
    forward = v_north * np.cos(angle) + v_east * np.sin(angle)
    starboard = -v_north * np.sin(angle) + v_east * np.cos(angle)
    said = _means(log.channel(ahead), times)
    use = np.isfinite(said) & (np.hypot(v_north, v_east) > _MOVING)
    if use.sum() < _WINDOWS:
        return
    _check_scale(log, ahead, said[use], forward[use], tally)
    for name in SIDEWAYS:
        aside = _means(log.channel(name), times)
        both = np.isfinite(aside) & use
        if both.sum() < _WINDOWS or np.ptp(aside[both]) == 0.0 or np.ptp(starboard[both]) == 0.0:
            continue
        agrees = float(np.corrcoef(aside[both], starboard[both])[0, 1])
        if agrees < -_AGREES:
            tally.doubt(
                name,
                f"{log.deployment}: the track moves to the other side (correlation {agrees:.2f}): "
                "wrong sign or frame",
                len(log.channel(name)),
            )


def _check_scale(
    log: DeploymentLog, name: str, said: Array, track: Array, tally: Tally
) -> None:  # fmt: skip
    """Refuse a forward velocity whose size is not the track's, beyond what a current explains."""
    size = float(np.median(np.abs(said)))
    moved = float(np.median(np.abs(track)))
    low, high = SCALE
    if size > 0.0 and low <= moved / size <= high:
        return
    if max(size, moved) < _MOVING:
        return
    spacing = log.channel(name).spacing
    found = f"{size:.3g} m/s where the track moves forward at {moved:.3g} m/s (medians)"
    if size > 0.0 and low <= moved * spacing / size <= high:
        what = f"metres per sample of {spacing:g} s?"
    elif np.ptp(log.channel(name).values) == 0.0:
        what = "a sensor that was off?"
    elif abs(moved - size) > _CURRENT:
        what = "a distance, or another unit?"
    else:  # what a current can do to a velocity through the water
        tally.doubt(name, f"{log.deployment}: {found}", len(log.channel(name)))
        return
    raise InputError(
        f"{', '.join(log.files)}: {name} has {found}, not a velocity in m/s: {what} Correct the "
        "unit, or leave the file or the column out"
    )


def _track(log: DeploymentLog) -> tuple[Array, Array, Array]:
    """Times [s] at which windows with samples of the track begin and end, and north and east [m]
    there; empty without a track."""
    latitude, longitude = log.channel("latitude"), log.channel("longitude")
    if len(latitude) < 2 or len(longitude) < 2:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    windows = np.unique((latitude.time - latitude.time[0]) // _WINDOW)
    times = latitude.time[0] + _WINDOW * np.union1d(windows, windows + 1.0)
    times = times[times < latitude.time[-1]]
    north, east = offset(
        latitude.at(times), longitude.at(times),
        float(latitude.values[0]), float(longitude.values[0]),
    )  # fmt: skip
    return times, north, east


def _means(channel: Channel, times: Array) -> Array:
    """Mean of a channel between each two times; NaN where it has a hole."""
    found = np.full(max(len(times) - 1, 0), np.nan)
    for k in range(len(found)):
        inside = channel.within(times[k], times[k + 1])
        if not len(inside):
            continue
        steps = np.diff([times[k], *inside.time, times[k + 1]])
        if steps.max() <= _HOLE:
            found[k] = float(inside.values.mean())
    return found
