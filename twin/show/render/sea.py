"""Sea: the water around the track and the ground below, as a block, a chart or open water.

The ground is the mission's sea floor if its scenario has one, else decoration.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np

from twin.show.render import canvas, ribbon, shapes
from twin.show.render.camera import Array, SceneLayout, nice_step, ticks
from twin.show.render.shapes import DRIFT, LEVEL, SEABED, SUN, WORLD, Props, Shape
from twin.water.floor.lookup import floor_depths

OPEN_BANDS, BANDS, WALL_BANDS = 256, 96, 96
"""Steps of colour gradients, too fine to be seen. OPEN_BANDS: open water. BANDS: backdrop around a
block and behind the close-up. WALL_BANDS: walls"""
REACH = 70.0
"""[m] Visible distance straight up or down through the water: sets the backdrop's gradient"""
OPEN_RADIUS = 700.0  # [m] radius of the chase camera's backdrop
RELIEF, CELLS, CHART_CELLS = 26, 96, 200
"""Grid cells along each side. RELIEF: decorative relief and waves. CELLS: sea floor. CHART_CELLS:
the map's floor, whose colour edges are visible"""
RELIEF_SHARE = 0.05  # largest height of the floor's relief / depth of the block
SHADOW_LIFT, SHADOW_WIDTH = 0.03, 0.1
"""[display units] SHADOW_LIFT: height of a shadow above the ground. SHADOW_WIDTH: its width"""
WAVE_SHARE = 0.0035  # height of the drawn waves / length of the block
OPEN_FADE, FADES = 90.0, 48
"""OPEN_FADE: [m] distance at which surface and floor fade out. FADES: number of fading rings"""
SNOW_BOX, SNOW_COUNT, SNOW_SIZE = 14.0, 260, 0.010
"""Drifting particles in a cube show motion. SNOW_BOX: [m] its side. SNOW_SIZE: [m] radius"""
IN_SIGHT = 2.0
"""Largest depth of a block with a sea floor, as a multiple of its depth without one: a dive to
100 m above an abyss stays visible"""
FLOOR_MARGIN = 1.04  # depth of the block, as a multiple of the deepest floor in it
CHART_BANDS = 14  # steps of the map's colours
SHADED, LIT = 0.95, 0.18
"""Ends of the map's floor colours, as relative depths in the water palette"""
SEEN_FROM = 70.0  # [m] altitude from which the chase camera no longer sees the floor
ABOVE, PALE = np.array([0.10, 0.42, 0.55]), np.array([0.9, 0.97, 1.0])
"""Colours. ABOVE: of the surface seen from above. PALE: of lines"""


def backdrop_radius(layout: SceneLayout) -> float:
    """[display units] Radius of a sphere around the block and the cameras that frame it."""
    return 6.0 * float(np.linalg.norm(layout.size * layout.factors)) + 60.0


def add_backdrop(
    props: Props, name: str, group: int, radius: float, *, light: bool, bands: int = BANDS
) -> list[str]:
    """Add a sphere around the scene, in bands that form a colour gradient; return their names."""
    colours = backdrop_colours(0.0 if light else None, bands)
    look: dict[str, Any] = {"group": group, "body": WORLD}
    return [
        props.add(f"{name}_{i}", shapes.band(radius, low, high), colours[i], **look)
        for i, (low, high) in enumerate(itertools.pairwise(_elevations(bands).tolist()))
    ]


def _elevations(bands: int) -> Array:
    return np.linspace(-math.pi / 2, math.pi / 2, bands + 1)


def backdrop_colours(depth: float | None, bands: int) -> Array:
    """Colours of a backdrop's bands, shape (bands, 3).

    Args:
      depth: [m] depth of the viewpoint in open water, negative above; None: a dark backdrop.
    """
    edges = _elevations(bands)
    rise = np.sin((edges[1:] + edges[:-1]) / 2)[:, None]
    # The sun lights faces that point up, the backdrop's lower half: compensate that.
    dim = 1.0 / (1.0 + SUN * np.clip(-rise, 0.0, None))
    if depth is None:
        blend = 0.5 + 0.5 * np.tanh(2.2 * rise)
        top, bottom = canvas.BACKDROP_TOP, canvas.BACKDROP_BOTTOM
        return np.asarray(dim * (bottom + blend * (top - bottom)))
    # A view upwards sees shallower, brighter water; a view downwards the reverse.
    light = np.exp(-np.clip(depth - REACH * rise, 0.0, None) / canvas.LIGHT_DEPTH)
    seen = canvas.DEEP_LIGHT + (canvas.SURFACE_LIGHT - canvas.DEEP_LIGHT) * light
    up = np.clip(rise, 0.0, None)
    colours = dim * seen * (1.0 + 0.25 * up)
    sky = canvas.HORIZON + up**0.6 * (canvas.ZENITH - canvas.HORIZON)
    return np.where((rise > 0.0) & (depth < 0.0), sky, colours)


