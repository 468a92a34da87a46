"""Turning fit: coefficients of a glider's turn and roll, fitted to the turns of a log.

The linear lateral motion about its own glide flies every steady part of a log again
(`twin.identify.linear_motion`). Residuals are those of the yaw rate, by the measured roll and
rudder, and of the roll, by the battery's rotation. Dives and climbs have glides of their own, so
that coefficients that change sign with the lift separate from the others. Single coefficients are
less well determined than the turn. They start at the vehicle file's, scaled by its hull, and stay
there where the log does not determine them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from twin.identify.calibration import Array, Calibration
from twin.identify.comparison import ComparedQuantity, Comparison, Fitted
from twin.identify.linear_motion import Lateral, linearised, turning_part
from twin.identify.logged_missions import Log
from twin.identify.pitch import battery_moment, munk_moment, righting_arm, with_righting_arm
from twin.identify.turning_windows import (
    Group,
    TurningWindow,
    averaged,
    channel_of,
    felt,
    groups_of,
    rolls,
    windows_of,
    yaw_rates,
)
from twin.identify.unknowns import UnknownParameter, of_law

LEAST_WINDOWS = 3
"""Fewest windows of a phase for a fit of its turns"""
FARTHEST = 4.0
"""Largest distance in spreads of a positive coefficient from the vehicle file's. Where turns give
only a ratio of two, damping would otherwise grow until no time step is short enough."""
SURE = 2.0
"""Standard deviations by which the fit without a yaw moment of the hull must be worse for the hull
to get one"""
ROUNDS = 2
"""Fits of a battery's turns; later ones start from the neutral position of the one before"""
STEERABLE = 0.8
"""Fraction of its travel in which the neutral position lies, so that the part steers both ways"""
PASSES, MOST_LOOKS = 3, 15
"""Number of fits, after each of which weights are set again; evaluations in each fit"""
LEAST_TURN, LEAST_ROLL = math.radians(0.01), math.radians(0.3)
"""[rad/s], [rad] Lower bounds of the standard deviations of yaw rate and roll, by rounding"""
START_YAW, START_DAMPING = (-2.0, -1.0, 0.0, 1.0), (0.0, 1.0)
"""Offsets in spreads of yaw moment and damping at which the search starts"""
LONGEST_CORRELATION = 300.0
"""[s] Longest lag over which autocorrelation is summed"""


def own_sideslip(calibration: Calibration) -> float:
    """Yaw moment of the hull without sideslip, as the sideslip [rad] of an equal Munk moment."""
    return float(calibration.vehicle.flow_frame.yaw_moment_offset[0]) / munk_moment(calibration)


def _side_scale(calibration: Calibration) -> float:
    """Roll moment [kg/rad] of the side force half a diameter off the axis."""
    vehicle = calibration.vehicle
    return abs(vehicle.flow_frame.side_force[0]) * 0.5 * vehicle.hull_diameter


def _with_authority(calibration: Calibration, value: float) -> Calibration:
    """Set the battery's eccentricity by its authority; the righting arm of the whole is kept."""
    arm, vehicle = righting_arm(calibration), calibration.vehicle
    eccentricity = value * vehicle.mass * arm / vehicle.battery.mass
    return with_righting_arm(calibration.with_vehicle(battery={"eccentricity": eccentricity}), arm)


def _with_lift_slope(calibration: Calibration, value: float) -> Calibration:
    part = turning_part(calibration.vehicle)
    assert part is not None
    return calibration.with_vehicle(**{part.name: {"lift_slope": value}})


