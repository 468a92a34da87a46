"""AHRS: roll, pitch and heading from the IMU's gyros and accelerometers and a compass.

A complementary filter integrates the gyros and relaxes to the tilt of the accelerometers over
`time_constant`. Its error then obeys

    e' = (rate error by the gyros) - (e - tilt error by the accelerometers) / time_constant

to first order in Euler angles, with the errors of the same gyros and accelerometers that the IMU
reports. A constant accelerometer bias b_a therefore tilts attitude and specific force alike, by
b_a / g, and a gyro bias b_g adds time_constant b_g: attitude is no second measurement of gravity.

The vehicle's iron causes the compass deviation. The magnetometer reads A R^T m_n + b: A the soft
iron, b the hard iron in body axes, both in units of the horizontal field. After tilt compensation,
a level vehicle shows the classical deviation A0 + B sin psi + C cos psi + D sin 2psi + E cos 2psi
with b = (-B, -C) and A = I + [[-D, -E], [-E, D]]; under tilt the dip adds a dependence on pitch and
roll. The readings have no declination.

The measured roll and pitch level the compass, so that an accelerometer bias enters the heading by
the tangent of the dip. The heading's filter relaxes to that heading: a constant yaw gyro bias b_g
adds time_constant b_g. Calibration removes the battery's share of b at the neutral position only:
the share turns with the rotation and falls with the cube of the distance as the battery shifts away
from the compass.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

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
    drawn_value,
    gauss_markov,
    require_finite,
    require_non_negative,
    require_positive,
    signal,
)
from twin.sensors.kernels import compass_kernel, complementary_kernel, tilt_kernel, turn_kernel

DEG = math.pi / 180.0
ANGLES = ("roll", "pitch")
RATES = ("roll_rate", "pitch_rate", "yaw_rate")
FORCES = ("specific_force_x", "specific_force_y", "specific_force_z")
IRON = ("a0", "b", "c", "vertical", "d", "e", "battery_x", "battery_y", "battery_z")
"""Constants of a compass that are sampled per mission."""
MAX_SHIFT = 0.2
"""[m] Upper bound of a glider battery's travel; the compass must be farther away."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Attitude(Sensor):
    """Filter of roll and pitch, with an error of its own; the defaults describe a 3DM-GX5-25.

    The data sheet's 0.25 deg RMS consists of 0.2 deg from the default gyros' turn-on bias, 0.13 deg
    from the accelerometers' bias and misalignment, and `rms_deg`.
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
    """[s] Time in which the filter relaxes to the accelerometers; 0: no filter, only `rms_deg`. The
    device's complementary filter takes 10 s, which gives its 0.5 deg with these gyros. The default
    is 5 s, because the device's Kalman filter also estimates the gyro bias"""
    rms_deg: float = 0.08
    """[deg] RMS per angle of the filter's own error, a stationary Gauss-Markov process"""
    correlation_time: float = 120.0
    """[s] Correlation time of the filter's own error; our estimate"""

    def __post_init__(self) -> None:
        require_non_negative(self, "rms_deg", "time_constant")
        require_finite(self, "time_constant")
        require_positive(self, "correlation_time")

    @classmethod
    def ideal(cls) -> Attitude:
        """Make a filter without errors."""
        return cls(rms_deg=0.0, time_constant=0.0)

    def begin(self, outset: Outset) -> AttitudeRun:
        """Begin to measure measured_roll [-180, 180) and measured_pitch [-90, 90] [degree]."""
        rng, n, dt, time = outset.rng, outset.samples, outset.dt, self.correlation_time
        own = [gauss_markov(rng, n, std=self.rms_deg, dt=dt, correlation_time=time) for _ in ANGLES]
        return AttitudeRun(self.time_constant, dt, np.stack(own))


