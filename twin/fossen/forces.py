"""Forces of the Fossen model: the coefficient wrench, the restoring forces, the net buoyancy.

Body axes FRD about the CB, SI units. Coefficients and signs: S. Zhang, J. Yu, A. Zhang, F. Zhang,
Ocean Engineering 60 (2013) 1-13; they carry the density of sea water. Outside the identified
range of the flow angles the terms blend into the sines and cosines of the whole circle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

STRIPS = 9
"""equal-volume strips along the hull that carry the buoyancy at the surface"""


class Parameters(NamedTuple):
    """What the compiled equations need of a `Vehicle`; same names, units and frames."""

    gravity: float
    reference_density: float
    mass: float
    neutral_volume: float
    hull_length: float
    hull_diameter: float
    hull_compressibility: float
    static_mass: float
    static_cg: Array
    static_inertia: Array
    movable_mass: float
    movable_inertia: Array
    movable_neutral_x: float
    movable_eccentricity: float
    added_mass: Array
    k_d0: float
    k_d: float
    k_l0: float
    k_alpha: float
    k_beta: float
    k_mr: float
    k_p: float
    k_m0: float
    k_m: float
    k_q: float
    k_my: float
    k_r: float
    linear_angle: float
    blend_angle: float
    rate_damping_min_speed: float
    density_depth: Array
    density_value: Array


def parameters_of(vehicle: Vehicle, density_depth: Array, density_value: Array) -> Parameters:
    """Gather the vehicle's numbers and a density table (depth [m], density [kg/m3])."""

    def array(values: object) -> Array:
        return np.array(values, dtype=np.float64, order="C")

    k_d0, k_d = vehicle.drag
    k_l0, k_alpha = vehicle.lift
    (k_beta,) = vehicle.side_force
    k_mr, k_p = vehicle.roll_moment
    k_m0, k_m, k_q = vehicle.pitch_moment
    k_my, k_r = vehicle.yaw_moment
    return Parameters(
        gravity=float(vehicle.gravity),
        reference_density=float(vehicle.reference_density),
        mass=float(vehicle.mass),
        neutral_volume=float(vehicle.neutral_volume),
        hull_length=float(vehicle.hull_length),
        hull_diameter=float(vehicle.hull_diameter),
        hull_compressibility=float(vehicle.hull_compressibility),
        static_mass=float(vehicle.static_mass),
        static_cg=array(vehicle.static_cg),
        static_inertia=array(vehicle.static_inertia),
        movable_mass=float(vehicle.movable_mass),
        movable_inertia=array(vehicle.movable_inertia),
        movable_neutral_x=float(vehicle.movable_neutral_x),
        movable_eccentricity=float(vehicle.movable_eccentricity),
        added_mass=array(vehicle.added_mass),
        k_d0=float(k_d0),
        k_d=float(k_d),
        k_l0=float(k_l0),
        k_alpha=float(k_alpha),
        k_beta=float(k_beta),
        k_mr=float(k_mr),
        k_p=float(k_p),
        k_m0=float(k_m0),
        k_m=float(k_m),
        k_q=float(k_q),
        k_my=float(k_my),
        k_r=float(k_r),
        linear_angle=float(vehicle.linear_angle),
        blend_angle=float(vehicle.blend_angle),
        rate_damping_min_speed=float(vehicle.rate_damping_min_speed),
        density_depth=array(density_depth),
        density_value=array(density_value),
    )


