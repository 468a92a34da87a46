"""Turning fit: coefficients of a glider's turn and roll, fitted to the turns of a log.

Every steady part of a log is simulated by the linear lateral motion about its median glide
(`twin.identify.linear_motion`). The measured roll and rudder give a yaw rate, the battery's
rotation gives a roll; the residuals are these minus the measured ones. Dives and climbs are
linearised separately, so coefficients that change sign with the lift can be told from the others.
Single coefficients are less certain than the turn rate. Each starts at the vehicle file's value,
and stays there if the log does not determine it.
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
"""Minimum number of windows of a phase for a fit of its turns"""
FARTHEST = 4.0
"""[spreads] Largest difference of a positive coefficient from the vehicle file's. If turns
determine only a ratio of two, damping would else grow until no time step is short enough."""
LEAST_SIGNIFICANCE = 2.0
"""[standard deviations] Smallest significance for which the hull gets a yaw moment of its own"""
ROUNDS = 2
"""Number of fits if a battery turns the vehicle; each starts at the last neutral position"""
NEUTRAL_RANGE = 0.8
"""Middle fraction of a part's travel for its neutral position, so that it steers both ways"""
PASSES, MOST_LOOKS = 3, 15
"""PASSES: number of fits, each with weights from the fit before. MOST_LOOKS: maximum number of
evaluations in a fit"""
LEAST_TURN, LEAST_ROLL = math.radians(0.01), math.radians(0.3)
"""Lower bounds of standard deviations, for rounding. LEAST_TURN: [rad/s]. LEAST_ROLL: [rad]"""
START_YAW, START_DAMPING = (-2.0, -1.0, 0.0, 1.0), (0.0, 1.0)
"""Starts of the search, in spreads. START_YAW: of the yaw moment. START_DAMPING: of the damping"""
LONGEST_CORRELATION = 300.0
"""[s] Longest lag over which autocorrelation is summed"""


def own_sideslip(calibration: Calibration) -> float:
    """Sideslip [rad] whose Munk moment equals the hull's yaw moment at no sideslip."""
    return float(calibration.vehicle.flow_frame.yaw_moment_offset[0]) / munk_moment(calibration)


def _side_scale(calibration: Calibration) -> float:
    """Roll moment [kg/rad] of the side force half a diameter off the axis."""
    vehicle = calibration.vehicle
    return abs(vehicle.flow_frame.side_force[0]) * 0.5 * vehicle.hull_diameter


def _with_authority(calibration: Calibration, value: float) -> Calibration:
    """Set the battery's eccentricity from `roll_authority`; keep the vehicle's righting arm."""
    arm, vehicle = righting_arm(calibration), calibration.vehicle
    eccentricity = value * vehicle.mass * arm / vehicle.battery.mass
    return with_righting_arm(calibration.with_vehicle(battery={"eccentricity": eccentricity}), arm)


def _with_lift_slope(calibration: Calibration, value: float) -> Calibration:
    part = turning_part(calibration.vehicle)
    assert part is not None
    return calibration.with_vehicle(**{part.name: {"lift_slope": value}})


