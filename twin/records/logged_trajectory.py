"""Logged trajectory: a log, with estimates where a simulation has its truth.

Nobody knows the truth of a vehicle at sea. Pictures show the best that there is in its place: the
track corrected at the fixes, the measured attitude and depth, the velocity of a Doppler log or of
the flight model, the current of a profiler or the mean over the dive. Those signals stand under the
names of the truth (`true_north`, `true_pitch` ...), and `sources` says of each what it is, so that
every label can. `twin.flight.logged_trajectory` makes them.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.geodesy import position, wrap_longitude
from twin.records.place import START_LATITUDE, START_LONGITUDE
from twin.records.schema import VARIABLES
from twin.records.trajectory import Trajectory, actuator_names

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class LoggedTrajectory(Trajectory):
    """One mission of a log, or several in a row, on one clock and in one frame."""

    sources: dict[str, str]
    """What each true_* signal is, such as {"true_north": "corrected track"}."""
    starts: tuple[int, ...] = (0,)
    """First sample of each mission"""
    vehicle: str | None = None
    """Whose flight model it is; None where none was flown"""
    unflown: str = ""
    """Why none was"""

    @property
    def actuators(self) -> tuple[str, ...]:
        """The moving parts whose positions the log has; a command need not be logged."""
        return tuple(part for part in actuator_names(VARIABLES) if f"true_{part}" in self)

    def geographic_position(self) -> tuple[Array, Array]:
        """Latitude and longitude [degree, WGS84] of the track, each of shape (time,).

        Raises:
          InputError: the log does not say where on Earth it began.
        """
        if START_LATITUDE not in self.provenance:
            raise InputError("this log does not say where on Earth it began")
        place = (self.provenance[START_LATITUDE], self.provenance[START_LONGITUDE])
        latitude, longitude = position(self["true_north"], self["true_east"], *place)
        return latitude, wrap_longitude(longitude)

    def distance_through_water(self) -> Array:
        """Path length through the water [m] up to each sample, shape (time,); without the samples
        whose speed is unknown."""
        speed = np.nan_to_num(np.linalg.norm(self.v_rel, axis=-1), nan=0.0)
        steps = np.diff(self.time) * (speed[1:] + speed[:-1]) / 2
        return np.concatenate([[0.0], np.cumsum(steps)])


def source_of(trajectory: Trajectory, name: str, default: str) -> str:
    """What a true_* signal of a trajectory is: `default` where it is the truth of a simulation.

    Args:
      name: of the signal, such as "true_north".
      default: the word for a simulation, such as "truth".
    """
    if isinstance(trajectory, LoggedTrajectory):
        return trajectory.sources.get(name, default)
    return default


AVERAGED = "depth-averaged current"
"""The source of a current that is one number for each dive"""
MEASURED = "measured"
"""The source of a signal that the log's own sensor measured"""
