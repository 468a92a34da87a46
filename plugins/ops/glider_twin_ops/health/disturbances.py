"""Disturbances: what is no fault and moves the channels of a sound vehicle all the same.

Water whose current changes with depth pushes a vehicle sideways on its way through it, and it rolls
or steers against that: by how much depends on its heading and on the tide, so that such channels
step where a leg begins. A speed through the water that is off, a compass whose zero is off and the
tide move the currents that fixes tell.
"""

from __future__ import annotations

import math

import numpy as np

from glider_twin_ops.health.channels import NAMES, PLACE
from twin.numbers import Array

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
    """What may have been in the currents all along.

    Returns:
      What each adds to the channels of a dive at size 1, (kinds, dives, channels), and the
      deviation of each size, (kinds,).
    """
    north, east = np.nan_to_num(ways).T
    rows = [(north, east, SPEED_OFF), (-east, north, HEADING_OFF)]
    for rate in TIDES:
        phase = rate * DAY * days
        for wave in (np.cos(phase), np.sin(phase)):
            none = np.zeros(len(days))
            rows += [(wave, none, TIDE_SPEED), (none, wave, TIDE_SPEED)]
    found = np.zeros((len(rows), len(days), len(NAMES)))
    for row, (to_north, to_east, _) in zip(found, rows, strict=True):
        row[:, PLACE["current_north"]] = to_north
        row[:, PLACE["current_east"]] = to_east
    return found, np.array([row[-1] for row in rows])
