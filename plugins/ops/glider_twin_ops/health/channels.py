"""Channels: numbers of one dive that a sound vehicle repeats from dive to dive.

A channel is a residual, so that a pilot's settings hardly move it. Sink rates are compared with a
flight model that reads the logged pitch, pump and density. The battery's position is compared with
the position that the logged pitch needs, and the pump's energy with that of the vehicle's file.
`dive_channels` computes channels from a log.

Disturbances move channels without a fault. A current that changes with depth pushes the vehicle
sideways; it rolls or steers against the push, by an amount that depends on its heading and on the
tide. Roll and steering may therefore step where a leg begins. A wrong speed through the water, a
wrong compass zero and tides move the depth-averaged currents between fixes.
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
    """Standard deviation between dives of a sound vehicle, before its own dives correct it"""
    walk: float
    """Standard deviation of the level's change from dive to dive, by water, seasons and wear"""
    says: str
    """Meaning of the channel, for a reader of the page"""
    flown: bool = True
    """False: flights of the twin do not predict it, since it depends on the sea and on noise"""
    instead: str = ""
    """Channel that replaces this one in dives that have both; the sea disturbs that one less"""


CHANNELS = tuple(
    Channel(*row)
    for row in (
        ("rate_dive", "1", 0.025, 0.004, "1 less the flight model's depth rate in dives over the "
         "log's"),
        ("rate_climb", "1", 0.02, 0.004, "1 less the flight model's depth rate in climbs over the "
         "log's"),
        ("trim_dive", "mm", 0.4, 0.08, "battery's place in dives, less what the pitch needs"),
        ("trim_climb", "mm", 0.4, 0.08, "battery's place in climbs, less what the pitch needs"),
        ("roll_dive", "degree", 0.3, 0.05, "roll in dives, less what a turning battery gives"),
        ("roll_climb", "degree", 0.3, 0.05, "roll in climbs, less what a turning battery gives"),
        ("turn_dive", "degree", 0.9, 0.1, "place of what turns it on a straight heading in dives"),
        ("turn_climb", "degree", 0.9, 0.1, "place of what turns it on a straight heading in "
         "climbs"),
        ("turn_moves", "1", 0.4, 0.05, "logarithm of the way that what turns it makes in an hour",
         False),
        ("heading_error", "1", 0.3, 0.06, "logarithm of the heading's median error", False),
        ("pump_rate", "1", 0.045, 0.005, "logarithm of the volume that is pumped in a second"),
        ("pump_work", "1", 0.02, 0.005, "logarithm of the pump's energy over that of the vehicle's "
         "file"),
        ("hotel", "W", 0.04, 0.005, "power while no pump runs"),
        ("resistance", "1", 0.03, 0.005, "logarithm of the voltage's drop over the current"),
        ("air", "1", 0.001, 0.0002, "logarithm of the hull's pressure over its temperature"),
        ("surface_depth", "m", 0.1, 0.01, "depth that it shows at the surface"),
        ("echoes", "1", 0.15, 0.02, "echoes of the floor over those that earlier dives had at its "
         "heights", False),
        ("temperature_lag", "s", 3.0, 0.4, "time by which the thermistor is late, by dives and "
         "climbs", True, "cell_lag"),
        ("cell_lag", "s", 1.0, 0.1, "time by which the conductivity is later than the temperature"),
        ("lock", "1", 0.1, 0.02, "part of the samples in which the Doppler log has lock"),
        ("current_north", "m s-1", 0.025, 0.006, "depth-averaged current to the north, by the "
         "compass' heading", False),
        ("current_east", "m s-1", 0.025, 0.006, "depth-averaged current to the east, by the "
         "compass' heading", False),
    )
)  # fmt: skip
"""All channels. Noise and walk are those of sound simulated deployments (presets `faulty` and
`piloted`), raised where these are near 0. Rates, roll, steering, pump, hotel, currents and the
depth at the surface have the noise of the noisier half of eleven real deployments, each left out
once, and `cell_lag` the median of seven. A deployment's own dives scale them"""
NAMES = tuple(channel.name for channel in CHANNELS)
PLACE = {name: k for k, name in enumerate(NAMES)}
NOISE, WALK = (np.array([getattr(one, name) for one in CHANNELS]) for name in ("noise", "walk"))
FLOWN = np.array([channel.flown for channel in CHANNELS])

