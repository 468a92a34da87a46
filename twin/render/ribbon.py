"""Ribbon: a track as a tube that is revealed as the glider flies it.

The tube is cut into chunks of a few nodes. Chunks that lie wholly in the past are drawn; the one
in which the glider is, is replaced by the `head`, a short tube that is reshaped for each frame
and ends at the glider.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.render.shapes import Shape, tube

Array = NDArray[np.float64]

CHUNK = 24
"""Segments per chunk"""
SIDES = 7
MOST_NODES = 3600
"""Nodes of one track; the tolerance grows until they suffice."""
TEXELS = 4096
"""Samples of the colour along the track"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ribbon:
    """A track in display units, ready to be meshed."""

    time: Array
    """[s] of each node, increasing, shape (n,)"""
    nodes: Array
    """Shape (n, 3)"""
    radius: float
    span: tuple[float, float]
    """[s] that the colour texture covers"""

    def along(self, time: Array) -> Array:
        """Texture coordinate of mission times [s]."""
        first, last = self.span
        relative = np.clip((time - first) / (last - first), 0.0, 1.0)
        return (0.5 + relative * (TEXELS - 1)) / TEXELS

    def starts(self) -> NDArray[np.int64]:
        """Index of each chunk's first node, shape (chunks,)."""
        return np.arange(0, len(self.nodes) - 1, CHUNK, dtype=np.int64)

    def chunk(self, index: int) -> Shape:
        """The tube of one chunk."""
        first = int(self.starts()[index])
        last = min(first + CHUNK, len(self.nodes) - 1)
        part = slice(first, last + 1)
        return tube(self.nodes[part], self.radius, SIDES, self.along(self.time[part]))

    def chunk_ends(self) -> Array:
        """Time [s] of each chunk's last node, shape (chunks,)."""
        return self.time[np.minimum(self.starts() + CHUNK, len(self.nodes) - 1)]

    def at(self, time: float) -> Array:
        """The track's point at a mission time [s], shape (3,)."""
        return np.array([np.interp(time, self.time, column) for column in self.nodes.T])

    def head(self, time: float, tip: Array, clear: float = 0.0) -> Shape:
        """The tube from the running chunk's start to `tip` (3,), always of CHUNK + 2 nodes.

        Nodes nearer than `clear` to the tip are left out, so that the tube does not double back
        where the tip lags behind the track's own end.
        """
        starts = self.starts()
        running = int(np.searchsorted(self.chunk_ends(), time, side="right"))
        first = int(starts[min(running, len(starts) - 1)])
        flown = np.flatnonzero(self.time[first : first + CHUNK + 1] < time) + first
        if len(flown) > 1:
            apart = np.linalg.norm(self.nodes[flown] - tip, axis=-1) >= clear
            flown = flown[np.logical_or(apart, flown == first)]
        nodes = np.concatenate([self.nodes[flown], tip[None]])
        times = np.concatenate([self.time[flown], [time]])
        missing = CHUNK + 2 - len(nodes)
        nodes = np.concatenate([nodes, np.repeat(nodes[-1:], missing, axis=0)])
        times = np.concatenate([times, np.repeat(times[-1:], missing)])
        shape = tube(nodes, self.radius, SIDES, self.along(times))
        return close_tip(shape, missing)


def close_tip(shape: Shape, repeated: int) -> Shape:
    """Shrink the repeated last rings of a tube to a point, so that it ends in a cone."""
    if repeated == 0:
        return shape
    vertices = shape.vertices.copy()
    count = repeated * SIDES
    vertices[-count:] = vertices[-count:].reshape(-1, SIDES, 3).mean(axis=1).repeat(SIDES, axis=0)
    return dataclasses.replace(shape, vertices=vertices)


def simplify(points: Array, tolerance: float, most: int = MOST_NODES) -> NDArray[np.int64]:
    """Indices of the points (n, 3) that a polyline within `tolerance` needs (Douglas-Peucker).

    The tolerance is doubled until at most `most` points are left. Ramer (1972), Douglas and
    Peucker (1973).
    """
    while True:
        keep = _douglas_peucker(points, tolerance)
        if len(keep) <= most:
            return keep
        tolerance *= 2.0


def _douglas_peucker(points: Array, tolerance: float) -> NDArray[np.int64]:
    keep = np.zeros(len(points), bool)
    keep[[0, -1]] = True
    waiting = [(0, len(points) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        inside = points[first + 1 : last] - points[first]
        chord = points[last] - points[first]
        length = float(chord @ chord)
        if length > 0:
            along = np.clip(inside @ chord / length, 0.0, 1.0)
            inside = inside - along[:, None] * chord
        squared = np.einsum("ij,ij->i", inside, inside)
        worst = int(np.argmax(squared))
        if squared[worst] > tolerance**2:
            split = first + 1 + worst
            keep[split] = True
            waiting += [(first, split), (split, last)]
    return np.flatnonzero(keep)
