"""Flow-frame law: lift, drag and moments of angle of attack and sideslip, times speed squared.

For speed V through the water, angle of attack alpha and sideslip beta (S. Zhang, J. Yu, A. Zhang,
F. Zhang, Ocean Engineering 60 (2013) 1-13), with a_L = alpha + K_L0 / K_alpha, the angle of attack
relative to zero lift:

    D  = (K_D0 + K_D alpha^2) V^2          L  = (K_L0 + K_alpha alpha) V^2
    SF = (K_beta + K_beta_lift a_L) beta V^2
    T1 = (K_W a_L + (K_MR + K_MR_lift a_L) beta + K_p p + (K_pr + K_pr_lift a_L) r) V^2
    T2 = (K_M0 + K_M alpha + K_q q) V^2
    T3 = (K_MY0 + (K_MY + K_MY_lift a_L) beta + K_r r + (K_rp + K_rp_lift a_L) p) V^2

(-D, SF, -L) and (T1, T2, T3) are turned from flow to body axes. The terms with a_L are ours. In
sideslip, the force of wings changes sign with their lift and that of a fin does not; the paper's
dives cannot separate the two. K_MY0, the yaw moment of a hull with unequal sides, and K_W, the roll
moment of wings with unequal lift, are ours too. All of these are 0 in vehicles as printed. Outside
the identified range of the flow angles the terms blend into a law of the whole sphere, also ours:
see docs/physics/equations.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeGuard

import numpy as np
from numpy.typing import NDArray

from twin.compiled import elementary, inline, jit
from twin.compiled.elementary import scalar
from twin.vehicle.changes import Uncertainty, coefficient
from twin.vehicle.laws.base import HullLaw, Polar

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

Array = NDArray[np.float64]

# indices into the values
K_D0, K_D, K_L0, K_ALPHA, K_BETA, K_MR, K_P, K_M0, K_M, K_Q, K_MY, K_R = range(12)
K_BETA_LIFT, K_MR_LIFT, K_MY_LIFT, K_PR, K_PR_LIFT, K_RP, K_RP_LIFT, K_MY0, K_W = range(12, 21)
ZERO_LIFT, LINEAR, BLEND, SLOWEST, CROSS_FLOW = range(21, 26)


# --- kernels of the MuJoCo twin ----------------------------------------------------------------


@inline
def _blend(angle, linear, full):  # type: ignore[no-untyped-def]
    """Weight: 0 inside the identified range, 1 where the whole-sphere law holds, cubic between."""
    x = min(max((abs(angle) - linear) / (full - linear), 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@jit
def native_wrench(c, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Force [N] and moment [N m] at velocity (u, v, w) through the water and rates (p, q, r)."""
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
    lift_angle = alpha + c[ZERO_LIFT]
    floor = c[SLOWEST]
    damping2 = max(speed2, floor * floor)
    d1 = c[K_P] * p * damping2
    d2 = c[K_Q] * q * damping2
    d3 = c[K_R] * r * damping2

    drag = (c[K_D0] + c[K_D] * alpha * alpha) * speed2
    side = (c[K_BETA] + c[K_BETA_LIFT] * lift_angle) * beta * speed2
    lift = (c[K_L0] + c[K_ALPHA] * alpha) * speed2
    t1 = (c[K_MR] + c[K_MR_LIFT] * lift_angle) * beta * speed2 + d1
    t2 = (c[K_M0] + c[K_M] * alpha) * speed2 + d2
    t3 = (c[K_MY] + c[K_MY_LIFT] * lift_angle) * beta * speed2 + d3
    t1 += (c[K_PR] + c[K_PR_LIFT] * lift_angle) * r * damping2
    t3 += (c[K_RP] + c[K_RP_LIFT] * lift_angle) * p * damping2
    t3 += c[K_MY0] * speed2
    t1 += c[K_W] * lift_angle * speed2
    l = ca * cb * t1 - ca * sb * t2 - sa * t3
    m = sb * t1 + cb * t2
    n = sa * cb * t1 - sa * sb * t2 + ca * t3

    if abs(alpha) > linear or abs(beta) > linear:
        s = max(_blend(alpha, linear, full), _blend(beta, linear, full))
        k = 1.0 - s
        # direction of the flow in body axes
        fx, fy, fz = ca * cb, sb, sa * cb
        drag = k * drag + s * (c[K_D0] + c[CROSS_FLOW] * (fy * fy + fz * fz)) * speed2
        side = k * side + s * c[K_BETA] * sb * cb * speed2
        lift = k * lift + s * (c[K_L0] + c[K_ALPHA] * fz) * fx * speed2
        # moments without work around any closed turn: flow x gradient of a potential
        roll = -(c[K_M0] + (c[K_M] + c[K_MY]) * fz) * fy - c[K_MY0] * fz
        l = k * l + s * (roll * speed2 + d1)
        m = k * m + s * ((c[K_M0] + c[K_M] * fz) * fx * speed2 + d2)
        n = k * n + s * (c[K_MY] * fx * fy * speed2 + c[K_MY0] * fx * speed2 + d3)

    x = -ca * cb * drag - ca * sb * side + sa * lift
    y = -sb * drag + cb * side
    z = -sa * cb * drag - sa * sb * side - ca * lift
    return x, y, z, l, m, n


