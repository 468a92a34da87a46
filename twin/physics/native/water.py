"""The water's forces on a glider, as native functions of the water-relative motion.

Axes are FRD about the centre of buoyancy; `block` is the parameter block. Sources: force and
moment law, Zhang et al. (2013); added mass in a moving fluid, Kirchhoff's equations as in
Fossen (2021), sections 8.1-8.3; ellipsoid law, the fluid chapter of MuJoCo's documentation.
The behaviour outside the identified range is ours and described in docs/physics.md.
"""

from __future__ import annotations

import math

import numba

from twin.physics.native import block as b

jit = numba.njit(error_model="numpy", inline="always")
jit_call = numba.njit(error_model="numpy")


@jit
def smoothstep(x):
    """0 below 0, 1 above 1, cubic between."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@jit
def blend_weight(angle, linear, full):
    """0 inside the identified range, 1 where the cross-flow law holds."""
    return smoothstep((abs(angle) - linear) / (full - linear))


@jit_call
def coefficient_wrench(block, u, v, w, p, q, r):
    """Force [N] and moment [N m] of the identified law at v_rel (u, v, w), rates (p, q, r)."""
    speed2 = u * u + v * v + w * w
    speed = math.sqrt(speed2)
    alpha, beta = 0.0, 0.0
    ca, sa, cb, sb = 1.0, 0.0, 1.0, 0.0
    if speed > 1e-9:
        alpha = math.atan2(w, u)
        in_plane = math.sqrt(u * u + w * w)
        if in_plane > 1e-12:
            ca, sa = u / in_plane, w / in_plane
        sb, cb = v / speed, in_plane / speed
        beta = math.asin(min(max(sb, -1.0), 1.0))
    linear, full = block[b.P_LINEAR_ANGLE], block[b.P_BLEND_ANGLE]
    wa, wb = 0.0, 0.0
    if abs(alpha) > linear:
        wa = blend_weight(alpha, linear, full)
    if abs(beta) > linear:
        wb = blend_weight(beta, linear, full)
    odd_a = (1.0 - wa) * alpha + wa * sa * ca
    even_a = (1.0 - wa) * alpha * alpha + wa * sa * sa
    constant_a = (1.0 - wa) + wa * ca
    odd_b = (1.0 - wb) * beta + wb * sb * cb

    drag = (block[b.P_DRAG] + block[b.P_DRAG + 1] * even_a) * speed2
    side = block[b.P_SIDE] * odd_b * speed2
    lift = (block[b.P_LIFT] * constant_a + block[b.P_LIFT + 1] * odd_a) * speed2
    t1 = block[b.P_ROLL] * odd_b * speed2
    t2 = (block[b.P_PITCH] * constant_a + block[b.P_PITCH + 1] * odd_a) * speed2
    t3 = block[b.P_YAW] * odd_b * speed2
    floor = block[b.P_MIN_SPEED]
    damping2 = max(speed2, floor * floor)
    d1 = block[b.P_ROLL + 1] * p * damping2
    d2 = block[b.P_PITCH + 2] * q * damping2
    d3 = block[b.P_YAW + 1] * r * damping2

    # rate moments turn from flow axes (as identified) to body axes, where they always damp
    s = max(wa, wb)
    k = 1.0 - s
    x = -ca * cb * drag - ca * sb * side + sa * lift
    y = -sb * drag + cb * side
    z = -sa * cb * drag - sa * sb * side - ca * lift
    e1, e2, e3 = t1 + k * d1, t2 + k * d2, t3 + k * d3
    l = ca * cb * e1 - ca * sb * e2 - sa * e3 + s * d1
    m = sb * e1 + cb * e2 + s * d2
    n = sa * cb * e1 - sa * sb * e2 + ca * e3 + s * d3
    return x, y, z, l, m, n


@jit
def added_momentum(block, row, u, v, w, p, q, r):
    """Component `row` of M_A (v_rel, omega)."""
    i = b.P_ADDED_MASS + 6 * row
    return (
        block[i] * u
        + block[i + 1] * v
        + block[i + 2] * w
        + block[i + 3] * p
        + block[i + 4] * q
        + block[i + 5] * r
    )


@jit_call
def added_mass_wrench(block, u, v, w, p, q, r, cx, cy, cz):
    """What remains of the added-mass force once M_A d(twist)/dt is in the mass matrix.

    With h = M_A (v_rel, omega): the force is M_A (omega x v_rel + R^T dV_c/dt, 0) - (omega x h_1,
    omega x h_2 + v_rel x h_1). (cx, cy, cz) is R^T dV_c/dt, the rate of the current along the
    path in body axes [m/s2].
    """
    ax = q * w - r * v + cx
    ay = r * u - p * w + cy
    az = p * v - q * u + cz
    h1 = added_momentum(block, 0, u, v, w, p, q, r)
    h2 = added_momentum(block, 1, u, v, w, p, q, r)
    h3 = added_momentum(block, 2, u, v, w, p, q, r)
    h4 = added_momentum(block, 3, u, v, w, p, q, r)
    h5 = added_momentum(block, 4, u, v, w, p, q, r)
    h6 = added_momentum(block, 5, u, v, w, p, q, r)
    x = added_momentum(block, 0, ax, ay, az, 0.0, 0.0, 0.0) - (q * h3 - r * h2)
    y = added_momentum(block, 1, ax, ay, az, 0.0, 0.0, 0.0) - (r * h1 - p * h3)
    z = added_momentum(block, 2, ax, ay, az, 0.0, 0.0, 0.0) - (p * h2 - q * h1)
    l = added_momentum(block, 3, ax, ay, az, 0.0, 0.0, 0.0) - (q * h6 - r * h5) - (v * h3 - w * h2)
    m = added_momentum(block, 4, ax, ay, az, 0.0, 0.0, 0.0) - (r * h4 - p * h6) - (w * h1 - u * h3)
    n = added_momentum(block, 5, ax, ay, az, 0.0, 0.0, 0.0) - (p * h5 - q * h4) - (u * h2 - v * h1)
    return x, y, z, l, m, n


@jit
def _largest_moment(along, side1, side2):
    """Moment integral of a disc of the larger side radius swept along an axis (MuJoCo's bound)."""
    widest = max(side1, side2)
    return 8.0 / 15.0 * math.pi * along * widest**4


@jit_call
def ellipsoid_wrench(geoms, count, density, viscosity, u, v, w, p, q, r):
    """Viscous and circulatory force [N] and moment [N m] of MuJoCo's ellipsoid law.

    `geoms` holds `count` rows of FLUID_ROW values in HULL axes (x forward, y port, z up), and so
    are the arguments and the result. Added mass is not here: it is in the mass matrix.
    """
    fx, fy, fz, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        g = geoms[k * b.FLUID_ROW : (k + 1) * b.FLUID_ROW]
        x, y, z = g[0], g[1], g[2]
        # velocity of the geom's centre through the water, then into the geom's axes
        ux, uy, uz = u + q * z - r * y, v + r * x - p * z, w + p * y - q * x
        v0 = g[3] * ux + g[6] * uy + g[9] * uz
        v1 = g[4] * ux + g[7] * uy + g[10] * uz
        v2 = g[5] * ux + g[8] * uy + g[11] * uz
        w0 = g[3] * p + g[6] * q + g[9] * r
        w1 = g[4] * p + g[7] * q + g[10] * r
        w2 = g[5] * p + g[8] * q + g[11] * r
        a0, a1, a2 = g[12], g[13], g[14]
        scale, blunt, slender, angular, kutta, magnus = g[15], g[16], g[17], g[18], g[19], g[20]
        speed = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        # outward normal scaling of the ellipsoid seen along the flow
        n0, n1, n2 = (a1 * a2) ** 2 * v0, (a2 * a0) ** 2 * v1, (a0 * a1) ** 2 * v2
        along = n0 * v0 + n1 * v1 + n2 * v2
        normal2 = n0 * n0 + n1 * n1 + n2 * n2
        projected = math.pi * math.sqrt(normal2 / max(along, 1e-15))
        cosine = along / max(speed * normal2, 1e-15)
        longest, shortest = max(a0, a1, a2), min(a0, a1, a2)
        middle = a0 + a1 + a2 - longest - shortest
        broadside = math.pi * longest * middle
        # Kutta: circulation (n x v), lift along (n x v) x v
        lift = kutta * density * cosine * projected
        c0, c1, c2 = n1 * v2 - n2 * v1, n2 * v0 - n0 * v2, n0 * v1 - n1 * v0
        spin = magnus * density * 4.0 / 3.0 * math.pi * a0 * a1 * a2
        sphere = 2.0 / 3.0 * (a0 + a1 + a2)
        linear = viscosity * 3.0 * math.pi * sphere + density * speed * (
            blunt * projected + slender * (broadside - projected)
        )
        f0 = spin * (w1 * v2 - w2 * v1) + lift * (c1 * v2 - c2 * v1) - linear * v0
        f1 = spin * (w2 * v0 - w0 * v2) + lift * (c2 * v0 - c0 * v2) - linear * v1
        f2 = spin * (w0 * v1 - w1 * v0) + lift * (c0 * v1 - c1 * v0) - linear * v2
        widest = 8.0 / 15.0 * math.pi * middle * longest**4
        i0 = _largest_moment(a0, a1, a2)
        i1 = _largest_moment(a1, a2, a0)
        i2 = _largest_moment(a2, a0, a1)
        h0 = w0 * (angular * i0 + slender * (widest - i0))
        h1 = w1 * (angular * i1 + slender * (widest - i1))
        h2 = w2 * (angular * i2 + slender * (widest - i2))
        rotary = viscosity * math.pi * sphere**3 + density * math.sqrt(h0 * h0 + h1 * h1 + h2 * h2)
        t0, t1, t2 = -rotary * w0, -rotary * w1, -rotary * w2
        # back to hull axes at the CB
        gx = scale * (g[3] * f0 + g[4] * f1 + g[5] * f2)
        gy = scale * (g[6] * f0 + g[7] * f1 + g[8] * f2)
        gz = scale * (g[9] * f0 + g[10] * f1 + g[11] * f2)
        fx += gx
        fy += gy
        fz += gz
        mx += scale * (g[3] * t0 + g[4] * t1 + g[5] * t2) + y * gz - z * gy
        my += scale * (g[6] * t0 + g[7] * t1 + g[8] * t2) + z * gx - x * gz
        mz += scale * (g[9] * t0 + g[10] * t1 + g[11] * t2) + x * gy - y * gx
    return fx, fy, fz, mx, my, mz


STRIPS = 9


@jit
def immersed_fraction(depth, diameter):
    """Immersed fraction of a strip of the hull whose axis is at `depth` [m]."""
    return smoothstep(depth / diameter + 0.5)


@jit_call
def immersion(block, depth, sin_pitch):
    """Mean immersed fraction, and sum of fraction * x / STRIPS [m] (arm of the buoyancy)."""
    length, diameter = block[b.P_LENGTH], block[b.P_DIAMETER]
    if depth > 0.5 * (length * abs(sin_pitch) + diameter):
        return 1.0, 0.0
    mean, arm = 0.0, 0.0
    for i in range(STRIPS):
        x = length * ((i + 0.5) / STRIPS - 0.5)
        fraction = immersed_fraction(depth - x * sin_pitch, diameter)
        mean += fraction / STRIPS
        arm += fraction * x / STRIPS
    return mean, arm


@jit
def displaced_volume(block, pump, depth):
    """Volume [m3] at `pump` [cm3] and `depth` [m]; the hull shrinks linearly with pressure."""
    pressure = block[b.P_REFERENCE_DENSITY] * block[b.P_GRAVITY] * max(depth, 0.0)
    volume = block[b.P_NEUTRAL_VOLUME] + 1e-6 * pump
    return volume * (1.0 - block[b.P_COMPRESSIBILITY] * pressure)


@jit
def actuator_rate(block, index, position, command):
    """Rate of actuator `index`: first-order lag, rate limited, stopped at the ends."""
    low, high = block[b.P_ACTUATOR_MIN + index], block[b.P_ACTUATOR_MAX + index]
    target = min(max(command, low), high)
    rate = (target - position) / block[b.P_LAG + index]
    limit = block[b.P_RATE + index]
    return min(max(rate, -limit), limit)
