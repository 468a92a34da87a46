"""DVL: Doppler velocity log with four beams, on the bottom or in the water below the vehicle.

Each ping, beam i along b_i (azimuth 45, 135, 225, 315 deg, tilted from the instrument's axis)
reads b_i . (v + omega x r) (1 + scale error) + noise, where v is the velocity over ground in
bottom lock and the velocity through the water of the cell layer in water lock, and r the lever
arm. A beam sees the bottom while its slant range to the sea floor lies in the instrument's range
and the beam is not too far from the vertical; over an uneven floor each beam ends where it meets
it. Water lock needs the whole cell layer above the floor. Three beams are enough: least squares
over the ones that are left gives the velocity. Pings are averaged to the mission's grid, over the
interval centred on the sample at which the lock is decided, and the vehicle removes the lever arm
with its own gyro.

The instrument sits turned by a small fixed rotation in its mount, which the vehicle does not know:
the beams point that way, and the velocity is given in the instrument's axes as if they were the
vehicle's.

Defaults: LinkQuest 600 kHz micro (the paper's table: 0.3-110 m, 1 % +- 1 mm/s, 5 Hz); beams and
water mode as in the osrf/lrauv simulation. Frame: body FRD, positive as the vehicle moves.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.numbers import Array
from twin.records.schema import variables
from twin.sensors.base import NOWHERE, Outset, Sensor, SensorRun, Surroundings
from twin.sensors.checks import (
    Signals,
    drawn_value,
    require_finite,
    require_non_negative,
    require_positive,
    signal,
)
from twin.sensors.noise import normals

DEG = math.pi / 180.0
AZIMUTHS_DEG = (45.0, 135.0, 225.0, 315.0)
"""[deg] of the beams about the instrument's axis, from forward to starboard"""
MODES = {"none": 0, "bottom": 1, "water": 2}
"""measured_dvl_mode; the record of the instrument flags them the same way"""
CELL_SAMPLES = 3
"""depths across the cell layer at which the current is averaged"""
CELL_PERIOD = 2.0
"""[s] for which the current below holds: the layer is 40 m thick and changes slowly"""
MARCH = 2.0
"""[m] steps in which a beam looks for the floor, as the altimeter's"""
BODY_RATES = ("roll_rate", "pitch_rate", "yaw_rate")
OUTPUTS = ("measured_dvl_surge", "measured_dvl_sway", "measured_dvl_heave")


def beam_directions(tilt: float) -> Array:
    """Unit vectors of the beams, shape (4, 3), body FRD, `tilt` [rad] from straight down."""
    azimuth = np.array(AZIMUTHS_DEG) * DEG
    horizontal = math.sin(tilt)
    return np.stack(
        [
            horizontal * np.cos(azimuth),
            horizontal * np.sin(azimuth),
            np.full(4, math.cos(tilt)),
        ],
        axis=1,
    )


def rotation(turn: Array) -> Array:
    """Matrix of the rotation by a vector [rad], shape (3, 3) (Rodrigues): instrument to body."""
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = turn / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


