"""Controllers in Python: what one sees, what it answers, and guidance as the first of them.

The simulation calls a controller once per control period of its vehicle. Anything callable with
this signature will do: a function, a trained policy, an object with a memory.

A schedule replaces it by commands that are each held until the next one; followed positions
replace what guidance commands one part by those of a log.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.compiled import borrowing
from twin.errors import InputError, MissionError, unknown_name
from twin.mission import Mission
from twin.mission.guidance import guidance_step, new_state
from twin.mission.mission_file import ABORTED, DEPTH_OFFSET, DONE, HOLDING, PHASE, SEGMENT
from twin.mission.reckoning import altitude_read, compass, heading_read
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True, slots=True)
class Observation:
    """The vehicle as its controller sees it: NED, FRD, SI."""

    time: float
    """[s] since the mission's start"""
    depth: float
    """[m] of the CB, positive down"""
    roll: float
    """[rad], positive starboard down"""
    pitch: float
    """[rad], positive nose up"""
    heading: float
    """[rad] true, in [0, 2 pi)"""
    roll_rate: float
    """p [rad/s]"""
    pitch_rate: float
    """q [rad/s]"""
    yaw_rate: float
    """r [rad/s]"""
    parts: Mapping[str, float]
    """position of each part by its name, in the part's unit"""
    altitude: float = math.inf
    """[m] of the CB above the sea floor; inf where there is none"""
    north: float = math.nan
    """[m] of the vehicle: what a fix at the surface says, or a navigator at any time; NaN: none"""
    east: float = math.nan
    """[m], likewise"""
    current_north: float = math.nan
    """[m/s] a navigator's estimate of the current; NaN: no navigator, guidance dead-reckons"""
    current_east: float = math.nan
    """[m/s], likewise"""
    fixed: bool = False
    """True where a receiver has a fix: it is at the surface, whatever its depth says"""

    def __getattr__(self, name: str) -> float:
        """A part's position by its name: `observation.pump`."""
        parts = object.__getattribute__(self, "parts")
        if name in parts:
            return float(parts[name])
        known = [*(name for name in self.__slots__ if name != "parts"), *parts]
        raise AttributeError(unknown_name("field of an observation", name, known))


def misread(seen: Observation, gains: Array, memory: Array, surfaced: float) -> Observation:
    """The observation by instruments that err, as guidance reads them.

    Args:
      seen: the truth.
      gains: with the errors of the instruments, shape (GAINS,).
      memory: as guidance's state, zeros at first; it is updated.
      surfaced: [m] depth of the CB above which a receiver has a fix.
    """
    altitude = altitude_read(gains, memory, seen.time, seen.altitude)
    memory[PHASE] = HOLDING  # begun
    return dataclasses.replace(
        seen,
        depth=seen.depth + float(gains[DEPTH_OFFSET]),
        heading=compass(heading_read(gains, seen.heading)),
        altitude=altitude,
        fixed=seen.depth <= surfaced,
    )


class Command(Mapping[str, float]):
    """Wanted positions by part: `Command(shift=0.02, pump=-200.0)`; parts left out rest.

    The parts follow with their lags, rates and limits. Units are the parts' own: a glider's shift
    is in m, its rotation in rad, its pump in cm3.
    """

    def __init__(self, **positions: float):
        for name, value in positions.items():
            if not isinstance(value, int | float | np.number) or not math.isfinite(value):
                raise InputError(f"command: {name} = {value!r} must be a finite number")
        self._positions = {name: float(value) for name, value in positions.items()}

    def __getitem__(self, name: str) -> float:
        return self._positions[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._positions)

    def __len__(self) -> int:
        return len(self._positions)

    def __repr__(self) -> str:
        return f"Command({', '.join(f'{k}={v:g}' for k, v in self._positions.items())})"

    def as_array(self, vehicle: Vehicle) -> NDArray[np.float64]:
        """Positions of all parts of `vehicle`, shape (parts,).

        Raises:
          InputError: the vehicle has no part of some name; the nearest is offered.
        """
        values = vehicle.rest
        for name, value in self._positions.items():
            if name not in vehicle.part_names:
                what = f"command: part of vehicle {vehicle.name!r}"
                raise InputError(unknown_name(what, name, vehicle.part_names))
            values[vehicle.part_names.index(name)] = value
        return values


