"""Plant: native callbacks for water, parts, guidance and logging inside MuJoCo's own step.

`mjcb_passive` adds the added mass M_A to the mass matrix and the water's forces to a user's in the
hull's row of `xfrc_applied`. `mjcb_act_dyn` moves the parts; `mjcb_control` runs guidance and the
log. All three return at once for a model without our parameter block, so other models in the
process are untouched. They are C functions without the GIL: `mj_step`, `mujoco.batch` and
dm_control run the same code.
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
    load_f8,
    load_i4,
    load_i8,
    part_address,
    part_at,
    part_here,
    state_of,
    table_of,
)
from twin.physics.native.effects import (
    law_rate_damping,
    law_rotary_damping,
    law_wrench,
    part_mass,
    part_volume,
    part_wrench,
    run_control,
    run_log,
)
from twin.physics.native.hydrodynamics import (
    add_added_mass,
    add_point_mass,
    add_rotary_damping,
    added_mass_wrench,
    displaced_volume,
    hull_warming,
    immersion,
    part_rate,
    point_mass_wrench,
    times,
)
from twin.physics.native.late import flow_at, follow_floor
from twin.water.density import density_at

CONTROL_NONE = b.CONTROL_NONE
ZERO = (0.0, 0.0, 0.0)
FASTEST = 20.0
"""[m/s] Speed through the water above which a run has failed, even if it slows down later."""
NO_FORCE = 5e-324
"""[N] Written in place of a sum that is 0 in all axes: `last` must not look as if never written."""
UNSTABLE = 2.0
"""[1] Product of step and rotary damping over inertia above which an explicit step is unstable."""
RATE = 1e-4
"""[rad/s] Step of the finite differences that give a law's rotary damping."""
_VOID = types.void(types.int64, types.int64)
mj_make_mass = types.ExternalFunction("mj_makeM", _VOID)
mj_factor_mass = types.ExternalFunction("mj_factorM", _VOID)


@inline
def remember_velocity(state, velocity, time, timestep):
    """Store the velocities of this step and the previous one; after a time jump, of this one."""
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
    """Fraction of the last change of a rate that the next step repeats under rotary damping."""
    return max(0.0, 1.0 + damping / inertia)


@jit
def rotary_damping(law, values, density, u, v, w, p, q, r, l, m, n):
    """Symmetric part of -d(K, M, N)/d(p, q, r) of the hull law, body axes FRD [N m s].

    Returns pp, pq, qq, pr, qr, rr of a matrix without negative eigenvalues. A law without that
    kernel is differenced about its moments (l, m, n); negative damping of a rate counts as 0.
    """
    pp, pq, qq, pr, qr, rr = law_rotary_damping(law, values, density, u, v, w, p, q, r)
    if math.isnan(pp):
        _, _, _, lp, mp, np = law_wrench(law, values, density, u, v, w, p + RATE, q, r)
        _, _, _, lq, mq, nq = law_wrench(law, values, density, u, v, w, p, q + RATE, r)
        _, _, _, lr, mr, nr = law_wrench(law, values, density, u, v, w, p, q, r + RATE)
        pp, qq, rr = (l - lp) / RATE, (m - mq) / RATE, (n - nr) / RATE
        pq = 0.5 * ((l - lq) + (m - mp)) / RATE
        pr = 0.5 * ((l - lr) + (n - np)) / RATE
        qr = 0.5 * ((m - mr) + (n - nq)) / RATE
    pp, qq, rr = max(pp, 0.0), max(qq, 0.0), max(rr, 0.0)
    # test the principal minors with a slack for rounding: a law without roll damping has rank 2
    whole, slack = pp + qq + rr, 1e-9 * (pp + qq + rr)
    if (
        min(pp * qq - pq * pq, pp * rr - pr * pr, qq * rr - qr * qr) < -slack * whole
        or pp * (qq * rr - qr * qr) - pq * (pq * rr - qr * pr) + pr * (pq * qr - qq * pr)
        < -slack * whole * whole
    ):
        pq, pr, qr = 0.0, 0.0, 0.0
    return pp, pq, qq, pr, qr, rr


