"""Turning residuals: yaw rate and roll of the lateral model less those of a log, weighted.

The model answers the inputs of the log. The fitted coefficients are numbers of the vehicle's own
size.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit
from twin.identify.calibration import Calibration
from twin.identify.lateral import Lateral, linearised, turning_part
from twin.identify.pitch import righting_arm, with_righting_arm
from twin.identify.problem import OUTLIER, correlation_samples, robust_scale
from twin.identify.turning_windows import Group, averaged
from twin.identify.unknowns import UnknownParameter
from twin.vehicle.parts import BatteryHinge, Fin


def _with_law(calibration: Calibration, **changes: object) -> Calibration:
    return calibration.replace(vehicle=calibration.vehicle.replace(**changes))


def munk_moment(calibration: Calibration) -> float:
    """[kg] that the hull's own yaw moment of sideslip has, over u v: Y_A - X_A."""
    added = calibration.vehicle.added_mass
    return float(max(added[1, 1] - added[0, 0], 1e-3 * calibration.vehicle.mass))


def _side_scale(calibration: Calibration) -> float:
    """[kg/rad] roll moment of a side force half a diameter off the axis."""
    vehicle = calibration.vehicle
    return abs(vehicle.flow_frame.side_force[0]) * 0.5 * vehicle.hull_diameter


def _set_part(calibration: Calibration, **changes: float) -> Calibration:
    part = turning_part(calibration.vehicle)
    assert part is not None
    return _with_law(calibration, **{part.name: changes})


def _with_authority(calibration: Calibration, value: float) -> Calibration:
    """The battery hung lower or higher, the righting arm of the whole kept."""
    arm = righting_arm(calibration)
    vehicle = calibration.vehicle
    eccentricity = value * vehicle.mass * arm / vehicle.battery.mass
    moved = calibration.replace(vehicle=vehicle.replace(battery={"eccentricity": eccentricity}))
    return with_righting_arm(moved, arm)


TURNING = (
    UnknownParameter(
        name="side_force",
        unit="kg m-1 rad-1",
        meaning="side force of sideslip, -K_beta",
        spread=0.4,  # hulls with and without a large fin
        logarithmic=True,
        get=lambda c: -c.vehicle.flow_frame.side_force[0],
        set=lambda c, x: _with_law(c, side_force=(-x,)),
    ),
    UnknownParameter(
        name="yaw_moment",
        unit="1",
        meaning="yaw moment of sideslip, K_MY, over the Munk moment: above 1 the fin wins",
        spread=0.5,
        get=lambda c: c.vehicle.flow_frame.yaw_moment[0] / munk_moment(c),
        set=lambda c, x: _with_law(
            c, yaw_moment=(x * munk_moment(c), c.vehicle.flow_frame.yaw_moment[1])
        ),
    ),
    UnknownParameter(
        name="yaw_moment_lift",
        unit="rad-1",
        meaning="part of the yaw moment of sideslip that is odd in lift, over the Munk moment",
        spread=4.0,  # 0.2 of the Munk moment at 3 deg
        get=lambda c: c.vehicle.flow_frame.yaw_moment_lift[0] / munk_moment(c),
        set=lambda c, x: _with_law(c, yaw_moment_lift=(x * munk_moment(c),)),
    ),
    UnknownParameter(
        name="yaw_damping",
        unit="kg s rad-1",
        meaning="yaw moment of yaw rate, -K_r",
        spread=0.6,
        logarithmic=True,
        get=lambda c: -c.vehicle.flow_frame.yaw_moment[1],
        set=lambda c, x: _with_law(c, yaw_moment=(c.vehicle.flow_frame.yaw_moment[0], -x)),
    ),
    UnknownParameter(
        name="roll_moment",
        unit="1",
        meaning="roll moment of sideslip, K_MR, over that of its side force half a diameter up",
        spread=3.0,
        get=lambda c: c.vehicle.flow_frame.roll_moment[0] / _side_scale(c),
        set=lambda c, x: _with_law(
            c, roll_moment=(x * _side_scale(c), c.vehicle.flow_frame.roll_moment[1])
        ),
    ),
    UnknownParameter(
        name="roll_moment_lift",
        unit="rad-1",
        meaning="part of the roll moment of sideslip that is odd in lift, over the same",
        spread=10.0,
        get=lambda c: c.vehicle.flow_frame.roll_moment_lift[0] / _side_scale(c),
        set=lambda c, x: _with_law(c, roll_moment_lift=(x * _side_scale(c),)),
    ),
    UnknownParameter(
        name="roll_authority",
        unit="1",
        meaning="first moment of the turning battery over that which rights the vehicle",
        spread=0.7,
        logarithmic=True,
        channel="rotation",
        get=lambda c: (
            c.vehicle.battery.mass
            * c.vehicle.battery.eccentricity
            / (c.vehicle.mass * righting_arm(c))
        ),
        set=_with_authority,
    ),
    UnknownParameter(
        name="rudder",
        unit="rad-1",
        meaning="lift slope of the rudder",
        spread=0.5,
        logarithmic=True,
        channel="fin",
        get=lambda c: getattr(turning_part(c.vehicle), "lift_slope", math.nan),
        set=lambda c, x: _set_part(c, lift_slope=x),
    ),
)
"""What a twin needs to turn as the log does."""

