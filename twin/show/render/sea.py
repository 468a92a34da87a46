"""Sea: the water around the track. A block with walls, surface and floor; a chart; open water."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from numpy.typing import NDArray

from twin.show.render import canvas, shapes
from twin.show.render.ribbon import simplify
from twin.show.render.scene_geometry import SceneLayout, nice_step, ticks
from twin.show.render.shapes import DRIFT, LEVEL, SUN, WORLD, Props, Shape

Array = NDArray[np.float64]

OPEN_BANDS, BANDS, WALL_BANDS = 256, 96, 96
"""Steps of the colour gradients of open water, of the backdrop around a block and behind the
close-up, and of walls: fine enough that the eye sees none"""
REACH = 70.0
"""[m] that one sees through the water, straight up or down: sets the backdrop's gradient"""
OPEN_RADIUS = 700.0
"""[m] of the chase camera's backdrop"""
RELIEF = 26
"""Grid cells of sea floor and surface along each side"""
RELIEF_SHARE = 0.05
"""Largest height of the floor's relief over the block's depth"""
SHADOW_LIFT = 0.03
"""[display units] of a shadow over the ground that it falls on"""
WAVE_SHARE = 0.0035
"""Height of the drawn waves over the block's length"""
OPEN_FADE = 90.0
"""[m] at which surface and floor fade out for the chase camera"""
FADES = 48
"""Rings of the fading: fine enough that the eye sees none"""
SNOW_BOX, SNOW_COUNT, SNOW_SIZE = 14.0, 260, 0.010
"""[m] of the cube of drifting particles, their number and radius [m]: our choice, for motion"""
ABOVE = np.array([0.10, 0.42, 0.55])
"""The surface seen from above"""
PALE = np.array([0.9, 0.97, 1.0])


def backdrop_radius(layout: SceneLayout) -> float:
    """[display units] of a sphere that holds the block and the cameras that frame it."""
    return 6.0 * float(np.linalg.norm(layout.size * layout.factors)) + 60.0


def add_backdrop(
    props: Props, name: str, group: int, radius: float, *, light: bool, bands: int = BANDS
) -> list[str]:
    """A sphere around everything, in bands whose colours make a gradient; their names."""
    edges = _elevations(bands)
    colours = backdrop_colour((edges[1:] + edges[:-1]) / 2, 0.0 if light else None)
    return [
        props.add(
            f"{name}_{i}",
            shapes.band(radius, float(low), float(high)),
            colours[i],
            group=group,
            body=WORLD,
        )
        for i, (low, high) in enumerate(itertools.pairwise(edges))
    ]


def _elevations(bands: int) -> Array:
    return np.linspace(-math.pi / 2, math.pi / 2, bands + 1)


def backdrop_colours(depth: float, bands: int) -> Array:
    """Colours of a backdrop's bands for a camera at `depth` [m]; negative is above the water.

    Shape (bands, 3).
    """
    edges = _elevations(bands)
    middles = (edges[1:] + edges[:-1]) / 2
    colours = backdrop_colour(middles, depth)
    if depth < 0.0:
        rise = np.sin(np.clip(middles, 0.0, None))[:, None] ** 0.6
        sky = canvas.HORIZON + rise * (canvas.ZENITH - canvas.HORIZON)
        return np.where(middles[:, None] > 0.0, sky, colours)
    return colours


def backdrop_colour(elevation: Array, depth: float | None) -> Array:
    """Colour at elevations [rad] (n,): open water seen from `depth` [m], or dark. Shape (n, 3)."""
    rise = np.sin(elevation)[:, None]
    # The sun lights what faces up, which is the backdrop's lower half; it must not look lit.
    dim = 1.0 / (1.0 + SUN * np.clip(-rise, 0.0, None))
    if depth is None:
        blend = 0.5 + 0.5 * np.tanh(2.2 * rise)
        top, bottom = canvas.BACKDROP_TOP, canvas.BACKDROP_BOTTOM
        return np.asarray(dim * (bottom + blend * (top - bottom)))
    # Looking up is looking at shallower, brighter water; looking down the reverse.
    seen = canvas.ambient_colour(depth - REACH * rise)
    return np.asarray(dim * seen * (1.0 + 0.25 * np.clip(rise, 0.0, None)))


