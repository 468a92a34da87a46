"""Seabed: the mission's own sea floor, where its scenario has one; else `sea` decorates."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from numpy.typing import NDArray

from twin.show.render import canvas, sea, shapes
from twin.show.render.scene_geometry import SceneLayout
from twin.show.render.shapes import SEABED, Props, Shape
from twin.water.floor.lookup import floor_depths

Array = NDArray[np.float64]

CELLS = 96
"""Grid cells along each side"""
CHART_CELLS = 200
"""As CELLS, of the map, where edges of colours are seen"""
IN_SIGHT = 2.0
"""The block is at most this much deeper than it would be without a floor: a dive to 100 m above
an abyss stays a dive"""
BELOW = 1.04
"""Depth of the block over that of the deepest floor in it"""
CHART_BANDS = 14
"""Steps of the map's colours"""
SHADED, LIT = 0.95, 0.18
"""Shares of the palette's water colours from the deepest to the shallowest floor"""
SEEN_FROM = 70.0
"""[m] height from which the chase camera sees the floor no more"""


def depths(table: Array, layout: SceneLayout, cells: int = CELLS) -> Array:
    """Depths [m] of the floor over the block, as `sea.sheet` counts them, shape (n, n)."""
    x = np.linspace(layout.low[0], layout.high[0], cells + 1)
    y = np.linspace(layout.high[1], layout.low[1], cells + 1)
    block = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((cells + 1,) * 2)], axis=-1)
    ned = layout.to_ned(block.reshape(-1, 3))
    north, east = (np.ascontiguousarray(ned[:, i]) for i in range(2))
    return np.asarray(floor_depths(table, north, east)).reshape(cells + 1, cells + 1)


def block_depth(table: Array, layout: SceneLayout) -> float:
    """[m] of a block that shows the floor, or as much water above it as is in sight."""
    usual = float(layout.high[2])
    return min(max(usual, BELOW * float(depths(table, layout).max())), IN_SIGHT * usual)


def add_block(
    props: Props, layout: SceneLayout, table: Array, path: Array, *, cut: bool = False
) -> None:
    """The floor as the top of a block of ground, with the shadow of `path` (n, 3) NED.

    `cut` takes away the ground on the starboard side of the path, from where the side camera looks:
    nothing may stand in front of the turns of its dives.
    """
    bottom = float(layout.high[2])
    ground = np.minimum(depths(table, layout), bottom)
    if ground.min() >= bottom:  # below the picture: the water goes on
        level = np.full_like(ground, -bottom * layout.factors[2])
        props.add("deep", sea.sheet(layout, level), canvas.water_colour(1.0))
        return
    sheet, count = sea.sheet(layout, -ground * layout.factors[2]), len(ground)
    first = 0
    if cut:
        free = layout.high[1] - layout.to_block(path)[:, 1].max()
        first = min(max(int(free / layout.size[1] * (count - 1)), 0), count - 2)
        kept = (sheet.faces % count >= first).all(axis=1)
        sheet = dataclasses.replace(sheet, faces=sheet.faces[kept])
    props.add("floor", sheet, canvas.SAND, material="matte")
    sides = _sides(sheet, count, first, -bottom * layout.factors[2])
    props.add("ground", sides, canvas.SAND * 0.6)
    north, east = (np.ascontiguousarray(path[:, i]) for i in range(2))
    below = np.minimum(floor_depths(table, north, east), bottom)
    shadow = sea.shadow(layout, path, -below * layout.factors[2] + sea.SHADOW_LIFT)
    if shadow is not None:
        props.add("shadow", shadow, canvas.SAND * 0.22, alpha=0.75)


def add_chart(props: Props, layout: SceneLayout, table: Array) -> None:
    """The map's ground in colours of depth, level so that no slope hides the track."""
    found = depths(table, layout, CHART_CELLS)
    level = np.full_like(found, -float(layout.high[2]) * layout.factors[2])
    sheet = sea.sheet(layout, level)
    middle = found.ravel()[sheet.faces].mean(axis=1)
    edges = np.linspace(middle.min(), middle.max() + 1e-9, CHART_BANDS + 1)
    for i, (low, high) in enumerate(itertools.pairwise(edges)):
        inside = (middle >= low) & (middle < high)
        if inside.any():
            share = LIT + (SHADED - LIT) * i / max(CHART_BANDS - 1, 1)
            part = dataclasses.replace(sheet, faces=sheet.faces[inside])
            props.add(f"floor_{i}", part, canvas.water_colour(share))


def add_open(props: Props) -> list[str]:
    """The floor under the chase camera's glider: rings that fade; the names of their geoms.

    They stand at height 0 of the body that is moved with the floor under the glider.
    """
    names = []
    for i, (inner, outer, fade) in enumerate(sea.fading_rings()):
        ring = shapes.ring(inner, outer, 0.0, up=True)
        names.append(props.add(f"floor_{i}", ring, canvas.SAND * 0.8, alpha=fade, body=SEABED))
    return names


def clearness(altitude: float) -> float:
    """How much of the floor is seen from an altitude [m], 0 to 1."""
    return float(np.clip(1.0 - altitude / SEEN_FROM, 0.0, 1.0))


def _sides(sheet: Shape, count: int, first: int, bottom: float) -> Shape:
    """The sides of the ground, from the rim of a sheet down to a height.

    The sheet has (count, count) nodes and begins with column `first`.
    """
    index = np.arange(count * count).reshape(count, count)[:, first:]
    rims = [index[:, 0], index[-1, :], index[::-1, -1], index[0, ::-1]]
    sides = []
    middle = sheet.vertices[index].mean(axis=(0, 1))
    for rim in rims:
        count = len(rim)
        top = sheet.vertices[rim]
        low = np.column_stack([top[:, :2], np.full(count, bottom)])
        faces = shapes.strip_faces(count)
        along = top[-1] - top[0]
        normal = np.array([along[1], -along[0], 0.0])
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        if normal @ (top.mean(axis=0) - middle) < 0:
            normal = -normal
        corners = np.concatenate([top, low])
        a, b, c = corners[faces[0]]
        if np.cross(b - a, c - a) @ normal < 0:
            faces = faces[:, ::-1]
        sides.append(Shape(vertices=corners, faces=faces, normals=np.tile(normal, (2 * count, 1))))
    return shapes.merge(sides)
