"""Followed positions: a part that follows a log's positions in place of what guidance commands.

Each leg of a mission has a piece of the log, which begins when the leg does; a leg that takes
longer than its piece keeps the last position.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from twin.compiled import jit
from twin.numbers import Array

MEMORY = 2
"""Numbers that `followed` remembers, at first 0: first position of the leg, and its begin [s]"""
HEAD = 3
"""Numbers of a table before those of its segments"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FollowedPositions:
    """The positions of one part."""

    part: int
    """index of the vehicle's part"""
    period: float
    """[s] between two positions"""
    positions: Array
    """within the part's travel, in its unit, (time,)"""
    legs: tuple[tuple[int, int], ...]
    """first and last position of the leg of each segment of the mission"""

    def table(self) -> Array:
        """What `followed` reads: part, period, segments, their legs, positions."""
        head = [self.part, self.period, len(self.legs)]
        return np.concatenate([head, np.ravel(self.legs), self.positions]).astype(float)


@jit(nogil=True)
def followed(table, memory, time, segment):  # type: ignore[no-untyped-def]
    """Position of the part at a time [s] in a segment of the mission.

    Args:
      table: of `FollowedPositions.table`. memory: (MEMORY,); it is updated.
    """
    count = int(table[2])
    k = HEAD + 2 * min(int(segment), count - 1)
    if table[k] != memory[0]:
        memory[0], memory[1] = table[k], time
    place = min(table[k] + round((time - memory[1]) / table[1]), table[k + 1])
    return table[HEAD + 2 * count + int(place)]
