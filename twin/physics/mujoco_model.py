"""MuJoCo model: a vehicle compiled into the MuJoCo model that native code adds the water to.

Geoms of the vehicle file that can collide (`contype` or `conaffinity` not 0) stay in every run:
those of static bodies are obstacles, those of the vehicle are its shape. A vehicle without such a
geom collides as a capsule of its hull's length and diameter. Without anything to hit, contacts are
switched off and cost nothing.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import warnings
from collections.abc import Iterator

import mujoco
import numpy as np

from twin.errors import InputError, VehicleError, unknown_name
from twin.frames import flip_vector
from twin.physics.model_block import (
    FLOOR_BODY,
    Tables,
    fill_block,
    header,
    joint_places,
    label,
    write_tables,
)
from twin.physics.native import block as b
from twin.physics.native.install import install
from twin.physics.stiffness import Stiffness, stiffness_of
from twin.vehicle.laws import LAWS, Ellipsoids
from twin.vehicle.parts import BatteryHinge
from twin.vehicle.vehicle import Vehicle, load_vehicle

COEFFICIENTS = "coefficients"
"""Value of `hydrodynamics` for the law of the vehicle file; other values are names of hull laws."""
INTEGRATORS = {
    name: getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")
    for name in ("euler", "rk4", "implicit", "implicitfast", "discrete")
}
SHORTEST_STEP, LONGEST_STEP = 1e-4, 1.0
"""[s] Limits of the physics step."""
ELLIPSOID_TIMESTEP = 0.02
"""[s] Upper bound of the ellipsoid law's default step; its stiff rotary drag diverges at 0.1 s."""
HULL_SHAPE = "glider_twin_hull_shape"
ALL_BITS = 2**31 - 1
"""Masks contype and conaffinity that match every geom that can collide at all."""
BEFORE_FIRST_STEP = -1e5
"""[m] Height of the floor's plane until native code first places it."""
HIDDEN_GROUP = 5
CONTACT_TIME = 0.2
"""[s] Time constant of contacts with the sea floor, soft as mud, at any physics step. Our choice:
the least time constant that the shipped step of 0.1 s allows."""
_OFF = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
_FREE_JOINT_ROWS = np.array([0, 1, 3, 6, 10, 15])


def hydrodynamics_names() -> tuple[str, ...]:
    """Values of `hydrodynamics`: "coefficients" for the file's own law, or a hull law's name."""
    return (COEFFICIENTS, *LAWS)


def with_hydrodynamics(vehicle: Vehicle, hydrodynamics: str) -> Vehicle:
    """Vehicle with the hull law of that name.

    Raises:
      InputError: no law has that name. VehicleError: the file lacks parameters of that law.
    """
    if hydrodynamics == COEFFICIENTS:
        return vehicle
    if hydrodynamics not in LAWS:
        raise InputError(unknown_name("hydrodynamics", hydrodynamics, hydrodynamics_names()))
    return vehicle.with_law(hydrodynamics)


