"""Mass matrix: the added mass inside MuJoCo's own."""

from __future__ import annotations

from twin.compiled import inline, jit


@jit
def add_added_mass(added_mass, scale, mass, rotation):
    """Add scale J^T M_A J to the free joint's block of the lower-triangular mass matrix.

    The free joint's linear velocities are in the world frame, its angular ones in hull axes, so
    J = diag(R^T, 1) with R hull to world. `rotation` is R, row major; M_A turns from FRD to
    hull axes by the signs of its rows and columns.
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

    It moves with R place in the world, so its Jacobian is (1, -R S(place)): hull axes for the
    rates.
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


@inline
def _times(a, b0, c, r00, r01, r02, r10, r11, r12, r20, r21, r22):
    """The row (a, b0, c) times R^T."""
    return (
        a * r00 + b0 * r01 + c * r02,
        a * r10 + b0 * r11 + c * r12,
        a * r20 + b0 * r21 + c * r22,
    )
