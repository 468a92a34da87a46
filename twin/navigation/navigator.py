"""Navigator: on-board estimate of a vehicle's position and of the current.

A velocity estimator gives the velocity through the water. If it gives no heave, heave follows from
the depth rate. Measured roll, pitch and heading turn the velocity to north and east
(`twin.navigation.dead_reckoning`). The gyros' compass deviation corrects the heading
(`twin.navigation.compass_deviation`). The current filter (`twin.navigation.current`) adds the
current, keeps the covariance, and uses GPS fixes and a Doppler log's bottom lock.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.navigation.compass_deviation import IRON, CompassDeviation
from twin.navigation.current import CurrentFilter, CurrentParameters, Innovation, Leg
from twin.navigation.dead_reckoning import LEAST_COSINE, SHALLOW_DEPTH
from twin.navigation.estimators.base import State, VelocityEstimator
from twin.navigation.estimators.dvl import BOTTOM
from twin.numbers import Array

ATTITUDE = ("measured_roll", "measured_pitch", "measured_heading")
DEPTH = "measured_depth"
FIX = ("measured_gps_north", "measured_gps_east")
RATES = ("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate")
LOG = ("measured_dvl_surge", "measured_dvl_sway", "measured_dvl_heave")
LOCK = "measured_dvl_mode"
UPDATE_S = 60.0
"""[s] Time between steps of the current filter under water: short against its correlation times"""
LOG_DEVIATION = 0.005
"""[m/s] Standard deviation, north and east each, of a Doppler log's mean in bottom lock: scale and
mount have errors of a hundredth of a glider's speed"""
LEAST_LOCK = 0.5
"""[1] Smallest fraction of samples with bottom lock in a filter step, for the log to be used"""
START_DEVIATION = 1.0
"""[m] Standard deviation, north and east each, of a given start position"""
KEPT: Mapping[str, Callable[[Any], Any]] = {
    "count": int,
    "depth": float,
    "waited": float,
    "placed": bool,
    "dived": bool,
    **dict.fromkeys(("body", "velocity", "moved", "left", "swum", "spread"), np.array),
    **dict.fromkeys(("bent", "astray", "iron"), np.array),
    "drifts": list,
}
"""Attributes in the state for `restore`, and their types"""


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class NavigationState:
    """State estimate at one sample."""

    time: float
    """[s] since the first sample"""
    north: float
    """[m] north of the origin of the mission's frame"""
    east: float
    """[m] east of the origin"""
    covariance: Array
    """[m2] Covariance of north and east at the last update of the filter, (2, 2)"""
    current_north: float
    """[m/s] northward current"""
    current_east: float
    """[m/s] eastward current"""
    velocity_north: float
    """[m/s] northward, through the water"""
    velocity_east: float
    """[m/s] eastward, through the water"""
    surge: float
    """[m/s] through the water, forward"""
    sway: float
    """[m/s] to starboard"""
    heave: float
    """[m/s] downward in body axes"""
    depth_rate: float
    """[m/s] change of depth since the previous sample, divided by the period"""