def compile_model(
    vehicle: Vehicle | str = "glider",
    *,
    hydrodynamics: str = "coefficients",
    timestep: float | None = None,
    integrator: str | None = None,
    lean: bool = False,
    tables: Tables | None = None,
    reserve: int = 0,
    log: bool = False,
    centred: bool = False,
    stiff: Stiffness | None = None,
) -> mujoco.MjModel:
    """Compile a vehicle with the parameter block appended, and install the native callbacks.

    Args:
      vehicle: a `Vehicle` (its fields override its XML text) or an argument of `load_vehicle`.
      hydrodynamics: "coefficients" (the file's own law) or the name of a hull law, such as
        "ellipsoid" (MuJoCo's, from the geometry alone).
      timestep: [s], None: the file's.
      integrator: one of INTEGRATORS, None: the file's.
      lean: leave out what only pictures and sensors need; the dynamics are the same.
      tables: mission, current, density and sea floor that the model carries.
      reserve: least count of numbers for which the model's tables must have room.
      log: give `userdata` room for the log of a `Simulation`.
      centred: hydrodynamics at the time-centred velocity; RK4 has that without the option.
      stiff: stiffness of the motion; it decides whether a centred step is implicit in rotary
        damping. None: stiffness on the fastest leg in `tables`, else in the usual glide.

    Raises:
      VehicleError: the file does not compile, its inertia is impossible, its joints or actuators
        have another structure, or it has obstacles and switches contacts off.
      InputError: unknown hydrodynamics or integrator, impossible timestep.
    """
    if isinstance(vehicle, str):
        vehicle = load_vehicle(vehicle)
    vehicle = with_hydrodynamics(vehicle, hydrodynamics)
    tables = Tables() if tables is None else tables
    try:
        spec = mujoco.MjSpec.from_string(vehicle.xml)
    except ValueError as error:
        raise VehicleError(f"{label(vehicle)}: {_first_line(error)}") from error
    spec.option.gravity = [0.0, 0.0, -vehicle.gravity]
    _write_inertia(spec, vehicle)
    _write_parts(spec, vehicle)
    prepare_contacts(spec, vehicle, floor=tables.floor.size > 0)
    if lean:
        _delete_unused(spec)
    if timestep is None and isinstance(vehicle.law, Ellipsoids):
        timestep = min(spec.option.timestep, ELLIPSOID_TIMESTEP)
    if timestep is not None:
        spec.option.timestep = timestep
    if not SHORTEST_STEP <= spec.option.timestep <= LONGEST_STEP:
        raise InputError(
            f"timestep {spec.option.timestep:g} s is outside {SHORTEST_STEP:g} to "
            f"{LONGEST_STEP:g} s"
        )
    if integrator is not None:
        if integrator not in INTEGRATORS:
            raise InputError(unknown_name("integrator", integrator, INTEGRATORS))
        spec.option.integrator = INTEGRATORS[integrator]
    width = len(vehicle.parts)
    joints = sum(1 for joint in spec.joints if joint.type != mujoco.mjtJoint.mjJNT_FREE)
    row = b.log_row(7 + joints, 6 + joints, width).itemsize // 8
    spec.nuserdata = b.STATE_WORDS + (b.RING * row if log else 0)
    words = b.HEADER_WORDS + b.PART_WORDS * width + vehicle.law.values().size
    words += max(tables.words, reserve)
    spec.add_numeric(name=b.NAME, size=words, data=np.zeros(1))
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "Inertia matrix", UserWarning)
            model = spec.compile()
    except (ValueError, UserWarning) as error:
        raise VehicleError(f"{label(vehicle)}: {_first_line(error)}") from error
    _check_structure(model, vehicle)
    fill_block(model, vehicle, words, ring=b.RING if log else 0)
    centred = centred and model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4
    header(model)["centred"] = float(centred)
    if centred:
        if stiff is None:
            flies = tables.control == b.CONTROL_MISSION
            stiff = stiffness_of(vehicle, tables.plan if flies else None)
        solved = stiff is not None and stiff.solved(model.opt.timestep)
        header(model)["implicit"] = float(solved)
    write_tables(model, tables)
    install(current=tables.current.size > 0, floor=tables.floor.size > 0)
    return model


def refit(model: mujoco.MjModel, data: mujoco.MjData, vehicle: Vehicle, other: Vehicle) -> None:
    """Rewrite the model of `vehicle` for an `other` vehicle of the same build, without compiling.

    They may differ in hull law, added mass, volume, compressibility, the centre of gravity of the
    fixed mass, and the parts' parameters except travel and place. The tables of a run are
    removed, and `data` is overwritten.

    Raises:
      VehicleError: the vehicles differ in something else.
    """
    for what, differs in {
        "XML text": vehicle.xml != other.xml,
        "hull law": vehicle.law.values().size != other.law.values().size,
        "mass": vehicle.static_mass != other.static_mass,
        "inertia": not np.array_equal(vehicle.static_inertia, other.static_inertia),
        "moving masses": vehicle.masses != other.masses,
        "travels or places of parts": [(p.low, p.high, p.position) for p in vehicle.parts]
        != [(p.low, p.high, p.position) for p in other.parts],
    }.items():
        if differs:
            raise VehicleError(
                f"{label(other)}: its {what} is not that of {vehicle.name!r}, so that it needs a "
                "model of its own (twin.physics.mujoco_model.compile_model)"
            )
    head = header(model)
    words, ring, centred = (int(head[name]) for name in ("words", "log_ring", "centred"))
    model.body_ipos[model.body("hull").id] = flip_vector(other.static_cg)
    mujoco.mj_setConst(model, data)
    fill_block(model, other, words, ring=ring)
    header(model)["centred"] = float(centred)


