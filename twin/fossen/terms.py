"""Terms of Fossen's equations as functions of scalars, for one vehicle and for many at once.

Vectors are tuples of 3 or 6 numbers. A symmetric matrix is the tuple of its lower triangle, row by
row: 6 numbers for a 3 x 3 (xx, xy, yy, xz, yz, zz), 21 for a 6 x 6. Every function is inlined and
holds no array, so that a loop over vehicles becomes vector code.

Source of the parametrisations: T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion
Control (2011), chapters 2, 3, 6 and 8. Body axes FRD with the origin at the centre of
buoyancy (CB), NED inertial axes, SI units.
"""

from __future__ import annotations

import math

from twin.compiled import Written, elementary, generate
from twin.compiled.elementary import cross, dot, scalar

STRIPS = 9
"""Number of equal-volume strips along the hull that carry the buoyancy at the surface."""


@scalar
def rows_times(m, a):  # type: ignore[no-untyped-def]
    """Product M a of a full 3 x 3, its 9 numbers row by row."""
    return (dot(m[0:3], a), dot(m[3:6], a), dot(m[6:9], a))


@scalar
def columns_times(m, a):  # type: ignore[no-untyped-def]
    """Product M^T a of a full 3 x 3, its 9 numbers row by row."""
    return (
        m[0] * a[0] + m[3] * a[1] + m[6] * a[2],
        m[1] * a[0] + m[4] * a[1] + m[7] * a[2],
        m[2] * a[0] + m[5] * a[1] + m[8] * a[2],
    )


@scalar
def symmetric_times(m, a):  # type: ignore[no-untyped-def]
    """Product M a of a symmetric 3 x 3."""
    return (
        m[0] * a[0] + m[1] * a[1] + m[3] * a[2],
        m[1] * a[0] + m[2] * a[1] + m[4] * a[2],
        m[3] * a[0] + m[4] * a[1] + m[5] * a[2],
    )


@scalar
def rotation(w, x, y, z):  # type: ignore[no-untyped-def]
    """Rotation matrix R_nb, body to NED, 9 numbers row by row, from a quaternion (eq. 2.69).

    The quaternion is normalised here, so that an integrator's stages may leave the unit sphere.
    """
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),
        s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w),
        s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y),
    )  # fmt: skip


@scalar
def quaternion(roll, pitch, heading):  # type: ignore[no-untyped-def]
    """Quaternion body to NED, scalar first, from ZYX Euler angles [rad] (section 2.2.2)."""
    (sr, cr), (sp, cp) = elementary.sincos(0.5 * roll), elementary.sincos(0.5 * pitch)
    sh, ch = elementary.sincos(0.5 * heading)
    return (
        cr * cp * ch + sr * sp * sh,
        sr * cp * ch - cr * sp * sh,
        cr * sp * ch + sr * cp * sh,
        cr * cp * sh - sr * sp * ch,
    )


@scalar
def quaternion_rate(w, x, y, z, omega):  # type: ignore[no-untyped-def]
    """Rate dq/dt = T_q(q) omega for body rates [rad/s] (eq. 2.75)."""
    p, q, r = omega
    return (
        -0.5 * (x * p + y * q + z * r),
        0.5 * (w * p - z * q + y * r),
        0.5 * (z * p + w * q - x * r),
        0.5 * (-y * p + x * q + w * r),
    )


# --- the vehicle's masses -------------------------------------------------------------------------


@scalar
def with_mass(body, mass, place, inertia):  # type: ignore[no-untyped-def]
    """Add a mass to a body (mass [kg], first moment [kg m], inertia about the CB [kg m2]).

    `inertia` is the mass's own about its CG at `place` [m]; -m S(r) S(r) moves it (eq. 3.36).
    """
    total, moment, turned = body
    x, y, z = place
    return (
        total + mass,
        (moment[0] + mass * x, moment[1] + mass * y, moment[2] + mass * z),
        (
            turned[0] + (inertia[0] + mass * (y * y + z * z)),
            turned[1] + (inertia[1] - mass * x * y),
            turned[2] + (inertia[2] + mass * (x * x + z * z)),
            turned[3] + (inertia[3] - mass * x * z),
            turned[4] + (inertia[4] - mass * y * z),
            turned[5] + (inertia[5] + mass * (x * x + y * y)),
        ),
    )


@scalar
def hung_mass(ahead, below, shift, roll, inertia):  # type: ignore[no-untyped-def]
    """Return (place [m], inertia) of a mass `below` the axis, turned about it by `roll` [rad].

    A positive roll moves the mass to port: R_x(roll) turns its place and its inertia.
    """
    s, c = elementary.sincos(roll)
    xx, xy, yy, xz, yz, zz = inertia
    place = (ahead + shift, -below * s, below * c)
    turned = (
        xx,
        c * xy - s * xz,
        c * c * yy - 2.0 * s * c * yz + s * s * zz,
        s * xy + c * xz,
        s * c * (yy - zz) + (c * c - s * s) * yz,
        s * s * yy + 2.0 * s * c * yz + c * c * zz,
    )
    return place, turned


