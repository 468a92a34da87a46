"""Sequences: missions as a network of one target sees them, in memory or read when needed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import Mission, Selection, pieces

Floats = NDArray[np.float32]
Places = NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class Mirror:
    """Port taken for starboard: a glider is as symmetric as its image is a glider."""

    inputs: Floats
    """Sign of each feature, (features,), 1 or -1; features of sign -1 are normalised about zero."""
    target: float
    """Sign of the target: 1 for surge, -1 for sway."""


class SequenceSource(Protocol):
    """Sequences of missions, wherever they are."""

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Samples of each mission."""
        ...

    @property
    def width(self) -> int:
        """Features of a sample."""
        ...

    @property
    def mirror(self) -> Mirror | None:
        """How missions are mirrored; None where that is not wanted."""
        ...

    @property
    def resident(self) -> bool:
        """Whether all of them are in memory."""
        ...

    def take(self, places: Sequence[int] | Places) -> Sequences:
        """The missions at these places, in their order, in memory."""
        ...


@dataclasses.dataclass(frozen=True)
class Sequences:
    """Sequences in memory: normalised inputs and target of each mission."""

    inputs: list[Floats]
    """(time, features) of each mission."""
    targets: list[Floats]
    """(time,) of each mission."""
    weights: list[Floats]
    """(time,) of each mission: 1 where the sample counts, else 0."""
    mirror: Mirror | None = None
    """How missions are mirrored; None where that is not wanted."""

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Samples of each mission."""
        return np.array([len(t) for t in self.targets], np.int64)

    @property
    def samples(self) -> int:
        """Samples of all missions."""
        return int(self.lengths.sum())

    @property
    def width(self) -> int:
        """Features of a sample."""
        return int(self.inputs[0].shape[1])

    @property
    def resident(self) -> bool:
        """True."""
        return True

    def take(self, places: Sequence[int] | Places) -> Sequences:
        """These missions; nothing is copied."""
        inputs, targets, weights = (
            [values[k] for k in places] for values in (self.inputs, self.targets, self.weights)
        )
        return Sequences(inputs, targets, weights, self.mirror)


@dataclasses.dataclass(frozen=True)
class StreamedSequences:
    """Sequences that are read from the store whenever they are asked for."""

    selection: Selection
    places: Places
    """Of the missions in the selection."""
    width: int
    mirror: Mirror | None
    make: Callable[[Mission, int], tuple[Floats, Floats, Floats]]
    """From a mission and its number among these to its inputs, target and weights."""

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Samples of each mission."""
        return self.selection.lengths[self.places]

    @property
    def resident(self) -> bool:
        """False."""
        return False

    def take(self, places: Sequence[int] | Places) -> Sequences:
        """Read these missions, a few at a time.

        Raises:
          StoreError: the store has changed since it was prepared, and cannot be read.
        """
        found: list[tuple[Floats, Floats, Floats]] = []
        for some in pieces(places, self.lengths):
            missions = self.selection.read(self.places[some])
            found += [self.make(m, k) for m, k in zip(missions, some, strict=True)]
        inputs, targets, weights = (list(values) for values in zip(*found, strict=True))
        return Sequences(inputs, targets, weights, self.mirror)


def ahead(source: SequenceSource, parts: Sequence[Places]) -> Iterator[Sequences]:
    """Some missions after others; while one part is in use, the next one is read."""
    if source.resident or not parts:
        yield from map(source.take, parts)
        return
    with ThreadPoolExecutor(1, "sequences") as reader:
        coming = reader.submit(source.take, parts[0])
        for part in parts[1:]:
            ready = coming.result()
            coming = reader.submit(source.take, part)
            yield ready
            del ready  # before the part after the next one begins to fill the memory
        yield coming.result()
