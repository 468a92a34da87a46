"""Preparation: from a store to the sequences that one network is trained and validated on."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from learn.dataset import TARGETS, Mirror, Mission, Sequences, load_missions, sample_split
from learn.features import FEATURES, Normalisation, channels_of, fit_normalisation, mirror_signs
from twin.errors import InputError, StoreError, unknown_name

Division = Literal["missions", "samples"]

TARGET_SIGNS = {"surge": 1.0, "sway": -1.0}
"""What the mirror port to starboard makes of the velocities."""


@dataclasses.dataclass(frozen=True)
class Prepared:
    """Normalised data of one target."""

    train: Sequences
    validation: Sequences
    normalisation: Normalisation


def prepare(
    store: str | Path,
    *,
    target: str,
    features: Sequence[str],
    division: Division = "missions",
    seed: int = 0,
    mirror: bool = True,
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

    Raises:
      InputError: an unknown target or division.
      StoreError: see `load_missions`; or a split has no missions.
    """
    if target not in TARGETS:
        raise InputError(unknown_name("target", target, TARGETS))
    channels = [*channels_of(features), TARGETS[target]]
    if division == "missions":
        missions = load_missions(store, channels, split="all")
        train = [m for m in missions if m.split == "train"]
        validation = [m for m in missions if m.split == "validation"]
        if not train:
            raise StoreError(
                f"store {store} has no missions for training; it needs a split into train, "
                "validation and test, as `factory generate` makes"
            )
        return _assemble(train, validation, features, target, None, mirror)
    if division == "samples":
        missions = load_missions(store, channels, split="all")
        weights = sample_split([m.samples for m in missions], seed)
        return _assemble(missions, missions, features, target, weights, mirror)
    raise InputError(unknown_name("division", division, ("missions", "samples")))


def _assemble(
    train: list[Mission],
    validation: list[Mission],
    features: Sequence[str],
    target: str,
    weights: list[list[NDArray[np.float32]]] | None,
    mirror: bool,
) -> Prepared:
    matrices = [m.features(features) for m in train]
    targets = [m.target(target) for m in train]
    image = Mirror(mirror_signs(features), TARGET_SIGNS[target]) if mirror else None
    centred = [name for name in features if FEATURES[name].odd] if mirror else []
    if mirror and TARGET_SIGNS[target] < 0:
        centred.append(target)
    normalisation = fit_normalisation(
        matrices, targets, features=features, target=target, centred=centred
    )

    def sequences(
        inputs: list[NDArray[np.float32]],
        wanted: list[NDArray[np.float32]],
        counted: list[NDArray[np.float32]] | None,
    ) -> Sequences:
        shift, scale = normalisation.target_mean, normalisation.target_scale
        return Sequences(
            [normalisation.inputs(values) for values in inputs],
            [(values - np.float32(shift)) / np.float32(scale) for values in wanted],
            counted or [np.ones(len(values), np.float32) for values in wanted],
            image,
        )

    if validation is train or weights is not None:
        assert weights is not None
        return Prepared(
            sequences(matrices, targets, weights[0]),
            sequences(matrices, targets, weights[1]),
            normalisation,
        )
    return Prepared(
        sequences(matrices, targets, None),
        sequences(
            [m.features(features) for m in validation],
            [m.target(target) for m in validation],
            None,
        ),
        normalisation,
    )
