"""Map ground: the world's coarse coast, graticule in degrees and minutes, and scale bar.

The coast consists of polygons of longitude and latitude that ship with the package: Natural Earth
1:50m, public domain; see `coast.md` beside this file.
"""

from __future__ import annotations

import functools
import math
from importlib import resources
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.path import Path
from matplotlib.ticker import FixedLocator, FuncFormatter
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from twin.geodesy import meridian_radius, normal_radius
from twin.show import style

Array = NDArray[np.float64]

LAND = "#E8E2D0"
SHORE = "#8C8570"
COAST_NOTE = "coast: Natural Earth 1:50m, coarse"  # note on a map with land
NEIGHBOURS = (-360.0, 0.0, 360.0)
"""[degree] Shifts at which the world is repeated, for maps across the date line"""
STEPS = (
    *(0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0),
    *(60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0),
)
"""[minute] Steps between grid lines"""
MOST_LINES = 5  # most grid lines of one direction: more labels would touch
EDGE = 0.06  # fraction of a span without lines at either end, where labels would leave the map
LEAST_SPAN = 0.004  # [degree of latitude] least height of a map: half a kilometre
MARGIN = 0.17  # margin on every side / larger span
BARS = (*(m * 10**k for k in range(6) for m in (1, 2, 5)), 1_000_000)
"""[m] Lengths that a scale bar may have"""
BAR_SHARE = 0.3  # largest length of a scale bar / width of the map


@functools.cache
def rings() -> tuple[Array, ...]:
    """Closed rings of the land, each (points, 2): longitude, latitude [degree].

    Rings of lakes run in the opposite direction. Land across the date line continues beyond 180
    degree; Antarctica is closed along the pole.
    """
    with resources.files(__package__).joinpath("coast.npz").open("rb") as file:
        stored = np.load(file)
        starts, steps, lengths = (stored[name] for name in ("starts", "steps", "lengths"))
        scale, offset = stored["scale"], stored["offset"]
    found, first = [], 0
    for start, length in zip(starts, lengths, strict=True):
        part = steps[first : first + length - 1].astype(np.int64)
        grid = np.concatenate([start[None], start + np.cumsum(part, axis=0)])
        ring = grid * scale + offset
        ring[:, 0] = np.unwrap(ring[:, 0], period=360.0)  # no jumps at the date line
        ring[:, 0] -= 360.0 * np.round(ring[:, 0].mean() / 360.0)
        if abs(ring[-1, 0] - ring[0, 0]) >= 180.0:
            pole = np.array([[ring[-1, 0], -90.0], [ring[0, 0], -90.0], ring[0]])
            ring = np.concatenate([ring, pole])
        found.append(ring)
        first += length - 1
    return tuple(found)


def land_within(west: float, east: float, south: float, north: float) -> list[Array]:
    """Rings whose bounding box meets a box [degree], shifted by 360 degree where needed."""
    return [
        ring + np.array([turn, 0.0])
        for ring in rings()
        if ring[:, 1].max() >= south and ring[:, 1].min() <= north
        for turn in NEIGHBOURS
        if ring[:, 0].max() + turn >= west and ring[:, 0].min() + turn <= east
    ]


def coast_within(west: float, east: float, south: float, north: float) -> bool:
    """Return True if a box [degree] contains a point of a coast."""
    low, high = (west, south), (east, north)
    rings = land_within(west, east, south, north)
    return any(((ring > low) & (ring < high)).all(axis=1).any() for ring in rings)


def land_in_view(west: float, east: float, south: float, north: float) -> bool:
    """Return True if land itself, not only its bounding box, reaches into a box [degree]."""
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


Box = tuple[float, float, float, float]
"""West, east, south, north [degree]; west and east may lie beyond 180"""


def box_around(latitude: Array, longitude: Array, shape: float = 1.0) -> Box:
    """Box around points [degree] with a margin.

    Args:
      latitude, longitude: positions of the points; longitudes must not jump by 360 degree.
      shape: width / height of the map [m/m].
    """
    south, north = float(np.nanmin(latitude)), float(np.nanmax(latitude))
    west, east = float(np.nanmin(longitude)), float(np.nanmax(longitude))
    shrink = cosine(0.5 * (south + north))
    tall = max(north - south, LEAST_SPAN, (east - west) * shrink / shape)
    half = (0.5 + MARGIN) * tall
    middle = 0.5 * (south + north), 0.5 * (west + east)
    wide = half * shape / shrink
    return (middle[1] - wide, middle[1] + wide, middle[0] - half, middle[0] + half)


