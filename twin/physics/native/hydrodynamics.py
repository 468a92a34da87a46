"""Hydrodynamics: added mass, buoyancy and immersion, which belong to no hull law and no part.

Axes are FRD about the centre of buoyancy. Added mass in a moving fluid follows Kirchhoff's
equations in Fossen (2021), sections 8.1-8.3; for a current with a gradient, Thomasson and Woolsey
(2013), Vehicle motion in currents, IEEE J. Oceanic Eng. 38.

The functions `add_...` add terms to MuJoCo's own mass matrix.
"""

from __future__ import annotations

import math

from twin.compiled import inline, jit

STRIPS = 9
"""Number of strips of equal volume along the hull that carry the buoyancy at the surface."""


@inline
def added_momentum(m, u, v, w, p, q, r):
    """Momentum M_A (v_rel, omega) of the added mass, six numbers; `m` is M_A."""
    return (
        m[0, 0] * u + m[0, 1] * v + m[0, 2] * w + m[0, 3] * p + m[0, 4] * q + m[0, 5] * r,
        m[1, 0] * u + m[1, 1] * v + m[1, 2] * w + m[1, 3] * p + m[1, 4] * q + m[1, 5] * r,
        m[2, 0] * u + m[2, 1] * v + m[2, 2] * w + m[2, 3] * p + m[2, 4] * q + m[2, 5] * r,
        m[3, 0] * u + m[3, 1] * v + m[3, 2] * w + m[3, 3] * p + m[3, 4] * q + m[3, 5] * r,
        m[4, 0] * u + m[4, 1] * v + m[4, 2] * w + m[4, 3] * p + m[4, 4] * q + m[4, 5] * r,
        m[5, 0] * u + m[5, 1] * v + m[5, 2] * w + m[5, 3] * p + m[5, 4] * q + m[5, 5] * r,
    )


@jit
def added_mass_wrench(added_mass, coupling, motion, p, q, r, rate, gradient):
    """Remaining added-mass force, M_A d(twist)/dt being in the mass matrix already.

    With h = M_A (v_rel, omega_rel): the force is M_A (omega x v_rel + R^T dV_c/dt, 0) -
    (omega x h_1 + G^T h_1, omega x h_2 + v_rel x h_1). `motion` is (v_rel, omega_rel), relative to
    water that turns with the gradient; (p, q, r) is omega. In body axes, `rate` (3) is R^T dV_c/dt,
    the rate of the current along the path [m/s2], and `gradient` (9) is G = R^T (grad V_c) R [1/s],
    row by row. Without `coupling` the coefficients of the hull law contain the second bracket, all
    but G^T h_1, which belongs to the current.
    """
    u, v, w, pr, qr, rr = motion
    ax = q * w - r * v + rate[0]
    ay = r * u - p * w + rate[1]
    az = p * v - q * u + rate[2]
    h1, h2, h3, h4, h5, h6 = added_momentum(added_mass, u, v, w, pr, qr, rr)
    strained = (
        gradient[0] * h1 + gradient[3] * h2 + gradient[6] * h3,
        gradient[1] * h1 + gradient[4] * h2 + gradient[7] * h3,
        gradient[2] * h1 + gradient[5] * h2 + gradient[8] * h3,
    )
    if coupling == 0.0:
        h1, h2, h3, h4, h5, h6 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y, z, l, m, n = added_momentum(added_mass, ax, ay, az, 0.0, 0.0, 0.0)
    return (
        x - (q * h3 - r * h2) - strained[0],
        y - (r * h1 - p * h3) - strained[1],
        z - (p * h2 - q * h1) - strained[2],
        l - (q * h6 - r * h5) - (v * h3 - w * h2),
        m - (r * h4 - p * h6) - (w * h1 - u * h3),
        n - (p * h5 - q * h4) - (u * h2 - v * h1),
    )


@inline
def point_mass_wrench(mass, place, p, q, r, rotation, gravity):
    """Weight and centrifugal force of a point mass [kg] carried at `place`, about the CB, FRD.

    The mass matrix contains the inertia (`add_point_mass`). `rotation` is hull to world, row
    major; NED down in body axes is (-R20, R21, R22).
    """
    # omega x (omega x place)
    wx, wy, wz = (
        q * place[2] - r * place[1],
        r * place[0] - p * place[2],
        p * place[1] - q * place[0],
    )
    cx, cy, cz = q * wz - r * wy, r * wx - p * wz, p * wy - q * wx
    x = mass * (-gravity * rotation[6] - cx)
    y = mass * (gravity * rotation[7] - cy)
    z = mass * (gravity * rotation[8] - cz)
    l = place[1] * z - place[2] * y
    m = place[2] * x - place[0] * z
    n = place[0] * y - place[1] * x
    return x, y, z, l, m, n


@inline
def immersed_fraction(depth, diameter):
    """Immersed fraction of the circular section of a strip whose axis is at `depth` [m]."""
    x = min(max(2.0 * depth / diameter, -1.0), 1.0)
    return 0.5 + (x * math.sqrt(1.0 - x * x) + math.asin(x)) / math.pi


@jit
def immersion(length, diameter, depth, sin_pitch):
    """Mean immersed fraction, and lever arm of the buoyancy [m]: sum of fraction * x / STRIPS."""
    if depth > 0.5 * (length * abs(sin_pitch) + diameter):
        return 1.0, 0.0
    mean, arm = 0.0, 0.0
    for i in range(STRIPS):
        x = length * ((i + 0.5) / STRIPS - 0.5)
        fraction = immersed_fraction(depth - x * sin_pitch, diameter)
        mean += fraction / STRIPS
        arm += fraction * x / STRIPS
    return mean, arm


