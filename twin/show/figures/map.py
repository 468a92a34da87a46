"""Map of a mission on Earth: coordinates, coast, fixes, track and currents, with a key."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import InputError
from twin.records.coordinates import NOMINAL
from twin.records.logged import AVERAGED, source_of
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.figures import map_ground as ground
from twin.show.figures.base import FigureKind

Array = NDArray[np.float64]

SEA = "#F4F8FB"
TRUE = "true track"  # name of the track of a simulated mission
SIZE, SHAPE = (5.4, 3.8), 1.05  # [in] of the figure; width / height of the map
UNDER_WATER = 3.0
"""[m] Depth that a dive between two fixes must exceed; else the vehicle stayed at the surface"""
STRETCHES = 12  # number of equal parts, each with a mean current, of a mission without fixes
LONGEST_ARROW = 0.45  # [in] length of the arrow of the 90th percentile of speed
ROUND_SPEEDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""[m/s] Speeds among which the key's arrow is chosen"""
ARROW: dict[str, Any] = {"angles": "uv", "scale_units": "inches", "width": 0.011, "units": "inches"}
LOCATOR, LOCATOR_LEAST, LOCATOR_MOST = 16.0, 8.0, 90.0
"""Height of the small locator map. LOCATOR: smallest ratio to the map's height. LOCATOR_LEAST,
LOCATOR_MOST: [degree of latitude] limits between which it grows until it shows a coast"""
LETTERS = 24  # characters of a line in the key
LOCATOR_ID, KEY_ID = "locator", "key"  # names of the axes beside a map, whose numbers need no unit


class Currents(NamedTuple):
    """Horizontal currents at some places, each field of shape (n,)."""

    latitude: Array
    longitude: Array
    """[degree]"""
    north: Array
    east: Array
    """[m/s]"""
    name: str
    """Name for the key"""
    colour: str = style.TRUTH


class MapContent(NamedTuple):
    """Content of a map; positions in degrees."""

    tracks: tuple[tuple[Array, Array], ...]
    """Latitude and longitude of the tracks, arrays of shape (time,)"""
    name: str
    """Name of the tracks"""
    fixes: tuple[Array, Array] | None = None
    """Latitude and longitude of the fixes"""
    currents: tuple[Currents, ...] = ()


def map_figure(trajectory: Trajectory) -> Figure:
    """Draw a mission on the map, with the mean current of each dive or stretch.

    Raises:
      InputError: the mission has no place on Earth.
    """
    return draw_content(content_of(trajectory))


def content_of(trajectory: Trajectory) -> MapContent:
    """Content of a trajectory's map; raise InputError without a place on Earth."""
    try:
        latitude, longitude = trajectory.geographic_position()
    except InputError as error:
        raise InputError(f"{error}; the track figure draws it in metres") from error
    longitude = joined(longitude)
    fixed, fixes = fix_samples(trajectory), None
    if len(fixed):  # shift the track's position by the fix's offset [m]: exact to first order
        scale = np.radians(1.0) * 6_371_000.0
        north, east = (
            trajectory[f"measured_gps_{name}"][fixed] - trajectory[f"true_{name}"][fixed]
            for name in ("north", "east")
        )
        shrink = np.cos(np.radians(latitude[fixed]))
        fixes = (latitude[fixed] + north / scale, longitude[fixed] + east / scale / shrink)
    nominal = "place" in str(trajectory.provenance.get(NOMINAL, ""))
    word = f"{TRUE} (nominal place)" if nominal else TRUE
    return MapContent(
        tracks=((latitude, longitude),),
        name=source_of(trajectory, "true_north", word),
        fixes=fixes,
        currents=mean_currents(trajectory, latitude, longitude),
    )


def joined(longitude: Array) -> Array:
    """Longitudes [degree] unwrapped, without the jump at 180."""
    turned = np.array(longitude, float)
    known = np.isfinite(turned)
    turned[known] = np.unwrap(turned[known], period=360.0)
    return turned


def fix_samples(trajectory: Trajectory) -> NDArray[np.intp]:
    """Indices of the samples that have a GPS position."""
    names = ("measured_gps_north", "measured_gps_east")
    if any(name not in trajectory for name in names):
        return np.zeros(0, np.intp)
    return np.flatnonzero(np.isfinite([trajectory[name] for name in names]).all(axis=0))


