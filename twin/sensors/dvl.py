"""DVL: Doppler velocity log with four beams, on the bottom or in the water below the vehicle.

Each ping, beam i along b_i (azimuth 45, 135, 225, 315 deg, tilted from the instrument's axis) reads
b_i . (v + omega x r) (1 + scale error) + noise, with r the lever arm. In bottom lock, v is the
velocity over ground; in water lock, the velocity through the water of the cell layer. A beam sees
the bottom while its slant range to the sea floor is within the instrument's range and its angle
from the vertical is small enough; over an uneven floor each beam has its own range. Water lock
needs the whole cell layer above the floor. Three beams are enough: least squares over the beams in
use gives the velocity. Pings are averaged over the interval centred on a sample, where the lock is
decided. The vehicle removes the lever arm with its own gyro.

The mount turns the instrument and its beams by a small fixed rotation that the vehicle does not
know: the vehicle takes velocities in the instrument's axes for velocities in its own axes.

Defaults: LinkQuest 600 kHz micro (the paper's table: 0.3-110 m, 1 % +- 1 mm/s, 5 Hz); beams and
water mode as in the osrf/lrauv simulation. Frame: body FRD, positive as the vehicle moves.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.numbers import Array
from twin.records.schema import variables
from twin.sensors.base import (
    NOWHERE,
    Outset,
    Sensor,
    SensorRun,
    Signals,
    Surroundings,
    columns,
    drawn_value,
    normals,
    require_finite,
    require_non_negative,
    require_positive,
)
from twin.sensors.kernels import body_kernel, dvl_kernel, level_slant_kernel, slant_kernel

DEG = math.pi / 180.0
AZIMUTHS_DEG = (45.0, 135.0, 225.0, 315.0)
"""[deg] Azimuths of the beams about the instrument's axis, from forward to starboard."""
MODES = {"none": 0, "bottom": 1, "water": 2}
"""Values of measured_dvl_mode; the instrument's own record has the same flags."""
CELL_SAMPLES = 3
"""Number of depths across the cell layer at which the current is averaged."""
CELL_PERIOD = 2.0
"""[s] Time for which the current of the cell layer is held, as it changes slowly over 40 m."""
MARCH = 2.0
"""[m] Step of the search for the floor along a beam, as the altimeter's."""
BODY_RATES = ("roll_rate", "pitch_rate", "yaw_rate")
ANGLES = ("true_roll", "true_pitch", "true_heading")
OVER_GROUND = ("true_velocity_north", "true_velocity_east", "true_velocity_down")
THROUGH_WATER = ("true_surge", "true_sway", "true_heave")
OUTPUTS = ("measured_dvl_surge", "measured_dvl_sway", "measured_dvl_heave")


