"""The 6-DOF equations of motion and their own Runge-Kutta integrator, compiled.

State y, shape (14,): position NED [m] (3), scalar-first quaternion body to NED (4), nu_r, the
velocity through the water [m/s] and the body rates [rad/s] (6), body FRD at the CB, and the hull's
temperature [degree_Celsius], which follows the water's: dT/dt = (T_water - T) / lag.

Fossen's equation for a vehicle in an irrotational current,

    M_RB dnu + C_RB(nu) nu + M_A dnu_r + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = 0,
    nu_c = [R^T V_c; 0],  dnu_c = [-S(omega) R^T V_c + R^T dV_c/dt; 0],

is integrated in nu_r. With C_RB independent of the linear velocity the rotating part of dnu_c
cancels and only the current's own rate along the path remains (Fossen 2011, property 8.1):

    (M_RB + M_A) dnu_r = -(C_RB + C_A(nu_r)) nu_r - D(nu_r) nu_r - g(eta) - M_RB [R^T dV_c/dt; 0].

A uniform, steady current then changes nothing but the track, to the last bit but rounding.

Water that accelerates or shears does more (Thomasson and Woolsey 2013; docs/physics/equations.md):

- the pressure gradient of the water's own acceleration acts on the displaced mass m_d, the
  Froude-Krylov force m_d (dV_c/dt + (grad V_c) V_c);
- the impulse of the added mass is strained: -G^T h_1, with G = R^T (grad V_c) R and
  h = M_A nu_w;
- nu_w = (v_r, omega - (G_32, -G_31, G_21)) is the motion through water that turns under the hull:
  damping, parts and the added mass's impulse take it, rigid-body terms do not.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import jit
from twin.fossen.forces import (
    PART_COLUMNS,
    ForceParameters,
    damping_wrench,
    density_at,
    displaced_mass,
    mass_position,
    part_mass,
    parts_wrench,
    pumped,
    restoring,
    temperature_at,
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
from twin.numbers import Array
from twin.water.current.sampler import sample_gradient

FASTEST = 20.0
"""[m/s] through the water: what is faster has left physics"""
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
    """Positions of the parts after `elapsed` [s]; `law` rows: min, max, lag, rate, one way.

    A command beyond the travel is one to its end: the lag acts on what is left to go.
    """
    position = np.empty(start.size)
    for i in range(start.size):
        wanted = min(max(command[i], law[0, i]), law[1, i])
        if law[4, i] != 0.0:
            wanted = min(wanted, start[i])
        position[i] = actuator_position(start[i], wanted, law[2, i], law[3, i], elapsed)
    return position


@jit
def mass_distribution(p: ForceParameters, positions: Array):  # type: ignore[no-untyped-def]
    """(mass [kg], first moment (3,) [kg m], I_b (3, 3) [kg m2]) about the CB, the masses held."""
    total = p.static_mass
    moment = p.static_mass * p.static_cg
    inertia = p.static_inertia + point_mass_inertia(p.static_mass, p.static_cg)
    for k in range(p.masses.shape[0]):
        row = p.masses[k]
        place = mass_position(row, positions)
        rotation = positions[int(row[4])] - row[5] if row[4] >= 0.0 else 0.0
        own = row[6:].copy().reshape((3, 3))
        total += row[0]
        moment = moment + row[0] * place
        inertia = inertia + rolled_inertia(own, rotation) + point_mass_inertia(row[0], place)
    for k in range(p.parts.shape[0]):
        row = p.parts[k]
        extra = part_mass(int(row[0]), row[PART_COLUMNS:], positions[k])
        if extra != 0.0:
            total += extra
            moment = moment + extra * row[1:4]
            inertia = inertia + point_mass_inertia(extra, row[1:4].copy())
    return total, moment, inertia


@jit
def turned_water(nu_r: Array, gradient: Array) -> Array:
    """nu_w, shape (6,): motion through the water as its gradient turns it under the hull.

    `gradient` (3, 3) [1/s] is G in body axes. At a place x ahead of the CB the water's velocity
    differs by G (x, 0, 0): across the hull like a yaw rate G_21 and a pitch rate -G_31 of the
    water; along the wings, at (0, y, 0), like a roll rate G_32.
    """
    nu_w = nu_r.copy()
    nu_w[3] -= gradient[2, 1]
    nu_w[4] += gradient[2, 0]
    nu_w[5] -= gradient[1, 0]
    return nu_w


@jit
def acceleration(  # type: ignore[no-untyped-def]
    p: ForceParameters,
    down: Array,
    depth: float,
    nu_r: Array,
    positions: Array,
    displaced: float,
    density: float,
    path_rate: Array,
    water_rate: Array,
    gradient: Array,
):
    """dnu_r/dt, shape (6,).

    `down` (3,) is the NED down axis in body axes, `positions` (parts,) those of the parts,
    `displaced` [kg] the mass of displaced water of the immersed hull, `density` [kg/m3] the
    water's. Of the current, in body axes: `path_rate` (3,) is dV_c/dt along the vehicle's path
    [m/s2], `water_rate` (3,) that along the water's own, `gradient` (3, 3) [1/s].
    """
    mass, moment, inertia = mass_distribution(p, positions)
    cg = moment / mass
    m_rb = rigid_body_mass(mass, cg, inertia)
    coriolis = rigid_body_coriolis(mass, cg, inertia, nu_r[3:])
    g, immersion = restoring(p, down, depth, mass, moment, displaced)
    m_a = p.added_mass * (immersion * density / p.reference_density)
    nu_w = turned_water(nu_r, gradient)
    if p.coupling != 0.0:  # else the hull law holds it
        coriolis += added_mass_coriolis(m_a, nu_w)
    force = immersion * damping_wrench(p, nu_w, density) - g - times(coriolis, nu_r)
    force += parts_wrench(p, positions, nu_w, density, depth, down)
    # buoyancy of pumped volume acts where it is: its lever x up
    volume, lever = pumped(p, positions)
    if lever[0] != 0.0 or lever[1] != 0.0 or lever[2] != 0.0:
        weight = immersion * displaced * p.gravity / (p.neutral_volume + 1e-6 * volume) * 1e-6
        force[3] -= weight * (lever[1] * down[2] - lever[2] * down[1])
        force[4] -= weight * (lever[2] * down[0] - lever[0] * down[2])
        force[5] -= weight * (lever[0] * down[1] - lever[1] * down[0])
    impulse = times(m_a, nu_w)
    force[:3] += immersion * displaced * water_rate - transposed_times(gradient, impulse[:3])
    for i in range(6):
        for j in range(3):
            force[i] -= m_rb[i, j] * path_rate[j]
    return solve_positive_definite(m_rb + m_a, force)


@jit
def still_acceleration(  # type: ignore[no-untyped-def]
    p: ForceParameters, down: Array, depth: float, nu_r: Array, positions: Array, displaced: float
):
    """`acceleration`, shape (6,), in still water of the reference density."""
    still = np.zeros(3)
    density, gradient = p.reference_density, np.zeros((3, 3))
    return acceleration(p, down, depth, nu_r, positions, displaced, density, still, still, gradient)


@jit
def derivative(p: ForceParameters, program: Array, t: float, y: Array, actuators: Array) -> Array:
    """dy/dt at time `t` [s] for positions of the parts, (parts,)."""
    rotation = rotation_from_quaternion(y[3:7])
    nu_r = y[7:13]
    flow = np.array(sample_gradient(program, t, y[0], y[1], y[2]))
    gradient = flow[6:].reshape((3, 3))
    velocity = times(rotation, nu_r[:3]) + flow[:3]
    path_rate = flow[3:6] + times(gradient, velocity)
    water_rate = flow[3:6] + times(gradient, flow[:3])
    body_gradient = np.empty((3, 3))
    for j in range(3):
        body_gradient[:, j] = transposed_times(rotation, times(gradient, rotation[:, j].copy()))

    dy = np.empty(14)
    dy[:3] = velocity
    dy[3:7] = quaternion_rate(y[3:7], nu_r[3:])
    dy[7:13] = acceleration(
        p,
        rotation[2].copy(),
        y[2],
        nu_r,
        actuators,
        displaced_mass(p, y[2], pumped(p, actuators)[0], y[13]),
        density_at(p, y[2]),
        transposed_times(rotation, path_rate),
        transposed_times(rotation, water_rate),
        body_gradient,
    )
    dy[13] = (temperature_at(p, y[2]) - y[13]) / p.hull_thermal_lag
    return dy


@jit
def integrate(  # type: ignore[no-untyped-def]
    p: ForceParameters,
    program: Array,
    law: Array,
    y0: Array,
    actuators0: Array,
    breakpoints: Array,
    commands: Array,
    dt: float,
):
    """Classical fixed-step RK4 from breakpoint to breakpoint.

    `breakpoints` (n,) [s] are all sample and command times, `commands` (n - 1, parts) hold between
    them; each interval is cut in equal steps of at most `dt`, so that no step straddles a
    command. Returns (states (n, 14), actuators (n, parts), rows before it failed, if it did).
    """
    n = breakpoints.size
    states = np.empty((n, y0.size))
    positions = np.empty((n, actuators0.size))
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
            speed2 = y[7] ** 2 + y[8] ** 2 + y[9] ** 2
            turn2 = (y[10] ** 2 + y[11] ** 2 + y[12] ** 2) * h**2
            if not (np.all(np.isfinite(y)) and speed2 <= FASTEST**2 and turn2 <= 1.0):
                return states, positions, row + 1
        held = here.copy()
        states[row + 1] = y
        positions[row + 1] = held
    return states, positions, n