def mean_currents(
    trajectory: Trajectory, latitude: Array, longitude: Array
) -> tuple[Currents, ...]:
    """Mean current of each dive between two fixes, or of equal stretches if there is no dive."""
    if any(f"true_current_{name}" not in trajectory for name in ("north", "east")):
        return ()
    north, east = (trajectory[f"true_current_{name}"] for name in ("north", "east"))
    depth = trajectory["true_depth"]
    edges = fix_samples(trajectory)
    pairs = [
        (a, b)
        for a, b in itertools.pairwise(edges)
        if b - a > 1 and np.nanmax(depth[a : b + 1], initial=0.0) > UNDER_WATER
    ]
    dives = bool(pairs)
    if not dives:
        edges = np.linspace(0, len(depth) - 1, STRETCHES + 1).astype(np.intp)
        pairs = list(itertools.pairwise(edges))
    rows = []
    for a, b in pairs:
        flow = np.stack([north[a : b + 1], east[a : b + 1]])
        known = flow[:, np.isfinite(flow).all(axis=0)]
        place = (latitude[(a + b) // 2], longitude[(a + b) // 2])
        if known.size and np.isfinite(place).all():
            rows.append((*place, known[0].mean(), known[1].mean()))
    if not rows:
        return ()
    word = source_of(trajectory, "true_current_north", "true current")
    over = "" if word == AVERAGED else ", mean of each dive" if dives else ", means"
    la, lo, n, e = np.array(rows).T
    return (Currents(la, lo, n, e, word + over),)


def draw_content(content: MapContent) -> Figure:
    """Draw the map, beside it a small locator map of the surroundings, and the key.

    Raises:
      InputError: no position is known.
    """
    places = [*content.tracks, *([] if content.fixes is None else [content.fixes])]
    latitude, longitude = (np.concatenate([place[k] for place in places]) for k in (0, 1))
    if not (np.isfinite(latitude) & np.isfinite(longitude)).any():
        raise InputError("no position on Earth is known: there is nothing to put on a map")
    box = ground.box_around(latitude, longitude, SHAPE)
    with style.styled():
        figure = style.new_figure(*SIZE)
        grid = figure.add_gridspec(2, 2, width_ratios=[2.55, 1.0], height_ratios=[1.0, 1.25])
        axes = figure.add_subplot(grid[:, 0])
        place, key = figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
        draw_base(axes, box)
        draw_tracks(axes, content)
        arrows = [(one, arrow_scale(content.currents)) for one in content.currents]
        for one, scale in arrows:
            draw_arrows(axes, one, scale)
        draw_locator(place, box)
        draw_key(key, axes, arrows)
    return figure


def draw_base(axes: Axes, box: ground.Box) -> None:
    """Draw sea, land, graticule and scale bar of an empty map."""
    axes.set_facecolor(SEA)
    ground.draw_land(axes, box)
    ground.draw_graticule(axes, box)
    ground.draw_scale_bar(axes, box)
    if ground.land_in_view(*box):
        axes.text(
            0.99, 0.01, ground.COAST_NOTE, transform=axes.transAxes, ha="right", va="bottom",
            fontsize=5.5, color=ground.SHORE, zorder=5,
        )  # fmt: skip


def draw_tracks(axes: Axes, content: MapContent) -> None:
    """Draw the tracks, their ends and the fixes, with labels for a key."""
    colour = style.TRUTH if content.name.startswith(TRUE) else style.ESTIMATE
    for index, (latitude, longitude) in enumerate(content.tracks):
        la, lo = style.thin(latitude, longitude)
        axes.plot(lo, la, color=colour, lw=1.3, label="" if index else content.name, zorder=2)
    if content.fixes is not None:
        la, lo = content.fixes
        axes.plot(lo, la, ".", color=style.COMMAND, ms=4.0, ls="none", label="GPS fix", zorder=3)
    la, lo = (np.concatenate([t[k] for t in content.tracks]) for k in (0, 1))
    known = np.flatnonzero(np.isfinite(la) & np.isfinite(lo))
    for name, index, marker in (("start", known[0], "o"), ("end", known[-1], "s")):
        axes.plot(lo[index], la[index], marker, ms=5.5, label=name, zorder=4, **style.END)


def arrow_scale(currents: Sequence[Currents]) -> float:
    """[m/s per inch] Scale of the arrows for all currents of a map."""
    speeds = np.concatenate([np.hypot(one.north, one.east) for one in currents])
    typical = float(np.percentile(speeds, 90)) if speeds.size else 0.0
    return max(typical, ROUND_SPEEDS[0]) / LONGEST_ARROW


def draw_arrows(axes: Axes, one: Currents, scale: float) -> None:
    """Draw the arrows of currents on a map."""
    arrows = axes.quiver(
        one.longitude, one.latitude, one.east, one.north, color=one.colour, scale=scale, zorder=3.5,
        **ARROW,
    )  # fmt: skip
    arrows.set_in_layout(False)


def draw_locator(axes: Axes, box: ground.Box) -> None:
    """Draw a small map of the surroundings, with the box of the large map."""
    west, east, south, north = box
    middle = 0.5 * (south + north), 0.5 * (west + east)
    tall = max(LOCATOR * (north - south), LOCATOR_LEAST)
    around = _around(middle, tall)
    while not ground.coast_within(*around) and tall < LOCATOR_MOST:  # the open ocean: look farther
        tall *= 1.5
        around = _around(middle, tall)
    axes.set_gid(LOCATOR_ID)
    axes.set_facecolor(SEA)
    ground.draw_land(axes, around, linewidth=0.4)
    ground.draw_graticule(axes, around, lines=2)
    axes.plot([west, east, east, west, west], [south, south, north, north, south],
              color=style.ESTIMATE, lw=1.0, zorder=4)  # fmt: skip
    axes.plot(middle[1], middle[0], "o", ms=3.0, color=style.ESTIMATE, zorder=4)
    axes.tick_params(labelsize=6.5, pad=2)
    axes.set_xlabel("")
    axes.set_ylabel("")


def _around(middle: tuple[float, float], tall: float) -> ground.Box:
    """Square box of height `tall` [degree of latitude] about a place (latitude, longitude)."""
    half = 0.5 * min(tall, LOCATOR_MOST)
    low, high = max(middle[0] - half, -89.5), min(middle[0] + half, 89.5)
    wide = min(half / ground.cosine(middle[0]), 180.0)
    return (middle[1] - wide, middle[1] + wide, low, high)


def draw_key(
    axes: Axes, map_axes: Axes, arrows: Sequence[tuple[Currents, float]], heading: str = ""
) -> None:
    """Draw the key: names of lines and marks, and an arrow of a round speed for each current.

    Args:
      heading: common title of the currents; with it names stand beside the arrows, else below.
    """
    axes.set_axis_off()
    axes.set_gid(KEY_ID)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    handles, names = map_axes.get_legend_handles_labels()
    axes.legend(handles, names, loc="upper left", bbox_to_anchor=(-0.08, 1.02), borderaxespad=0.0)
    if heading and arrows:
        axes.text(0.0, 0.30, heading, fontsize=7.5)
    for row, (one, scale) in enumerate(arrows):
        speed = max((s for s in ROUND_SPEEDS if s <= 1.2 * scale * LONGEST_ARROW),
                    default=ROUND_SPEEDS[0])  # fmt: skip
        y = (0.18 if heading else 0.30) - 0.14 * row
        arrow = axes.quiver([0.0], [y], [speed], [0.0], color=one.colour, scale=scale, **ARROW)
        arrow.set_in_layout(False)
        text = f"{100 * speed:g} cm/s"
        axes.text(0.46, y, f"{text}, {one.name}" if heading else text, va="center", fontsize=7.5,
                  color=one.colour if heading else style.COMMAND)  # fmt: skip
        if not heading:
            name = "\n".join(textwrap.wrap(one.name, LETTERS))
            axes.text(0.0, y - 0.055, name, va="top", fontsize=7.5, color=one.colour)


FIGURE = FigureKind(
    "map", "the mission on a map: coordinates, coast, fixes, track, currents as arrows", map_figure
)
