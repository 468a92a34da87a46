"""Velocity estimators: the base class, its registry, and methods that look back on minutes.

An estimator says how fast the vehicle moves through the water. One class is one method, sample by
sample on board (`step`) and over a whole mission (`batch`). Those that need nothing but the vehicle
are the baselines that networks are compared with.
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
"""Arrays by name, on which the next step depends."""

MEMORY_S = 120.0
"""[s] that a windowed step looks back: the longest average, and an inflection, over which methods
hold."""
USUAL = ("ekf", "steady_flight", "dvl")
"""In the order in which they are tried where none is named."""


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class BodyVelocity:
    """Velocity through the water at one sample, body FRD."""

    surge: float
    """[m/s] forward"""
    sway: float
    """[m/s] to starboard"""
    heave: float = math.nan
    """[m/s] downward in body axes; NaN: the depth rate says it"""
    covariance: NDArray[np.float64] | None = None
    """[m2/s2] of the errors, (3, 3); None: the estimator claims nothing"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VelocityDeviation:
    """Standard deviations of an estimator's error, as it states them before it flies.

    The defaults are for an estimator that states none: those of a glider's dead reckoning by
    attitude and depth.

    Raises:
      InputError: a value that is negative or not finite.
    """

    scale: float = 0.06
    """[1] relative error of the speed that stays: a wrong vehicle or a wrong scale"""
    noise: float = 0.02
    """[m/s] north and east each, of what comes and goes"""
    memory: float = 60.0
    """[s] for which that lasts"""

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
    """Velocities of one mission; what a method cannot know is None."""

    surge: Array | None = None
    """[m/s] through the water, forward, (time,)"""
    sway: Array | None = None
    """[m/s] through the water, starboard, (time,)"""
    surge_sd: Array | None = None
    """[m/s] standard deviation that the method claims for `surge`, (time,)"""
    sway_sd: Array | None = None
    """[m/s] as `surge_sd`"""
    ground_track: Array | None = None
    """[m] north, east over ground since the first sample, (time, 2), of a method that makes its
    own track."""
    uses_fixes: bool = False
    """`ground_track` is reset at GPS fixes and carries the depth-averaged current."""
    saw_bottom: bool = False
    """`ground_track` may follow the sea floor: without fixes, too, it is no track through the
    water."""


