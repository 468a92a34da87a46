"""Channels: what one dive says of a vehicle's health, each a number that a sound vehicle repeats.

Channels are made so that what a pilot changes leaves them where they are: depth rates are beside a
flight model's with the logged pitch, pump and density, the battery's place beside what the logged
pitch needs, the pump's work beside that against the sea. `dive_channels` makes them of a log.

Disturbances are no fault and move them all the same. Water whose current changes with depth pushes
a vehicle sideways on its way through it, and it rolls or steers against that: by how much depends
on its heading and on the tide, so that such channels step where a leg begins. A speed through the
water that is off, a compass whose zero is off and the tide move the currents that fixes tell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twin.numbers import Array


class Channel(NamedTuple):
    """One number of a dive."""

    name: str
    unit: str
    noise: float
    """Standard deviation from dive to dive of a sound vehicle, before its own dives say"""
    walk: float
    """Standard deviation of its change from dive to dive: seasons, water, wear that is no fault"""
    says: str
    """what it is, as a person reads it"""
    flown: bool = True
    """False: it depends on the sea and on noise, and flights of the twin do not tell it"""
    instead: str = ""
    """Channel that is judged in its stead in dives that tell it: what it shows, without the sea"""


CHANNELS = tuple(
    Channel(*row)
    for row in (
        ("rate_dive", "1", 0.02, 0.004, "1 less the flight model's depth rate in dives over the "
         "log's"),
        ("rate_climb", "1", 0.015, 0.004, "1 less the flight model's depth rate in climbs over the "
         "log's"),
        ("trim_dive", "mm", 0.4, 0.08, "battery's place in dives, less what the pitch needs"),
        ("trim_climb", "mm", 0.4, 0.08, "battery's place in climbs, less what the pitch needs"),
        ("roll_dive", "degree", 0.2, 0.05, "roll in dives, less what a turning battery gives"),
        ("roll_climb", "degree", 0.2, 0.05, "roll in climbs, less what a turning battery gives"),
        ("turn_dive", "degree", 0.4, 0.1, "place of what turns it on a straight heading in dives"),
        ("turn_climb", "degree", 0.4, 0.1, "place of what turns it on a straight heading in "
         "climbs"),
        ("turn_moves", "1", 0.4, 0.05, "logarithm of the way that what turns it makes in an hour",
         False),
        ("heading_error", "1", 0.3, 0.06, "logarithm of the heading's median error", False),
        ("pump_rate", "1", 0.02, 0.005, "logarithm of the volume that is pumped in a second"),
        ("pump_work", "1", 0.02, 0.005, "logarithm of the pump's energy over its work against the "
         "sea"),
        ("hotel", "W", 0.02, 0.005, "power while no pump runs"),
        ("resistance", "1", 0.03, 0.005, "logarithm of the voltage's drop over the current"),
        ("air", "1", 0.001, 0.0002, "logarithm of the hull's pressure over its temperature"),
        ("surface_depth", "m", 0.08, 0.01, "depth that it shows at the surface"),
        ("echoes", "1", 0.15, 0.02, "echoes of the floor over those that earlier dives had at its "
         "heights", False),
        ("temperature_lag", "s", 3.0, 0.4, "time by which the thermistor is late, by dives and "
         "climbs", True, "cell_lag"),
        ("cell_lag", "s", 1.0, 0.1, "time by which the conductivity is later than the temperature"),
        ("lock", "1", 0.1, 0.02, "part of the samples in which the Doppler log has lock"),
        ("current_north", "m s-1", 0.012, 0.006, "depth-averaged current to the north, by the "
         "compass' heading", False),
        ("current_east", "m s-1", 0.012, 0.006, "depth-averaged current to the east, by the "
         "compass' heading", False),
    )
)  # fmt: skip
"""Every channel; noise and walk are of the size that sound simulated deployments of a Slocum have
(preset `faulty`), larger where they are hardly there; for `surface_depth` of that of four vehicles;
and for `cell_lag` of that of real ones: 1 s is the median of seven deployments at full rate. A
deployment's own dives change them"""
NAMES = tuple(channel.name for channel in CHANNELS)
PLACE = {name: k for k, name in enumerate(NAMES)}
NOISE, WALK = (np.array([getattr(one, name) for one in CHANNELS]) for name in ("noise", "walk"))
FLOWN = np.array([channel.flown for channel in CHANNELS])

DIFFERENCE = 0.03
"""[m/s] deviation of a current's component at the top of a dive less that at its bottom: that of 30
draws of preset `field`, seed 511"""
ON_A_LEG = ("turn_moves", "heading_error")
"""Channels that change where a leg begins: a drive rests while the heading stands in its dead band,
and how long it does is another matter on each heading. By 1.0 in 68 % of 207 new legs (sound
deployments of four vehicles, seed 2003), times the root of 1 less the cosine of the turn"""
TIDES = (2.0 * math.pi / (12.42 * 3600.0), 2.0 * math.pi / (23.93 * 3600.0))
"""[rad/s] of M2 and K1"""
SPEED_OFF, HEADING_OFF, TIDE_SPEED = 0.1, math.radians(3.0), 0.05
"""Deviations, before anything is known: part by which the speed through the water is off, [rad] of
the compass' zero, [m/s] of each phase of a tide's component"""
DAY = 86400.0


def steps_in_shear(response: Array, ways: Array, days: Array, depth: float) -> Array:
    """Deviation of the change of each channel from the dive before, (dives, channels).

    Half of the shear's variance stands, half turns with the semidiurnal tide; across the heading
    it changes as the vehicle turns. Those `ON_A_LEG` change by the turn alone; where a
    heading is not known, as at a right angle.

    Args:
      response: of each channel to a shear across the heading of 1/s, (channels,).
      ways: mean velocity through the water of each dive, (dives, 2); NaN: on any heading.
      days: [d] of the middles of the dives. depth: [m] of the lower turn.
    """
    heading = np.arctan2(ways[:, 1], ways[:, 0])
    known = np.isfinite(heading)
    turned, ahead = np.zeros((2, len(ways)))
    if len(ways) > 1:
        along = np.where(known[1:] & known[:-1], np.cos(np.diff(heading)), 0.0)
        later = np.cos(TIDES[0] * DAY * np.diff(days))
        ahead[1:] = 1.0 - along
        turned[1:] = ahead[1:] + (1.0 - along * later)
    across = DIFFERENCE / depth * np.sqrt(turned)
    found = across[:, None] * np.abs(np.nan_to_num(response))
    found[:, [PLACE[name] for name in ON_A_LEG]] = np.sqrt(ahead)[:, None]
    return found


def standing(ways: Array, days: Array) -> tuple[Array, Array]:
    """Disturbances that may have been in the currents all along.

    Returns:
      Addition of each to the channels of a dive at size 1, (kinds, dives, channels), and the
      deviation of each size, (kinds,).
    """
    north, east = np.nan_to_num(ways).T
    none = np.zeros(len(days))
    rows = [(north, east, SPEED_OFF), (-east, north, HEADING_OFF)]
    for rate in TIDES:
        phase = rate * DAY * days
        for wave in (np.cos(phase), np.sin(phase)):
            rows += [(wave, none, TIDE_SPEED), (none, wave, TIDE_SPEED)]
    found = np.zeros((len(rows), len(days), len(NAMES)))
    for row, (to_north, to_east, _) in zip(found, rows, strict=True):
        row[:, PLACE["current_north"]] = to_north
        row[:, PLACE["current_east"]] = to_east
    return found, np.array([row[-1] for row in rows])
