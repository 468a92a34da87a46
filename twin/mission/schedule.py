"""Schedule: actuator commands, each held until the next one; an open-loop manoeuvre."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import MissionError

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Schedule:
    """Commands, piecewise constant in time, for either model.

    Raises:
      MissionError: lengths differ, times do not increase, or something is not finite.
    """

    times: ArrayLike
    """[s], shape (k,), increasing; the first not after the start"""
    commands: ArrayLike
    """position of each part of the vehicle, in their order and units, shape (k, parts); the
    glider's are shift [m], rotation [rad], pump [cm3]"""

    def __post_init__(self) -> None:
        times = np.atleast_1d(np.array(self.times, dtype=np.float64))
        commands = np.atleast_2d(np.array(self.commands, dtype=np.float64))
        if times.ndim != 1 or commands.ndim != 2 or len(commands) != times.size:
            raise MissionError(
                f"schedule: {times.size} times need commands of shape ({times.size}, parts), "
                f"not {commands.shape}"
            )
        if not (np.isfinite(times).all() and np.isfinite(commands).all()):
            raise MissionError("schedule: times and commands must be finite")
        if times.size == 0 or np.any(np.diff(times) <= 0.0):
            raise MissionError("schedule times must increase and hold at least one time")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "commands", commands)

    def table(self) -> Array:
        """Rows (time, then the position of each part) for native code, shape (k, 1 + parts)."""
        return np.column_stack([np.asarray(self.times), np.asarray(self.commands)])

    def check(self, vehicle: Vehicle) -> None:
        """Raise MissionError when the commands have another width than the vehicle."""
        width = np.asarray(self.commands).shape[1]
        if width != len(vehicle.parts):
            raise MissionError(
                f"schedule: commands have {width} columns, vehicle {vehicle.name!r} has "
                f"{len(vehicle.parts)} parts: {', '.join(vehicle.part_names)}"
            )

    def to_dict(self) -> dict[str, Any]:
        """JSON-able form; `Schedule(**form)` is equal."""
        return {
            "times": np.asarray(self.times).tolist(),
            "commands": np.asarray(self.commands).tolist(),
        }
