"""Attitude: roll and pitch as the AHRS's filter makes them of its own gyros and accelerometers.

A complementary filter follows the gyros and is drawn to the tilt that the accelerometers show, over
`time_constant`. Its error then obeys

    e' = (rate error by the gyros) - (e - tilt error by the accelerometers) / time_constant

with the errors of the very gyros and accelerometers that the IMU reports, in Euler angles, to first
order. A constant accelerometer bias b_a therefore tilts attitude and specific force alike, by
b_a / g, and a gyro bias b_g adds time_constant b_g: attitude is no second measurement of gravity.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.records.schema import variables
from twin.sensors.base import Outset, Sensor, SensorRun
from twin.sensors.checks import (
    Signals,
    require_finite,
    require_non_negative,
    require_positive,
    signal,
)
from twin.sensors.noise import gauss_markov

ANGLES = ("roll", "pitch")
RATES = ("roll_rate", "pitch_rate", "yaw_rate")
FORCES = ("specific_force_x", "specific_force_y", "specific_force_z")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Attitude(Sensor):
    """The filter and the error that is its own; the defaults are a 3DM-GX5-25's.

    Of the 0.25 deg RMS of its data sheet the default gyros' turn-on bias makes 0.2 deg, the
    accelerometers' bias and misalignment 0.13 deg, and `rms_deg` the rest.
    """

    name = "attitude"
    reads = (
        "true_roll", "true_pitch",
        *(f"{kind}_{name}" for name in RATES for kind in ("true", "measured")),
        *(f"measured_{name}" for name in FORCES),
    )  # fmt: skip
    writes = variables("measured_roll", "measured_pitch")
    ideal_is_truth = True
    unset: ClassVar[Mapping[str, Any]] = {"time_constant": 0.0}

    time_constant: float = 5.0
    """[s] over which the accelerometers hold the gyros; 0: no filter, only the error below. The
    device's complementary filter has 10 s and, with these gyros, its 0.5 deg; half of that stands
    for the gyro bias that its Kalman filter estimates"""
    rms_deg: float = 0.08
    """[deg] RMS per angle of the filter's own error, a stationary Gauss-Markov process"""
    correlation_time: float = 120.0
    """[s] of that process; ours"""

    def __post_init__(self) -> None:
        require_non_negative(self, "rms_deg", "time_constant")
        require_finite(self, "time_constant")
        require_positive(self, "correlation_time")

    @classmethod
    def ideal(cls) -> Attitude:
        """No error at all."""
        return cls(rms_deg=0.0, time_constant=0.0)

    def begin(self, outset: Outset) -> AttitudeRun:
        """measured_roll in [-180, 180) and measured_pitch in [-90, 90] [degree]."""
        own = np.stack(
            [
                gauss_markov(
                    outset.rng,
                    outset.samples,
                    std=self.rms_deg,
                    dt=outset.dt,
                    correlation_time=self.correlation_time,
                )
                for _ in ANGLES
            ]
        )
        return AttitudeRun(self.time_constant, outset.dt, own)


@dataclasses.dataclass
class AttitudeRun(SensorRun):
    """The filter in one mission."""

    time_constant: float
    dt: float
    own: NDArray[np.float64]
    """error of its own [degree], (2, n)"""
    carried: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.full(2, np.nan))
    """errors of roll and pitch by gyros and accelerometers [degree]"""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        true = [signal(signals, f"true_{name}")[first:last] for name in ANGLES]
        filtered = self._errors(signals, true, slice(first, last))
        out = {
            f"measured_{name}": own + angle + error
            for name, own, angle, error in zip(
                ANGLES, self.own[:, first:last], true, filtered, strict=True
            )
        }
        np.clip(out["measured_pitch"], -90.0, 90.0, out=out["measured_pitch"])
        beyond = np.abs(out["measured_roll"]) > 180.0
        if beyond.any():
            out["measured_roll"][beyond] = (out["measured_roll"][beyond] + 180.0) % 360.0 - 180.0
        return out

    def _errors(
        self, signals: Signals, true: list[NDArray[np.float64]], span: slice
    ) -> NDArray[np.float64]:
        """What gyros and accelerometers make of roll and pitch [degree], shape (2, stretch)."""
        from twin.sensors.kernels import complementary_kernel, tilt_kernel

        errors = np.zeros((2, len(true[0])))
        if self.time_constant == 0.0:
            return errors
        gyro = np.empty((3, errors.shape[1]))
        for i, name in enumerate(RATES):
            measured, rate = (signal(signals, f"{kind}_{name}") for kind in ("measured", "true"))
            np.subtract(measured[span], rate[span], out=gyro[i])
        force = np.stack([signal(signals, f"measured_{name}")[span] for name in FORCES])
        rates, reference = np.empty_like(errors), np.empty_like(errors)
        tilt_kernel(*true, force, gyro, rates, reference)
        for i in range(2):
            complementary_kernel(
                rates[i], reference[i], self.dt, self.time_constant, self.carried[i : i + 1],
                errors[i],
            )  # fmt: skip
        return errors