class Controller(Protocol):
    """Called once per control period, in the order of time."""

    def __call__(self, observation: Observation) -> Command:
        """The command that holds until the next call."""
        ...


class MissionController:
    """A mission flown from Python by the same compiled guidance as in the native plant.

    Use it to wrap the guidance (noise on the observation, a limit on the command) or in loops that
    are not ours. It remembers where the mission is: make a new one for every flight.
    """

    def __init__(self, mission: Mission, vehicle: Vehicle):
        """Compile `mission` for `vehicle`; raises MissionError when it cannot be flown."""
        self.table, self.gains = mission.compile(vehicle)
        self.state = new_state()
        self._names = vehicle.part_names
        self._needs_floor = mission.needs_floor
        self._command = np.zeros(len(self._names))

    def __call__(self, observation: Observation) -> Command:
        """One guidance tick.

        Raises:
          MissionError: it is flown above the sea floor, and the observation has none.
        """
        o = observation
        if self._needs_floor and math.isinf(o.altitude):
            raise MissionError(
                f"the mission goes by {self._needs_floor}, and the observation has no altitude: "
                "fly it in a scenario with a sea floor, such as floor=FlatFloor(depth_m=200)"
            )
        guidance_step(
            self.table, self.gains, self.state, o.time, o.depth, o.roll, o.pitch, o.heading,
            o.roll_rate, o.pitch_rate, o.yaw_rate, self._command, o.altitude, o.north, o.east,
            o.current_north, o.current_east, float(o.fixed),
        )  # fmt: skip
        return Command(**dict(zip(self._names, self._command.tolist(), strict=True)))

    @property
    def segment(self) -> int:
        """Index of the segment being flown; the number of segments once they are flown."""
        return int(self.state[SEGMENT])

    @property
    def done(self) -> bool:
        """True once the plan is flown, and the surface reached where it ends there."""
        return bool(self.state[DONE])

    @property
    def aborted(self) -> bool:
        """True once the mission's maximum depth was exceeded."""
        return bool(self.state[ABORTED])


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
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}


MEMORY = 2
"""Numbers that `followed` remembers, at first 0: first position of the leg, and its begin [s]"""
FOLLOWED_HEAD = 3
"""Numbers of a table before those of its segments"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FollowedPositions:
    """The positions of one part, whatever guidance commands it.

    Each leg of the mission has a piece of them, which begins when the leg does; a leg that takes
    longer keeps the last one.
    """

    part: int
    """index of the vehicle's part"""
    period: float
    """[s] between two positions"""
    positions: Array
    """within the part's travel, in its unit, (time,)"""
    legs: tuple[tuple[int, int], ...]
    """first and last position of the leg of each segment of the mission"""

    def table(self) -> Array:
        """What `followed` reads: part, period, segments, their legs, positions."""
        head = [self.part, self.period, len(self.legs)]
        return np.concatenate([head, np.ravel(self.legs), self.positions]).astype(float)


@borrowing(nogil=True)
def followed(table, memory, time, segment):  # type: ignore[no-untyped-def]
    """Position of the part at a time [s] in a segment of the mission.

    Args:
      table: of `FollowedPositions.table`. memory: (MEMORY,); it is updated.
    """
    count = int(table[2])
    k = FOLLOWED_HEAD + 2 * min(int(segment), count - 1)
    if table[k] != memory[0]:
        memory[0], memory[1] = table[k], time
    place = min(table[k] + round((time - memory[1]) / table[1]), table[k + 1])
    return table[FOLLOWED_HEAD + 2 * count + int(place)]
