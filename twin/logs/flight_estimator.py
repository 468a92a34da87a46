"""Flight estimators: velocity of a logged vehicle through the water; an extension point.

The steady model balances the forces at every sample (`twin.identify.speed`). The flight model
integrates the equations of translation (`twin.identify.translation`). `fly_dive` applies them.
"""

from __future__ import annotations

import abc
import dataclasses
from typing import ClassVar, Self

import numpy as np

from twin import seams
from twin.errors import InputError
from twin.identify.calibration import Array, Calibration, Mask
from twin.identify.logged_missions import Log
from twin.identify.speed import horizontal, motion_of, motions_of, start_of
from twin.identify.translation import Translation, Velocity
from twin.identify.unknowns import ERROR_STEP, unit_errors
from twin.logs.thermal_lag import CtdSeries
from twin.records.reader import MissionStore
from twin.registry import Registry

LEAST_COSINE = 0.2
"""[1] Smallest cos(pitch) cos(roll) with which the depth rate determines heave"""
LEAST_KNOWN = 0.9
"""[1] Smallest fraction of the time under water with an attitude for which a current is given"""
UNDER_WATER = 3.0
"""[m] Depth below which a vehicle is under water"""
DESCENT, CLIMB = 1, 2
"""Values of `measured_phase`"""
LEVEL_RATE = 0.03
"""[m/s] Depth rate below which a vehicle turns or flies level, as in the import's phases"""


class FlightEstimator(abc.ABC):
    """Estimator of a logged vehicle's velocity through the water, an extension point.

    The estimator gives speed, track and currents. The vertical velocity of the water is always the
    flight model's depth rate minus the logged depth rate: an estimator that takes its heave from
    the logged depth rate would find still water.
    """

    kind: ClassVar[str]
    """Name that the user types: `twin flight --estimator KIND` or `KIND:ARGUMENT`."""
    summary: ClassVar[str]
    """One line for help texts and documents."""

    modelled: ClassVar[bool] = False
    """True if the flight model gives the speed; an error of it then shows in the depth rate."""

    @classmethod
    def open(cls, argument: str) -> Self:
        """Create the estimator; `argument` is the text after the colon, or empty.

        Raises:
          InputError: an argument that the estimator does not take.
        """
        if argument:
            raise InputError(f"estimator {cls.kind!r} takes no argument, not {argument!r}")
        return cls()

    @abc.abstractmethod
    def motion(
        self, store: MissionStore, log: Log, calibration: Calibration, start: Velocity
    ) -> Translation:
        """Velocity through the water, body FRD, at each of the log's samples.

        Args:
          store: store of the log, for signals that `log` does not hold; `log.index` is the mission.
          log: the dive, with corrected density.
          calibration: the vehicle and the errors of its sensors.
          start: surge, sway, heave [m/s] at the first sample, from depth rate and pitch.

        Raises:
          StoreError: the store lacks a signal that the estimator needs.
        """

    def errors(self, log: Log, calibration: Calibration) -> tuple[Array, Array] | None:
        """Independent errors of speed [m/s] and of angle of attack [rad], (errors, time) each.

        Each is of one standard deviation; None where the estimator does not know its errors.
        """
        return None


ESTIMATORS: Registry[type[FlightEstimator]] = seams.FLIGHT_ESTIMATORS
"""All flight estimators by name."""

register = ESTIMATORS.add
"""Add an estimator class; usable as a decorator."""


def open_estimator(text: str) -> FlightEstimator:
    """Open the estimator that a text such as "flight" or "network:runs/mine" names.

    Raises:
      InputError: an unknown name, or an argument that the estimator does not take.
    """
    kind, _, argument = text.partition(":")
    return ESTIMATORS[kind].open(argument)


class FlightModel(FlightEstimator):
    """Flight model: weight, buoyancy, drag, lift and the vehicle's inertia."""

    kind = "flight"
    summary = "the vehicle's flight model with its inertia"
    modelled = True
    inertia: ClassVar[bool] = True

    def motion(
        self, store: MissionStore, log: Log, calibration: Calibration, start: Velocity
    ) -> Translation:
        """See `FlightEstimator.motion`; the steady model ignores `start`."""
        return motion_of(log, calibration, "flight" if self.inertia else "steady", start=start)

    def errors(self, log: Log, calibration: Calibration) -> tuple[Array, Array]:
        """Propagate the standard errors of the vehicle and the pitch sensor (`unit_errors`)."""
        wrong = [calibration, *unit_errors(calibration)]
        found = motions_of([log], wrong, "flight" if self.inertia else "steady")
        (right,), *others = found
        speed = np.stack([one.speed - right.speed for (one,) in others])
        attack = np.stack([one.angle_of_attack - right.angle_of_attack for (one,) in others])
        return speed / ERROR_STEP, attack / ERROR_STEP


