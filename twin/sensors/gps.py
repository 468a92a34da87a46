"""GPS: position fixes while the antenna is out of the water, after a time to first fix."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.records.schema import variables
from twin.sensors.base import NOWHERE, Sensor, Surroundings
from twin.sensors.checks import (
    Drawn,
    Signals,
    drawn_value,
    require_finite,
    require_non_negative,
    require_positive,
    signal,
)
from twin.sensors.noise import gauss_markov


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
    """[m] body FRD about the CB: fixes need this point above the mean surface. None: they need
    the hull to break the surface (`max_immersion`), as with a mast raised at the surface"""
    max_immersion: float = 0.999
    """[1] immersed share of the hull below which it breaks the surface; a glider that floats
    0.5 kg light shows 0.8 % of its hull"""
    first_fix_min: float = 30.0
    """[s] shortest time to first fix, uniform"""
    first_fix_max: float = 120.0
    """[s] longest time to first fix"""
    tracking_at_start: bool = True
    """A mission that starts at the surface starts with a fix: vehicles wait for one to dive"""
    dip_tolerance: float = 5.0
    """[s] the receiver keeps its satellites through shorter dips of the antenna"""
    sigma_min: float = 3.0
    """[m] smallest standard deviation of a mission, per horizontal axis, uniform"""
    sigma_max: float = 5.0
    """[m] largest one"""
    correlation_time: float = 120.0
    """[s] of the position error; ours"""
    fix_interval: float = 1.0
    """[s] between fixes; 0: in every sample"""

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
        """The true position in every sample at the surface, from the first one on."""
        return cls(
            first_fix_min=0.0, first_fix_max=0.0, sigma_min=0.0, sigma_max=0.0, fix_interval=0.0
        )

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """The mission's standard deviation per axis [m]."""
        return {"gps_sigma": float(rng.uniform(self.sigma_min, self.sigma_max))}

    def at_surface(self, truth: Signals) -> NDArray[np.bool_]:
        """Whether the antenna is out of the water, shape (n,)."""
        if self.antenna_position is None:
            return np.asarray(truth["true_immersion"]) < self.max_immersion
        x, y, z = self.antenna_position
        roll, pitch = (np.deg2rad(signal(truth, f"true_{name}")) for name in ("roll", "pitch"))
        below = -np.sin(pitch) * x + np.cos(pitch) * (np.sin(roll) * y + np.cos(roll) * z)
        return signal(truth, "true_depth") + below < 0.0

    def measure(
        self,
        signals: Signals,
        *,
        dt: float,
        drawn: Drawn,
        rng: np.random.Generator,
        surroundings: Surroundings = NOWHERE,
    ) -> dict[str, NDArray[Any]]:
        """measured_gps_north and measured_gps_east [m] about the mission's origin; NaN: no fix."""
        north, east = signal(signals, "true_north"), signal(signals, "true_east")
        n = north.shape[0]
        fixes_north, fixes_east = np.full(n, np.nan), np.full(n, np.nan)
        sigma = drawn_value(drawn, "gps_sigma")
        stride = max(1, round(self.fix_interval / dt))
        dry = self.at_surface(signals)
        for start, stop in self._surfacings(dry, dt):
            wait = rng.uniform(self.first_fix_min, self.first_fix_max)
            if start == 0 and self.tracking_at_start:
                wait = 0.0
            fixes = np.arange(start + math.ceil(wait / dt), stop, stride)
            if fixes.size == 0:
                continue
            for out, true in ((fixes_north, north), (fixes_east, east)):
                out[fixes] = true[fixes] + gauss_markov(
                    rng, fixes.size, std=sigma, dt=stride * dt,
                    correlation_time=self.correlation_time,
                )  # fmt: skip
        fixes_north[~dry] = fixes_east[~dry] = np.nan
        return {"measured_gps_north": fixes_north, "measured_gps_east": fixes_east}

    @classmethod
    def observed(cls, name: str, signals: Signals) -> NDArray[Any] | None:
        """The true position."""
        return signals.get(f"true_{name.removeprefix('gps_')}")

    def _surfacings(self, dry: NDArray[np.bool_], dt: float) -> list[tuple[int, int]]:
        """Start and end (exclusive) of each stay at the surface, short dips bridged."""
        edges = np.flatnonzero(np.diff(dry, prepend=False, append=False))
        stays: list[tuple[int, int]] = []
        for start, stop in edges.reshape(-1, 2).tolist():
            if stays and (start - stays[-1][1]) * dt <= self.dip_tolerance:
                stays[-1] = (stays[-1][0], stop)
            else:
                stays.append((start, stop))
        return stays
