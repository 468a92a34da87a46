"""Trajectory: what one simulated mission was, as named arrays in NED and FRD.

The names are the schema's: `true_*` is what happened, `commanded_*` what was asked for;
`measured_*` is added by the sensor models. `VARIABLES` says what each one is.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One mission, sampled at a fixed period.

    `signals` maps schema names to float64 arrays of shape (time,); `states` holds the MuJoCo rows
    (time, 23): qpos 9, qvel 8, act 3, ctrl 3, from which any sample can be rendered or resumed.
    """

    time: Array
    """[s] since the start, shape (time,)."""
    signals: dict[str, Array]
    states: Array
    complete: bool = True
    """False when the simulation stopped early (unstable)."""
    provenance: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __getitem__(self, name: str) -> Array:
        return self.signals[name]

    @property
    def position(self) -> Array:
        """North, east, depth [m], shape (time, 3)."""
        return np.stack([self[f"true_{n}"] for n in ("north", "east", "depth")], axis=-1)

    @property
    def v_rel(self) -> Array:
        """Surge, sway, heave through the water [m/s], body FRD, shape (time, 3)."""
        return np.stack([self[f"true_{n}"] for n in ("surge", "sway", "heave")], axis=-1)

    def distance_through_water(self) -> Array:
        """Path length through the water [m] up to each sample, shape (time,)."""
        return _cumulative(np.linalg.norm(self.v_rel, axis=-1), self.time)

    def track_through_water(self) -> Array:
        """North, east [m] that the glider moved relative to the water, shape (time, 2)."""
        north = self["true_velocity_north"] - self["true_current_north"]
        east = self["true_velocity_east"] - self["true_current_east"]
        return np.stack([_cumulative(north, self.time), _cumulative(east, self.time)], axis=-1)


def _cumulative(rate: Array, time: Array) -> Array:
    """Trapezoidal integral from 0, same shape as `rate`."""
    steps = np.diff(time) * (rate[1:] + rate[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])


def sample_times(count: int, period: float) -> Array:
    """Times [s] of samples 0, 1, 2, ... at a `period` [s], each rounded once, shape (count,).

    Whole seconds are whole numbers, also for periods such as 0.1 that no float holds exactly.
    """
    ratio = Fraction(period).limit_denominator(_FINEST_FRACTION)
    if not math.isclose(ratio, period, rel_tol=1e-15):
        return np.arange(count, dtype=float) * period
    return np.arange(count, dtype=float) * ratio.numerator / ratio.denominator


_FINEST_FRACTION = 10_000
"""Largest denominator of a sample period in seconds: physics steps are 1e-4 s or longer"""


SETPOINTS = ("roll", "pitch", "heading", "depth", "speed")
"""What guidance asks of the vehicle's motion; every other command is a part's position."""


def actuator_names(signals: Iterable[str]) -> tuple[str, ...]:
    """The vehicle's moving parts: names with both a true position and a command, in order.

    Args:
      signals: names of signals, as `trajectory.signals` holds them.
    """
    there = dict.fromkeys(signals)
    names = (name.removeprefix("true_") for name in there if name.startswith("true_"))
    return tuple(n for n in names if n not in SETPOINTS and f"commanded_{n}" in there)
