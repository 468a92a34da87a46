"""Flow-frame law: lift, drag and moments of angle of attack and sideslip, times speed squared.

For speed V through the water, angle of attack alpha and sideslip beta (S. Zhang, J. Yu, A. Zhang,
F. Zhang, Ocean Engineering 60 (2013) 1-13; the coefficients carry the density of sea water):

    D = (K_D0 + K_D alpha^2) V^2    SF = K_beta beta V^2    L = (K_L0 + K_alpha alpha) V^2
    T1 = (K_MR beta + K_p p) V^2    T2 = (K_M0 + K_M alpha + K_q q) V^2
    T3 = (K_MY beta + K_r r) V^2

(-D, SF, -L) and (T1, T2, T3) turn from the flow to the body. Outside the identified range of the
flow angles the terms blend into the sines and cosines of the whole circle: ours, see
docs/physics.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from twin.compiled import inline, jit
from twin.vehicle.laws.base import HullLaw
from twin.vehicle.uncertainty import Uncertainty, coefficient

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

Array = NDArray[np.float64]

# places in the values
K_D0, K_D, K_L0, K_ALPHA, K_BETA, K_MR, K_P, K_M0, K_M, K_Q, K_MY, K_R = range(12)
LINEAR, BLEND, SLOWEST = 12, 13, 14


# --- the MuJoCo twin's ------------------------------------------------------------------------


@inline
def _blend(angle, linear, full):  # type: ignore[no-untyped-def]
    """0 inside the identified range, 1 where the cross-flow law holds: a cubic step between."""
    x = min(max((abs(angle) - linear) / (full - linear), 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@jit
def native_wrench(c, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Force [N] and moment [N m] at v_rel (u, v, w), rates (p, q, r)."""
    speed2 = u * u + v * v + w * w
    speed = math.sqrt(speed2)
    alpha, beta = 0.0, 0.0
    ca, sa, cb, sb = 1.0, 0.0, 1.0, 0.0
    if speed > 1e-9:
        alpha = math.atan2(w, u)
        in_plane = math.sqrt(u * u + w * w)
        if in_plane > 1e-12:
            ca, sa = u / in_plane, w / in_plane
        sb, cb = v / speed, in_plane / speed
        beta = math.asin(min(max(sb, -1.0), 1.0))
    linear, full = c[LINEAR], c[BLEND]
    wa, wb = 0.0, 0.0
    if abs(alpha) > linear:
        wa = _blend(alpha, linear, full)
    if abs(beta) > linear:
        wb = _blend(beta, linear, full)
    odd_a = (1.0 - wa) * alpha + wa * sa * ca
    even_a = (1.0 - wa) * alpha * alpha + wa * sa * sa
    constant_a = (1.0 - wa) + wa * ca
    odd_b = (1.0 - wb) * beta + wb * sb * cb

    drag = (c[K_D0] + c[K_D] * even_a) * speed2
    side = c[K_BETA] * odd_b * speed2
    lift = (c[K_L0] * constant_a + c[K_ALPHA] * odd_a) * speed2
    t1 = c[K_MR] * odd_b * speed2
    t2 = (c[K_M0] * constant_a + c[K_M] * odd_a) * speed2
    t3 = c[K_MY] * odd_b * speed2
    floor = c[SLOWEST]
    damping2 = max(speed2, floor * floor)
    d1 = c[K_P] * p * damping2
    d2 = c[K_Q] * q * damping2
    d3 = c[K_R] * r * damping2

    # rate moments turn from flow axes (as identified) to body axes, where they always damp
    s = max(wa, wb)
    k = 1.0 - s
    x = -ca * cb * drag - ca * sb * side + sa * lift
    y = -sb * drag + cb * side
    z = -sa * cb * drag - sa * sb * side - ca * lift
    e1, e2, e3 = t1 + k * d1, t2 + k * d2, t3 + k * d3
    l = ca * cb * e1 - ca * sb * e2 - sa * e3 + s * d1
    m = sb * e1 + cb * e2 + s * d2
    n = sa * cb * e1 - sa * sb * e2 + ca * e3 + s * d3
    return x, y, z, l, m, n


