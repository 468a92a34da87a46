"""Shot and subject: how a picture or video shows something, and what it shows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name

if TYPE_CHECKING:
    from twin.faults.base import Fault
    from twin.records.tracks import NamedTrack
    from twin.records.trajectory import Trajectory
    from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

CAMERAS = ("orbit", "side", "map", "chase")
COLOURS = ("speed", "current", "depth", "error")
DEFAULT_SECONDS = 20.0
"""[s] of video when no speed-up is given"""
SMALLEST, LARGEST = 64, 7680
"""[pixel] sides of a picture; the largest is 8K UHD"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Subject:
    """What a film is about."""

    trajectory: Trajectory
    vehicle: Vehicle
    tracks: tuple[NamedTrack, ...] = ()
    """Dead-reckoned tracks beside the true one"""
    title: str = ""
    floor: Array | None = None
    """Table of the mission's sea floor; None: what is drawn is decoration"""
    faults: Sequence[Fault] = ()
    """What is wrong with the vehicle: what is gone is not drawn from then on"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Shot:
    """Camera, size, speed and part of the mission."""

    camera: str = "orbit"
    """orbit (circles the track), side, map (from above) or chase (behind the glider)."""

    width: int = 1280
    """[pixel]"""

    height: int = 720
    """[pixel]"""

    fps: float = 30.0
    """Frames per second of a video."""

    speed_up: float | None = None
    """Mission seconds per video second; None makes the video DEFAULT_SECONDS long."""

    start: float | None = None
    """[s] First mission time shown; None is the mission's start."""

    end: float | None = None
    """[s] Last mission time shown; None is the mission's end."""

    colour: str | None = None
    """What colours the track: speed, current, depth, or error (of the first dead-reckoned track);
    None: speed, or depth in a log that does not tell the speed."""

    exaggeration: float | None = None
    """Vertical scale over horizontal scale; None chooses one. The chase camera has always 1."""

    floor: float | None = None
    """[m] Depth at which the picture ends below; None: so that it shows the mission's sea floor, or
    without one a little below the deepest point."""

    hud: bool = True
    """Draw the strip of readouts, the labels and the legend."""

    inset: bool = True
    """Draw the close-up of the glider (not with the chase camera, which is one)."""

    def __post_init__(self) -> None:
        if self.camera not in CAMERAS:
            raise InputError(unknown_name("camera", self.camera, CAMERAS))
        if self.colour is not None and self.colour not in COLOURS:
            raise InputError(unknown_name("track colour", self.colour, COLOURS))
        for name, pixels in (("width", self.width), ("height", self.height)):
            if not SMALLEST <= pixels <= LARGEST:
                raise InputError(f"{name} {pixels} must be {SMALLEST} to {LARGEST} pixels")
        for name in ("fps", "speed_up", "exaggeration", "floor"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name.replace('_', '-')} {value} must be positive and finite")

    def part(self, time: Array) -> tuple[float, float]:
        """First and last mission time [s] shown, of a mission sampled at `time` [s].

        Raises:
          InputError: the part lies outside the mission or is empty.
        """
        first, last = float(time[0]), float(time[-1])
        start = first if self.start is None else self.start
        end = last if self.end is None else self.end
        slack = 1e-6 * max(last - first, 1.0)
        if not (first - slack <= start < end <= last + slack):
            raise InputError(
                f"part {start:g} to {end:g} s must be inside the mission, {first:g} to {last:g} s, "
                "and end after it starts"
            )
        return max(start, first), min(end, last)

    def frame_times(self, time: Array) -> Array:
        """Mission times [s] of the video's frames, shape (frames,)."""
        start, end = self.part(time)
        speed_up = self.speed_up
        if speed_up is None:
            speed_up = (end - start) / DEFAULT_SECONDS
        frames = max(2, round((end - start) / speed_up * self.fps) + 1)
        return np.asarray(np.linspace(start, end, frames))

    def still_time(
        self, time: Array, at: float | None, known: NDArray[np.bool_] | None = None
    ) -> Array:
        """The one mission time [s] of a still, shape (1,): `at`, or the end of the part.

        Args:
          time: [s] of the samples, (time,).
          at: [s]; None is the end of the part.
          known: samples whose place is known, (time,); then the end is the last of these.
        """
        start, end = self.part(time)
        if at is None:
            if known is not None and (shown := time[known & (time >= start) & (time <= end)]).size:
                end = float(shown[-1])
            return np.array([end])
        if not start <= at <= end:
            raise InputError(f"time {at:g} s is outside the shown part, {start:g} to {end:g} s")
        return np.array([float(at)])
