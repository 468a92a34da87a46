"""Compass: heading with the deviation that the vehicle's own iron makes.

The magnetometer reads A R^T m_n + b: A the soft iron, b the hard iron in body axes, both in
units of the horizontal field. Tilt-compensated with the true tilt (what tilt errors add is
inside the AHRS's heading figure), a level vehicle then shows the classical deviation
A0 + B sin psi + C cos psi + D sin 2psi + E cos 2psi with b = (-B, -C) and
A = I + [[-D, -E], [-E, D]]; under tilt the dip adds a dependence on pitch and roll.
Declination is taken as removed.

The battery's share of b is calibrated away at its neutral position only: it turns with the
rotation and falls with the cube of the distance as the battery shifts away from the compass.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
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

DEG = math.pi / 180.0
MAX_SHIFT = 0.2
"""[m] no glider's battery travels further; the compass must be further away than this"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Compass:
    """Standard deviations of what a mission draws; the defaults are a calibrated compass.

    OceanGliders' depth-averaged current procedure: about 1 deg or less after calibration,
    usually up to 5 deg without.
    """

    offset_deg: float = 0.3
    """[deg] A0: mounting and residual declination"""
    hard_iron_deg: float = 0.7
    """[deg] B and C, and the vertical component; 1 deg is 0.44 uT in a horizontal field of 25 uT"""
    soft_iron_deg: float = 0.3
    """[deg] D and E"""
    battery_deg: float = 0.5
    """[deg] each component of the battery's field at its neutral position; ours"""
    battery_distance: float = 0.3
    """[m] from the compass forward to the neutral battery, as the Sea-Wing model places its IMU"""
    dip_deg: float = 60.0
    """[deg] inclination of the Earth's field; about 60 in Monterey Bay"""
    noise_deg: float = 0.2
    """[deg] RMS of the correlated noise of the filter; ours"""
    noise_correlation_time: float = 10.0
    """[s]"""

    def __post_init__(self) -> None:
        require_non_negative(
            self, "offset_deg", "hard_iron_deg", "soft_iron_deg", "battery_deg", "noise_deg"
        )
        require_positive(self, "noise_correlation_time")
        require_finite(self, "dip_deg", "battery_distance")
        if abs(self.dip_deg) > 85.0:
            raise InputError(
                f"Compass.dip_deg is {self.dip_deg:g}: beyond 85 deg no compass gives a heading"
            )
        if self.battery_distance <= MAX_SHIFT:
            raise InputError(
                f"Compass.battery_distance is {self.battery_distance:g} m: it must exceed "
                f"{MAX_SHIFT:g} m, which a battery may travel"
            )

    @classmethod
    def ideal(cls) -> Compass:
        """No deviation and no noise."""
        return cls(
            offset_deg=0.0, hard_iron_deg=0.0, soft_iron_deg=0.0, battery_deg=0.0, noise_deg=0.0
        )

    @classmethod
    def preset(cls, name: str) -> Compass:
        """A compass of `COMPASS_PRESETS` by name."""
        if name not in COMPASS_PRESETS:
            raise InputError(unknown_name("compass", name, COMPASS_PRESETS))
        return COMPASS_PRESETS[name]

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """The mission's deviation coefficients and iron [deg]."""
        spread = {
            "compass_a0_deg": self.offset_deg,
            "compass_b_deg": self.hard_iron_deg,
            "compass_c_deg": self.hard_iron_deg,
            "compass_vertical_deg": self.hard_iron_deg,
            "compass_d_deg": self.soft_iron_deg,
            "compass_e_deg": self.soft_iron_deg,
            "compass_battery_x_deg": self.battery_deg,
            "compass_battery_y_deg": self.battery_deg,
            "compass_battery_z_deg": self.battery_deg,
        }
        unit = rng.standard_normal(len(spread))
        return {name: float(std * unit[i]) for i, (name, std) in enumerate(spread.items())}

    def measure(
        self, truth: Signals, *, dt: float, drawn: Drawn, rng: np.random.Generator
    ) -> dict[str, NDArray[np.float64]]:
        """measured_heading [degree] in [0, 360)."""
        from twin.sensors.kernels import compass_kernel

        heading = signal(truth, "true_heading")
        iron = {
            key: drawn_value(drawn, f"compass_{key}_deg") * DEG
            for key in ("a0", "b", "c", "d", "e", "vertical", "battery_x", "battery_y", "battery_z")
        }
        soft = np.zeros((3, 3))
        soft[:2, :2] = [[-iron["d"], -iron["e"]], [-iron["e"], iron["d"]]]
        error = gauss_markov(
            rng, heading.shape[0], std=self.noise_deg, dt=dt,
            correlation_time=self.noise_correlation_time,
        )  # fmt: skip
        out = np.empty_like(heading)
        compass_kernel(
            signal(truth, "true_roll"), signal(truth, "true_pitch"), heading,
            signal(truth, "true_shift"), signal(truth, "true_rotation"),
            np.array([-iron["b"], -iron["c"], iron["vertical"]]), soft,
            np.array([iron["battery_x"], iron["battery_y"], iron["battery_z"]]),
            self.battery_distance, math.tan(self.dip_deg * DEG), iron["a0"], error, out,
        )  # fmt: skip
        return {"measured_heading": out}


COMPASS_PRESETS: dict[str, Compass] = {
    "none": Compass.ideal(),
    # sqrt(0.7^2 + 0.3^2 + 0.3^2 + 0.2^2) = 0.84 deg RMS before the battery moves.
    "calibrated": Compass(),
    # sqrt(4.6^2 + 1.5^2 + 1.0^2 + 0.2^2) = 4.9 deg RMS before the battery moves.
    "uncalibrated": Compass(offset_deg=1.0, hard_iron_deg=4.6, soft_iron_deg=1.5, battery_deg=2.0),
}
