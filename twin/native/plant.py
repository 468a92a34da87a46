"""The native callbacks: water, actuators, guidance and logging inside MuJoCo's own step.

`mjcb_passive` owns the water: it adds M_A to the mass matrix and writes the hull's row of
`xfrc_applied`. `mjcb_act_dyn` moves the actuators, `mjcb_control` runs guidance and the log. All
three return at once for a model without our parameter block, so other models in the process
are untouched. They are C functions without the GIL: `mj_step`, `mujoco.batch` and dm_control
run the same code.
"""

from __future__ import annotations

import ctypes
import functools
import math

import llvmlite.binding as llvm
import mujoco
import numba
from numba import types

from twin.current.sampler import sample
from twin.density import density_at
from twin.errors import TwinError
from twin.guidance import (
    GAINS,
    GUIDANCE_STATE,
    HEADING_SETPOINT,
    PITCH_SETPOINT,
    SEGMENT,
    SEGMENT_COLUMNS,
    guidance_step,
)
from twin.native import block as b
from twin.native import layout as at
from twin.native.cache import cached_by_content
from twin.native.memory import as_f8_pointer, load_f8, load_i8
from twin.native.water import (
    actuator_rate,
    added_mass_wrench,
    coefficient_wrench,
    displaced_volume,
    ellipsoid_wrench,
    immersion,
)

USER_SIZE = b.U_GUIDANCE + GUIDANCE_STATE

_VOID = types.void(types.int64, types.int64)

layout_table = types.ExternalFunction("glider_twin_layout", types.int64())
mj_make_mass = types.ExternalFunction("mj_makeM", _VOID)
mj_factor_mass = types.ExternalFunction("mj_factorM", _VOID)

jit = numba.njit(error_model="numpy")
inline = numba.njit(error_model="numpy", inline="always")


@inline
def field(table, struct, slot):
    """The pointer-sized word of `struct` at `slot` of the layout table."""
    return load_i8(struct + load_i8(table + 8 * slot))


@inline
def block_address(table, model):
    """Address of the model's parameter block, 0 when it is not one of ours."""
    count = field(table, model, at.M_NUMERIC_COUNT)
    if count < b.PARAMETERS:
        return 0
    address = field(table, model, at.M_NUMERIC_DATA) + 8 * (count - b.PARAMETERS)
    if load_f8(address) != b.MAGIC or load_f8(address + 8) != b.VERSION:
        return 0
    return address


@inline
def array(address, size):
    """The `size` float64 values at `address`, as an array without a copy."""
    return numba.carray(as_f8_pointer(address), size)


@jit
def add_added_mass(block, mass, rotation):
    """Add J^T M_A J to the free joint's block of the lower-triangular mass matrix.

    The free joint's linear velocities are in the world frame, its angular ones in hull axes, so
    J = diag(R^T, 1) with R hull to world. `rotation` is R, row major; M_A turns from FRD to
    hull axes by the signs of its rows and columns.
    """
    r00, r01, r02 = rotation[0], rotation[1], rotation[2]
    r10, r11, r12 = rotation[3], rotation[4], rotation[5]
    r20, r21, r22 = rotation[6], rotation[7], rotation[8]
    m = b.P_ADDED_MASS
    # A R^T with A in hull axes: x keeps its sign, y and z flip together
    a00, a01, a02 = block[m], -block[m + 1], -block[m + 2]
    a11, a12, a22 = block[m + 7], block[m + 8], block[m + 14]
    t00, t01, t02 = _times(a00, a01, a02, r00, r01, r02, r10, r11, r12, r20, r21, r22)
    t10, t11, t12 = _times(a01, a11, a12, r00, r01, r02, r10, r11, r12, r20, r21, r22)
    t20, t21, t22 = _times(a02, a12, a22, r00, r01, r02, r10, r11, r12, r20, r21, r22)
    mass[0] += r00 * t00 + r01 * t10 + r02 * t20
    mass[1] += r10 * t00 + r11 * t10 + r12 * t20
    mass[2] += r10 * t01 + r11 * t11 + r12 * t21
    mass[3] += r20 * t00 + r21 * t10 + r22 * t20
    mass[4] += r20 * t01 + r21 * t11 + r22 * t21
    mass[5] += r20 * t02 + r21 * t12 + r22 * t22
    # C R^T, rotational rows against translational columns, and the rotational corner
    for i in range(3):
        k = m + 18 + 6 * i
        sign = 1.0 if i == 0 else -1.0
        c0, c1, c2 = sign * block[k], -sign * block[k + 1], -sign * block[k + 2]
        x, y, z = _times(c0, c1, c2, r00, r01, r02, r10, r11, r12, r20, r21, r22)
        start = (3 + i) * (4 + i) // 2
        mass[start] += x
        mass[start + 1] += y
        mass[start + 2] += z
        mass[start + 3] += sign * block[k + 3]
        if i > 0:
            mass[start + 4] -= sign * block[k + 4]
        if i > 1:
            mass[start + 5] -= sign * block[k + 5]