@functools.lru_cache(maxsize=8)
def beam_solutions(tilt: float) -> Array:
    """Least-squares inverses, shape (16, 3, 4): entry `set` uses beam i where bit i is set."""
    beams = beam_directions(tilt)
    out = np.zeros((16, 3, 4))
    for used in range(16):
        index = [i for i in range(4) if used >> i & 1]
        if len(index) >= 3:
            out[used][:, index] = np.linalg.pinv(beams[index])
    return out


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dvl(Sensor):
    """One instrument; the scale error and the sound-speed error are drawn once per mission."""

    name = "dvl"
    reads = (
        "true_north", "true_east", "true_depth", "true_roll", "true_pitch", "true_heading",
        "true_surge", "true_sway", "true_heave",
        "true_velocity_north", "true_velocity_east", "true_velocity_down",
        *(f"true_{name}" for name in BODY_RATES), *(f"measured_{name}" for name in BODY_RATES),
    )  # fmt: skip
    writes = variables(*OUTPUTS, "measured_dvl_mode")
    draws: ClassVar[Mapping[str, str]] = {
        "dvl_scale": "1", "dvl_sound_speed": "1",
        **{f"dvl_misalignment_{axis}": "rad" for axis in "xyz"},
    }  # fmt: skip
    unset: ClassVar[Mapping[str, Any]] = {"misalignment_deg": 0.0}

    fitted: bool = True
    """False: the vehicle carries none, velocities are NaN and the mode is 0"""
    exact: bool = False
    """True: the true velocity over ground in bottom mode, whatever the depth"""
    ping_rate: float = 5.0
    """[Hz]"""
    tilt_deg: float = 30.0
    """[deg] of each beam from the instrument's axis"""
    lever_arm: tuple[float, float, float] = (-0.60, 0.0, 0.11)
    """[m] body FRD from the CB; the lrauv simulation's station, at the Sea-Wing's hull bottom"""
    min_range: float = 0.3
    """[m] smallest slant range of bottom lock"""
    max_range: float = 110.0
    """[m] largest slant range of bottom lock"""
    max_beam_angle_deg: float = 60.0
    """[deg] from the vertical; a beam beyond gets no bottom echo"""
    cell_min: float = 20.0
    """[m] nearest water cell, below a level instrument"""
    cell_max: float = 60.0
    """[m] farthest water cell"""
    scale: float = 0.005
    """[1] standard deviation of the scale error: the sheet's 1 % read as two sigma"""
    sound_speed: float = 0.0
    """[1] standard deviation of dc/c, which adds to the scale; 0: the sheet's 1 % contains it"""
    misalignment_deg: float = 0.5
    """[deg] standard deviation about each body axis by which it is turned in its mount; ours, a
    mechanical mount without calibration. With attitude the largest error of Doppler navigation
    (Kinsey and Whitcomb, 2007)"""
    bottom_noise: float = 0.001
    """[m/s] per beam and ping: the sheet's 1 mm/s read as one sigma"""
    water_noise: float = 0.0035
    """[m/s] per beam and ping, as in the lrauv simulation"""
    mean_lock_time: float = 600.0
    """[s] of the two-state Markov chain; ours"""
    mean_loss_time: float = 5.0
    """[s] without any lock; 0: lock is never lost"""
    outlier_probability: float = 0.0075
    """[1] per ping"""
    outlier_size: float = 0.5
    """[m/s] uniform within +- this, on one beam"""
    wrong_beam_share: float = 0.5
    """[1] of the outliers, in which a beam reports its neighbour's velocity instead"""

    def __post_init__(self) -> None:
        require_positive(self, "ping_rate", "max_range", "mean_lock_time", "cell_max")
        require_non_negative(
            self, "min_range", "cell_min", "scale", "sound_speed", "misalignment_deg",
            "bottom_noise", "water_noise", "mean_loss_time", "outlier_probability",
            "outlier_size", "wrong_beam_share",
        )  # fmt: skip
        require_finite(self, "lever_arm", "ping_rate")
        for name in ("outlier_probability", "wrong_beam_share"):
            if getattr(self, name) > 1.0:
                raise InputError(f"Dvl.{name} is {getattr(self, name):g}: it must be at most 1")
        require_finite(self, "tilt_deg", "max_beam_angle_deg")
        for name in ("tilt_deg", "max_beam_angle_deg"):
            if not 0.0 < getattr(self, name) < 90.0:
                raise InputError(
                    f"Dvl.{name} is {getattr(self, name):g} deg: it must lie between 0 and 90"
                )
        if self.min_range >= self.max_range or self.cell_min >= self.cell_max:
            raise InputError(
                f"Dvl ranges {self.min_range:g}..{self.max_range:g} m and cells "
                f"{self.cell_min:g}..{self.cell_max:g} m: each maximum must exceed its minimum"
            )

    @classmethod
    def ideal(cls) -> Dvl:
        """The true velocity over ground, always."""
        return cls(exact=True, scale=0.0, misalignment_deg=0.0, lever_arm=(0.0, 0.0, 0.0))

    @classmethod
    def noise_free(cls) -> Dvl:
        """The geometry, range and modes of the default instrument without random errors."""
        return cls(
            scale=0.0, misalignment_deg=0.0, bottom_noise=0.0, water_noise=0.0,
            mean_loss_time=0.0, outlier_probability=0.0,
        )  # fmt: skip

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """The mission's relative scale and sound-speed errors [1] and misalignment [rad]."""
        turn = self.misalignment_deg * DEG
        spread = (self.scale, self.sound_speed, turn, turn, turn)
        return self.draw_normal(rng, spread)

    def begin(self, outset: Outset) -> DvlRun:
        """measured_dvl_surge/_sway/_heave [m/s] at the CB and measured_dvl_mode.

        The measured body rates remove the lever arm. The current of the surroundings is evaluated
        at the cell layer.
        """
        if not self.fitted or self.exact:
            return DvlRun(dvl=self, dt=outset.dt, samples=outset.samples)
        ping_dt = 1.0 / self.ping_rate
        pings = max(1, math.ceil((outset.samples - 0.5) * outset.dt * self.ping_rate))
        outlier, outlier_beam = self._outliers(outset.rng, pings)
        mount = rotation(
            np.array([drawn_value(outset.drawn, f"dvl_misalignment_{a}") for a in "xyz"])
        )
        return DvlRun(
            dvl=self,
            dt=outset.dt,
            samples=outset.samples,
            locked=self._locked(outset.rng, pings, ping_dt),
            white=normals(outset.rng, outset.samples, 4),
            outlier=outlier,
            outlier_beam=outlier_beam,
            beams=beam_directions(self.tilt_deg * DEG) @ mount.T,
            factor=1.0
            + drawn_value(outset.drawn, "dvl_scale")
            + drawn_value(outset.drawn, "dvl_sound_speed"),
            surroundings=outset.surroundings,
        )

    @classmethod
    def observed(cls, name: str, signals: Signals) -> NDArray[Any] | None:
        """The velocity over ground in bottom lock, through the water in water lock."""
        from twin.frames import euler_to_matrix

        axis = name.removeprefix("dvl_")
        through_water, mode = signals.get(f"true_{axis}"), signals.get("measured_dvl_mode")
        if through_water is None or mode is None:
            return through_water
        angles = (np.deg2rad(signals[f"true_{n}"]) for n in ("roll", "pitch", "heading"))
        velocity = np.stack(
            [signals[f"true_velocity_{n}"] for n in ("north", "east", "down")], axis=-1
        )
        body = np.einsum("tji,tj->ti", euler_to_matrix(*angles), velocity)
        ground = body[:, ("surge", "sway", "heave").index(axis)]
        return np.where(mode == MODES["water"], through_water, ground)

    def _locked(self, rng: np.random.Generator, pings: int, ping_dt: float) -> NDArray[np.bool_]:
        """Which pings have lock: alternating exponential stays of the two-state chain."""
        locked = np.ones(pings, bool)
        if self.mean_loss_time == 0.0:
            return locked
        cycle = self.mean_lock_time + self.mean_loss_time
        lost_first = rng.random() < self.mean_loss_time / cycle
        now, end = 0.0, pings * ping_dt
        if lost_first:
            now = rng.exponential(self.mean_loss_time)
            locked[: math.ceil(now / ping_dt)] = False
        while True:
            now += rng.exponential(self.mean_lock_time)
            if now >= end:
                return locked
            lost = math.ceil(now / ping_dt)
            now += rng.exponential(self.mean_loss_time)
            locked[lost : math.ceil(now / ping_dt)] = False

    def _outliers(self, rng: np.random.Generator, pings: int) -> tuple[Array, NDArray[np.int64]]:
        """Per ping the wrong velocity [m/s] (0 none, NaN the neighbour's beam) and its beam."""
        size, beam = np.zeros(pings), np.zeros(pings, np.int64)
        count = rng.binomial(pings, self.outlier_probability)
        where = rng.integers(pings, size=count)
        size[where] = rng.uniform(-self.outlier_size, self.outlier_size, count)
        size[where[rng.random(count) < self.wrong_beam_share]] = np.nan
        beam[where] = rng.integers(4, size=count)
        return size, beam


