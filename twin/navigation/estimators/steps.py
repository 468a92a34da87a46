"""Baseline steps: a baseline sample by sample, from the last minutes of what was measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.navigation.dead_reckoning import Signals
from twin.navigation.estimators.base import (
    BodyVelocity,
    State,
    VelocityDeviation,
    VelocityEstimator,
)
from twin.numbers import Array
from twin.seams import BASELINES
from twin.vehicle.vehicle import Vehicle

MEMORY_S = 120.0
"""[s] that a baseline looks back: its longest average, and an inflection, over which it holds."""


class Recent:
    """The last samples of some channels, (samples,) each, as `Baseline.estimate` reads them."""

    def __init__(self, channels: tuple[str, ...], samples: int):
        self.channels, self.samples = channels, samples
        self.reset()

    def reset(self) -> None:
        """Forget all."""
        self._rows = np.zeros((len(self.channels), self.samples))
        self.count = 0

    def add(self, sample: Mapping[str, float]) -> None:
        """Take a sample.

        Raises:
          InputError: a channel is missing.
        """
        try:
            given = [sample[name] for name in self.channels]
        except KeyError as lost:
            raise InputError(
                f"the sample has no channel {lost}: this estimator reads {', '.join(self.channels)}"
            ) from None
        if self.count < self.samples:
            self._rows[:, self.count] = given
            self.count += 1
        else:
            self._rows[:, :-1] = self._rows[:, 1:]
            self._rows[:, -1] = given

    def signals(self) -> dict[str, Array]:
        """What there is of each channel, (count,)."""
        return {name: self._rows[k, : self.count] for k, name in enumerate(self.channels)}

    def state(self) -> dict[str, NDArray[Any]]:
        """The samples, (channels, count)."""
        return {"recent": self._rows[:, : self.count].copy()}

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
        self.reset()
        self.count = rows.shape[1]
        self._rows[:, : self.count] = rows


class BaselineSteps(VelocityEstimator):
    """What a baseline says of the last sample when it has seen `MEMORY_S` up to it.

    One that the command line can name has the name of its baseline as `kind`.
    """

    def __init__(self, baseline: Any, period: float):
        """Begin before the first sample of a `Baseline`; `period` [s] between samples."""
        self.baseline, self.period = baseline, period
        self.channels = baseline.needs(baseline.vehicle)
        self.recent = Recent(self.channels, max(2, round(MEMORY_S / period) + 1))

    @property
    def deviation(self) -> VelocityDeviation:
        """See `VelocityEstimator`."""
        found: VelocityDeviation = self.baseline.deviation
        return found

    @classmethod
    def open(cls, argument: str, vehicle: Vehicle, period: float) -> Self:
        """See `VelocityEstimator`; it takes no argument."""
        if argument:
            raise InputError(f"estimator {cls.kind!r} takes no argument, not {argument!r}")
        baseline = BASELINES[cls.kind]
        if why := baseline.unsuited(vehicle):
            raise InputError(f"estimator {cls.kind!r}: {why}")
        return cls(baseline(vehicle=vehicle), period)

    def reset(self) -> None:
        """See `VelocityEstimator`."""
        self.recent.reset()

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
        found = self.baseline.estimate(signals, self.period)
        if found.surge is None or found.sway is None:
            raise InputError(
                f"the method {self.baseline.title!r} gives no velocity through the water here: "
                "choose another estimator"
            )
        covariance = None
        if found.surge_sd is not None and found.sway_sd is not None:
            deviations = (found.surge_sd[-1], found.sway_sd[-1], max(found.surge_sd[-1], 0.0))
            covariance = np.diag(np.square(deviations))
        return BodyVelocity(
            surge=float(found.surge[-1]), sway=float(found.sway[-1]), covariance=covariance
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """See `VelocityEstimator`."""
        return self.recent.state()

    def restore(self, state: State) -> None:
        """See `VelocityEstimator`."""
        self.recent.restore(state)