DIFFERENCE = 0.03
"""[m/s] Standard deviation of a current component's difference between the top and the bottom of a
dive, from 30 currents of preset `field`, seed 511"""
ON_A_LEG = ("turn_moves", "heading_error")
"""Channels that step where a leg begins, since the steering rests while the heading is in its dead
band. The step is below 1.0 sqrt(1 - cos(turn)) in 68 % of 207 new legs (sound deployments of four
vehicles, seed 2003)"""
TIDES = (2.0 * math.pi / (12.42 * 3600.0), 2.0 * math.pi / (23.93 * 3600.0))
"""[rad/s] Angular frequencies of the tides M2 and K1"""
HEADING = 1
"""Index of the compass' zero among the disturbances of `standing`"""
SPEED_OFF, HEADING_OFF, TIDE_SPEED = 0.1, math.radians(3.0), 0.05
"""Prior standard deviations. SPEED_OFF: relative error of speed through the water. HEADING_OFF:
[rad] of the compass' zero. TIDE_SPEED: [m/s] amplitude of each phase of a tide's component"""
DAY = 86400.0


def steps_in_shear(response: Array, ways: Array, days: Array, depth: float) -> Array:
    """Standard deviation of each channel's step from the dive before, (dives, channels).

    Half of the shear's variance is steady; half turns with the semidiurnal tide. Its component
    across the heading changes as the vehicle turns. Channels `ON_A_LEG` step by the turn alone.
    An unknown heading counts as a turn by a right angle.

    Args:
      response: change of each channel per 1/s of shear across the heading, (channels,).
      ways: mean velocity through the water of each dive, (dives, 2); NaN: unknown heading.
      days: [d] middles of the dives. depth: [m] of the lower turn.
    """
    ahead = new_legs(ways)
    later = np.cos(TIDES[0] * DAY * np.diff(days, prepend=days[:1]))
    turned = ahead + 1.0 - (1.0 - ahead) * later
    across = DIFFERENCE / depth * np.sqrt(turned)
    found = across[:, None] * np.abs(np.nan_to_num(response))
    found[:, [PLACE[name] for name in ON_A_LEG]] = np.sqrt(ahead)[:, None]
    return found


def new_legs(ways: Array) -> Array:
    """1 less the cosine of each dive's turn from the dive before, (dives,); 0 for the first dive.

    An unknown heading counts as a turn by a right angle.

    Args:
      ways: mean velocity through the water of each dive, (dives, 2); NaN: unknown heading.
    """
    headings = np.arctan2(ways[:, 1], ways[:, 0])
    turns = np.diff(headings, prepend=headings[:1])
    turns[:1] = 0.0
    return 1.0 - np.where(np.isfinite(turns), np.cos(turns), 0.0)


ORDERED = 2.0
"""[noise] Standard deviation of a channel's step per change of depth, pitch or volume beyond what
happens without an order. Simulated deployments with a pilot have 0 to 1.4"""


def groups_of(changes: Array) -> Array:
    """Ordered part of the changes of depth, pitch and volume, (dives, 3).

    Args:
      changes: of depth, pitch and volume of dives, pitch and volume of climbs, in units of what
        happens without an order, (dives, 5).
    """
    beyond = np.maximum(np.abs(changes) - 1.0, 0.0)
    groups = ([0], [1, 3], [2, 4])
    return np.stack([np.linalg.norm(beyond[:, own], axis=1) for own in groups], axis=1)


def ordered_steps(changes: Array) -> Array:
    """Standard deviation of each channel's step by ordered changes, (dives, channels)."""
    return ORDERED * np.linalg.norm(groups_of(changes), axis=1)[:, None] * NOISE


def standing(ways: Array, days: Array) -> tuple[Array, Array]:
    """Disturbances of the currents that may be there from the first dive on.

    Returns:
      What each adds to the channels of a dive at size 1, (kinds, dives, channels), and the
      standard deviation of each size, (kinds,).
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