# fmt: off
TURNING = (
    # spread: hulls with and without a large fin
    of_law(
        "side_force", "kg m-1 rad-1", "side force of sideslip, -K_beta",
        0.4, "side_force", scale=lambda c: -1.0, logarithmic=True),
    of_law(
        "yaw_moment", "1",
        "yaw moment of sideslip, K_MY, over the Munk moment: above 1 the fin wins",
        0.5, "yaw_moment", scale=munk_moment),
    # spread: 0.2 of the Munk moment at 3 deg angle of attack
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
    # with a battery only: a rudder's neutral position has the same effect
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
"""Parameters that can be fitted to the turns of a log"""

BIASES = ("yaw_bias", "roll_offset")
"""[rad] Biases that are fitted with TURNING: a yaw moment at no roll and no rudder, as the sideslip
of an equal Munk moment, and the roll sensor's zero. The fitted vehicle has the neutral position of
the turning part that balances both. A rolled battery balances a yaw moment to opposite sides in
dives and in climbs; so the moment can be a parameter of the hull, `yaw_moment_offset`, in place
of the bias."""
BIAS_SPREADS = (math.radians(3.0), math.radians(5.0))


def biases_beside(names: Collection[str]) -> tuple[str, ...]:
    """Select the BIASES that are fitted together with parameters of these names."""
    return BIASES[1:] if "yaw_moment_offset" in names else BIASES


class Turns(Comparison):
    """Residuals of the windows: "yaw_rate" [rad/s] and, for a turning battery, "roll" [rad]."""

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
        """True if a battery rolls the vehicle and its positions in the group are known."""
        return group.position is not None and self.channel == "rotation"

    def asymmetry(self, x: Array) -> tuple[float, float]:
        """Yaw moment as a sideslip, the hull's own plus the bias, and the roll offset [rad]."""
        yaw, roll = self.beside_hull(x)
        return own_sideslip(self.calibration(x)) + yaw, roll

    def beside_hull(self, x: Array) -> tuple[float, float]:
        """Bias of the yaw moment without the hull's own, as a sideslip, and roll offset [rad]."""
        count = len(self.biases)
        biases = x[len(x) - count :] * np.array(BIAS_SPREADS[-count:])
        return (float(biases[0]) if count == len(BIASES) else 0.0), float(biases[-1])

    def neutral(
        self, x: Array, *, with_hull: bool = False
    ) -> tuple[float, dict[bool, float]] | None:
        """Positions [rad] of the turning part at which the log's vehicle went straight.

        The result is the mean over the groups, weighted by duration, and the means of dives (False)
        and climbs (True); 0 is the groups' neutral position. None if no position is known. Guidance
        allows for the hull's own yaw moment, so only `with_hull` includes this moment."""
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
        """[standard deviations] Significance of unknown `k` in the fit `x`: root of the likelihood
        ratio to a fit of the others with `k` at the vehicle file's value (Wilks 1938), which
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
        """Residuals, model minus log, of the averages in each window (see `Comparison`)."""
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
                # a constant difference comes from the trim, not from the dynamics
                found["roll"] += _windows(group, roll - np.median(roll[group.used]))
        return found

    def best_start(self) -> Array:
        """Offsets of the best of several starts of yaw moment and damping, each with best biases.
        From a single start, the fit could end in turns to the wrong side, a local minimum."""
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
    """Linear motion about the group's glide, and the Munk moment [N m] at sideslip `bias` [rad]."""
    square = group.glide.surge**2 + group.glide.heave**2
    moment = munk_moment(calibration) * bias * square
    return linearised(calibration.vehicle, group.glide), moment


def _windows(group: Group, values: Array) -> list[Array]:
    """Values of each window at the averages that are compared."""
    return [values[group.used[:, k], k] for k in range(len(group.windows))]


class TurningFit(NamedTuple):
    """Result of a fit of a log's turns."""

    fitted: Fitted
    """Fit of `Turns`"""
    asymmetry: tuple[float, float]
    """[rad] Yaw moment as the sideslip of an equal Munk moment, and roll offset"""
    groups: tuple[Group, ...]
    neutral: float | None
    """[rad] Neutral position of the turning part in the fitted vehicle; None: not known"""
    apart: float
    """[rad] Difference between the neutral positions of dives and climbs; `neutral` is the mean"""
    balanced: bool
    """False if the hull's own yaw moment was fitted, but is not significant, or the turning part
    cannot balance it in dives and in climbs"""


def turned(logs: Sequence[Log], calibration: Calibration) -> TurningFit | None:
    """Fit the coefficients of turns; None if dives or climbs have too few windows.

    The hull gets a yaw moment of its own if the moment is significant and the turning part can
    balance it in dives and in climbs.
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
    """Fit these parameters and the neutral position of the turning part to the windows."""
    part, channel = turning_part(calibration.vehicle), channel_of(calibration)
    groups = groups_of(windows, channel)
    there = all(g.position is not None for g in groups)
    neutral, apart, balanced = None, 0.0, True
    own = [k for k, p in enumerate(parameters) if p.name == "yaw_moment_offset"]
    if part is not None and there:
        neutral, calibration = 0.0, _with_neutral(calibration, part.name, 0.0)
    farthest = [FARTHEST if p.logarithmic else np.inf for p in parameters]
    farthest += [np.inf for _ in biases_beside({p.name for p in parameters})]
    bounds = (-np.array(farthest), np.array(farthest))
    # a battery's effect depends on the sine of its rotation from neutral: fit again from there
    for _ in range(ROUNDS if channel == "rotation" and there else 1):
        turns = Turns(groups, calibration, parameters)
        x, _ = turns.fit(turns.best_start(), PASSES, bounds=bounds, max_nfev=MOST_LOOKS, xtol=1e-4)
        fitted, asymmetry = turns.fitted(x), turns.asymmetry(x)
        more = turns.neutral(x)
        if neutral is None or part is None or more is None:
            break
        room, middle = NEUTRAL_RANGE * (part.high - part.low) / 2.0, 0.5 * (part.high + part.low)
        mean, phases = more
        apart = max(phases.values()) - min(phases.values())
        if own:
            straight = turns.neutral(x, with_hull=True)
            assert straight is not None
            balanced = all(abs(neutral + at - middle) <= room for at in straight[1].values())
        neutral = min(max(neutral + mean, middle - room), middle + room)
        groups = groups_of(windows, channel, neutral)
        calibration = _with_neutral(calibration, part.name, neutral)
        flown = _with_neutral(fitted.calibration, part.name, neutral)
        fitted = fitted._replace(calibration=flown)
    sure = all(turns.worse_without(x, k, bounds) > LEAST_SIGNIFICANCE for k in own)
    return TurningFit(
        fitted=fitted,
        asymmetry=asymmetry,
        groups=tuple(groups),
        neutral=neutral,
        apart=apart,
        balanced=balanced and sure,
    )


def _with_neutral(calibration: Calibration, part: str, neutral: float) -> Calibration:
    """Return the calibration with this neutral position [rad] of the turning part set."""
    return calibration.with_vehicle(**{part: {"neutral": neutral}})