@inline
def native_rate_damping(c, timestep, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Step times K_p, K_q, K_r V^2."""
    stiff = timestep * (u * u + v * v + w * w)
    return c[K_P] * stiff, c[K_Q] * stiff, c[K_R] * stiff


# --- the Fossen model's -----------------------------------------------------------------------


@jit
def flow_functions(angle, linear_angle, blend_angle):  # type: ignore[no-untyped-def]
    """Stand for angle, angle^2 and 1, and equal them inside the identified range.

    Returns (odd, square, one, weight): beyond `blend_angle` they are sin cos, sin^2 and cos, the
    shapes of a plate in cross flow, so that the forces stay bounded on the whole circle; the
    weight of those shapes rises from 0 at `linear_angle` to 1.
    """
    x = (abs(angle) - linear_angle) / (blend_angle - linear_angle)
    x = min(max(x, 0.0), 1.0)
    s = x * x * (3.0 - 2.0 * x)
    sine, cosine = np.sin(angle), np.cos(angle)
    odd = (1.0 - s) * angle + s * sine * cosine
    square = (1.0 - s) * angle * angle + s * sine * sine
    one = (1.0 - s) + s * cosine
    return odd, square, one, s


@jit
def fossen_wrench(c, density, nu_r):  # type: ignore[no-untyped-def]
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
    alpha_odd, alpha_square, one, alpha_weight = flow_functions(alpha, c[LINEAR], c[BLEND])
    beta_odd, _, _, beta_weight = flow_functions(beta, c[LINEAR], c[BLEND])
    weight = max(alpha_weight, beta_weight)
    rate2 = max(speed, c[SLOWEST]) ** 2
    damping = np.empty(3)
    damping[0] = c[K_P] * nu_r[3] * rate2
    damping[1] = c[K_Q] * nu_r[4] * rate2
    damping[2] = c[K_R] * nu_r[5] * rate2

    flow = np.empty(6)
    flow[0] = -(c[K_D0] + c[K_D] * alpha_square) * speed2
    flow[1] = c[K_BETA] * beta_odd * speed2
    flow[2] = -(c[K_L0] * one + c[K_ALPHA] * alpha_odd) * speed2
    flow[3] = c[K_MR] * beta_odd * speed2 + (1.0 - weight) * damping[0]
    flow[4] = (c[K_M0] * one + c[K_M] * alpha_odd) * speed2 + (1.0 - weight) * damping[1]
    flow[5] = c[K_MY] * beta_odd * speed2 + (1.0 - weight) * damping[2]

    ca, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
    body = np.empty(6)
    for k in (0, 3):
        body[k] = ca * cb * flow[k] - ca * sb * flow[k + 1] - sa * flow[k + 2]
        body[k + 1] = sb * flow[k] + cb * flow[k + 1]
        body[k + 2] = sa * cb * flow[k] - sa * sb * flow[k + 1] + ca * flow[k + 2]
    for i in range(3):
        body[3 + i] += weight * damping[i]
    return body


# --- the coefficients -------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class FlowFrame(HullLaw):
    """Identified coefficients in the flow frame, as glider papers print them."""

    kind: ClassVar[str] = "flow-frame"
    native_wrench = staticmethod(native_wrench)
    native_rate_damping = staticmethod(native_rate_damping)
    fossen_wrench = staticmethod(fossen_wrench)

    drag: tuple[float, float]
    """K_D0 [kg/m], K_D [kg/m/rad2]"""
    lift: tuple[float, float]
    """K_L0 [kg/m], K_alpha [kg/m/rad]"""
    side_force: tuple[float]
    """K_beta [kg/m/rad]"""
    roll_moment: tuple[float, float]
    """K_MR [kg/rad], K_p [kg s/rad]"""
    pitch_moment: tuple[float, float, float]
    """K_M0 [kg], K_M [kg/rad], K_q [kg s/rad2]"""
    yaw_moment: tuple[float, float]
    """K_MY [kg/rad], K_r [kg s/rad2]"""
    linear_angle: float
    """[rad], the published law holds as printed up to this flow angle."""
    blend_angle: float
    """[rad], the cross-flow law holds from this flow angle on."""
    rate_damping_min_speed: float
    """[m/s], rate damping uses at least this speed."""

    @classmethod
    def read(cls, reader: MjcfReader) -> Self:
        """From the `<numeric>` elements that bear the fields' names."""
        numeric = reader.numeric
        return cls(
            drag=numeric("drag", 2),
            lift=numeric("lift", 2),
            side_force=numeric("side_force", 1),
            roll_moment=numeric("roll_moment", 2),
            pitch_moment=numeric("pitch_moment", 3),
            yaw_moment=numeric("yaw_moment", 2),
            linear_angle=numeric("linear_angle", 1)[0],
            blend_angle=numeric("blend_angle", 1)[0],
            rate_damping_min_speed=numeric("rate_damping_min_speed", 1)[0],
        )

    def problems(self) -> list[tuple[str, str]]:
        """Angles out of order, a negative speed."""
        found = []
        if self.rate_damping_min_speed < 0:
            found.append(("rate_damping_min_speed", "at least 0"))
        if not 0 < self.linear_angle < self.blend_angle <= math.pi / 2:
            found.append(
                (
                    "linear_angle, blend_angle",
                    "ordered as 0 < linear_angle < blend_angle <= pi/2",
                )
            )
        return found

    def values(self) -> Array:
        """In the order of K_D0 to SLOWEST."""
        return np.array(
            [
                *(*self.drag, *self.lift, *self.side_force),
                *(*self.roll_moment, *self.pitch_moment, *self.yaw_moment),
                *(self.linear_angle, self.blend_angle, self.rate_damping_min_speed),
            ],
            dtype=np.float64,
        )

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Every coefficient."""
        return tuple(coefficient(name, what) for name, what, _ in COEFFICIENTS)

    def scaled(self, factors: Mapping[str, float]) -> Self:
        """By the names of COEFFICIENTS."""
        fields: dict[str, Any] = {}
        for name, _, field in COEFFICIENTS:
            values = fields.setdefault(field, [])
            values.append(getattr(self, field)[len(values)] * factors[name])
        changes: dict[str, Any] = {name: tuple(values) for name, values in fields.items()}
        return dataclasses.replace(self, **changes)

    @property
    def valid_angle(self) -> float:
        """[rad] `linear_angle`."""
        return self.linear_angle


COEFFICIENTS = (
    ("k_d0", "drag at zero angle of attack", "drag"),
    ("k_d", "drag due to angle of attack", "drag"),
    ("k_l0", "lift at zero angle of attack", "lift"),
    ("k_alpha", "lift slope", "lift"),
    ("k_beta", "side force", "side_force"),
    ("k_mr", "roll moment", "roll_moment"),
    ("k_p", "roll damping", "roll_moment"),
    ("k_m0", "pitch moment at zero angle of attack", "pitch_moment"),
    ("k_m", "pitch moment", "pitch_moment"),
    ("k_q", "pitch damping", "pitch_moment"),
    ("k_my", "yaw moment", "yaw_moment"),
    ("k_r", "yaw damping", "yaw_moment"),
)
"""Name, meaning and field of each coefficient, in the order of the fields' numbers"""