def beam_directions(tilt: float) -> Array:
    """Unit vectors of the beams, shape (4, 3), body FRD, `tilt` [rad] from straight down."""
    azimuth, sine = np.array(AZIMUTHS_DEG) * DEG, math.sin(tilt)
    down = np.full(4, math.cos(tilt))
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), down], axis=1)


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
    """One instrument, whose scale, sound speed and misalignment errors are sampled per mission."""

    name = "dvl"
    reads = (
        "true_north", "true_east", "true_depth", *ANGLES, *THROUGH_WATER, *OVER_GROUND,
        *(f"true_{name}" for name in BODY_RATES), *(f"measured_{name}" for name in BODY_RATES),
    )  # fmt: skip
    writes = variables(*OUTPUTS, "measured_dvl_mode")
    draws: ClassVar[Mapping[str, str]] = {
        "dvl_scale": "1", "dvl_sound_speed": "1",
        **{f"dvl_misalignment_{axis}": "rad" for axis in "xyz"},
    }  # fmt: skip
    unset: ClassVar[Mapping[str, Any]] = {"misalignment_deg": 0.0}

    fitted: bool = True
    """False: the vehicle has no DVL, velocities are NaN and the mode is 0"""
    exact: bool = False
    """True: the reading is the true velocity over ground in bottom mode at any depth"""
    ping_rate: float = 5.0
    """[Hz] Rate of the pings"""
    tilt_deg: float = 30.0
    """[deg] Angle of each beam from the instrument's axis"""
    lever_arm: tuple[float, float, float] = (-0.60, 0.0, 0.11)
    """[m] Place from the CB, body FRD; the lrauv simulation's, at the Sea-Wing's hull bottom"""
    min_range: float = 0.3
    """[m] Smallest slant range of bottom lock"""
    max_range: float = 110.0
    """[m] Largest slant range of bottom lock"""
    max_beam_angle_deg: float = 60.0
    """[deg] Largest angle from the vertical at which a beam gets a bottom echo"""
    cell_min: float = 20.0
    """[m] Distance of the nearest water cell below a level instrument"""
    cell_max: float = 60.0
    """[m] Distance of the farthest water cell"""
    scale: float = 0.005
    """[1] Standard deviation of the scale error: the data sheet's 1 %, taken as two sigma"""
    sound_speed: float = 0.0
    """[1] Standard deviation of dc/c, added to the scale error; 0: the data sheet's 1 % has it"""
    misalignment_deg: float = 0.5
    """[deg] Standard deviation of the rotation in the mount about each body axis; our estimate for
    a mechanical mount without calibration. Misalignment and attitude are the largest errors of
    Doppler navigation (Kinsey and Whitcomb, 2007)"""
    bottom_noise: float = 0.001
    """[m/s] Noise per beam and ping: the data sheet's 1 mm/s, taken as one sigma"""
    water_noise: float = 0.0035
    """[m/s] Noise per beam and ping, as in the lrauv simulation"""
    mean_lock_time: float = 600.0
    """[s] Mean time with lock (two-state Markov chain); our estimate"""
    mean_loss_time: float = 5.0
    """[s] Mean time without any lock; 0: lock is never lost"""
    outlier_probability: float = 0.0075
    """[1] Probability of an outlier per ping"""
    outlier_size: float = 0.5
    """[m/s] Bound of an outlier, which is uniform within +- this, on one beam"""
    wrong_beam_share: float = 0.5
    """[1] Fraction of the outliers in which a beam reports its neighbour's velocity instead"""

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
        """Make a log that always reads the true velocity over ground."""
        return cls(exact=True, scale=0.0, misalignment_deg=0.0, lever_arm=(0.0, 0.0, 0.0))

    @classmethod
    def noise_free(cls) -> Dvl:
        """Make the default instrument without random errors; geometry, range and modes stay."""
        return cls(
            scale=0.0, misalignment_deg=0.0, bottom_noise=0.0, water_noise=0.0,
            mean_loss_time=0.0, outlier_probability=0.0,
        )  # fmt: skip

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample the mission's relative scale and sound-speed errors [1] and misalignment [rad]."""
        turn = self.misalignment_deg * DEG
        return self.draw_normal(rng, (self.scale, self.sound_speed, turn, turn, turn))

    def begin(self, outset: Outset) -> DvlRun:
        """Begin to measure measured_dvl_surge/_sway/_heave [m/s] at the CB and measured_dvl_mode.

        The measured body rates remove the lever arm. The current of the surroundings is evaluated
        at the cell layer.
        """
        run = DvlRun(self, outset.dt, outset.samples, outset.surroundings)
        if self.fitted and not self.exact:
            rng, pings = outset.rng, math.ceil((outset.samples - 0.5) * outset.dt * self.ping_rate)
            outliers = self._outliers(rng, max(1, pings))
            scale, sound_speed, *turn = (drawn_value(outset.drawn, name) for name in self.draws)
            run.pings = Pings(
                self._locked(rng, max(1, pings)),
                normals(rng, outset.samples, 4),
                *outliers,
                beam_directions(self.tilt_deg * DEG) @ rotation(np.array(turn)).T,
                1.0 + scale + sound_speed,
            )
        return run

    @classmethod
    def observed(cls, name: str, signals: Signals) -> NDArray[Any] | None:
        """True velocity over ground in bottom lock, through the water in water lock."""
        from twin.frames import euler_to_matrix

        axis = name.removeprefix("dvl_")
        through_water, mode = signals.get(f"true_{axis}"), signals.get("measured_dvl_mode")
        if through_water is None or mode is None:
            return through_water
        angles = (np.deg2rad(signals[name]) for name in ANGLES)
        velocity = np.stack([signals[name] for name in OVER_GROUND], axis=-1)
        body = np.einsum("tji,tj->ti", euler_to_matrix(*angles), velocity)
        ground = body[:, ("surge", "sway", "heave").index(axis)]
        return np.where(mode == MODES["water"], through_water, ground)

    def _locked(self, rng: np.random.Generator, pings: int) -> NDArray[np.bool_]:
        """Mark pings with lock; times with and without lock are exponential (two-state chain)."""
        locked, ping_dt = np.ones(pings, bool), 1.0 / self.ping_rate
        if self.mean_loss_time == 0.0:
            return locked
        now, end = 0.0, pings * ping_dt
        if rng.random() < self.mean_loss_time / (self.mean_lock_time + self.mean_loss_time):
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
        """Outlier velocity [m/s] of each ping (0 none, NaN the neighbour's) and its beam."""
        size, beam = np.zeros(pings), np.zeros(pings, np.int64)
        count = rng.binomial(pings, self.outlier_probability)
        where = rng.integers(pings, size=count)
        size[where] = rng.uniform(-self.outlier_size, self.outlier_size, count)
        size[where[rng.random(count) < self.wrong_beam_share]] = np.nan
        beam[where] = rng.integers(4, size=count)
        return size, beam