@dataclasses.dataclass
class AttitudeRun(SensorRun):
    """The filter in one mission."""

    time_constant: float
    dt: float
    own: Array
    """[degree] Filter's own error, (2, n)."""
    carried: Array = dataclasses.field(default_factory=lambda: np.full(2, np.nan))
    """[degree] Errors of roll and pitch from gyros and accelerometers."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        span = slice(first, last)
        true = columns(signals, [f"true_{name}" for name in ANGLES], span)
        roll, pitch = self.own[:, span] + true + self._errors(signals, true, span)
        np.clip(pitch, -90.0, 90.0, out=pitch)
        beyond = np.abs(roll) > 180.0
        roll[beyond] = (roll[beyond] + 180.0) % 360.0 - 180.0
        return {"measured_roll": roll, "measured_pitch": pitch}

    def _errors(self, signals: Signals, true: list[Array], span: slice) -> Array:
        """Errors of roll and pitch from gyros and accelerometers [degree], shape (2, stretch)."""
        errors = np.zeros((2, len(true[0])))
        if self.time_constant == 0.0:
            return errors
        measured, rate = (
            np.stack(columns(signals, [f"{kind}_{name}" for name in RATES], span))
            for kind in ("measured", "true")
        )
        force = np.stack(columns(signals, [f"measured_{name}" for name in FORCES], span))
        rates, reference = np.empty_like(errors), np.empty_like(errors)
        tilt_kernel(*true, force, measured - rate, rates, reference)
        for i in range(2):
            complementary_kernel(
                rates[i], reference[i], self.dt, self.time_constant, self.carried[i : i + 1],
                errors[i],
            )  # fmt: skip
        return errors


@dataclasses.dataclass(frozen=True, kw_only=True)
class Compass(Sensor):
    """Standard deviations of a compass's errors; the defaults describe a calibrated compass.

    OceanGliders' depth-averaged current procedure: about 1 deg or less after calibration,
    usually up to 5 deg without.
    """

    name = "compass"
    reads = (
        "true_roll", "true_pitch", "true_heading", "measured_roll", "measured_pitch",
        *(f"{kind}_{name}" for name in RATES[1:] for kind in ("true", "measured")),
    )  # fmt: skip
    writes = variables("measured_heading")
    draws = dict.fromkeys((f"compass_{key}_deg" for key in IRON), "degree")
    ideal_is_truth = True
    unset: ClassVar[Mapping[str, Any]] = {"time_constant": 0.0}

    offset_deg: float = 0.3
    """[deg] A0: mounting and residual declination"""
    hard_iron_deg: float = 0.7
    """[deg] B and C, and the vertical component; 1 deg is 0.44 uT in a horizontal field of 25 uT"""
    soft_iron_deg: float = 0.3
    """[deg] D and E"""
    battery_deg: float = 0.5
    """[deg] Each component of the battery's field at its neutral position; our estimate"""
    battery_shift_part: str = "shift"
    """Name of the part that slides the battery; without this part the battery stays at neutral"""
    battery_rotation_part: str = "rotation"
    """Name of the part that turns the battery; without this part the battery does not turn"""
    battery_distance: float = 0.3
    """[m] Distance from the compass forward to the neutral battery, as in the Sea-Wing model"""
    dip_deg: float = 60.0
    """[deg] Inclination of the Earth's field; about 60 in Monterey Bay"""
    noise_deg: float = 0.2
    """[deg] RMS of the correlated noise of the filter; our estimate"""
    noise_correlation_time: float = 10.0
    """[s] Correlation time of the filter's noise"""
    time_constant: float = 5.0
    """[s] Time in which the filter relaxes to the compass, as `Attitude.time_constant`; 0: no
    filter, and the true tilt levels the compass"""

    def __post_init__(self) -> None:
        require_non_negative(
            self, "offset_deg", "hard_iron_deg", "soft_iron_deg", "battery_deg", "noise_deg",
            "time_constant",
        )  # fmt: skip
        require_positive(self, "noise_correlation_time")
        require_finite(self, "dip_deg", "battery_distance", "time_constant")
        if abs(self.dip_deg) > 85.0:
            raise InputError(
                f"Compass.dip_deg is {self.dip_deg:g}: beyond 85 deg no compass gives a heading"
            )
        if self.battery_distance <= MAX_SHIFT:
            raise InputError(
                f"Compass.battery_distance is {self.battery_distance:g} m: it must exceed "
                f"{MAX_SHIFT:g} m, which a battery may travel"
            )

    @property
    def deviation_deg(self) -> float:
        """Standard deviation [deg] of the heading error of a level vehicle at one heading."""
        return math.hypot(self.offset_deg, self.hard_iron_deg, self.soft_iron_deg, self.battery_deg)

    @classmethod
    def ideal(cls) -> Compass:
        """Make a compass without deviation and noise."""
        return cls(
            offset_deg=0.0, hard_iron_deg=0.0, soft_iron_deg=0.0, battery_deg=0.0, noise_deg=0.0,
            time_constant=0.0,
        )  # fmt: skip

    @classmethod
    def preset(cls, name: str) -> Compass:
        """Return a compass of `COMPASS_PRESETS` by name."""
        if name not in COMPASS_PRESETS:
            raise InputError(unknown_name("compass", name, COMPASS_PRESETS))
        return COMPASS_PRESETS[name]

    def inputs(self, signals: Iterable[str]) -> tuple[str, ...]:
        """Attitude, and the battery's position if a part moves it."""
        there = set(signals)
        return (*self.reads, *(name for name in self._parts if name in there))

    @property
    def _parts(self) -> tuple[str, str]:
        """Signals of the parts that slide and turn the battery."""
        return f"true_{self.battery_shift_part}", f"true_{self.battery_rotation_part}"

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample the mission's deviation coefficients and iron [deg]."""
        hard, soft, battery = self.hard_iron_deg, self.soft_iron_deg, self.battery_deg
        spread = [self.offset_deg, *[hard] * 3, *[soft] * 2, *[battery] * 3]
        return self.draw_normal(rng, spread)

    def begin(self, outset: Outset) -> CompassRun:
        """Begin to measure measured_heading [degree] in [0, 360)."""
        iron = {key: drawn_value(outset.drawn, f"compass_{key}_deg") * DEG for key in IRON}
        soft = np.zeros((3, 3))
        soft[:2, :2] = [[-iron["d"], -iron["e"]], [-iron["e"], iron["d"]]]
        error = gauss_markov(
            outset.rng, outset.samples, std=self.noise_deg, dt=outset.dt,
            correlation_time=self.noise_correlation_time,
        )  # fmt: skip
        there = set(outset.signals)
        return CompassRun(
            compass=self,
            dt=outset.dt,
            error=error,
            parts=tuple(part if part in there else None for part in self._parts),
            hard=np.array([-iron["b"], -iron["c"], iron["vertical"]]),
            soft=soft,
            battery=np.array([iron["battery_x"], iron["battery_y"], iron["battery_z"]]),
            offset=iron["a0"],
        )


