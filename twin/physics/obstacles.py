"""Obstacles: what a vehicle can run into, and the shape of the vehicle that touches it.

Geoms that can collide (`contype` or `conaffinity` not 0) of the vehicle file stay in every run:
those of static bodies are obstacles, those of the vehicle its shape. A vehicle without such a geom
collides as a capsule of its hull's length and diameter. Where nothing can be hit, contacts are
switched off and cost nothing.
"""

from __future__ import annotations

import functools

import mujoco

from twin.errors import VehicleError
from twin.vehicle.vehicle import Vehicle

FLOOR_BODY = "glider_twin_floor"
"""Mocap body with the plane that stands for the sea floor under the vehicle"""
HULL_SHAPE = "glider_twin_hull_shape"
ALL_BITS = 2**31 - 1
"""Of contype and conaffinity: meets every geom that can collide at all"""
BEFORE_FIRST_STEP = -1e5
"""[m] height of the plane until native code lays it"""
HIDDEN_GROUP = 5
GIVES_WAY = 0.2
"""[s] time constant of the contact with the sea floor, whatever the step: that which the shipped
step of 0.1 s allows, as of a bed of mud; ours"""
_OFF = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT


def may_collide(geom: mujoco.MjsGeom) -> bool:
    """Whether a geom's masks let it collide with anything."""
    return bool(geom.contype or geom.conaffinity)


def has_contacts(model: mujoco.MjModel) -> bool:
    """Whether a compiled model has anything that could touch."""
    return not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT


@functools.lru_cache(maxsize=64)
def obstacle_names(xml: str) -> tuple[str, ...]:
    """Names of what stands in the water of a vehicle file, empty ones too."""
    spec = mujoco.MjSpec.from_string(xml)
    return tuple(g.name for g in spec.geoms if may_collide(g) and _is_static(g.parent))


def prepare_contacts(spec: mujoco.MjSpec, vehicle: Vehicle, *, floor: bool) -> None:
    """Switch contacts on where something can be hit, else off, and give what is missing.

    Args:
      spec: of the vehicle, changed in place.
      floor: whether the run has a sea floor; its plane is added.

    Raises:
      VehicleError: the file has obstacles and switches contacts off.
    """
    colliding = [geom for geom in spec.geoms if may_collide(geom)]
    obstacles = [geom for geom in colliding if _is_static(geom.parent)]
    switched_off = bool(spec.option.disableflags & _OFF)
    if obstacles and switched_off:
        names = ", ".join(repr(geom.name or "without a name") for geom in obstacles)
        raise VehicleError(
            f"vehicle {vehicle.name!r} ({vehicle.path}): geom {names} stands in the water, and "
            '<flag contact="disable"/> or constraint="disable" lets the vehicle pass through it: '
            'leave the flags out, or give a geom that is only drawn contype="0" conaffinity="0"'
        )
    if not (floor or obstacles):
        if len({geom.parent.name for geom in colliding}) < 2:  # MuJoCo need not look for contacts
            spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
            if not (spec.equalities or spec.tendons or any(map(_constrained, spec.joints))):
                spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        return
    spec.option.disableflags &= ~_OFF
    shape = [geom for geom in colliding if geom not in obstacles]
    if switched_off:
        for geom in shape:  # the file's parts pass through each other
            geom.contype, geom.conaffinity = 1, 0
    if not shape:
        radius = vehicle.hull_diameter / 2
        end = max(vehicle.hull_length / 2 - radius, 1e-3)
        spec.body("hull").add_geom(
            name=HULL_SHAPE,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[-end, 0, 0, end, 0, 0],
            size=[radius, 0, 0],
            mass=0,
            group=HIDDEN_GROUP,
            contype=ALL_BITS,
            conaffinity=ALL_BITS,
        )
    if floor:
        body = spec.worldbody.add_body(name=FLOOR_BODY, mocap=True, pos=[0, 0, BEFORE_FIRST_STEP])
        body.add_geom(
            name=FLOOR_BODY,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0, 0, 1],
            group=HIDDEN_GROUP,
            contype=ALL_BITS,
            conaffinity=ALL_BITS,
            solref=[GIVES_WAY, 1.0],
            priority=1,
        )


def _constrained(joint: mujoco.MjsJoint) -> bool:
    """Whether a joint has limits or dry friction, which are constraints too."""
    limited = joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE or any(joint.range)
    return bool(limited or joint.frictionloss)


def _is_static(body: mujoco.MjsBody) -> bool:
    """Whether a body stands still in the world: neither it nor one that carries it has a joint."""
    while body.parent is not None and body.name != "world":
        if body.joints:
            return False
        body = body.parent
    return True