def _write_inertia(spec: mujoco.MjSpec, vehicle: Vehicle) -> None:
    """Write the masses of `vehicle`, which may differ from its XML text, into the spec's bodies."""
    signs = np.outer(flip_vector(np.ones(3)), flip_vector(np.ones(3)))
    blocks = [("hull", vehicle.static_mass, flip_vector(vehicle.static_cg), vehicle.static_inertia)]
    for mass in vehicle.masses:
        offset = np.array([0.0, 0.0, -mass.eccentricity])
        blocks.append((mass.name, mass.mass, offset, mass.inertia))
    for name, kilograms, cg, inertia in blocks:
        body = spec.body(name)
        i = inertia * signs
        body.mass, body.ipos = kilograms, cg
        body.iquat = [1, 0, 0, 0]
        # the file may give either form of the inertia, and MuJoCo refuses both at once
        body.inertia, body.fullinertia = np.zeros(3), np.full(6, np.nan)
        if np.count_nonzero(i - np.diag(np.diag(i))):
            body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
        else:
            body.inertia = np.diag(i)
    for mass in vehicle.masses:
        spec.body(mass.name).pos = [mass.neutral_x, 0.0, 0.0]


def _write_parts(spec: mujoco.MjSpec, vehicle: Vehicle) -> None:
    """Write the travels and places of the parts of `vehicle` into the spec."""
    for part in vehicle.parts:
        actuator = spec.actuator(part.name)
        actuator.actrange = actuator.ctrlrange = [part.low, part.high]
        if isinstance(part, BatteryHinge):
            # at the neutral position the mass hangs as drawn in the file
            spec.joint(actuator.target).ref = part.neutral
        if part.joint is None:
            spec.site(actuator.target).pos = flip_vector(np.array(part.position))
    for name, place in (("imu", vehicle.imu_position), ("gps", vehicle.gps_position)):
        spec.site(name).pos = flip_vector(place)


def _delete_unused(spec: mujoco.MjSpec) -> None:
    """Delete sensors, cameras, lights, and geoms without collision or fluid forces."""
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    for item in [*spec.cameras, *spec.lights]:
        spec.delete(item)
    for geom in list(spec.geoms):
        if geom.fluid_ellipsoid == 0 and not may_collide(geom):
            spec.delete(geom)
    used = {actuator.target for actuator in spec.actuators}
    for site in list(spec.sites):
        if site.name not in used:
            spec.delete(site)


def may_collide(geom: mujoco.MjsGeom) -> bool:
    """Tell whether a geom's masks let it collide with anything."""
    return bool(geom.contype or geom.conaffinity)


@functools.lru_cache(maxsize=64)
def obstacle_names(xml: str) -> tuple[str, ...]:
    """Names of the obstacles in a vehicle file; an unnamed geom gives an empty string."""
    spec = mujoco.MjSpec.from_string(xml)
    return tuple(g.name for g in spec.geoms if may_collide(g) and _is_static(g.parent))


