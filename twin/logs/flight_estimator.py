"""Flight estimators, an extension point, and the dives that they say were flown.

The steady model has its forces in balance at every sample (`twin.identify.speed`); the
flight model integrates the three equations of translation (`twin.identify.translation`).
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
from twin.identify.speed import horizontal, motion_of, start_of
from twin.identify.translation import Translation, Velocity
from twin.logs.thermal_lag import CtdSeries
from twin.records.reader import MissionStore
from twin.registry import Registry

LEAST_COSINE = 0.2
"""cos(pitch) cos(roll) below which heave cannot be solved for"""
LEAST_KNOWN = 0.9
"""[1] of the time under water: what a cut log does not say is a guess, and no current follows"""
UNDER_WATER = 3.0
"""[m]"""
DESCENT, CLIMB = 1, 2
"""Flags of `measured_phase`"""
LEVEL_RATE = 0.03
"""[m/s] below which a vehicle turns or flies level, as the import's phases have it"""


class FlightEstimator(abc.ABC):
    """A way to estimate how a logged vehicle moved through the water.

    Speed, track and currents are made of its velocities. The vertical velocity of the water always
    is what the flight model of the vehicle leaves of the depth rate: an estimator that solves for
    heave from the depth rate has nothing to say on it.
    """

    kind: ClassVar[str]
    """Name that the user types: `twin flight --estimator KIND` or `KIND:ARGUMENT`."""
    summary: ClassVar[str]
    """One line for help texts and documents."""

    modelled: ClassVar[bool] = False
    """Whether its speed is the flight model's, so that the depth rate tells its error."""

    @classmethod
    def open(cls, argument: str) -> Self:
        """Make one; `argument` is what stood behind the colon, empty without.

        Raises:
          InputError: an argument that it does not take.
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
          store: for signals that the log has not; `log.index` is its mission.
          log: the dive, its density corrected.
          calibration: the vehicle and the errors of its sensors.
          start: surge, sway, heave [m/s] at the first sample, from depth rate and pitch.

        Raises:
          StoreError: the store lacks a signal that it needs.
        """


ESTIMATORS: Registry[type[FlightEstimator]] = seams.FLIGHT_ESTIMATORS
"""Every way to the velocity through the water, by name."""

register = ESTIMATORS.add
"""Add a kind of one's own; usable as a decorator."""


def open_estimator(text: str) -> FlightEstimator:
    """The estimator that a text such as "flight" or "network:runs/mine" names.

    Raises:
      InputError: an unknown kind, or an argument that it does not take.
    """
    kind, _, argument = text.partition(":")
    return ESTIMATORS[kind].open(argument)


class FlightModel(FlightEstimator):
    """Weight, buoyancy, drag and lift with the vehicle's inertia."""

    kind = "flight"
    summary = "the vehicle's flight model with its inertia"
    modelled = True
    inertia: ClassVar[bool] = True

    def motion(
        self, store: MissionStore, log: Log, calibration: Calibration, start: Velocity
    ) -> Translation:
        """See `FlightEstimator.motion`; `start` plays no part in a balance."""
        return motion_of(log, calibration, "flight" if self.inertia else "steady", start=start)


class SteadyModel(FlightModel):
    """The flight model of glider pilots, without inertia."""

    kind = "steady"
    summary = "forces in balance at every sample, zero at inflections"
    inertia = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownDive:
    """One mission; arrays are (time,), NaN where nothing is known."""

    mission: int
    """Row in the store."""
    motion: Translation | None
    """Through the water, body FRD; None for a mission that no model can fly"""
    velocity: Array
    """North, east through the water [m/s], (time, 2); zero where it is not known"""
    depth: Array
    """[m] as stored"""
    water_up: Array
    """[m/s] vertical velocity of the water, positive up, filtered as the log's depth rate"""
    sink_rate: Array
    """[m/s] downward through the water by the flight model: the depth rate in still water"""
    descending: Mask
    """In a dive, away from its turns and the surface"""
    ascending: Mask
    """In a climb"""
    ctd: CtdSeries | None
    """Corrected; None without one"""
    known: float = 1.0
    """[1] Part of the time under water in which the log has an attitude"""

    @property
    def tells_current(self) -> bool:
        """Whether its way through the water is known well enough for a current."""
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
      store: of the dive.
      log: the dive.
      calibration: the vehicle and the errors of its sensors.
      estimator: for the velocity through the water.
      raw: its CTD as stored, None without.
      ctd: the same with its thermal lag corrected.
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
    return FlownDive(
        mission=log.index,
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
    """A mission that no model can fly: it moved with the water."""
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
    )


def _heave(log: Log, calibration: Calibration, motion: Translation) -> Array:
    """Heave [m/s] that the filtered depth rate leaves to an estimator without one."""
    pitch, roll = calibration.true_pitch(log.pitch), log.roll
    sway = np.nan_to_num(motion.sway, nan=0.0)
    rest = log.depth_rate + motion.surge * np.sin(pitch) - sway * np.cos(pitch) * np.sin(roll)
    cosine = np.cos(pitch) * np.cos(roll)
    return np.asarray(rest * cosine / np.maximum(cosine**2, LEAST_COSINE**2))