class Pings(NamedTuple):
    """Random numbers and geometry of a log that pings."""

    locked: NDArray[np.bool_]
    """True for pings with lock."""
    white: NDArray[np.float32]
    """Standard normals, (n, 4)."""
    outlier: Array
    """[m/s] Outlier of each ping: 0 none, NaN the beam reports its neighbour's velocity."""
    outlier_beam: NDArray[np.int64]
    beams: Array
    """Directions of the beams as mounted, (4, 3)."""
    factor: float
    """[1] Factor on the velocities."""


@dataclasses.dataclass
class DvlRun(SensorRun):
    """A Doppler log in one mission."""

    delay = 1  # a reading is the mean over an interval centred on the sample

    dvl: Dvl
    dt: float
    samples: int
    surroundings: Surroundings = NOWHERE
    pings: Pings | None = None
    """Random numbers of the pings; None: the log is not fitted, or exact."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        velocity, mode = np.full((3, last - first), np.nan), np.zeros(last - first)
        span = slice(first, last)
        if self.pings is not None:
            # a ping between two samples needs both of them
            around = slice(max(first - 1, 0), min(last + 1, self.samples))
            velocity, mode = self._pinged(self.pings, signals, around, span)
            x, y, z = self.dvl.lever_arm
            p, q, r = columns(signals, [f"measured_{name}" for name in BODY_RATES], span)
            velocity[0] -= q * z - r * y
            velocity[1] -= r * x - p * z
            velocity[2] -= p * y - q * x
        elif self.dvl.fitted:
            over_ground = columns(signals, (*ANGLES, *OVER_GROUND), span)
            body_kernel(*over_ground, velocity, np.empty_like(velocity))
            mode[:] = MODES["bottom"]
        return dict(zip(OUTPUTS, velocity, strict=True)) | {"measured_dvl_mode": mode}

    def finish(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        kept, self.samples = self.samples, last
        try:
            return self.measure(signals, first, last)
        finally:
            self.samples = kept

    def _pinged(
        self, pings: Pings, truth: Signals, around: slice, span: slice
    ) -> tuple[Array, Array]:
        """Velocity at the instrument [m/s], (3, stretch), and mode for the samples of `span`.

        `around` is `span` with one more sample on either side, where the mission has one.
        """
        its, current = self.dvl, self.surroundings.current
        angles, over_ground = (columns(truth, names, around) for names in (ANGLES, OVER_GROUND))
        n = len(angles[0])
        ground, plumb = np.empty((3, n)), np.empty((3, n))
        body_kernel(*angles, *over_ground, ground, plumb)
        if current is None:
            water = np.stack(columns(truth, THROUGH_WATER, around))
        else:
            below = self._cell_current(truth, around, current)
            through = [v - c for v, c in zip(over_ground, below, strict=True)]
            water = np.empty((3, n))
            body_kernel(*angles, *through, water, np.empty((3, n)))
        rates = np.stack(columns(truth, [f"true_{name}" for name in BODY_RATES], around))
        tilt, lever = its.tilt_deg * DEG, np.array(its.lever_arm, float)
        cell_reach = its.cell_max / math.cos(tilt)
        north, east, depth = columns(truth, ("true_north", "true_east", "true_depth"), around)
        # distances [m] along the beams to the bottom; inf where there is none
        slant = np.full((len(pings.beams), n), np.inf)
        bottom = self.surroundings.bottom_depth
        if self.surroundings.floor is not None:
            slant_kernel(
                self.surroundings.floor, north, east, depth, *angles, lever, pings.beams,
                max(its.max_range, cell_reach), MARCH, slant,
            )  # fmt: skip
        elif bottom is not None:
            level = np.asarray(bottom, float)
            level = level[around] if level.shape else np.full(n, level)
            level_slant_kernel(plumb, depth, level, lever, pings.beams, slant)
        velocity, mode = np.empty((3, n)), np.zeros(n)
        own = slice(span.start - around.start, span.stop - around.start)
        dvl_kernel(
            ground, water, rates, plumb, depth, slant, lever, pings.beams, beam_solutions(tilt),
            1.0 / its.ping_rate / self.dt, pings.locked, pings.factor, its.bottom_noise,
            its.water_noise, pings.white, pings.outlier, pings.outlier_beam, its.min_range,
            its.max_range, math.cos(its.max_beam_angle_deg * DEG), cell_reach, around.start,
            own.start, own.stop, velocity, mode,
        )  # fmt: skip
        return velocity[:, own], mode[own]

    def _cell_current(self, truth: Signals, span: slice, current: Array) -> list[Array]:
        """Current [m/s] north, east, down averaged over the cell layer, each of shape (n,)."""
        from twin.water.current.sampler import sample_track

        stride = max(1, round(CELL_PERIOD / self.dt))
        at = np.arange(span.start // stride * stride, span.stop, stride)
        north, east, depth, roll, pitch = columns(
            truth, ("true_north", "true_east", "true_depth", *ANGLES[:2]), at
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