class VelocityEstimator(abc.ABC):
    """Velocity through the water from what is measured and commanded; it never sees the truth.

    A method gives `kind`, `summary`, `channels` and `step`. It knows the vehicle as its file says,
    never as a mission drew it.
    """

    kind: ClassVar[str] = ""
    """Its name for `twin simulate --navigate KIND` or `KIND:ARGUMENT`."""
    summary: ClassVar[str] = ""
    """A description for tables of methods."""
    title: ClassVar[str] = ""
    """Its name in tables and legends; empty: its kind."""
    colour: ClassVar[str] = ""
    """A name of `twin.show.style.PALETTE`; grey without one."""
    drawn: ClassVar[bool] = False
    """Whether the figures of tracks draw it; more than a few would hide each other."""
    without_water: ClassVar[str] = ""
    """Why it can have no track through the water, a sentence for the report."""
    takes: ClassVar[str] = ""
    """Its argument, such as RUN; one that needs an argument is no baseline."""

    channels: tuple[str, ...] = ()
    """Schema variables that a sample must hold: measured or commanded, never true."""
    period: float
    """[s] between samples"""
    _memory: Any = None
    """Object with `reset`, `state` and `restore` on which the next step depends"""

    def __init__(self, vehicle: Vehicle, period: float):
        """Begin before the first sample.

        Args:
          vehicle: as its file says.
          period: [s] between the samples that there are. One that needs a multiple of it says so
            by its own `period`.
        """
        self.vehicle, self.period = vehicle, period
        self.channels = self.needs(vehicle)

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """Why it cannot estimate the velocities of such a vehicle; empty: it can."""
        return ""

    @classmethod
    def needs(cls, vehicle: Vehicle) -> tuple[str, ...]:
        """`channels`, and what else it reads on such a vehicle."""
        return cls.channels

    @property
    def deviation(self) -> VelocityDeviation:
        """The error that it states; a current filter begins with it."""
        return VelocityDeviation()

    @classmethod
    def open(cls, argument: str, vehicle: Vehicle, period: float) -> Self:
        """Make one for a vehicle.

        Args:
          argument: the text behind the colon, empty without.
          vehicle, period: as of `__init__`.

        Raises:
          InputError: an argument that it does not take, or a vehicle that it does not suit.
        """
        if argument:
            raise InputError(f"estimator {cls.kind!r} takes no argument, not {argument!r}")
        if why := cls.unsuited(vehicle):
            raise InputError(f"estimator {cls.kind!r}: {why}")
        return cls(vehicle, period)

    def reset(self) -> None:
        """Begin before the first sample."""
        if self._memory is not None:
            self._memory.reset()

    @abc.abstractmethod
    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """Velocity at a sample, from it and those before it.

        Args:
          sample: a value for each of `channels`, in the schema's units.

        Raises:
          InputError: a channel is missing, or not finite where the method needs it.
        """

    def batch(self, signals: Signals) -> Estimate:
        """Velocities of a whole mission; `step` after `step` where a method has no other way.

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
        """Arrays on which the next step depends."""
        return {} if self._memory is None else dict(self._memory.state())

    def restore(self, state: State) -> None:
        """Go on from where `state` was called, here or in another process."""
        if self._memory is not None:
            self._memory.restore(state)

    @classmethod
    def flaw(cls, name: str) -> str:
        """The first thing that is wrong with a kind."""
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
    """The last samples of some channels, (samples,) each, in the form that `batch` reads."""

    def __init__(self, channels: tuple[str, ...], samples: int):
        self.channels, self.samples = channels, samples
        self.reset()

    def reset(self) -> None:
        """Forget all."""
        self._rows = np.zeros((len(self.channels), 0))

    @property
    def count(self) -> int:
        """Samples so far."""
        return self._rows.shape[1]

    def add(self, sample: Mapping[str, float]) -> None:
        """Take a sample."""
        readers = f": this estimator reads {', '.join(self.channels)}"
        given = np.array(values_of(sample, self.channels, readers))[:, None]
        self._rows = np.concatenate([self._rows[:, 1 - self.samples :], given], axis=1)

    def signals(self) -> dict[str, Array]:
        """Samples of each channel so far, (count,)."""
        return dict(zip(self.channels, self._rows, strict=True))

    def state(self) -> dict[str, NDArray[Any]]:
        """The samples, (channels, count)."""
        return {"recent": self._rows.copy()}

    def restore(self, state: State) -> None:
        """Go on from `state`.

        Raises:
          InputError: it is of other channels or of another period.
        """
        rows = state.get("recent")
        if rows is None or rows.shape[0] != len(self.channels) or rows.shape[1] > self.samples:
            raise InputError(
                "this state is of another estimator or of another period: make the estimator as "
                "it was when it was saved"
            )
        self._rows = np.array(rows, np.float64)


class WindowedEstimator(VelocityEstimator):
    """A method that gives `batch`; a step is its last sample over `MEMORY_S` up to now."""

    def __init__(self, vehicle: Vehicle, period: float):
        """Begin before the first sample; see `VelocityEstimator`."""
        super().__init__(vehicle, period)
        self.recent = self._memory = Recent(self.channels, max(2, round(MEMORY_S / period) + 1))

    @abc.abstractmethod
    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`; averages may reach beyond a sample."""

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`; at rest at the first sample."""
        self.recent.add(sample)
        if self.recent.count < 2:
            return BodyVelocity(surge=0.0, sway=0.0)
        return self.last(self.recent.signals())

    def last(self, signals: Signals) -> BodyVelocity:
        """Velocity at the last of the samples (count,) of each channel.

        Raises:
          InputError: the method gives no velocity of this vehicle.
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
"""Every estimator that has a name."""

register = VELOCITY_ESTIMATORS.add
"""Add a kind of one's own; usable as a decorator."""


def baselines() -> dict[str, type[VelocityEstimator]]:
    """The estimators that need nothing but the vehicle, by name, as networks are set beside."""
    return {name: kind for name, kind in VELOCITY_ESTIMATORS.items() if not kind.takes}


def check_estimate(name: str, estimate: Any, samples: int) -> Estimate:
    """The result of an estimator's `batch`, as it must be.

    Raises:
      InputError: it is no `Estimate`, or an array of it has another shape.
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
    """The estimator that a text such as "ekf" or "network:runs/mine" names.

    Args:
      vehicle: as its file says.
      period: [s] between the samples that there are.

    Raises:
      InputError: an unknown kind, an argument that it does not take, or a vehicle that it does not
        suit.
    """
    kind, _, argument = text.partition(":")
    return VELOCITY_ESTIMATORS[kind].open(argument, vehicle, period)


def usual_velocity_estimator(vehicle: Vehicle, period: float) -> VelocityEstimator:
    """The first of `USUAL` that suits a vehicle.

    Raises:
      InputError: none does; what each lacks.
    """
    why = []
    for name in USUAL:
        try:
            return open_velocity_estimator(name, vehicle, period)
        except InputError as error:
            why.append(str(error))
    raise InputError("no velocity estimator suits the vehicle: " + "; ".join(why))
