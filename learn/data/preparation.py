"""Preparation: make training and validation sequences of one network from a store."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self, get_args

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import SPEED, TARGETS, Division, MissionSequence, Selection
from learn.data.labels import LabelConfig, count_labels
from learn.data.sequences import (
    Mirror,
    Normalisation,
    NormalisationFit,
    Sequences,
    SequenceSource,
    StreamedSequences,
)
from learn.data.stores import (
    Stores,
    each_store,
    no_measured_labels,
    no_truth,
    open_stores,
    parts_of,
)
from twin.errors import InputError, StoreError, unknown_name
from twin.navigation.features import channels_of, mirror_signs
from twin.navigation.flight_filter import FlightSpread
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath

Floats = NDArray[np.float32]
Places = NDArray[np.int64]
Sequence3 = tuple[Floats, Floats, Floats]
"""Inputs (time, features), target (time,) and weights (time,) of a mission."""

TRUTH = LabelConfig()

TARGET_SIGNS = {"surge": 1.0, "sway": -1.0}
"""Sign of each velocity in a mission's mirror image, port for starboard."""
VALIDATING = 4
"""In a training with held-out rows, one of this number of rows validates."""
DIVISION_EDGES = {"train": (0.0, 0.7), "validation": (0.7, 0.85), "test": (0.85, 1.0)}
"""Ranges of a uniform random number that put a sample in each split of the paper's division."""


@dataclasses.dataclass(frozen=True)
class Prepared:
    """Normalised data of one target; as a context manager, it closes the store."""

    train: SequenceSource
    validation: SequenceSource
    normalisation: Normalisation
    selection: Selection

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.selection.close()

    @property
    def period(self) -> float:
        """[s] between samples"""
        return self.selection.period


def prepare(
    store: str | StorePath | Stores,
    *,
    target: str,
    features: Sequence[str],
    division: Division = "missions",
    seed: int = 0,
    mirror: bool = True,
    period: float | None = None,
    scales: Normalisation | None = None,
    held_out: Sequence[int] = (),
    labels: LabelConfig = TRUTH,
    spread: FlightSpread | None = None,
    resident: bool = True,
) -> Prepared:
    """Prepare training and validation data of one velocity, in one pass through the stores.

    Args:
      store: path of a store, or paths of several.
      target: surge or sway.
      features: names of the inputs, in order.
      division: `missions` uses the store's split. `samples` is the paper's random 70/15/15
        division over samples of all missions; it leaks (see `SampleDivision`).
      seed: seed of the division by samples.
      mirror: train on the mirror image of every mission too, port for starboard.
      period: [s] between samples, see `Selection`.
      scales: normalisation of a network whose training continues; None fits one to the data.
      held_out: rows of the store that are neither trained nor validated on. If there are any, the
        store's split has no effect: every fourth of the other rows validates, the rest train.
      labels: source of the velocities to learn, the truth or a Doppler log.
      spread: prior standard deviations of hulls about the vehicle file, for the flight filter.
      resident: keep all sequences in memory; if False, read them again on each use, with equal
        values.

    Raises:
      InputError: the target or division is unknown; a vehicle's part has no mirror image.
      StoreError: as in `Selection`; or a split has no missions.
    """
    if target not in TARGETS:
        raise InputError(unknown_name("target", target, TARGETS))
    if division not in get_args(Division):
        raise InputError(unknown_name("division", division, get_args(Division)))
    signs = mirror_signs(features, parts_of(store)) if mirror else None
    own = [TARGETS[target], *_speed(store)] if labels.source == "truth" else labels.channels()
    selection = open_stores(store, [*channels_of(features), *own], period=period, spread=spread)
    try:
        task = _Task(tuple(features), target, labels, signs, division, seed, tuple(held_out))
        return _one_pass(selection, task, scales, resident=resident)
    except BaseException:
        selection.close()
        raise


