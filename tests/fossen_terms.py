"""Terms of the Fossen model with arrays in and out, for tests."""

import numpy as np

from twin.fossen import terms
from twin.fossen.terms import STRIPS


def restoring(p, down, depth, mass, moment, displaced):
    """(g(eta) (6,), immersion) on the left of Fossen's equation."""
    immersion, lever = terms.immersed(depth, down[0], p.hull_length, p.hull_diameter)
    body = (float(mass), tuple(np.asarray(moment, float).tolist()), (0.0,) * 6)
    axis = tuple(np.asarray(down, float).tolist())
    force, torque = terms.restoring(p.gravity, float(displaced), immersion, lever, body, axis)
    return -np.array([*force, *torque]), immersion


def strip_immersion(p, depth, slope, strip):
    """(x [m], immersed fraction) of one strip."""
    x = p.hull_length * ((strip + 0.5) / STRIPS - 0.5)
    below = depth + x * slope + 0.5 * p.hull_diameter
    return x, terms.wet_section(below, p.hull_diameter)


def rotation(q):
    """R_nb (3, 3) of a quaternion of any length."""
    return np.array(terms.rotation(*np.asarray(q, float).tolist())).reshape(3, 3)


def quaternion_rate(q, omega):
    """dq/dt (4,) for body rates."""
    return np.array(terms.quaternion_rate(*np.asarray(q, float).tolist(), numbers(omega)))


def numbers(values):
    """A tuple of floats."""
    return tuple(np.asarray(values, dtype=float).tolist())


def lower(matrix):
    """The numbers of a symmetric matrix's lower triangle, row by row."""
    return numbers(matrix[np.tril_indices(len(matrix))])