# fmt: off
TURNING = (
    # hulls with and without a large fin
    of_law(
        "side_force", "kg m-1 rad-1", "side force of sideslip, -K_beta",
        0.4, "side_force", scale=lambda c: -1.0, logarithmic=True),
    of_law(
        "yaw_moment", "1",
        "yaw moment of sideslip, K_MY, over the Munk moment: above 1 the fin wins",
        0.5, "yaw_moment", scale=munk_moment),
    # 0.2 of the Munk moment at 3 deg
    of_law(
        "yaw_moment_lift", "rad-1",
        "part of the yaw moment of sideslip that is odd in lift, over the Munk moment",
        4.0, "yaw_moment_lift", scale=munk_moment),
    of_law(
        "yaw_damping", "kg s rad-1", "yaw moment of yaw rate, -K_r",
        0.6, "yaw_moment", 1, lambda c: -1.0, logarithmic=True),
    of_law(
        "roll_moment", "1",
        "roll moment of sideslip, K_MR, over that of its side force half a diameter up",
        3.0, "roll_moment", scale=_side_scale),
    of_law(
        "roll_moment_lift", "rad-1",
        "part of the roll moment of sideslip that is odd in lift, over the same",
        10.0, "roll_moment_lift", scale=_side_scale),
    # a rudder's neutral position says the same
    UnknownParameter(
        "yaw_moment_offset", "degree",
        "yaw moment of the hull without sideslip, as the sideslip with such a Munk moment",
        3.0, lambda c: math.degrees(own_sideslip(c)),
        lambda c, x: c.with_vehicle(yaw_moment_offset=(math.radians(x) * munk_moment(c),)),
        channel="rotation"),
    UnknownParameter(
        "roll_authority", "1",
        "first moment of the turning battery over that which rights the vehicle",
        0.7, lambda c: battery_moment(c) / (c.vehicle.mass * righting_arm(c)), _with_authority,
        logarithmic=True, channel="rotation"),
    UnknownParameter(
        "rudder", "rad-1", "lift slope of the rudder",
        0.5, lambda c: getattr(turning_part(c.vehicle), "lift_slope", math.nan), _with_lift_slope,
        logarithmic=True, channel="fin"),
)
# fmt: on
"""Parameters of a twin that turns as the log"""

BIASES = ("yaw_bias", "roll_offset")
"""[rad] Biases that are fitted with TURNING: the asymmetry that turns a vehicle at no roll and no
rudder, beyond the hull's own, as the sideslip of an equal yaw moment on the bare hull; and the roll
sensor's zero. The vehicle is flown with the neutral position of the turning part that balances
them. A rolled battery balances a yaw moment one way in dives and the other way in climbs. There the
hull has a yaw moment of its own, which is a parameter."""
BIAS_SPREADS = (math.radians(3.0), math.radians(5.0))


def biases_beside(names: Collection[str]) -> tuple[str, ...]:
    """Members of BIASES that are fitted with parameters of these names."""
    return BIASES[1:] if "yaw_moment_offset" in names else BIASES