def cosine(latitude: float) -> float:
    """Ratio of the lengths of a degree of longitude and of latitude, at a latitude [degree]."""
    ratio = normal_radius(latitude) / meridian_radius(latitude)
    return max(ratio * math.cos(math.radians(latitude)), 0.02)


def draw_graticule(axes: Axes, box: Box, *, lines: int = MOST_LINES) -> None:
    """Set limits and aspect of a map, and draw its lines with labels in degrees and minutes."""
    west, east, south, north = box
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    shrink = cosine(0.5 * (south + north))
    axes.set_aspect(1.0 / shrink, anchor="N")  # free space goes below the map, for the label
    shape = shrink * (east - west) / (north - south)
    for axis, low, high, name, most in (
        (axes.xaxis, west, east, longitude_text, max(2, min(lines, round(lines * shape)))),
        (axes.yaxis, south, north, latitude_text, lines),
    ):
        step = line_step(high - low, most)
        edge = EDGE * (high - low)
        first = math.ceil((low + edge) * 60.0 / step)
        last = math.floor((high - edge) * 60.0 / step)
        axis.set_major_locator(FixedLocator([k * step / 60.0 for k in range(first, last + 1)]))
        axis.set_major_formatter(
            FuncFormatter(lambda value, _, name=name, step=step: name(value, step))
        )
    axes.tick_params(axis="y", labelrotation=90)
    for label in axes.get_yticklabels():
        label.set_verticalalignment("center")
    axes.spines[["top", "right"]].set_visible(True)
    axes.set_xlabel("longitude")
    axes.set_ylabel("latitude")


def line_step(span: float, most: int) -> float:
    """[minute] Step between lines, so that a span [degree] has at most `most` lines."""
    return next((step for step in STEPS if 60.0 * span / step <= most), STEPS[-1])


def latitude_text(value: float, step: float = 1.0) -> str:
    """Text of a latitude [degree] as on charts, with the decimals of `step` [minute]."""
    return _text(abs(value), step) + ("" if abs(value) < 1e-9 else "N" if value > 0.0 else "S")


def longitude_text(value: float, step: float = 1.0) -> str:
    """Text of a longitude [degree] as on charts, between 180 W and 180 E; `step` in minutes."""
    turned = (value + 180.0) % 360.0 - 180.0
    half = abs(turned) < 1e-9 or abs(abs(turned) - 180.0) < 1e-9
    return _text(abs(turned), step) + ("" if half else "E" if turned > 0.0 else "W")


def _text(value: float, step: float) -> str:
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    whole, rest = divmod(round(60.0 * value, digits), 60.0)
    if step % 60.0 == 0.0:
        return f"{whole:.0f}°"
    width = 2 + (digits + 1 if digits else 0)
    return f"{whole:.0f}°{rest:0{width}.{digits}f}′"


def draw_scale_bar(axes: Axes, box: Box) -> float:
    """Draw a bar of round length in the lower left corner; return its length [m]."""
    west, east, south, north = box
    middle = 0.5 * (south + north)
    metres = math.radians(1.0) * normal_radius(middle) * math.cos(math.radians(middle))
    long = max((b for b in BARS if b <= BAR_SHARE * (east - west) * metres), default=BARS[0])
    x, y = west + 0.05 * (east - west), south + 0.045 * (north - south)
    ends = np.array([x, x + long / metres])
    axes.plot(ends, [y, y], color="white", lw=5.0, solid_capstyle="butt", zorder=5)
    axes.plot(ends, [y, y], color=style.COMMAND, lw=2.0, solid_capstyle="butt", zorder=6)
    text = f"{long / 1000:g} km" if long >= 1000 else f"{long} m"
    axes.annotate(
        text, (float(ends.mean()), y), (0, 5), textcoords="offset points", ha="center",
        fontsize=7.5, zorder=6, bbox={"fc": "white", "ec": "none", "alpha": 0.7, "pad": 0.8},
    )  # fmt: skip
    return float(long)
