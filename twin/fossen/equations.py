"""The 6-DOF equations of motion and their own Runge-Kutta integrator, compiled.

State y, shape (13,): position NED [m] (3), scalar-first quaternion body to NED (4), and nu_r, the
velocity through the water [m/s] and the body rates [rad/s] (6), body FRD at the CB.

Fossen's equation for a vehicle in an irrotational current,

    M_RB dnu + C_RB(nu) nu + M_A dnu_r + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = 0,
    nu_c = [R^T V_c; 0],  dnu_c = [-S(omega) R^T V_c + R^T dV_c/dt; 0],

is integrated in nu_r. With C_RB independent of the linear velocity the rotating part of dnu_c
cancels and only the current's own rate along the path remains (Fossen 2011, property 8.1):

    (M_RB + M_A) dnu_r = -(C_RB + C_A(nu_r)) nu_r - D(nu_r) nu_r - g(eta) - M_RB [R^T dV_c/dt; 0].

A uniform current then changes nothing but the track, to the last bit but rounding.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit
from twin.fossen.forces import (
    Parameters,
    damping_wrench,
    displaced_mass,
    movable_position,
    restoring,
)
from twin.fossen.matrices import (
    added_mass_coriolis,
    point_mass_inertia,
    quaternion_rate,
    rigid_body_coriolis,
    rigid_body_mass,
    rolled_inertia,
    rotation_from_quaternion,
    solve_positive_definite,
    times,
    transposed_times,
)
from twin.water.current.sampler import sample

Array = NDArray[np.float64]

STATE_SIZE = 13
POSITION = slice(0, 3)
QUATERNION = slice(3, 7)
NU_R = slice(7, 13)


@jit
def actuator_position(start: float, command: float, lag: float, rate: float, elapsed: float):  # type: ignore[no-untyped-def]
    """Exact solution of dx/dt = clip((command - x) / lag, -rate, rate) after `elapsed` [s]."""
    gap = command - start
    band = rate * lag
    if abs(gap) > band:
        ramp = (abs(gap) - band) / rate
        if elapsed <= ramp:
            return start + np.sign(gap) * rate * elapsed
        return command - np.sign(gap) * band * np.exp(-(elapsed - ramp) / lag)
    return command - gap * np.exp(-elapsed / lag)


@jit
def actuators_after(start: Array, command: Array, law: Array, elapsed: float) -> Array:
    """Positions (shift, rotation, pump) after `elapsed` [s]; `law` rows: min, max, lag, rate."""
    position = np.empty(3)
    for i in range(3):
        free = actuator_position(start[i], command[i], law[2, i], law[3, i], elapsed)
        position[i] = min(max(free, law[0, i]), law[1, i])
    return position


@jit
def mass_distribution(p: Parameters, shift: float, rotation: float):  # type: ignore[no-untyped-def]
    """(CG (3,) [m], I_b (3, 3) [kg m2] about the CB) with the movable block held in place."""
    movable = movable_position(p, shift, rotation)
    cg = (p.static_mass * p.static_cg + p.movable_mass * movable) / p.mass
    inertia = (
        p.static_inertia
        + point_mass_inertia(p.static_mass, p.static_cg)
        + rolled_inertia(p.movable_inertia, rotation)
        + point_mass_inertia(p.movable_mass, movable)
    )
    return cg, inertia


@jit
def acceleration(  # type: ignore[no-untyped-def]
    p: Parameters,
    down: Array,
    depth: float,
    nu_r: Array,
    shift: float,
    rotation: float,
    displaced: float,
    current_rate: Array,
):
    """dnu_r/dt, shape (6,).

    `down` (3,) is the NED down axis in body axes, `displaced` [kg] the mass of displaced water
    of the immersed hull, `current_rate` (3,) the body components of dV_c/dt [m/s2].
    """
    cg, inertia = mass_distribution(p, shift, rotation)
    m_rb = rigid_body_mass(p.mass, cg, inertia)
    coriolis = rigid_body_coriolis(p.mass, cg, inertia, nu_r[3:])
    coriolis += added_mass_coriolis(p.added_mass, nu_r)
    g, immersion = restoring(p, down, depth, p.mass * cg, displaced)
    force = immersion * damping_wrench(p, nu_r) - g - times(coriolis, nu_r)
    for i in range(6):
        for j in range(3):
            force[i] -= m_rb[i, j] * current_rate[j]
    return solve_positive_definite(m_rb + p.added_mass, force)


@jit
def derivative(p: Parameters, program: Array, t: float, y: Array, actuators: Array) -> Array:
    """dy/dt at time `t` [s] for actuator positions (shift [m], rotation [rad], pump [cm3])."""
    rotation = rotation_from_quaternion(y[3:7])
    nu_r = y[7:13]
    v_water = times(rotation, nu_r[:3])
    # The current's velocity does not depend on the vehicle's; its rate along the path does.
    still = sample(program, t, y[0], y[1], y[2], 0.0, 0.0, 0.0)
    v_north = v_water[0] + still[0]
    v_east = v_water[1] + still[1]
    v_down = v_water[2] + still[2]
    moving = sample(program, t, y[0], y[1], y[2], v_north, v_east, v_down)
    rate = np.empty(3)
    rate[0], rate[1], rate[2] = moving[3], moving[4], moving[5]

    dy = np.empty(13)
    dy[0], dy[1], dy[2] = v_north, v_east, v_down
    dy[3:7] = quaternion_rate(y[3:7], nu_r[3:])
    dy[7:13] = acceleration(
        p,
        rotation[2].copy(),
        y[2],
        nu_r,
        actuators[0],
        actuators[1],
        displaced_mass(p, y[2], actuators[2]),
        transposed_times(rotation, rate),
    )
    return dy


@jit
def integrate(  # type: ignore[no-untyped-def]
    p: Parameters,
    program: Array,
    law: Array,
    y0: Array,
    actuators0: Array,
    breakpoints: Array,
    commands: Array,
    dt: float,
):
    """Classical fixed-step RK4 from breakpoint to breakpoint.

    `breakpoints` (n,) [s] are all sample and command times, `commands` (n - 1, 3) hold between
    them; each interval is cut in equal steps of at most `dt`, so that no step straddles a
    command. Returns (states (n, 13), actuators (n, 3), rows that are finite).
    """
    n = breakpoints.size
    states = np.empty((n, 13))
    positions = np.empty((n, 3))
    y = y0.copy()
    held = actuators0.copy()
    states[0] = y
    positions[0] = held
    for row in range(n - 1):
        span = breakpoints[row + 1] - breakpoints[row]
        steps = max(1, int(np.ceil(span / dt - 1e-9)))
        h = span / steps
        command = commands[row]
        here = held
        for step in range(steps):
            t = breakpoints[row] + step * h
            middle = actuators_after(held, command, law, (step + 0.5) * h)
            there = actuators_after(held, command, law, (step + 1) * h)
            k1 = derivative(p, program, t, y, here)
            k2 = derivative(p, program, t + 0.5 * h, y + 0.5 * h * k1, middle)
            k3 = derivative(p, program, t + 0.5 * h, y + 0.5 * h * k2, middle)
            k4 = derivative(p, program, t + h, y + h * k3, there)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            y[3:7] /= np.sqrt(y[3] ** 2 + y[4] ** 2 + y[5] ** 2 + y[6] ** 2)
            here = there
        if not np.all(np.isfinite(y)):
            return states, positions, row + 1
        held = here.copy()
        states[row + 1] = y
        positions[row + 1] = held
    return states, positions, n