@inline
def _times(a, b0, c, r00, r01, r02, r10, r11, r12, r20, r21, r22):
    """The row (a, b0, c) times R^T."""
    return (
        a * r00 + b0 * r01 + c * r02,
        a * r10 + b0 * r11 + c * r12,
        a * r20 + b0 * r21 + c * r22,
    )


@inline
def remember_velocity(state, velocity, time, timestep):
    """Keep the velocities of this step and the one before; after a jump, of this one only."""
    if state[b.U_KNOWN] == 0.0 or time != state[b.U_TIME]:
        consecutive = abs(time - state[b.U_TIME] - timestep) < 1e-6 * timestep
        for i in range(6):
            if consecutive and state[b.U_KNOWN] == 1.0:
                state[b.U_EARLIER + i] = state[b.U_TWIST + i]
            else:
                state[b.U_EARLIER + i] = velocity[i]
        state[b.U_TIME] = time
        state[b.U_KNOWN] = 1.0
    for i in range(6):
        state[b.U_TWIST + i] = velocity[i]


@inline
def kept(block, axis, damping, stiff):
    """Part of the last velocity change that the next step repeats under rotary damping."""
    return max(0.0, 1.0 + block[damping] * stiff / block[b.P_ROTARY_INERTIA + axis])


@jit
def water(model, data):
    """One evaluation of everything the water does; idempotent at a given state."""
    table = layout_table()
    address = block_address(table, model)
    if address == 0:
        return
    block = array(address, b.PARAMETERS)
    hull = int(block[b.P_HULL_BODY])
    rotation = array(field(table, data, at.D_XMAT) + 72 * hull, 9)
    mass = array(field(table, data, at.D_MASS), 36)
    rigid = 3.0 * block[b.P_RIGID_MASS]
    if abs(mass[0] + mass[2] + mass[5] - rigid) > 1e-9 * rigid:
        mj_make_mass(model, data)  # called again at the same state: M_A is already inside
    add_added_mass(block, mass, rotation)
    mj_factor_mass(model, data)

    position = array(field(table, data, at.D_XPOS) + 24 * hull, 3)
    velocity = array(field(table, data, at.D_QVEL), 6)
    state = array(field(table, data, at.D_USERDATA), b.U_GUIDANCE)
    force = array(field(table, data, at.D_XFRC_APPLIED) + 48 * hull, 6)
    time = load_f8(data + load_i8(table + 8 * at.D_TIME))
    depth = -position[2]
    total = 0.0
    for i in range(6):
        total += velocity[i]
    if not math.isfinite(total + position[0] + position[1] + depth):
        if state[b.U_FAILED] == 0.0:
            state[b.U_FAILED], state[b.U_FAIL_TIME] = 1.0, time
        for i in range(6):
            force[i] = 0.0
        return

    v0, v1, v2 = velocity[0], velocity[1], velocity[2]
    centred = block[b.P_CENTRED] == 1.0
    timestep = 0.0
    if centred:
        timestep = load_f8(model + load_i8(table + 8 * at.M_TIMESTEP))
        remember_velocity(state, velocity, time, timestep)
        v0 += 0.5 * (v0 - state[b.U_EARLIER])
        v1 += 0.5 * (v1 - state[b.U_EARLIER + 1])
        v2 += 0.5 * (v2 - state[b.U_EARLIER + 2])

    # current and its rate along the path, NED, then through-water velocity in FRD
    cn, ce, cd, rn, re, rd = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    size = int(block[b.P_CURRENT_SIZE])
    if size > 0:
        program = array(int(block[b.P_CURRENT]), size)
        cn, ce, cd, rn, re, rd = sample(
            program,
            time,
            position[0],
            -position[1],
            depth,
            v0,
            -v1,
            -v2,
        )
    dx, dy, dz = v0 - cn, v1 + ce, v2 + cd
    u = rotation[0] * dx + rotation[3] * dy + rotation[6] * dz
    v = -(rotation[1] * dx + rotation[4] * dy + rotation[7] * dz)
    w = -(rotation[2] * dx + rotation[5] * dy + rotation[8] * dz)
    ax = rotation[0] * rn - rotation[3] * re - rotation[6] * rd
    ay = -(rotation[1] * rn - rotation[4] * re - rotation[7] * rd)
    az = -(rotation[2] * rn - rotation[5] * re - rotation[8] * rd)
    p, q, r = velocity[3], -velocity[4], -velocity[5]
    if centred:
        stiff = timestep * (u * u + v * v + w * w)
        p += 0.5 * kept(block, 0, b.P_ROLL + 1, stiff) * (p - state[b.U_EARLIER + 3])
        q += 0.5 * kept(block, 1, b.P_PITCH + 2, stiff) * (q + state[b.U_EARLIER + 4])
        r += 0.5 * kept(block, 2, b.P_YAW + 1, stiff) * (r + state[b.U_EARLIER + 5])

    density = block[b.P_REFERENCE_DENSITY]
    size = int(block[b.P_DENSITY_SIZE])
    if size > 0:
        density = density_at(array(int(block[b.P_DENSITY]), size), depth)
    sin_pitch = rotation[6]  # world z of the hull's forward axis
    fraction, arm = immersion(block, depth, sin_pitch)

    if block[b.P_HYDRODYNAMICS] == b.ELLIPSOID:
        count = int(block[b.P_FLUID_COUNT])
        geoms = array(int(block[b.P_FLUID]), count * b.FLUID_ROW)
        x, y, z, l, m, n = ellipsoid_wrench(
            geoms, count, density, block[b.P_VISCOSITY], u, -v, -w, p, -q, -r
        )
        y, z, m, n = -y, -z, -m, -n
    else:
        x, y, z, l, m, n = coefficient_wrench(block, u, v, w, p, q, r)
    xa, ya, za, la, ma, na = added_mass_wrench(block, u, v, w, p, q, r, ax, ay, az)
    x, y, z = fraction * x + xa, -(fraction * y + ya), -(fraction * z + za)
    l, m, n = fraction * l + la, -(fraction * m + ma), -(fraction * n + na)

    # hull axes to world, buoyancy on top, moment moved from the CB to the centre of mass
    pump = array(field(table, data, at.D_ACT), 3)[2]
    volume = displaced_volume(block, pump, depth)
    lift = density * volume * block[b.P_GRAVITY]
    fx = rotation[0] * x + rotation[1] * y + rotation[2] * z
    fy = rotation[3] * x + rotation[4] * y + rotation[5] * z
    fz = rotation[6] * x + rotation[7] * y + rotation[8] * z + fraction * lift
    mx = rotation[0] * l + rotation[1] * m + rotation[2] * n + arm * lift * rotation[3]
    my = rotation[3] * l + rotation[4] * m + rotation[5] * n - arm * lift * rotation[0]
    mz = rotation[6] * l + rotation[7] * m + rotation[8] * n
    centre = array(field(table, data, at.D_XIPOS) + 24 * hull, 3)
    ox, oy, oz = centre[0] - position[0], centre[1] - position[1], centre[2] - position[2]
    force[0], force[1], force[2] = fx, fy, fz
    force[3] = mx - (oy * fz - oz * fy)
    force[4] = my - (oz * fx - ox * fz)
    force[5] = mz - (ox * fy - oy * fx)

    state[b.U_CURRENT], state[b.U_CURRENT + 1], state[b.U_CURRENT + 2] = cn, ce, cd
    state[b.U_CURRENT_RATE], state[b.U_CURRENT_RATE + 1] = rn, re
    state[b.U_CURRENT_RATE + 2] = rd
    state[b.U_DENSITY] = density
    state[b.U_IMMERSION] = fraction
    state[b.U_NET_MASS] = block[b.P_RIGID_MASS] - density * volume


