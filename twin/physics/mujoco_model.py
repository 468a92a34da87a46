"""MuJoCo model: a vehicle made into the MuJoCo model that the native water acts on."""

from __future__ import annotations

import warnings
from typing import Any

import mujoco
import numpy as np

from twin.errors import FloorError, InputError, VehicleError, unknown_name
from twin.frames import flip_vector
from twin.physics.native import block as b
from twin.physics.native.install import install
from twin.physics.obstacles import FLOOR_BODY, may_collide, prepare_contacts
from twin.physics.tables import Tables
from twin.vehicle.laws import LAWS, Ellipsoids
from twin.vehicle.parts import PARTS, Part
from twin.vehicle.vehicle import Vehicle, load_vehicle

COEFFICIENTS = "coefficients"
"""Hydrodynamics by the vehicle file's own law; else the name of a hull law."""
INTEGRATORS = {
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
}
SHORTEST_STEP, LONGEST_STEP = 1e-4, 1.0
"""[s]"""
ELLIPSOID_TIMESTEP = 0.02
"""[s] quadratic rotary drag of the ellipsoid law is stiff at inflections: 0.1 s diverges there"""
RUN_TABLES = ("plan", "current", "density", "temperature", "floor")
"""Tables of a run, in the block's order."""
_FREE_JOINT_ROWS = np.array([0, 1, 3, 6, 10, 15])


def hydrodynamics_names() -> tuple[str, ...]:
    """What `hydrodynamics` may be: the file's own law by "coefficients", or another by name."""
    return (COEFFICIENTS, *LAWS)


