"""Sequences: normalised inputs and target of missions, in memory or read when needed.

Also here: normalisation of inputs and target, and windows, the sections that training packs.
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
    """Signs that turn a mission into its mirror image, port for starboard."""

    inputs: Floats
    """Sign of each feature, (features,), 1 or -1; features of sign -1 are normalised about zero."""
    target: float
    """Sign of the target: 1 for surge, -1 for sway."""


class SequenceSource(Protocol):
    """Protocol of a source of missions' sequences, in memory or streamed."""

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Samples of each mission."""
        ...

    @property
    def width(self) -> int:
        """Number of features."""
        ...

    @property
    def mirror(self) -> Mirror | None:
        """Signs of the mirror image; None if missions are not mirrored."""
        ...

    @property
    def resident(self) -> bool:
        """True if all sequences are in memory."""
        ...

    def take(self, places: Sequence[int] | Places) -> Sequences:
        """Load the missions at these indices into memory, in the given order."""
        ...


@dataclasses.dataclass(frozen=True)
class Sequences:
    """Sequences in memory: normalised inputs and target of each mission."""

    inputs: list[Floats]
    """Inputs of each mission, (time, features)."""
    targets: list[Floats]
    """Target of each mission, (time,)."""
    weights: list[Floats]
    """Weights of each mission, (time,): 1 if the sample counts, else 0."""
    mirror: Mirror | None = None
    """Signs of the mirror image; None if missions are not mirrored."""

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Samples of each mission."""
        return np.array([len(t) for t in self.targets], np.int64)

    @property
    def samples(self) -> int:
        """Number of samples in all missions."""
        return int(self.lengths.sum())

    @property
    def width(self) -> int:
        """Number of features."""
        return int(self.inputs[0].shape[1])

    @property
    def resident(self) -> bool:
        """True: all sequences are in memory."""
        return True

    def take(self, places: Sequence[int] | Places) -> Sequences:
        """Sequences of these missions; the arrays are not copied."""
        inputs, targets, weights = (
            [values[k] for k in places] for values in (self.inputs, self.targets, self.weights)
        )
        return Sequences(inputs, targets, weights, self.mirror)


@dataclasses.dataclass(frozen=True)
class StreamedSequences:
    """Sequences that are read from the store on each request."""

    selection: Selection
    places: Places
    """Indices of the missions in the selection."""
    width: int
    mirror: Mirror | None
    make: Callable[[MissionSequence, int], tuple[Floats, Floats, Floats]]
    """Function from a mission and its index in `places` to its inputs, target and weights."""

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Samples of each mission."""
        return self.selection.lengths[self.places]

    @property
    def resident(self) -> bool:
        """False: sequences are read on each request."""
        return False

    def take(self, places: Sequence[int] | Places) -> Sequences:
        """Read these missions, a few at a time.

        Raises:
          StoreError: the store has changed since its preparation and cannot be read.
        """
        found: list[tuple[Floats, Floats, Floats]] = []
        for some in pieces(places, self.lengths):
            missions = self.selection.read(self.places[some])
            found += [self.make(m, k) for m, k in zip(missions, some, strict=True)]
        inputs, targets, weights = (list(values) for values in zip(*found, strict=True))
        return Sequences(inputs, targets, weights, self.mirror)


def ahead(source: SequenceSource, parts: Sequence[Places]) -> Iterator[Sequences]:
    """Load groups of missions in turn; a thread reads the next group while one is in use."""
    if source.resident or not parts:
        yield from map(source.take, parts)
        return
    with ThreadPoolExecutor(1, "sequences") as reader:
        coming = reader.submit(source.take, parts[0])
        for part in parts[1:]:
            ready = coming.result()
            coming = reader.submit(source.take, part)
            yield ready
            del ready  # frees this group before the thread reads another
        yield coming.result()


@dataclasses.dataclass(frozen=True)
class SequenceWindows:
    """Windows of missions, one row for each window, see `cut_windows`."""

    table: NDArray[np.int64]
    """Columns: mission, first sample, warm-up samples, counted samples, 1 if mirrored"""

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
    """Cut missions into windows whose counted samples cover every mission exactly once.

    A window has `length` counted samples, or fewer at a mission's end. Up to `washin` samples
    before them warm up the network's state and do not count. A mission's first window has no
    warm-up: the launch from rest counts. With `rng`, each mission's first cut is random, so that
    epochs differ. With `mirror` and `rng`, each window is mirrored with probability one half; with
    `mirror` alone, every window comes plain and mirrored.
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
    """Pack windows into one batch, padded at the end.

    Returns:
      Inputs (time, batch, features), targets and weights (time, batch); warm-up and padding have
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
    """Divide windows into batches of at most `size` windows, in random order with `rng`.

    Windows are sorted by length, so that padding is small; `rng` also orders equal lengths.
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
    """Shift and scale of inputs and target, fitted to the training missions."""

    features: tuple[str, ...]
    mean: tuple[float, ...]
    scale: tuple[float, ...]
    target: str
    target_mean: float
    """[m/s] Mean of the target"""
    target_scale: float
    """[m/s] Standard deviation of the target"""

    def inputs(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Normalised features of the same shape (..., features)."""
        mean = np.array(self.mean, np.float32)
        scale = np.array(self.scale, np.float32)
        return (values - mean) / scale

    def wanted(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Normalised target of the same shape; zero where the target is unknown."""
        shifted = values - np.float32(self.target_mean)
        return np.nan_to_num(shifted / np.float32(self.target_scale), nan=0.0)


class Moments:
    """Running mean and variance of columns, updated mission by mission.

    The update is eq. 2.1 of Chan, Golub and LeVeque, "Updating formulae and a pairwise algorithm
    for computing sample variances" (1979), which is as exact as two passes over all samples. The
    result depends only on the missions and their order.
    """

    def __init__(self, columns: int) -> None:
        self._count = 0
        self._mean = np.zeros(columns)
        self._squares = np.zeros(columns)

    def add(self, values: NDArray[np.float32]) -> None:
        """Add one mission, (samples, columns)."""
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
        """Mean and standard deviation of each column; a column marked True has mean zero."""
        squares = self._squares / self._count
        mean = np.where(about_zero, 0.0, self._mean)
        deviation = np.sqrt(np.where(about_zero, squares + np.square(self._mean), squares))
        return mean, deviation


class NormalisationFit:
    """Fit of a normalisation to training missions, one at a time.

    A constant feature gets scale 1: division by its rounding noise would amplify that noise.
    """

    def __init__(self, features: Sequence[str], target: str, centred: Iterable[str] = ()) -> None:
        """Start a fit; `centred` names the features and target with mean zero, because training
        also sees each mission's mirror image, in which they change sign."""
        self._features, self._target = tuple(features), target
        self._centred = np.isin([*features, target], list(centred))
        self._inputs, self._wanted = Moments(len(self._features)), Moments(1)

    def add(self, matrix: NDArray[np.float32], wanted: NDArray[np.float32]) -> None:
        """Add one mission: features (time, features), and target (time,), NaN where unknown."""
        self._inputs.add(matrix)
        self._wanted.add(wanted[np.isfinite(wanted)][:, None])

    def result(self) -> Normalisation:
        """Normalisation of all added missions."""
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
