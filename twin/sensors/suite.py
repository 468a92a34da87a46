"""Suite: the devices of one vehicle, and what they make of one mission's truth.

Every device has its own branch of the mission's seed, one stream for the constants it draws and
one for its noise, so that changing one device leaves the others' errors as they were. Two
devices read others as a vehicle does: the DVL removes its lever arm with the measured gyro, the
on-board track uses measured depth, attitude, heading and GPS.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError, unknown_name
from twin.sensors.attitude import Attitude
from twin.sensors.checks import Signals
from twin.sensors.compass import Compass
from twin.sensors.dvl import Dvl
from twin.sensors.encoders import Encoders
from twin.sensors.gps import Gps
from twin.sensors.imu import FORCE_SIGNALS, GYRO_SIGNALS, Imu
from twin.sensors.noise import DRAWN_STREAM, device_generator
from twin.sensors.onboard import Onboard
from twin.sensors.pressure import Pressure

if TYPE_CHECKING:
    from twin.water.density import DensityProfile

TRUTH_SIGNALS = (
    "true_north", "true_east", "true_depth",
    "true_roll", "true_pitch", "true_heading",
    "true_surge", "true_sway", "true_heave",
    "true_velocity_north", "true_velocity_east", "true_velocity_down",
    *(f"true_{name}" for name in GYRO_SIGNALS),
    *(f"true_{name}" for name in FORCE_SIGNALS),
    "true_shift", "true_rotation", "true_pump", "true_immersion",
)  # fmt: skip
"""What `SensorSuite.measure` reads; units as in the trajectory schema (angles in degree)."""

MEASURED_SIGNALS = (
    *(f"measured_{name}" for name in GYRO_SIGNALS),
    *(f"measured_{name}" for name in FORCE_SIGNALS),
    "measured_roll", "measured_pitch", "measured_heading",
    "measured_pressure", "measured_depth",
    "measured_gps_north", "measured_gps_east",
    "measured_dvl_surge", "measured_dvl_sway", "measured_dvl_heave", "measured_dvl_mode",
    "measured_shift", "measured_rotation", "measured_pump",
    "measured_onboard_north", "measured_onboard_east",
)  # fmt: skip
"""What it returns, in this order."""

DRAWING_DEVICES = ("imu", "compass", "pressure", "gps", "dvl")
"""The devices with constants that a mission draws."""

_UNITS = {
    "gyro_bias": "rad s-1", "gyro_scale": "1", "gyro_misalignment": "rad",
    "accel_bias": "m s-2", "accel_scale": "1", "accel_misalignment": "rad",
}  # fmt: skip
DRAWN_UNITS: Mapping[str, str] = {
    **{f"{name}_{axis}": unit for name, unit in _UNITS.items() for axis in "xyz"},
    **{
        f"compass_{name}_deg": "degree"
        for name in ("a0", "b", "c", "vertical", "d", "e", "battery_x", "battery_y", "battery_z")
    },
    "pressure_offset_dbar": "dbar",
    "pressure_gain": "1",
    "gps_sigma": "m",
    "dvl_scale": "1",
    "dvl_sound_speed": "1",
}
"""Every constant that a mission draws, with its unit, in the order of `SensorSuite.draw`."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SensorSuite:
    """One configuration per device; the defaults are the `field` preset."""

    imu: Imu = dataclasses.field(default_factory=Imu)
    """gyroscope and accelerometer"""
    attitude: Attitude = dataclasses.field(default_factory=Attitude)
    """roll and pitch"""
    compass: Compass = dataclasses.field(default_factory=Compass)
    """heading"""
    pressure: Pressure = dataclasses.field(default_factory=Pressure)
    """pressure and depth"""
    gps: Gps = dataclasses.field(default_factory=Gps)
    """fixes at the surface"""
    dvl: Dvl = dataclasses.field(default_factory=Dvl)
    """velocity over ground or through the water"""
    encoders: Encoders = dataclasses.field(default_factory=Encoders)
    """actuator positions"""
    onboard: Onboard = dataclasses.field(default_factory=Onboard)
    """the vehicle's own dead-reckoned track"""

    @classmethod
    def preset(cls, name: str) -> SensorSuite:
        """A suite of `SUITE_PRESETS` by name; raises InputError for an unknown one."""
        if name not in SUITE_PRESETS:
            raise InputError(unknown_name("sensor preset", name, SUITE_PRESETS))
        return SUITE_PRESETS[name]

    def draw(self, seed: np.random.SeedSequence | np.random.Generator) -> dict[str, float]:
        """The constants of one mission: biases, scales, deviation coefficients (`DRAWN_UNITS`).

        With the mission's SeedSequence the draw is the one that `measure` makes by itself; a
        Generator gives another draw and moves on.
        """
        if isinstance(seed, np.random.Generator):
            seed = np.random.SeedSequence(int(seed.integers(2**63)))
        drawn: dict[str, float] = {}
        for name in DRAWING_DEVICES:
            drawn |= getattr(self, name).draw(device_generator(seed, name, DRAWN_STREAM))
        return drawn

    def measure(
        self,
        truth: Signals,
        *,
        dt: float,
        rng_seed: np.random.SeedSequence,
        drawn: Mapping[str, float] | None = None,
        bottom_depth: ArrayLike | None = None,
        latitude: float = 36.8,
        density: DensityProfile | None = None,
        current: NDArray[np.float64] | None = None,
    ) -> dict[str, NDArray[Any]]:
        """Every `MEASURED_SIGNALS` array, shape (n,), from the truth of one mission.

        truth: `TRUTH_SIGNALS` arrays of shape (n,) every `dt` [s]; they are not changed, and a
        device without errors returns them themselves. rng_seed: the mission's seed, left as it
        was. drawn: the mission's constants, by default `draw(rng_seed)`. bottom_depth [m]: a
        number or shape (n,); None puts the bottom out of the DVL's reach. latitude [deg].
        density: default constant. current: compiled current field for the DVL's water cells.
        Raises InputError for a missing or misshapen signal and for a wrong dt, latitude or bottom.
        """
        from twin.water.density import DensityProfile

        self._check(truth, dt, latitude, bottom_depth)
        drawn = self.draw(rng_seed) if drawn is None else drawn
        if density is None:
            density = DensityProfile.constant()
        out: dict[str, NDArray[Any]] = {}

        def run(name: str, signals: Signals, **extra: Any) -> None:
            rng = device_generator(rng_seed, name)
            device = getattr(self, name)
            out.update(device.measure(signals, dt=dt, drawn=drawn, rng=rng, **extra))

        for name, ideal in _PASS_THROUGH.items():
            if getattr(self, name) == ideal[0] and not any(drawn.get(key, 0.0) for key in ideal[2]):
                out.update({f"measured_{s}": np.asarray(truth[f"true_{s}"]) for s in ideal[1]})
            else:
                run(name, truth)
        run("pressure", truth, density=density, latitude=latitude)
        run("gps", truth)
        run("dvl", truth, gyro=out, bottom_depth=bottom_depth, current=current)
        run("onboard", out)
        return {name: out[name] for name in MEASURED_SIGNALS}

    def _check(
        self, truth: Signals, dt: float, latitude: float, bottom_depth: ArrayLike | None
    ) -> None:
        missing = [name for name in TRUTH_SIGNALS if name not in truth]
        if missing:
            raise InputError(
                f"truth lacks {', '.join(missing)}: the sensors need every signal of TRUTH_SIGNALS"
            )
        n = np.shape(truth["true_depth"])
        for name in TRUTH_SIGNALS:
            if np.shape(truth[name]) != n or len(n) != 1 or n[0] == 0:
                raise InputError(
                    f"{name} has shape {np.shape(truth[name])} and true_depth {n}: give vectors "
                    "of one length, one mission at a time"
                )
        if not (np.isfinite(dt) and dt > 0.0):
            raise InputError(f"dt is {dt:g} s: give the positive time step of the truth")
        if not -90.0 <= latitude <= 90.0:
            raise InputError(f"latitude {latitude:g} deg is outside -90..90")
        if bottom_depth is not None:
            bottom = np.asarray(bottom_depth, float)
            if bottom.shape not in ((), n):
                raise InputError(
                    f"bottom_depth has shape {bottom.shape}: give a number or one per sample {n}"
                )
            if not np.all(bottom > 0.0):
                raise InputError(
                    f"bottom_depth is {bottom[~(bottom > 0.0)].flat[0]:g} m: it must be above 0, "
                    "positive down; None puts the bottom out of reach"
                )