BIASES = ("yaw_bias", "roll_offset")
"""Fitted beside them: the asymmetry that turns a vehicle at no roll and no rudder (as the sideslip
[rad] of the same yaw moment on the bare hull), and the roll sensor's zero. What flies is the
neutral position of the turning part that balances them."""
BIAS_SPREADS = (math.radians(3.0), math.radians(5.0))


def channel_of(calibration: Calibration) -> str | None:
    """The log's channel of the turning part: "rotation", "fin", or None."""
    part = turning_part(calibration.vehicle)
    if isinstance(part, BatteryHinge):
        return "rotation"
    return "fin" if isinstance(part, Fin) else None


def yaw_rates(
    group: Group, lateral: Lateral, position: Array, yaw: float, roll_offset: float
) -> Array:
    """Yaw rate [rad/s] that the group's rolls and turning part give, (samples, windows).

    Args:
      position: of the turning part, as a linear model feels it.
      yaw: constant yaw moment [N m]. roll_offset: the roll sensor's zero [rad].
    """
    step, response = lateral.turned_by_roll(group.period)
    roll = np.sin(group.roll - roll_offset)
    inputs = np.stack([roll, group.slope, position, np.full_like(roll, yaw)], axis=-1)
    driven = 0.5 * (inputs[1:] + inputs[:-1]) @ response.T
    state = np.linalg.solve(np.eye(2) - step, response @ inputs[0].T).T
    return _march(step, np.ascontiguousarray(driven), np.ascontiguousarray(state), 1)


def rolls(group: Group, lateral: Lateral, position: Array) -> Array:
    """Roll [rad] that the battery's positions give, (samples, windows)."""
    step, response = lateral.rolled_by_part(group.period)
    driven = 0.5 * (position[1:] + position[:-1])[..., None] * response[:, 0]
    state = np.linalg.solve(np.eye(4) - step, response[:, :1] * position[0]).T
    return np.arctan(_march(step, driven, np.ascontiguousarray(state), 3))


@jit
def _march(step: Array, driven: Array, state: Array, which: int) -> Array:
    """One state of x(k + 1) = step x(k) + driven(k), (samples, windows)."""
    samples, windows, n = driven.shape
    out = np.empty((samples + 1, windows))
    x, y = np.empty(n), np.empty(n)
    for w in range(windows):
        x[:] = state[w]
        out[0, w] = x[which]
        for k in range(samples):
            for i in range(n):
                y[i] = driven[k, w, i]
                for j in range(n):
                    y[i] += step[i, j] * x[j]
            x[:] = y
            out[k + 1, w] = x[which]
    return out


def felt(calibration: Calibration, position: Array) -> Array:
    """The position as the linear model feels it: of a hinge, the rotation whose small rolls would
    be the tangent of the true ones, (a + b cos x) tan(roll) = -b sin x; of a rudder, itself."""
    if channel_of(calibration) != "rotation":
        return position
    vehicle = calibration.vehicle
    battery = vehicle.battery.mass * vehicle.battery.eccentricity
    whole = vehicle.mass * righting_arm(calibration)
    return whole * np.sin(position) / (whole - battery * (1.0 - np.cos(position)))