def add_block(
    props: Props, layout: SceneLayout, floor: Array | None, path: Array, *, cut: bool = False
) -> None:
    """Add walls coloured by depth with ticks, the surface, the ground and the path's shadow.

    Args:
      floor: table of the sea floor.
      path: track in NED [m], (n, 3).
      cut: leave out the sea floor between the side camera and the path, so that no ground hides
        the lower turns of the dives.
    """
    corners = layout.corners()
    bottom = float(corners[4, 2])
    walls = [(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    inward = corners[:4].mean(axis=0) - corners[0]
    if _wall(*walls[0], 0.0, -1.0).normals[0] @ inward < 0:
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
    length = float((layout.size * layout.factors)[:2].max())
    above = sheet(layout, WAVE_SHARE * length * _terrain(RELIEF + 1, seed=11, rough=0.9))
    props.add("surface", above, canvas.GLASS, alpha=0.17, material="lit")
    below = dataclasses.replace(above, faces=above.faces[:, ::-1], normals=-above.normals)
    props.add("surface_below", below, canvas.GLASS, alpha=0.22, material="lit")
    if floor is None:
        _add_made_up(props, layout, canvas.SAND)
        height: Array | float = bottom * (1.0 - 1.2 * RELIEF_SHARE)
    elif _add_ground(props, layout, floor, path, cut):
        deep = np.minimum(floor_depths(floor, *_north_east(path)), layout.high[2])
        height = -deep * layout.factors[2] + SHADOW_LIFT
    else:
        return
    if (fallen := shadow(layout, path, height)) is not None:
        props.add("shadow", fallen, canvas.SAND * 0.22, alpha=0.75)


def add_chart(props: Props, layout: SceneLayout, floor: Array | None) -> None:
    """Add a chart: a grid of round metres over ground coloured by depth, or as deep water."""
    corners = layout.corners()
    if floor is None:
        _add_made_up(props, layout, canvas.water_colour(0.62))
    width = 0.0013 * float((layout.size * layout.factors)[:2].max())
    height = float(corners[4, 2]) * (1.0 - 1.5 * RELIEF_SHARE)
    lines = []
    for axis in (0, 1):
        for value in grid_values(layout, axis):
            ends = np.array([layout.low, layout.high])
            ends[:, axis], ends[:, 2] = value, 0.0
            lines.append(_level_strip(layout.display_block(ends), width, height))
    if lines:
        props.add("grid", shapes.merge(lines), PALE, alpha=0.22)
    rim = [_level_strip(corners[[i, (i + 1) % 4]], 2 * width, height) for i in range(4)]
    props.add("rim", shapes.merge(rim), np.ones(3), alpha=0.6)
    if floor is None:
        return
    # The ground has colours of depth, but is level so that no slope hides the track.
    found = floor_grid(floor, layout, CHART_CELLS)
    shape = sheet(layout, np.full_like(found, -float(layout.high[2]) * layout.factors[2]))
    middle = found.ravel()[shape.faces].mean(axis=1)
    edges = np.linspace(middle.min(), middle.max() + 1e-9, CHART_BANDS + 1)
    for i, (low, high) in enumerate(itertools.pairwise(edges)):
        inside = (middle >= low) & (middle < high)
        if inside.any():
            share = LIT + (SHADED - LIT) * i / (CHART_BANDS - 1)
            part = dataclasses.replace(shape, faces=shape.faces[inside])
            props.add(f"floor_{i}", part, canvas.water_colour(share))


def add_open_water(props: Props, layout: SceneLayout, floor: Array | None) -> list[str]:
    """Add surface and ground as rings around the glider that fade with distance.

    Returns:
      names of the ground's rings if there is a `floor`; they move with the depth under the glider.
    """
    radii = OPEN_FADE * np.linspace(0.0, 1.0, FADES + 1) ** 1.4
    names = []
    for i, (inner, outer) in enumerate(itertools.pairwise(np.maximum(radii, 0.01).tolist())):
        fade = (1.0 - (i + 0.5) / FADES) ** 1.3
        below = shapes.ring(inner, outer, 0.0, up=False)
        props.add(f"surface_{i}", below, np.array([0.75, 0.97, 1.0]), alpha=0.55 * fade, body=LEVEL)
        above = shapes.ring(inner, outer, 0.0, up=True)
        props.add(f"surface_above_{i}", above, ABOVE, alpha=0.30 + 0.35 * (1 - fade), body=LEVEL)
        depth, body = (float(layout.high[2]), LEVEL) if floor is None else (0.0, SEABED)
        ring = shapes.ring(inner, outer, -depth, up=True)
        names.append(props.add(f"floor_{i}", ring, canvas.SAND * 0.8, alpha=fade, body=body))
    return names if floor is not None else []


def add_snow(props: Props) -> str:
    """Add particles that make motion visible, repeated every SNOW_BOX; return the geom's name."""
    rng = np.random.default_rng(5)
    cell = rng.uniform(0.0, SNOW_BOX, size=(SNOW_COUNT, 3))
    # Eight copies of one cell look endless, since they are moved by less than a cell.
    copies = [cell + SNOW_BOX * (np.array(o) - 1.0) for o in np.ndindex(2, 2, 2)]
    sizes = np.tile(SNOW_SIZE * rng.uniform(0.4, 1.0, SNOW_COUNT), 8)
    grains = shapes.grains(np.concatenate(copies), sizes)
    return props.add("snow", grains, np.array([0.85, 0.95, 1.0]), alpha=0.55, body=DRIFT)


def floor_grid(table: Array, layout: SceneLayout, cells: int = CELLS) -> Array:
    """[m] Depths of the floor on a grid over the block, in the order of `sheet`, shape (n, n)."""
    x = np.linspace(layout.low[0], layout.high[0], cells + 1)
    y = np.linspace(layout.high[1], layout.low[1], cells + 1)
    block = np.stack(np.broadcast_arrays(x[:, None], y, 0.0), axis=-1)
    found = floor_depths(table, *_north_east(layout.to_ned(block.reshape(-1, 3))))
    return np.asarray(found).reshape(block.shape[:2])


def _north_east(ned: Array) -> tuple[Array, Array]:
    return np.ascontiguousarray(ned[:, 0]), np.ascontiguousarray(ned[:, 1])


def block_depth(table: Array, layout: SceneLayout) -> float:
    """[m] Depth of a block that reaches the sea floor, at most IN_SIGHT times its usual depth."""
    usual = float(layout.high[2])
    return min(max(usual, FLOOR_MARGIN * float(floor_grid(table, layout).max())), IN_SIGHT * usual)


def depth_ticks(layout: SceneLayout) -> Array:
    """[m] Depths of the marks on the walls, without 0."""
    found = ticks(0.0, float(layout.high[2]), about=5)
    return found[found > 0]


def grid_values(layout: SceneLayout, axis: int) -> Array:
    """[m] Round coordinates of the map's grid lines along the block's x (0) or y (1)."""
    step = nice_step(float(layout.size[:2].max()) / 6)
    first = math.ceil(layout.low[axis] / step)
    last = math.floor(layout.high[axis] / step)
    return step * np.arange(first, last + 1, dtype=float)


def _add_made_up(props: Props, layout: SceneLayout, colour: Array) -> None:
    """Add a decorative floor whose relief fades out towards the block's edges."""
    bottom = float(layout.corners()[4, 2])
    fade = np.sin(np.pi * np.linspace(0.0, 1.0, RELIEF + 1)) ** 0.5
    relief = RELIEF_SHARE * abs(bottom) * np.outer(fade, fade)
    ground = sheet(layout, bottom + relief * _terrain(RELIEF + 1, seed=7))
    props.add("floor", ground, colour, material="matte")


def _add_ground(props: Props, layout: SceneLayout, table: Array, path: Array, cut: bool) -> bool:
    """Add the sea floor as top of a block of ground; return False if it is below the picture."""
    bottom = float(layout.high[2])
    ground = np.minimum(floor_grid(table, layout), bottom)
    if ground.min() >= bottom:  # the floor is below the picture: draw deep water
        level = np.full_like(ground, -bottom * layout.factors[2])
        props.add("deep", sheet(layout, level), canvas.water_colour(1.0))
        return False
    shape, count = sheet(layout, -ground * layout.factors[2]), len(ground)
    first = 0
    if cut:
        free = layout.high[1] - layout.to_block(path)[:, 1].max()
        first = min(max(int(free / layout.size[1] * (count - 1)), 0), count - 2)
        kept = (shape.faces % count >= first).all(axis=1)
        shape = dataclasses.replace(shape, faces=shape.faces[kept])
    props.add("floor", shape, canvas.SAND, material="matte")
    sides = _sides(shape, count, first, -bottom * layout.factors[2])
    props.add("ground", sides, canvas.SAND * 0.6)
    return True


def shadow(layout: SceneLayout, path: Array, height: Array | float) -> Shape | None:
    """Shadow of a path (n, 3), a band at display heights (n,); None for a path without extent."""
    nodes = layout.display(path)
    nodes[:, 2] = height
    nodes = nodes[ribbon.simplify(nodes, SHADOW_WIDTH / 2)]
    if np.ptp(nodes[:, :2], axis=0).max() < SHADOW_WIDTH:
        return None
    half = SHADOW_WIDTH / 2 * shapes.tube_frame(nodes)[0]
    faces = shapes.strip_faces(len(nodes))
    return Shape(
        vertices=np.concatenate([nodes - half, nodes + half]),
        faces=np.concatenate([faces, faces[:, ::-1]]),
        normals=np.tile([0.0, 0.0, 1.0], (2 * len(nodes), 1)),
    )


def _wall(a: Array, b: Array, top: float, low: float, lift: float = 0.0) -> Shape:
    """Strip of the wall from corner `a` to `b` between two heights, moved inwards by `lift`."""
    corners = [[a[0], a[1], low], [b[0], b[1], low], [b[0], b[1], top], [a[0], a[1], top]]
    strip = shapes.quad(np.array(corners))
    return dataclasses.replace(strip, vertices=strip.vertices + lift * strip.normals)


def _level_strip(ends: Array, width: float, height: float) -> Shape:
    """Level strip between two points (2, 3) at a height, visible from above."""
    a, b = ends[:, :2]
    across = width / 2 * np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
    corners = np.array([a - across, b - across, b + across, a + across])
    return shapes.quad(np.column_stack([corners, np.full(4, height)]))


def sheet(layout: SceneLayout, height: Array) -> Shape:
    """Sheet over the block with `height` (n, n) in display units."""
    count = len(height)
    # Block y runs to the right of x, display y to the left: reverse the order of y.
    x = np.linspace(layout.low[0], layout.high[0], count) * layout.scale
    y = -np.linspace(layout.high[1], layout.low[1], count) * layout.scale
    origin, ahead = layout.display_block(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    forward = (ahead - origin) / layout.scale
    left = np.array([-forward[1], forward[0], 0.0])
    turn = np.column_stack([forward, left, [0.0, 0.0, 1.0]])
    shape = shapes.relief(x, y, height, turn)
    return dataclasses.replace(shape, vertices=shape.vertices + origin * [1.0, 1.0, 0.0])


def _terrain(cells: int, *, seed: int, rough: float = 0.55) -> Array:
    """Smooth random heights between -1 and 1, shape (cells, cells), determined by `seed`.

    The heights are sums of waves of halving length: decoration, not bathymetry.
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


def clearness(altitude: float) -> float:
    """Visibility of the floor from an altitude [m], 0 to 1."""
    return float(np.clip(1.0 - altitude / SEEN_FROM, 0.0, 1.0))


def _sides(sheet: Shape, count: int, first: int, bottom: float) -> Shape:
    """Side walls of the ground, from the rim of a sheet down to the height `bottom`.

    The sheet has (count, count) nodes; columns before `first` are left out.
    """
    index = np.arange(count * count).reshape(count, count)[:, first:]
    middle = sheet.vertices[index].mean(axis=(0, 1))
    sides = []
    for rim in (index[:, 0], index[-1, :], index[::-1, -1], index[0, ::-1]):
        top = sheet.vertices[rim]
        low = np.column_stack([top[:, :2], np.full(len(rim), bottom)])
        faces = shapes.strip_faces(len(rim))
        along = top[-1] - top[0]
        normal = np.array([along[1], -along[0], 0.0])
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        if normal @ (top.mean(axis=0) - middle) < 0:
            normal = -normal
        corners = np.concatenate([top, low])
        a, b, c = corners[faces[0]]
        if np.cross(b - a, c - a) @ normal < 0:
            faces = faces[:, ::-1]
        normals = np.tile(normal, (len(corners), 1))
        sides.append(Shape(vertices=corners, faces=faces, normals=normals))
    return shapes.merge(sides)
