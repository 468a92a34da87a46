"""Grid kernels: the velocity inside a box of a gridded current, compiled."""

from __future__ import annotations

import numpy as np

from twin.compiled import borrowing, jit
from twin.water.current.interpolation import INVALID, locate
from twin.water.current.sampler import record_at

GRID_CODE = 9
"""Of grids in compiled programs."""

HEADER = 6
"""nt, nd, nn, ne, number of velocity components (2 or 3), meridian curvature [1/m]."""


@borrowing
def _along_east(program, at, step, f, rate):  # type: ignore[no-untyped-def]
    """Value and derivative between two neighbours on the east axis."""
    here = program[at]
    slope = program[at + step] - here
    return here + f * slope, rate * slope


@borrowing
def _mix(a, a_rate, b, b_rate, f, rate):  # type: ignore[no-untyped-def]
    """Linear interpolation between two (value, derivative) pairs whose weight f itself moves."""
    return a + f * (b - a), a_rate + f * (b_rate - a_rate) + rate * (b - a)


@borrowing
def _at_one_time(program, at, steps, fractions, rates):  # type: ignore[no-untyped-def]
    """One velocity component from the 8 corners of a cell at one of the file's times."""
    _, s_d, s_n, s_e = steps
    _, f_d, f_n, f_e = fractions
    _, r_d, r_n, r_e = rates
    a, ar = _along_east(program, at, s_e, f_e, r_e)
    b, br = _along_east(program, at + s_n, s_e, f_e, r_e)
    c, cr = _mix(a, ar, b, br, f_n, r_n)
    a, ar = _along_east(program, at + s_d, s_e, f_e, r_e)
    b, br = _along_east(program, at + s_d + s_n, s_e, f_e, r_e)
    a, ar = _mix(a, ar, b, br, f_n, r_n)
    return _mix(c, cr, a, ar, f_d, r_d)


@borrowing
def _component(program, at, steps, fractions, rates):  # type: ignore[no-untyped-def]
    """One velocity component from the 16 corners of the cell whose first corner is `at`."""
    now, now_rate = _at_one_time(program, at, steps, fractions, rates)
    if steps[0] == 0:
        return now, now_rate
    later, later_rate = _at_one_time(program, at + steps[0], steps, fractions, rates)
    return _mix(now, now_rate, later, later_rate, fractions[0], rates[0])


@borrowing
def _is_grid(program, start, size):  # type: ignore[no-untyped-def]
    """Whether the payload has the length that its header says."""
    if size < HEADER:
        return False
    nt, nd, nn, ne = program[start], program[start + 1], program[start + 2], program[start + 3]
    nc = program[start + 4]
    axes = nt + nd + nn + ne
    return (
        min(nt, nd, nn, ne) >= 1.0
        and (nc == 2.0 or nc == 3.0)
        and HEADER + axes + nt * nd * nn * ne * nc == size
    )


@borrowing
def box_interpolation(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Header, time, depth, north and east axes, velocity (time, depth, north, east, component)."""
    if not _is_grid(program, start, size):
        return INVALID
    nt = int(program[start])
    nd = int(program[start + 1])
    nn = int(program[start + 2])
    ne = int(program[start + 3])
    nc = int(program[start + 4])
    # Tangent-plane metres to metres along the meridian and the origin's parallel, second order.
    curvature = program[start + 5]
    y = north - 0.5 * curvature * east * east
    y_rate = r_n - curvature * east * r_e
    x = east * (1.0 + curvature * north)
    x_rate = r_e * (1.0 + curvature * north) + curvature * east * r_n
    at = start + HEADER
    i_t, f_t, inv_t = locate(program, at, nt, t)
    at += nt
    i_d, f_d, inv_d = locate(program, at, nd, depth)
    at += nd
    i_n, f_n, inv_n = locate(program, at, nn, y)
    at += nn
    i_e, f_e, inv_e = locate(program, at, ne, x)
    at += ne
    at += (((i_t * nd + i_d) * nn + i_n) * ne + i_e) * nc
    # An axis of one node has no neighbour: a step of zero reads the node itself.
    steps = (
        nd * nn * ne * nc if nt > 1 else 0,
        nn * ne * nc if nd > 1 else 0,
        ne * nc if nn > 1 else 0,
        nc if ne > 1 else 0,
    )
    fractions = (f_t, f_d, f_n, f_e)
    rates = (inv_t * r_t, inv_d * r_d, inv_n * y_rate, inv_e * x_rate)
    u, u_rate = _component(program, at, steps, fractions, rates)
    v, v_rate = _component(program, at + 1, steps, fractions, rates)
    w = 0.0
    w_rate = 0.0
    if nc == 3:
        w, w_rate = _component(program, at + 2, steps, fractions, rates)
    return u, v, w, u_rate, v_rate, w_rate


@jit
def beyond_grid(program, north, east):  # type: ignore[no-untyped-def]
    """Where a track (north, east [m], shape (n,)) is beyond the sides of a grid, shape (n,).

    There the sampler holds the edge value: a mission that gets there needs a larger file.
    """
    out = np.zeros(north.size, dtype=np.bool_)
    if program.size == 0 or not (0.0 <= program[0] <= program.size):
        return out
    at = 1
    for _ in range(int(program[0])):
        code, start, size = record_at(program, at)
        if size < 0:
            break
        at = start + size
        if code != GRID_CODE or not _is_grid(program, start, size):
            continue
        nn = int(program[start + 2])
        ne = int(program[start + 3])
        curvature = program[start + 5]
        n_axis = start + HEADER + int(program[start]) + int(program[start + 1])
        e_axis = n_axis + nn
        for i in range(north.size):
            y = north[i] - 0.5 * curvature * east[i] * east[i]
            x = east[i] * (1.0 + curvature * north[i])
            if nn > 1 and not (program[n_axis] <= y <= program[n_axis + nn - 1]):
                out[i] = True
            if ne > 1 and not (program[e_axis] <= x <= program[e_axis + ne - 1]):
                out[i] = True
    return out
