"""Ribbons and arrows: a track as a tube that grows with the flight, and arrows of the current.

The tube is cut into chunks of a few nodes. Chunks that are wholly flown are drawn. The `head`
replaces the chunk that is being flown: a short tube that is reshaped for each frame and ends at
the glider.

Arrows show the current against depth, on a mast in the block or beside the glider.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from twin.show.figures.water import mean_profile
from twin.show.render import canvas, shapes
from twin.show.render.camera import Array, SceneLayout, nice_step
from twin.show.render.shapes import WORLD, Props, Shape, tube

CHUNK, SIDES = 24, 7  # segments per chunk, and around the tube
MOST_NODES = 3600  # most nodes of one track; the tolerance grows until they suffice
TEXELS = 4096  # samples of the colour along the track
ARROWS = 11  # approximate number of arrows of a mast
LENGTH_SHARE = 0.11  # length of the strongest current's arrow over the block's length
THICKNESS_SHARE = 0.0028  # radius of an arrow's shaft over the block's length
LADDER_LENGTH, LADDER_RADIUS = 1.0, 0.03
"""[m] Arrows beside the glider. LADDER_LENGTH: of the strongest. LADDER_RADIUS: of all"""
LADDER_STEP, LADDER_REACH = 1.0, 2.6
"""[m] LADDER_STEP: between the arrows. LADDER_REACH: of the arrows above and below the glider"""
LADDER_SLOTS = math.floor(2 * LADDER_REACH / LADDER_STEP) + 1
"""Maximum number of arrows beside the glider at one time"""
LADDER_OFFSET = (0.2, -3.0)  # [m] start of these arrows ahead and to starboard of the glider
STILL = 1e-4  # [m/s] speed below which water counts as still


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ribbon:
    """Track in display units, with the radius and colour range of its tube."""

    time: Array  # [s] of each node, increasing, shape (n,)
    nodes: Array  # shape (n, 3)
    radius: float
    span: tuple[float, float]  # [s] that the colour texture covers

    def along(self, time: Array) -> Array:
        """Texture coordinate of mission times [s]."""
        first, last = self.span
        relative = np.clip((time - first) / (last - first), 0.0, 1.0)
        return (0.5 + relative * (TEXELS - 1)) / TEXELS

    def starts(self) -> NDArray[np.int64]:
        """Index of each chunk's first node, shape (chunks,)."""
        return np.arange(0, len(self.nodes) - 1, CHUNK, dtype=np.int64)

    def chunks(self) -> list[Shape]:
        """Tubes of all chunks."""
        parts = [slice(first, first + CHUNK + 1) for first in self.starts()]
        return [
            tube(self.nodes[part], self.radius, SIDES, self.along(self.time[part]))
            for part in parts
        ]

    def chunk_ends(self) -> Array:
        """Time [s] of each chunk's last node, shape (chunks,)."""
        return self.time[np.minimum(self.starts() + CHUNK, len(self.nodes) - 1)]

    def at(self, time: float) -> Array:
        """Point of the track at a mission time [s], shape (3,)."""
        return np.array([np.interp(time, self.time, column) for column in self.nodes.T])

    def head(self, time: float, tip: Array, clear: float = 0.0) -> Shape:
        """Tube from the start of the chunk at `time` to `tip` (3,), always with CHUNK + 2 nodes.

        Nodes nearer than `clear` to the tip are left out, so that the tube does not double back
        where the tip (such as the glider's tail) lies behind the track's end.
        """
        starts = self.starts()
        running = int(np.searchsorted(self.chunk_ends(), time, side="right"))
        first = int(starts[min(running, len(starts) - 1)])
        flown = np.flatnonzero(self.time[first : first + CHUNK + 1] < time) + first
        if len(flown) > 1:
            apart = np.linalg.norm(self.nodes[flown] - tip, axis=-1) >= clear
            flown = flown[np.logical_or(apart, flown == first)]
        missing = CHUNK + 1 - len(flown)
        nodes = np.concatenate([self.nodes[flown], np.repeat(tip[None], missing + 1, axis=0)])
        times = np.concatenate([self.time[flown], np.full(missing + 1, time)])
        shape = tube(nodes, self.radius, SIDES, self.along(times))
        # The repeated last rings shrink to points, so that the tube ends in a cone.
        rings = shape.vertices.reshape(-1, SIDES, 3)[len(flown) + 1 :]
        rings[:] = rings.mean(axis=1, keepdims=True)
        return shape


def simplify(points: Array, tolerance: float, most: int = MOST_NODES) -> NDArray[np.int64]:
    """Indices of the points (n, 3) of a polyline that stays within `tolerance` of all points.

    The tolerance is doubled until at most `most` points are left. Ramer (1972), Douglas and
    Peucker (1973).
    """
    while True:
        keep = _douglas_peucker(points, tolerance)
        if len(keep) <= most:
            return keep
        tolerance *= 2.0