@inline
def keep_user(user, force, last):
    """Store the user's wrench: numbers of the row `force` that are not those of our `last` sum.

    An assigned force stays until the next assignment, as MuJoCo's own do. `last` is the world's
    row, which MuJoCo never reads: it is copied, restored and cleared along with the hull's.
    """
    written = False
    for i in range(6):
        written = written or last[i] != 0.0
    for i in range(6):
        if not written or force[i] != last[i]:
            user[i] = force[i]


@inline
def fail(state, time):
    """Record the first failure of a run."""
    if state.failed == 0.0:
        state.failed, state.fail_time = 1.0, time


@inline
def along(local, a, n, e, d):
    """`local` plus the derivative along (n, e, d) of a field with the gradient `a` (9), NED."""
    return (
        local[0] + (a[0] * n + a[1] * e + a[2] * d),
        local[1] + (a[3] * n + a[4] * e + a[5] * d),
        local[2] + (a[6] * n + a[7] * e + a[8] * d),
    )


@inline
def to_body(axes, n, e, d):
    """Turn a NED vector into body axes, whose directions are given in NED."""
    x, y, z = axes
    return (
        x[0] * n + x[1] * e + x[2] * d,
        y[0] * n + y[1] * e + y[2] * d,
        z[0] * n + z[1] * e + z[2] * d,
    )


@inline
def to_world(rotation, x, y, z):
    """Turn a vector from hull axes into world axes by the hull's row-major matrix."""
    return (
        rotation[0] * x + rotation[1] * y + rotation[2] * z,
        rotation[3] * x + rotation[4] * y + rotation[5] * z,
        rotation[6] * x + rotation[7] * y + rotation[8] * z,
    )