class SteadyModel(FlightModel):
    """Steady model, as glider pilots use it: the flight model without inertia."""

    kind = "steady"
    summary = "forces in balance at every sample, zero at inflections"
    inertia = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownDive:
    """Flight of one mission through the water; arrays are (time,), NaN where unknown."""

    mission: int
    """Row in the store."""
    motion: Translation | None
    """Velocity through the water, body FRD; None for a mission that no model can fly"""
    velocity: Array
    """North, east through the water [m/s], (time, 2); zero where unknown"""
    depth: Array
    """[m] Depth as stored"""
    water_up: Array
    """[m/s] vertical velocity of the water, positive up, filtered like the log's depth rate"""
    sink_rate: Array
    """[m/s] Downward velocity by the flight model: the depth rate in still water"""
    descending: Mask
    """Samples of a descent, without turns and the surface"""
    ascending: Mask
    """Samples of a climb, without turns and the surface"""
    ctd: CtdSeries | None
    """CTD with its thermal lag corrected; None without a CTD"""
    speed_deviation: Array
    """[m/s] Standard deviation of the speed through the water"""
    attack_deviation: Array
    """[rad] Standard deviation of the angle of attack"""
    known: float = 1.0
    """[1] Fraction of the time under water in which the log has an attitude"""

    @property
    def tells_current(self) -> bool:
        """True if the track through the water is known well enough for a current."""
        return self.motion is not None and self.known >= LEAST_KNOWN


def fly_dive(
    store: MissionStore,
    log: Log,
    calibration: Calibration,
    estimator: FlightEstimator,
    raw: CtdSeries | None,
    ctd: CtdSeries | None,
) -> FlownDive:
    """Fly a vehicle through one dive of a log.

    Args:
      store: the store of the dive.
      log: the dive.
      calibration: the vehicle and the errors of its sensors.
      estimator: estimator of the velocity through the water.
      raw: the CTD as stored, None without one.
      ctd: the CTD with its thermal lag corrected.
    """
    if raw is not None and ctd is not None and log.density is not None and ctd is not raw:
        change = np.nan_to_num(ctd.density - raw.density, nan=0.0)
        log = dataclasses.replace(log, density=log.density + change)
    first = start_of(log, calibration)
    model = motion_of(log, calibration, start=first)
    sink = model.sink_rate(log.roll, calibration.true_pitch(log.pitch))
    motion = estimator.motion(store, log, calibration, first)
    if not np.isfinite(motion.heave).any():
        motion = dataclasses.replace(motion, heave=_heave(log, calibration, motion))
    down, up = log.depth_rate > LEVEL_RATE, log.depth_rate < -LEVEL_RATE
    if "measured_phase" in store:
        phase = store.row("measured_phase", log.index)[: len(log.depth)]
        down, up = phase == DESCENT, phase == CLIMB
    count = int(store.samples[log.index])
    errors = estimator.errors(log, calibration) or (np.full((1, count), np.nan),) * 2
    speed_sd, attack_sd = (np.sqrt(np.square(one).sum(axis=0)) for one in errors)
    return FlownDive(
        mission=log.index,
        speed_deviation=speed_sd,
        attack_deviation=attack_sd,
        known=_known(store, log.index),
        motion=motion,
        velocity=np.nan_to_num(np.stack(horizontal(log, calibration, motion), axis=1), nan=0.0),
        depth=store.row("measured_depth", log.index)[:count].astype(float),
        water_up=np.where(log.use, log.filtered(sink) - log.depth_rate, np.nan),
        sink_rate=sink,
        descending=down & log.use,
        ascending=up & log.use,
        ctd=ctd,
    )


def _known(store: MissionStore, mission: int) -> float:
    count = int(store.samples[mission])
    depth, pitch, heading = (
        store.row(f"measured_{name}", mission)[:count] for name in ("depth", "pitch", "heading")
    )
    under = depth > UNDER_WATER
    return float(np.isfinite(pitch + heading)[under].mean()) if under.any() else 1.0


def still(store: MissionStore, mission: int, ctd: CtdSeries | None) -> FlownDive:
    """Flight of a mission that no model can fly: the vehicle moves with the water."""
    count = int(store.samples[mission])
    unknown, no = np.full(count, np.nan), np.zeros(count, bool)
    return FlownDive(
        mission=mission,
        motion=None,
        velocity=np.zeros((count, 2)),
        depth=store.row("measured_depth", mission)[:count].astype(float),
        water_up=unknown,
        sink_rate=unknown,
        descending=no,
        ascending=no,
        ctd=ctd,
        speed_deviation=unknown,
        attack_deviation=unknown,
    )


def _heave(log: Log, calibration: Calibration, motion: Translation) -> Array:
    """Solve the filtered depth rate for heave [m/s], for an estimator without heave."""
    pitch, roll = calibration.true_pitch(log.pitch), log.roll
    sway = np.nan_to_num(motion.sway, nan=0.0)
    rest = log.depth_rate + motion.surge * np.sin(pitch) - sway * np.cos(pitch) * np.sin(roll)
    cosine = np.cos(pitch) * np.cos(roll)
    return np.asarray(rest * cosine / np.maximum(cosine**2, LEAST_COSINE**2))