def _douglas_peucker(points: Array, tolerance: float) -> NDArray[np.int64]:
    keep = {0, len(points) - 1}
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
            keep.add(split)
            waiting += [(first, split), (split, last)]
    return np.array(sorted(keep), np.int64)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArrowProfile:
    """Mean current against depth, over the shown part of a mission."""

    depth: Array  # [m], increasing, shape (n,)
    velocity: Array  # north, east [m/s], shape (n, 2)

    @property
    def strongest(self) -> float:
        """Largest speed [m/s]; 0 for still water."""
        speed = float(np.hypot(*self.velocity.T).max(initial=0.0))
        return speed if speed >= STILL else 0.0

    def at(self, depth: float) -> Array:
        """North, east [m/s] at a depth [m], shape (2,)."""
        return np.array([np.interp(depth, self.depth, column) for column in self.velocity.T])


def profile(depth: Array, velocity: Array) -> ArrowProfile:
    """Average samples to a profile: depth [m] (n,), velocity north and east [m/s] (n, 2)."""
    centres, means = mean_profile(np.clip(depth, 0.0, None), *velocity.T)
    return ArrowProfile(depth=centres, velocity=np.stack(means, axis=-1))


def add_mast(props: Props, layout: SceneLayout, current: ArrowProfile, path: Array) -> None:
    """Add a mast with arrows at round depths, at the place freest from `path` (n, 3) NED [m]."""
    if current.strongest == 0.0:
        return
    length = float(layout.size[:2].max() * layout.scale)
    radius = THICKNESS_SHARE * length
    per_speed = LENGTH_SHARE * length / current.strongest
    foot = free_place(layout, path, LENGTH_SHARE)
    top, low = (layout.display(np.array([*foot, d])) for d in (0.0, float(layout.high[2])))
    mast = shapes.cone(low, top, 0.7 * radius, 0.7 * radius, 8)
    props.add("mast", mast, np.array([0.85, 0.92, 0.96]), material="lit")
    parts = []
    for depth in mast_depths(current):
        north, east = current.at(depth)
        vector = per_speed * np.array([north, -east, 0.0])
        long = float(np.linalg.norm(vector))
        if long > 2 * radius:
            start = layout.display(np.array([*foot, depth]))
            parts.append(shapes.arrow(start, start + vector, min(radius, long / 12)))
    if parts:
        props.add("current_arrows", shapes.merge(parts), canvas.CURRENT, material="lit")


def mast_depths(current: ArrowProfile) -> list[float]:
    """Round depths [m] of a mast's arrows."""
    deepest = float(current.depth[-1])
    step = nice_step(max(deepest, 1.0) / ARROWS)
    return list(map(float, np.arange(step / 2, deepest + step / 2, step)))


def ladder(
    current: ArrowProfile, depth: float, heading: float, floor: float
) -> list[tuple[float, Array, Array]]:
    """Arrows of the current beside the glider at round depths, for the chase camera.

    Args:
      depth: [m] depth of the glider.
      heading: [rad] heading of the glider.
      floor: [m] depth of the floor, below which there is no arrow.

    Returns:
      for each arrow its depth [m], start and vector in display units from the glider, both (3,).
    """
    ahead, aside = LADDER_OFFSET
    c, s = math.cos(heading), math.sin(heading)
    x, y = ahead * c - aside * s, -(ahead * s + aside * c)
    per_speed = LADDER_LENGTH / current.strongest if current.strongest else 0.0
    first = math.ceil((depth - LADDER_REACH) / LADDER_STEP)
    last = math.floor((depth + LADDER_REACH) / LADDER_STEP)
    found = []
    for level in LADDER_STEP * np.arange(first, last + 1, dtype=float):
        if 0.0 <= level <= floor:
            north, east = current.at(float(level))
            vector = per_speed * np.array([north, -east, 0.0])
            found.append((float(level), np.array([x, y, depth - level]), vector))
    return found


def add_ladder(props: Props) -> list[str]:
    """Add the arrows beside the glider, reshaped for each frame; return their geoms' names."""
    arrow = ladder_arrow(np.array([1.0, 0.0, 0.0]))
    return [
        props.add(f"ladder_{i}", arrow, canvas.CURRENT, material="lit", body=WORLD)
        for i in range(LADDER_SLOTS)
    ]


def ladder_arrow(vector: Array) -> Shape:
    """Shape of an arrow beside the glider, from the origin of its geom, in display units."""
    radius = min(LADDER_RADIUS, float(np.linalg.norm(vector)) / 8)
    return shapes.arrow(np.zeros(3), vector, radius)


def free_place(layout: SceneLayout, path: Array, share: float) -> Array:
    """North, east [m] of the place near a corner of the block that is farthest from the track.

    Args:
      path: track in NED [m], (n, 3).
      share: length of the longest arrow there over the block's length.
    """
    x, y = layout.size[:2]
    room = 1.2 * share * float(max(x, y))
    xs, ys = ((low + min(room, 0.3 * size), low + size - min(room, 0.3 * size))
              for low, size in ((layout.low[0], x), (layout.low[1], y)))  # fmt: skip
    corners = np.array([(a, b, 0.0) for a in xs for b in ys])
    inside = layout.to_block(path[:: max(1, len(path) // 500)])
    gap = np.linalg.norm(inside[None, :, :2] - corners[:, None, :2], axis=-1).min(axis=1)
    return np.asarray(layout.to_ned(corners[int(np.argmax(gap))])[:2])
