"""Feature steps: features sample by sample, as a vehicle under way computes them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.navigation.features.base import Feature, Term, feature, slope_weights
from twin.numbers import Array

STATE = ("window", "angles", "count")
"""Arrays of a state."""


class FeatureSteps:
    """Values of several features for one sample after the other, equal to `Feature.compute`.

    Terms that several features share are looked up once. All looks are weighted sums over one
    window of the last samples, (terms, samples).
    """

    def __init__(self, features: Sequence[str | Feature], period: float):
        """Begin before the first sample.

        Args:
          features: names or features, in the order of the values.
          period: [s] between samples.
        """
        self.period = period
        self.features = tuple(feature(f) if isinstance(f, str) else f for f in features)
        terms = tuple(dict.fromkeys(term for f in self.features for term in f.terms))
        self.channels = tuple(dict.fromkeys(term.channel for term in terms))
        """Schema variables that a sample must hold."""
        column = {name: k for k, name in enumerate(self.channels)}
        place = {term: k for k, term in enumerate(terms)}
        self._columns = np.array([column[term.channel] for term in terms], int)
        shapes = np.array([term.shape for term in terms])
        self._sine, self._cosine, self._angle = (
            np.flatnonzero(shapes == shape) for shape in ("sine", "cosine", "angle")
        )
        lengths = [term.samples(period) for term in terms]
        self._weights = np.zeros((len(terms), max(lengths, default=1)))
        for k, (term, length) in enumerate(zip(terms, lengths, strict=True)):
            self._weights[k, -length:] = _weights(term, length, period)
        self._means = np.flatnonzero([term.look == "mean" for term in terms])
        self._lengths = np.array(lengths, int)[self._means]
        self._plain = [
            (k, place[f.terms[0]]) for k, f in enumerate(self.features) if f.combine is None
        ]
        self._combined = [
            (k, f.combine, [place[term] for term in f.terms])
            for k, f in enumerate(self.features)
            if f.combine is not None
        ]
        self._to, self._from = np.array(self._plain, int).reshape(-1, 2).T
        self.reset()

    def reset(self) -> None:
        """Begin before the first sample again."""
        self._window = np.zeros_like(self._weights)
        self._angles = np.zeros(self._angle.size)
        self._count = 0

    def step(self, sample: Mapping[str, float]) -> Array:
        """Values (features,) after a sample, in their own units.

        Args:
          sample: a finite value for each of `channels`, in the schema's units.

        Raises:
          InputError: a channel is missing or not finite.
        """
        try:
            given = [float(sample[name]) for name in self.channels]
        except KeyError as lost:
            raise InputError(
                f"the sample has no channel {lost}; its features read {', '.join(self.channels)}"
            ) from None
        if not math.isfinite(sum(given)):
            bad = next(n for n, v in zip(self.channels, given, strict=True) if not math.isfinite(v))
            raise InputError(
                f"channel {bad} is not finite at sample {self._count}: hold the last good value, "
                "or leave the sample out"
            )
        looked = self._look(np.array(given)[self._columns])
        values = np.empty(len(self.features))
        values[self._to] = looked[self._from]
        for k, combine, places in self._combined:
            values[k] = combine(*looked[places])
        return values

    def _look(self, given: Array) -> Array:
        """Values of the terms, (terms,), after these samples of theirs, (terms,)."""
        given[self._sine] = np.sin(np.deg2rad(given[self._sine]))
        given[self._cosine] = np.cos(np.deg2rad(given[self._cosine]))
        if self._angle.size:
            turned = np.deg2rad(given[self._angle])
            if self._count:
                turn = turned - self._angles
                turned = self._angles + turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
            given[self._angle] = self._angles = turned
        if self._count:
            self._window[:, :-1] = self._window[:, 1:]
            self._window[:, -1] = given
        else:  # before the first sample a signal is taken as constant
            self._window[:] = given[:, None]
        self._count += 1
        looked = np.einsum("ts,ts->t", self._weights, self._window)
        if self._count < self._weights.shape[1]:
            for k, length in zip(self._means, self._lengths, strict=True):
                if self._count < length:
                    looked[k] = self._window[k, -self._count :].mean()
        return looked

    def state(self) -> dict[str, NDArray[np.float64]]:
        """All that the next step depends on, as arrays by name."""
        return {
            "window": self._window.copy(),
            "angles": self._angles.copy(),
            "count": np.array(float(self._count)),
        }

    def restore(self, state: Mapping[str, NDArray[np.float64]]) -> None:
        """Go on from where `state` was called, here or in another process.

        Raises:
          InputError: it is of other features or of another period.
        """
        lost = [name for name in STATE if name not in state]
        if lost or np.shape(state["window"]) != self._window.shape:
            raise InputError(
                "this state is of other features or of another period: make the steps as they "
                "were when it was saved"
            )
        self._window = np.array(state["window"], np.float64)
        self._angles = np.array(state["angles"], np.float64)
        self._count = int(state["count"])


def _weights(term: Term, samples: int, period: float) -> Array:
    """Weights (samples,) of the samples, oldest first, in what the term gives."""
    if term.look == "slope":
        return slope_weights(samples, period)
    return np.full(samples, 1.0 / samples)
