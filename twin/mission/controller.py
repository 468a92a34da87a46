"""Controllers in Python: observation, command, and guidance (`MissionController`) as a controller.

The simulation calls a controller once per control period of its vehicle. Any callable with this
signature works: a function, a trained policy, an object with a memory.

A schedule replaces the controller by commands that each hold until the next one. Followed positions
replace guidance's commands to one vehicle part by the positions of a log.
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
    """State of the vehicle that its controller observes: NED, FRD, SI."""

    time: float
    """[s] Time since the mission's start."""
    depth: float
    """[m] Depth of the centre of buoyancy, positive down."""
    roll: float
    """[rad] Roll, positive starboard down."""
    pitch: float
    """[rad] Pitch, positive nose up."""
    heading: float
    """[rad] True heading, in [0, 2 pi)."""
    roll_rate: float
    """[rad/s] Roll rate p."""
    pitch_rate: float
    """[rad/s] Pitch rate q."""
    yaw_rate: float
    """[rad/s] Yaw rate r."""
    parts: Mapping[str, float]
    """Position of each part by name, in the part's unit."""
    altitude: float = math.inf
    """[m] Altitude of the centre of buoyancy above the sea floor; inf without a sea floor."""
    north: float = math.nan
    """[m] Position north, from a fix at the surface, or from a navigator; NaN: unknown."""
    east: float = math.nan
    """[m] Position east, from the same source."""
    current_north: float = math.nan
    """[m/s] Navigator's estimate of the current; NaN: no navigator, so guidance dead-reckons."""
    current_east: float = math.nan
    """[m/s] Navigator's estimate of the current eastward."""
    fixed: bool = False
    """True if a receiver has a fix: the vehicle is at the surface, whatever its depth reads."""

    def __getattr__(self, name: str) -> float:
        """Position of a part by its name: `observation.pump`."""
        parts = object.__getattribute__(self, "parts")
        if name in parts:
            return float(parts[name])
        known = [*(name for name in self.__slots__ if name != "parts"), *parts]
        raise AttributeError(unknown_name("field of an observation", name, known))


def misread(seen: Observation, gains: Array, memory: Array, surfaced: float) -> Observation:
    """Apply the errors of guidance's instruments to an observation.

    Args:
      seen: the true observation.
      gains: gains with the errors of the instruments, shape (GAINS,).
      memory: as long as guidance's state, zeros at the start; holds the last altitude; updated.
      surfaced: [m] depth of the CB above which a receiver has a fix.
    """
    altitude = altitude_read(gains, memory, seen.time, seen.altitude)
    memory[PHASE] = HOLDING  # any phase but NOT_STARTED
    return dataclasses.replace(
        seen,
        depth=seen.depth + float(gains[DEPTH_OFFSET]),
        heading=compass(heading_read(gains, seen.heading)),
        altitude=altitude,
        fixed=seen.depth <= surfaced,
    )


class Command(Mapping[str, float]):
    """Commanded positions by part: `Command(shift=0.02, pump=-200.0)`; other parts go to rest.

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
          InputError: the vehicle has no part of that name; the nearest name is offered.
        """
        values = vehicle.rest
        for name, value in self._positions.items():
            if name not in vehicle.part_names:
                what = f"command: part of vehicle {vehicle.name!r}"
                raise InputError(unknown_name(what, name, vehicle.part_names))
            values[vehicle.part_names.index(name)] = value
        return values


class Controller(Protocol):
    """Callable that the simulation calls once per control period, in the order of time."""

    def __call__(self, observation: Observation) -> Command:
        """Return the command that holds until the next call."""
        ...


class MissionController:
    """Controller that flies a mission with the same compiled guidance as the native plant.

    Use it to wrap guidance (noise on the observation, a limit on the command) or in a simulation
    loop of your own. It remembers the progress of the mission: make a new one for every flight.
    """

    def __init__(self, mission: Mission, vehicle: Vehicle):
        """Compile `mission` for `vehicle`; raises MissionError when it cannot be flown."""
        self.table, self.gains = mission.compile(vehicle)
        self.state = new_state()
        self._names = vehicle.part_names
        self._needs_floor = mission.needs_floor
        self._command = np.zeros(len(self._names))

    def __call__(self, observation: Observation) -> Command:
        """Run one guidance tick.

        Raises:
          MissionError: the mission flies above the sea floor, and the observation has no altitude.
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
        """Index of the segment in progress; after the last one, the number of segments."""
        return int(self.state[SEGMENT])

    @property
    def done(self) -> bool:
        """True once all segments are flown, and the surface reached if the mission ends there."""
        return bool(self.state[DONE])

    @property
    def aborted(self) -> bool:
        """True once the mission's maximum depth was exceeded."""
        return bool(self.state[ABORTED])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Schedule:
    """Commands that are piecewise constant in time, for the MuJoCo twin or the Fossen model.

    Raises:
      MissionError: lengths differ, times do not increase, or a number is not finite.
    """

    times: ArrayLike
    """[s] Times of the commands, shape (k,), increasing; the first is not after the start."""
    commands: ArrayLike
    """Position of each part of the vehicle, in their order and units, shape (k, parts). A glider's
    are shift [m], rotation [rad] and pump [cm3]."""

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
        """Table for native code: rows of time and positions of all parts, shape (k, 1 + parts)."""
        return np.column_stack([np.asarray(self.times), np.asarray(self.commands)])

    def check(self, vehicle: Vehicle) -> None:
        """Raise MissionError if the commands have another number of parts than the vehicle."""
        width = np.asarray(self.commands).shape[1]
        if width != len(vehicle.parts):
            raise MissionError(
                f"schedule: commands have {width} columns, vehicle {vehicle.name!r} has "
                f"{len(vehicle.parts)} parts: {', '.join(vehicle.part_names)}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Describe the schedule as a dict for JSON; `Schedule(**dict)` gives an equal schedule."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}


MEMORY = 2
"""Numbers in the memory of `followed`: index of the leg's first position, start of the leg [s]."""
FOLLOWED_HEAD = 3
"""Count of numbers in a table before the legs of its segments."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FollowedPositions:
    """Positions of one part, for a run in which guidance does not command that part.

    Each segment of the mission has a leg of positions, which starts with the segment. If the
    segment takes longer, the part keeps the last position.
    """

    part: int
    """Index of the vehicle's part."""
    period: float
    """[s] Time between two positions."""
    positions: Array
    """Positions within the part's travel, in its unit, (time,)."""
    legs: tuple[tuple[int, int], ...]
    """Index of the first and the last position for each segment of the mission."""

    def table(self) -> Array:
        """Table that `followed` reads: part, period, number of segments, their legs, positions."""
        head = [self.part, self.period, len(self.legs)]
        return np.concatenate([head, np.ravel(self.legs), self.positions]).astype(float)


@borrowing(nogil=True)
def followed(table, memory, time, segment):  # type: ignore[no-untyped-def]
    """Position of the followed part at a time [s] in a segment of the mission.

    Args:
      table: of `FollowedPositions.table`. memory: (MEMORY,); it is updated.
    """
    count = int(table[2])
    k = FOLLOWED_HEAD + 2 * min(int(segment), count - 1)
    if table[k] != memory[0]:
        memory[0], memory[1] = table[k], time
    place = min(table[k] + round((time - memory[1]) / table[1]), table[k + 1])
    return table[FOLLOWED_HEAD + 2 * count + int(place)]
