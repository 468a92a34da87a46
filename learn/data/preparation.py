"""Preparation: from a store to the sequences that one network is trained and validated on."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import (
    TARGETS,
    Mirror,
    Mission,
    Sequences,
    any_channel,
    load_missions,
    sample_split,
)
from learn.data.labels import (
    NO_CURRENT,
    STORE_CURRENT,
    LabelConfig,
    LabelCounts,
    count_labels,
    measured,
)
from learn.data.logs import SPEED
from learn.data.normalisation import Normalisation, fit_normalisation
from learn.data.parts import parts_of
from twin.errors import InputError, StoreError, unknown_name
from twin.navigation.features import channels_of, mirror_signs
from twin.records.attributes import SPLIT
from twin.records.reader import MissionStore
from twin.records.store_path import StorePath

Division = Literal["missions", "samples"]

TRUTH = LabelConfig()

TARGET_SIGNS = {"surge": 1.0, "sway": -1.0}
"""What the mirror port to starboard makes of the velocities."""


@dataclasses.dataclass(frozen=True)
class Prepared:
    """Normalised data of one target."""

    train: Sequences
    validation: Sequences
    normalisation: Normalisation
    period: float
    """[s] between samples"""


def prepare(
    store: str | StorePath,
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
) -> Prepared:
    """Training and validation data of one velocity.

    Args:
      store: path of the store.
      target: surge or sway.
      features: names of the inputs, in order.
      division: `missions` uses the store's split. `samples` is the paper's random 70/15/15
        division over samples of all missions; it leaks (see `sample_split`).
      seed: of the division by samples.
      mirror: let the training show every mission mirrored port to starboard too.
      period: [s] between samples, see `load_missions`.
      scales: of a network whose training goes on; fitted to the data without.
      held_out: rows of the store that are neither trained nor validated on. With any, the store's
        split is not asked: of the other rows every fourth validates, the rest train.
      labels: what is learned, the truth or what a Doppler log measured.

    Raises:
      InputError: an unknown target or division; a part of the vehicle that has no mirror image.
      StoreError: see `load_missions`; or a split has no missions.
    """
    if target not in TARGETS:
        raise InputError(unknown_name("target", target, TARGETS))
    signs = mirror_signs(features, parts_of(store)) if mirror else None
    own = [TARGETS[target], *_speed(store)] if labels.source == "truth" else labels.channels()
    channels = [*channels_of(features), *own]
    if division == "missions":
        missions = load_missions(store, channels, split="all", period=period)
        missions = _labelled(missions, target, store, labels)
        if held_out:
            missions = _held_out(missions, held_out, store)
        train = [m for m in missions if m.split == "train"]
        validation = [m for m in missions if m.split == "validation"]
        if not train:
            raise StoreError(
                f"store {store} has no missions for training; it needs a split into train, "
                "validation and test, as `factory generate` makes"
            )
        return _assemble(train, validation, features, target, None, signs, scales, labels)
    if division == "samples":
        missions = load_missions(store, channels, split="all", period=period)
        missions = _labelled(missions, target, store, labels)
        weights = sample_split([m.samples for m in missions], seed)
        return _assemble(missions, missions, features, target, weights, signs, scales, labels)
    raise InputError(unknown_name("division", division, ("missions", "samples")))


VALIDATING = 4
"""Of the rows that are not held out, every so many-th validates."""


def _speed(store: str | StorePath) -> list[str]:
    """The channel of a log's speed through the water, where it has one."""
    with MissionStore(store) as reader:
        return [SPEED] if reader.logged and SPEED in reader else []


def _labelled(
    missions: list[Mission], target: str, store: str | StorePath, labels: LabelConfig
) -> list[Mission]:
    """Missions that say something about a target; the truth of a simulated store always does."""
    certain = labels.source == "truth"
    kept = [
        m
        for m in missions
        if (certain and m.row is None) or np.isfinite(labels.of(m, target)).any()
    ]
    if not kept and labels.source == "dvl":
        raise _no_doppler_labels(store, target, count_labels(missions, labels))
    if not kept:
        raise _no_truth(store, target)
    return kept