class Navigator:
    """Navigator of one vehicle: position and current, sample by sample."""

    def __init__(
        self,
        estimator: VelocityEstimator,
        *,
        latitude: float,
        period: float | None = None,
        start: tuple[float, float] | None = None,
        current: CurrentFilter | CurrentParameters | None = None,
        compass: float | None = None,
    ):
        """Create the navigator.

        Args:
          estimator: estimator of the velocity through the water.
          latitude: [degree] for the inertial period.
          period: [s] between samples; None: the estimator's. The estimator's period must be a whole
            multiple of it; in between, the last velocity holds.
          start: north, east [m] of the start, known to `START_DEVIATION`: the first fix after a
            dive then updates the current. None: unknown; positions count from the origin until the
            first fix.
          current: the filter, or its parameters, such as those of `tune` for earlier missions.
            None: those of a usual sea, with the stated errors of speed and compass.
          compass: [degree] stated standard deviation of the compass; None for the usual one.

        Raises:
          InputError: periods that are no multiples; or `compass` with a filter or parameters, which
            have their own.
        """
        self.estimator = estimator
        self.period = estimator.period if period is None else period
        ratio = estimator.period / self.period
        self._every = round(ratio)
        if self._every < 1 or abs(ratio - self._every) > 1e-6:
            raise InputError(
                f"the estimator takes a sample every {estimator.period:g} s, and there is one "
                f"every {self.period:g} s: give samples every {estimator.period:g} s, or a whole "
                "part of it"
            )
        stated = estimator.deviation
        if current is None:
            current = CurrentParameters(
                speed_scale=stated.scale,
                compass=CurrentParameters.compass if compass is None else compass,
            )
        elif compass is not None:
            raise InputError(
                f"a compass' deviation of {compass:g} degree beside the parameters of a current: "
                "give it as their `compass`"
            )
        if not isinstance(current, CurrentFilter):
            current = CurrentFilter(current, latitude=latitude, memory=stated.memory)
        self.filter = current
        self.legs: list[Leg] = []
        """Dives so far, from fix to fix."""
        self.innovations: list[Innovation] = []
        """Innovation of the fix after each dive."""
        self._noise = stated.noise**2 * np.eye(2)
        self.channels = tuple(dict.fromkeys((*estimator.channels, DEPTH, *ATTITUDE)))
        """Variables that a sample must have; `FIX`, `RATES`, `LOG`, `LOCK` are optional."""
        self.deviation = CompassDeviation(self.period)
        """Filter of the compass deviation, which needs the gyros' rates."""
        self._start = start
        self._first = self.filter.state()
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self.estimator.reset()
        self.deviation.reset()
        self.filter.restore(self._first)
        self.filter.locate(self._start or (0.0, 0.0), START_DEVIATION)
        self.legs.clear()
        self.innovations.clear()
        self._left = np.array([*(self._start or (0.0, 0.0)), 0.0])  # last fix, and its time [s]
        self._swum = np.zeros(2)  # displacement through the water since the last fix
        self._count = 0
        self._body = np.zeros(3)  # surge, sway and heave; NaN heave comes from the depth rate
        self._spread = self._noise.copy()
        self._depth = 0.0
        self._velocity = np.zeros(2)
        self._moved = np.zeros(2)  # displacement through the water since the filter's last step
        self._waited = 0.0
        self._placed = self._start is not None
        self._dived = False  # True if under water since the last fix; afloat, the drift is unknown
        self._bent = np.zeros((2, IRON))  # derivative of the velocity by the iron parameters
        self._astray = np.zeros((2, IRON))  # [m] derivative of `_swum` by the iron parameters
        self._iron = np.zeros(IRON)
        self._hold()

    def _hold(self) -> None:
        """Cache the filter's estimates until its next step."""
        self._place, covariance = self.filter.position
        self._covariance = self.filter.inflation * covariance
        self._current, _ = self.filter.current
        scale, offset = self.filter.calibration
        self._turn = np.array([[1.0 + scale, -offset], [offset, 1.0 + scale]])
        self._moved[:] = 0.0
        self._waited = 0.0
        self._drifts: list[Array] = []  # velocity over ground minus through water, in bottom lock

    def step(self, sample: Mapping[str, float]) -> NavigationState:
        """Estimate the state at a sample, from this sample and the earlier ones.

        Args:
          sample: a value for each of `channels`, in the schema's units. A fix, gyro rates and a
            Doppler log's velocity are optional: they may be NaN or missing.

        Raises:
          InputError: a channel is missing or not finite.
        """
        for name in (DEPTH, *ATTITUDE):
            if not math.isfinite(sample.get(name, math.nan)):
                raise InputError(
                    f"the sample has no finite {name}: a navigator needs depth, roll, pitch and "
                    "heading at every sample"
                )
        if self._count % self._every == 0:
            found = self.estimator.step(sample)
            self._body[:] = found.surge, found.sway, found.heave
            if found.covariance is not None:
                # the mean of the two horizontal axes: their directions at sea are arbitrary
                level = 0.5 * (found.covariance[0, 0] + found.covariance[1, 1])
                self._spread = max(level, 1e-8) * np.eye(2)
        roll, pitch, heading = (math.radians(sample[name]) for name in ATTITUDE)
        rates = np.array([sample.get(name, math.nan) for name in RATES[1:]])
        sensitivity = self.deviation.step(roll, pitch, heading, rates)
        self._straighten()
        heading += float(sensitivity @ self._iron)
        velocity, heave, rate = self._through_water(sample[DEPTH], roll, pitch, heading)
        bent = np.outer((-velocity[1], velocity[0]), sensitivity)
        if self._count:
            self._moved += 0.5 * self.period * (velocity + self._velocity)
            self._astray += 0.5 * self.period * (bent + self._bent)
            self._waited += self.period
        self._bent = bent
        if sample.get(LOCK, math.nan) == BOTTOM:
            log = np.array([sample[name] for name in LOG])
            if np.isfinite(log).all():
                self._drifts.append(_level(log, roll, pitch, heading) - velocity)
        self._velocity = velocity
        self._dived = self._dived or sample[DEPTH] > SHALLOW_DEPTH
        self._count += 1
        fix = [sample.get(name, math.nan) for name in FIX]
        if math.isfinite(fix[0] + fix[1]):
            self._take(fix)
        elif self._waited >= UPDATE_S - 1e-9:
            self._update(known=True)
        north, east = self._place + self._turn @ self._moved + self._current * self._waited
        return NavigationState(
            time=self._time, north=float(north), east=float(east), covariance=self._covariance,
            current_north=float(self._current[0]), current_east=float(self._current[1]),
            velocity_north=float(velocity[0]), velocity_east=float(velocity[1]),
            surge=float(self._body[0]), sway=float(self._body[1]), heave=heave, depth_rate=rate,
        )  # fmt: skip

    def _straighten(self) -> None:
        """Correct the position for new iron estimates, over the track since the last fix."""
        iron = self.deviation.iron
        if not np.array_equal(iron, self._iron):
            moved = self._astray @ (iron - self._iron)
            self.filter.displace(moved)
            self._swum += moved
            self._place = self._place + moved
            self._iron = iron

    def _through_water(
        self, depth: float, roll: float, pitch: float, heading: float
    ) -> tuple[Array, float, float]:
        """North and east through the water, (2,), heave and depth rate, all [m/s].

        The equations are those of `dead_reckoning.horizontal_velocity`, for one sample.
        """
        rate = (depth - self._depth) / self.period if self._count else 0.0
        self._depth = depth
        surge, sway, heave = self._body.tolist()
        if math.isnan(heave):
            cosine = math.cos(pitch) * math.cos(roll)
            rest = rate + surge * math.sin(pitch) - sway * math.cos(pitch) * math.sin(roll)
            heave = rest * cosine / max(cosine**2, LEAST_COSINE**2)
        return _level(np.array([surge, sway, heave]), roll, pitch, heading), heave, rate

    def _update(self, *, known: bool) -> None:
        """Step the filter to this sample; `known`: the motion since its last step is known."""
        if self._waited > 0.0:
            self._swum += self._moved
            through = self._moved / self._waited if known else None
            self.filter.step(self._waited, through, self._spread)
            locked = len(self._drifts) * self.period >= LEAST_LOCK * self._waited
            if through is not None and locked:
                # the median is robust against outliers of the log
                ground = through + np.median(self._drifts, axis=0)
                self.filter.ground_velocity(ground, LOG_DEVIATION**2 * np.eye(2))
        self._hold()

    def _take(self, fix: list[float]) -> None:
        self._update(known=self._dived)
        if self._placed and self._dived:
            innovation = self.filter.fix(fix)
            assert innovation is not None  # the motion is known since the last fix
            self.innovations.append(innovation)
            north, east, start = self._left.tolist()
            swum_north, swum_east = self._swum.tolist()
            leg = Leg(
                start=start, duration=self._time - start, through_water=(swum_north, swum_east),
                over_ground=(fix[0] - north, fix[1] - east),
            )  # fmt: skip
            self.legs.append(leg)
        else:  # a fix afloat gives the position, but says nothing on the current under water
            self.filter.locate(fix)
        self._placed, self._dived = True, False
        self._left = np.array([*fix, self._time])
        self._swum = np.zeros(2)
        self._astray[:] = 0.0
        self._hold()

    @property
    def _time(self) -> float:
        """[s] Time of the last sample"""
        return (self._count - 1) * self.period

    @property
    def _parts(self) -> dict[str, Any]:
        """Components with a state of their own."""
        return {"estimator": self.estimator, "filter": self.filter, "deviation": self.deviation}

    def state(self) -> dict[str, NDArray[Any]]:
        """State as arrays by name, for `restore`."""
        parts = {
            f"{part}:{name}": value
            for part, one in self._parts.items()
            for name, value in one.state().items()
        }
        return parts | {name: np.array(getattr(self, f"_{name}"), np.float64) for name in KEPT}

    def restore(self, state: State) -> None:
        """Continue from the state that `state` returned; the arguments must be the same.

        The state lacks earlier dives: `legs` and `innovations` start empty.
        """
        for part, one in self._parts.items():
            begins = f"{part}:"
            one.restore({k.removeprefix(begins): state[k] for k in state if k.startswith(begins)})
        self.legs.clear()
        self.innovations.clear()
        self._hold()
        for name, kind in KEPT.items():
            setattr(self, f"_{name}", kind(state[name]))


def _level(velocity: Array, roll: float, pitch: float, heading: float) -> Array:
    """North and east, (2,), of a velocity in body axes, (3,); angles in radians."""
    surge, sway, heave = velocity.tolist()
    s_roll, c_roll = math.sin(roll), math.cos(roll)
    forward = surge * math.cos(pitch) + (sway * s_roll + heave * c_roll) * math.sin(pitch)
    starboard = sway * c_roll - heave * s_roll
    c_head, s_head = math.cos(heading), math.sin(heading)
    north = forward * c_head - starboard * s_head
    return np.array([north, forward * s_head + starboard * c_head])
