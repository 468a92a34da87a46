"""Turning: what turns and rolls a glider, fitted to the turns of a log.

Every steady part of a log is flown again by the lateral motion about its own glide
(`twin.identify.lateral`): the yaw rate that its roll and its rudder should have given beside the
one it had, and the roll that the battery's rotation should have given beside the measured one.
Dives and climbs each have their own glides, so that what changes sign with the lift parts from
what does not. Which of the coefficients make up a turn is less known than the turn: they start at
the vehicle file's, in proportion to its hull, and what the log does not tell stays there.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from twin.compiled import jit
from twin.identify.calibration import Calibration
from twin.identify.lateral import Glide, Lateral, linearised, turning_part
from twin.identify.logged import Log
from twin.identify.pitch import righting_arm, with_righting_arm
from twin.identify.problem import OUTLIER, correlation_samples, robust_scale
from twin.identify.speed import density_of, motion_of, steady_parts
from twin.identify.unknowns import Parameter
from twin.vehicle.parts import BatteryHinge, Fin

Array = NDArray[np.float64]

LONGEST, SHORTEST = 900.0, 100.0
"""[s] of one window: longer ones are cut, shorter ones left out."""
SETTLE = 30.0
"""[s] at the start of a window that are not compared: the sideslip there is a guess."""
LEAST_DEPTH = 5.0
"""[m]"""
SPACINGS, LEAST_AVERAGE, MOST_AVERAGE = 2.5, 10.0, 90.0
"""Samples of the vehicle's own, and bounds [s], whose means of yaw rate and roll are compared: when
a move ended is known to about one of its samples."""
BENT = 1e-6
"""[rad] of the heading's second difference from which a sample is the vehicle's own, not one that
was put between two of them"""
SPEED_BINS = 3
"""Glides of a phase, by speed, that turns are linearised about."""
ENOUGH_IN_BIN = 6
"""Windows for which a glide of their own is worth while."""
LEAST_WINDOWS = 3
"""of a phase: with fewer its turns are not known"""
LEAST_TURN = math.radians(0.01)
"""[rad/s] that the yaw rate is off at least: compasses and the log's rounding."""
LEAST_ROLL = math.radians(0.3)
"""[rad] that the roll is off at least"""
MOST_ROLL = math.radians(60.0)
"""[rad] beyond which no glide is linear"""
START_YAW, START_DAMPING = (-2.0, -1.0, 0.0, 1.0), (0.0, 1.0)
"""Spreads of yaw moment and damping from the vehicle file's at which the search looks."""
FARTHEST = 4.0
"""Spreads from the vehicle file's that a positive coefficient may go: where a turn says only a
ratio of two, damping would grow until no time step holds it."""
STEP = 1e-3
"""Spreads of the finite differences."""
PASSES = 3
"""Fits between which weights are taken again."""
LONGEST_CORRELATION = 300.0
"""[s]"""


def _law(calibration: Calibration, **changes: object) -> Calibration:
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
    return _law(calibration, **{part.name: changes})


def _with_authority(calibration: Calibration, value: float) -> Calibration:
    """The battery hung lower or higher, the righting arm of the whole kept."""
    arm = righting_arm(calibration)
    vehicle = calibration.vehicle
    eccentricity = value * vehicle.mass * arm / vehicle.battery.mass
    moved = calibration.replace(vehicle=vehicle.replace(battery={"eccentricity": eccentricity}))
    return with_righting_arm(moved, arm)


