"""On-board track: the position that a vehicle dead-reckons and logs by itself.

As buoyancy gliders do it, `speed_by="depth-rate"` (OceanGliders' depth-averaged current procedure:
Slocum takes the horizontal speed as w / tan(pitch + angle of attack), Spray assumes an angle of
attack of 3 deg):

1. depth rate = change of the measured depth over the last `window` seconds, and pitch = mean of
   the measured pitch over the same window;
2. horizontal speed = |depth rate| / tan(|pitch| + angle of attack), at most `max_speed`. It is
   held while the pitch is below `min_pitch` or the depth rate has the wrong sign for it (at
   inflections), and is 0 above `surface_depth`;
3. the position moves by that speed along the measured heading, plus the last depth-averaged
   current if `use_current`;
4. a GPS fix resets the position. The first one after at least `min_dive_time` without a fix
   also gives the depth-averaged current: what was used plus (fix - position) / time since the
   last fix.

As propelled vehicles with a Doppler log do it, `speed_by="dvl"`: the measured velocity in body
axes, turned by the measured roll, pitch and heading, moves the position; the last one is held while
there is no lock. A velocity through the water takes the depth-averaged current with it, which a fix
gives after at least `min_dive_time` of water lock; one over ground needs none.

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
    """Track and currents by the measured signals; each of shape (n,)."""

    north: Array
    """[m] from the mission's origin"""
    east: Array
    """[m]"""
    current_north: Array
    """[m/s] latest depth-averaged current, 0 before the first one"""
    current_east: Array
    """[m/s]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Onboard(Sensor):
    """Settings of the vehicle's own dead reckoning. It has no error of its own to switch off:
    with ideal devices it still shows what its assumptions cost."""

    name = "onboard"
    reads = (
        "measured_depth", "measured_pitch", "measured_heading",
        "measured_gps_north", "measured_gps_east",
    )  # fmt: skip
    writes = variables("measured_onboard_north", "measured_onboard_east")
    unset: ClassVar[Mapping[str, Any]] = {"speed_by": DEPTH_RATE}

    speed_by: str = DEPTH_RATE
    """Source of the speed: "depth-rate" or "dvl" """
    angle_of_attack_deg: float = 3.0
    """[deg] one constant for every glide, as Spray assumes; the Sea-Wing's is 1.3 to 3 deg"""
    window: float = 20.0
    """[s] over which the depth rate is taken"""
    min_pitch_deg: float = 10.0
    """[deg] below this the quotient is not used"""
    surface_depth: float = 1.0
    """[m] above this the vehicle counts as surfaced"""
    max_speed: float = 1.0
    """[m/s] no buoyancy glider is faster through the water for long; by depth rate"""
    use_current: bool = True
    """Add the last depth-averaged current"""
    min_dive_time: float = 300.0
    """[s] shorter times without a fix give no depth-averaged current"""

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
        """The defaults: the algorithm has no error of its own."""
        return cls()

    def inputs(self, signals: Iterable[str]) -> tuple[str, ...]:
        """Depth, attitude and GPS, and the Doppler log where it gives the speed."""
        return self.reads + (DVL_READS if self.speed_by == DVL else ())

    def track(self, measured: Signals, *, dt: float) -> OnboardTrack:
        """The track from measured depth, pitch, heading and GPS on one time grid of step dt [s]."""
        n = signal(measured, "measured_depth").shape[0]
        return OnboardTrack(*OnboardRun(self, dt).rows(measured, 0, n))

    def begin(self, outset: Outset) -> OnboardRun:
        """measured_onboard_north and measured_onboard_east [m]."""
        return OnboardRun(self, outset.dt)


@dataclasses.dataclass
class OnboardRun(SensorRun):
    """Dead reckoning under way."""

    onboard: Onboard
    dt: float
    carried: Array = dataclasses.field(default_factory=lambda: np.zeros(8))
    """position, current, speed and times, as the kernels have them"""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        rows = self.rows(signals, first, last)
        return {"measured_onboard_north": rows[0], "measured_onboard_east": rows[1]}

    def rows(self, measured: Signals, first: int, last: int) -> Array:
        """The fields of `OnboardTrack` for a stretch of samples, shape (4, stretch)."""
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
