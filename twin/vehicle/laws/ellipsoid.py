"""Ellipsoid law: MuJoCo's drag, lift and added mass of ellipsoids, from the geometry alone.

The formulas are in the fluid chapter of MuJoCo's documentation, here with the motion through the
water. The geoms are the hull's with `fluidshape="ellipsoid"`; their added mass replaces any in the
vehicle file. The Fossen model computes the same forces in separate vector code, after Andersen,
Pesavento and Wang (2005) and Lamb (1932, article 114), which MuJoCo cites.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from twin.compiled import inline, jit
from twin.vehicle.changes import Uncertainty, coefficient
from twin.vehicle.laws.base import HullLaw

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

Array = NDArray[np.float64]
ROW = 27
"""Numbers of a geom: place 3, rotation 9, semi-axes 3, MuJoCo's 12 fluid coefficients; hull axes
(x forward, y port, z up)."""
HEAD = 4
"""Numbers before the geoms: viscosity, and roll, pitch, yaw damping / speed squared."""
SEAWATER_VISCOSITY = 1.4e-3
"""[Pa s] Dynamic viscosity of sea water at about 10 degC."""


@jit
def _largest_moment(along, side1, side2):  # type: ignore[no-untyped-def]
    """Moment integral of a disc of the larger side radius swept along an axis (MuJoCo's bound)."""
    widest = max(side1, side2)
    return 8.0 / 15.0 * math.pi * along * widest**4


@jit
def native_wrench(c, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Viscous and circulatory force [N] and moment [N m]; added mass is in the mass matrix."""
    viscosity = c[0]
    # hull axes: x forward, y port, z up
    v, w, q, r = -v, -w, -q, -r
    fx, fy, fz, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range((c.size - HEAD) // ROW):
        g = c[HEAD + k * ROW : HEAD + (k + 1) * ROW]
        x, y, z = g[0], g[1], g[2]
        # velocity of the geom's centre through the water, then into the geom's axes
        ux, uy, uz = u + q * z - r * y, v + r * x - p * z, w + p * y - q * x
        v0 = g[3] * ux + g[6] * uy + g[9] * uz
        v1 = g[4] * ux + g[7] * uy + g[10] * uz
        v2 = g[5] * ux + g[8] * uy + g[11] * uz
        w0 = g[3] * p + g[6] * q + g[9] * r
        w1 = g[4] * p + g[7] * q + g[10] * r
        w2 = g[5] * p + g[8] * q + g[11] * r
        a0, a1, a2 = g[12], g[13], g[14]
        scale, blunt, slender, angular, kutta, magnus = g[15], g[16], g[17], g[18], g[19], g[20]
        speed = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        # gradient of the ellipsoid's surface for the flow direction: gives the projected area
        n0, n1, n2 = (a1 * a2) ** 2 * v0, (a2 * a0) ** 2 * v1, (a0 * a1) ** 2 * v2
        along = n0 * v0 + n1 * v1 + n2 * v2
        normal2 = n0 * n0 + n1 * n1 + n2 * n2
        projected = math.pi * math.sqrt(normal2 / max(along, 1e-15))
        cosine = along / max(speed * normal2, 1e-15)
        longest, shortest = max(a0, a1, a2), min(a0, a1, a2)
        middle = a0 + a1 + a2 - longest - shortest
        broadside = math.pi * longest * middle
        # Kutta: circulation (n x v), lift along (n x v) x v
        lift = kutta * density * cosine * projected
        c0, c1, c2 = n1 * v2 - n2 * v1, n2 * v0 - n0 * v2, n0 * v1 - n1 * v0
        spin = magnus * density * 4.0 / 3.0 * math.pi * a0 * a1 * a2
        sphere = 2.0 / 3.0 * (a0 + a1 + a2)
        linear = viscosity * 3.0 * math.pi * sphere + density * speed * (
            blunt * projected + slender * (broadside - projected)
        )
        f0 = spin * (w1 * v2 - w2 * v1) + lift * (c1 * v2 - c2 * v1) - linear * v0
        f1 = spin * (w2 * v0 - w0 * v2) + lift * (c2 * v0 - c0 * v2) - linear * v1
        f2 = spin * (w0 * v1 - w1 * v0) + lift * (c0 * v1 - c1 * v0) - linear * v2
        widest = 8.0 / 15.0 * math.pi * middle * longest**4
        i0 = _largest_moment(a0, a1, a2)
        i1 = _largest_moment(a1, a2, a0)
        i2 = _largest_moment(a2, a0, a1)
        h0 = w0 * (angular * i0 + slender * (widest - i0))
        h1 = w1 * (angular * i1 + slender * (widest - i1))
        h2 = w2 * (angular * i2 + slender * (widest - i2))
        rotary = viscosity * math.pi * sphere**3 + density * math.sqrt(h0 * h0 + h1 * h1 + h2 * h2)
        t0, t1, t2 = -rotary * w0, -rotary * w1, -rotary * w2
        # back to hull axes at the CB
        gx = scale * (g[3] * f0 + g[4] * f1 + g[5] * f2)
        gy = scale * (g[6] * f0 + g[7] * f1 + g[8] * f2)
        gz = scale * (g[9] * f0 + g[10] * f1 + g[11] * f2)
        fx += gx
        fy += gy
        fz += gz
        mx += scale * (g[3] * t0 + g[4] * t1 + g[5] * t2) + y * gz - z * gy
        my += scale * (g[6] * t0 + g[7] * t1 + g[8] * t2) + z * gx - x * gz
        mz += scale * (g[9] * t0 + g[10] * t1 + g[11] * t2) + x * gy - y * gx
    return fx, -fy, -fz, mx, -my, -mz


@inline
def native_rate_damping(c, timestep, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Time step times speed squared times the rate damping from the file's coefficients.

    A file without those coefficients gets -1e300, which turns extrapolation of rates off.
    """
    stiff = timestep * (u * u + v * v + w * w)
    if c[1] == 0.0 and c[2] == 0.0 and c[3] == 0.0:
        return -1e300, -1e300, -1e300
    return c[1] * stiff, c[2] * stiff, c[3] * stiff


@jit
def _ellipsoid_force(g, density, viscosity, flow, spin):  # type: ignore[no-untyped-def]
    """Return (force, moment) on one ellipsoid in its own axes, at velocity `flow`, rates `spin`."""
    axes = g[12:15]
    product = axes[0] * axes[1] * axes[2]
    blunt, slender, angular, kutta, magnus = g[16], g[17], g[18], g[19], g[20]
    speed = np.sqrt(np.sum(flow**2))
    order = np.sort(axes)
    broadside = np.pi * order[2] * order[1]
    equivalent = 2.0 * (axes[0] + axes[1] + axes[2]) / 3.0
    resistance = 3.0 * np.pi * viscosity * equivalent
    force = np.zeros(3)
    if speed > 0.0:
        course = flow / speed
        # surface gradient where the flow is tangent, weighted: a_j^2 a_k^2 v_i
        weighted = (product / axes) ** 2 * course
        shadow = np.pi * np.sqrt(np.sum(weighted**2) / np.sum(weighted * course))
        incidence = np.sum(weighted * course) / np.sum(weighted**2)
        circulation = np.cross(weighted, flow)
        force += kutta * density * incidence * shadow * np.cross(circulation, flow)
        resistance += density * speed * (blunt * shadow + slender * (broadside - shadow))
    force += magnus * density * (4.0 / 3.0) * np.pi * product * np.cross(spin, flow)
    force -= resistance * flow
    largest = 8.0 / 15.0 * np.pi * order[1] * order[2] ** 4
    swept = np.empty(3)
    for i in range(3):
        others = max(axes[(i + 1) % 3], axes[(i + 2) % 3])
        swept[i] = 8.0 / 15.0 * np.pi * axes[i] * others**4
    momentum = spin * (angular * swept + slender * (largest - swept))
    drag = density * np.sqrt(np.sum(momentum**2)) + viscosity * np.pi * equivalent**3
    return force, -drag * spin


@jit
def fossen_wrench(c, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Sum the forces of all ellipsoids about the CB, body FRD."""
    flip = np.array([1.0, -1.0, -1.0])
    velocity, rates = flip * np.array([u, v, w]), flip * np.array([p, q, r])
    force, moment = np.zeros(3), np.zeros(3)
    for k in range((c.size - HEAD) // ROW):
        g = c[HEAD + k * ROW : HEAD + (k + 1) * ROW]
        place = g[:3].copy()
        turn = g[3:12].copy().reshape((3, 3))
        here = velocity + np.cross(rates, place)
        flow, spin = np.zeros(3), np.zeros(3)
        for i in range(3):
            for j in range(3):
                flow[i] += turn[j, i] * here[j]
                spin[i] += turn[j, i] * rates[j]
        own_force, own_moment = _ellipsoid_force(g, density, c[0], flow, spin)
        f, t = np.zeros(3), np.zeros(3)
        for i in range(3):
            for j in range(3):
                f[i] += g[15] * turn[i, j] * own_force[j]
                t[i] += g[15] * turn[i, j] * own_moment[j]
        force += f
        moment += t + np.cross(place, f)
    force, moment = flip * force, flip * moment
    return force[0], force[1], force[2], moment[0], moment[1], moment[2]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Ellipsoids(HullLaw):
    """Ellipsoids that represent a hull and its wings."""

    kind: ClassVar[str] = "ellipsoid"
    density_in_coefficients: ClassVar[bool] = False
    native_wrench = staticmethod(native_wrench)
    native_rate_damping = staticmethod(native_rate_damping)
    fossen_wrench = staticmethod(fossen_wrench)
    not_in_lanes: ClassVar[str] = "its ellipsoids are MuJoCo's own"

    geoms: Array
    """Shape (n, 27): place [m] 3, rotation to hull axes 9, semi-axes [m] 3, MuJoCo's 12 fluid
    coefficients; hull axes x forward, y port, z up."""
    viscosity: float = SEAWATER_VISCOSITY
    """[Pa s] Dynamic viscosity of the water."""
    rate_damping: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[kg s/rad2] K_p, K_q, K_r of the file's own coefficients; a time-centred step extrapolates
    the rates by them. 0: no extrapolation of rates."""

    @classmethod
    def read(cls, reader: MjcfReader) -> Self:
        """Read the hull's geoms with fluidshape="ellipsoid", as MuJoCo compiles them."""
        geoms = fluid_geoms(reader.xml)
        if not len(geoms):
            reader.fail(
                "the hull law 'ellipsoid'",
                "given by geoms with fluidshape='ellipsoid' on body 'hull'; add one, or use "
                "another law (--hydrodynamics coefficients)",
            )
        moments = {"roll_moment": 2, "pitch_moment": 3, "yaw_moment": 2}
        damping = (0.0, 0.0, 0.0)
        if all(name in reader.numerics for name in moments):
            roll, pitch, yaw = (reader.numeric(name, n)[-1] for name, n in moments.items())
            damping = (roll, pitch, yaw)
        return cls(geoms=geoms, rate_damping=damping)

    def values(self) -> Array:
        """Viscosity, rate damping, then the geoms one after the other."""
        return np.concatenate([[self.viscosity, *self.rate_damping], np.ravel(self.geoms)])

    def added_mass(self, reference_density: float) -> Array:
        """M_A (6, 6), FRD about the CB, summed over MuJoCo's virtual masses of each geom."""
        total = np.zeros((6, 6))
        for row in self.geoms:
            rotation = row[3:12].reshape(3, 3)
            x, y, z = row[:3]
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            # velocity at the geom in its own axes = R^T (v + omega x r); spin = R^T omega
            jacobian = np.zeros((6, 6))
            jacobian[:3, :3] = rotation.T
            jacobian[:3, 3:] = -rotation.T @ cross
            jacobian[3:, 3:] = rotation.T
            virtual = reference_density * row[15] * np.concatenate([row[21:24], row[24:27]])
            total += jacobian.T @ np.diag(virtual) @ jacobian
        signs = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
        return total * np.outer(signs, signs)

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """MuJoCo's fluid coefficients, each as one factor for all geoms."""
        return tuple(coefficient(name, what) for name, what, _ in COEFFICIENTS)

    def scaled(self, factors: Mapping[str, float]) -> Self:
        """Return a copy with fluid coefficients times the factors, by the names of COEFFICIENTS."""
        geoms = np.array(self.geoms)
        for name, _, column in COEFFICIENTS:
            geoms[:, column] *= factors[name]
        return dataclasses.replace(self, geoms=geoms)


COEFFICIENTS = (
    ("blunt_drag", "drag across the flow", 16),
    ("slender_drag", "drag along the flow", 17),
    ("angular_drag", "drag of turning", 18),
    ("kutta_lift", "lift of circulation", 19),
    ("magnus_lift", "lift of spin", 20),
)
"""Name, meaning and column of each fluid coefficient in `Ellipsoids.geoms`."""


def fluid_geoms(xml: str) -> Array:
    """Read the hull's ellipsoid fluid geoms from a vehicle file, shape (n, ROW), hull axes.

    Raises:
      ValueError: MuJoCo cannot compile the text.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(xml)
    hull, rows = model.body("hull").id, []
    for geom in np.flatnonzero(model.geom_bodyid == hull):
        if model.geom_fluid[geom, 0] == 0:
            continue
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        size, kind = model.geom_size[geom], model.geom_type[geom]
        if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            axes = np.full(3, size[0])
        elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            axes = np.array([size[0], size[0], size[0] + size[1]])
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            axes = np.array([size[0], size[0], size[1]])
        else:
            axes = size.copy()
        rows.append(np.concatenate([model.geom_pos[geom], rotation, axes, model.geom_fluid[geom]]))
    return np.array(rows).reshape(-1, ROW)
