"""On-board track: the position that a vehicle dead-reckons and logs by itself.

Buoyancy gliders, `speed_by="depth-rate"` (OceanGliders' depth-averaged current procedure: Slocum
takes the horizontal speed as w / tan(|pitch| + |angle of attack|), Spray assumes an angle of
attack of 3 deg):

1. The depth rate is the change of the measured depth over the last `window` seconds, and the pitch
   is the mean measured pitch over the same window.
2. The horizontal speed is |depth rate| / tan(|pitch| + angle of attack), at most `max_speed`. It is
   held while the pitch is below `min_pitch` or the depth rate has the wrong sign for the pitch (at
   inflections), and is 0 above `surface_depth`.
3. The position moves by that speed along the measured heading, plus the last depth-averaged
   current if `use_current`.
4. A GPS fix resets the position. The first fix after at least `min_dive_time` without one also
   gives the depth-averaged current: the current used plus (fix - position) / time since the last
   fix.

Propelled vehicles with a Doppler log, `speed_by="dvl"`: the measured body velocity, turned by the
measured roll, pitch and heading, moves the position. Without lock the last velocity is held. A
velocity through the water gets the depth-averaged current added, which a fix gives after at least
`min_dive_time` of water lock; a velocity over ground does not.

The track starts at the mission's origin, or at the first fix if there is one at the start.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.numbers import Array
from twin.records.schema import variables
from twin.sensors.base import (
    Outset,
    Sensor,
    SensorRun,
    Signals,
    columns,
    require_non_negative,
    require_positive,
    signal,
)
from twin.sensors.kernels import dvl_track_kernel, onboard_kernel

DEPTH_RATE, DVL = "depth-rate", "dvl"
SPEEDS = (DEPTH_RATE, DVL)
DVL_READS = (
    "measured_roll", "measured_dvl_surge", "measured_dvl_sway", "measured_dvl_heave",
    "measured_dvl_mode",
)  # fmt: skip


class OnboardTrack(NamedTuple):
    """Track and currents from the measured signals; each of shape (n,)."""

    north: Array
    """[m] Distance north of the mission's origin."""
    east: Array
    """[m] Distance east of the mission's origin."""
    current_north: Array
    """[m/s] Latest depth-averaged current toward north, 0 before the first."""
    current_east: Array
    """[m/s] Latest depth-averaged current toward east, 0 before the first."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Onboard(Sensor):
    """Settings of the vehicle's own dead reckoning. The algorithm has no errors that could be
    switched off: with ideal devices it still shows the cost of its assumptions."""

    name = "onboard"
    reads = (
        "measured_depth", "measured_pitch", "measured_heading",
        "measured_gps_north", "measured_gps_east",
    )  # fmt: skip
    writes = variables("measured_onboard_north", "measured_onboard_east")
    unset: ClassVar[Mapping[str, Any]] = {"speed_by": DEPTH_RATE}

    speed_by: str = DEPTH_RATE
    """Source of the speed: "depth-rate" or "dvl"."""
    angle_of_attack_deg: float = 3.0
    """[deg] Angle of attack in every glide, as Spray assumes; the Sea-Wing's is 1.3 to 3 deg"""
    window: float = 20.0
    """[s] Time over which depth rate and mean pitch are taken"""
    min_pitch_deg: float = 10.0
    """[deg] Pitch below which the last speed is held"""
    surface_depth: float = 1.0
    """[m] Depth above which the vehicle counts as surfaced"""
    max_speed: float = 1.0
    """[m/s] Upper bound of the speed by depth rate; no buoyancy glider keeps a larger one"""
    use_current: bool = True
    """True: add the last depth-averaged current"""
    min_dive_time: float = 300.0
    """[s] Shortest time without a fix that gives a depth-averaged current"""

    def __post_init__(self) -> None:
        if self.speed_by not in SPEEDS:
            raise InputError(f"Onboard: {unknown_name('speed_by', str(self.speed_by), SPEEDS)}")
        require_non_negative(self, "angle_of_attack_deg", "surface_depth", "min_dive_time")
        require_positive(self, "window", "max_speed", "min_pitch_deg")
        for name in ("angle_of_attack_deg", "min_pitch_deg"):
            if getattr(self, name) >= 90.0:
                raise InputError(
                    f"Onboard.{name} is {getattr(self, name):g} deg: it must be below 90"
                )

    @classmethod
    def ideal(cls) -> Onboard:
        """Make the defaults: the algorithm has no error of its own."""
        return cls()

    def inputs(self, signals: Iterable[str]) -> tuple[str, ...]:
        """Depth, attitude and GPS, and the Doppler log if it gives the speed."""
        return self.reads + (DVL_READS if self.speed_by == DVL else ())

    def track(self, measured: Signals, *, dt: float) -> OnboardTrack:
        """Compute the track from measured depth, pitch, heading and GPS every dt [s]."""
        n = signal(measured, "measured_depth").shape[0]
        return OnboardTrack(*OnboardRun(self, dt).rows(measured, 0, n))

    def begin(self, outset: Outset) -> OnboardRun:
        """Begin to measure measured_onboard_north and measured_onboard_east [m]."""
        return OnboardRun(self, outset.dt)


@dataclasses.dataclass
class OnboardRun(SensorRun):
    """Dead reckoning in one mission."""

    onboard: Onboard
    dt: float
    carried: Array = dataclasses.field(default_factory=lambda: np.zeros(8))
    """Position, current, speed and times, in the kernels' order."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        rows = self.rows(signals, first, last)
        return {"measured_onboard_north": rows[0], "measured_onboard_east": rows[1]}

    def rows(self, measured: Signals, first: int, last: int) -> Array:
        """Compute the fields of `OnboardTrack` for a stretch of samples, shape (4, stretch)."""
        its, dt = self.onboard, self.dt
        out = np.empty((4, last - first))
        if its.speed_by == DVL:
            self._by_dvl(measured, slice(first, last), out)
            return out
        onboard_kernel(
            *columns(measured, its.reads), dt, max(1, round(its.window / dt)),
            math.radians(its.angle_of_attack_deg), math.radians(its.min_pitch_deg),
            its.surface_depth, its.max_speed, its.min_dive_time, its.use_current, self.carried,
            first, out,
        )  # fmt: skip
        return out

    def _by_dvl(self, measured: Signals, span: slice, out: Array) -> None:
        from twin.frames import euler_to_matrix

        its = self.onboard
        angles = columns(measured, ("measured_roll", "measured_pitch", "measured_heading"), span)
        to_ned = euler_to_matrix(*(np.deg2rad(angle) for angle in angles))
        body = np.stack(columns(measured, DVL_READS[1:4], span), axis=-1)
        velocity = np.einsum("tij,tj->it", to_ned, body)
        dvl_track_kernel(
            velocity[0], velocity[1], *columns(measured, (DVL_READS[4], *its.reads[3:]), span),
            self.dt, its.min_dive_time, its.use_current, self.carried, span.start, out,
        )  # fmt: skip
