"""Equations of motion in six degrees of freedom and their Runge-Kutta integrator, compiled.

State y, shape (14,): position NED [m] (3), scalar-first quaternion body to NED (4), nu_r, the
velocity through the water [m/s] and the body rates [rad/s] (6), body FRD at the CB, and the hull's
temperature [degree_Celsius], which follows the water's: dT/dt = (T_water - T) / lag.

Fossen's equation for a vehicle in an irrotational current,

    M_RB dnu + C_RB(nu) nu + M_A dnu_r + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = 0,
    nu_c = [R^T V_c; 0],  dnu_c = [-S(omega) R^T V_c + R^T dV_c/dt; 0],

is integrated in nu_r. With C_RB independent of the linear velocity, the rotating part of dnu_c
cancels. Only the current's own rate along the path remains (Fossen 2011, property 8.1):

    (M_RB + M_A) dnu_r = -(C_RB + C_A(nu_r)) nu_r - D(nu_r) nu_r - g(eta) - M_RB [R^T dV_c/dt; 0].

A uniform, steady current then changes only the track, up to rounding.

Water that accelerates or shears adds terms (Thomasson and Woolsey 2013; docs/physics/equations.md):

- the pressure gradient of the water's own acceleration acts on the displaced mass m_d, the
  Froude-Krylov force m_d (dV_c/dt + (grad V_c) V_c);
- the impulse of the added mass is strained: -G^T h_1, with G = R^T (grad V_c) R and
  h = M_A nu_w;
- nu_w = (v_r, omega - (G_32, -G_31, G_21)) is the motion relative to water that rotates under the
  hull; damping, parts and the added mass's impulse use nu_w, rigid-body terms do not.
"""

from __future__ import annotations

import math

import numpy as np

from twin.compiled import elementary, jit
from twin.compiled.elementary import scalar
from twin.fossen.forces import (
    ForceParameters,
    carried,
    damping_wrench,
    density_at,
    displaced_mass,
    parts_wrench,
    pumped,
    temperature_at,
)
from twin.fossen.terms import (
    added,
    balanced,
    buoyant_moment,
    columns_times,
    immersed,
    mass_matrix,
    quaternion_rate,
    restoring,
    rotation,
    rows_times,
    solved,
    sum3,
)
from twin.numbers import Array
from twin.water.current.sampler import sample_gradient

FASTEST = 20.0
"""[m/s] Limit of the speed through the water; a faster state has left the range of physics."""
POSITION = slice(0, 3)
QUATERNION = slice(3, 7)
NU_R = slice(7, 13)


@scalar
def part_after(start, command, low, high, lag, rate, one_way, elapsed):  # type: ignore[no-untyped-def]
    """Position of a part after `elapsed` [s], the exact solution of d(position)/dt = clip((command
    - position) / lag, -rate, rate). A command beyond the travel is clamped to its end."""
    wanted = min(max(command, low), high)
    if one_way != 0.0:
        wanted = min(wanted, start)
    gap = wanted - start
    band = rate * lag
    # the part moves at its largest rate until `band` from its goal, then by the lag alone
    ramp = min(max(abs(gap) - band, 0.0) / rate, elapsed)
    rest = math.copysign(abs(gap) - ramp * rate, gap)
    return wanted - rest * elementary.exp(-(elapsed - ramp) / lag)


@jit
def actuators_after(start: Array, command: Array, law: Array, elapsed: float) -> Array:
    """Positions of the parts after `elapsed` [s]; `law` rows: min, max, lag, rate, one way.

    A command beyond the travel is clamped to its end before the lag acts.
    """
    position = np.empty(start.size)
    for i in range(start.size):
        position[i] = part_after(
            start[i], command[i], law[0, i], law[1, i], law[2, i], law[3, i], law[4, i], elapsed
        )
    return position


