"""Current and its rate of change along the vehicle's path, compiled, without allocations.

`sample` is called once per physics step from inside C callbacks. The rate is the material
derivative for the vehicle, dV_c/dt + (v . grad) V_c with v the velocity over ground, and it is the
exact derivative of the piecewise linear interpolation, not an estimate. At a node the derivative
of the cell that lies ahead in the axis's direction is returned; outside a table or grid the edge
value is held and the derivative is zero. Above the mean sea surface the value at depth 0 holds.
A NaN position never indexes out of bounds: it reads a finite edge value.
"""

from __future__ import annotations

import math

import numpy as np

from twin.compiled import jit
from twin.water.current.program import (
    EKMAN,
    GEOSTROPHIC,
    GRID,
    GRID_HEADER,
    INERTIAL,
    LOG_LAYER,
    PROFILE,
    RECORD_HEADER,
    SERIES,
    TIDE,
    UNIFORM,
)


@jit
def _locate(program, start, n, x):
    """Cell of x on the ascending axis program[start:start+n]: index, fraction, 1/width.

    The guess of an evenly spaced axis is tried first, then a binary search. The width's inverse is
    zero where the edge value is held, which makes every derivative vanish there.
    """
    first = program[start]
    if n == 1 or not (x >= first):
        return 0, 0.0, 0.0
    last = program[start + n - 1]
    if x >= last:
        return n - 2, 1.0, 0.0
    low = int((x - first) / (last - first) * (n - 1))
    low = min(max(low, 0), n - 2)
    if not (program[start + low] <= x < program[start + low + 1]):
        low = 0
        high = n - 1
        while high - low > 1:
            middle = (low + high) >> 1
            if program[start + middle] <= x:
                low = middle
            else:
                high = middle
    inverse = 1.0 / (program[start + low + 1] - program[start + low])
    return low, (x - program[start + low]) * inverse, inverse


@jit
def _table(program, start, x, x_rate):
    """Linear table: n, axis (n), velocity (n, 3)."""
    n = int(program[start])
    low, fraction, inverse = _locate(program, start + 1, n, x)
    here = start + 1 + n + 3 * low
    ahead = here + 3 if n > 1 else here
    rate = x_rate * inverse
    d_n = program[ahead] - program[here]
    d_e = program[ahead + 1] - program[here + 1]
    d_d = program[ahead + 2] - program[here + 2]
    return (
        program[here] + fraction * d_n,
        program[here + 1] + fraction * d_e,
        program[here + 2] + fraction * d_d,
        rate * d_n,
        rate * d_e,
        rate * d_d,
    )


@jit
def _ekman(program, start, depth, depth_rate):
    """Surface speed, 1/depth scale, surface angle from north, sense (+1 N, -1 S hemisphere)."""
    inverse = program[start + 1]
    decay = program[start] * math.exp(-depth * inverse)
    angle = program[start + 2] + program[start + 3] * depth * inverse
    north = decay * math.cos(angle)
    east = decay * math.sin(angle)
    rate = depth_rate * inverse
    turn = program[start + 3] * rate
    return north, east, 0.0, -rate * north - turn * east, -rate * east + turn * north, 0.0


@jit
def _geostrophic(program, start, depth, depth_rate):
    """Barotropic north, east; baroclinic surface north, east; 1/scale depth."""
    inverse = program[start + 4]
    decay = math.exp(-depth * inverse)
    north = program[start + 2] * decay
    east = program[start + 3] * decay
    rate = -depth_rate * inverse
    return program[start] + north, program[start + 1] + east, 0.0, rate * north, rate * east, 0.0


@jit
def _tide(program, start, t):
    """n, then per constituent: angular rate, cos and sin coefficients (north, east each)."""
    north = 0.0
    east = 0.0
    north_rate = 0.0
    east_rate = 0.0
    for i in range(int(program[start])):
        at = start + 1 + 5 * i
        omega = program[at]
        c = math.cos(omega * t)
        s = math.sin(omega * t)
        north += program[at + 1] * c + program[at + 3] * s
        east += program[at + 2] * c + program[at + 4] * s
        north_rate += omega * (program[at + 3] * c - program[at + 1] * s)
        east_rate += omega * (program[at + 4] * c - program[at + 2] * s)
    return north, east, 0.0, north_rate, east_rate, 0.0


