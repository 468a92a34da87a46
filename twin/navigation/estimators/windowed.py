"""Windowed estimator: a method over whole missions, sample by sample from the last minutes."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.navigation.dead_reckoning import Signals
from twin.navigation.estimators.base import (
    BodyVelocity,
    Estimate,
    State,
    VelocityEstimator,
)
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle

MEMORY_S = 120.0
"""[s] that a step looks back: the longest average, and an inflection, over which methods hold."""


class Recent:
    """The last samples of some channels, (samples,) each, as `batch` reads them."""

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


class WindowedEstimator(VelocityEstimator):
    """A method that gives `batch`; a step is its last sample over `MEMORY_S` up to now."""

    def __init__(self, vehicle: Vehicle, period: float):
        """Begin before the first sample; see `VelocityEstimator`."""
        super().__init__(vehicle, period)
        self.recent = Recent(self.channels, max(2, round(MEMORY_S / period) + 1))

    @abc.abstractmethod
    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`; what it averages may lie after a sample."""

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
        found = self.batch(signals)
        if found.surge is None or found.sway is None:
            raise InputError(
                f"the method {self.kind!r} gives no velocity through the water here: "
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
