"""Controllers in Python: what one sees, what it answers, and guidance as the first of them.

The simulation calls a controller once per control period of its vehicle. Anything callable with
this signature will do: a function, a trained policy, an object with a memory.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.mission import Mission, guidance
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
    shift: float
    """[m], positive forward"""
    rotation: float
    """[rad], positive turns to starboard"""
    pump: float
    """[cm3], positive lighter"""


@dataclass(frozen=True, kw_only=True, slots=True)
class Command:
    """Wanted actuator positions; the actuators follow with their lags, rates and limits."""

    shift: float = 0.0
    """[m], positive forward (nose down)"""
    rotation: float = 0.0
    """[rad], positive turns to starboard"""
    pump: float = 0.0
    """[cm3], positive lighter"""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not math.isfinite(value):
                raise InputError(f"command: {name} = {value!r} must be a finite number")

    def as_array(self) -> NDArray[np.float64]:
        """Shape (3,) in the order of the actuators: shift, rotation, pump."""
        return np.array([self.shift, self.rotation, self.pump])


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
        self.state = guidance.new_state()
        self._command = np.zeros(3)

    def __call__(self, observation: Observation) -> Command:
        """One guidance tick."""
        o = observation
        guidance.guidance_step(
            self.table,
            self.gains,
            self.state,
            o.time,
            o.depth,
            o.roll,
            o.pitch,
            o.heading,
            o.roll_rate,
            o.pitch_rate,
            o.yaw_rate,
            o.shift,
            o.rotation,
            o.pump,
            self._command,
        )
        shift, rotation, pump = (float(x) for x in self._command)
        return Command(shift=shift, rotation=rotation, pump=pump)

    @property
    def segment(self) -> int:
        """Index of the segment being flown; the number of segments once they are flown."""
        return int(self.state[guidance.SEGMENT])

    @property
    def done(self) -> bool:
        """True once the plan is flown, and the surface reached where it ends there."""
        return bool(self.state[guidance.DONE])

    @property
    def aborted(self) -> bool:
        """True once the mission's maximum depth was exceeded."""
        return bool(self.state[guidance.ABORTED])
