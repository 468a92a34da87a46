"""Shapes: triangle meshes of the scene, and the MuJoCo spec that holds them.

A mesh has vertices, faces, normals and texture coordinates, in display units (see
`camera`), z up. Faces are counterclockwise seen from outside. MuJoCo draws only front
faces: the water's walls face inwards, so that the walls near the camera are invisible.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
VEHICLE = "vehicle/"  # prefix of the attached glider's names
BACKDROP_GROUP, CLOSE_UP_GROUP, WATER_GROUP = 0, 3, 5  # geom groups; fluid geoms 4 stay hidden
UNSEEN_GROUP = 4  # group of fluid geoms, and of lost parts of a vehicle
GLIDER_GROUPS = (1, 2)  # outside and inside of the glider
WORLD, WATER, LEVEL, SEABED, DRIFT = "world", "water", "level", "seabed", "drift"
"""Bodies to which the scene's geoms are attached"""
AMBIENT, HEADLIGHT, SUN = 0.36, 0.40, 0.58
"""Intensities of light; 1 is full. HEADLIGHT: from the camera. SUN: from above"""
SAMPLES = 4  # samples per pixel against jagged edges
SLICES, STACKS = 24, 6
"""Facets of round geoms. SLICES: around. STACKS: along. More cost CPU time without visible gain."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Shape:
    """One mesh."""

    vertices: Array  # shape (n, 3)
    faces: Integers  # shape (m, 3), indices of vertices
    normals: Array  # unit, shape (n, 3)
    coordinates: Array | None = None  # texture coordinates, shape (n, 2)


def tube(nodes: Array, radius: float, sides: int, along: Array | None = None) -> Shape:
    """Make a round, open tube through `nodes` (n, 3).

    Args:
      radius: radius in display units.
      sides: number of sides of the polygonal cross-section.
      along: texture coordinate of each node, shape (n,).
    """
    side, up = (across[:, None] for across in tube_frame(nodes))
    c, s = _circle(sides).T[..., None]
    ring = c * side + s * up
    shape = loft(nodes[:, None] + radius * ring, ring)
    if along is None:
        return shape
    repeated = np.repeat(along, sides)
    coordinates = np.stack([repeated, np.full_like(repeated, 0.5)], axis=-1)
    return dataclasses.replace(shape, coordinates=coordinates)


def loft(rings: Array, normals: Array, *, inside: bool = False) -> Shape:
    """Make the surface through closed rings of corners, visible from outside or `inside`.

    Args:
      rings: corners, shape (rings, corners, 3).
      normals: unit normals, broadcast to the shape of `rings`.
    """
    count, sides = rings.shape[:2]
    firsts = sides * np.arange(count - 1)
    faces = (firsts[:, None, None] + strip_faces(sides, closed=True)).reshape(-1, 3)
    return Shape(
        vertices=rings.reshape(-1, 3),
        faces=faces[:, ::-1] if inside else faces,
        normals=np.broadcast_to(normals, rings.shape).reshape(-1, 3),
    )


def tube_frame(nodes: Array) -> tuple[Array, Array]:
    """Two unit vectors across the curve at each node, both (n, 3), without sudden twists."""
    tangent = np.gradient(nodes, axis=0)
    length = np.linalg.norm(tangent, axis=-1, keepdims=True)
    tangent = np.where(length > 0, tangent / np.where(length > 0, length, 1.0), [1.0, 0.0, 0.0])
    # The reference is the world's vertical, which a glider's path never follows for long.
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    width = np.linalg.norm(side, axis=-1, keepdims=True)
    side = np.where(width > 1e-6, side / np.where(width > 1e-6, width, 1.0), [0.0, 1.0, 0.0])
    return side, np.cross(side, tangent)


def quad(corners: Array) -> Shape:
    """Make a flat quadrilateral of corners (4, 3), counterclockwise seen from its front."""
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    normal = normal / np.linalg.norm(normal)
    return Shape(
        vertices=np.asarray(corners, float),
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        normals=np.tile(normal, (4, 1)),
    )


def merge(shapes: list[Shape]) -> Shape:
    """Merge shapes into one, without texture coordinates."""
    offsets = np.cumsum([0, *(len(s.vertices) for s in shapes[:-1])])
    return Shape(
        vertices=np.concatenate([s.vertices for s in shapes]),
        faces=np.concatenate([s.faces + o for s, o in zip(shapes, offsets, strict=True)]),
        normals=np.concatenate([s.normals for s in shapes]),
    )


def relief(x: Array, y: Array, height: Array, transform: Array) -> Shape:
    """Make a sheet over a grid: x (n,), y (m,), height (n, m), rotated by `transform` (3, 3)."""
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


def _circle(count: int) -> Array:
    """Corners of a regular polygon in the unit circle, (count, 2)."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def strip_faces(count: int, *, closed: bool = False) -> Integers:
    """Triangles between a row of `count` vertices and the next row, (m, 3)."""
    i = np.arange(count if closed else count - 1)
    j = (i + 1) % count
    return np.concatenate(
        [np.stack([i, i + count, j], -1), np.stack([j, i + count, j + count], -1)]
    )


def ring(inner: float, outer: float, z: float, *, up: bool, slices: int = 48) -> Shape:
    """Make a flat horizontal ring about the z axis, visible from above (`up`) or from below."""
    rims = [np.column_stack([r * _circle(slices), np.full(slices, z)]) for r in (inner, outer)]
    return loft(np.stack(rims), np.array([0.0, 0.0, 1.0 if up else -1.0]), inside=not up)


