"""Shapes: triangle meshes of the scene, as vertices, faces, normals and texture coordinates.

All in display units (see `layout`), z up, faces counterclockwise seen from outside. MuJoCo draws
only front faces, which the water's walls use: whichever wall is nearest to the camera disappears.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Shape:
    """One mesh."""

    vertices: Array
    """Shape (n, 3)"""
    faces: Integers
    """Shape (m, 3), indices of vertices"""
    normals: Array
    """Unit, shape (n, 3)"""
    coordinates: Array | None = None
    """Texture coordinates, shape (n, 2)"""


def tube(nodes: Array, radius: float, sides: int, along: Array | None = None) -> Shape:
    """A round tube through `nodes` (n, 3), its ends closed by points.

    Args:
      radius: in display units.
      sides: of the polygon that stands for the circle.
      along: texture coordinate of each node, shape (n,).
    """
    side, up = tube_frame(nodes)
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    vertices = (nodes[:, None] + radius * ring).reshape(-1, 3)
    count = len(nodes)
    start = (np.arange(count - 1) * sides)[:, None] + np.arange(sides)
    beside = (np.arange(count - 1) * sides)[:, None] + (np.arange(sides) + 1) % sides
    faces = np.stack(
        [
            np.stack([start, start + sides, beside], axis=-1),
            np.stack([beside, start + sides, beside + sides], axis=-1),
        ],
        axis=2,
    ).reshape(-1, 3)
    coordinates = None
    if along is not None:
        repeated = np.repeat(along, sides)
        coordinates = np.stack([repeated, np.full_like(repeated, 0.5)], axis=-1)
    return Shape(
        vertices=vertices, faces=faces, normals=ring.reshape(-1, 3), coordinates=coordinates
    )


def tube_frame(nodes: Array) -> tuple[Array, Array]:
    """Two unit vectors across the curve at each node, both (n, 3), without sudden twists."""
    tangent = np.gradient(nodes, axis=0)
    length = np.linalg.norm(tangent, axis=-1, keepdims=True)
    tangent = np.where(length > 0, tangent / np.where(length > 0, length, 1.0), [1.0, 0.0, 0.0])
    # "Up" is the world's, which a glider's path never follows for long.
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    width = np.linalg.norm(side, axis=-1, keepdims=True)
    side = np.where(width > 1e-6, side / np.where(width > 1e-6, width, 1.0), [0.0, 1.0, 0.0])
    return side, np.cross(side, tangent)


def quad(corners: Array) -> Shape:
    """A flat quadrilateral, corners (4, 3) counterclockwise seen from its front."""
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    normal = normal / np.linalg.norm(normal)
    return Shape(
        vertices=np.asarray(corners, float),
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        normals=np.tile(normal, (4, 1)),
    )


def merge(shapes: list[Shape]) -> Shape:
    """Several shapes as one, without texture coordinates."""
    offsets = np.cumsum([0, *(len(s.vertices) for s in shapes[:-1])])
    return Shape(
        vertices=np.concatenate([s.vertices for s in shapes]),
        faces=np.concatenate([s.faces + o for s, o in zip(shapes, offsets, strict=True)]),
        normals=np.concatenate([s.normals for s in shapes]),
    )


def relief(x: Array, y: Array, height: Array, transform: Array) -> Shape:
    """A sheet over a grid: x (n,), y (m,), height (n, m), turned by `transform` (3, 3)."""
    n, m = height.shape
    grid = np.stack([*np.meshgrid(x, y, indexing="ij"), height], axis=-1)
    slope_x = np.gradient(height, x, axis=0)
    slope_y = np.gradient(height, y, axis=1)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(height)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    index = np.arange(n * m).reshape(n, m)
    a, b = index[:-1, :-1].ravel(), index[1:, :-1].ravel()
    c, d = index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    return Shape(
        vertices=grid.reshape(-1, 3) @ transform.T,
        faces=faces,
        normals=normals.reshape(-1, 3) @ transform.T,
    )


def ring(inner: float, outer: float, z: float, *, up: bool, slices: int = 48) -> Shape:
    """A flat horizontal ring about the z axis that is seen from above (`up`) or from below."""
    angle = 2 * np.pi * np.arange(slices) / slices
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rims = [np.column_stack([r * circle, np.full(slices, z)]) for r in (inner, outer)]
    i = np.arange(slices)
    j = (i + 1) % slices
    faces = np.concatenate(
        [np.stack([i, i + slices, j], -1), np.stack([j, i + slices, j + slices], -1)]
    )
    normal = [0.0, 0.0, 1.0 if up else -1.0]
    return Shape(
        vertices=np.concatenate(rims),
        faces=faces if up else faces[:, ::-1].copy(),
        normals=np.tile(normal, (2 * slices, 1)),
    )


def band(radius: float, low: float, high: float, slices: int = 24) -> Shape:
    """A strip of a sphere about the origin between elevations [rad], seen from inside."""
    angle = 2 * np.pi * np.arange(slices) / slices
    rims = [
        radius
        * np.column_stack(
            [
                np.cos(elevation) * np.cos(angle),
                np.cos(elevation) * np.sin(angle),
                np.full(slices, np.sin(elevation)),
            ]
        )
        for elevation in (low, high)
    ]
    i = np.arange(slices)
    j = (i + 1) % slices
    faces = np.concatenate(
        [np.stack([i, i + slices, j], -1), np.stack([j, i + slices, j + slices], -1)]
    )
    vertices = np.concatenate(rims)
    return Shape(vertices=vertices, faces=faces, normals=-vertices / radius)


def arrow(start: Array, end: Array, radius: float, sides: int = 10) -> Shape:
    """A round arrow from `start` to `end` (3,), its head three radii wide and six long."""
    vector = end - start
    length = float(np.linalg.norm(vector))
    direction = vector / length
    head = min(6.0 * radius, 0.6 * length)
    neck = end - head * direction
    shaft = cone(start, neck, radius, radius, sides)
    tip = cone(neck, end, 3.0 * radius, 0.02 * radius, sides)
    base = cone(neck, neck + 1e-3 * radius * direction, 0.02 * radius, 3.0 * radius, sides)
    return merge([shaft, tip, base])


def cone(start: Array, end: Array, first: float, last: float, sides: int) -> Shape:
    """The side of a truncated cone with radii `first` and `last`."""
    direction = (end - start) / np.linalg.norm(end - start)
    helper = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    side = np.cross(direction, helper)
    side /= np.linalg.norm(side)
    up = np.cross(direction, side)
    angle = 2 * np.pi * np.arange(sides) / sides
    circle = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = np.concatenate(
        [np.stack([i, j, i + sides], -1), np.stack([j, j + sides, i + sides], -1)]
    )
    slope = (first - last) / np.linalg.norm(end - start)
    normals = circle + slope * direction
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return Shape(
        vertices=np.concatenate([start + first * circle, end + last * circle]),
        faces=faces,
        normals=np.concatenate([normals, normals]),
    )


def grains(centres: Array, sizes: Array) -> Shape:
    """Octahedra at `centres` (n, 3) with radii `sizes` (n,)."""
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = np.array(
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    )
    vertices = (centres[:, None] + sizes[:, None, None] * corners).reshape(-1, 3)
    index = (faces[None] + 6 * np.arange(len(centres))[:, None, None]).reshape(-1, 3)
    return Shape(vertices=vertices, faces=index, normals=np.tile(corners, (len(centres), 1)))
