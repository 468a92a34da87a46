"""Model: a vehicle file made into the MuJoCo model that the native water acts on."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.errors import InputError, VehicleError, unknown_name
from twin.frames import flip_vector
from twin.mission.guidance import GUIDANCE_STATE
from twin.physics.native import block as b
from twin.physics.native import plant
from twin.vehicle.vehicle import ACTUATORS, Vehicle, load_vehicle

HYDRODYNAMICS = {"coefficients": b.COEFFICIENTS, "ellipsoid": b.ELLIPSOID}
INTEGRATORS = {
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
}
SEAWATER_VISCOSITY = 1.4e-3
"""[Pa s] dynamic viscosity at about 10 degC; only the ellipsoid law uses it."""
SHORTEST_STEP, LONGEST_STEP = 1e-4, 1.0
"""[s]"""
ELLIPSOID_TIMESTEP = 0.02
"""[s] quadratic rotary drag of the ellipsoid law is stiff at inflections: 0.1 s diverges there"""
JOINTS = {
    "hull": mujoco.mjtJoint.mjJNT_FREE,
    "shift": mujoco.mjtJoint.mjJNT_SLIDE,
    "rotation": mujoco.mjtJoint.mjJNT_HINGE,
}
"""The joints that the native code moves, in their order"""
JOINT_WORDS = {
    mujoco.mjtJoint.mjJNT_FREE: "free",
    mujoco.mjtJoint.mjJNT_SLIDE: "slide",
    mujoco.mjtJoint.mjJNT_HINGE: "hinge",
}
JOINT_RULE = (
    "joints must be the free joint 'hull' on body 'hull', then the slide 'shift' and the hinge "
    "'rotation' on body 'battery'"
)
_FREE_JOINT_ROWS = np.array([0, 1, 3, 6, 10, 15])


def compile_model(
    vehicle: Vehicle | str = "glider",
    *,
    hydrodynamics: str = "coefficients",
    timestep: float | None = None,
    integrator: str | None = None,
    lean: bool = False,
) -> mujoco.MjModel:
    """Compile a vehicle with the parameter block appended, and install the native callbacks.

    Args:
      vehicle: a `Vehicle` (its fields win over its XML text) or what `load_vehicle` takes.
      hydrodynamics: "coefficients" (identified law) or "ellipsoid" (MuJoCo's geometry law).
      timestep: [s], None for the file's.
      integrator: one of INTEGRATORS, None for the file's.
      lean: leave out what only eyes and sensors need; the dynamics are the same.

    Raises:
      VehicleError: the file does not compile or has another joint or actuator structure.
      InputError: unknown hydrodynamics or integrator, impossible timestep.
    """
    if isinstance(vehicle, str):
        vehicle = load_vehicle(vehicle)
    if hydrodynamics not in HYDRODYNAMICS:
        raise InputError(unknown_name("hydrodynamics", hydrodynamics, HYDRODYNAMICS))
    try:
        spec = mujoco.MjSpec.from_string(vehicle.xml)
    except ValueError as error:
        raise VehicleError(f"{_label(vehicle)}: {_first_line(error)}") from error
    _check_joints(spec, vehicle)
    _write_inertia(spec, vehicle)
    if lean:
        _strip(spec)
    if timestep is None and hydrodynamics == "ellipsoid":
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
    spec.nuserdata = b.U_GUIDANCE + GUIDANCE_STATE
    spec.add_numeric(name=b.NAME, size=b.PARAMETERS, data=np.zeros(b.PARAMETERS))
    try:
        model = spec.compile()
    except ValueError as error:
        raise VehicleError(f"{_label(vehicle)}: {_first_line(error)}") from error
    _check_structure(model, vehicle)
    fill_block(model, vehicle, hydrodynamics)
    plant.install()
    return model


def parameter_block(model: mujoco.MjModel) -> np.ndarray:
    """The live parameter block of a compiled model, shape (PARAMETERS,)."""
    return model.numeric_data[-b.PARAMETERS :]


def fill_block(model: mujoco.MjModel, vehicle: Vehicle, hydrodynamics: str) -> None:
    """Write the vehicle's parameters into the model's block."""
    block = parameter_block(model)
    block[:] = 0.0
    block[b.P_MAGIC], block[b.P_VERSION] = b.MAGIC, b.VERSION
    block[b.P_HYDRODYNAMICS] = HYDRODYNAMICS[hydrodynamics]
    hull = model.body("hull").id
    block[b.P_HULL_BODY] = hull
    block[b.P_RIGID_MASS] = model.body_subtreemass[hull]
    block[b.P_NEUTRAL_VOLUME] = vehicle.neutral_volume
    block[b.P_GRAVITY] = vehicle.gravity
    block[b.P_REFERENCE_DENSITY] = vehicle.reference_density
    block[b.P_COMPRESSIBILITY] = vehicle.hull_compressibility
    block[b.P_LENGTH], block[b.P_DIAMETER] = vehicle.hull_length, vehicle.hull_diameter
    for start, values in (
        (b.P_DRAG, vehicle.drag),
        (b.P_LIFT, vehicle.lift),
        (b.P_SIDE, vehicle.side_force),
        (b.P_ROLL, vehicle.roll_moment),
        (b.P_PITCH, vehicle.pitch_moment),
        (b.P_YAW, vehicle.yaw_moment),
        (b.P_LAG, _step_lag(vehicle.actuator_lag, model)),
        (b.P_RATE, vehicle.actuator_rate),
        (b.P_ACTUATOR_MIN, vehicle.actuator_min),
        (b.P_ACTUATOR_MAX, vehicle.actuator_max),
    ):
        block[start : start + len(values)] = values
    block[b.P_LINEAR_ANGLE] = vehicle.linear_angle
    block[b.P_BLEND_ANGLE] = vehicle.blend_angle
    block[b.P_MIN_SPEED] = vehicle.rate_damping_min_speed
    block[b.P_CONTROL_PERIOD] = vehicle.control_period
    block[b.P_VISCOSITY] = SEAWATER_VISCOSITY
    added_mass = vehicle.added_mass
    if hydrodynamics == "ellipsoid":
        geoms = fluid_geoms(model)
        if not len(geoms):
            raise VehicleError(
                f"{_label(vehicle)} has no geom with fluidshape='ellipsoid' on its hull; "
                "add one or use --hydrodynamics coefficients"
            )
        added_mass = ellipsoid_added_mass(geoms, vehicle.reference_density)
        block[b.P_FLUID], block[b.P_FLUID_COUNT] = share(geoms), len(geoms)
    block[b.P_ADDED_MASS : b.P_ADDED_MASS + 36] = added_mass.ravel()
    rotary = np.diag(vehicle.static_inertia + vehicle.movable_inertia) + np.diag(added_mass)[3:]
    block[b.P_ROTARY_INERTIA : b.P_ROTARY_INERTIA + 3] = rotary


def _step_lag(lag: np.ndarray, model: mujoco.MjModel) -> np.ndarray:
    """The lag [s] with which one explicit step follows the exponential exactly.

    MuJoCo advances activations by act + dt * rate, except under RK4, which needs the true lag.
    """
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        return lag
    timestep = model.opt.timestep
    return timestep / -np.expm1(-timestep / lag)


_shared: dict[bytes, np.ndarray] = {}


def share(values: np.ndarray) -> float:
    """Address of an immortal copy of `values` (float64), for small tables that models point to."""
    values = np.ascontiguousarray(values, float)
    kept = _shared.setdefault(values.tobytes(), values)
    return float(kept.ctypes.data)


def fluid_geoms(model: mujoco.MjModel) -> np.ndarray:
    """The hull's ellipsoid fluid geoms, shape (count, FLUID_ROW), hull axes; see native.block."""
    hull, rows = model.body("hull").id, []
    for geom in np.flatnonzero(model.geom_bodyid == hull):
        if model.geom_fluid[geom, 0] == 0:
            continue
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        size, kind = model.geom_size[geom], model.geom_type[geom]
        if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            axes = np.full(3, size[0])
        elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            axes = np.array([size[0], size[0], size[0] + size[1]])
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            axes = np.array([size[0], size[0], size[1]])
        else:
            axes = size.copy()
        rows.append(np.concatenate([model.geom_pos[geom], rotation, axes, model.geom_fluid[geom]]))
    return np.array(rows).reshape(-1, b.FLUID_ROW)


def ellipsoid_added_mass(geoms: np.ndarray, density: float) -> np.ndarray:
    """Added mass (6, 6), FRD about the CB, of MuJoCo's virtual masses at each fluid geom."""
    total = np.zeros((6, 6))
    for row in geoms:
        rotation = row[3:12].reshape(3, 3)
        x, y, z = row[:3]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        # velocity at the geom in its own axes = R^T (v + omega x r); spin = R^T omega
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = rotation.T
        jacobian[:3, 3:] = -rotation.T @ cross
        jacobian[3:, 3:] = rotation.T
        virtual = density * row[15] * np.concatenate([row[21:24], row[24:27]])
        total += jacobian.T @ np.diag(virtual) @ jacobian
    signs = np.concatenate([flip_vector(np.ones(3))] * 2)
    return total * np.outer(signs, signs)


def _write_inertia(spec: mujoco.MjSpec, vehicle: Vehicle) -> None:
    """Make the spec's bodies those of `vehicle`, which may differ from its XML text."""
    signs = np.outer(flip_vector(np.ones(3)), flip_vector(np.ones(3)))
    battery_offset = np.array([0.0, 0.0, -vehicle.movable_eccentricity])
    for name, mass, cg, inertia in (
        ("hull", vehicle.static_mass, flip_vector(vehicle.static_cg), vehicle.static_inertia),
        ("battery", vehicle.movable_mass, battery_offset, vehicle.movable_inertia),
    ):
        body = spec.body(name)
        i = inertia * signs
        body.mass, body.ipos = mass, cg
        body.iquat = [1, 0, 0, 0]
        if np.count_nonzero(i - np.diag(np.diag(i))):
            body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
        else:
            body.inertia = np.diag(i)
    battery = spec.body("battery")
    battery.pos = [vehicle.movable_neutral_x, battery.pos[1], battery.pos[2] * 0.0]


def _strip(spec: mujoco.MjSpec) -> None:
    """Delete sensors, cameras, lights and force-free geoms: nothing here moves the glider."""
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    for item in [*spec.cameras, *spec.lights]:
        spec.delete(item)
    for geom in list(spec.geoms):
        if geom.fluid_ellipsoid == 0:
            spec.delete(geom)
    for site in list(spec.sites):
        if site.name != "cb":
            spec.delete(site)


def _check_joints(spec: mujoco.MjSpec, vehicle: Vehicle) -> None:
    """Before compiling: MuJoCo reports a joint that is missing as a keyframe of the wrong size."""
    found = {joint.name: joint.type for joint in spec.joints}
    for name, kind in JOINTS.items():
        if found.get(name) != kind:
            word = JOINT_WORDS[kind]
            example = f'<freejoint name="{name}"/>' if word == "free" else f'type="{word}"'
            raise VehicleError(
                f"{_label(vehicle)}: the {word} joint {name!r} ({example}) is missing; {JOINT_RULE}"
            )
    if len(spec.joints) != len(JOINTS):
        names = ", ".join(joint.name or "one without a name" for joint in spec.joints)
        raise VehicleError(f"{_label(vehicle)}: {JOINT_RULE} and no others; found {names}")


def _check_structure(model: mujoco.MjModel, vehicle: Vehicle) -> None:
    """The native code relies on this order of joints, dofs and actuators."""
    joints = [model.joint(i).name for i in range(model.njnt)]
    if joints != list(JOINTS):
        raise VehicleError(f"{_label(vehicle)}: {JOINT_RULE}; found them as {', '.join(joints)}")
    actuators = [model.actuator(i).name for i in range(model.nu)]
    if actuators != list(ACTUATORS) or model.na != 3:
        raise VehicleError(
            f"{_label(vehicle)}: actuators must be {', '.join(ACTUATORS)} in this order, "
            f"each with one activation state (dyntype='user' actdim='1'); found "
            f"{', '.join(actuators)} with {model.na} activations"
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