@jit
def mass_distribution(p: ForceParameters, positions: Array):  # type: ignore[no-untyped-def]
    """Return (mass [kg], first moment (3,) [kg m], I_b (3, 3) [kg m2]) about the CB, parts held."""
    mass, (x, y, z), (xx, xy, yy, xz, yz, zz) = carried(p, positions)
    return mass, np.array([x, y, z]), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def skew(a: Array) -> Array:
    """Matrix S(a), shape (3, 3), with S(a) b = a x b (Fossen 2011, definition 2.2)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def rigid_body_mass(mass: float, cg: Array, inertia: Array) -> Array:
    """Mass matrix M_RB, shape (6, 6), of a body with CG at `cg` [m] (Fossen 2011, eq. 3.44).

    `inertia` [kg m2], shape (3, 3), is I_b about the CB, not about the CG.
    """
    arm = mass * skew(cg)
    return np.block([[mass * np.eye(3), -arm], [arm, np.asarray(inertia)]])


@jit
def turned_water(nu_r: Array, gradient: Array) -> Array:
    """Motion nu_w, shape (6,), relative to water that rotates under the hull by its gradient.

    `gradient` (3, 3) [1/s] is G in body axes. At a place x ahead of the CB the water's velocity
    differs by G (x, 0, 0). Across the hull this is a yaw rate G_21 and a pitch rate -G_31 of the
    water; along the wings, at (0, y, 0), it is a roll rate G_32.
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
    """Acceleration dnu_r/dt, shape (6,).

    `down` (3,) is the NED down axis in body axes, `positions` (parts,) are positions of the parts,
    `displaced` [kg] is the mass of water that the hull displaces, `density` [kg/m3] the water's.
    Current, in body axes: `path_rate` (3,) is dV_c/dt along the vehicle's path [m/s2],
    `water_rate` (3,) along the water's own path, `gradient` (3, 3) [1/s] the gradient.
    """
    body = carried(p, positions)
    axis = (down[0], down[1], down[2])
    immersion, lever = immersed(depth, down[0], p.hull_length, p.hull_diameter)
    nu_w = turned_water(nu_r, gradient)
    wrench = restoring(p.gravity, displaced, immersion, lever, body, axis)
    # buoyancy of pumped volume acts at the pump's place
    volume, moment = pumped(p, positions)
    raised = buoyant_moment(
        p.gravity,
        immersion * displaced / (p.neutral_volume + 1e-6 * volume) * 1e-6,
        (moment[0], moment[1], moment[2]),
        axis,
    )
    wrench = added(wrench, ((0.0, 0.0, 0.0), raised))
    tau = immersion * damping_wrench(p, nu_w, density)
    tau += parts_wrench(p, positions, nu_w, density, depth, down)
    wrench = added(wrench, ((tau[0], tau[1], tau[2]), (tau[3], tau[4], tau[5])))
    scale, wet = immersion * density / p.reference_density, immersion * displaced
    m_a = triangle(p.added_mass)
    g = gradient
    force = balanced(
        wrench,
        body,
        m_a,
        scale,
        p.coupling,
        (nu_r[0], nu_r[1], nu_r[2]),
        (nu_r[3], nu_r[4], nu_r[5]),
        (nu_w[3], nu_w[4], nu_w[5]),
        (g[0, 0], g[0, 1], g[0, 2], g[1, 0], g[1, 1], g[1, 2], g[2, 0], g[2, 1], g[2, 2]),
        (path_rate[0], path_rate[1], path_rate[2]),
        (wet * water_rate[0], wet * water_rate[1], wet * water_rate[2]),
    )
    return np.array(solved(mass_matrix(body, m_a, scale), force))


@jit
def triangle(m: Array):  # type: ignore[no-untyped-def]
    """Lower triangle of a symmetric (6, 6), as a tuple for `terms`."""
    return (
        m[0, 0], m[1, 0], m[1, 1], m[2, 0], m[2, 1], m[2, 2],
        m[3, 0], m[3, 1], m[3, 2], m[3, 3], m[4, 0], m[4, 1], m[4, 2], m[4, 3], m[4, 4],
        m[5, 0], m[5, 1], m[5, 2], m[5, 3], m[5, 4], m[5, 5],
    )  # fmt: skip


@jit
def still_acceleration(  # type: ignore[no-untyped-def]
    p: ForceParameters, down: Array, depth: float, nu_r: Array, positions: Array, displaced: float
):
    """Acceleration, shape (6,), in still water of the reference density; see `acceleration`."""
    still = np.zeros(3)
    density, gradient = p.reference_density, np.zeros((3, 3))
    return acceleration(p, down, depth, nu_r, positions, displaced, density, still, still, gradient)


@jit
def derivative(p: ForceParameters, program: Array, t: float, y: Array, actuators: Array) -> Array:
    """Rate dy/dt at time `t` [s] for positions of the parts, (parts,)."""
    rot = rotation(y[3], y[4], y[5], y[6])
    nu_r = y[7:13]
    flow = sample_gradient(program, t, y[0], y[1], y[2])
    current, local, grad = flow[0:3], flow[3:6], flow[6:15]
    through = rows_times(rot, (y[7], y[8], y[9]))
    velocity = sum3(through, current)
    path = columns_times(rot, sum3(local, rows_times(grad, velocity)))
    water = columns_times(rot, sum3(local, rows_times(grad, current)))
    a = columns_times(rot, rows_times(grad, (rot[0], rot[3], rot[6])))
    b = columns_times(rot, rows_times(grad, (rot[1], rot[4], rot[7])))
    c = columns_times(rot, rows_times(grad, (rot[2], rot[5], rot[8])))

    dy = np.empty(14)
    dy[0], dy[1], dy[2] = velocity
    dy[3], dy[4], dy[5], dy[6] = quaternion_rate(y[3], y[4], y[5], y[6], (y[10], y[11], y[12]))
    dy[7:13] = acceleration(
        p,
        np.array(rot[6:9]),
        y[2],
        nu_r,
        actuators,
        displaced_mass(p, y[2], pumped(p, actuators)[0], y[13]),
        density_at(p, y[2]),
        np.array(path),
        np.array(water),
        np.array(((a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2]))),
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
    """Integrate by the classical fixed-step RK4 from breakpoint to breakpoint.

    `breakpoints` (n,) [s] are all sample and command times; `commands` (n - 1, parts) hold between
    them. Each interval is divided into equal steps of at most `dt`; no step contains a command.
    Returns (states (n, 14), actuators (n, parts), number of valid rows: n unless it failed).
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