@jit
def smoothstep(x: float) -> float:
    """3 x^2 - 2 x^3 between 0 and 1, constant outside."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@jit
def flow_functions(angle: float, linear_angle: float, blend_angle: float):  # type: ignore[no-untyped-def]
    """Stand-ins for angle, angle^2 and 1 that equal them inside the identified range.

    Returns (odd, square, one, weight): beyond `blend_angle` they are sin cos, sin^2 and cos, the
    shapes of a plate in cross flow, so that the forces stay bounded on the whole circle; the
    weight of those shapes rises from 0 at `linear_angle` to 1.
    """
    s = smoothstep((abs(angle) - linear_angle) / (blend_angle - linear_angle))
    sine, cosine = np.sin(angle), np.cos(angle)
    odd = (1.0 - s) * angle + s * sine * cosine
    square = (1.0 - s) * angle * angle + s * sine * sine
    one = (1.0 - s) + s * cosine
    return odd, square, one, s


@jit
def damping_wrench(p: Parameters, nu_r: Array) -> Array:
    """-D(nu_r) nu_r: force [N] and moment [N m] about the CB, shape (6,), body FRD.

    The flow frame's force (-D, SF, -L) and moment (T1, T2, T3) both turn to the body by R_BC of
    angle of attack and sideslip (Zhang et al. 2013). Outside the identified range the rate moments
    pass over to body axes: turned by R_BC, those of roll and yaw would drive the rates in
    reversed flow instead of damping them.
    """
    u, v, w = nu_r[0], nu_r[1], nu_r[2]
    speed2 = u * u + v * v + w * w
    speed = np.sqrt(speed2)
    alpha = np.arctan2(w, u)
    beta = 0.0
    if speed > 0.0:
        beta = np.arcsin(min(max(v / speed, -1.0), 1.0))
    alpha_odd, alpha_square, one, alpha_weight = flow_functions(
        alpha, p.linear_angle, p.blend_angle
    )
    beta_odd, _, _, beta_weight = flow_functions(beta, p.linear_angle, p.blend_angle)
    weight = max(alpha_weight, beta_weight)
    rate2 = max(speed, p.rate_damping_min_speed) ** 2
    damping = np.empty(3)
    damping[0] = p.k_p * nu_r[3] * rate2
    damping[1] = p.k_q * nu_r[4] * rate2
    damping[2] = p.k_r * nu_r[5] * rate2

    flow = np.empty(6)
    flow[0] = -(p.k_d0 + p.k_d * alpha_square) * speed2
    flow[1] = p.k_beta * beta_odd * speed2
    flow[2] = -(p.k_l0 * one + p.k_alpha * alpha_odd) * speed2
    flow[3] = p.k_mr * beta_odd * speed2 + (1.0 - weight) * damping[0]
    flow[4] = (p.k_m0 * one + p.k_m * alpha_odd) * speed2 + (1.0 - weight) * damping[1]
    flow[5] = p.k_my * beta_odd * speed2 + (1.0 - weight) * damping[2]

    ca, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
    body = np.empty(6)
    for k in (0, 3):
        body[k] = ca * cb * flow[k] - ca * sb * flow[k + 1] - sa * flow[k + 2]
        body[k + 1] = sb * flow[k] + cb * flow[k + 1]
        body[k + 2] = sa * cb * flow[k] - sa * sb * flow[k + 1] + ca * flow[k + 2]
    for i in range(3):
        body[3 + i] += weight * damping[i]
    return body


@jit
def movable_position(p: Parameters, shift: float, rotation: float) -> Array:
    """Centre of the movable block [m], shape (3,), body FRD; +rotation [rad] moves it to port."""
    r = np.empty(3)
    r[0] = p.movable_neutral_x + shift
    r[1] = -p.movable_eccentricity * np.sin(rotation)
    r[2] = p.movable_eccentricity * np.cos(rotation)
    return r


@jit
def strip_immersion(p: Parameters, depth: float, slope: float, strip: int):  # type: ignore[no-untyped-def]
    """(x [m], immersed fraction) of one strip; `slope` is the depth gained per metre forward."""
    x = p.hull_length * ((strip + 0.5) / STRIPS - 0.5)
    fraction = smoothstep((depth + x * slope + 0.5 * p.hull_diameter) / p.hull_diameter)
    return x, fraction


@jit
def restoring(p: Parameters, down: Array, depth: float, moment: Array, displaced_mass: float):  # type: ignore[no-untyped-def]
    """(g(eta), immersion): restoring vector, shape (6,), on the left of Fossen's equation.

    `down` (3,) is the NED down axis in body axes, `depth` [m] that of the CB, `moment` [kg m]
    the first moment of the masses about the CB, `displaced_mass` [kg] = density * volume when
    fully immersed. Weight acts at the masses, buoyancy on the strips. Fossen 2011, section 4.1.
    """
    g = np.zeros(6)
    immersed = 0.0
    lever = 0.0
    for strip in range(STRIPS):
        x, fraction = strip_immersion(p, depth, down[0], strip)
        immersed += fraction
        lever += fraction * x
    immersion = immersed / STRIPS
    arm = displaced_mass * p.gravity * lever / STRIPS
    for i in range(3):
        g[i] = p.gravity * (displaced_mass * immersion - p.mass) * down[i]
    # Weight: first moment x down; buoyancy: (arm, 0, 0) x (-down).
    g[3] = -p.gravity * (moment[1] * down[2] - moment[2] * down[1])
    g[4] = -p.gravity * (moment[2] * down[0] - moment[0] * down[2]) - arm * down[2]
    g[5] = -p.gravity * (moment[0] * down[1] - moment[1] * down[0]) + arm * down[1]
    return g, immersion


@jit
def density_at(p: Parameters, depth: float) -> float:
    """Density [kg/m3] from the table, linear between its rows, constant beyond its ends."""
    depths, values = p.density_depth, p.density_value
    last = depths.size - 1
    if depth <= depths[0]:
        return values[0]
    if depth >= depths[last]:
        return values[last]
    row = np.searchsorted(depths, depth)
    part = (depth - depths[row - 1]) / (depths[row] - depths[row - 1])
    return values[row - 1] + part * (values[row] - values[row - 1])


@jit
def displaced_mass(p: Parameters, depth: float, pump: float) -> float:
    """Mass of the water that the fully immersed hull displaces [kg]; pump in cm3.

    The hull shrinks in proportion to the pressure of water of the reference density.
    """
    pressure = p.reference_density * p.gravity * depth
    volume = (p.neutral_volume + 1e-6 * pump) * (1.0 - p.hull_compressibility * pressure)
    return density_at(p, depth) * volume
