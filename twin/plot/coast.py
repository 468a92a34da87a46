"""Coast: the world's land as polygons of longitude and latitude, coarse, shipped with the package.

Natural Earth 1:50m, public domain; `coast.md` beside this file says more.
"""

from __future__ import annotations

import functools
from importlib import resources
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.path import Path
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAND = "#E8E2D0"
SHORE = "#8C8570"
COAST_NOTE = "coast: Natural Earth 1:50m, coarse"
"""What a map with land says of it"""
NEIGHBOURS = (-360.0, 0.0, 360.0)
"""[degree] by which the world is repeated, for maps across the date line"""


@functools.cache
def rings() -> tuple[Array, ...]:
    """The closed rings of the land, each (points, 2): longitude, latitude [degree].

    Holes in the land run the other way round. Land across the date line goes on beyond 180 degree;
    Antarctica is closed along the pole.
    """
    with resources.files(__package__).joinpath("coast.npz").open("rb") as file:
        stored = np.load(file)
        starts, steps, lengths = (stored[name] for name in ("starts", "steps", "lengths"))
        scale, offset = stored["scale"], stored["offset"]
    found, first = [], 0
    for start, length in zip(starts, lengths, strict=True):
        part = steps[first : first + length - 1].astype(np.int64)
        grid = np.concatenate([start[None], start + np.cumsum(part, axis=0)])
        found.append(_unrolled(grid * scale + offset))
        first += length - 1
    return tuple(found)


def _unrolled(ring: Array) -> Array:
    """A ring without jumps of longitude at the date line."""
    ring[:, 0] = np.unwrap(ring[:, 0], period=360.0)
    ring[:, 0] -= 360.0 * np.round(ring[:, 0].mean() / 360.0)
    if abs(ring[-1, 0] - ring[0, 0]) < 180.0:
        return ring
    pole = np.array([[ring[-1, 0], -90.0], [ring[0, 0], -90.0], ring[0]])
    return np.concatenate([ring, pole])


def land_within(west: float, east: float, south: float, north: float) -> list[Array]:
    """The rings that reach into a box [degree], moved by whole turns to where the box is."""
    found = []
    for ring in rings():
        low, high = ring.min(axis=0), ring.max(axis=0)
        if high[1] < south or low[1] > north:
            continue
        for turn in NEIGHBOURS:
            if high[0] + turn >= west and low[0] + turn <= east:
                found.append(ring + np.array([turn, 0.0]))
    return found


def coast_within(west: float, east: float, south: float, north: float) -> bool:
    """Whether a box [degree] holds a point of a coast."""
    for ring in land_within(west, east, south, north):
        x, y = ring.T
        if ((x > west) & (x < east) & (y > south) & (y < north)).any():
            return True
    return False


def land_in_view(west: float, east: float, south: float, north: float) -> bool:
    """Whether land reaches into a box [degree], and not only the box around that land."""
    box = Bbox.from_extents(west, south, east, north)
    return any(
        Path(ring, closed=True).intersects_bbox(box)
        for ring in land_within(west, east, south, north)
    )


def draw_land(axes: Axes, box: tuple[float, float, float, float], **look: Any) -> None:
    """Fill the land of a box (west, east, south, north) [degree]."""
    found = land_within(*box)
    if not found:
        return
    whole = Path.make_compound_path(*(Path(ring, closed=True) for ring in found))
    given = {"facecolor": LAND, "edgecolor": SHORE, "linewidth": 0.6, "zorder": 0.5, **look}
    land = PathCollection([whole], **given)
    land.set_gid("land")
    axes.add_collection(land, autolim=False)