@jit
def _inertial(program, start, t, depth, depth_rate):
    """Speed, signed angular rate (clockwise from above is +), angle at t 0, layer depth,
    1/decay depth below the layer."""
    angle = program[start + 2] + program[start + 1] * t
    below = depth - program[start + 3]
    speed = program[start]
    rate = 0.0
    if below >= 0.0:
        speed *= math.exp(-below * program[start + 4])
        rate = -depth_rate * program[start + 4]
    north = speed * math.cos(angle)
    east = speed * math.sin(angle)
    omega = program[start + 1]
    return north, east, 0.0, rate * north - omega * east, rate * east + omega * north, 0.0


@jit
def _log_layer(program, start, depth, depth_rate):
    """(u*/kappa) north, east; water depth; roughness length; layer thickness."""
    height = program[start + 2] - depth
    rate = 0.0
    if height <= program[start + 3]:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if height < program[start + 4]:
        rate = -depth_rate / height
    else:
        height = program[start + 4]
    log = math.log(height / program[start + 3])
    north = program[start]
    east = program[start + 1]
    return north * log, east * log, 0.0, north * rate, east * rate, 0.0


@jit
def _along_east(program, at, step, f, rate):
    """Value and path rate between two neighbours on the east axis."""
    here = program[at]
    slope = program[at + step] - here
    return here + f * slope, rate * slope


@jit
def _mix(a, a_rate, b, b_rate, f, rate):
    """Linear interpolation between two (value, rate) pairs whose weight f itself moves."""
    return a + f * (b - a), a_rate + f * (b_rate - a_rate) + rate * (b - a)


@jit
def _grid_component(program, at, steps, fractions, rates):
    """One velocity component from the 16 corners of the cell whose first corner is `at`."""
    s_t, s_d, s_n, s_e = steps
    f_t, f_d, f_n, f_e = fractions
    r_t, r_d, r_n, r_e = rates
    a, ar = _along_east(program, at, s_e, f_e, r_e)
    b, br = _along_east(program, at + s_n, s_e, f_e, r_e)
    c, cr = _mix(a, ar, b, br, f_n, r_n)
    a, ar = _along_east(program, at + s_d, s_e, f_e, r_e)
    b, br = _along_east(program, at + s_d + s_n, s_e, f_e, r_e)
    a, ar = _mix(a, ar, b, br, f_n, r_n)
    now, now_rate = _mix(c, cr, a, ar, f_d, r_d)
    if s_t == 0:
        return now, now_rate
    at += s_t
    a, ar = _along_east(program, at, s_e, f_e, r_e)
    b, br = _along_east(program, at + s_n, s_e, f_e, r_e)
    c, cr = _mix(a, ar, b, br, f_n, r_n)
    a, ar = _along_east(program, at + s_d, s_e, f_e, r_e)
    b, br = _along_east(program, at + s_d + s_n, s_e, f_e, r_e)
    a, ar = _mix(a, ar, b, br, f_n, r_n)
    later, later_rate = _mix(c, cr, a, ar, f_d, r_d)
    return _mix(now, now_rate, later, later_rate, f_t, r_t)


@jit
def _grid(program, start, t, north, east, depth, v_north, v_east, depth_rate):
    """Header, time, depth, north and east axes, velocity (time, depth, north, east, component)."""
    nt = int(program[start])
    nd = int(program[start + 1])
    nn = int(program[start + 2])
    ne = int(program[start + 3])
    nc = int(program[start + 4])
    # Tangent-plane metres to metres along the meridian and the origin's parallel, second order.
    curvature = program[start + 5]
    y = north - 0.5 * curvature * east * east
    y_rate = v_north - curvature * east * v_east
    x = east * (1.0 + curvature * north)
    x_rate = v_east * (1.0 + curvature * north) + curvature * east * v_north
    at = start + GRID_HEADER
    i_t, f_t, inv_t = _locate(program, at, nt, t)
    at += nt
    i_d, f_d, inv_d = _locate(program, at, nd, depth)
    at += nd
    i_n, f_n, inv_n = _locate(program, at, nn, y)
    at += nn
    i_e, f_e, inv_e = _locate(program, at, ne, x)
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
    rates = (inv_t, inv_d * depth_rate, inv_n * y_rate, inv_e * x_rate)
    u, u_rate = _grid_component(program, at, steps, fractions, rates)
    v, v_rate = _grid_component(program, at + 1, steps, fractions, rates)
    w = 0.0
    w_rate = 0.0
    if nc == 3:
        w, w_rate = _grid_component(program, at + 2, steps, fractions, rates)
    return u, v, w, u_rate, v_rate, w_rate