@jit
def water(model, data):
    """Evaluate all forces of the water once; repeating it at the same state changes nothing."""
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
        mj_make_mass(model, data)  # repeated at the same state: M_A is already inside
    position = array(field(table, data, at.D_XPOS) + 24 * hull, 3)
    velocity = array(field(table, data, at.D_QVEL), 6)
    state = state_of(table, data)
    last = array(field(table, data, at.D_XFRC_APPLIED), 6)
    force = array(field(table, data, at.D_XFRC_APPLIED) + 48 * hull, 6)
    user = state.user
    keep_user(user, force, last)
    time = load_f8(data + load_i8(table + 8 * at.D_TIME))
    timestep = load_f8(model + load_i8(table + 8 * at.M_TIMESTEP))
    depth = -position[2]
    total, spin2 = 0.0, 0.0
    for i in range(6):
        total += velocity[i]
    for i in range(3, 6):
        spin2 += velocity[i] * velocity[i]
    finite = math.isfinite(total + position[0] + position[1] + depth)
    if not finite or spin2 * timestep * timestep > 1.0:
        fail(state, time)
    if not finite:
        mj_factor_mass(model, data)
        for i in range(6):
            force[i] = last[i] = 0.0
        return

    # displaced and carried masses; M_A is scaled by the immersed fraction of the hull
    density = head.reference_density
    if head.density["size"] > 0.0:
        density = density_at(table_of(start, head, head.density), depth)
    sin_pitch = rotation[6]  # world z of the hull's forward axis
    fraction, arm = immersion(head.length, head.diameter, depth, sin_pitch)
    water_scale = fraction * density / head.reference_density
    law_scale = water_scale if head.law_scaled != 0.0 else fraction
    add_added_mass(head.added_mass, water_scale, mass, rotation)
    carried, volume = 0.0, 0.0
    for k in range(count):
        part = part_at(start, head, k)
        if part.gives_volume != 0.0:
            volume += part_volume(int(part.kind), part.values, act[k] + part.zero)
        if part.gives_mass != 0.0:
            extra = part_mass(int(part.kind), part.values, act[k] + part.zero)
            carried += extra
            add_point_mass(extra, part.place, mass, rotation)

    v0, v1, v2 = velocity[0], velocity[1], velocity[2]
    centred = head.centred == 1.0
    if centred:
        remember_velocity(state, velocity, time, timestep)
        v0 += 0.5 * (v0 - state.earlier[0])
        v1 += 0.5 * (v1 - state.earlier[1])
        v2 += 0.5 * (v2 - state.earlier[2])

    # body axes FRD in NED: forward, starboard, down of the hull's forward-port-up matrix
    ahead = (rotation[0], -rotation[3], -rotation[6])
    side = (-rotation[1], rotation[4], rotation[7])
    below = (-rotation[2], rotation[5], rotation[8])
    axes = (ahead, side, below)
    p, q, r = velocity[3], -velocity[4], -velocity[5]
    cn, ce, cd = 0.0, 0.0, 0.0
    rate, fluid = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    gradient = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if head.current["size"] > 0.0:
        program = table_of(start, head, head.current)
        flow = flow_at(program, time, position[0], -position[1], depth)
        cn, ce, cd = flow[0], flow[1], flow[2]
        a = flow[6:]
        # rate of the current along the hull's path, and acceleration of the water itself
        rn, re, rd = along(flow[3:6], a, v0, -v1, -v2)
        fluid = along(flow[3:6], a, cn, ce, cd)
        rate = to_body(axes, rn, re, rd)
        # column by column: the change of velocity along each axis of the body
        dx = to_body(axes, *along(ZERO, a, *ahead))
        dy = to_body(axes, *along(ZERO, a, *side))
        dz = to_body(axes, *along(ZERO, a, *below))
        gradient = (dx[0], dy[0], dz[0], dx[1], dy[1], dz[1], dx[2], dy[2], dz[2])
    u, v, w = to_body(axes, v0 - cn, -v1 - ce, -v2 - cd)
    if u * u + v * v + w * w > FASTEST * FASTEST:
        fail(state, time)

    law, values = int(head.law), table_of(start, head, head.law_values)
    p_change, q_change, r_change = 0.0, 0.0, 0.0
    implicit = centred and head.implicit == 1.0
    if centred:
        p_change = 0.5 * (p - state.earlier[3])
        q_change, r_change = 0.5 * (q + state.earlier[4]), 0.5 * (r + state.earlier[5])
        if not implicit:
            dp, dq, dr = law_rate_damping(
                law, values, law_scale * timestep, density, u, v, w, p, q, r
            )
            roll, pitch, yaw = head.rotary_inertia
            implicit = min(dp / roll, dq / pitch, dr / yaw) < -UNSTABLE
            if not implicit:
                p += kept(dp, roll) * p_change
                q += kept(dq, pitch) * q_change
                r += kept(dr, yaw) * r_change
        if implicit:
            p, q, r = p + p_change, q + q_change, r + r_change
    # rates through the water, which turns under the hull with the gradient of the current
    pw, qw, rw = p - gradient[7], q + gradient[6], r - gradient[3]

    x, y, z, l, m, n = law_wrench(law, values, density, u, v, w, pw, qw, rw)
    if implicit:
        # damping by the new rates: subtracted here, added to the mass matrix
        damping = rotary_damping(law, values, density, u, v, w, pw, qw, rw, l, m, n)
        add_rotary_damping(damping, 0.5 * timestep * law_scale, mass)
        a, b, c = times(damping, (p_change, q_change, r_change))
        l, m, n = l + a, m + b, n + c
    mj_factor_mass(model, data)

    xa, ya, za, la, ma, na = added_mass_wrench(
        head.added_mass, head.coupling, (u, v, w, pw, qw, rw), p, q, r, rate, gradient
    )
    x, l = law_scale * x + water_scale * xa, law_scale * l + water_scale * la
    y, z = -(law_scale * y + water_scale * ya), -(law_scale * z + water_scale * za)
    m, n = -(law_scale * m + water_scale * ma), -(law_scale * n + water_scale * na)

    # buoyancy and parts: the wrenches of parts are turned from FRD into hull axes
    warming = 0.0
    if head.temperature["size"] > 0.0:
        seawater = density_at(table_of(start, head, head.temperature), depth)
        warming = hull_warming(head, state, time, seawater)
    total_volume = displaced_volume(head, volume, depth, warming)
    lift = density * total_volume * head.gravity
    for k in range(count if head.acting != 0.0 else 0):
        part = part_at(start, head, k)
        place = part.place
        if part.gives_wrench != 0.0:
            # NED down in body axes is (-R20, R21, R22) of the hull's forward-port-up matrix
            there = depth - rotation[6] * place[0] + rotation[7] * place[1] + rotation[8] * place[2]
            px, py, pz, pl, pm, pn = part_wrench(
                int(part.kind), part.values, place, act[k] + part.zero,
                u, v, w, pw, qw, rw, density, there,
            )  # fmt: skip
            x, y, z, l, m, n = x + px, y - py, z - pz, l + pl, m - pm, n - pn
        if part.gives_volume != 0.0 and (place[0] != 0.0 or place[1] != 0.0 or place[2] != 0.0):
            # buoyancy of the part's volume acts at its place: moment place x up, FRD to hull axes
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
    fx, fy, fz = to_world(rotation, x, y, z)
    fz += fraction * lift
    # Froude-Krylov: the pressure that accelerates the water acts on the volume of the hull
    displaced = fraction * density * total_volume
    fx += displaced * fluid[0]
    fy -= displaced * fluid[1]
    fz -= displaced * fluid[2]
    mx, my, mz = to_world(rotation, l, m, n)
    mx += arm * lift * rotation[3]
    my -= arm * lift * rotation[0]
    centre = array(field(table, data, at.D_XIPOS) + 24 * hull, 3)
    ox, oy, oz = centre[0] - position[0], centre[1] - position[1], centre[2] - position[2]
    force[0], force[1], force[2] = fx + user[0], fy + user[1], fz + user[2]
    force[3] = mx - (oy * fz - oz * fy) + user[3]
    force[4] = my - (oz * fx - ox * fz) + user[4]
    force[5] = mz - (ox * fy - oy * fx) + user[5]
    total, still = 0.0, True
    for i in range(6):
        total, still = total + force[i], still and force[i] == 0.0
    if still:
        force[0] = NO_FORCE
    for i in range(6):
        last[i] = force[i]

    # MuJoCo would ignore a force that is not finite and go on
    if not follow_floor(head, model, data, state) or not math.isfinite(total):
        fail(state, time)
    state.current[0], state.current[1], state.current[2] = cn, ce, cd
    state.density = density
    state.immersion = fraction
    state.net_mass = head.rigid_mass + carried - density * total_volume