@dataclasses.dataclass(kw_only=True)
class DvlRun(SensorRun):
    """A Doppler log in one mission; of its fields the later ones are of one that pings."""

    delay = 1  # readings are means over an interval centred on the sample

    dvl: Dvl
    dt: float
    samples: int
    locked: NDArray[np.bool_] = dataclasses.field(default_factory=lambda: np.zeros(0, bool))
    """per ping"""
    white: NDArray[np.float32] = dataclasses.field(default_factory=lambda: np.zeros((0, 4), "f4"))
    """standard normals, (n, 4)"""
    outlier: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    """[m/s] per ping"""
    outlier_beam: NDArray[np.int64] = dataclasses.field(
        default_factory=lambda: np.zeros(0, np.int64)
    )
    beams: Array = dataclasses.field(default_factory=lambda: np.zeros((4, 3)))
    """directions as mounted"""
    factor: float = 1.0
    surroundings: Surroundings = NOWHERE

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        velocity, mode = np.empty((3, last - first)), np.zeros(last - first)
        if not self.dvl.fitted:
            velocity[:] = np.nan
        elif self.dvl.exact:
            from twin.sensors.kernels import body_kernel

            span = slice(first, last)
            body_kernel(
                *self._angles(signals, span), *self._over_ground(signals, span), velocity,
                np.empty_like(velocity),
            )  # fmt: skip
            mode[:] = MODES["bottom"]
        else:
            # a ping between two samples needs both of them
            begin, stop = max(first - 1, 0), min(last + 1, self.samples)
            velocity, mode = self._pinged(signals, slice(begin, stop), first - begin, last - begin)
            x, y, z = self.dvl.lever_arm
            p, q, r = (signal(signals, f"measured_{name}")[first:last] for name in BODY_RATES)
            velocity[0] -= q * z - r * y
            velocity[1] -= r * x - p * z
            velocity[2] -= p * y - q * x
        return dict(zip(OUTPUTS, velocity, strict=True)) | {"measured_dvl_mode": mode}

    def finish(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        kept, self.samples = self.samples, last
        try:
            return self.measure(signals, first, last)
        finally:
            self.samples = kept

    @staticmethod
    def _angles(truth: Signals, span: slice) -> list[Array]:
        return [signal(truth, f"true_{name}")[span] for name in ("roll", "pitch", "heading")]

    @staticmethod
    def _over_ground(truth: Signals, span: slice) -> list[Array]:
        names = ("north", "east", "down")
        return [signal(truth, f"true_velocity_{name}")[span] for name in names]

    def _pinged(self, truth: Signals, span: slice, begin: int, end: int) -> tuple[Array, Array]:
        """Velocity at the instrument [m/s], (3, end - begin), and mode of these places of `span`.

        `span` has a sample more on either side, where the mission has.
        """
        from twin.sensors.kernels import body_kernel, dvl_kernel

        its, current = self.dvl, self.surroundings.current
        angles, over_ground = self._angles(truth, span), self._over_ground(truth, span)
        n = len(angles[0])
        ground, plumb = np.empty((3, n)), np.empty((3, n))
        body_kernel(*angles, *over_ground, ground, plumb)
        if current is None:
            names = ("surge", "sway", "heave")
            water = np.stack([signal(truth, f"true_{name}")[span] for name in names])
        else:
            below = self._cell_current(truth, span, current)
            through = [v - c for v, c in zip(over_ground, below, strict=True)]
            water = np.empty((3, n))
            body_kernel(*angles, *through, water, np.empty((3, n)))
        rates = np.stack([signal(truth, f"true_{name}")[span] for name in BODY_RATES])
        depth = signal(truth, "true_depth")[span]
        tilt = its.tilt_deg * DEG
        cell_reach = its.cell_max / math.cos(tilt)
        slant = self._slant(truth, span, angles, plumb, cell_reach)
        velocity, mode = np.empty((3, n)), np.zeros(n)
        dvl_kernel(
            ground, water, rates, plumb, depth, slant, np.array(its.lever_arm, float),
            self.beams, beam_solutions(tilt), 1.0 / its.ping_rate / self.dt,
            self.locked, self.factor, its.bottom_noise, its.water_noise,
            self.white, self.outlier, self.outlier_beam, its.min_range, its.max_range,
            math.cos(its.max_beam_angle_deg * DEG), cell_reach, span.start, begin, end,
            velocity, mode,
        )  # fmt: skip
        return velocity[:, begin:end], mode[begin:end]

    def _slant(
        self, truth: Signals, span: slice, angles: list[Array], plumb: Array, cell_reach: float
    ) -> Array:
        """Distances [m] along the beams to the bottom, shape (4, n); inf where there is none."""
        from twin.sensors.kernels import level_slant_kernel, slant_kernel

        its, around = self.dvl, self.surroundings
        depth = signal(truth, "true_depth")[span]
        slant = np.full((len(self.beams), depth.shape[0]), np.inf)
        lever = np.array(its.lever_arm, float)
        if around.floor is not None:
            place = [signal(truth, f"true_{name}")[span] for name in ("north", "east")]
            farthest = max(its.max_range, cell_reach)
            slant_kernel(
                around.floor, *place, depth, *angles, lever, self.beams, farthest, MARCH, slant
            )
        elif around.bottom_depth is not None:
            bottom = np.asarray(around.bottom_depth, float)
            bottom = bottom[span] if bottom.shape else np.full(depth.shape[0], bottom)
            level_slant_kernel(plumb, depth, bottom, lever, self.beams, slant)
        return slant

    def _cell_current(self, truth: Signals, span: slice, current: Array) -> list[Array]:
        """Current [m/s] north, east, down averaged over the cell layer, each of shape (n,)."""
        from twin.water.current.sampler import sample_track

        stride = max(1, round(CELL_PERIOD / self.dt))
        at = np.arange(span.start // stride * stride, span.stop, stride)
        north, east, depth, roll, pitch = (
            signal(truth, f"true_{name}")[at]
            for name in ("north", "east", "depth", "roll", "pitch")
        )
        plumb = np.cos(np.deg2rad(roll)) * np.cos(np.deg2rad(pitch))
        still = np.zeros(at.size)
        total = np.zeros((at.size, 3))
        for cell in np.linspace(self.dvl.cell_min, self.dvl.cell_max, CELL_SAMPLES):
            down = depth + cell * plumb
            total += sample_track(current, at * self.dt, north, east, down, *[still] * 3)[:, :3]
        total /= CELL_SAMPLES
        held = np.arange(span.start, span.stop) // stride - at[0] // stride
        return [total[held, i] for i in range(3)]