def _no_doppler_labels(store: str | StorePath, target: str, counts: LabelCounts) -> StoreError:
    """The log had no lock, or bottom lock without a known current."""
    nothing = f"store {store} has no sample to learn {target} from: its Doppler log never had"
    with MissionStore(store) as reader:
        otherwise = "" if reader.logged else "; or learn from the truth with --labels truth"
    if not counts.bottom:
        return StoreError(f"{nothing} lock{otherwise}")
    share = 100.0 * counts.bottom / counts.samples
    return StoreError(
        f"{nothing} water lock, and no current is known to take off what it measured over ground "
        f"(bottom lock in {share:.3g} % of the samples). {_which_current(store)}{otherwise}"
    )


def _which_current(store: str | StorePath) -> str:
    """What --known-current can be where there is bottom track alone."""
    with MissionStore(store) as reader:
        simulated = not reader.logged and all(name in reader for name in STORE_CURRENT)
    if not simulated:
        return (
            "Give --known-current NORTH,EAST in m/s, 0,0 in still water; or take a log with water "
            "lock"
        )
    highest = max(
        float(np.hypot(*(mission.signals[name] for name in STORE_CURRENT)).max())
        for mission in load_missions(store, STORE_CURRENT)
    )
    if highest == 0.0:
        return "The water of this store stands still: give --known-current 0,0"
    return (
        f"Its missions have currents of their own, of up to {highest:.2g} m/s: give "
        "--known-current store, which takes what the simulation knows of each and no vehicle knows "
        "at sea; or take a store whose water stands still (--preset paper of a vehicle with a "
        "propeller, or --set current.speed=0) and give --known-current 0,0; or one with water "
        "lock, which needs none"
    )


def _no_truth(store: str | StorePath, target: str) -> StoreError:
    return StoreError(
        f"store {store} has no truth to learn {target} from (neither {TARGETS[target]} nor "
        f"{SPEED}); a run that is trained on another store can be judged on it: "
        f"`learn evaluate RUN {store}`"
    )


def check_truth(store: str | StorePath) -> None:
    """Refuse logs that have no array of truth, before their signals are read.

    Raises:
      StoreError: see `prepare`.
    """
    with MissionStore(store) as reader:
        if reader.logged:
            for target, channel in TARGETS.items():
                if channel not in reader and SPEED not in reader:
                    raise _no_truth(store, target)


def labels_in(
    store: str | StorePath,
    labels: LabelConfig,
    *,
    division: Division = "missions",
    period: float | None = None,
) -> LabelCounts:
    """What the Doppler logs of the missions that are trained on and validated give.

    Raises:
      StoreError: those for training give nothing; or see `load_missions`.
    """
    missions = load_missions(store, labels.channels(), split="all", period=period)
    learned = missions
    if division == "missions":
        missions = [m for m in missions if m.split in ("train", "validation")]
        learned = [m for m in missions if m.split == "train"]
    if learned and not any(measured(m, labels).usable.any() for m in learned):
        raise _no_doppler_labels(store, " or ".join(TARGETS), count_labels(learned, labels))
    return count_labels(missions, labels)


FEW_LABELS = 0.1
"""With labels in a smaller part of the samples, networks see little of how the vehicle moves."""


def few_labels(store: str | StorePath, labels: LabelConfig, counts: LabelCounts) -> str | None:
    """A warning where bottom track is left out and little else is there, else None."""
    if labels.known_current != NO_CURRENT or counts.used >= FEW_LABELS * counts.samples:
        return None
    if counts.bottom <= counts.water:
        return None
    return (
        f"store {store} has labels in {counts.used} of {counts.samples} samples alone: the Doppler "
        "log mostly measured over ground, and no current is known to take off that (bottom lock in "
        f"{100.0 * counts.bottom / counts.samples:.3g} % of the samples). {_which_current(store)}"
    )