@dataclasses.dataclass
class CompassRun(SensorRun):
    """A compass in one mission."""

    compass: Compass
    dt: float
    error: Array
    """[degree] Error of the filter, (n,)."""
    parts: tuple[str | None, ...]
    """Signals of the parts that slide and turn the battery."""
    hard: Array
    soft: Array
    battery: Array
    offset: float
    """[rad] Constant error A0."""
    carried: Array = dataclasses.field(default_factory=lambda: np.full(1, np.nan))
    """[degree] Error of the filter from gyros and magnetic field."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        span, its = slice(first, last), self.compass
        heading = signal(signals, "true_heading")[span]
        shift, rotation = (
            np.zeros_like(heading) if part is None else signal(signals, part)[span]
            for part in self.parts
        )
        roll, pitch = columns(signals, [f"true_{name}" for name in ANGLES], span)
        level = [roll, pitch]
        if its.time_constant > 0.0:
            level = columns(signals, [f"measured_{name}" for name in ANGLES], span)
        deviation = np.empty_like(heading)
        compass_kernel(
            roll, pitch, heading, *level, shift, rotation, self.hard, self.soft, self.battery,
            its.battery_distance, math.tan(its.dip_deg * DEG), self.offset, deviation,
        )  # fmt: skip
        if its.time_constant > 0.0:
            measured, true = (
                columns(signals, [f"{kind}_{name}" for name in RATES[1:]], span)
                for kind in ("measured", "true")
            )
            gyro = (one - other for one, other in zip(measured, true, strict=True))
            rate = np.empty_like(heading)
            turn_kernel(roll, pitch, *gyro, rate)
            complementary_kernel(
                rate, deviation.copy(), self.dt, its.time_constant, self.carried, deviation
            )
        out = np.mod(heading + deviation + self.error[span], 360.0)
        out[out == 360.0] = 0.0  # np.mod of a tiny negative number
        return {"measured_heading": out}


COMPASS_PRESETS: dict[str, Compass] = {
    "none": Compass.ideal(),
    # RMS before the battery moves: sqrt(0.7^2 + 0.3^2 + 0.3^2 + 0.2^2) = 0.84 deg
    "calibrated": Compass(),
    # paper's table: 0.8 deg RMS of the filter's heading, here as the filter's own error with the
    # correlation time of roll and pitch
    "table": dataclasses.replace(Compass.ideal(), noise_deg=0.8, noise_correlation_time=120.0),
    # RMS before the battery moves: sqrt(4.6^2 + 1.5^2 + 1.0^2 + 0.2^2) = 4.9 deg
    "uncalibrated": Compass(offset_deg=1.0, hard_iron_deg=4.6, soft_iron_deg=1.5, battery_deg=2.0),
}