@jit
def actuate(model, data, index):
    """Rate d(act)/dt of part `index`; 0 for models that are not ours."""
    table = layout_table()
    address = part_address(table, model, index)
    if address == 0:
        return 0.0
    position = load_f8(field(table, data, at.D_ACT) + 8 * index)
    command = load_f8(field(table, data, at.D_CTRL) + 8 * index)
    part = part_here(address)
    rate = part_rate(part, position, command)
    if part.dof >= 6.0:
        # cancel the servo's damping of the commanded motion. The force is set, not added: no other
        # passive force acts on a driven joint, and this callback may run again at the same state
        width = field(table, model, at.M_NV)
        passive = array(field(table, data, at.D_QFRC_PASSIVE), width)
        passive[min(int(part.dof), width - 1)] = part.servo_damping * rate
    return rate


@jit
def control(model, data):
    """Run guidance and log; both wait for their time, so a repeated call changes nothing."""
    table = layout_table()
    address = header_address(table, model)
    if address == 0:
        return
    head = header_at(address)
    state = state_of(table, data)
    if state.failed != 0.0:
        return
    time = load_f8(data + load_i8(table + 8 * at.D_TIME))
    if load_i4(data + load_i8(table + 8 * at.D_NCON)) > 0:  # stays set until the next log row
        state.contact = 1.0
    if head.control != CONTROL_NONE:
        run_control(head, block_start(address, head), table, data, time, state)
    if head.log_period > 0.0:
        run_log(head, table, model, data, time, state)