Array = NDArray[np.float64]

LEAST_TURN = math.radians(0.01)
"""[rad/s] that the yaw rate is off at least: compasses and the log's rounding."""
LEAST_ROLL = math.radians(0.3)
"""[rad] that the roll is off at least"""
START_YAW, START_DAMPING = (-2.0, -1.0, 0.0, 1.0), (0.0, 1.0)
"""Spreads of yaw moment and damping from the vehicle file's at which the search looks."""
STEP = 1e-3
"""Spreads of the finite differences."""
LONGEST_CORRELATION = 300.0
"""[s]"""


class TurnProblem:
    """Residuals of yaw rate and roll as a function of offsets from the start, in spreads."""

    def __init__(
        self,
        groups: Sequence[Group],
        start: Calibration,
        parameters: tuple[UnknownParameter, ...],
    ):
        self.groups, self.start, self.parameters = groups, start, parameters
        self.channel = channel_of(start)
        self.centres = np.array([p.get(start) for p in parameters])
        self.weights: list[tuple[Array, Array | None]] = []

    def calibration(self, x: Array) -> Calibration:
        """The calibration at these offsets, the biases left out."""
        out = self.start
        for parameter, centre, offset in zip(self.parameters, self.centres, x, strict=False):
            out = parameter.at(out, float(centre), float(offset))
        return out

    def biases(self, x: Array) -> tuple[float, float]:
        """Yaw bias as a sideslip, roll offset [rad]."""
        yaw, roll = x[len(self.parameters) :] * np.array(BIAS_SPREADS)
        return float(yaw), float(roll)

    def neutral(self, x: Array) -> tuple[float, dict[bool, float]] | None:
        """Position [rad] of the turning part at which the log's vehicle went straight, counted as
        the groups count: mean over them, each as long as it is, and of dives (False) and climbs
        (True) apart; None without positions."""
        calibration = self.calibration(x)
        bias, offset = self.biases(x)
        found, weights, climbing = [], [], []
        for group in self.groups:
            if group.position is None or not group.used.any():
                continue
            lateral = linearised(calibration.vehicle, group.glide)
            square = group.glide.surge**2 + group.glide.heave**2
            yaw = munk_moment(calibration) * bias * square
            step, response = lateral.turned_by_roll(group.period)
            by_roll, _, by_part, by_yaw = np.linalg.solve(np.eye(2) - step, response)[1]
            compared = np.repeat(group.used, group.count, axis=0)
            rolled = group.roll[: len(compared)][compared]
            roll, rolled_by_part = float(np.mean(rolled)), 0.0
            if self.channel == "rotation":
                given = rolls(group, lateral, felt(calibration, group.position))
                roll = float(np.median(rolled - given[: len(compared)][compared]))
                rolled_by_part = lateral.gains()[1]
            # the yaw rate, linear in the position, is 0 there
            turned = by_roll * math.sin(roll - offset) + by_yaw * yaw
            found.append(-turned / (by_part + by_roll * rolled_by_part))
            weights.append(float(group.used.sum()))
            climbing.append(group.climbing)
        if not found:
            return None
        at, share, up = np.array(found), np.array(weights), np.array(climbing)
        phases = {c: float(np.average(at[up == c], weights=share[up == c])) for c in set(climbing)}
        return float(np.average(at, weights=share)), phases

    def raw(self, x: Array) -> list[tuple[Array, Array | None]]:
        """Yaw rate [rad/s] and roll [rad], model less log, (averages, windows) of each group."""
        calibration = self.calibration(x)
        bias, offset = self.biases(x)
        out = []
        for group in self.groups:
            lateral = linearised(calibration.vehicle, group.glide)
            position = np.zeros_like(group.roll)
            if group.position is not None:
                position = felt(calibration, group.position)
            square = group.glide.surge**2 + group.glide.heave**2
            yaw = munk_moment(calibration) * bias * square
            rate = yaw_rates(group, lateral, position, yaw, offset) - group.rate
            rate = averaged(rate, group.count)
            roll = None
            if group.position is not None and self.channel == "rotation":
                roll = averaged(rolls(group, lateral, position) - group.roll, group.count)
                # its roll with the battery at rest is an offset of the trim, not dynamics
                roll = roll - np.median(roll[group.used])
            out.append((rate, roll))
        return out

    def parts(self, x: Array) -> list[tuple[Array, NDArray[np.int_]]]:
        """Weighted residuals of each group and the dive of each."""
        out = []
        for group, (rate, roll), (w_rate, w_roll) in zip(
            self.groups, self.raw(x), self.weights, strict=True
        ):
            blocks = np.broadcast_to(group.blocks, group.used.shape)[group.used]
            out.append(((rate * w_rate)[group.used], blocks))
            if roll is not None and w_roll is not None:
                out.append(((roll * w_roll)[group.used], blocks))
        return out

    def residual(self, x: Array) -> Array:
        """Weighted residuals, then the offsets; huge where nothing can be integrated."""
        with np.errstate(over="ignore", invalid="ignore"):
            values = np.concatenate([part for part, _ in self.parts(x)])
        return np.concatenate([np.clip(np.nan_to_num(values, nan=1e6), -1e6, 1e6), x])

    def jacobian(self, x: Array) -> Array:
        """Forward differences."""
        base = self.residual(x)
        columns = [(self.residual(x + STEP * unit) - base) / STEP for unit in np.eye(len(x))]
        return np.stack(columns, axis=1)

    def best_start(self) -> Array:
        """Offsets to begin from: of several yaw moments and dampings, with the asymmetry that
        suits each, those that fit best. Turns to the wrong side are a valley of their own."""
        best, lowest = np.zeros(len(self.parameters) + len(BIASES)), math.inf
        names = [p.name for p in self.parameters]
        self.reweight(best)
        for yaw, damping in itertools.product(START_YAW, START_DAMPING):
            x = np.zeros_like(best)
            x[names.index("yaw_moment")], x[names.index("yaw_damping")] = yaw, damping
            base = self.residual(x)
            free = range(len(names), len(x))
            columns = [(self.residual(x + STEP * np.eye(len(x))[k]) - base) / STEP for k in free]
            step, *_ = np.linalg.lstsq(np.stack(columns, axis=1), -base, rcond=None)
            x[len(names) :] = np.clip(step, -2.0, 2.0)
            cost = float(np.sum(self.residual(x) ** 2))
            if cost < lowest:
                best, lowest = x, cost
        return best

    def reweight(self, x: Array) -> tuple[float, float | None]:
        """Weights of the next fit; returns deviations of yaw rate [rad/s] and roll [rad]."""
        found = self.raw(x)
        rate, rate_weights = self._weights([r for r, _ in found], LEAST_TURN)
        rolled = [r for _, r in found if r is not None]
        roll: float | None = None
        roll_weights: list[Array] = []
        if rolled:
            roll, roll_weights = self._weights(rolled, LEAST_ROLL)
        later = iter(roll_weights)
        self.weights = [
            (w, None if r is None else next(later))
            for w, (_, r) in zip(rate_weights, found, strict=True)
        ]
        return rate, roll

    def _weights(self, found: list[Array], least: float) -> tuple[float, list[Array]]:
        groups = [g for g in self.groups if g.position is not None]
        groups = groups if len(groups) == len(found) else list(self.groups)
        values = np.concatenate([r[g.used] for r, g in zip(found, groups, strict=True)])
        scale = max(robust_scale(values), least)
        shares = [1.0 / (1.0 + (r / (OUTLIER * scale)) ** 2) for r in found]
        series = [
            (np.sqrt(s) * r)[g.used[:, k], k]
            for r, s, g in zip(found, shares, groups, strict=True)
            for k in range(r.shape[1])
        ]
        first = self.groups[0]
        samples = correlation_samples(
            [one for one in series if len(one) > 2],
            round(LONGEST_CORRELATION / (first.period * first.count)),
        )
        return scale, [np.sqrt(s / samples) / scale for s in shares]