@scalar
def mass_matrix(body, added, scale):  # type: ignore[no-untyped-def]
    """Mass matrix M_RB + scale M_A, the 21 numbers of its lower triangle (eq. 3.44)."""
    m, (gx, gy, gz), i = body
    a = added
    return (
        m + scale * a[0],
        scale * a[1], m + scale * a[2],
        scale * a[3], scale * a[4], m + scale * a[5],
        scale * a[6], scale * a[7] - gz, scale * a[8] + gy, i[0] + scale * a[9],
        scale * a[10] + gz, scale * a[11], scale * a[12] - gx, i[1] + scale * a[13],
        i[2] + scale * a[14],
        scale * a[15] - gy, scale * a[16] + gx, scale * a[17], i[3] + scale * a[18],
        i[4] + scale * a[19], i[5] + scale * a[20],
    )  # fmt: skip


@scalar
def impulse(added, scale, v, w):  # type: ignore[no-untyped-def]
    """Linear and angular impulse of the water, scale M_A (v, w) (Lamb 1932, article 124)."""
    a = added
    return (
        (
            scale * (a[0] * v[0] + a[1] * v[1] + a[3] * v[2]
                     + a[6] * w[0] + a[10] * w[1] + a[15] * w[2]),
            scale * (a[1] * v[0] + a[2] * v[1] + a[4] * v[2]
                     + a[7] * w[0] + a[11] * w[1] + a[16] * w[2]),
            scale * (a[3] * v[0] + a[4] * v[1] + a[5] * v[2]
                     + a[8] * w[0] + a[12] * w[1] + a[17] * w[2]),
        ),
        (
            scale * (a[6] * v[0] + a[7] * v[1] + a[8] * v[2]
                     + a[9] * w[0] + a[13] * w[1] + a[18] * w[2]),
            scale * (a[10] * v[0] + a[11] * v[1] + a[12] * v[2]
                     + a[13] * w[0] + a[14] * w[1] + a[19] * w[2]),
            scale * (a[15] * v[0] + a[16] * v[1] + a[17] * v[2]
                     + a[18] * w[0] + a[19] * w[1] + a[20] * w[2]),
        ),
    )  # fmt: skip


@scalar
def rigid_body_coriolis(body, v, w):  # type: ignore[no-untyped-def]
    """Force and moment -C_RB nu, in the parametrisation without the linear velocity.

    Only this form obeys M_RB dnu + C_RB nu = M_RB dnu_r + C_RB nu_r in an irrotational constant
    current (section 8.2.1).
    """
    mass, moment, inertia = body
    turning = cross(w, v)
    about = cross(w, cross(w, moment))
    arm = cross(moment, turning)
    gyro = cross(w, symmetric_times(inertia, w))
    return (
        (
            -mass * turning[0] - about[0],
            -mass * turning[1] - about[1],
            -mass * turning[2] - about[2],
        ),
        (-arm[0] - gyro[0], -arm[1] - gyro[1], -arm[2] - gyro[2]),
    )


@scalar
def added_mass_coriolis(h, v, w):  # type: ignore[no-untyped-def]
    """Force and moment -C_A nu from the impulse `h` (linear, angular) (eq. 6.43, Munk's moment)."""
    munk, gyro = cross(h[0], v), cross(h[1], w)
    return cross(h[0], w), (munk[0] + gyro[0], munk[1] + gyro[1], munk[2] + gyro[2])


@scalar
def balanced(wrench, body, m_a, scale, coupling, v, w, turned, gradient, path, push):  # type: ignore[no-untyped-def]
    """Right-hand side, 6 numbers, of (M_RB + M_A) dnu_r = ... (`twin.fossen.equations`): `wrench`
    and the inertial terms.

    Args:
      body: see `with_mass`. m_a: added mass, multiplied by `scale`.
      coupling: 1: the coupling by added mass acts; 0: the law already contains it.
      v, w: velocity through the water, body rates; `turned`: rates relative to the water's own.
      gradient: of the current in body axes [1/s], 9 numbers.
      path: rate of the current along the vehicle's path, in body axes [m/s2].
      push: force of the pressure that accelerates the water, in body axes [N].
    """
    h = impulse(m_a, scale, v, turned)
    (rx, ry, rz), (rk, rm, rn) = rigid_body_coriolis(body, v, w)
    (ax, ay, az), (ak, am, an) = added_mass_coriolis(h, v, w)
    strained = columns_times(gradient, h[0])
    lost = cross(body[1], path)
    (x, y, z), (k, m, n) = wrench
    return (
        x + rx + coupling * ax + push[0] - strained[0] - body[0] * path[0],
        y + ry + coupling * ay + push[1] - strained[1] - body[0] * path[1],
        z + rz + coupling * az + push[2] - strained[2] - body[0] * path[2],
        k + rk + coupling * ak - lost[0],
        m + rm + coupling * am - lost[1],
        n + rn + coupling * an - lost[2],
    )


