"""Held-back missions: they decide step by step whether a training that starts from a run goes on.

A few training missions hardly show what a network already knows. Missions of the same recipe with a
seed of their own do, and cost seconds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch

from learn.data.dataset import Selection, any_channel
from learn.data.further import fly_further, longer, recipe_to_fly
from learn.data.preparation import prepare
from learn.data.sequences import Normalisation, Sequences
from learn.networks.base import build_network
from learn.networks.fixed_memory import FixedMemory
from learn.run import open_run
from learn.training.feed import recall
from learn.training.fit_config import FitConfig
from twin.errors import TwinError
from twin.navigation.features import channels_of
from twin.navigation.flight_filter import HULLS
from twin.navigation.settings import ESTIMATED

HELD_BACK = 48
"""Missions that decide: fewer do not tell a gain of a few per cent from luck"""
STEADY = "flight_steady"
EVERY_S = 4.0
"""[s] Time between the samples that decide: nearer ones are nearly equal"""


def fly_held_back(config: FitConfig, folder: Path, say: Callable[[str], None]) -> tuple[str, ...]:
    """Fly HELD_BACK missions by the stores' recipes, with the batched engine if it can.

    Returns:
      Paths of the new stores; empty if a recipe cannot be flown, as that of logs.
    """
    share = -(-HELD_BACK // len(config.stores))
    recipes = []
    for store in config.stores:
        recipe = recipe_to_fly(store, lambda why: say(f"no missions are held back: {why}"))
        if recipe is None:
            return ()
        seed = int(recipe.digest[8:16], 16)
        try:
            recipes.append(longer(recipe, share, seed=seed, engine="lanes"))
        except TwinError:  # a vehicle that the batched engine cannot fly
            recipes.append(longer(recipe, share, seed=seed))
    say(f"flying {sum(len(one.plan) for one in recipes)} missions that decide on the training")
    return tuple(str(fly_further(one, folder, "held-back")) for one in recipes)


def held_sequences(
    config: FitConfig, target: str, stores: Sequence[str], scales: Normalisation
) -> Sequences:
    """Sequences of the held-back missions of `stores`; errors as in `prepare`."""
    with prepare(
        stores, target=target, features=config.features, mirror=False, period=config.period,
        scales=scales, spread=HULLS[config.hulls],
    ) as data:  # fmt: skip
        parts = [part.take(range(len(part.lengths))) for part in (data.train, data.validation)]
    inputs, targets, weights = (
        [*getattr(parts[0], name), *getattr(parts[1], name)]
        for name in ("inputs", "targets", "weights")
    )
    return Sequences(inputs, targets, weights)


def filter_kept(sequences: Sequences, scales: Normalisation) -> Sequences:
    """Sequences whose targets in steady glides are the flight filter's own output.

    There the filter's error belongs to the hull and its sensors: networks would learn the few
    training hulls by heart. Without the features `flight_steady` and the filter's velocity, the
    sequences return as they are.
    """
    names = (STEADY, f"flight_{scales.target}")
    if not set(names) <= set(scales.features):
        return sequences
    steady, filtered = (scales.features.index(name) for name in names)
    targets = []
    for inputs, target in zip(sequences.inputs, sequences.targets, strict=True):
        glides = inputs[:, steady] * scales.scale[steady] + scales.mean[steady] > 0.5
        own = inputs[:, filtered] * scales.scale[filtered] + scales.mean[filtered]
        targets.append(np.where(glides, scales.wanted(own.astype(np.float32)), target))
    return dataclasses.replace(sequences, targets=targets)


@dataclasses.dataclass(frozen=True)
class Held:
    """Errors of a network on held-back missions, in units of the normalised target."""

    mse: float
    """Mean squared error over the samples"""
    bias: float
    """Mean over the missions of the squared mean error, which dead reckoning adds up"""

    def better(self, other: Held) -> bool:
        """True if neither error is larger than another's, and one is smaller."""
        return self.mse <= other.mse and self.bias <= other.bias and self != other


class HeldBack:
    """Held-back missions with the fixed memory of a network, whose weights may change."""

    def __init__(self, network: FixedMemory, sequences: Sequences) -> None:
        self._network = network
        every = max(1, round(EVERY_S / network.config.period)) if network.config.period else 1
        places = np.arange(sequences.samples)
        owner = np.repeat(np.arange(len(sequences.lengths)), sequences.lengths)
        kept = (places % every == 0) & (np.concatenate(sequences.weights) > 0.0)
        self._recalled = recall(network, sequences)[torch.from_numpy(kept)]
        self._wanted = torch.from_numpy(np.concatenate(sequences.targets)[kept])
        self._owner = owner[kept]

    def judge(self) -> Held:
        """Errors of the network with its present weights."""
        with torch.no_grad():
            off = (self._network.read(self._recalled)[:, 0] - self._wanted).double().numpy()
        counts = np.bincount(self._owner)
        means = np.bincount(self._owner, off)[counts > 0] / counts[counts > 0]
        return Held(float(np.square(off).mean()), float(np.square(means).mean()))


LEAST_GAIN = 0.98
"""[1] Ratio of root mean squared lasting errors below which another prior of the hulls is taken"""


def choose_hulls(config: FitConfig, stores: Sequence[str], say: Callable[[str], None]) -> str:
    """Choose the flight filter's prior of the hulls by the start's surge on held-back missions.

    Args:
      stores: stores of `fly_held_back`.
      say: called with the start's error, the first figure of a fit.

    Returns:
      A key of `twin.navigation.flight_filter.HULLS`; the start's own unless another gains.
    """
    assert config.start is not None
    (first, *_) = open_run(config.start).networks(plain=False)["surge"].members
    network, scale = first.network, first.normalisation.target_scale
    if not isinstance(network, FixedMemory):
        return config.hulls
    network = build_network(dataclasses.replace(network.config, period=_period(config)))
    network.load_state_dict(first.network.state_dict())
    assert isinstance(network, FixedMemory)
    tried = {config.hulls: config}
    if set(channels_of(config.features)) & set(ESTIMATED):
        tried |= {name: dataclasses.replace(config, hulls=name) for name in HULLS}
    found = {
        name: HeldBack(network, held_sequences(one, "surge", stores, first.normalisation)).judge()
        for name, one in tried.items()
    }
    own = found[config.hulls]
    say(
        f"the start's surge is off by {1e3 * scale * own.mse**0.5:.2g} mm/s in root mean square on "
        f"held-back missions, by {1e3 * scale * own.bias**0.5:.2g} mm/s in a mission's mean"
    )
    best = min(found, key=lambda name: found[name].bias)
    return best if found[best].bias ** 0.5 < LEAST_GAIN * own.bias**0.5 else config.hulls


def _period(config: FitConfig) -> float:
    with Selection(config.store, any_channel(config.store), period=config.period) as selection:
        return float(selection.period)