def training_lengths(
    store: str | StorePath | Stores,
    division: Division = "missions",
    period: float | None = None,
    held_out: Sequence[int] = (),
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Lengths, in samples, of the missions that may train, and of those that may validate.

    With held-out rows or a division by samples, both lists are equal. Errors: see `Selection`.
    """
    with open_stores(store, (), period=period) as selection:
        places = _candidates(selection, division, held_out)
        if division == "samples" or held_out:
            return selection.lengths[places], selection.lengths[places]
        trains = np.array(selection.splits)[places] == "train"
        if not trains.any():
            raise _no_training(selection.store)
        return selection.lengths[places[trains]], selection.lengths[places[~trains]]


def sample_bytes(features: int) -> int:
    """Bytes of one sample in memory: features, target and weight, at four bytes each."""
    return 4 * (features + 2)


def _candidates(selection: Selection, division: Division, held_out: Sequence[int]) -> Places:
    """Indices of the missions that may train or validate."""
    if held_out:
        return np.flatnonzero(~np.isin(selection.rows, held_out))
    places = np.arange(len(selection))
    if division == "samples":
        return places
    return np.flatnonzero(np.isin(selection.splits, ("train", "validation")))


def _speed(store: str | StorePath | Stores) -> list[str]:
    """Name of a log's channel of speed through the water, if the store has it; else empty."""
    with MissionStore(each_store(store)[0]) as reader:
        return [SPEED] if reader.logged and SPEED in reader else []


@dataclasses.dataclass(frozen=True)
class _Task:
    """Settings by which missions become sequences."""

    features: tuple[str, ...]
    target: str
    labels: LabelConfig
    signs: Floats | None
    """Sign of each feature in a mission's mirror image; None if missions are not mirrored"""
    division: Division
    seed: int
    held_out: tuple[int, ...]

    @property
    def mirror(self) -> Mirror | None:
        """Signs of features and target in the mirror image; None if missions are not mirrored."""
        return None if self.signs is None else Mirror(self.signs, TARGET_SIGNS[self.target])

    def fit(self) -> NormalisationFit:
        """Start a fit of the normalisation; values that change sign in the mirror get mean zero."""
        if self.signs is None:
            return NormalisationFit(self.features, self.target)
        centred = [n for n, s in zip(self.features, self.signs, strict=True) if s < 0]
        centred += [self.target] if TARGET_SIGNS[self.target] < 0 else []
        return NormalisationFit(self.features, self.target, centred)


@dataclasses.dataclass(frozen=True)
class _Maker:
    """Function from a mission of one split (train or validation) to the mission's sequence."""

    task: _Task
    scales: Normalisation
    division: SampleDivision | None
    """Division by samples; None: all samples of a mission count"""
    part: str
    numbers: Places
    """Index of each of the split's missions among all missions with labels"""

    def __call__(self, mission: MissionSequence, number: int) -> Sequence3:
        wanted = self.task.labels.of(mission, self.task.target)
        made = normalised(self.scales, mission.features(self.task.features), wanted)
        return self.weighed(made, number)

    def weighed(self, made: Sequence3, number: int) -> Sequence3:
        """Sequence with weight 0 for the samples of other splits."""
        if self.division is None:
            return made
        inputs, wanted, weights = made
        share = self.division.weights(int(self.numbers[number]), self.part)
        return inputs, wanted, weights * share


def normalised(scales: Normalisation, matrix: Floats, wanted: Floats) -> Sequence3:
    """Normalised sequence of a mission; samples without a known target have weight 0."""
    return scales.inputs(matrix), scales.wanted(wanted), np.isfinite(wanted).astype(np.float32)


def _one_pass(
    selection: Selection, task: _Task, scales: Normalisation | None, *, resident: bool
) -> Prepared:
    """Find the missions with labels, fit the normalisation and, if resident, keep the sequences."""
    fitted = task.fit()
    kept: list[int] = []
    training: list[bool] = []
    known: list[tuple[Floats, Floats]] = []
    certain = task.labels.source == "truth" and not selection.logged
    candidates = _candidates(selection, task.division, task.held_out)
    for place, mission in zip(candidates, selection.each(candidates), strict=True):
        wanted = task.labels.of(mission, task.target)
        if not certain and not np.isfinite(wanted).any():
            continue
        trains = mission.split == "train" or task.division == "samples"
        if task.held_out:
            trains = len(kept) % VALIDATING != 1
        matrix = mission.features(task.features)
        if trains and scales is None:
            fitted.add(matrix, wanted)
        if resident:
            known.append((matrix, wanted))
        kept.append(int(place))
        training.append(trains)
    if len(candidates) and not kept:
        raise _nothing_learned(selection, task)
    _check_kept(selection, task, kept, training)
    normalisation = fitted.result() if scales is None else scales
    ready: list[Sequence3] = []
    for k, (matrix, wanted) in enumerate(known):
        ready.append(normalised(normalisation, matrix, wanted))
        known[k] = _EMPTY  # frees the raw mission, so that none is in memory twice
    places, chosen = np.array(kept, np.int64), np.array(training)
    division = None
    parts = {"train": np.flatnonzero(chosen), "validation": np.flatnonzero(~chosen)}
    if task.division == "samples":
        division = SampleDivision(selection.lengths[places], task.seed)
        parts["validation"] = parts["train"]
    found: dict[str, SequenceSource] = {}
    for part, numbers in parts.items():
        make = _Maker(task, normalisation, division, part, numbers)
        found[part] = (
            _in_memory(make, ready)
            if resident
            else StreamedSequences(
                selection, places[numbers], len(task.features), task.mirror, make
            )
        )
    if resident:
        selection.close()
    return Prepared(found["train"], found["validation"], normalisation, selection)


_EMPTY = (np.empty((0, 0), np.float32), np.empty(0, np.float32))


def _in_memory(make: _Maker, ready: Sequence[Sequence3]) -> Sequences:
    made = [make.weighed(ready[k], number) for number, k in enumerate(make.numbers)]
    inputs, targets, weights = ([one[part] for one in made] for part in range(3))
    return Sequences(inputs, targets, weights, make.task.mirror)


def _nothing_learned(selection: Selection, task: _Task) -> StoreError:
    """Error for a store in which no mission has a label."""
    if task.labels.source != "truth":
        counts = count_labels(selection.each(), task.labels)
        return no_measured_labels(selection.store, task.target, counts, task.labels)
    return no_truth(selection.store, task.target)


def _check_kept(
    selection: Selection, task: _Task, kept: Sequence[int], training: Sequence[bool]
) -> None:
    """Raise StoreError if there are too few missions to learn from."""
    if task.held_out and len(kept) < 2:
        raise StoreError(
            f"store {selection.store}: without rows {list(task.held_out)} fewer than two are left"
        )
    if not any(training):
        raise _no_training(selection.store)


def _no_training(store: str | StorePath) -> StoreError:
    return StoreError(
        f"store {store} has no missions for training; it needs a split into train, validation and "
        "test, as `factory generate` makes"
    )


class SampleDivision:
    """The paper's random division of samples into 70 % training, 15 % validation, 15 % test.

    The division leaks: samples half a second apart are nearly equal, so validation and test do not
    show unseen motion. Use it to reproduce the paper's numbers, never to choose a network.
    """

    def __init__(self, lengths: NDArray[np.int64], seed: int) -> None:
        self._lengths, self._seed = lengths, seed
        self._first = np.cumsum(lengths) - lengths

    def weights(self, mission: int, part: str) -> Floats:
        """Weights of a mission's samples: 1 in `part` (train, validation or test), else 0.

        The random stream starts at the mission's first sample, so calls may have any order.
        """
        bits = np.random.PCG64(self._seed)
        bits.advance(int(self._first[mission]))
        draws = np.random.Generator(bits).random(int(self._lengths[mission]))
        low, high = DIVISION_EDGES[part]
        return ((draws >= low) & (draws < high)).astype(np.float32)