def few_missions(store: str | StorePath, division: Division = "missions") -> str | None:
    """A warning where all that is learned comes from a single mission, else None.

    Raises:
      StoreError: the store's split cannot be read.
    """
    with MissionStore(store) as reader:
        rows = list(range(len(reader)))
        if division == "missions" and SPLIT in reader:
            rows = [row for row in rows if reader.splits[row] == "train"]
        noun = "row" if reader.logged else "mission"
    if len(rows) != 1:
        return None
    return (
        f"store {store} has one {noun} for training ({noun} {rows[0]}): what the networks learn "
        f"holds for its water and its manoeuvres; take a store of more {noun}s"
    )


def check_window(
    store: str | StorePath,
    window: int,
    *,
    division: Division = "missions",
    period: float | None = None,
) -> None:
    """Refuse a window of samples that no training mission fills.

    Raises:
      InputError: it is longer than the longest of them.
      StoreError: see `load_missions`.
    """
    missions = load_missions(store, any_channel(store), split="all", period=period)
    if division == "missions":
        missions = [m for m in missions if m.split == "train"]
    longest = max(missions, key=lambda m: m.samples, default=None)
    if longest is not None and window > longest.samples:
        raise InputError(
            f"--window {window} is longer than every training mission of {store}: the longest, "
            f"mission {longest.index}, has {longest.samples} samples"
        )


def _held_out(
    missions: list[Mission], held_out: Sequence[int], store: str | StorePath
) -> list[Mission]:
    left = [m for m in missions if m.index not in set(held_out)]
    if len(left) < 2:
        raise StoreError(f"store {store}: without rows {list(held_out)} fewer than two are left")
    return [
        dataclasses.replace(m, split="validation" if k % VALIDATING == 1 else "train")
        for k, m in enumerate(left)
    ]


def _assemble(
    train: list[Mission],
    validation: list[Mission],
    features: Sequence[str],
    target: str,
    weights: list[list[NDArray[np.float32]]] | None,
    signs: NDArray[np.float32] | None,
    scales: Normalisation | None,
    labels: LabelConfig,
) -> Prepared:
    matrices = [m.features(features) for m in train]
    targets = [labels.of(m, target) for m in train]
    image = None if signs is None else Mirror(signs, TARGET_SIGNS[target])
    centred = [] if signs is None else [n for n, s in zip(features, signs, strict=True) if s < 0]
    if signs is not None and TARGET_SIGNS[target] < 0:
        centred.append(target)
    known = [values[np.isfinite(values)] for values in targets]
    normalisation = scales or fit_normalisation(
        matrices, known, features=features, target=target, centred=centred
    )

    def sequences(
        inputs: list[NDArray[np.float32]],
        wanted: list[NDArray[np.float32]],
        counted: list[NDArray[np.float32]] | None,
    ) -> Sequences:
        shift, scale = normalisation.target_mean, normalisation.target_scale
        return Sequences(
            [normalisation.inputs(values) for values in inputs],
            [
                np.nan_to_num((values - np.float32(shift)) / np.float32(scale), nan=0.0)
                for values in wanted
            ],
            [
                weight * np.isfinite(values).astype(np.float32)
                for weight, values in zip(
                    counted or [np.ones(len(values), np.float32) for values in wanted],
                    wanted,
                    strict=True,
                )
            ],
            image,
        )

    if validation is train or weights is not None:
        assert weights is not None
        return Prepared(
            sequences(matrices, targets, weights[0]),
            sequences(matrices, targets, weights[1]),
            normalisation,
            train[0].period,
        )
    return Prepared(
        sequences(matrices, targets, None),
        sequences(
            [m.features(features) for m in validation],
            [labels.of(m, target) for m in validation],
            None,
        ),
        normalisation,
        train[0].period,
    )