class Turns(Comparison):
    """Channels "yaw_rate" [rad/s] and, with a battery that turns, "roll" [rad] of every window."""

    step = 1e-3

    def __init__(
        self,
        groups: Sequence[Group],
        nominal: Calibration,
        parameters: tuple[UnknownParameter, ...],
    ):
        self.groups = groups
        self.channel = channel_of(nominal)
        own, free = {p.name for p in TURNING}, {p.name for p in parameters}
        self.flies = bool(free - own)
        self.biases = biases_beside(free)
        longest = round(LONGEST_CORRELATION / (groups[0].period * groups[0].count))
        channels = {
            "yaw_rate": ComparedQuantity(unit="rad/s", least=LEAST_TURN, longest=longest),
            "roll": ComparedQuantity(unit="rad", least=LEAST_ROLL, longest=longest),
        }
        blocks = {"yaw_rate": groups, "roll": [g for g in groups if self._rolls(g)]}
        dives = {n: [w.block for g in some for w in g.windows] for n, some in blocks.items()}
        super().__init__(nominal, parameters, channels, dives)

    def _rolls(self, group: Group) -> bool:
        """True where a battery at known positions rolls the group's windows."""
        return group.position is not None and self.channel == "rotation"

    def asymmetry(self, x: Array) -> tuple[float, float]:
        """Whole yaw moment as a sideslip, the hull's own plus its bias, and roll offset [rad]."""
        yaw, roll = self.beside_hull(x)
        return own_sideslip(self.calibration(x)) + yaw, roll

    def beside_hull(self, x: Array) -> tuple[float, float]:
        """Bias of the yaw moment beyond the hull's own, as a sideslip, and roll offset [rad]."""
        count = len(self.biases)
        biases = x[len(x) - count :] * np.array(BIAS_SPREADS[-count:])
        return (float(biases[0]) if count == len(BIASES) else 0.0), float(biases[-1])

    def neutral(
        self, x: Array, *, with_hull: bool = False
    ) -> tuple[float, dict[bool, float]] | None:
        """Position [rad] of the turning part at which the log's vehicle went straight, from the
        zero of the groups: mean over the groups, weighted by their durations, and means of dives
        (False) and climbs (True). None without positions.

        The hull's own yaw moment counts only `with_hull`, as guidance knows it.
        """
        calibration = self.calibration(x)
        bias, offset = self.asymmetry(x) if with_hull else self.beside_hull(x)
        found, weights, climbing = [], [], []
        for group in self.groups:
            if group.position is None or not group.used.any():
                continue
            lateral, yaw = _linear(calibration, group, bias)
            step, response = lateral.turned_by_roll(group.period)
            by_roll, _, by_part, by_yaw = np.linalg.solve(np.eye(2) - step, response)[1]
            compared = np.repeat(group.used, group.count, axis=0)
            rolled = group.roll[: len(compared)][compared]
            roll, rolled_by_part = float(np.mean(rolled)), 0.0
            if self.channel == "rotation":
                given = rolls(group, lateral, felt(calibration, group.position))
                roll = float(np.median(rolled - given[: len(compared)][compared]))
                rolled_by_part = lateral.gains()[1]
            # position at which the yaw rate, linear in it, is 0
            turned = by_roll * math.sin(roll - offset) + by_yaw * yaw
            found.append(-turned / (by_part + by_roll * rolled_by_part))
            weights.append(float(group.used.sum()))
            climbing.append(group.climbing)
        if not found:
            return None
        at, share, up = np.array(found), np.array(weights), np.array(climbing)
        phases = {c: float(np.average(at[up == c], weights=share[up == c])) for c in set(climbing)}
        return float(np.average(at, weights=share)), phases

    def worse_without(self, x: Array, k: int, bounds: tuple[Array, Array]) -> float:
        """Standard deviations by which the fit `x` gets worse with unknown `k` at the vehicle
        file's value and the others fitted again: root of the likelihood ratio (Wilks 1938), which
        correlations of the unknowns do not affect."""
        free = np.delete(np.arange(len(x)), k)

        def residual(y: Array) -> Array:
            return self.residual(np.insert(y, k, 0.0))

        low, high = (bound[free] for bound in bounds)
        found = least_squares(
            residual, x[free], bounds=(low, high), x_scale="jac", max_nfev=MOST_LOOKS, xtol=1e-4
        )
        return math.sqrt(max(2.0 * float(found.cost) - float(np.sum(self.residual(x) ** 2)), 0.0))

    def missed(self, x: Array) -> dict[str, list[Array]]:
        """Model less log, see the base; averages of each window."""
        calibration = self.calibration(x)
        bias, offset = self.asymmetry(x)
        found: dict[str, list[Array]] = {"yaw_rate": [], "roll": []}
        for kept in self.groups:
            group = kept.reglided(calibration) if self.flies else kept
            lateral, yaw = _linear(calibration, group, bias)
            position = np.zeros_like(group.roll)
            if group.position is not None:
                position = felt(calibration, group.position)
            rate = yaw_rates(group, lateral, position, yaw, offset) - group.rate
            found["yaw_rate"] += _windows(group, averaged(rate, group.count))
            if self._rolls(group):
                roll = averaged(rolls(group, lateral, position) - group.roll, group.count)
                # the roll with the battery at rest is an offset of the trim, no dynamics
                found["roll"] += _windows(group, roll - np.median(roll[group.used]))
        return found

    def best_start(self) -> Array:
        """Offsets of the best of several starts: yaw moments and dampings, each with its best
        asymmetry. Turns to the wrong side are a local minimum of their own."""
        best, lowest = np.zeros(self.size), math.inf
        names = [p.name for p in self.parameters]
        self.reweight(best)
        for yaw, damping in itertools.product(START_YAW, START_DAMPING):
            x = np.zeros_like(best)
            x[names.index("yaw_moment")], x[names.index("yaw_damping")] = yaw, damping
            base = self.residual(x)
            free = [k for k, name in enumerate(names) if name == "yaw_moment_offset"]
            free += range(len(names), len(x))
            columns = [
                (self.residual(x + self.step * np.eye(len(x))[k]) - base) / self.step for k in free
            ]
            step, *_ = np.linalg.lstsq(np.stack(columns, axis=1), -base, rcond=None)
            x[free] = np.clip(step, -2.0, 2.0)
            cost = float(np.sum(self.residual(x) ** 2))
            if cost < lowest:
                best, lowest = x, cost
        return best


def _linear(calibration: Calibration, group: Group, bias: float) -> tuple[Lateral, float]:
    """Motion about the group's glide, and the yaw moment [N m] of a sideslip `bias` [rad]."""
    square = group.glide.surge**2 + group.glide.heave**2
    moment = munk_moment(calibration) * bias * square
    return linearised(calibration.vehicle, group.glide), moment


