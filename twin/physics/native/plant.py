"""The native callbacks: water, parts, guidance and logging inside MuJoCo's own step.

`mjcb_passive` owns the water: it adds M_A to the mass matrix and writes the hull's row of
`xfrc_applied`. `mjcb_act_dyn` moves the parts, `mjcb_control` runs guidance and the log. All
three return at once for a model without our parameter block, so other models in the process
are untouched. They are C functions without the GIL: `mj_step`, `mujoco.batch` and dm_control
run the same code.
"""

from __future__ import annotations

import math

from numba import types

from twin.compiled import inline, jit
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import (
    array,
    block_start,
    field,
    header_address,
    header_at,
    layout_table,
    part_address,
    part_at,
    part_here,
    state_of,
    table_of,
)
from twin.physics.native.control import run_control
from twin.physics.native.effects import (
    law_rate_damping,
    law_wrench,
    part_mass,
    part_volume,
    part_wrench,
)
from twin.physics.native.floor import follow_floor, note_contact
from twin.physics.native.mass_matrix import add_added_mass, add_point_mass
from twin.physics.native.memory import load_f8, load_i8
from twin.physics.native.sample_log import run_log
from twin.physics.native.water import (
    added_mass_wrench,
    displaced_volume,
    immersion,
    part_rate,
    point_mass_wrench,
)
from twin.water.current.sampler import sample
from twin.water.density import density_at

CONTROL_NONE = b.CONTROL_NONE

_VOID = types.void(types.int64, types.int64)

mj_make_mass = types.ExternalFunction("mj_makeM", _VOID)
mj_factor_mass = types.ExternalFunction("mj_factorM", _VOID)


@inline
def remember_velocity(state, velocity, time, timestep):
    """Keep the velocities of this step and the one before; after a jump, of this one only."""
    if state.known == 0.0 or time != state.time:
        consecutive = abs(time - state.time - timestep) < 1e-6 * timestep
        for i in range(6):
            if consecutive and state.known == 1.0:
                state.earlier[i] = state.twist[i]
            else:
                state.earlier[i] = velocity[i]
        state.time = time
        state.known = 1.0
    for i in range(6):
        state.twist[i] = velocity[i]


@inline
def kept(damping, inertia):
    """Part of the last rate's change that the next step repeats under rotary damping."""
    return max(0.0, 1.0 + damping / inertia)


