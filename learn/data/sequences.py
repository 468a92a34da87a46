"""Sequences: missions as a network of one target sees them, in memory or read when needed.

Normalisation: shift and scale of a network's inputs and target.
Windows: pieces of missions packed for training, and the order in which training sees them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import MissionSequence, Selection, pieces

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
    make: Callable[[MissionSequence, int], tuple[Floats, Floats, Floats]]
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


@dataclasses.dataclass(frozen=True)
class SequenceWindows:
    """Pieces of missions, (mission, start, wash-in, length, mirrored), see `cut_windows`."""

    table: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.table)


def cut_windows(
    lengths: Iterable[int],
    *,
    length: int,
    washin: int,
    rng: np.random.Generator | None = None,
    mirror: bool = False,
) -> SequenceWindows:
    """Cut missions into pieces whose counted samples tile every mission exactly once.

    A piece counts `length` samples (the last of a mission fewer) and starts up to `washin` samples
    earlier, so that a network has found its state when counting begins. The first piece starts at
    the launch with no wash-in: the launch from rest counts. With `rng` the cuts are moved by a
    random amount, so that epochs differ. With `mirror` every other piece, at random, is the mirror
    image; without `rng` every piece comes both ways.
    """
    rows = []
    for mission, total in enumerate(lengths):
        first = length if rng is None else int(rng.integers(1, length + 1))
        begin = 0
        while begin < total:
            end = min(first if begin == 0 else begin + length, total)
            start = max(0, begin - washin)
            rows.append((mission, start, begin - start, end - begin, 0))
            begin = end
    table = np.array(rows, np.int64).reshape(-1, 5)
    if mirror and rng is not None:
        table[:, 4] = rng.integers(0, 2, len(table))
    elif mirror:
        table = np.concatenate([table, table + np.array([0, 0, 0, 0, 1])])
    return SequenceWindows(table)


def pack_windows(sequences: Sequences, windows: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
    """Windows side by side, padded at the end.

    Returns:
      inputs (time, batch, features), targets and weights (time, batch); wash-in and padding have
      weight 0.
    """
    longest = int((windows[:, 2] + windows[:, 3]).max())
    batch, features = len(windows), sequences.inputs[0].shape[1]
    x = np.zeros((longest, batch, features), np.float32)
    y = np.zeros((longest, batch), np.float32)
    w = np.zeros((longest, batch), np.float32)
    for column, (mission, start, skip, count, _) in enumerate(windows):
        end = start + skip + count
        x[: skip + count, column] = sequences.inputs[mission][start:end]
        y[: skip + count, column] = sequences.targets[mission][start:end]
        w[skip : skip + count, column] = sequences.weights[mission][start + skip : end]
    if sequences.mirror is not None:
        turned = windows[:, 4] == 1
        x[:, turned] *= sequences.mirror.inputs
        y[:, turned] *= np.float32(sequences.mirror.target)
    return x, y, w


def batches(
    windows: SequenceWindows, size: int, rng: np.random.Generator | None = None
) -> list[NDArray[np.int64]]:
    """Windows in groups of about `size`, similar lengths together, groups in random order.

    Sorting by length keeps the padding small; ties are broken at random.
    """
    table = windows.table
    if rng is not None:
        table = table[rng.permutation(len(table))]
    spans = table[:, 2] + table[:, 3]
    table = table[np.argsort(-spans, kind="stable")]
    groups = [table[k : k + size] for k in range(0, len(table), size)]
    if rng is not None:
        groups = [groups[k] for k in rng.permutation(len(groups))]
    return groups


Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Normalisation:
    """Shift and scale of inputs and target, fitted on training missions only."""

    features: tuple[str, ...]
    mean: tuple[float, ...]
    scale: tuple[float, ...]
    target: str
    target_mean: float
    """[m/s]"""
    target_scale: float
    """[m/s]"""

    def inputs(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Normalised features of the same shape (..., features)."""
        mean = np.array(self.mean, np.float32)
        scale = np.array(self.scale, np.float32)
        return (values - mean) / scale

    def wanted(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Normalised target of the same shape; zero where it is not known."""
        shifted = values - np.float32(self.target_mean)
        return np.nan_to_num(shifted / np.float32(self.target_scale), nan=0.0)


class Moments:
    """Means and squared deviations of columns, gathered mission by mission.

    Missions are joined by Chan, Golub and LeVeque, "Updating formulae and a pairwise algorithm for
    computing sample variances" (1979), eq. 2.1: as exact as two passes over all samples together.
    The result follows from the missions and their order alone.
    """

    def __init__(self, columns: int) -> None:
        self._count = 0
        self._mean = np.zeros(columns)
        self._squares = np.zeros(columns)

    def add(self, values: NDArray[np.float32]) -> None:
        """One mission, (samples, columns)."""
        count = len(values)
        if not count:
            return
        exact = values.astype(np.float64)
        mean = exact.mean(0)
        squares = np.square(exact - mean).sum(0)
        total, away = self._count + count, mean - self._mean
        self._squares += squares + np.square(away) * (self._count * count / total)
        self._mean += away * (count / total)
        self._count = total

    def statistics(self, about_zero: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Mean and standard deviation of each column; of those marked, zero and about zero."""
        squares = self._squares / self._count
        mean = np.where(about_zero, 0.0, self._mean)
        deviation = np.sqrt(np.where(about_zero, squares + np.square(self._mean), squares))
        return mean, deviation


class NormalisationFit:
    """A normalisation from training missions, each seen once.

    A feature that never changes keeps the scale 1: it says nothing, and a division by its rounding
    noise would make it loud.
    """

    def __init__(self, features: Sequence[str], target: str, centred: Iterable[str] = ()) -> None:
        """`centred`: features and target whose mean is taken as zero, because the training shows
        every mission with its mirror image, where they have the other sign."""
        self._features, self._target = tuple(features), target
        self._centred = np.isin([*features, target], list(centred))
        self._inputs, self._wanted = Moments(len(self._features)), Moments(1)

    def add(self, matrix: NDArray[np.float32], wanted: NDArray[np.float32]) -> None:
        """One mission: features (time, features), and target (time,), NaN where not known."""
        self._inputs.add(matrix)
        self._wanted.add(wanted[np.isfinite(wanted)][:, None])

    def result(self) -> Normalisation:
        """Shift and scale of all that was added."""
        mean, deviation = self._inputs.statistics(self._centred[:-1])
        (target_mean,), (target_scale,) = self._wanted.statistics(self._centred[-1:])
        constant = deviation <= 1e-6 * np.maximum(np.abs(mean), 1e-6)
        return Normalisation(
            features=self._features,
            mean=tuple(map(float, mean)),
            scale=tuple(map(float, np.where(constant, 1.0, deviation))),
            target=self._target,
            target_mean=float(target_mean),
            target_scale=float(target_scale) or 1.0,
        )
