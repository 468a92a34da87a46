"""Flight estimators: ways to the velocity through the water of a logged dive, a seam.

The steady model has its forces in balance at every sample (`twin.identify.start_values`); the
flight model integrates the three equations of translation (`twin.identify.translation`).
"""

from __future__ import annotations

import abc
from typing import ClassVar, Self

from twin import seams
from twin.errors import InputError
from twin.identify.calibration import Calibration
from twin.identify.logged_missions import Log
from twin.identify.speed import motion_of
from twin.identify.translation import Translation
from twin.records.reader import MissionStore
from twin.registry import Registry


class FlightEstimator(abc.ABC):
    """A way to estimate how a logged vehicle moved through the water.

    Speed, track and currents are made of its velocities. The vertical velocity of the water always
    is what the flight model of the vehicle leaves of the depth rate: an estimator that solves for
    heave from the depth rate has nothing to say on it.
    """

    kind: ClassVar[str]
    """What the user types: `twin flight --estimator KIND` or `KIND:ARGUMENT`."""
    summary: ClassVar[str]
    """What it does, for help texts and documents."""

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
        self,
        store: MissionStore,
        log: Log,
        calibration: Calibration,
        start: tuple[float, float, float],
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


class SteadyModel(FlightEstimator):
    """The flight model of glider pilots, without inertia."""

    kind = "steady"
    summary = "forces in balance at every sample, zero at inflections"
    modelled = True

    def motion(
        self,
        store: MissionStore,
        log: Log,
        calibration: Calibration,
        start: tuple[float, float, float],
    ) -> Translation:
        """See `FlightEstimator.motion`; `start` plays no part in a balance."""
        return motion_of(log, calibration, "steady")


class FlightModel(FlightEstimator):
    """Weight, buoyancy, drag and lift with the vehicle's inertia."""

    kind = "flight"
    summary = "the vehicle's flight model with its inertia"
    modelled = True

    def motion(
        self,
        store: MissionStore,
        log: Log,
        calibration: Calibration,
        start: tuple[float, float, float],
    ) -> Translation:
        """See `FlightEstimator.motion`."""
        return motion_of(log, calibration, start=start)