@inline
def native_rate_damping(c, timestep, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Time step times K_p, K_q, K_r V^2."""
    stiff = timestep * (u * u + v * v + w * w)
    return c[K_P] * stiff, c[K_Q] * stiff, c[K_R] * stiff


@inline
def native_rotary_damping(c, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Damping of the rates' moments, turned from flow to body axes as in `native_wrench`."""
    speed2 = u * u + v * v + w * w
    speed, in_plane = math.sqrt(speed2), math.sqrt(u * u + w * w)
    ca, sa, cb, sb = 1.0, 0.0, 1.0, 0.0
    if speed > 1e-9:
        sb, cb = v / speed, in_plane / speed
        if in_plane > 1e-12:
            ca, sa = u / in_plane, w / in_plane
    damping2 = -max(speed2, c[SLOWEST] * c[SLOWEST])
    roll, pitch, yaw = c[K_P] * damping2, c[K_Q] * damping2, c[K_R] * damping2
    by_yaw, by_roll = c[K_PR] * damping2, c[K_RP] * damping2
    if c[K_PR_LIFT] != 0.0 or c[K_RP_LIFT] != 0.0:
        lift_angle = (math.atan2(sa, ca) + c[ZERO_LIFT]) * damping2
        by_yaw += c[K_PR_LIFT] * lift_angle
        by_roll += c[K_RP_LIFT] * lift_angle
    pp, qq, rr = ca * cb * roll - sa * by_roll, cb * pitch, ca * yaw + sa * cb * by_yaw
    pq = 0.5 * (sb * roll - ca * sb * pitch)
    pr = 0.5 * (ca * cb * by_yaw - sa * yaw + sa * cb * roll + ca * by_roll)
    qr = 0.5 * (sb * by_yaw - sa * sb * pitch)
    # cheap test for small angles: a sine is 1 % less than its angle at a quarter of a radian
    if ca < 0.9 or max(abs(sa), abs(sb)) > 0.9 * c[LINEAR]:
        linear, full = c[LINEAR], c[BLEND]
        beta = math.asin(min(max(sb, -1.0), 1.0))
        s = max(_blend(math.atan2(sa, ca), linear, full), _blend(beta, linear, full))
        k = 1.0 - s
        pp, qq, rr = k * pp + s * roll, k * qq + s * pitch, k * rr + s * yaw
        pq, pr, qr = k * pq, k * pr, k * qr
    return pp, pq, qq, pr, qr, rr


# --- kernels of the Fossen model ----------------------------------------------------------------


@scalar
def beyond_identified(angle, linear_angle, blend_angle):  # type: ignore[no-untyped-def]
    """Weight of the whole-sphere law: 0 up to `linear_angle`, 1 from `blend_angle` on."""
    x = (abs(angle) - linear_angle) / (blend_angle - linear_angle)
    x = min(max(x, 0.0), 1.0)
    return 3.0 * x * x - 2.0 * x * x * x


@scalar
def _to_body(ca, sa, cb, sb, flow):  # type: ignore[no-untyped-def]
    """Turn a vector by R_BC, from flow to body axes, given the angles' cosines and sines."""
    return (
        ca * cb * flow[0] - ca * sb * flow[1] - sa * flow[2],
        sb * flow[0] + cb * flow[1],
        sa * cb * flow[0] - sa * sb * flow[1] + ca * flow[2],
    )


@scalar
def fossen_wrench(c, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Wrench -D(nu_r) nu_r: force [N] and moment [N m] about the CB, body FRD.

    R_BC, by angle of attack and sideslip, turns the flow frame's force (-D, SF, -L) and moment
    (T1, T2, T3) to body axes (Zhang et al. 2013). Outside the identified range the moments blend
    into body axes: in reversed flow, R_BC would make roll and yaw damping accelerate the rates.
    There the moment of the flow is e x grad Phi, with e the direction of the motion and
    Phi = -K_M0 e_z - K_M e_z^2 / 2 + K_MY0 e_y + K_MY e_y^2 / 2. This moment does no work around
    any closed turn of the hull; near (1, 0, 0) it is K_M0 + K_M alpha in pitch and
    K_MY0 + K_MY beta in yaw.
    """
    square = u * u + v * v + w * w
    speed = math.sqrt(square)
    still = not speed > 0.0
    ex = 1.0 if still else u / speed
    ey, ez = 0.0 if still else v / speed, 0.0 if still else w / speed
    # sines and cosines of angle of attack and sideslip from the direction e
    cb, sb = math.sqrt(ex * ex + ez * ez), ey
    across = not cb > 0.0
    ca, sa = 1.0 if across else ex / cb, 0.0 if across else ez / cb
    alpha, beta = elementary.atan2(ez, ex), elementary.atan2(sb, cb)
    turning = max(square, c[SLOWEST] * c[SLOWEST])
    from_zero_lift = alpha + c[ZERO_LIFT]
    s = max(
        beyond_identified(alpha, c[LINEAR], c[BLEND]), beyond_identified(beta, c[LINEAR], c[BLEND])
    )
    # published law, inside the identified range
    drag = c[K_D0] + c[K_D] * alpha * alpha
    side = (c[K_BETA] + c[K_BETA_LIFT] * from_zero_lift) * beta
    lift = c[K_L0] + c[K_ALPHA] * alpha
    t1 = (c[K_MR] + c[K_MR_LIFT] * from_zero_lift) * beta * square + turning * (
        c[K_P] * p + (c[K_PR] + c[K_PR_LIFT] * from_zero_lift) * r
    )
    t2 = (c[K_M0] + c[K_M] * alpha) * square + turning * (c[K_Q] * q)
    t3 = (c[K_MY] + c[K_MY_LIFT] * from_zero_lift) * beta * square + turning * (
        c[K_R] * r + (c[K_RP] + c[K_RP_LIFT] * from_zero_lift) * p
    )
    t3 += c[K_MY0] * square
    t1 += c[K_W] * from_zero_lift * square
    # law of the whole sphere
    all_drag = c[K_D0] + c[CROSS_FLOW] * (1.0 - ex * ex)
    all_side = c[K_BETA] * sb * cb
    all_lift = (c[K_L0] + c[K_ALPHA] * ez) * ex
    gy, gz = c[K_MY] * ey + c[K_MY0], -c[K_M0] - c[K_M] * ez
    one = 1.0 - s
    force = (
        -square * (one * drag + s * all_drag),
        square * (one * side + s * all_side),
        -square * (one * lift + s * all_lift),
    )
    x, y, z = _to_body(ca, sa, cb, sb, force)
    k, m, n = _to_body(ca, sa, cb, sb, (t1, t2, t3))
    k = one * k + s * (square * (ey * gz - ez * gy) + turning * c[K_P] * p)
    m = one * m + s * (-square * ex * gz + turning * c[K_Q] * q)
    n = one * n + s * (square * ex * gy + turning * c[K_R] * r)
    return x, y, z, k, m, n


@scalar
def fossen_rate_damping(c, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Rate damping -K_p V^2, -K_q V^2, -K_r V^2 in body axes; products of small angles omitted."""
    turning = max(u * u + v * v + w * w, c[SLOWEST] * c[SLOWEST])
    return -c[K_P] * turning, -c[K_Q] * turning, -c[K_R] * turning


# --- the coefficients -------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class FlowFrame(HullLaw):
    """Identified coefficients in the flow frame, as glider papers print them."""

    kind: ClassVar[str] = "flow-frame"
    native_wrench = staticmethod(native_wrench)
    native_rate_damping = staticmethod(native_rate_damping)
    native_rotary_damping = staticmethod(native_rotary_damping)
    fossen_wrench = staticmethod(fossen_wrench)
    fossen_rate_damping = staticmethod(fossen_rate_damping)

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
    side_force_lift: tuple[float] = (0.0,)
    """K_beta_lift [kg/m/rad2]"""
    roll_moment_lift: tuple[float] = (0.0,)
    """K_MR_lift [kg/rad2]"""
    yaw_moment_lift: tuple[float] = (0.0,)
    """K_MY_lift [kg/rad2]"""
    roll_from_yaw: tuple[float, float] = (0.0, 0.0)
    """K_pr [kg s/rad] of a fin; K_pr_lift [kg s/rad2] of wings"""
    yaw_from_roll: tuple[float, float] = (0.0, 0.0)
    """K_rp [kg s/rad] of a fin; K_rp_lift [kg s/rad2] of wings"""
    yaw_moment_offset: tuple[float] = (0.0,)
    """K_MY0 [kg] of a hull with unequal sides: positive turns it to starboard"""
    wing_asymmetry: tuple[float] = (0.0,)
    """K_W [kg/rad] of wings with unequal lift: positive if the port wing lifts more"""
    linear_angle: float
    """[rad] Largest flow angle at which the published law holds as printed."""
    blend_angle: float
    """[rad] Flow angle from which the law of the whole sphere holds alone."""
    rate_damping_min_speed: float
    """[m/s] Lower bound of the speed in the rate damping."""
    identified_angle: float = 0.0
    """[rad] Angle of attack relative to zero lift in the glides that identified the coefficients;
    0: unknown."""
    cross_flow_drag: float = 0.0
    """[kg/m] Drag of the hull across the flow, minus K_D0, beyond the identified angles; 0: K_D,
    which is too small if it was measured at small angles."""

    @classmethod
    def read(cls, reader: MjcfReader) -> Self:
        """Read the `<numeric>` elements with the fields' names."""
        fields: dict[str, Any] = {}
        for field, size in _SIZES.items():
            default = (0.0,) * size if field in _OPTIONAL_FIELDS else None
            fields[field] = reader.numeric(field, size, default)
        for field in ("linear_angle", "blend_angle", "rate_damping_min_speed"):
            fields[field] = reader.number(field)
        for field in ("identified_angle", "cross_flow_drag"):
            fields[field] = reader.number(field, default=0.0)
        return cls(**fields)

    def problems(self) -> list[tuple[str, str]]:
        """Report drag or damping that would propel, no lift slope, wrong angles or speed."""
        found = []
        for name in ("drag", "cross_flow_drag"):
            if np.min(getattr(self, name)) < 0.0:
                found.append((name, "at least 0: drag never drives"))
        split = any(any(getattr(self, name)) for name in _LIFT_FIELDS)
        if self.lift[1] < 0.0 or (split and self.lift[1] == 0.0):
            found.append(("lift", "a pair with a positive slope K_alpha"))
        if max(self.roll_moment[1], self.pitch_moment[2], self.yaw_moment[1]) > 0.0:
            found.append(("K_p, K_q, K_r", "at most 0: damping never drives"))
        else:
            widest = self.linear_angle + abs(self.zero_lift)
            for angle in (-widest, widest):
                cross = sum(a + b * angle for a, b in (self.roll_from_yaw, self.yaw_from_roll))
                if cross * cross > 4.0 * self.roll_moment[1] * self.yaw_moment[1] + 1e-12:
                    rule = "so small that K_p and K_r damp: (K_pr + K_rp)^2 <= 4 K_p K_r"
                    found.append(("roll_from_yaw, yaw_from_roll", rule))
                    break
        if self.rate_damping_min_speed < 0:
            found.append(("rate_damping_min_speed", "at least 0"))
        if not 0 < self.linear_angle < self.blend_angle <= math.pi / 2:
            rule = "ordered as 0 < linear_angle < blend_angle <= pi/2"
            found.append(("linear_angle, blend_angle", rule))
        if not 0.0 <= self.identified_angle < math.pi / 2:
            found.append(("identified_angle", "between 0 and pi/2"))
        return found

    def values(self) -> Array:
        """Coefficients in the order of K_D0 to CROSS_FLOW."""
        coefficients = [value for field in _SIZES for value in getattr(self, field)]
        angles = (self.zero_lift, self.linear_angle, self.blend_angle)
        others = (*angles, self.rate_damping_min_speed, self.cross_flow_drag or self.drag[1])
        return np.array([*coefficients, *others], dtype=np.float64)

    def polar(self, alpha: float, density: float) -> Polar:
        """Published law: K_D0 + K_D alpha^2, K_L0 + K_alpha alpha, K_M0 + K_M alpha."""
        if not is_flow_frame(self):
            return super().polar(alpha, density)
        return Polar(
            self.drag[0] + self.drag[1] * alpha**2,
            self.lift[0] + self.lift[1] * alpha,
            self.pitch_moment[0] + self.pitch_moment[1] * alpha,
        )

    @property
    def zero_lift(self) -> float:
        """K_L0 / K_alpha [rad]: minus the angle of attack at zero lift."""
        return self.lift[0] / self.lift[1] if self.lift[1] else 0.0

    @property
    def _split_unknown(self) -> bool:
        """True when the file does not give the wings' share of the roll moment of sideslip."""
        return self.identified_angle > 0.0 and self.roll_moment_lift == (0.0,)

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Coefficients in the file, and the wings' share of the roll moment where unknown."""
        values = dict(zip(COEFFICIENT_NAMES, self.values(), strict=False))
        found = [
            coefficient(name, what)
            for name, what, field in COEFFICIENTS
            if field not in _OPTIONAL_FIELDS or values[name] != 0.0
        ]
        if self._split_unknown:
            found.append(ROLL_LIFT_SHARE)
        return tuple(found)

    def scaled(self, factors: Mapping[str, float]) -> Self:
        """Return a copy with coefficients times factors, by COEFFICIENTS' names; others stay."""
        fields: dict[str, Any] = {}
        for name, _, field in COEFFICIENTS:
            values = fields.setdefault(field, [])
            values.append(getattr(self, field)[len(values)] * factors.get(name, 1.0))
        changes: dict[str, Any] = {name: tuple(values) for name, values in fields.items()}
        share = factors.get(ROLL_LIFT_SHARE.name, 0.0)
        if share != 0.0:
            moment, damping = changes["roll_moment"]
            changes["roll_moment"] = ((1.0 - share) * moment, damping)
            changes["roll_moment_lift"] = (share * moment / self.identified_angle,)
        return dataclasses.replace(self, **changes)

    def with_drag(self, factor: float) -> Self:
        """Return a copy with K_D0 times the factor; induced and cross-flow drag stay."""
        first, second = self.drag
        across = self.cross_flow_drag or second
        return dataclasses.replace(self, drag=(first * factor, second), cross_flow_drag=across)

    @property
    def turns_by_itself(self) -> bool:
        """True when the hull has a yaw moment, or its wings a roll moment, at zero sideslip."""
        return self.yaw_moment_offset != (0.0,) or self.wing_asymmetry != (0.0,)

    @property
    def valid_angle(self) -> float:
        """Largest angle [rad] at which the law holds as printed: `linear_angle`."""
        return self.linear_angle


def is_flow_frame(law: HullLaw) -> TypeGuard[FlowFrame]:
    """Tell whether both models compute a law by the kernels of this module.

    A derived law with kernels of its own returns False: its coefficients mean other forces than
    identification, filters and polars assume.
    """
    kernels = type(law).native_wrench, type(law).fossen_wrench
    return isinstance(law, FlowFrame) and kernels == (native_wrench, fossen_wrench)


ROLL_LIFT_SHARE = Uncertainty(
    name="roll_lift_share",
    certain=0.0,
    spread="uniform(0.8, 1)",
    known=True,
    long_name="wings' part of the roll moment of sideslip",
    why="it changes sign with lift: the turns of 7 Seagliders and a SeaExplorer in dives and "
    "climbs show most of it to be theirs",
)
"""Wings' share of the roll moment, for vehicles with coefficients identified in dives alone."""
_LIFT_FIELDS = (
    "side_force_lift", "roll_moment_lift", "yaw_moment_lift", "roll_from_yaw", "yaw_from_roll",
)  # fmt: skip
_OPTIONAL_FIELDS = (*_LIFT_FIELDS, "yaw_moment_offset", "wing_asymmetry")
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
    ("k_beta_lift", "side force of lifting wings", "side_force_lift"),
    ("k_mr_lift", "roll moment of lifting wings", "roll_moment_lift"),
    ("k_my_lift", "yaw moment of lifting wings", "yaw_moment_lift"),
    ("k_pr", "roll moment of yaw rate, fin", "roll_from_yaw"),
    ("k_pr_lift", "roll moment of yaw rate, lifting wings", "roll_from_yaw"),
    ("k_rp", "yaw moment of roll rate, fin", "yaw_from_roll"),
    ("k_rp_lift", "yaw moment of roll rate, lifting wings", "yaw_from_roll"),
    ("k_my0", "yaw moment at zero sideslip", "yaw_moment_offset"),
    ("k_w", "roll moment of wings that do not lift alike", "wing_asymmetry"),
)
"""Name, meaning and field of each coefficient, in the order of the values."""
COEFFICIENT_NAMES = tuple(name for name, _, _ in COEFFICIENTS)
_SIZES = Counter(field for _, _, field in COEFFICIENTS)
"""Number of coefficients in each field."""