def with_hydrodynamics(vehicle: Vehicle, hydrodynamics: str) -> Vehicle:
    """The vehicle with the hull law of that name.

    Raises:
      InputError: there is no such law. VehicleError: the file lacks what it needs.
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
) -> mujoco.MjModel:
    """Compile a vehicle with the parameter block appended, and install the native callbacks.

    Args:
      vehicle: a `Vehicle` (its fields win over its XML text) or what `load_vehicle` takes.
      hydrodynamics: "coefficients" (the file's own law) or the name of a hull law, such as
        "ellipsoid" (MuJoCo's, from the geometry alone).
      timestep: [s], None for the file's.
      integrator: one of INTEGRATORS, None for the file's.
      lean: leave out what only eyes and sensors need; the dynamics are the same.
      tables: mission, current and density that it is to carry.
      reserve: numbers that it must have room for in its tables, at least.
      log: give its `userdata` room for the log of a `Simulation`.
      centred: water at the time-centred velocity; RK4 evaluates between steps and is so by itself.

    Raises:
      VehicleError: the file does not compile, its inertia cannot be solved for, it has another
        joint or actuator structure, or it has obstacles and switches contacts off.
      InputError: unknown hydrodynamics or integrator, impossible timestep.
    """
    if isinstance(vehicle, str):
        vehicle = load_vehicle(vehicle)
    vehicle = with_hydrodynamics(vehicle, hydrodynamics)
    tables = Tables() if tables is None else tables
    try:
        spec = mujoco.MjSpec.from_string(vehicle.xml)
    except ValueError as error:
        raise VehicleError(f"{_label(vehicle)}: {_first_line(error)}") from error
    _check_free_joint(spec, vehicle)
    spec.option.gravity = [0.0, 0.0, -vehicle.gravity]
    _write_inertia(spec, vehicle)
    _write_parts(spec, vehicle)
    prepare_contacts(spec, vehicle, floor=tables.floor.size > 0)
    if lean:
        _strip(spec)
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
    row = b.row_words(7 + joints, 6 + joints, width)
    spec.nuserdata = b.STATE_WORDS + (b.RING * row if log else 0)
    words = b.HEADER_WORDS + b.PART_WORDS * width + vehicle.law.values().size
    words += max(tables.words, reserve)
    spec.add_numeric(name=b.NAME, size=words, data=np.zeros(1))
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "Inertia matrix", UserWarning)
            model = spec.compile()
    except (ValueError, UserWarning) as error:
        raise VehicleError(f"{_label(vehicle)}: {_first_line(error)}") from error
    _check_structure(model, vehicle)
    fill_block(model, vehicle, words, ring=b.RING if log else 0)
    staged = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    header(model)["centred"] = float(centred and not staged)
    write_tables(model, tables)
    install()
    return model


def header(model: mujoco.MjModel) -> Any:
    """The live header of a compiled model's block, a record of `block.HEADER`.

    Raises:
      VehicleError: the model carries no block of this program.
    """
    values = model.numeric_data
    if len(values) >= b.HEADER_WORDS:
        found = values[-b.HEADER_WORDS :].view(b.HEADER)[0]
        if found["magic"] == b.MAGIC and found["version"] == b.VERSION:
            return found
    raise VehicleError(
        "this MuJoCo model carries no vehicle's parameters, so it would move in vacuum: build it "
        "with twin.suite.physics.Physics.from_vehicle or "
        "twin.physics.mujoco_model.compile_model"
    )


def state(data: mujoco.MjData) -> Any:
    """The live state that native code keeps in a simulation, a record of `block.STATE`."""
    return data.userdata[: b.STATE_WORDS].view(b.STATE)[0]


def _body(model: mujoco.MjModel) -> np.ndarray:
    """The block in front of its header, shape (words - HEADER_WORDS,)."""
    words = int(header(model)["words"])
    return model.numeric_data[-words : len(model.numeric_data) - b.HEADER_WORDS]


def table(model: mujoco.MjModel, name: str) -> np.ndarray:
    """One of the block's tables, live: "parts", "law_values" or one of RUN_TABLES."""
    place = header(model)[name]
    start = int(place["start"])
    return _body(model)[start : start + int(place["size"])]


def part_table(model: mujoco.MjModel) -> np.ndarray:
    """The parts as native code sees them, live, of dtype `block.PART`, shape (parts,)."""
    return table(model, "parts").view(b.PART)


def part_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the parts, in their order."""
    return tuple(model.actuator(index).name for index in range(model.nu))


def joint_places(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """(index of the part, place in qpos) of every part that drives a joint."""
    found = []
    for index in range(model.nu):
        if model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT:
            joint = int(model.actuator_trnid[index, 0])
            found.append((index, int(model.jnt_qposadr[joint])))
    return found


def fill_block(model: mujoco.MjModel, vehicle: Vehicle, words: int, *, ring: int) -> None:
    """Write the vehicle into the model's block of `words` numbers."""
    head = model.numeric_data[-b.HEADER_WORDS :].view(b.HEADER)[0]
    hull = model.body("hull").id
    added_mass = vehicle.added_mass
    inertia = vehicle.static_inertia + sum(mass.inertia for mass in vehicle.masses)
    for name, value in {
        "words": words,
        **{n: getattr(model, n) for n in ("nq", "nv", "nu", "na", "nbody", "nuserdata")},
        "hull_body": hull,
        "rigid_mass": model.body_subtreemass[hull],
        "neutral_volume": vehicle.neutral_volume,
        "gravity": vehicle.gravity,
        "reference_density": vehicle.reference_density,
        "compressibility": vehicle.hull_compressibility,
        "thermal_expansion": vehicle.hull_thermal_expansion,
        "thermal_lag": vehicle.hull_thermal_lag,
        "reference_temperature": vehicle.hull_reference_temperature,
        "length": vehicle.hull_length,
        "diameter": vehicle.hull_diameter,
        "added_mass": added_mass,
        "coupling": float(vehicle.added_mass_coupling),
        "rotary_inertia": np.diag(inertia) + np.diag(added_mass)[3:],
        "law": LAWS.code(vehicle.law.kind),
        "law_scaled": float(vehicle.law.density_in_coefficients),
        "acting": float(any(_acts(part) for part in vehicle.parts)),
        "control_period": vehicle.control_period,
        "floor_body": _floor_body(model),
        "log_ring": ring,
        "version": b.VERSION,
        "magic": b.MAGIC,
    }.items():
        head[name] = value
    body = _body(model)
    used = 0
    for name, values in (
        ("parts", _part_rows(vehicle, model)),
        ("law_values", vehicle.law.values()),
    ):
        body[used : used + values.size] = values
        head[name]["start"], head[name]["size"] = used, values.size
        used += values.size
    for name in RUN_TABLES:
        head[name]["start"], head[name]["size"] = used, 0


def refit(model: mujoco.MjModel, data: mujoco.MjData, vehicle: Vehicle, other: Vehicle) -> None:
    """Make a model of `vehicle` that of an `other` one of its build, without compiling.

    They may differ in the hull's law, added mass, volume and compressibility, in the place of the
    fixed block's centre of gravity, and in the fields of their parts but for travels and places.
    The tables of a run are taken out, and `data` of the model are overwritten.

    Raises:
      VehicleError: they differ in something else.
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
                f"{_label(other)}: its {what} is not that of {vehicle.name!r}, so that it needs a "
                "model of its own (twin.physics.mujoco_model.compile_model)"
            )
    head = header(model)
    words, ring, centred = (int(head[name]) for name in ("words", "log_ring", "centred"))
    model.body_ipos[model.body("hull").id] = flip_vector(other.static_cg)
    mujoco.mj_setConst(model, data)
    fill_block(model, other, words, ring=ring)
    header(model)["centred"] = float(centred)


def _floor_body(model: mujoco.MjModel) -> int:
    """Place of the sea floor's plane among the mocap bodies; -1 where there is none."""
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, FLOOR_BODY)
    return -1 if found < 0 else int(model.body_mocapid[found])


def _acts(part: Part) -> bool:
    """Whether a part does more than displace volume at the CB."""
    kind = type(part)
    elsewhere = kind.native_volume is not None and any(part.position)
    return elsewhere or kind.native_mass is not None or kind.native_wrench is not None


def _part_rows(vehicle: Vehicle, model: mujoco.MjModel) -> np.ndarray:
    """The parts as numbers, shape (parts * PART_WORDS,)."""
    rows = np.zeros(len(vehicle.parts), b.PART)
    for index, (row, part) in enumerate(zip(rows, vehicle.parts, strict=True)):
        kind, values = type(part), part.values()
        if len(values) > b.VALUES:
            raise VehicleError(
                f"{_label(vehicle)}: part {part.name!r} has {len(values)} values, at most "
                f"{b.VALUES} are possible"
            )
        row["kind"], row["one_way"] = PARTS.code(part.kind), float(part.one_way)
        row["low"], row["high"], row["rate"] = part.low, part.high, part.rate
        row["lag"] = _step_lag(part.lag, model)
        row["place"], row["rest"] = part.position, part.rest
        row["values"][: len(values)] = values
        row["dof"] = -1.0
        if model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT:
            row["dof"] = model.jnt_dofadr[model.actuator_trnid[index, 0]]
            row["servo_damping"] = -model.actuator_biasprm[index, 2]
        for effect in ("volume", "mass", "wrench"):
            row[f"gives_{effect}"] = float(getattr(kind, f"native_{effect}") is not None)
    return rows.view(np.float64).ravel()


def room(model: mujoco.MjModel) -> int:
    """Numbers that the tables of a run may have together in this model."""
    return len(_body(model)) - int(header(model)["plan"]["start"])


def write_tables(model: mujoco.MjModel, tables: Tables) -> None:
    """Put the tables of a run into the model, in place of those that it carried.

    Raises:
      InputError: they are larger than the model's room; compile it with a larger `reserve`.
      FloorError: a sea floor for a model that was compiled without one.
    """
    if tables.floor.size and header(model)["floor_body"] < 0.0:
        raise FloorError(
            "this model was compiled without a sea floor, so nothing would touch it: compile it "
            "with tables=Tables(floor=...)"
        )
    if tables.words > room(model):
        raise InputError(
            f"the tables of this run have {tables.words} numbers, the model has room for "
            f"{room(model)}; compile it with reserve={tables.words}"
        )
    head, body = header(model), _body(model)
    used = int(head["plan"]["start"])
    for name in RUN_TABLES:
        values = getattr(tables, name).ravel()
        head[name]["size"] = 0  # first: no table may be seen half written
        head[name]["start"] = used
        body[used : used + values.size] = values
        head[name]["size"] = values.size
        used += values.size
    head["plan_rows"] = len(tables.plan)
    head["control"] = tables.control
    if tables.gains is not None:
        head["gains"] = tables.gains
    elif tables.control == b.CONTROL_SCHEDULE:
        head["control_period"] = model.opt.timestep


def _step_lag(lag: float, model: mujoco.MjModel) -> float:
    """The lag [s] with which one explicit step follows the exponential exactly.

    MuJoCo advances activations by act + dt * rate, except under RK4, which needs the true lag.
    """
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        return lag
    timestep = model.opt.timestep
    return float(timestep / -np.expm1(-timestep / lag))


def _write_inertia(spec: mujoco.MjSpec, vehicle: Vehicle) -> None:
    """Make the spec's bodies those of `vehicle`, which may differ from its XML text."""
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
        # the file may have said it the other way, and both at once are refused
        body.inertia, body.fullinertia = np.zeros(3), np.full(6, np.nan)
        if np.count_nonzero(i - np.diag(np.diag(i))):
            body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
        else:
            body.inertia = np.diag(i)
    for mass in vehicle.masses:
        spec.body(mass.name).pos = [mass.neutral_x, 0.0, 0.0]


def _write_parts(spec: mujoco.MjSpec, vehicle: Vehicle) -> None:
    """Make the spec's travels and places those of `vehicle`."""
    for part in vehicle.parts:
        actuator = spec.actuator(part.name)
        actuator.actrange = actuator.ctrlrange = [part.low, part.high]
        if part.joint is None:
            spec.site(actuator.target).pos = flip_vector(np.array(part.position))
    for name, place in (("imu", vehicle.imu_position), ("gps", vehicle.gps_position)):
        spec.site(name).pos = flip_vector(place)


def _strip(spec: mujoco.MjSpec) -> None:
    """Delete sensors, cameras, lights and geoms that neither collide nor feel the water."""
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


def _check_free_joint(spec: mujoco.MjSpec, vehicle: Vehicle) -> None:
    """Before compiling, which would blame a keyframe for the missing joint."""
    joints = spec.body("hull").joints
    if not joints or joints[0].type != mujoco.mjtJoint.mjJNT_FREE:
        raise VehicleError(
            f"{_label(vehicle)}: the free joint 'hull' (<freejoint name=\"hull\"/>) is missing: "
            "put it first into body 'hull'"
        )


def _check_structure(model: mujoco.MjModel, vehicle: Vehicle) -> None:
    """The native code relies on the hull coming first and on one activation for each part."""
    first = model.joint(0) if model.njnt else None
    if (
        first is None
        or first.type[0] != mujoco.mjtJoint.mjJNT_FREE
        or (model.body(int(first.bodyid[0])).name != "hull")
    ):
        raise VehicleError(
            f"{_label(vehicle)}: the first joint must be the free joint of body 'hull' "
            '(<freejoint name="hull"/>)'
        )
    names = tuple(model.actuator(i).name for i in range(model.nu))
    if names != vehicle.part_names or model.na != model.nu:
        raise VehicleError(
            f"{_label(vehicle)}: each actuator must be a part with one activation state "
            f"(dyntype='user' actdim='1'); found {', '.join(names)} with {model.na} activations"
        )
    if model.njnt != 1 + sum((m.slide is not None) + (m.hinge is not None) for m in vehicle.masses):
        joints = ", ".join(model.joint(i).name or "one without a name" for i in range(model.njnt))
        raise VehicleError(
            f"{_label(vehicle)}: joints other than the hull's must be slides or hinges of moving "
            f"masses, each with an actuator; found {joints}"
        )
    for index, _ in joint_places(model):
        joint = model.joint(int(model.actuator_trnid[index, 0]))
        if joint.stiffness[0] or np.any(joint.damping) or np.any(joint.frictionloss):
            raise VehicleError(
                f"{_label(vehicle)}: joint {joint.name!r} must be without stiffness, damping and "
                "frictionloss: the servo of its actuator holds it"
            )
    if not np.array_equal(model.M_rowadr[:6], _FREE_JOINT_ROWS):
        raise VehicleError(f"{_label(vehicle)}: body 'hull' must be the first moving body")
    if model.opt.density != 0 or model.opt.viscosity != 0:
        raise VehicleError(
            f"{_label(vehicle)}: <option> density and viscosity must be 0: MuJoCo's own "
            "fluid would act beside ours"
        )


def _label(vehicle: Vehicle) -> str:
    return f"vehicle {vehicle.name!r} ({vehicle.path})"


def _first_line(error: Exception) -> str:
    return " ".join(str(error).split())
