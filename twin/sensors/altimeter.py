"""Altimeter: the height above the sea floor by one downward echo sounder.

Each ping measures the range along the beam to the sea floor. The vehicle computes its height from
the range and its own pitch and roll. The beam is tilted forward, so that it is plumb in a dive. In
a climb it points aft, and beyond `max_beam_angle_deg` from the vertical no echo returns.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.numbers import Array
from twin.records.schema import Variable, variables
from twin.sensors.base import (
    Outset,
    Sensor,
    SensorRun,
    Signals,
    columns,
    drawn_value,
    normals,
    require_finite,
    require_non_negative,
    require_positive,
    signal,
)

ANGLES = ("roll", "pitch", "heading")
MARCH = 2.0
"""[m] Step of the search for the floor along a beam: finer than any bathymetry grid."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Altimeter(Sensor):
    """One narrow beam, which measures in missions with a sea floor.

    Range and tilt: the altimeter of Slocum gliders (Teledyne's G2 manual: 0 to 100 m, tilted by
    26 deg so that it is plumb in a dive at that pitch). Noise, scale and lost pings: our estimates.
    """

    name = "altimeter"
    reads = (
        "true_altitude", "true_north", "true_east", "true_depth",
        "true_roll", "true_pitch", "true_heading", "measured_roll", "measured_pitch",
    )  # fmt: skip
    writes = variables("measured_altitude")
    draws: ClassVar[Mapping[str, str]] = {"altimeter_scale": "1"}
    ideal_is_truth = True

    fitted: bool = True
    """False: the vehicle has no altimeter, and every value is NaN"""
    tilt_deg: float = 26.0
    """[deg] Angle of the beam from the hull's downward axis, forward"""
    min_range: float = 0.5
    """[m] Shortest range"""
    max_range: float = 100.0
    """[m] Longest range"""
    max_beam_angle_deg: float = 35.0
    """[deg] Largest angle from the vertical at which an echo returns"""
    ping_period: float = 4.0
    """[s] Time between pings; the samples in between are NaN"""
    scale: float = 0.005
    """[1] Standard deviation of the relative error of the assumed sound speed, per mission"""
    noise: float = 0.1
    """[m] White noise per ping"""
    lost_share: float = 0.05
    """[1] Fraction of the pings without a usable echo"""

    def __post_init__(self) -> None:
        require_positive(self, "max_range")
        require_non_negative(self, "min_range", "ping_period", "scale", "noise", "lost_share")
        if self.lost_share > 1.0:
            raise InputError(f"Altimeter.lost_share is {self.lost_share:g}: it must be at most 1")
        if self.min_range >= self.max_range:
            raise InputError(
                f"Altimeter ranges {self.min_range:g}..{self.max_range:g} m: the longest must "
                "exceed the shortest"
            )
        require_finite(self, "tilt_deg", "max_beam_angle_deg")
        for name in ("tilt_deg", "max_beam_angle_deg"):
            if not 0.0 <= getattr(self, name) < 90.0:
                raise InputError(
                    f"Altimeter.{name} is {getattr(self, name):g} deg: give 0 to below 90"
                )

    @classmethod
    def ideal(cls) -> Altimeter:
        """Make an altimeter that reads the true height at every sample."""
        return cls(
            tilt_deg=0.0, min_range=0.0, max_range=12_000.0, ping_period=0.0, scale=0.0, noise=0.0,
            lost_share=0.0,
        )  # fmt: skip

    def inputs(self, signals: Iterable[str]) -> tuple[str, ...]:
        """Position and attitude, in missions with a sea floor."""
        return self.reads if "true_altitude" in set(signals) else ()

    def channels(self, signals: Iterable[str]) -> tuple[Variable, ...]:
        """Variable of the height, in missions with a sea floor."""
        return self.writes if "true_altitude" in set(signals) else ()

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample the mission's relative error of the range [1]."""
        return self.draw_normal(rng, (self.scale,))

    def begin(self, outset: Outset) -> AltimeterRun:
        """Begin to measure measured_altitude [m]; NaN between pings, out of range, without echo."""
        stride = max(1, round(self.ping_period / outset.dt))
        pings = len(range(0, outset.samples, stride)) if self.fitted else 0
        noise = self.noise * normals(outset.rng, pings).astype(float)
        return AltimeterRun(
            altimeter=self,
            stride=stride,
            noise=noise,
            lost=outset.rng.random(pings) < self.lost_share,
            scale=1.0 + drawn_value(outset.drawn, "altimeter_scale"),
            floor=outset.surroundings.floor,
        )

    def beam(self, *angles: Array) -> Array:
        """Unit vectors of the beam NED, shape (n, 3), at a roll, pitch and heading [deg]."""
        from twin.frames import euler_to_matrix

        tilt = math.radians(self.tilt_deg)
        to_ned = euler_to_matrix(*(np.deg2rad(angle) for angle in angles))
        return np.asarray(to_ned @ np.array([math.sin(tilt), 0.0, math.cos(tilt)]))


@dataclasses.dataclass
class AltimeterRun(SensorRun):
    """An altimeter in one mission."""

    altimeter: Altimeter
    stride: int
    """Samples from ping to ping."""
    noise: Array
    """[m] Noise of each ping."""
    lost: NDArray[np.bool_]
    """True for pings without a usable echo."""
    scale: float
    floor: Array | None

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        its = self.altimeter
        height = np.full(last - first, np.nan)
        at = np.arange(-(-first // self.stride) * self.stride, last, self.stride)
        if its.fitted and at.size:
            ping = at // self.stride
            toward = its.beam(*columns(signals, [f"true_{n}" for n in ANGLES], at))
            length = self._lengths(signals, at, toward)
            length *= self.scale
            length += self.noise[ping]
            lost = self.lost[ping] | (length < its.min_range) | ~(length <= its.max_range)
            lost |= toward[:, 2] < math.cos(math.radians(its.max_beam_angle_deg))
            tilted = columns(signals, [f"measured_{n}" for n in ANGLES[:2]], at)
            believed = its.beam(*tilted, np.zeros(at.size))
            height[at - first] = np.where(lost, np.nan, length * believed[:, 2])
        return {"measured_altitude": height}

    def _lengths(self, signals: Signals, at: NDArray[np.int64], toward: Array) -> Array:
        """Ranges [m] along the beams to the sea floor, inf out of reach, shape (pings,)."""
        if self.floor is None:  # without a floor the bottom is level
            with np.errstate(divide="ignore"):
                below = signal(signals, "true_altitude")[at] / np.maximum(toward[:, 2], 0.0)
            return np.maximum(below, 0.0)
        from twin.water.floor.lookup import beam_lengths

        place = columns(signals, ("true_north", "true_east", "true_depth"), at)
        reach = 1.1 * self.altimeter.max_range  # noise may make a longer range a measured one
        return beam_lengths(self.floor, *place, toward, reach, MARCH)
