"""Feeds: what a training sees of its missions at one step.

A network with trained memory is shown windows: pieces of missions that start some samples early
(wash-in, not counted), so that it has found its state when counting begins. One whose memory has no
weights is shown single samples in any order: what it recalls at each is worked out once.
"""

from __future__ import annotations

import abc
import dataclasses
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learn.data.sequences import Sequences, batches, cut_windows, pack_windows
from learn.networks.base import Network, NetworkConfig, build_network
from learn.networks.fixed_memory import FixedMemory
from learn.training.optimiser import TrainingConfig

SIDE_BY_SIDE = 64
"""Windows of one piece of the error over all samples."""
RECALLED = 32
"""Missions whose memory is worked out at once."""
SAMPLES = 16384
"""Samples of one piece of the error over all samples."""


class Feed(abc.ABC):
    """Groups of what is shown at one step, and the error on one of them."""

    @abc.abstractmethod
    def epoch(self, rng: np.random.Generator) -> list[Any]:
        """Groups that show every sample once, in random order."""

    @abc.abstractmethod
    def everything(self) -> list[Any]:
        """Groups that together are all samples, and their mirror images where these are shown."""

    @abc.abstractmethod
    def squared_error(self, group: Any) -> tuple[Tensor, float]:
        """Sum of the squared errors of the network over the counted samples of a group, and how
        many count."""


def feed_for(network: Network, sequences: Sequences, config: TrainingConfig) -> Feed:
    """The feed that suits a network; the network must be on its device already."""
    kind = SampleFeed if isinstance(network, FixedMemory) else WindowFeed
    return kind(network, sequences, config)


def recalled_columns(config: NetworkConfig) -> int:
    """What a fixed memory recalls at a sample, in numbers; none of another network."""
    with torch.random.fork_rng(devices=[]):
        network = build_network(config)
    if not isinstance(network, FixedMemory):
        return 0
    with torch.no_grad():
        sample = torch.zeros(1, 1, config.inputs)
        return int(network.recall(sample, network.initial_state(1))[0].shape[-1])


@dataclasses.dataclass
class WindowFeed(Feed):
    """Windows of missions, see `learn.data.sequences.cut_windows`."""

    network: Network
    sequences: Sequences
    config: TrainingConfig

    def epoch(self, rng: np.random.Generator) -> list[Any]:
        """See `Feed`."""
        windows = cut_windows(
            self.sequences.lengths,
            length=self.config.window,
            washin=self.config.washin,
            rng=rng,
            mirror=self.sequences.mirror is not None,
        )
        return list(batches(windows, self.config.batch, rng))

    def everything(self) -> list[Any]:
        """See `Feed`."""
        windows = cut_windows(
            self.sequences.lengths,
            length=self.config.full_window,
            washin=self.config.washin,
            mirror=self.sequences.mirror is not None,
        )
        return list(batches(windows, SIDE_BY_SIDE))

    def squared_error(self, group: Any) -> tuple[Tensor, float]:
        """See `Feed`."""
        x, y, w = pack_windows(self.sequences, group)
        weight = float(w.sum())
        device = next(self.network.parameters()).device
        inputs, wanted, counted = (torch.from_numpy(a).to(device) for a in (x, y, w))
        output = self.network(inputs)[0][..., 0]
        return (counted * (output - wanted).square()).sum(), weight


@dataclasses.dataclass(frozen=True)
class _Samples:
    """Places of samples, and which of them are shown as their mirror images."""

    places: NDArray[np.int64]
    mirrored: NDArray[np.bool_] | None


class SampleFeed(Feed):
    """Single samples of all missions with what a fixed memory recalls at each."""

    def __init__(self, network: Network, sequences: Sequences, config: TrainingConfig) -> None:
        assert isinstance(network, FixedMemory)
        self.network, self.config = network, config
        device = next(network.parameters()).device
        counted = np.concatenate(sequences.weights) > 0.0
        self._recalled = _recall(network, sequences)[torch.from_numpy(counted)].to(device)
        self._wanted = torch.from_numpy(np.concatenate(sequences.targets)[counted]).to(device)
        self._image: tuple[Tensor, float] | None = None
        """Signs of what is recalled, and of the target."""
        if sequences.mirror is not None:
            signs = network.mirrored(torch.from_numpy(sequences.mirror.inputs).to(device))
            self._image = signs, float(sequences.mirror.target)

    def epoch(self, rng: np.random.Generator) -> list[Any]:
        """See `Feed`."""
        count = len(self._wanted)
        order = rng.permutation(count)
        turned = None if self._image is None else rng.integers(0, 2, count).astype(bool)
        return _pieces(order, turned, self.config.samples)

    def everything(self) -> list[Any]:
        """See `Feed`."""
        places = np.arange(len(self._wanted))
        groups = _pieces(places, None, SAMPLES)
        if self._image is not None:
            groups += _pieces(places, np.ones(len(places), bool), SAMPLES)
        return groups

    def squared_error(self, group: Any) -> tuple[Tensor, float]:
        """See `Feed`."""
        places = torch.from_numpy(group.places).to(self._wanted.device)
        recalled, wanted = self._recalled[places], self._wanted[places]
        if group.mirrored is not None and self._image is not None:
            signs, sign = self._image
            turned = torch.from_numpy(group.mirrored).to(wanted.device)
            recalled = torch.where(turned[:, None], recalled * signs, recalled)
            wanted = torch.where(turned, wanted * sign, wanted)
        output = self.network.read(recalled)[..., 0]
        return (output - wanted).square().sum(), float(len(places))


def _pieces(places: NDArray[np.int64], mirrored: NDArray[np.bool_] | None, size: int) -> list[Any]:
    return [
        _Samples(places[k : k + size], None if mirrored is None else mirrored[k : k + size])
        for k in range(0, len(places), size)
    ]


def _recall(network: FixedMemory, sequences: Sequences) -> Tensor:
    """What the memory recalls at every sample, (samples, recalled), mission by mission."""
    found: list[Tensor] = [torch.empty(0)] * len(sequences.inputs)
    order = np.argsort(-sequences.lengths, kind="stable")
    device = next(network.parameters()).device
    with torch.no_grad():
        for first in range(0, len(order), RECALLED):
            group = order[first : first + RECALLED]
            x = torch.nn.utils.rnn.pad_sequence(
                [torch.from_numpy(sequences.inputs[k]) for k in group]
            )
            recalled, _ = network.recall(x.to(device), network.initial_state(len(group)))
            for column, k in enumerate(group):
                found[k] = recalled[: len(sequences.inputs[k]), column]
        return torch.cat(found)
