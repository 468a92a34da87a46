"""GPS: position fixes while the antenna is out of the water, after a time to first fix."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.numbers import Array
from twin.records.schema import variables
from twin.sensors.base import (
    Outset,
    Sensor,
    SensorRun,
    Signals,
    columns,
    drawn_value,
    gauss_markov_knots,
    normals,
    require_finite,
    require_non_negative,
    require_positive,
    signal,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Gps(Sensor):
    """A receiver that sleeps under water.

    Time to first fix: 30-120 s (Slocum, OceanGliders' depth-averaged current procedure).
    """

    name = "gps"
    reads = (
        "true_north", "true_east", "true_depth", "true_roll", "true_pitch", "true_immersion",
    )  # fmt: skip
    writes = variables("measured_gps_north", "measured_gps_east")
    draws: ClassVar[Mapping[str, str]] = {"gps_sigma": "m"}

    antenna_position: tuple[float, float, float] | None = None
    """[m] Antenna, body FRD about the CB; a fix needs it above the mean surface. None: a fix needs
    the hull to break the surface (`max_immersion`), as with a mast raised at the surface"""
    max_immersion: float = 0.999
    """[1] Immersed fraction of the hull below which it breaks the surface; a glider floating 0.5 kg
    light shows 0.8 % of its hull"""
    first_fix_min: float = 30.0
    """[s] Shortest time to first fix, uniformly distributed"""
    first_fix_max: float = 120.0
    """[s] Longest time to first fix"""
    tracking_at_start: bool = True
    """True: a mission that starts at the surface starts with a fix, as vehicles wait for one"""
    dip_tolerance: float = 5.0
    """[s] Longest dip of the antenna through which the receiver keeps its satellites"""
    sigma_min: float = 3.0
    """[m] Smallest standard deviation of a mission per horizontal axis, uniformly distributed"""
    sigma_max: float = 5.0
    """[m] Largest standard deviation of a mission"""
    correlation_time: float = 120.0
    """[s] Correlation time of the position error; our estimate"""
    fix_interval: float = 1.0
    """[s] Time between fixes; 0: in every sample"""

    def __post_init__(self) -> None:
        require_non_negative(
            self, "max_immersion", "first_fix_min", "first_fix_max", "dip_tolerance",
            "sigma_min", "sigma_max", "fix_interval",
        )  # fmt: skip
        require_positive(self, "correlation_time")
        if self.antenna_position is not None:
            require_finite(self, "antenna_position")
        for low, high in (("first_fix_min", "first_fix_max"), ("sigma_min", "sigma_max")):
            if getattr(self, low) > getattr(self, high):
                raise InputError(
                    f"Gps.{low} is {getattr(self, low):g}, above {high} {getattr(self, high):g}: "
                    "swap them"
                )

    @classmethod
    def ideal(cls) -> Gps:
        """Make a receiver with the true position in every sample at the surface."""
        return cls(
            first_fix_min=0.0, first_fix_max=0.0, sigma_min=0.0, sigma_max=0.0, fix_interval=0.0
        )

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample the mission's standard deviation per axis [m]."""
        return {"gps_sigma": float(rng.uniform(self.sigma_min, self.sigma_max))}

    def at_surface(self, truth: Signals) -> NDArray[np.bool_]:
        """Mark samples with the antenna out of the water, shape (n,)."""
        if self.antenna_position is None:
            return np.asarray(truth["true_immersion"]) < self.max_immersion
        x, y, z = self.antenna_position
        roll, pitch = np.deg2rad(columns(truth, ("true_roll", "true_pitch")))
        below = -np.sin(pitch) * x + np.cos(pitch) * (np.sin(roll) * y + np.cos(roll) * z)
        return signal(truth, "true_depth") + below < 0.0

    def begin(self, outset: Outset) -> GpsRun:
        """Begin to measure measured_gps_north and measured_gps_east [m] about the mission's origin.

        NaN: no fix. Random numbers of a surfacing are sampled when it happens, not before.
        """
        return GpsRun(
            gps=self, dt=outset.dt, rng=outset.rng, sigma=drawn_value(outset.drawn, "gps_sigma")
        )


@dataclasses.dataclass
class Wander:
    """Two Gauss-Markov processes, north and east [m], as `twin.sensors.base.gauss_markov`.

    Knots are sampled on demand, so that the length need not be known.
    """

    rng: np.random.Generator
    std: float
    decay: float
    stride: int
    count: int = 0
    knot: Array = dataclasses.field(default_factory=lambda: np.zeros(2))
    following: Array = dataclasses.field(default_factory=lambda: np.zeros(2))

    def next(self) -> Array:
        """Sample the next errors, shape (2,)."""
        if self.count == 0:
            self.following = self.std * normals(self.rng, 2).astype(float)
        place = self.count % self.stride
        if place == 0:
            step = self.std * math.sqrt(1.0 - self.decay**2)
            self.knot = self.following
            self.following = self.decay * self.knot + step * normals(self.rng, 2)
        self.count += 1
        return self.knot + (self.following - self.knot) * (place / self.stride)


@dataclasses.dataclass
class GpsRun(SensorRun):
    """A receiver in one mission."""

    gps: Gps
    dt: float
    rng: np.random.Generator
    sigma: float
    wander: Wander | None = None
    """Errors of this surfacing after its first fix."""
    next_fix: int = 0
    """Index of the next sample with a fix."""
    last_dry: int = -(10**9)
    """Index of the last sample with the antenna out of the water."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        out = np.full((2, last - first), np.nan)
        names = [name for name in self.gps.reads if name in signals]
        dry = self.gps.at_surface({name: signals[name][first:last] for name in names})
        for k in np.flatnonzero(dry) + first:
            error = self._fix(int(k))
            if error is not None:
                out[0, k - first] = signals["true_north"][k] + error[0]
                out[1, k - first] = signals["true_east"][k] + error[1]
        return {"measured_gps_north": out[0], "measured_gps_east": out[1]}

    def _fix(self, k: int) -> Array | None:
        """Error [m] of the fix of a sample at the surface, (2,); None: there is no fix."""
        its = self.gps
        if (k - self.last_dry - 1) * self.dt > its.dip_tolerance:
            self.wander = None
            wait = self.rng.uniform(its.first_fix_min, its.first_fix_max)
            if k == 0 and its.tracking_at_start:
                wait = 0.0
            self.next_fix = k + math.ceil(wait / self.dt)
        self.last_dry = k
        error = None
        while self.next_fix <= k:  # the error process went on while the antenna was under water
            if self.wander is None:
                self.wander = self._wander()
            value = self.wander.next()
            if self.next_fix == k:
                error = value
            self.next_fix += self._stride
        return error

    @property
    def _stride(self) -> int:
        """Number of samples from fix to fix."""
        return max(1, round(self.gps.fix_interval / self.dt))

    def _wander(self) -> Wander:
        """Make the errors of the fixes of one surfacing."""
        interval, time = self._stride * self.dt, self.gps.correlation_time
        return Wander(self.rng, *gauss_markov_knots(self.sigma, interval, time))

    def state(self) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        found: dict[str, Any] = self.rng.bit_generator.state  # type: ignore[assignment]
        words = [found["has_uint32"], found["uinteger"], *found["state"]["state"]]
        one = self.wander
        return {
            "generator": np.array(words, np.uint64),
            "surfacing": np.array([self.next_fix, self.last_dry], np.int64),
            "wander": np.zeros(0)
            if one is None
            else np.array([one.count, *one.knot, *one.following], np.float64),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """See `SensorRun`."""
        words = np.asarray(state["generator"], np.uint64)
        found: dict[str, Any] = self.rng.bit_generator.state  # type: ignore[assignment]
        self.rng.bit_generator.state = {
            **found,
            "has_uint32": int(words[0]),
            "uinteger": int(words[1]),
            "state": {"state": words[2:].copy()},
        }
        self.next_fix, self.last_dry = (int(value) for value in state["surfacing"])
        self.wander = None
        if len(state["wander"]):
            self.wander = self._wander()
            values = np.asarray(state["wander"], np.float64)
            self.wander.count = int(values[0])
            self.wander.knot, self.wander.following = values[1:3], values[3:5]
