"""Solid: the vehicle's visible shape as triangles, from its MJCF, and the motion of its bodies.

Only geoms that pictures show are included, with their colours. Every shape becomes flat triangles,
whose normals are smoothed over edges that are not sharp.

`pack` encodes arrays for the page's script as integer multiples of a step, in base64.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.faults.base import Fault
from twin.show.render import stage
from twin.show.render.shapes import GLIDER_GROUPS
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

SIDES, RINGS = 28, 10  # facets around round shapes, and from pole to equator of domes
UNMOVED = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
"""Position and quaternion of a body in its parent's frame"""
CREASE = math.cos(math.radians(42.0))  # faces that meet at a larger angle keep an edge
WHOLES: tuple[type[np.signedinteger[Any]], ...] = (np.int8, np.int16, np.int32)
"""Integer types, of which the narrowest that holds a range is taken; each type's least is NaN"""


class Body(NamedTuple):
    """One body of the vehicle; frames are MuJoCo's, z up, in metres."""

    parent: int  # index of the body that carries it; -1 for the hull
    position: Array  # position in the parent's frame, (3,)
    quaternion: Array  # (w, x, y, z) to the parent's frame, (4,)
    moves: list[dict[str, Any]]
    """Motions of the body, in order: {"part", "kind": slide or turn, "axis", "anchor"}"""
    corners: Array  # corners of triangles, (triangles, 3 corners, 3)
    normals: Array  # unit normals, in the shape of `corners`
    colours: Array  # RGBA of the triangles, 0 to 1, (triangles, 4)
    until: float = math.inf  # [s] mission time at which the body is lost


def read_solid(vehicle: Vehicle, faults: Sequence[Fault] = ()) -> list[Body]:
    """Read the bodies of a vehicle, the hull first; geoms that a fault removes are bodies too."""
    model = mujoco.MjModel.from_xml_string(vehicle.xml)
    hull = model.body("hull").id
    turned = stage.turned_bodies(model, vehicle, "")
    ids = np.flatnonzero(model.body_rootid == hull).tolist()  # the hull is the first of its tree
    until = np.full(model.ngeom, math.inf)
    for fault in faults:
        lost = stage.named_geoms(model, fault.gone)
        until[lost] = np.minimum(until[lost], fault.start)
    found = [_body(model, b, ids, turned, _seen(model, b, until == math.inf)) for b in ids]
    for moment in np.unique(until[until < math.inf]).tolist():
        for b in ids:
            if geoms := _seen(model, b, until == moment):
                shape = _shape(model, geoms)
                found.append(Body(ids.index(b), *UNMOVED, [], *shape, until=moment))
    return found


def _seen(model: mujoco.MjModel, body: int, among: NDArray[np.bool_]) -> list[int]:
    """Ids of the visible geoms of a body, `among` a mask of geoms."""
    return [
        geom
        for geom in np.flatnonzero(among).tolist()
        if model.geom_group[geom] in GLIDER_GROUPS
        and model.geom_bodyid[geom] == body
        and _colour(model, geom)[3] > 0.0
    ]


def _shape(model: mujoco.MjModel, geoms: Sequence[int]) -> tuple[Array, Array, Array]:
    """Corners, normals and colours of the geoms of one body."""
    pieces, colours = [np.zeros((0, 2, 3, 3))], [np.zeros((0, 4))]
    for geom in geoms:
        piece = _placed(_triangles(model, geom), model.geom_pos[geom], model.geom_quat[geom])
        pieces.append(np.stack([piece, smooth_normals(piece)], axis=1))
        colours.append(np.tile(_colour(model, geom), (len(piece), 1)))
    shape = np.concatenate(pieces)
    return shape[:, 0], shape[:, 1], np.concatenate(colours)


def _body(
    model: mujoco.MjModel, body: int, ids: list[int], turned: dict[str, Any], geoms: Sequence[int]
) -> Body:
    moves = []
    for joint in np.flatnonzero(model.jnt_bodyid == body).tolist():
        kind = mujoco.mjtJoint(int(model.jnt_type[joint]))
        if kind != mujoco.mjtJoint.mjJNT_FREE:
            way = "slide" if kind == mujoco.mjtJoint.mjJNT_SLIDE else "turn"
            moves.append(
                (model.joint(joint).name, way, model.jnt_axis[joint], model.jnt_pos[joint])
            )
    for name, found in turned.items():
        if found.body == body:
            axis = np.zeros(3)  # the hull's axis; the body's own is needed
            mujoco.mju_rotVecQuat(axis, found.axis, found.rest * [1.0, -1.0, -1.0, -1.0])
            moves.append((name, "turn", axis, np.zeros(3)))
    described = [
        {"part": part, "kind": kind, "axis": axis.tolist(), "anchor": anchor.tolist()}
        for part, kind, axis, anchor in moves
    ]
    if body == ids[0]:
        return Body(-1, *UNMOVED, described, *_shape(model, geoms))
    frame = model.body_pos[body].copy(), model.body_quat[body].copy()
    parent = ids.index(int(model.body_parentid[body]))
    return Body(parent, *frame, described, *_shape(model, geoms))