_PASS_THROUGH: dict[str, tuple[Any, tuple[str, ...], tuple[str, ...]]] = {
    "imu": (
        Imu.ideal(),
        GYRO_SIGNALS + FORCE_SIGNALS,
        tuple(f"{name}_{axis}" for name in _UNITS for axis in "xyz"),
    ),
    "attitude": (Attitude.ideal(), ("roll", "pitch"), ()),
    "compass": (
        Compass.ideal(),
        ("heading",),
        tuple(name for name in DRAWN_UNITS if name.startswith("compass")),
    ),
    "encoders": (Encoders.ideal(), ("shift", "rotation", "pump"), ()),
}
"""device: (its ideal, the signals it then passes on as they are, the constants that must be 0)"""

SUITE_PRESETS: dict[str, SensorSuite] = {
    "ideal": SensorSuite(
        imu=Imu.ideal(),
        attitude=Attitude.ideal(),
        compass=Compass.ideal(),
        pressure=Pressure.ideal(),
        gps=Gps.ideal(),
        dvl=Dvl.ideal(),
        encoders=Encoders.ideal(),
    ),
    "field": SensorSuite(),
    "field-uncalibrated": SensorSuite(compass=Compass.preset("uncalibrated")),
    "field-no-dvl": SensorSuite(dvl=Dvl(fitted=False)),
}
"""`ideal`: measured is true (GPS still only at the surface; the on-board track is the algorithm
on ideal inputs). `field`: 3DM-GX5-25, "calibrated" compass, and the other devices' defaults."""
