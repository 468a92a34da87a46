"""Camera: a sensor beside the vehicle, whose marker poses give velocities over ground.

`factory generate --labels camera` adds it. Poses have the noise measured in drawn pictures
(`glider_twin_vision.sighting`) and are smoothed with the vehicle's inertial unit.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from glider_twin_vision.lens import action_camera
from glider_twin_vision.markers import Board
from glider_twin_vision.observer import SIGNALS, observer, watch
from glider_twin_vision.sighting import Losses, sighted
from glider_twin_vision.smoother import Settings, smooth
from twin.errors import InputError
from twin.records.schema import variables
from twin.sensors import Sensor, Surroundings, require_non_negative, require_positive

LOGGED = (
    *(f"measured_{name}" for name in ("roll", "pitch", "heading")),
    *(f"measured_specific_force_{axis}" for axis in "xyz"),
)
"""Attitude [degree] and specific force [m/s2] by the vehicle's own sensors"""
AXES = ("surge", "sway", "heave")
MEASURED = tuple(f"measured_camera_{axis}" for axis in AXES)
DEVIATIONS = tuple(f"measured_camera_{axis}_deviation" for axis in AXES)
DIMMEST, CLEAREST = 2.0, 15.0
"""[m] Range of the visibilities of missions, drawn evenly in their logarithm"""
WORST = 0.1
"""[m/s] Stated deviation beyond which the camera says nothing"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Camera(Sensor):
    """Camera of an observer, ArUco markers on the vehicle."""

    name = "camera"
    reads = (*SIGNALS, *LOGGED)
    writes = variables(*MEASURED, *DEVIATIONS)
    draws: ClassVar[Mapping[str, str]] = {
        "camera_visibility": "m", "camera_distance": "m", "camera_focal_error": "1",
        "camera_clock": "s",
    }  # fmt: skip

    observer: str = "vehicle"
    """Carrier of the camera: frame, vehicle or diver"""
    rate: float = 10.0
    """[1/s] Pictures"""
    marker_side: float = 0.15
    """[m] Black square of a marker"""
    dropped: float = 0.03
    """[1] Part of the pictures that never arrive"""
    hidden: float = 0.2
    """[1] Part of the pictures in which something hides a marker"""
    focal_error: float = 0.002
    """[1] Deviation of the calibrated focal length"""
    clock: float = 0.01
    """[s] Deviation of the camera's clock from the log's"""

    def __post_init__(self) -> None:
        parts = ("dropped", "hidden", "focal_error", "clock")
        require_positive(self, "rate", "marker_side")
        require_non_negative(self, *parts)
        observer(self.observer)
        Board(side=self.marker_side)
        if not 1.0 <= self.rate <= 60.0:
            raise InputError(f"Camera.rate is {self.rate:g}: 1 to 60 pictures a second")
        for name in parts:
            if not getattr(self, name) < 1.0:
                raise InputError(f"Camera.{name} is {getattr(self, name):g}: it must be below 1")

    @classmethod
    def ideal(cls) -> Camera:
        """Make a camera on a frame without lost pictures and with a perfect calibration."""
        return cls(observer="frame", dropped=0.0, hidden=0.0, focal_error=0.0, clock=0.0)

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample a mission's water, distance and calibration."""
        visibility = DIMMEST * (CLEAREST / DIMMEST) ** rng.random()
        return {
            "camera_visibility": visibility,
            "camera_distance": min(rng.uniform(1.2, 3.0), 0.5 * visibility + 0.2),
            "camera_focal_error": self.focal_error * rng.standard_normal(),
            "camera_clock": self.clock * rng.standard_normal(),
        }

    def measure(
        self, signals: Mapping[str, NDArray[Any]], *, dt: float, drawn: Mapping[str, float],
        rng: np.random.Generator, surroundings: Surroundings | None = None,
    ) -> dict[str, NDArray[Any]]:  # fmt: skip
        """See `twin.sensors.Sensor`; NaN where the stated deviation exceeds WORST."""
        count = len(signals[SIGNALS[0]])
        names = (*MEASURED, *DEVIATIONS)
        nothing = {name: np.full(count, math.nan) for name in names}
        if count < 4:
            return nothing
        view = watch(
            signals, dt, rng, name=self.observer, rate=self.rate, distance=drawn["camera_distance"]
        )
        frames = sighted(
            view, Board(side=self.marker_side), action_camera(), rng,
            visibility=drawn["camera_visibility"],
            losses=Losses(dropped=self.dropped, hidden=self.hidden),
            focal_error=drawn["camera_focal_error"],
        )  # fmt: skip
        if not len(frames.time):
            return nothing
        frames = dataclasses.replace(frames, time=frames.time + drawn["camera_clock"])
        given = np.stack([signals[name] for name in LOGGED], axis=-1).astype(np.float64)
        own = observer(self.observer).velocity
        time = np.asarray(np.arange(count) * dt, np.float64)
        angles = np.asarray(np.radians(given[:, :3]), np.float64)
        found = smooth(time, angles, given[:, 3:], frames, Settings(own=own))
        return labelled(found.velocity, found.deviation)


def labelled(
    velocity: NDArray[np.float64], deviation: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Channels MEASURED and DEVIATIONS of velocities and deviations [m/s], both (n, 3)."""
    vague = np.max(deviation, axis=1, keepdims=True) > WORST
    values = np.hstack([np.where(vague, math.nan, velocity), np.where(vague, math.nan, deviation)])
    return dict(zip((*MEASURED, *DEVIATIONS), values.T.copy(), strict=True))
