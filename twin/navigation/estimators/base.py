"""Velocity estimators: base class, table of types, and estimators that use the last minutes.

An estimator gives the vehicle's velocity through the water. One class is one method, both sample by
sample on board (`step`) and over a whole mission (`batch`). Estimators that need only the vehicle
are the baselines of comparisons with networks.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from twin import seams
from twin.errors import InputError, unknown_name
from twin.navigation.dead_reckoning import Array, Signals, values_of
from twin.records.schema import VARIABLES
from twin.registry import Registry
from twin.vehicle.vehicle import Vehicle

State = Mapping[str, NDArray[Any]]
"""State as arrays by name, for `restore`."""

MEMORY_S = 120.0
"""[s] Time span of a windowed step's samples: it covers the longest average and an inflection, in
which methods hold a value."""
USUAL = ("ekf", "steady_flight", "dvl")
"""Estimators in the order of choice if the user names none."""


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class BodyVelocity:
    """Velocity through the water at one sample, body FRD."""

    surge: float
    """[m/s] forward"""
    sway: float
    """[m/s] to starboard"""
    heave: float = math.nan
    """[m/s] downward in body axes; NaN if the depth rate must give it"""
    covariance: NDArray[np.float64] | None = None
    """[m2/s2] covariance of the errors, (3, 3); None if the estimator gives none"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VelocityDeviation:
    """Standard deviations of an estimator's error, stated before the mission.

    The defaults are for an estimator that states none: those of a glider's dead reckoning by
    attitude and depth.

    Raises:
      InputError: a value that is negative or not finite.
    """

    scale: float = 0.06
    """[1] Constant relative error of the speed, from a wrong vehicle or a wrong scale"""
    noise: float = 0.02
    """[m/s] Varying error of the velocity, north and east each"""
    memory: float = 60.0
    """[s] Correlation time of the varying error"""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(
                    f"a velocity's deviation: {field.name} is {value!r}; it must be finite, and 0 "
                    "or more"
                )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Estimate:
    """Estimated velocities of one mission; quantities that a method cannot give are None."""

    surge: Array | None = None
    """[m/s] through the water, forward, (time,)"""
    sway: Array | None = None
    """[m/s] through the water, starboard, (time,)"""
    surge_sd: Array | None = None
    """[m/s] Standard deviation of `surge`, as the method states it, (time,)"""
    sway_sd: Array | None = None
    """[m/s] Standard deviation of `sway`, as the method states it, (time,)"""
    ground_track: Array | None = None
    """[m] north, east over ground since the first sample, (time, 2), for a method that computes its
    own track."""
    uses_fixes: bool = False
    """True if `ground_track` is reset at GPS fixes and includes the depth-averaged current."""
    saw_bottom: bool = False
    """True if `ground_track` may use bottom lock: it is then no track through the water, even
    without fixes."""