@jit
def water(model, data):
    """One evaluation of everything the water does; idempotent at a given state."""
    table = layout_table()
    address = header_address(table, model)
    if address == 0:
        return
    head = header_at(address)
    start = block_start(address, head)
    hull = int(head.hull_body)
    rotation = array(field(table, data, at.D_XMAT) + 72 * hull, 9)
    mass = array(field(table, data, at.D_MASS), 21)
    count = int(head.nu)
    act = array(field(table, data, at.D_ACT), count)
    rigid = 3.0 * head.rigid_mass
    if abs(mass[0] + mass[2] + mass[5] - rigid) > 1e-9 * rigid:
        mj_make_mass(model, data)  # called again at the same state: M_A is already inside
    add_added_mass(head.added_mass, mass, rotation)
    carried, volume = 0.0, 0.0
    for k in range(count):
        part = part_at(start, head, k)
        if part.gives_volume != 0.0:
            volume += part_volume(int(part.kind), part.values, act[k] + part.zero)
        if part.gives_mass != 0.0:
            extra = part_mass(int(part.kind), part.values, act[k] + part.zero)
            carried += extra
            add_point_mass(extra, part.place, mass, rotation)
    mj_factor_mass(model, data)

    position = array(field(table, data, at.D_XPOS) + 24 * hull, 3)
    velocity = array(field(table, data, at.D_QVEL), 6)
    state = state_of(table, data)
    force = array(field(table, data, at.D_XFRC_APPLIED) + 48 * hull, 6)
    time = load_f8(data + load_i8(table + 8 * at.D_TIME))
    depth = -position[2]
    total = 0.0
    for i in range(6):
        total += velocity[i]
    if not math.isfinite(total + position[0] + position[1] + depth):
        if state.failed == 0.0:
            state.failed, state.fail_time = 1.0, time
        for i in range(6):
            force[i] = 0.0
        return

    v0, v1, v2 = velocity[0], velocity[1], velocity[2]
    centred = head.centred == 1.0
    timestep = 0.0
    if centred:
        timestep = load_f8(model + load_i8(table + 8 * at.M_TIMESTEP))
        remember_velocity(state, velocity, time, timestep)
        v0 += 0.5 * (v0 - state.earlier[0])
        v1 += 0.5 * (v1 - state.earlier[1])
        v2 += 0.5 * (v2 - state.earlier[2])

    # current and its rate along the path, NED, then through-water velocity in FRD
    cn, ce, cd, rn, re, rd = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if head.current["size"] > 0.0:
        program = table_of(start, head, head.current)
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

    density = head.reference_density
    if head.density["size"] > 0.0:
        density = density_at(table_of(start, head, head.density), depth)
    law, values = int(head.law), table_of(start, head, head.law_values)
    if centred:
        dp, dq, dr = law_rate_damping(law, values, timestep, density, u, v, w, p, q, r)
        p += 0.5 * kept(dp, head.rotary_inertia[0]) * (p - state.earlier[3])
        q += 0.5 * kept(dq, head.rotary_inertia[1]) * (q + state.earlier[4])
        r += 0.5 * kept(dr, head.rotary_inertia[2]) * (r + state.earlier[5])

    sin_pitch = rotation[6]  # world z of the hull's forward axis
    fraction, arm = immersion(head.length, head.diameter, depth, sin_pitch)
    x, y, z, l, m, n = law_wrench(law, values, density, u, v, w, p, q, r)
    xa, ya, za, la, ma, na = added_mass_wrench(
        head.added_mass, head.coupling, u, v, w, p, q, r, ax, ay, az
    )
    x, y, z = fraction * x + xa, -(fraction * y + ya), -(fraction * z + za)
    l, m, n = fraction * l + la, -(fraction * m + ma), -(fraction * n + na)

    # buoyancy, and the parts: their wrenches in FRD become hull axes here
    total_volume = displaced_volume(
        head.neutral_volume,
        volume,
        head.reference_density,
        head.gravity,
        head.compressibility,
        depth,
    )
    lift = density * total_volume * head.gravity
    for k in range(count if head.acting != 0.0 else 0):
        part = part_at(start, head, k)
        place = part.place
        if part.gives_wrench != 0.0:
            # NED down in body axes is (-R20, R21, R22) of the hull's forward-port-up matrix
            there = depth - rotation[6] * place[0] + rotation[7] * place[1] + rotation[8] * place[2]
            px, py, pz, pl, pm, pn = part_wrench(
                int(part.kind),
                part.values,
                place,
                act[k] + part.zero,
                u,
                v,
                w,
                p,
                q,
                r,
                density,
                there,
            )
            x, y, z, l, m, n = x + px, y - py, z - pz, l + pl, m - pm, n - pn
        if part.gives_volume != 0.0 and (place[0] != 0.0 or place[1] != 0.0 or place[2] != 0.0):
            # buoyancy of its own volume acts where it is: moment place x up, FRD to hull axes
            own = part_volume(int(part.kind), part.values, act[k] + part.zero)
            squeezed = total_volume / (head.neutral_volume + 1e-6 * volume)
            up = fraction * density * 1e-6 * own * squeezed * head.gravity
            ux, uy, uz = up * rotation[6], -up * rotation[7], -up * rotation[8]
            l += place[1] * uz - place[2] * uy
            m -= place[2] * ux - place[0] * uz
            n -= place[0] * uy - place[1] * ux
        if part.gives_mass != 0.0:
            extra = part_mass(int(part.kind), part.values, act[k] + part.zero)
            px, py, pz, pl, pm, pn = point_mass_wrench(
                extra, place, p, q, r, rotation, head.gravity
            )
            x, y, z, l, m, n = x + px, y - py, z - pz, l + pl, m - pm, n - pn

    # hull axes to world, moment moved from the CB to the centre of mass
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

    follow_floor(head, start, table, data, position, state)
    state.current[0], state.current[1], state.current[2] = cn, ce, cd
    state.current_rate[0], state.current_rate[1], state.current_rate[2] = rn, re, rd
    state.density = density
    state.immersion = fraction
    state.net_mass = head.rigid_mass + carried - density * total_volume


@jit
def actuate(model, data, index):
    """d(act)/dt of part `index`; 0 for models that are not ours."""
    table = layout_table()
    address = part_address(table, model, index)
    if address == 0:
        return 0.0
    position = load_f8(field(table, data, at.D_ACT) + 8 * index)
    command = load_f8(field(table, data, at.D_CTRL) + 8 * index)
    return part_rate(part_here(address), position, command)


@jit
def control(model, data):
    """Guidance and log; both advance on time, so repeated calls at one state change nothing."""
    table = layout_table()
    address = header_address(table, model)
    if address == 0:
        return
    head = header_at(address)
    state = state_of(table, data)
    if state.failed != 0.0:
        return
    time = load_f8(data + load_i8(table + 8 * at.D_TIME))
    note_contact(table, data, state)
    if head.control != CONTROL_NONE:
        run_control(head, block_start(address, head), table, data, time, state)
    if head.log_period > 0.0:
        run_log(head, table, model, data, time, state)