def _colour(model: mujoco.MjModel, geom: int) -> Array:
    material = model.geom_matid[geom]
    return np.asarray(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material], float)


def _placed(corners: Array, position: Array, quaternion: Array) -> Array:
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, quaternion)
    return np.asarray(corners @ turn.reshape(3, 3).T + position)


def _triangles(model: mujoco.MjModel, geom: int) -> Array:
    """Corners of a geom's triangles, (triangles, 3, 3), in the geom's frame."""
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    shapes = mujoco.mjtGeom
    if kind == shapes.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        corners = model.mesh_vertadr[mesh] + model.mesh_face[first : first + count]
        return np.asarray(model.mesh_vert[corners], float)
    if kind == shapes.mjGEOM_BOX:
        return size * _unit_box()
    arc = np.linspace(0.0, np.pi / 2, RINGS + 1)
    dome = np.stack([np.sin(arc), np.cos(arc)], axis=-1)  # radius, height
    if kind in (shapes.mjGEOM_SPHERE, shapes.mjGEOM_ELLIPSOID):
        radii = np.full(3, size[0]) if kind == shapes.mjGEOM_SPHERE else size
        return radii * lathe(np.concatenate([dome, dome[-2::-1] * [1.0, -1.0]]))
    if kind == shapes.mjGEOM_CAPSULE:
        end = size[0] * dome + [0.0, size[1]]
        return lathe(np.concatenate([end, end[::-1] * [1.0, -1.0]]))
    assert kind == shapes.mjGEOM_CYLINDER, f"geom of type {kind} in a vehicle file"
    r, half = size[0], size[1]
    return lathe(np.array([[0.0, half], [r, half], [r, -half], [0.0, -half]]))


def lathe(profile: Array) -> Array:
    """Rotate a profile (n, 2) of radius and height, from the top, about z: (triangles, 3, 3)."""
    angle = 2.0 * np.pi * np.arange(SIDES + 1) / SIDES
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    wide, high = profile[:, :1], profile[:, 1:]
    grid = np.stack(np.broadcast_arrays(wide * ring[:, 0], wide * ring[:, 1], high), axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    both = np.concatenate([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 3)
    area = np.linalg.norm(np.cross(both[:, 1] - both[:, 0], both[:, 2] - both[:, 0]), axis=-1)
    return np.asarray(both[area > 1e-12])


def _unit_box() -> Array:
    """Triangles of a box with half sides of 1, (12, 3, 3)."""
    faces = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3] * sign
            middle = sign * np.eye(3)[axis]
            a, b, c, d = middle - u - v, middle + u - v, middle + u + v, middle - u + v
            faces += [[a, b, c], [a, c, d]]
    return np.array(faces)


def smooth_normals(corners: Array) -> Array:
    """Smoothed unit normals (triangles, 3, 3) of triangles (triangles, 3, 3).

    A corner's normal is the area-weighted mean over the faces that meet there at an angle below
    that of CREASE to the corner's own face.
    """
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit = face / np.maximum(np.linalg.norm(face, axis=-1, keepdims=True), 1e-15)
    places = np.rint(corners.reshape(-1, 3) * 1e5).astype(np.int64)
    _, which = np.unique(places, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    starts = np.flatnonzero(np.diff(which.ravel()[order], prepend=-1))
    normals = np.repeat(unit[:, None], 3, axis=1).reshape(-1, 3)
    for group in np.split(order, starts[1:]):
        of = group // 3
        near = unit[of] @ unit[of].T >= CREASE
        normals[group] = near @ face[of]
    long = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = np.where(long > 1e-15, normals / np.maximum(long, 1e-15), 0.0)
    return np.asarray(normals.reshape(corners.shape))


Packed = dict[str, Any]
"""Packed array for JSON: {"type", "offset", "step", "data"}"""


def pack(values: Array, step: float) -> Packed:
    """Pack numbers of any shape, in row order, rounded to multiples of `step` in their unit.

    Raises:
      InputError: the range has too many steps for 32 bits.
    """
    inside = np.isfinite(values)
    known = values[inside]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    offset = step * round((low + high) / 2.0 / step)
    most = max(high - offset, offset - low) / step + 1.0
    kind = next((k for k in WHOLES if most <= np.iinfo(k).max), None)
    if kind is None:
        raise InputError(f"values from {low:g} to {high:g} cannot be packed in steps of {step:g}")
    whole = np.full(values.shape, np.iinfo(kind).min, kind)
    whole[inside] = np.rint((known - offset) / step).astype(kind)
    return {
        "type": np.dtype(kind).name,
        "offset": offset,
        "step": step,
        "data": base64.b64encode(whole.astype(whole.dtype.newbyteorder("<")).tobytes()).decode(),
    }
