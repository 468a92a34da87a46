"""Allocation: how several parts of a kind share what guidance asks of one of them.

Guidance moves one part for pitch, one for heading and one for speed. Where more of its kind can do
the same, such as the fins of an X tail, a third rudder or a second screw, they go along: by weights
that make the wanted moment or thrust with the least sum of squared travels, and no other moment
(Fossen 2011, section 12.3: generalised inverse of the effectiveness matrix, weighted). The matrix
has each part's own wrench by position at 1 m/s ahead. A part without a mate goes alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError
from twin.vehicle.parts import Part

Array = NDArray[np.float64]

SHARED = {"pitch": (4, 3, 5), "heading": (5, 3, 4), "speed": (0, 4, 5)}
"""Of each control that is shared: row of the wrench that is wanted, and those that must vanish"""
MOST_FOLLOWERS = 24
"""in a vehicle; guidance keeps them in a table of this length"""
NEGLIGIBLE = 1e-6
"""Weight below which a part does not go along"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Follower:
    """A part that goes along with the one that guidance moves."""

    lead: str
    part: str
    weight: float
    """its way from rest over that of the lead; from the lead's rest"""


def followers(
    parts: Sequence[Part], steering: Mapping[str, str], alone: Sequence[str] = ()
) -> tuple[Follower, ...]:
    """Who goes along with whom, by the wrenches of the parts; () where each part is alone.

    Args:
      steering: name of the part that guidance moves for each control.
      alone: controls whose one part the file has named, which share nothing.

    Raises:
      VehicleError: there are more than MOST_FOLLOWERS.
    """
    found: list[Follower] = []
    by_name = {part.name: part for part in parts}
    for control in (c for c in SHARED if c in steering and c not in alone):
        lead = by_name[steering[control]]
        able = [p for p in parts if type(p) is type(lead) and control in p.controls()]
        mates = [part for part in able if part is not lead]
        if mates:
            weights = _weights(control, [lead, *mates])[1:]
            found += [
                Follower(lead=lead.name, part=part.name, weight=float(weight))
                for part, weight in zip(mates, weights, strict=True)
                if abs(weight) > NEGLIGIBLE
            ]
    if len(found) > MOST_FOLLOWERS:
        raise VehicleError(
            f"{len(found)} fins and screws that go along with others; at most {MOST_FOLLOWERS}: "
            "name the part that steers by <text name='steer.pitch' data='PART'/>"
        )
    return tuple(found)


def _weights(control: str, team: Sequence[Part]) -> Array:
    """Ways of a team's parts from rest over that of its first, shape (parts,)."""
    travel = np.array([part.high - part.low for part in team])
    matrix = np.array([part.effectiveness() for part in team]).T[list(SHARED[control])] * travel
    share = np.linalg.pinv(matrix, rcond=1e-9) @ np.eye(3)[0]
    ways = share * travel
    if abs(ways[0]) <= NEGLIGIBLE * np.abs(ways).max():
        return np.asarray(np.eye(len(team))[0])
    return np.asarray(ways / ways[0])


def idle_parts(
    parts: Sequence[Part],
    steering: Mapping[str, str],
    shared: Sequence[Follower],
    alone: Sequence[str] = (),
) -> dict[str, str]:
    """Parts that guidance leaves at rest, and the part that does what each could do.

    A part beside one that the file has named for the control is not idle but not wanted.
    """
    busy = {*steering.values(), *(follower.part for follower in shared)}
    found = {}
    for part in parts:
        able = [c for c in part.controls() if c in steering and c not in alone]
        if able and part.name not in busy:
            found[part.name] = steering[able[0]]
    return found