TURNING = (
    Parameter(
        name="side_force",
        unit="kg m-1 rad-1",
        meaning="side force of sideslip, -K_beta",
        spread=0.4,  # hulls with and without a large fin
        logarithmic=True,
        get=lambda c: -c.vehicle.flow_frame.side_force[0],
        set=lambda c, x: _law(c, side_force=(-x,)),
    ),
    Parameter(
        name="yaw_moment",
        unit="1",
        meaning="yaw moment of sideslip, K_MY, over the Munk moment: above 1 the fin wins",
        spread=0.5,
        get=lambda c: c.vehicle.flow_frame.yaw_moment[0] / munk_moment(c),
        set=lambda c, x: _law(
            c, yaw_moment=(x * munk_moment(c), c.vehicle.flow_frame.yaw_moment[1])
        ),
    ),
    Parameter(
        name="yaw_moment_lift",
        unit="rad-1",
        meaning="part of the yaw moment of sideslip that is odd in lift, over the Munk moment",
        spread=4.0,  # 0.2 of the Munk moment at 3 deg
        get=lambda c: c.vehicle.flow_frame.yaw_moment_lift[0] / munk_moment(c),
        set=lambda c, x: _law(c, yaw_moment_lift=(x * munk_moment(c),)),
    ),
    Parameter(
        name="yaw_damping",
        unit="kg s rad-1",
        meaning="yaw moment of yaw rate, -K_r",
        spread=0.6,
        logarithmic=True,
        get=lambda c: -c.vehicle.flow_frame.yaw_moment[1],
        set=lambda c, x: _law(c, yaw_moment=(c.vehicle.flow_frame.yaw_moment[0], -x)),
    ),
    Parameter(
        name="roll_moment",
        unit="1",
        meaning="roll moment of sideslip, K_MR, over that of its side force half a diameter up",
        spread=3.0,
        get=lambda c: c.vehicle.flow_frame.roll_moment[0] / _side_scale(c),
        set=lambda c, x: _law(
            c, roll_moment=(x * _side_scale(c), c.vehicle.flow_frame.roll_moment[1])
        ),
    ),
    Parameter(
        name="roll_moment_lift",
        unit="rad-1",
        meaning="part of the roll moment of sideslip that is odd in lift, over the same",
        spread=10.0,
        get=lambda c: c.vehicle.flow_frame.roll_moment_lift[0] / _side_scale(c),
        set=lambda c, x: _law(c, roll_moment_lift=(x * _side_scale(c),)),
    ),
    Parameter(
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
    Parameter(
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
"""Fitted beside them and not flown: the asymmetry that turns a vehicle at no roll and no rudder
(as the sideslip [rad] of the same yaw moment on the bare hull), and the roll sensor's zero."""
BIAS_SPREADS = (math.radians(3.0), math.radians(5.0))


def channel_of(calibration: Calibration) -> str | None:
    """The log's channel of the turning part: "rotation", "fin", or None."""
    part = turning_part(calibration.vehicle)
    if isinstance(part, BatteryHinge):
        return "rotation"
    return "fin" if isinstance(part, Fin) else None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Window:
    """A steady part of a log: what was done and how it turned, each (samples,)."""

    log: Log
    part: slice
    climbing: bool
    speed: float
    """[m/s] through the water, median"""
    glide: Glide
    block: int = 0
    """Number of the dive"""


def windows_of(logs: Sequence[Log], calibration: Calibration) -> list[Window]:
    """Steady parts of the logs, each of one phase."""
    found: list[Window] = []
    for number, log in enumerate(logs):
        motion = motion_of(log, calibration)
        net = calibration.net_mass(
            density_of(log, calibration),
            np.maximum(log.depth, 0.0),
            log.pump,
            log.hull_warming(calibration.thermal_lag),
        )
        pitch = calibration.true_pitch(log.pitch)
        steady = log.use & steady_parts(log) & (log.depth > LEAST_DEPTH)
        steady &= (np.abs(log.roll) < MOST_ROLL) & (np.sign(pitch) == -np.sign(net))
        steady &= motion.surge > 0.05
        phase = np.where(steady, np.sign(pitch), 0.0)
        edges = np.flatnonzero(np.diff(phase)) + 1
        for first, last in zip([0, *edges], [*edges, len(phase)], strict=True):
            if phase[first] == 0.0:
                continue
            pieces = max(1, math.ceil((last - first) * log.period / LONGEST))
            for bounds in np.array_split(np.arange(first, last), pieces):
                if len(bounds) * log.period < SHORTEST or len(bounds) < log.window + 2:
                    continue
                part = slice(int(bounds[0]), int(bounds[-1]) + 1)
                found.append(
                    Window(
                        log=log,
                        part=part,
                        climbing=bool(phase[first] > 0.0),
                        speed=float(np.median(motion.speed[part])),
                        glide=Glide(
                            surge=float(np.median(motion.surge[part])),
                            heave=float(np.median(motion.heave[part])),
                            pitch=float(np.median(pitch[part])),
                            net_mass=float(np.median(net[part])),
                        ),
                        block=number,
                    )
                )
    return found


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Group:
    """Windows that share a glide; arrays are (samples, windows), padded at the end."""

    glide: Glide
    climbing: bool
    period: float
    roll: Array
    """[rad] as measured"""
    slope: Array
    """[rad/s] of the roll"""
    position: Array | None
    """[rad] of the turning part, its mean taken off; None: the log has none"""
    rate: Array
    """[rad/s] yaw rate, about the body's axis"""
    used: NDArray[np.bool_]
    """what is compared: (averages, windows)"""
    count: int
    """Samples of a mean"""
    blocks: NDArray[np.int_]
    """(windows,) numbers of the dives"""


def groups_of(windows: Sequence[Window], channel: str | None) -> list[Group]:
    """The windows by phase and speed."""
    logs = list({w.log.index: w.log for w in windows}.values())
    average = min(max(SPACINGS * spacing(logs), LEAST_AVERAGE), MOST_AVERAGE)
    count = max(round(average / logs[0].period), 1)
    found = []
    for climbing in (False, True):
        phase = sorted((w for w in windows if w.climbing == climbing), key=lambda w: w.speed)
        if not phase:
            continue
        bins = max(1, min(SPEED_BINS, len(phase) // ENOUGH_IN_BIN))
        for chosen in np.array_split(np.arange(len(phase)), bins):
            found.append(_group([phase[k] for k in chosen], channel, count))
    return found


def _group(windows: Sequence[Window], channel: str | None, count: int) -> Group:
    period = windows[0].log.period
    length = max(w.part.stop - w.part.start for w in windows)
    skip = round(SETTLE / period)
    shape = (length, len(windows))
    roll, slope, position, rate = (np.zeros(shape) for _ in range(4))
    used = np.zeros(shape, bool)
    lacking = channel is None or any(getattr(w.log, channel) is None for w in windows)
    for k, window in enumerate(windows):
        log, part = window.log, window.part
        n = part.stop - part.start
        roll[:n, k] = log.roll[part]
        # d(roll)/dt = p + tan(pitch) (q sin(roll) + r cos(roll))
        p, q, r = log.rates[:, part]
        turning = q * np.sin(log.roll[part]) + r * np.cos(log.roll[part])
        slope[:n, k] = p + np.tan(window.glide.pitch) * turning
        rate[:n, k] = r
        used[skip : n - log.window // 2, k] = True
        if not lacking and channel is not None:
            position[:n, k] = getattr(log, channel)[part]
    names = ("surge", "heave", "pitch", "net_mass")
    glide = Glide(**{n: float(np.median([getattr(w.glide, n) for w in windows])) for n in names})
    return Group(
        glide=glide,
        climbing=windows[0].climbing,
        period=period,
        roll=roll,
        slope=slope,
        position=None if lacking else position,
        rate=rate,
        used=np.asarray(_averaged(used.astype(float), count) == 1.0),
        count=count,
        blocks=np.array([w.block for w in windows]),
    )


def spacing(logs: Sequence[Log]) -> float:
    """[s] between the vehicle's own samples: a store puts others on straight lines between."""
    bends, samples = 0, 0
    for log in logs:
        bent = np.abs(np.diff(log.heading, 2)) > BENT
        bends, samples = bends + int(bent.sum()), samples + len(bent)
    # a line between two samples of the vehicle bends at the store's samples beside each
    share = bends / max(samples, 1)
    return logs[0].period * max(2.0 / share, 1.0) if share > 0.0 else MOST_AVERAGE


def _averaged(values: Array, n: int) -> Array:
    """Means of `n` samples, (averages, windows), of (samples, windows); a rest at the end goes."""
    whole = len(values) // n * n
    return values[:whole].reshape(-1, n, values.shape[1]).mean(axis=1)


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


class TurnProblem:
    """Residuals of yaw rate and roll as a function of offsets from the start, in spreads."""

    def __init__(
        self,
        groups: Sequence[Group],
        start: Calibration,
        parameters: tuple[Parameter, ...],
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
            rate = _averaged(rate, group.count)
            roll = None
            if group.position is not None and self.channel == "rotation":
                roll = _averaged(rolls(group, lateral, position) - group.roll, group.count)
                # where it rolls to with the battery at rest is no matter of dynamics
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


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Turns:
    """What the turns of a log say."""

    calibration: Calibration
    parameters: tuple[Parameter, ...]
    centres: Array
    offsets: Array
    """in spreads, the parameters' then BIASES'"""
    jacobian: Array
    residual: Array
    blocks: NDArray[np.int_]
    """Dive of each residual; -1: what was known before."""
    rate_deviation: float
    """[rad/s] of the yaw rate"""
    roll_deviation: float | None
    """[rad] of the roll; None without the battery's rotation"""
    groups: tuple[Group, ...]

    @property
    def biases(self) -> tuple[float, float]:
        """Yaw bias as a sideslip, roll offset [rad]."""
        yaw, roll = self.offsets[len(self.parameters) :] * np.array(BIAS_SPREADS)
        return float(yaw), float(roll)


def turned(logs: Sequence[Log], calibration: Calibration) -> Turns | None:
    """Fit what turns the vehicle; None where no phase has turns enough."""
    windows = windows_of(logs, calibration)
    if min(sum(w.climbing == c for w in windows) for c in (False, True)) < LEAST_WINDOWS:
        return None
    channel = channel_of(calibration)
    groups = groups_of(windows, channel)
    there = all(g.position is not None for g in groups)
    parameters = tuple(p for p in TURNING if p.channel is None or (p.channel == channel and there))
    if channel != "rotation" or not there:
        parameters = tuple(p for p in parameters if not p.name.startswith("roll_moment"))
    problem = TurnProblem(groups, calibration, parameters)
    factors = [p.logarithmic for p in parameters] + [False] * len(BIASES)
    farthest = np.where(factors, FARTHEST, np.inf)
    x = problem.best_start()
    scales = problem.reweight(x)
    for _ in range(PASSES):
        found = least_squares(
            problem.residual,
            x,
            jac=problem.jacobian,
            bounds=(-farthest, farthest),
            x_scale="jac",
            max_nfev=15,
            xtol=1e-4,
        )
        x = found.x
        scales = problem.reweight(x)
    parts = problem.parts(x)
    blocks = np.concatenate([b for _, b in parts] + [np.full(len(x), -1)])
    return Turns(
        calibration=problem.calibration(x),
        parameters=parameters,
        centres=problem.centres,
        offsets=x,
        jacobian=problem.jacobian(x),
        residual=problem.residual(x),
        blocks=blocks,
        rate_deviation=scales[0],
        roll_deviation=scales[1],
        groups=tuple(groups),
    )