def _windows(group: Group, values: Array) -> list[Array]:
    """Compared values of each window."""
    return [values[group.used[:, k], k] for k in range(len(group.windows))]


class TurningFit(NamedTuple):
    """Result of a fit of a log's turns."""

    fitted: Fitted
    """Fit with the channels of `Turns`"""
    asymmetry: tuple[float, float]
    """[rad] Yaw moment as the sideslip of an equal Munk moment; roll offset"""
    groups: tuple[Group, ...]
    neutral: float | None
    """[rad] Position of the turning part that balances the asymmetry; None: not known"""
    apart: float
    """[rad] Distance between the neutral positions of dives and climbs; the mean is flown"""
    balanced: bool
    """False where the hull's own yaw moment was fitted and is not sure, or the turning part cannot
    balance it in dives and in climbs"""


def turned(logs: Sequence[Log], calibration: Calibration) -> TurningFit | None:
    """Fit the coefficients of turns; None where a phase has too few windows.

    The hull gets a yaw moment of its own where the neutral positions of dives and climbs surely
    differ and the turning part can reach both.
    """
    windows = windows_of(logs, calibration)
    if min(sum(w.climbing == c for w in windows) for c in (False, True)) < LEAST_WINDOWS:
        return None
    channel = channel_of(calibration)
    there = all(g.position is not None for g in groups_of(windows, channel))
    parameters = [p for p in TURNING if p.channel is None or (p.channel == channel and there)]
    if channel != "rotation" or not there:
        parameters = [p for p in parameters if not p.name.startswith("roll_moment")]
    found = _turned(windows, calibration, tuple(parameters))
    if not found.balanced:
        rest = tuple(p for p in parameters if p.name != "yaw_moment_offset")
        found = _turned(windows, calibration, rest)
    return found


def _turned(
    windows: Sequence[TurningWindow],
    calibration: Calibration,
    parameters: tuple[UnknownParameter, ...],
) -> TurningFit:
    """Fit these parameters to the windows, and the neutral position that goes with them."""
    part, channel = turning_part(calibration.vehicle), channel_of(calibration)
    groups = groups_of(windows, channel)
    there = all(g.position is not None for g in groups)
    neutral, apart, balanced = None, 0.0, True
    own = [k for k, p in enumerate(parameters) if p.name == "yaw_moment_offset"]
    if part is not None and there:
        neutral, calibration = 0.0, _resting(calibration, part.name, 0.0)
    farthest = [FARTHEST if p.logarithmic else np.inf for p in parameters]
    farthest += [np.inf for _ in biases_beside({p.name for p in parameters})]
    bounds = (-np.array(farthest), np.array(farthest))
    # a battery acts by the sine of its rotation from the neutral position: fit again from there
    for _ in range(ROUNDS if channel == "rotation" and there else 1):
        turns = Turns(groups, calibration, parameters)
        x, _ = turns.fit(turns.best_start(), PASSES, bounds=bounds, max_nfev=MOST_LOOKS, xtol=1e-4)
        fitted, asymmetry = turns.fitted(x), turns.asymmetry(x)
        more = turns.neutral(x)
        if neutral is None or part is None or more is None:
            break
        room, middle = STEERABLE * (part.high - part.low) / 2.0, 0.5 * (part.high + part.low)
        mean, phases = more
        apart = max(phases.values()) - min(phases.values())
        if own:
            straight = turns.neutral(x, with_hull=True)
            assert straight is not None
            balanced = all(abs(neutral + at - middle) <= room for at in straight[1].values())
        neutral = min(max(neutral + mean, middle - room), middle + room)
        groups = groups_of(windows, channel, neutral)
        calibration = _resting(calibration, part.name, neutral)
        flown = _resting(fitted.calibration, part.name, neutral)
        fitted = fitted._replace(calibration=flown)
    sure = all(turns.worse_without(x, k, bounds) > SURE for k in own)
    return TurningFit(
        fitted=fitted,
        asymmetry=asymmetry,
        groups=tuple(groups),
        neutral=neutral,
        apart=apart,
        balanced=balanced and sure,
    )


def _resting(calibration: Calibration, part: str, neutral: float) -> Calibration:
    """Return the calibration with this neutral position [rad] of the turning part."""
    return calibration.with_vehicle(**{part: {"neutral": neutral}})