@jit
def actuate(model, data, index):
    """d(act)/dt of actuator `index`; 0 for models that are not ours."""
    table = layout_table()
    address = block_address(table, model)
    if address == 0 or index > 2:
        return 0.0
    block = array(address, b.PARAMETERS)
    position = array(field(table, data, at.D_ACT), 3)[index]
    command = array(field(table, data, at.D_CTRL), 3)[index]
    return actuator_rate(block, index, position, command)


@jit
def run_control(block, table, data, time, state):
    """Guidance or schedule, once per control period."""
    period = block[b.P_CONTROL_PERIOD]
    step_tolerance = 1e-6 * period
    if time < state[b.U_TICKS] * period - step_tolerance:
        return
    state[b.U_TICKS] += 1.0
    control = array(field(table, data, at.D_CTRL), 3)
    rows = int(block[b.P_TABLE_ROWS])
    if block[b.P_CONTROL] == b.CONTROL_SCHEDULE:
        steps = numba.carray(as_f8_pointer(int(block[b.P_TABLE])), (rows, 4))
        k = 0
        while k + 1 < rows and time >= steps[k + 1, 0] - step_tolerance:
            k += 1
        for i in range(3):
            control[i] = steps[k, 1 + i]
        return
    qpos = array(field(table, data, at.D_QPOS), 9)
    velocity = array(field(table, data, at.D_QVEL), 6)
    hull = int(block[b.P_HULL_BODY])
    rotation = array(field(table, data, at.D_XMAT) + 72 * hull, 9)
    roll = math.atan2(rotation[7], rotation[8])
    pitch = math.asin(min(max(rotation[6], -1.0), 1.0))
    heading = math.atan2(-rotation[3], rotation[0])
    if heading < 0.0:
        heading += 2.0 * math.pi
    position = array(field(table, data, at.D_ACT), 3)
    plan = numba.carray(as_f8_pointer(int(block[b.P_TABLE])), (rows, SEGMENT_COLUMNS))
    gains = block[b.P_GAINS : b.P_GAINS + GAINS]
    memory = state[b.U_GUIDANCE : b.U_GUIDANCE + GUIDANCE_STATE]
    command = state[b.U_COMMAND : b.U_COMMAND + 3]
    guidance_step(
        plan,
        gains,
        memory,
        time,
        -qpos[2],
        roll,
        pitch,
        heading,
        velocity[3],
        -velocity[4],
        -velocity[5],
        position[0],
        position[1],
        position[2],
        command,
    )
    for i in range(3):
        control[i] = command[i]


