"""Held-back missions: they decide step by step whether a training that starts from a run goes on.

A few training missions hardly show what a network already knows. Missions of the same recipe with a
seed of their own do, and cost seconds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray

from learn.data.dataset import TARGETS, Selection
from learn.data.further import fly_further, longer, recipe_to_fly
from learn.data.sequences import Normalisation, Sequences
from learn.networks.base import build_network
from learn.networks.fixed_memory import FixedMemory
from learn.run import open_run
from learn.seams import NETWORKS
from learn.training.feed import recall
from learn.training.fit_config import FitConfig
from twin.navigation.features import channels_of, feature_matrix
from twin.navigation.flight_filter import ANY, HULLS
from twin.navigation.settings import ESTIMATED, estimate

Floats = NDArray[np.float32]

HELD_BACK = 48
"""Missions that decide: fewer do not tell a gain of a few per cent from luck"""
STEADY = "flight_steady"
EVERY_S = 4.0
"""[s] Time between the samples that decide: nearer ones are nearly equal"""


def fly_held_back(config: FitConfig, folder: Path, say: Callable[[str], None]) -> tuple[str, ...]:
    """Fly HELD_BACK missions by the stores' recipes, with the batched engine if it can.

    Returns:
      Paths of the new stores; empty if a recipe cannot be flown, as that of logs, or if the
      training has no start whose memory is fixed.
    """
    kind = NETWORKS[config.network.kind]
    if config.start is None or config.labels.source != "truth" or not issubclass(kind, FixedMemory):
        return ()
    share = -(-HELD_BACK // len(config.stores))
    recipes = []
    for store in config.stores:
        recipe = recipe_to_fly(store, lambda why: say(f"no missions are held back: {why}"))
        if recipe is None:
            return ()
        recipes.append(longer(recipe, share, seed=int(recipe.digest[8:16], 16)))
    say(f"flying {sum(len(one.plan) for one in recipes)} missions that decide on the training")
    return tuple(str(fly_further(one, folder, "held-back")) for one in recipes)


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


def kept_samples(period: float, missions: Sequence[Floats]) -> NDArray[np.int64]:
    """Indices of the samples that decide, EVERY_S apart, among those of all missions."""
    step = max(1, round(EVERY_S / period)) if period else 1
    return np.arange(0, sum(map(len, missions)), step)


@dataclasses.dataclass(frozen=True)
class HeldRows:
    """Samples of held-back missions that decide on one network, EVERY_S apart."""

    recalled: Floats
    """Fixed memory at each sample, (rows, recalled)"""
    wanted: Floats
    """Normalised target, (rows,)"""
    owner: NDArray[np.int64]
    """Number of each sample's mission, (rows,)"""

    @classmethod
    def of(cls, network: FixedMemory, inputs: Sequence[Floats], wanted: Sequence[Floats]) -> Self:
        """Rows of missions with normalised inputs (time, inputs) and targets (time,) each."""
        places = kept_samples(network.config.period, wanted)
        recalled = recall(network, Sequences(list(inputs), list(wanted), []))
        owner = np.repeat(np.arange(len(wanted)), [len(one) for one in wanted])
        kept = recalled[torch.from_numpy(places)].numpy()
        return cls(kept, np.concatenate(wanted)[places], owner[places])

    def save(self, path: Path) -> None:
        """Write the rows to a file of numpy, .npz."""
        np.savez(path, **vars(self))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read the rows that `save` wrote."""
        with np.load(path) as found:
            return cls(**found)


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
    """Rows of held-back missions with their network, whose weights may change."""

    def __init__(self, network: FixedMemory, rows: HeldRows) -> None:
        self._network, self._owner = network, rows.owner
        device = next(network.parameters()).device
        self._recalled = torch.from_numpy(rows.recalled).to(device)
        self._wanted = torch.from_numpy(rows.wanted).to(device)

    def judge(self) -> Held:
        """Errors of the network with its present weights."""
        with torch.no_grad():
            read = self._network.read_apart(self._recalled)[:, 0]
            off = (read - self._wanted).double().cpu().numpy()
        counts = np.bincount(self._owner)
        means = np.bincount(self._owner, off)[counts > 0] / counts[counts > 0]
        return Held(float(np.square(off).mean()), float(np.square(means).mean()))


LEAST_GAIN = 0.98
"""[1] Ratio of root mean squared lasting errors below which another prior of the hulls is taken"""


class HeldMissions:
    """Held-back missions as `HeldRows` of each network, by the flight filter's prior of hulls.

    Tried are the start's own and ANY: a narrower one wins on clean hulls and loses on fouled ones.
    """

    def __init__(self, config: FitConfig, stores: Sequence[str], *, fresh: bool) -> None:
        """Read the missions of `fly_held_back`; errors as in `Selection`.

        Args:
          fresh: False leaves out other priors than that of `config`, as for a resumed training.
        """
        assert config.start is not None
        self._config = config
        reads = bool(set(channels_of(config.features)) & set(ESTIMATED))
        self._tried = tuple(dict.fromkeys((config.hulls, *([ANY] if fresh and reads else []))))
        self._velocities: dict[str, list[Floats]] = {name: [] for name in TARGETS}
        self._inputs: dict[str, list[Floats]] = {name: [] for name in self._tried}
        for store in stores:
            self._read(store)
        start = open_run(config.start).networks(plain=False)
        self._starts = {
            job.name: start[job.target].members[job.member % len(start[job.target].members)]
            for job in config.jobs()
        }
        self._rows: dict[tuple[str, Normalisation], HeldRows] = {}

    def _read(self, store: str) -> None:
        config, (own, *others) = self._config, self._tried
        wanted = [*channels_of(config.features), *TARGETS.values()]
        with Selection(store, wanted, period=config.period, spread=HULLS[own]) as selection:
            self._period = selection.period
            for one in selection.each():
                for name in TARGETS:
                    self._velocities[name].append(one.target(name))
                self._inputs[own].append(one.features(config.features))
                for name in others:
                    assert selection.vehicle is not None  # estimated channels are read
                    signals = {**one.signals, **estimate(
                        one.signals, selection.vehicle, one.period, mission=one.index,
                        spread=HULLS[name],
                    )}  # fmt: skip
                    self._inputs[name].append(
                        feature_matrix(signals, config.features, one.period, one.index)
                    )

    def _network(self, job: str) -> FixedMemory:
        first = self._starts[job].network
        network = build_network(dataclasses.replace(first.config, period=self._period))
        network.load_state_dict(first.state_dict())
        assert isinstance(network, FixedMemory)
        return network

    def rows(self, job: str, hulls: str) -> HeldRows:
        """Rows of one network; networks of equal input scales share the memory's array."""
        scales = self._starts[job].normalisation
        if (hulls, scales) in self._rows:
            return self._rows[hulls, scales]
        wanted = [scales.wanted(one) for one in self._velocities[scales.target]]
        for (known, other), rows in self._rows.items():
            if (known, other.mean, other.scale) == (hulls, scales.mean, scales.scale):
                target = np.concatenate(wanted)[kept_samples(self._period, wanted)]
                found = dataclasses.replace(rows, wanted=target)
                break
        else:
            inputs = [scales.inputs(one) for one in self._inputs[hulls]]
            found = HeldRows.of(self._network(job), inputs, wanted)
        self._rows[hulls, scales] = found
        return found

    def choose_hulls(self, say: Callable[[str], None]) -> str:
        """Choose the flight filter's prior of the hulls by the start's surge.

        Args:
          say: called with the start's error, the first figure of a fit.

        Returns:
          A key of `twin.navigation.flight_filter.HULLS`; the start's own unless another gains.
        """
        (first, *_) = (job.name for job in self._config.jobs() if job.target == "surge")
        network, scale = self._network(first), self._starts[first].normalisation.target_scale
        found = {n: HeldBack(network, self.rows(first, n)).judge() for n in self._tried}
        own = found[self._config.hulls]
        say(
            f"the start's surge is off by {1e3 * scale * own.mse**0.5:.2g} mm/s in root mean square"
            f" on held-back missions, by {1e3 * scale * own.bias**0.5:.2g} mm/s in a mission's mean"
        )
        best = min(found, key=lambda name: found[name].bias)
        gains = found[best].bias ** 0.5 < LEAST_GAIN * own.bias**0.5
        return best if gains else self._config.hulls
