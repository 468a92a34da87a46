"""Attitude: roll and pitch as the AHRS's Kalman filter reports them."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.records.schema import variables
from twin.sensors.base import NOWHERE, Sensor, Surroundings
from twin.sensors.checks import (
    Drawn,
    Signals,
    require_non_negative,
    require_positive,
    signal,
)
from twin.sensors.noise import gauss_markov


@dataclasses.dataclass(frozen=True, kw_only=True)
class Attitude(Sensor):
    """Roll and pitch error of the filter: one stationary Gauss-Markov process per angle."""

    name = "attitude"
    reads = ("true_roll", "true_pitch")
    writes = variables("measured_roll", "measured_pitch")
    ideal_is_truth = True

    rms_deg: float = 0.25
    """[deg] RMS per angle: the 3DM-GX5-25's extended Kalman filter (0.5 for its
    complementary filter)"""
    correlation_time: float = 120.0
    """[s] ours: the filter's error follows the gyro bias that it estimates, over minutes"""

    def __post_init__(self) -> None:
        require_non_negative(self, "rms_deg")
        require_positive(self, "correlation_time")

    @classmethod
    def ideal(cls) -> Attitude:
        """No error at all."""
        return cls(rms_deg=0.0)

    def measure(
        self,
        signals: Signals,
        *,
        dt: float,
        drawn: Drawn,
        rng: np.random.Generator,
        surroundings: Surroundings = NOWHERE,
    ) -> dict[str, NDArray[Any]]:
        """measured_roll and measured_pitch [degree]."""
        out = {}
        for name in ("roll", "pitch"):
            true = signal(signals, f"true_{name}")
            error = gauss_markov(
                rng, true.shape[0], std=self.rms_deg, dt=dt, correlation_time=self.correlation_time
            )
            error += true
            out[f"measured_{name}"] = error
        return out