@jit
def run_log(block, table, model, data, time, state):
    """Begin a log row when one is due; close the previous one with its acceleration."""
    qvel = array(field(table, data, at.D_QVEL), 8)
    timestep = load_f8(model + load_i8(table + 8 * at.M_TIMESTEP))
    logged = int(state[b.U_LOGGED])
    first = int(block[b.P_LOG])
    if state[b.U_OPEN] == 1.0:
        last = array(first + 8 * b.ROW * (logged - 1), b.ROW)
        elapsed = time - last[b.R_TIME]
        if elapsed > 0.5 * timestep:
            for i in range(6):
                last[b.R_ACCELERATION + i] = (qvel[i] - last[b.R_QVEL + i]) / elapsed
            state[b.U_OPEN] = 0.0
    due = logged * block[b.P_LOG_PERIOD]
    if logged >= int(block[b.P_LOG_ROWS]) or time < due - 0.5 * timestep:
        return
    row = array(first + 8 * b.ROW * logged, b.ROW)
    qpos = array(field(table, data, at.D_QPOS), 9)
    act = array(field(table, data, at.D_ACT), 3)
    control = array(field(table, data, at.D_CTRL), 3)
    row[b.R_TIME] = time
    for i in range(9):
        row[b.R_QPOS + i] = qpos[i]
    for i in range(8):
        row[b.R_QVEL + i] = qvel[i]
    for i in range(3):
        row[b.R_ACT + i] = act[i]
        row[b.R_CTRL + i] = control[i]
        row[b.R_CURRENT + i] = state[b.U_CURRENT + i]
    row[b.R_DENSITY] = state[b.U_DENSITY]
    row[b.R_IMMERSION] = state[b.U_IMMERSION]
    row[b.R_NET_MASS] = state[b.U_NET_MASS]
    row[b.R_PITCH_SETPOINT] = state[b.U_GUIDANCE + PITCH_SETPOINT]
    row[b.R_HEADING_SETPOINT] = state[b.U_GUIDANCE + HEADING_SETPOINT]
    row[b.R_SEGMENT] = state[b.U_GUIDANCE + SEGMENT]
    state[b.U_LOGGED] += 1.0
    state[b.U_OPEN] = 1.0


