"""Preparation: from a store to the sequences that one network is trained and validated on."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self, get_args

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import SPEED, TARGETS, Division, MissionSequence, Selection, any_channel
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
    no_doppler_labels,
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
"""What the mirror port to starboard makes of the velocities."""
VALIDATING = 4
"""Of the rows that are not held out, every so many-th validates."""
DIVISION_EDGES = {"train": (0.0, 0.7), "validation": (0.7, 0.85), "test": (0.85, 1.0)}
"""Parts of the paper's division by samples."""


@dataclasses.dataclass(frozen=True)
class Prepared:
    """Normalised data of one target; a context manager, which lets go of the store."""

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
    """Training and validation data of one velocity, in one pass through the store or stores.

    Args:
      store: path of the store, or of several.
      target: surge or sway.
      features: names of the inputs, in order.
      division: `missions` uses the store's split. `samples` is the paper's random 70/15/15
        division over samples of all missions; it leaks (see `SampleDivision`).
      seed: of the division by samples.
      mirror: let the training show every mission mirrored port to starboard too.
      period: [s] between samples, see `Selection`.
      scales: of a network whose training goes on; fitted to the data without.
      held_out: rows of the store that are neither trained nor validated on. With any, the store's
        split is not asked: of the other rows every fourth validates, the rest train.
      labels: what is learned, the truth or what a Doppler log measured.
      spread: how far hulls may be from their file, for the flight filter.
      resident: keep all sequences in memory; else they are read again whenever they are needed,
        with the same values.

    Raises:
      InputError: an unknown target or division; a part of the vehicle that has no mirror image.
      StoreError: see `Selection`; or a split has no missions.
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
    """Samples of each mission that may train, and of each that may validate; errors as `Selection`.

    With rows held out, and by samples, each of the others may do both.
    """
    with open_stores(store, any_channel(each_store(store)[0]), period=period) as selection:
        places = _candidates(selection, division, held_out)
        if division == "samples" or held_out:
            return selection.lengths[places], selection.lengths[places]
        trains = np.array(selection.splits)[places] == "train"
        if not trains.any():
            raise _no_training(selection.store)
        return selection.lengths[places[trains]], selection.lengths[places[~trains]]


def sample_bytes(features: int) -> int:
    """Bytes of one sample in memory: its features, the target and the weight, each of four."""
    return 4 * (features + 2)


def _candidates(selection: Selection, division: Division, held_out: Sequence[int]) -> Places:
    """Missions that may train or validate."""
    if held_out:
        return np.flatnonzero(~np.isin(selection.rows, held_out))
    places = np.arange(len(selection))
    if division == "samples":
        return places
    return np.flatnonzero(np.isin(selection.splits, ("train", "validation")))


def _speed(store: str | StorePath | Stores) -> list[str]:
    """The channel of a log's speed through the water, where it has one."""
    with MissionStore(each_store(store)[0]) as reader:
        return [SPEED] if reader.logged and SPEED in reader else []


@dataclasses.dataclass(frozen=True)
class _Task:
    """What is made of missions."""

    features: tuple[str, ...]
    target: str
    labels: LabelConfig
    signs: Floats | None
    """Of the features in the mirror; None where missions are not mirrored"""
    division: Division
    seed: int
    held_out: tuple[int, ...]

    @property
    def mirror(self) -> Mirror | None:
        """How the sequences are mirrored."""
        return None if self.signs is None else Mirror(self.signs, TARGET_SIGNS[self.target])

    def fit(self) -> NormalisationFit:
        """Scales about zero for what the mirror turns round."""
        if self.signs is None:
            return NormalisationFit(self.features, self.target)
        centred = [n for n, s in zip(self.features, self.signs, strict=True) if s < 0]
        centred += [self.target] if TARGET_SIGNS[self.target] < 0 else []
        return NormalisationFit(self.features, self.target, centred)


@dataclasses.dataclass(frozen=True)
class _Maker:
    """Makes a mission's sequence; `numbers` are the missions that it is asked for."""

    task: _Task
    scales: Normalisation
    division: SampleDivision | None
    """None: all samples of a mission count"""
    part: str
    numbers: Places
    """Among all that have labels"""

    def __call__(self, mission: MissionSequence, number: int) -> Sequence3:
        wanted = self.task.labels.of(mission, self.task.target)
        made = normalised(self.scales, mission.features(self.task.features), wanted)
        return self.weighed(made, number)

    def weighed(self, made: Sequence3, number: int) -> Sequence3:
        """A sequence in which only the samples of its part count."""
        if self.division is None:
            return made
        inputs, wanted, weights = made
        share = self.division.weights(int(self.numbers[number]), self.part)
        return inputs, wanted, weights * share


def normalised(scales: Normalisation, matrix: Floats, wanted: Floats) -> Sequence3:
    """The sequence of a mission; samples whose target is not known do not count."""
    return scales.inputs(matrix), scales.wanted(wanted), np.isfinite(wanted).astype(np.float32)


def _one_pass(
    selection: Selection, task: _Task, scales: Normalisation | None, *, resident: bool
) -> Prepared:
    """Which missions have labels, their scales, and their sequences where those are kept."""
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
        known[k] = _GONE  # so that no mission is in memory twice
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


_GONE = (np.empty((0, 0), np.float32), np.empty(0, np.float32))


def _in_memory(make: _Maker, ready: Sequence[Sequence3]) -> Sequences:
    made = [make.weighed(ready[k], number) for number, k in enumerate(make.numbers)]
    inputs, targets, weights = ([one[part] for one in made] for part in range(3))
    return Sequences(inputs, targets, weights, make.task.mirror)


def _nothing_learned(selection: Selection, task: _Task) -> StoreError:
    """No mission has a label."""
    if task.labels.source == "dvl":
        counts = count_labels(selection.each(), task.labels)
        return no_doppler_labels(selection.store, task.target, counts)
    return no_truth(selection.store, task.target)


def _check_kept(
    selection: Selection, task: _Task, kept: Sequence[int], training: Sequence[bool]
) -> None:
    """Raise StoreError where there is too little to learn from."""
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
    """The paper's division: each SAMPLE is training, validation or test with 70, 15, 15 %.

    It leaks: samples half a second apart are nearly equal, so validation and test cannot judge
    unseen motion. It is here to reproduce the paper's figures, never to choose a network.
    """

    def __init__(self, lengths: NDArray[np.int64], seed: int) -> None:
        self._lengths, self._seed = lengths, seed
        self._first = np.cumsum(lengths) - lengths

    def weights(self, mission: int, part: str) -> Floats:
        """1 for the samples of a mission that are in `train`, `validation` or `test`, else 0.

        A mission's numbers are drawn from its own place in the seed's sequence of numbers.
        """
        bits = np.random.PCG64(self._seed)
        bits.advance(int(self._first[mission]))
        draws = np.random.Generator(bits).random(int(self._lengths[mission]))
        low, high = DIVISION_EDGES[part]
        return ((draws >= low) & (draws < high)).astype(np.float32)