@inline
def displaced_volume(head, pumped, depth, warming):
    """Volume [m3] of a hull with `pumped` [cm3] at `depth` [m], `warming` [K] above reference.

    The volume shrinks linearly with pressure and grows linearly with temperature.
    """
    pressure = head.reference_density * head.gravity * max(depth, 0.0)
    volume = head.neutral_volume + 1e-6 * pumped
    return volume * (1.0 - head.compressibility * pressure + head.thermal_expansion * warming)


@inline
def hull_warming(head, state, time, water):
    """Temperature [K] of the hull above its reference; it follows the `water` [degC] with a lag.

    Exact if the water's temperature is constant since the last call. A repeated call at one time
    changes nothing; a call for an earlier time starts again.
    """
    if state.hull_known == 0.0 or time < state.hull_time:
        state.hull_temperature, state.hull_known = water, 1.0
    else:
        passed = time - state.hull_time
        state.hull_temperature += (water - state.hull_temperature) * -math.expm1(
            -passed / head.thermal_lag
        )
    state.hull_time = time
    return state.hull_temperature - head.reference_temperature


@inline
def part_rate(part, position, command):
    """Rate of a part: first-order lag, limited rate, travel ending at its stops."""
    target = min(max(command, part.low), part.high)
    if part.one_way != 0.0:
        target = min(target, position)
    rate = (target - position) / part.lag
    return min(max(rate, -part.rate), part.rate)


@jit
def add_added_mass(added_mass, scale, mass, rotation):
    """Add scale J^T M_A J to the free joint's block of the lower-triangular mass matrix.

    Linear velocities of the free joint are in world axes and angular ones in hull axes, so
    J = diag(R^T, 1) with R hull to world. `rotation` is R, row major. The signs of rows and
    columns turn M_A from FRD to hull axes.
    """
    r00, r01, r02 = rotation[0], rotation[1], rotation[2]
    r10, r11, r12 = rotation[3], rotation[4], rotation[5]
    r20, r21, r22 = rotation[6], rotation[7], rotation[8]
    # A R^T with A in hull axes: x keeps its sign, y and z flip together
    a00, a01, a02 = scale * added_mass[0, 0], -scale * added_mass[0, 1], -scale * added_mass[0, 2]
    a11, a12, a22 = scale * added_mass[1, 1], scale * added_mass[1, 2], scale * added_mass[2, 2]
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
        k = 3 + i
        sign = scale if i == 0 else -scale
        c0, c1, c2 = sign * added_mass[k, 0], -sign * added_mass[k, 1], -sign * added_mass[k, 2]
        x, y, z = _times(c0, c1, c2, r00, r01, r02, r10, r11, r12, r20, r21, r22)
        start = (3 + i) * (4 + i) // 2
        mass[start] += x
        mass[start + 1] += y
        mass[start + 2] += z
        mass[start + 3] += sign * added_mass[k, 3]
        if i > 0:
            mass[start + 4] -= sign * added_mass[k, 4]
        if i > 1:
            mass[start + 5] -= sign * added_mass[k, 5]


@jit
def add_point_mass(extra, place, mass, rotation):
    """Add a point mass [kg], fixed to the hull at `place` (FRD), to the free joint's block.

    Its velocity has the Jacobian (1, -R S(place)): linear in world axes, rates in hull axes.
    """
    x, y, z = place[0], -place[1], -place[2]
    mass[0] += extra
    mass[2] += extra
    mass[5] += extra
    # rotational rows against translational columns: m S(place) R^T, row by row
    for i in range(3):
        s0, s1, s2 = 0.0, 0.0, 0.0
        if i == 0:
            s1, s2 = -z, y
        elif i == 1:
            s0, s2 = z, -x
        else:
            s0, s1 = -y, x
        begin = (3 + i) * (4 + i) // 2
        for j in range(3):
            turned = s0 * rotation[3 * j] + s1 * rotation[3 * j + 1] + s2 * rotation[3 * j + 2]
            mass[begin + j] += extra * turned
    mass[9] += extra * (y * y + z * z)
    mass[13] -= extra * x * y
    mass[14] += extra * (x * x + z * z)
    mass[18] -= extra * x * z
    mass[19] -= extra * y * z
    mass[20] += extra * (x * x + y * y)


@jit
def add_rotary_damping(damping, period, mass):
    """Add `period` [s] times a symmetric rotary damping to the free joint's rotary block.

    damping: pp, pq, qq, pr, qr, rr [N m s] in body axes FRD.
    """
    pp, pq, qq, pr, qr, rr = damping
    mass[9] += period * pp
    mass[13] -= period * pq
    mass[14] += period * qq
    mass[18] -= period * pr
    mass[19] += period * qr
    mass[20] += period * rr


@inline
def times(symmetric, vector):
    """Product of a symmetric matrix, ordered as pp, pq, qq, pr, qr, rr, and a vector of three."""
    pp, pq, qq, pr, qr, rr = symmetric
    p, q, r = vector
    return pp * p + pq * q + pr * r, pq * p + qq * q + qr * r, pr * p + qr * q + rr * r


@inline
def _times(a, b0, c, r00, r01, r02, r10, r11, r12, r20, r21, r22):
    """Product of the row (a, b0, c) and R^T."""
    return (
        a * r00 + b0 * r01 + c * r02,
        a * r10 + b0 * r11 + c * r12,
        a * r20 + b0 * r21 + c * r22,
    )