@jit
def sample(program, t, north, east, down, v_north, v_east, v_down):
    """Current and its total time derivative along the vehicle's path.

    program: float64 vector from `Current.compile`. t [s] since mission start; north, east, down
    [m] about the mission's origin, down = depth; v_* [m/s] the vehicle's velocity over ground.
    Returns (u_north, u_east, u_down [m/s], a_north, a_east, a_down [m/s2]), positive toward
    north, east and down.
    """
    u_n = 0.0
    u_e = 0.0
    u_d = 0.0
    a_n = 0.0
    a_e = 0.0
    a_d = 0.0
    if program.size == 0:
        return u_n, u_e, u_d, a_n, a_e, a_d
    depth = 0.0
    depth_rate = 0.0
    if down > 0.0:
        depth = down
        depth_rate = v_down
    at = 1
    for _ in range(int(program[0])):
        kind = int(program[at])
        start = at + RECORD_HEADER
        at = start + int(program[at + 1])
        if kind == UNIFORM:
            u_n += program[start]
            u_e += program[start + 1]
            u_d += program[start + 2]
            continue
        if kind == PROFILE:
            part = _table(program, start, depth, depth_rate)
        elif kind == EKMAN:
            part = _ekman(program, start, depth, depth_rate)
        elif kind == GEOSTROPHIC:
            part = _geostrophic(program, start, depth, depth_rate)
        elif kind == TIDE:
            part = _tide(program, start, t)
        elif kind == INERTIAL:
            part = _inertial(program, start, t, depth, depth_rate)
        elif kind == LOG_LAYER:
            part = _log_layer(program, start, depth, depth_rate)
        elif kind == SERIES:
            part = _table(program, start, t, 1.0)
        elif kind == GRID:
            part = _grid(program, start, t, north, east, depth, v_north, v_east, depth_rate)
        else:
            # Not a program at all: NaN is an event that the simulation reports, zero would hide it.
            return math.nan, math.nan, math.nan, math.nan, math.nan, math.nan
        u_n += part[0]
        u_e += part[1]
        u_d += part[2]
        a_n += part[3]
        a_e += part[4]
        a_d += part[5]
    return u_n, u_e, u_d, a_n, a_e, a_d


@jit
def sample_track(program, t, north, east, down, v_north, v_east, v_down):
    """`sample` at each point of a track: seven vectors of shape (n,), result (n, 6)."""
    out = np.empty((t.size, 6))
    for i in range(t.size):
        part = sample(program, t[i], north[i], east[i], down[i], v_north[i], v_east[i], v_down[i])
        for j in range(6):
            out[i, j] = part[j]
    return out


@jit
def beyond_grid(program, north, east):
    """Where a track (north, east [m], shape (n,)) is beyond the sides of a grid, shape (n,).

    There the sampler holds the edge value: a mission that gets there needs a larger file.
    """
    out = np.zeros(north.size, dtype=np.bool_)
    if program.size == 0:
        return out
    at = 1
    for _ in range(int(program[0])):
        start = at + RECORD_HEADER
        kind = int(program[at])
        at = start + int(program[at + 1])
        if kind != GRID:
            continue
        nn = int(program[start + 2])
        ne = int(program[start + 3])
        curvature = program[start + 5]
        n_axis = start + GRID_HEADER + int(program[start]) + int(program[start + 1])
        e_axis = n_axis + nn
        for i in range(north.size):
            y = north[i] - 0.5 * curvature * east[i] * east[i]
            x = east[i] * (1.0 + curvature * north[i])
            if nn > 1 and not (program[n_axis] <= y <= program[n_axis + nn - 1]):
                out[i] = True
            if ne > 1 and not (program[e_axis] <= x <= program[e_axis + ne - 1]):
                out[i] = True
    return out
