"""Velocity estimators: their base class, and the registry that makes one from its name.

An estimator finds on board how fast the vehicle moves through the water.
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
from twin.errors import InputError
from twin.registry import Registry, missing_method, self_named
from twin.vehicle.vehicle import Vehicle

State = Mapping[str, NDArray[Any]]
"""What the next step depends on, arrays by name."""


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

    The defaults are those of an estimator that states none: what the dead reckoning of a glider by
    attitude and depth errs by.

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


class VelocityEstimator(abc.ABC):
    """Velocity through the water from what is measured and commanded, sample by sample.

    A kind that the command line can name gives `kind`, `summary` and `open`.
    """

    kind: ClassVar[str] = ""
    """What the user types: `twin simulate --navigate KIND` or `KIND:ARGUMENT`."""
    summary: ClassVar[str] = ""
    """What it does, for help texts and documents."""

    period: float
    """[s] between samples"""
    channels: tuple[str, ...]
    """Schema variables that a sample must hold: measured or commanded, never true."""

    @property
    def deviation(self) -> VelocityDeviation:
        """What it states of its error; a current filter begins with it."""
        return VelocityDeviation()

    @classmethod
    def open(cls, argument: str, vehicle: Vehicle, period: float) -> Self:
        """Make one for a vehicle.

        Args:
          argument: what stood behind the colon, empty without.
          vehicle: as its file says; never as a mission drew it.
          period: [s] between the samples that there are. One that needs a multiple of it says so
            by its own `period`.

        Raises:
          InputError: an argument that it does not take, or a vehicle that it does not suit.
        """
        raise NotImplementedError

    @abc.abstractmethod
    def reset(self) -> None:
        """Begin before the first sample."""

    @abc.abstractmethod
    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """Velocity at a sample, from it and those before it.

        Args:
          sample: a value for each of `channels`, in the schema's units.
        """

    @abc.abstractmethod
    def state(self) -> dict[str, NDArray[Any]]:
        """What the next step depends on."""

    @abc.abstractmethod
    def restore(self, state: State) -> None:
        """Go on from where `state` was called, here or in another process."""


USUAL = ("ekf", "steady_flight", "dvl")
"""In the order in which they are tried where none is named."""


def _lacks(kind: type[VelocityEstimator]) -> str:
    if not getattr(kind, "summary", ""):
        return "a `summary`"
    if kind.open.__func__ is VelocityEstimator.open.__func__:  # type: ignore[attr-defined]
        return "the method `open`"
    return missing_method(kind)


check_estimator = self_named(
    "velocity estimator",
    VelocityEstimator,  # type: ignore[type-abstract]
    _lacks,
    InputError,
)
"""Make sure that a kind is whole; the table of seams names it."""

VELOCITY_ESTIMATORS: Registry[type[VelocityEstimator]] = seams.VELOCITY_ESTIMATORS
"""Every estimator that has a name."""

register = VELOCITY_ESTIMATORS.add
"""Add a kind of one's own; usable as a decorator."""


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
