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

from twin.compiled import cfunc, generation
from twin.errors import TwinError
from twin.mission.guidance import GUIDANCE_STATE
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import array, block_address, field, inline, jit, layout_table
from twin.physics.native.control import run_control
from twin.physics.native.mass_matrix import add_added_mass
from twin.physics.native.memory import load_f8, load_i8
from twin.physics.native.sample_log import run_log
from twin.physics.native.water import (
    actuator_rate,
    added_mass_wrench,
    coefficient_wrench,
    displaced_volume,
    ellipsoid_wrench,
    immersion,
)
from twin.water.current.sampler import sample
from twin.water.density import density_at

USER_SIZE = b.U_GUIDANCE + GUIDANCE_STATE

_VOID = types.void(types.int64, types.int64)

mj_make_mass = types.ExternalFunction("mj_makeM", _VOID)
mj_factor_mass = types.ExternalFunction("mj_factorM", _VOID)


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
def _compile(_: int) -> dict[str, numba.core.ccallback.CFunc]:
    """The three C functions of one `generation`; older ones stay, others may be running them."""
    at.publish()
    llvm.load_library_permanently(str(at.library_path()))

    @cfunc(_VOID)
    def glider_twin_water(model, data):
        water(model, data)

    @cfunc(_VOID)
    def glider_twin_control(model, data):
        control(model, data)

    @cfunc(types.float64(types.int64, types.int64, types.int32))
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
_addresses: dict[str, int] = {}


def install() -> None:
    """Install the callbacks in this process; calling it again changes nothing.

    After a kind of current was registered they are compiled again with its kernel.

    Raises:
      LayoutError: MuJoCo's structs are not where the callbacks would look.
      TwinError: another library's callback is in the way.
    """
    compiled = _compile(generation())
    for name, function in compiled.items():
        present = getattr(mujoco, f"get_mjcb_{name}")()
        ours = _installed.get(name)
        if present is not None and present is not ours:
            raise TwinError(
                f"mjcb_{name} is already taken by {present!r}; MuJoCo has one per process: "
                f"clear it with mujoco.set_mjcb_{name}(None) before loading a glider"
            )
        if _addresses.get(name) != function.address:
            ours = _PROTOTYPES[name](function.address)
            _installed[name], _addresses[name] = ours, function.address
        getattr(mujoco, f"set_mjcb_{name}")(ours)


def uninstall() -> None:
    """Take the callbacks out again; gliders in this process then move in vacuum."""
    for name, ours in _installed.items():
        if getattr(mujoco, f"get_mjcb_{name}")() is ours:
            getattr(mujoco, f"set_mjcb_{name}")(None)
