"""Mass matrix: the added mass inside MuJoCo's own."""

from __future__ import annotations

from twin.physics.native import block as b
from twin.physics.native.access import inline, jit


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