def add_block(props: Props, layout: SceneLayout, path: Array | None) -> None:
    """Walls coloured by depth with ticks, and the surface.

    With a `path` (n, 3) NED also a decorative floor and the path's shadow on it.
    """
    corners = layout.corners()
    bottom = float(corners[4, 2])
    walls = [(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    middle = corners[:4].mean(axis=0)
    if _wall(*walls[0], 0.0, -1.0).normals[0] @ (middle - walls[0][0]) < 0:
        walls = [(b, a) for a, b in walls]
    edges = np.linspace(0.0, bottom, WALL_BANDS + 1)
    for i, (top, low) in enumerate(itertools.pairwise(edges)):
        strips = [_wall(a, b, top, low) for a, b in walls]
        props.add(f"wall_{i}", shapes.merge(strips), canvas.water_colour((i + 0.5) / WALL_BANDS))
    width = 0.004 * abs(bottom) + 0.012
    lines = []
    for depth in depth_ticks(layout):
        z = -depth * layout.factors[2]
        lines += [_wall(a, b, z + width / 2, z - width / 2, lift=0.02) for a, b in walls]
    props.add("depth_lines", shapes.merge(lines), PALE, alpha=0.38)
    rims = [_wall(a, b, 0.0, -2 * width, lift=0.02) for a, b in walls]
    props.add("rim", shapes.merge(rims), np.ones(3), alpha=0.75)
    _add_surface(props, layout)
    if path is None:
        return
    _add_floor(props, layout, canvas.SAND)
    fallen = shadow(layout, path, layout.corners()[4, 2] * (1.0 - 1.2 * RELIEF_SHARE))
    if fallen is not None:
        props.add("shadow", fallen, canvas.SAND * 0.22, alpha=0.75)


def add_chart(props: Props, layout: SceneLayout, *, ground: bool = True) -> None:
    """A grid of round metres, and as `ground` a floor in the colour of deep water."""
    corners = layout.corners()
    if ground:
        _add_floor(props, layout, canvas.water_colour(0.62))
    width = 0.0013 * float((layout.size * layout.factors)[:2].max())
    height = float(corners[4, 2]) * (1.0 - 1.5 * RELIEF_SHARE)
    step = grid_step(layout)
    lines = []
    for axis in (0, 1):
        for value in grid_values(layout, axis, step):
            ends = np.array([layout.low, layout.high])
            ends[:, axis] = value
            ends[:, 2] = 0.0
            lines.append(_level_strip(layout.display_block(ends), width, height))
    if lines:
        props.add("grid", shapes.merge(lines), PALE, alpha=0.22)
    rim = [_level_strip(corners[[i, (i + 1) % 4]], 2 * width, height) for i in range(4)]
    props.add("rim", shapes.merge(rim), np.ones(3), alpha=0.6)


def fading_rings() -> list[tuple[float, float, float]]:
    """Inner and outer radius [m] and opacity of rings around the glider that fade out."""
    radii = OPEN_FADE * np.linspace(0.0, 1.0, FADES + 1) ** 1.4
    return [
        (max(float(radii[i]), 0.01), float(radii[i + 1]), (1.0 - (i + 0.5) / FADES) ** 1.3)
        for i in range(FADES)
    ]


def add_open_water(props: Props, layout: SceneLayout, *, ground: bool = True) -> None:
    """Surface, and as `ground` a floor, as rings around the glider that fade with distance."""
    floor = -float(layout.high[2])
    for i, (inner, outer, fade) in enumerate(fading_rings()):
        below = shapes.ring(inner, outer, 0.0, up=False)
        props.add(f"surface_{i}", below, np.array([0.75, 0.97, 1.0]), alpha=0.55 * fade, body=LEVEL)
        above = shapes.ring(inner, outer, 0.0, up=True)
        props.add(f"surface_above_{i}", above, ABOVE, alpha=0.30 + 0.35 * (1 - fade), body=LEVEL)
        if ground:
            ring = shapes.ring(inner, outer, floor, up=True)
            props.add(f"floor_{i}", ring, canvas.SAND * 0.8, alpha=fade, body=LEVEL)


def add_snow(props: Props) -> str:
    """Particles in the water, so that motion shows; the geom's name. They repeat every SNOW_BOX."""
    rng = np.random.default_rng(5)
    cell = rng.uniform(0.0, SNOW_BOX, size=(SNOW_COUNT, 3))
    # Eight copies of one cell: moved by less than a cell, they look endless.
    copies = [cell + SNOW_BOX * (np.array(o) - 1.0) for o in np.ndindex(2, 2, 2)]
    sizes = np.tile(SNOW_SIZE * rng.uniform(0.4, 1.0, SNOW_COUNT), 8)
    grains = shapes.grains(np.concatenate(copies), sizes)
    return props.add("snow", grains, np.array([0.85, 0.95, 1.0]), alpha=0.55, body=DRIFT)


def depth_ticks(layout: SceneLayout) -> Array:
    """Depths [m] that the walls mark, without 0."""
    found = ticks(0.0, float(layout.high[2]), about=5)
    return found[found > 0]


def grid_step(layout: SceneLayout) -> float:
    """[m] between the map's grid lines."""
    return nice_step(float(layout.size[:2].max()) / 6)


def grid_values(layout: SceneLayout, axis: int, step: float) -> Array:
    """Multiples of `step` [m] within the block along its x (0) or y (1)."""
    first = math.ceil(layout.low[axis] / step)
    last = math.floor(layout.high[axis] / step)
    return step * np.arange(first, last + 1, dtype=float)


def _add_floor(props: Props, layout: SceneLayout, colour: Array) -> None:
    """The sea floor, its relief fading out towards the block's edges."""
    bottom = float(layout.corners()[4, 2])
    fade = np.sin(np.pi * np.linspace(0.0, 1.0, RELIEF + 1)) ** 0.5
    relief = RELIEF_SHARE * abs(bottom) * np.outer(fade, fade)
    ground = sheet(layout, bottom + relief * _terrain(RELIEF + 1, seed=7))
    props.add("floor", ground, colour, material="matte")


def _add_surface(props: Props, layout: SceneLayout) -> None:
    """The sea surface, seen from above and from below."""
    length = float((layout.size * layout.factors)[:2].max())
    above = sheet(layout, WAVE_SHARE * length * _terrain(RELIEF + 1, seed=11, rough=0.9))
    props.add("surface", above, canvas.GLASS, alpha=0.17, material="lit")
    below = dataclasses.replace(above, faces=above.faces[:, ::-1], normals=-above.normals)
    props.add("surface_below", below, canvas.GLASS, alpha=0.22, material="lit")


def shadow(
    layout: SceneLayout, path: Array, height: Array | float, width: float = 0.1
) -> Shape | None:
    """The projection of a path (n, 3) at display heights (n,), a band; None if it goes nowhere."""
    nodes = layout.display(path)
    nodes[:, 2] = height
    nodes = nodes[simplify(nodes, width / 2)]
    if np.ptp(nodes[:, :2], axis=0).max() < width:
        return None
    side, _ = shapes.tube_frame(nodes)
    count = len(nodes)
    faces = shapes.strip_faces(count)
    return Shape(
        vertices=np.concatenate([nodes - width / 2 * side, nodes + width / 2 * side]),
        faces=np.concatenate([faces, faces[:, ::-1]]),
        normals=np.tile([0.0, 0.0, 1.0], (2 * count, 1)),
    )


def _wall(a: Array, b: Array, top: float, low: float, lift: float = 0.0) -> Shape:
    """A strip of the wall from corner `a` to `b` between two heights, moved in by `lift`."""
    corners = [[a[0], a[1], low], [b[0], b[1], low], [b[0], b[1], top], [a[0], a[1], top]]
    strip = shapes.quad(np.array(corners))
    return dataclasses.replace(strip, vertices=strip.vertices + lift * strip.normals)


def _level_strip(ends: Array, width: float, height: float) -> Shape:
    """A level strip between two points (2, 3), seen from above, at a height."""
    a, b = ends[:, :2]
    across = width / 2 * np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
    corners = np.array([a - across, b - across, b + across, a + across])
    return shapes.quad(np.column_stack([corners, np.full(4, height)]))


def sheet(layout: SceneLayout, height: Array) -> Shape:
    """A sheet over the block, `height` (n, n) in display units."""
    count = len(height)
    # Block y runs to the right of x, display y to the left: count it from the far side.
    x = np.linspace(layout.low[0], layout.high[0], count) * layout.scale
    y = -np.linspace(layout.high[1], layout.low[1], count) * layout.scale
    origin, ahead = layout.display_block(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    forward = (ahead - origin) / layout.scale
    left = np.array([-forward[1], forward[0], 0.0])
    turn = np.column_stack([forward, left, [0.0, 0.0, 1.0]])
    shape = shapes.relief(x, y, height, turn)
    offset = np.array([origin[0], origin[1], 0.0])
    return dataclasses.replace(shape, vertices=shape.vertices + offset)


def _terrain(cells: int, *, seed: int, rough: float = 0.55) -> Array:
    """Smooth random heights between -1 and 1, the same for the same seed. Shape (cells, cells).

    Decoration, not bathymetry: sums of waves of halving length.
    """
    rng = np.random.default_rng(seed)
    u = np.linspace(0.0, 1.0, cells)
    heights = np.zeros((cells, cells))
    for octave in range(4):
        for _ in range(4):
            angle, phase = rng.uniform(0, 2 * np.pi, 2)
            waves = 2 * np.pi * 1.3 * 2**octave
            across = np.cos(angle) * u[:, None] + np.sin(angle) * u[None, :]
            heights += rough**octave * np.sin(waves * across + phase)
    return heights / np.abs(heights).max()