def band(radius: float, low: float, high: float, slices: int = 24) -> Shape:
    """Make a strip of a sphere about the origin between elevations [rad], visible from inside."""
    rims = [
        radius * np.column_stack([np.cos(up) * _circle(slices), np.full(slices, np.sin(up))])
        for up in (low, high)
    ]
    return loft(np.stack(rims), -np.stack(rims) / radius)


def arrow(start: Array, end: Array, radius: float, sides: int = 10) -> Shape:
    """Make an arrow from `start` to `end` (3,); its head is 3 radii thick and 6 radii long."""
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
    """Make the lateral surface of a truncated cone with radii `first` and `last`."""
    direction = (end - start) / np.linalg.norm(end - start)
    helper = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    side = np.cross(direction, helper)
    side /= np.linalg.norm(side)
    up = np.cross(direction, side)
    circle = _circle(sides) @ [side, up]
    slope = (first - last) / np.linalg.norm(end - start)
    normals = circle + slope * direction
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return loft(np.stack([start + first * circle, end + last * circle]), normals, inside=True)


def grains(centres: Array, sizes: Array) -> Shape:
    """Make octahedra at `centres` (n, 3) with radii `sizes` (n,)."""
    corners = np.kron(np.eye(3), [[1.0], [-1.0]])
    faces = np.array(
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    )
    firsts = 6 * np.arange(len(centres))
    return Shape(
        vertices=(centres[:, None] + sizes[:, None, None] * corners).reshape(-1, 3),
        faces=(firsts[:, None, None] + faces).reshape(-1, 3),
        normals=np.tile(corners, (len(centres), 1)),
    )


MATERIALS = {
    "flat": (1.0 - AMBIENT - HEADLIGHT / 2, 0.0),
    "lit": (0.3, 0.2),
    "glow": (0.55, 0.1),
    "matte": (0.0, 0.0),
}
"""Emission and specular of each material; `flat` shows its colour unchanged at a mean angle"""


class Props:
    """MuJoCo spec with the glider, lights and water bodies, to which meshes are added."""

    def __init__(self, vehicle_xml: str, width: int, height: int):
        """Make the spec; `width` and `height` [pixel] are those of the largest picture."""
        self.spec = mujoco.MjSpec()
        self.spec.modelname = "stage"
        visual = self.spec.visual
        visual.global_.offwidth, visual.global_.offheight = width, height
        visual.quality.offsamples = SAMPLES
        visual.quality.shadowsize = 0
        visual.quality.numslices, visual.quality.numstacks = SLICES, STACKS
        visual.headlight.ambient = [AMBIENT] * 3
        visual.headlight.diffuse = [HEADLIGHT] * 3
        visual.headlight.specular = [0.0] * 3
        # The sun shines straight down, so that it does not change the colours of the walls.
        self.spec.worldbody.add_light(
            name="sun",
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            dir=[0.0, 0.0, -1.0],
            diffuse=[SUN] * 3,
            specular=[0.3] * 3,
            ambient=[0.0] * 3,
            castshadow=False,
        )
        for name, (emission, specular) in MATERIALS.items():
            self.spec.add_material(name=name, emission=emission, specular=specular, shininess=0.4)
        self._attach(mujoco.MjSpec.from_string(vehicle_xml))
        self._bodies = {WORLD: self.spec.worldbody}
        for name in (WATER, LEVEL, SEABED, DRIFT):
            self._bodies[name] = self.spec.worldbody.add_body(name=name, mocap=True)

    def add(
        self,
        name: str,
        shape: Shape,
        colour: Array,
        *,
        alpha: float = 1.0,
        material: str = "flat",
        group: int = WATER_GROUP,
        body: str = WATER,
    ) -> str:
        """Add a mesh and its geom, both of this name; return the name."""
        given = {"vert": shape.vertices, "normal": shape.normals, "texcoord": shape.coordinates}
        self.spec.add_mesh(
            name=name,
            userface=shape.faces.astype(np.int32).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            **{
                f"user{kind}": values.astype(np.float32).ravel()
                for kind, values in given.items()
                if values is not None
            },
        )
        self._bodies[body].add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=material,
            rgba=[*(float(c) for c in colour), alpha],
            group=group,
            contype=0,
            conaffinity=0,
            mass=0,
        )
        return name

    def add_row_texture(self, name: str, colours: Array, *, emission: float) -> None:
        """Add a material whose texture is one row of colours (n, 3); see `Shape.coordinates`."""
        kind = mujoco.mjtTexture.mjTEXTURE_2D
        texture = self.spec.add_texture(
            name=name, type=kind, width=len(colours), height=2, nchannel=3
        )
        texture.data = 2 * (255 * colours).astype(np.uint8).tobytes()
        material = self.spec.add_material(
            name=name, emission=emission, specular=0.15, shininess=0.3
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name

    def _attach(self, glider: mujoco.MjSpec) -> None:
        """Attach the glider's hull without the elements that only its physics needs."""
        unseen = (glider.keys, glider.sensors, glider.actuators, glider.cameras, glider.lights)
        for item in [item for items in unseen for item in items]:
            glider.delete(item)
        # MuJoCo warns about each setting in which two models differ: use the stage's settings.
        pairs: list[tuple[Any, Any]] = [(self.spec.option, glider.option)]
        for name in ("global_", "quality", "headlight", "map", "scale", "rgba"):
            pairs.append((getattr(self.spec.visual, name), getattr(glider.visual, name)))
        for ours, theirs in pairs:
            for name in dir(ours):
                if not name.startswith("_"):
                    setattr(theirs, name, getattr(ours, name))
        self.spec.worldbody.add_frame().attach_body(glider.body("hull"), VEHICLE, "")