@jit
def control(model, data):
    """Guidance and log; both advance on time, so repeated calls at one state change nothing."""
    table = layout_table()
    address = block_address(table, model)
    if address == 0:
        return
    block = array(address, b.PARAMETERS)
    state = array(field(table, data, at.D_USERDATA), USER_SIZE)
    if state[b.U_FAILED] != 0.0:
        return
    time = load_f8(data + load_i8(table + 8 * at.D_TIME))
    if block[b.P_CONTROL] != b.CONTROL_NONE:
        run_control(block, table, data, time, state)
    if block[b.P_LOG_PERIOD] > 0.0:
        run_log(block, table, model, data, time, state)


@functools.cache
def _compile() -> dict[str, numba.core.ccallback.CFunc]:
    """Compile the three C functions, or load them from the cache."""
    at.publish()
    llvm.load_library_permanently(str(at.library_path()))
    with cached_by_content():
        wrap = functools.partial(numba.cfunc, cache=True, error_model="numpy")

        @wrap(_VOID)
        def glider_twin_water(model, data):
            water(model, data)

        @wrap(_VOID)
        def glider_twin_control(model, data):
            control(model, data)

        @wrap(types.float64(types.int64, types.int64, types.int32))
        def glider_twin_actuate(model, data, index):
            return actuate(model, data, index)

    return {
        "passive": glider_twin_water,
        "control": glider_twin_control,
        "act_dyn": glider_twin_actuate,
    }


_PROTOTYPES = {
    "passive": ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p),
    "control": ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p),
    "act_dyn": ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int),
}
_installed: dict[str, object] = {}


def install() -> None:
    """Install the callbacks in this process; calling it again changes nothing.

    Raises:
      LayoutError: MuJoCo's structs are not where the callbacks would look.
      TwinError: another library's callback is in the way.
    """
    compiled = _compile()
    for name, function in compiled.items():
        present = getattr(mujoco, f"get_mjcb_{name}")()
        ours = _installed.get(name)
        if present is not None and present is not ours:
            raise TwinError(
                f"mjcb_{name} is already taken by {present!r}; MuJoCo has one per process: "
                f"clear it with mujoco.set_mjcb_{name}(None) before loading a glider"
            )
        if ours is None:
            ours = _PROTOTYPES[name](function.address)
            _installed[name] = ours
        getattr(mujoco, f"set_mjcb_{name}")(ours)


def uninstall() -> None:
    """Take the callbacks out again; gliders in this process then move in vacuum."""
    for name, ours in _installed.items():
        if getattr(mujoco, f"get_mjcb_{name}")() is ours:
            getattr(mujoco, f"set_mjcb_{name}")(None)