def _solver() -> Written:
    """Write the factorisation M = L D L^T and the two substitutions, for 6 unknowns."""

    def at(i: int, j: int) -> int:
        return i * (i + 1) // 2 + j

    lines = []
    for i in range(6):
        for j in range(i):
            rest = [f"u{i}{k} * l{j}{k}" for k in range(j)]
            lines.append(f"u{i}{j} = {' - '.join([f'm[{at(i, j)}]', *rest])}")
            lines.append(f"l{i}{j} = u{i}{j} * d{j}")
        rest = [f"u{i}{k} * l{i}{k}" for k in range(i)]
        lines.append(f"d{i} = 1.0 / ({' - '.join([f'm[{at(i, i)}]', *rest])})")
        lines.append(f"y{i} = {' - '.join([f'f[{i}]', *(f'l{i}{k} * y{k}' for k in range(i))])}")
    for i in reversed(range(6)):
        rest = [f"l{k}{i} * x{k}" for k in range(i + 1, 6)]
        lines.append(f"x{i} = {' - '.join([f'y{i} * d{i}', *rest])}")
    return "\n".join([*lines, "return x0, x1, x2, x3, x4, x5"]), {}


solved = generate("solved", ("m", "f"), _solver, module=__name__, forceinline=True)
"""(m, f) -> x with M x = f: M symmetric and positive definite, 21 numbers; f and x 6 each."""


# --- the water ------------------------------------------------------------------------------------


@scalar
def wet_section(below, diameter):  # type: ignore[no-untyped-def]
    """Immersed fraction of a circle's area when its lowest point is `below` [m] deep.

    With cos a = 1 - below / radius, the immersed segment has (a - sin a cos a) / pi of the area.
    """
    cosine = min(max(1.0 - 2.0 * below / diameter, -1.0), 1.0)
    sine = math.sqrt((1.0 - cosine) * (1.0 + cosine))
    return (elementary.acos(cosine) - sine * cosine) / math.pi


@scalar
def immersed(depth, slope, length, diameter):  # type: ignore[no-untyped-def]
    """Means over the strips: wet fraction, and wet fraction times place ahead of the CB [m].

    `slope` is the depth gained per metre forward.
    """
    whole, lever = 0.0, 0.0
    if depth - 0.5 * length >= 0.5 * diameter:
        return 1.0, 0.0
    for strip in range(STRIPS):
        x = length * ((strip + 0.5) / STRIPS - 0.5)
        part = wet_section(depth + x * slope + 0.5 * diameter, diameter)
        whole += part
        lever += part * x
    return whole / STRIPS, lever / STRIPS


@scalar
def restoring(gravity, displaced, immersion, lever, body, down):  # type: ignore[no-untyped-def]
    """Force and moment -g(eta) of weight at the masses and buoyancy on the strips (section 4.1).

    `displaced` [kg] is the mass of water that the fully immersed hull displaces, `down` the NED
    down axis in body axes.
    """
    mass, moment, _ = body
    net = gravity * (mass - displaced * immersion)
    weight = cross(moment, down)
    arm = displaced * gravity * lever
    return (
        (net * down[0], net * down[1], net * down[2]),
        (
            gravity * weight[0],
            gravity * weight[1] + arm * down[2],
            gravity * weight[2] - arm * down[1],
        ),
    )


@scalar
def buoyant_moment(gravity, displaced, place, down):  # type: ignore[no-untyped-def]
    """Moment place x (-down) of the buoyancy of `displaced` [kg] of water at `place` [m]."""
    arm, weight = cross(place, down), -gravity * displaced
    return (weight * arm[0], weight * arm[1], weight * arm[2])


@scalar
def strain(compressibility, pressure, expansion, warmer):  # type: ignore[no-untyped-def]
    """Relative volume of the hull, 1 + strain: pressure [Pa] and `warmer` [K] change it."""
    return 1.0 - compressibility * pressure + expansion * warmer


@scalar
def sum3(a, b):  # type: ignore[no-untyped-def]
    """Sum a + b of two vectors of 3."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@scalar
def added(a, b):  # type: ignore[no-untyped-def]
    """Sum of two wrenches, each force and moment."""
    return sum3(a[0], b[0]), sum3(a[1], b[1])