def prepare_contacts(spec: mujoco.MjSpec, vehicle: Vehicle, *, floor: bool) -> None:
    """Switch contacts on if anything can be hit, else off; add the missing geoms.

    Args:
      spec: spec of the vehicle, changed in place.
      floor: the run has a sea floor; its plane is added.

    Raises:
      VehicleError: the file has obstacles and switches contacts off.
    """
    colliding = [geom for geom in spec.geoms if may_collide(geom)]
    obstacles = [geom for geom in colliding if _is_static(geom.parent)]
    touched = {"group": HIDDEN_GROUP, "contype": ALL_BITS, "conaffinity": ALL_BITS}
    switched_off = bool(spec.option.disableflags & _OFF)
    if obstacles and switched_off:
        names = ", ".join(repr(geom.name or "without a name") for geom in obstacles)
        raise VehicleError(
            f"{label(vehicle)}: geom {names} stands in the water, and "
            '<flag contact="disable"/> or constraint="disable" lets the vehicle pass through it: '
            'leave the flags out, or give a geom that is only drawn contype="0" conaffinity="0"'
        )
    if not (floor or obstacles):
        if len({geom.parent.name for geom in colliding}) < 2:  # nothing can touch anything
            spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
            if not (spec.equalities or spec.tendons or any(map(_constrained, spec.joints))):
                spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        return
    spec.option.disableflags &= ~_OFF
    shape = [geom for geom in colliding if geom not in obstacles]
    if switched_off:
        for geom in shape:  # the vehicle's own geoms still pass through each other
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
            **touched,
        )
    if floor:
        body = spec.worldbody.add_body(name=FLOOR_BODY, mocap=True, pos=[0, 0, BEFORE_FIRST_STEP])
        body.add_geom(
            name=FLOOR_BODY,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0, 0, 1],
            **touched,
            solref=[CONTACT_TIME, 1.0],
            priority=1,
        )


def _constrained(joint: mujoco.MjsJoint) -> bool:
    """Tell whether a joint has limits or dry friction, which MuJoCo treats as constraints."""
    limited = joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE or any(joint.range)
    return bool(limited or joint.frictionloss)


def _is_static(body: mujoco.MjsBody) -> bool:
    """Tell whether neither a body nor any body that carries it has a joint."""
    while body.parent is not None and body.name != "world":
        if body.joints:
            return False
        body = body.parent
    return True


def _check_structure(model: mujoco.MjModel, vehicle: Vehicle) -> None:
    """Require the structure native code relies on: hull first, one activation for each part."""

    def require(kept: object, rule: str) -> None:
        if not kept:
            raise VehicleError(f"{label(vehicle)}: {rule}")

    joints = [model.joint(i) for i in range(model.njnt)]
    require(
        joints
        and joints[0].type[0] == mujoco.mjtJoint.mjJNT_FREE
        and model.body(int(joints[0].bodyid[0])).name == "hull",
        "the first joint must be the free joint of body 'hull' (<freejoint name=\"hull\"/>)",
    )
    names = tuple(model.actuator(i).name for i in range(model.nu))
    require(
        names == vehicle.part_names and model.na == model.nu,
        "each actuator must be a part with one activation state "
        f"(dyntype='user' actdim='1'); found {', '.join(names)} with {model.na} activations",
    )
    moved = sum((m.slide is not None) + (m.hinge is not None) for m in vehicle.masses)
    require(
        model.njnt == 1 + moved,
        "joints other than the hull's must be slides or hinges of moving masses, each with an "
        f"actuator; found {', '.join(joint.name or 'one without a name' for joint in joints)}",
    )
    for index, _ in joint_places(model):
        joint = joints[int(model.actuator_trnid[index, 0])]
        require(
            not (joint.stiffness[0] or np.any(joint.damping) or np.any(joint.frictionloss)),
            f"joint {joint.name!r} must be without stiffness, damping and frictionloss: the servo "
            "of its actuator holds it",
        )
    hull_first = np.array_equal(model.M_rowadr[:6], _FREE_JOINT_ROWS)
    require(hull_first, "body 'hull' must be the first moving body")
    require(
        model.opt.density == 0 and model.opt.viscosity == 0,
        "<option> density and viscosity must be 0: MuJoCo's own fluid would act beside ours",
    )


def _first_line(error: Exception) -> str:
    return " ".join(str(error).split())


_IGNORE_WARNING = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(lambda message: None)


@contextlib.contextmanager
def quiet_mujoco() -> Iterator[None]:
    """Silence MuJoCo's own warnings: an unstable run raises an error instead."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_IGNORE_WARNING)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
