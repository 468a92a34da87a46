"""Base of the baselines: what a method that estimates velocities may read, and what it returns.

Baselines are found by name, and imported when one is looked up. The command line can name them as
velocity estimators.
"""

from __future__ import annotations

import abc
import dataclasses
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.navigation.dead_reckoning import Array, Signals, depth_rate
from twin.navigation.estimators.base import VelocityDeviation, VelocityEstimator
from twin.navigation.estimators.steps import BaselineSteps
from twin.plugins import place_of
from twin.records.schema import VARIABLES
from twin.registry import check_class
from twin.vehicle.laws.flow_frame import is_flow_frame
from twin.vehicle.vehicle import Vehicle

Mask = NDArray[np.bool_]

SURFACE_DEPTH = 1.0
"""[m] above this a vehicle counts as afloat: it drifts and makes no way through the water."""
SHALLOW_DEPTH = 3.0
"""[m] above this it does when its depth rests too: pressure gauges are off by a metre or two."""
RESTING_RATE = 0.02
"""[m/s] of depth, averaged: a tenth of the slowest glide."""
RESTING_WINDOW_S = 10.0
"""[s] of that average."""


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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Baseline(abc.ABC):
    """A way to estimate velocities from what a vehicle measures and commands.

    It knows the vehicle as its file says, never as a mission drew it.
    """

    title: ClassVar[str]
    """What people read in tables and legends."""
    summary: ClassVar[str]
    """What it does, for tables of methods."""
    colour: ClassVar[str] = ""
    """Its colour, a name of `twin.show.style.PALETTE`; grey without one."""
    drawn: ClassVar[bool] = False
    """Whether the figures of tracks draw it; more than a few would hide each other."""
    without_water: ClassVar[str] = ""
    """Why it can have no track through the water, a sentence for the report."""
    channels: ClassVar[tuple[str, ...]]
    """Schema variables that it reads on every vehicle; none of them is truth."""

    steps: ClassVar[type[BaselineSteps]] = BaselineSteps
    """The method under way."""

    vehicle: Vehicle
    """Nominal parameters."""

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
        """What the method states of its velocity's error."""
        return VelocityDeviation()

    @abc.abstractmethod
    def estimate(self, signals: Signals, period: float) -> Estimate:
        """Velocities from channels (time,), one sample every `period` [s].

        Raises:
          StoreError: a channel is missing or not finite.
        """

    def begin(self, period: float) -> VelocityEstimator:
        """The same sample by sample, with one every `period` [s].

        What it says of a sample is what `estimate` says of the last one of what was seen so far.
        """
        return self.steps(self, period)


def no_glider(vehicle: Vehicle) -> str:
    """Why a vehicle does not glide by lift and drag coefficients; empty: it does.

    For methods that take a glider's balance of forces for granted.
    """
    if vehicle.steered("speed") is not None:
        return f"vehicle {vehicle.name!r} has a propeller: it does not glide"
    if vehicle.steered("buoyancy") is None:
        return f"vehicle {vehicle.name!r} has no pump: it does not glide"
    if not is_flow_frame(vehicle.law):
        return (
            f"vehicle {vehicle.name!r} has the hull law {vehicle.law.kind!r}: no lift and drag "
            "coefficients"
        )
    return ""


def check_baseline(name: str, kind: type[Baseline]) -> type[Baseline]:
    """Make sure that a baseline says what it must.

    Raises:
      InputError: it is only half there, with what it lacks.
    """
    from twin.show.style import PALETTE

    check_class("baseline", name, kind, Baseline, ("title", "summary"))
    where = f"baseline {name!r} ({place_of(kind)})"
    channels = getattr(kind, "channels", None)
    if not isinstance(channels, tuple) or not channels:
        raise InputError(f"{where} lacks channels, a tuple of the signals that it reads")
    for channel in channels:
        if channel not in VARIABLES:
            raise InputError(f"{where} reads {unknown_name('signal', channel, VARIABLES)}")
        if channel.startswith("true_"):
            raise InputError(f"{where} reads {channel}: a baseline must not see the truth")
    if kind.colour and kind.colour not in PALETTE:
        raise InputError(f"{where} has {unknown_name('colour', kind.colour, PALETTE)}")
    return kind


def check_estimate(name: str, estimate: Any, samples: int) -> Estimate:
    """What a baseline gave, as it must be.

    Raises:
      InputError: it is no `Estimate`, or an array of it has another shape.
    """
    if not isinstance(estimate, Estimate):
        raise InputError(
            f"baseline {name!r} gives {type(estimate).__name__} instead of an Estimate"
        )
    for field in dataclasses.fields(Estimate):
        values = getattr(estimate, field.name)
        wanted = (samples, 2) if field.name == "ground_track" else (samples,)
        if field.name in ("uses_fixes", "saw_bottom") or values is None:
            continue
        if np.shape(values) != wanted:
            raise InputError(
                f"baseline {name!r} gives {field.name} of shape {np.shape(values)}, not {wanted}"
            )
    return estimate


def afloat(depth: Array, period: float) -> Mask:
    """Where a vehicle with this measured depth [m] lies at the surface, (time,)."""
    rate = smooth(depth_rate(depth, period), RESTING_WINDOW_S, period)
    resting = (depth < SHALLOW_DEPTH) & (np.abs(rate) < RESTING_RATE)
    return resting | (depth < SURFACE_DEPTH)


def smooth(values: Array, seconds: float, period: float) -> Array:
    """Centred moving average over about `seconds`, shorter at the ends; (..., time)."""
    half = round(0.5 * seconds / period)
    count = values.shape[-1]
    total = np.zeros((*values.shape[:-1], count + 1))
    np.cumsum(values, axis=-1, out=total[..., 1:])
    index = np.arange(count)
    first = np.maximum(index - half, 0)
    last = np.minimum(index + half + 1, count)
    return np.asarray((total[..., last] - total[..., first]) / (last - first))


def hold(values: Array, valid: Mask, initial: float = 0.0) -> Array:
    """The last valid value at each sample, `initial` before the first; (time,)."""
    last = np.maximum.accumulate(np.where(valid, np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], initial)


def bridge(values: Array, valid: Mask, outside: float = 0.0, *, held: bool = False) -> Array:
    """Values with the samples that are not valid interpolated in between; (time,).

    Before the first and after the last valid sample, and without any, `outside`; with `held` the
    last valid value after it.
    """
    index = np.arange(len(values))
    if not valid.any():
        return np.full(len(values), outside)
    after = values[valid][-1] if held else outside
    return np.interp(index, index[valid], values[valid], left=outside, right=after)
