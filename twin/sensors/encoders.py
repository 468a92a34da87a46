"""Encoders: where the three actuators say they are."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.sensors.checks import Drawn, Signals, require_non_negative, signal


@dataclasses.dataclass(frozen=True, kw_only=True)
class Encoders:
    """Resolution of the position readings; a reading is the nearest multiple. 0 is continuous.

    Not published for the Sea-Wing: 12-bit potentiometers over each range give figures like these.
    """

    shift_resolution: float = 2.5e-5
    """[m] battery shift, 0.1 m / 4096"""
    rotation_resolution_deg: float = 0.05
    """[deg] battery rotation, 180 deg / 4096"""
    pump_resolution: float = 0.25
    """[cm3] pumped volume, 976 cm3 / 4096"""

    def __post_init__(self) -> None:
        require_non_negative(self, "shift_resolution", "rotation_resolution_deg", "pump_resolution")

    @classmethod
    def ideal(cls) -> Encoders:
        """Continuous readings."""
        return cls(shift_resolution=0.0, rotation_resolution_deg=0.0, pump_resolution=0.0)

    def measure(
        self, truth: Signals, *, dt: float, drawn: Drawn, rng: np.random.Generator
    ) -> dict[str, NDArray[np.float64]]:
        """measured_shift [m], measured_rotation [degree], measured_pump [cm3]."""
        out = {}
        for name, step in (
            ("shift", self.shift_resolution),
            ("rotation", self.rotation_resolution_deg),
            ("pump", self.pump_resolution),
        ):
            true = signal(truth, f"true_{name}")
            if step > 0.0:
                reading = np.rint(true * (1.0 / step))
                reading *= step
                out[f"measured_{name}"] = reading
            else:
                out[f"measured_{name}"] = true
        return out
