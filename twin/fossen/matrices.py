"""Fossen's matrices: mass, Coriolis and centripetal, and the kinematics of the attitude.

Source of the parametrisations: T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion
Control (2011), chapters 2, 3, 6 and 8. Body axes FRD with the origin at the centre of
buoyancy (CB), NED inertial axes, SI units. Every function is compiled.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import jit
from twin.numbers import Array


@jit
def skew(a: Array) -> Array:
    """S(a), shape (3, 3), with S(a) b = a x b (Fossen 2011, definition 2.2)."""
    s = np.zeros((3, 3))
    s[0, 1] = -a[2]
    s[0, 2] = a[1]
    s[1, 0] = a[2]
    s[1, 2] = -a[0]
    s[2, 0] = -a[1]
    s[2, 1] = a[0]
    return s


@jit
def times(matrix: Array, vector: Array) -> Array:
    """Matrix times vector as plain loops: for 3 to 6 rows faster than a BLAS call."""
    rows, columns = matrix.shape
    product = np.zeros(rows)
    for i in range(rows):
        for j in range(columns):
            product[i] += matrix[i, j] * vector[j]
    return product


@jit
def transposed_times(matrix: Array, vector: Array) -> Array:
    """Transposed matrix times vector."""
    rows, columns = matrix.shape
    product = np.zeros(columns)
    for i in range(rows):
        for j in range(columns):
            product[j] += matrix[i, j] * vector[i]
    return product


@jit
def rotation_from_quaternion(q: Array) -> Array:
    """R_nb, body to NED, shape (3, 3), of a scalar-first quaternion (Fossen 2011, eq. 2.69).

    The quaternion is normalised here, so that an integrator's stages may leave the unit sphere.
    """
    norm = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    w, x, y, z = q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm
    r = np.empty((3, 3))
    r[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    r[0, 1] = 2.0 * (x * y - z * w)
    r[0, 2] = 2.0 * (x * z + y * w)
    r[1, 0] = 2.0 * (x * y + z * w)
    r[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    r[1, 2] = 2.0 * (y * z - x * w)
    r[2, 0] = 2.0 * (x * z - y * w)
    r[2, 1] = 2.0 * (y * z + x * w)
    r[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return r


@jit
def quaternion_rate(q: Array, omega: Array) -> Array:
    """dq/dt = T_q(q) omega for body rates omega [rad/s] (Fossen 2011, eq. 2.75)."""
    rate = np.empty(4)
    rate[0] = -0.5 * (q[1] * omega[0] + q[2] * omega[1] + q[3] * omega[2])
    rate[1] = 0.5 * (q[0] * omega[0] - q[3] * omega[1] + q[2] * omega[2])
    rate[2] = 0.5 * (q[3] * omega[0] + q[0] * omega[1] - q[1] * omega[2])
    rate[3] = 0.5 * (-q[2] * omega[0] + q[1] * omega[1] + q[0] * omega[2])
    return rate


@jit
def point_mass_inertia(mass: float, r: Array) -> Array:
    """Parallel-axis term -m S(r) S(r), shape (3, 3) [kg m2] (Fossen 2011, eq. 3.36)."""
    inertia = np.empty((3, 3))
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    for i in range(3):
        for j in range(3):
            inertia[i, j] = -mass * r[i] * r[j]
        inertia[i, i] += mass * r2
    return inertia


@jit
def rolled_inertia(inertia: Array, angle: float) -> Array:
    """R_x(angle) I R_x(angle)^T: a block that turned by `angle` [rad] about the body x axis."""
    turn = np.zeros((3, 3))
    c, s = np.cos(angle), np.sin(angle)
    turn[0, 0] = 1.0
    turn[1, 1] = c
    turn[1, 2] = -s
    turn[2, 1] = s
    turn[2, 2] = c
    rolled = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for m in range(3):
                    rolled[i, j] += turn[i, k] * inertia[k, m] * turn[j, m]
    return rolled


@jit
def rigid_body_mass(mass: float, cg: Array, inertia: Array) -> Array:
    """M_RB, shape (6, 6), of a body with CG at `cg` [m] (Fossen 2011, eq. 3.44).

    `inertia` [kg m2], shape (3, 3), is I_b about the CB, not about the CG.
    """
    m_rb = np.zeros((6, 6))
    s = skew(cg)
    for i in range(3):
        m_rb[i, i] = mass
        for j in range(3):
            m_rb[i, j + 3] = -mass * s[i, j]
            m_rb[i + 3, j] = mass * s[i, j]
            m_rb[i + 3, j + 3] = inertia[i, j]
    return m_rb


@jit
def rigid_body_coriolis(mass: float, cg: Array, inertia: Array, omega: Array) -> Array:
    """C_RB, shape (6, 6), in the parametrisation without the linear velocity.

    Fossen 2011, section 8.2.1: only this form obeys M_RB dnu + C_RB nu =
    M_RB dnu_r + C_RB nu_r in an irrotational constant current. Arguments as in
    `rigid_body_mass`, omega [rad/s].
    """
    c_rb = np.zeros((6, 6))
    s_w = skew(omega)
    s_g = skew(cg)
    s_h = skew(times(inertia, omega))
    for i in range(3):
        for j in range(3):
            c_rb[i, j] = mass * s_w[i, j]
            c_rb[i + 3, j + 3] = -s_h[i, j]
            for k in range(3):
                c_rb[i, j + 3] -= mass * s_w[i, k] * s_g[k, j]
                c_rb[i + 3, j] += mass * s_g[i, k] * s_w[k, j]
    return c_rb


@jit
def added_mass_coriolis(m_a: Array, nu_r: Array) -> Array:
    """C_A(nu_r), shape (6, 6), of the added mass `m_a` (Fossen 2011, eq. 6.43).

    Its product with nu_r holds the Munk moment.
    """
    momentum = times(m_a, nu_r)
    s_p = skew(momentum[:3])
    s_h = skew(momentum[3:])
    c_a = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            c_a[i, j + 3] = -s_p[i, j]
            c_a[i + 3, j] = -s_p[i, j]
            c_a[i + 3, j + 3] = -s_h[i, j]
    return c_a


@jit
def solve_positive_definite(matrix: Array, right: Array) -> Array:
    """x of M x = b by Cholesky's factorisation; NaN when M is not positive definite.

    Written out because it compiles ten times faster than a call of LAPACK's general solver.
    """
    n = right.size
    lower = np.zeros((n, n))
    x = np.empty(n)
    for i in range(n):
        x[i] = right[i]
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            if i == j:
                lower[i, i] = np.sqrt(rest)
            else:
                lower[i, j] = rest / lower[j, j]
    for i in range(n):
        for k in range(i):
            x[i] -= lower[i, k] * x[k]
        x[i] /= lower[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= lower[k, i] * x[k]
        x[i] /= lower[i, i]
    return x