class VelocityEstimator(abc.ABC):
    """Estimator of the velocity through the water, from measured and commanded signals only.

    A method defines `kind`, `summary`, `channels` and `step`. It knows the nominal vehicle of the
    file, never a mission's sampled vehicle.
    """

    kind: ClassVar[str] = ""
    """Name for `twin simulate --navigate KIND` or `KIND:ARGUMENT`."""
    summary: ClassVar[str] = ""
    """Description for tables of methods."""
    title: ClassVar[str] = ""
    """Name in tables and legends; empty uses `kind`."""
    colour: ClassVar[str] = ""
    """Colour, a name of `twin.show.style.PALETTE`; grey if empty."""
    drawn: ClassVar[bool] = False
    """True: figures of tracks show this method; more than a few tracks would hide each other."""
    without_water: ClassVar[str] = ""
    """Reason why the method has no track through the water, a sentence for the report."""
    takes: ClassVar[str] = ""
    """Argument of the estimator, such as RUN; an estimator with an argument is no baseline."""

    channels: tuple[str, ...] = ()
    """Schema variables that a sample must hold: measured or commanded, never true."""
    period: float
    """[s] between samples"""
    _memory: Any = None
    """Object with `reset`, `state` and `restore` that holds the state of `step`"""

    def __init__(self, vehicle: Vehicle, period: float):
        """Create the estimator.

        Args:
          vehicle: the nominal vehicle, as in its file.
          period: [s] between the given samples. An estimator that needs a multiple of it sets its
            own `period`.
        """
        self.vehicle, self.period = vehicle, period
        self.channels = self.needs(vehicle)

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """Reason why the estimator does not suit a vehicle; empty if it does."""
        return ""

    @classmethod
    def needs(cls, vehicle: Vehicle) -> tuple[str, ...]:
        """Signals that the estimator reads on a vehicle: `channels` and others."""
        return cls.channels

    @property
    def deviation(self) -> VelocityDeviation:
        """Stated error of the estimator, with which a current filter starts."""
        return VelocityDeviation()

    @classmethod
    def open(cls, argument: str, vehicle: Vehicle, period: float) -> Self:
        """Create the estimator for a vehicle.

        Args:
          argument: the text after the colon, or empty.
          vehicle, period: as in `__init__`.

        Raises:
          InputError: an argument that the estimator does not take, or an unsuitable vehicle.
        """
        if argument:
            raise InputError(f"estimator {cls.kind!r} takes no argument, not {argument!r}")
        if why := cls.unsuited(vehicle):
            raise InputError(f"estimator {cls.kind!r}: {why}")
        return cls(vehicle, period)

    def reset(self) -> None:
        """Return to the state before the first sample."""
        if self._memory is not None:
            self._memory.reset()

    @abc.abstractmethod
    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """Velocity at a sample, from this sample and the earlier ones.

        Args:
          sample: a value for each of `channels`, in the schema's units.

        Raises:
          InputError: a channel is missing, or not finite where the method needs it.
        """

    def batch(self, signals: Signals) -> Estimate:
        """Velocities of a whole mission; by default, repeated calls of `step`.

        Raises:
          StoreError: a channel is missing or not finite.
        """
        self.reset()
        rows = np.stack([np.asarray(signals[name], np.float64) for name in self.channels], axis=1)
        found = [self.step(dict(zip(self.channels, row, strict=True))) for row in rows.tolist()]
        return Estimate(
            surge=np.array([one.surge for one in found]), sway=np.array([one.sway for one in found])
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """State as arrays by name, for `restore`."""
        return {} if self._memory is None else dict(self._memory.state())

    def restore(self, state: State) -> None:
        """Continue from the state that `state` returned, here or in another process."""
        if self._memory is not None:
            self._memory.restore(state)

    @classmethod
    def flaw(cls, name: str) -> str:
        """First fault of an estimator class; empty if it has none."""
        from twin.show.style import PALETTE

        if not cls.takes and not (isinstance(cls.channels, tuple) and cls.channels):
            return "it lacks `channels`, a tuple of the signals that it reads"
        for channel in cls.channels:
            if channel not in VARIABLES:
                return f"it reads {unknown_name('signal', channel, VARIABLES)}"
            if channel.startswith("true_"):
                return f"it reads {channel}: a velocity estimator must not see the truth"
        if cls.colour and cls.colour not in PALETTE:
            return f"it has {unknown_name('colour', cls.colour, PALETTE)}"
        return ""


class Recent:
    """Last samples of some channels, (samples,) each, in the form that `batch` reads."""

    def __init__(self, channels: tuple[str, ...], samples: int):
        self.channels, self.samples = channels, samples
        self.reset()

    def reset(self) -> None:
        """Delete all samples."""
        self._rows = np.zeros((len(self.channels), 0))

    @property
    def count(self) -> int:
        """Number of samples held."""
        return self._rows.shape[1]

    def add(self, sample: Mapping[str, float]) -> None:
        """Add a sample."""
        readers = f": this estimator reads {', '.join(self.channels)}"
        given = np.array(values_of(sample, self.channels, readers))[:, None]
        self._rows = np.concatenate([self._rows[:, 1 - self.samples :], given], axis=1)

    def signals(self) -> dict[str, Array]:
        """Samples of each channel, (count,)."""
        return dict(zip(self.channels, self._rows, strict=True))

    def state(self) -> dict[str, NDArray[Any]]:
        """Samples of all channels, (channels, count)."""
        return {"recent": self._rows.copy()}

    def restore(self, state: State) -> None:
        """Continue from `state`.

        Raises:
          InputError: the state has other channels or another period.
        """
        rows = state.get("recent")
        if rows is None or rows.shape[0] != len(self.channels) or rows.shape[1] > self.samples:
            raise InputError(
                "this state is of another estimator or of another period: make the estimator as "
                "it was when it was saved"
            )
        self._rows = np.array(rows, np.float64)


class WindowedEstimator(VelocityEstimator):
    """Estimator that defines `batch`; a step is the last sample of a batch over `MEMORY_S`."""

    def __init__(self, vehicle: Vehicle, period: float):
        """Create the estimator; see `VelocityEstimator`."""
        super().__init__(vehicle, period)
        self.recent = self._memory = Recent(self.channels, max(2, round(MEMORY_S / period) + 1))

    @abc.abstractmethod
    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`; averages may use later samples."""

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`; the velocity at the first sample is 0."""
        self.recent.add(sample)
        if self.recent.count < 2:
            return BodyVelocity(surge=0.0, sway=0.0)
        return self.last(self.recent.signals())

    def last(self, signals: Signals) -> BodyVelocity:
        """Velocity at the last sample; each channel is (count,).

        Raises:
          InputError: the method gives no velocity for this vehicle.
        """
        found = self.batch(signals)
        if found.surge is None or found.sway is None:
            raise InputError(
                f"the method {self.kind!r} gives no velocity through the water here: "
                "choose another estimator"
            )
        surge, sway, covariance = float(found.surge[-1]), float(found.sway[-1]), None
        if found.surge_sd is not None and found.sway_sd is not None:
            forward, starboard = found.surge_sd[-1], found.sway_sd[-1]
            covariance = np.diag(np.square((forward, starboard, max(forward, 0.0))))
        return BodyVelocity(surge=surge, sway=sway, covariance=covariance)


VELOCITY_ESTIMATORS: Registry[type[VelocityEstimator]] = seams.VELOCITY_ESTIMATORS
"""All velocity estimators by name."""

register = VELOCITY_ESTIMATORS.add
"""Add an estimator class; usable as a decorator."""


def baselines() -> dict[str, type[VelocityEstimator]]:
    """Estimators that need only the vehicle, by name: baselines of comparisons with networks."""
    return {name: kind for name, kind in VELOCITY_ESTIMATORS.items() if not kind.takes}


def check_estimate(name: str, estimate: Any, samples: int) -> Estimate:
    """Check the result of an estimator's `batch`, and return it.

    Raises:
      InputError: the result is no `Estimate`, or one of its arrays has a wrong shape.
    """
    if not isinstance(estimate, Estimate):
        raise InputError(
            f"estimator {name!r} gives {type(estimate).__name__} instead of an Estimate"
        )
    for field in dataclasses.fields(Estimate):
        values = getattr(estimate, field.name)
        wanted = (samples, 2) if field.name == "ground_track" else (samples,)
        if field.name in ("uses_fixes", "saw_bottom") or values is None:
            continue
        if np.shape(values) != wanted:
            raise InputError(
                f"estimator {name!r} gives {field.name} of shape {np.shape(values)}, not {wanted}"
            )
    return estimate


def open_velocity_estimator(text: str, vehicle: Vehicle, period: float) -> VelocityEstimator:
    """Open the estimator that a text such as "ekf" or "network:runs/mine" names.

    Args:
      vehicle: the nominal vehicle, as in its file.
      period: [s] between the given samples.

    Raises:
      InputError: an unknown name, an argument that the estimator does not take, or a vehicle that
        it does not suit.
    """
    kind, _, argument = text.partition(":")
    return VELOCITY_ESTIMATORS[kind].open(argument, vehicle, period)


def usual_velocity_estimator(vehicle: Vehicle, period: float) -> VelocityEstimator:
    """Open the first estimator of `USUAL` that suits a vehicle.

    Raises:
      InputError: no estimator suits the vehicle; the message has all reasons.
    """
    why = []
    for name in USUAL:
        try:
            return open_velocity_estimator(name, vehicle, period)
        except InputError as error:
            why.append(str(error))
    raise InputError("no velocity estimator suits the vehicle: " + "; ".join(why))
