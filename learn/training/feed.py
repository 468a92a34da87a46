"""Feed: the samples of missions that a training uses at one step.

A network with trained memory gets windows: sections of missions. Uncounted samples before a window
warm up the network's state. A network with fixed memory gets single samples in any order, since its
memory at each sample is computed once.
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
"""Windows per group in a full-batch step."""
RECALLED = 32
"""Missions whose fixed memory is computed together."""
SAMPLES = 16384
"""Single samples per group in a full-batch step."""


class Feed(abc.ABC):
    """Groups of samples for one step each, and the network's error on a group."""

    @abc.abstractmethod
    def epoch(self, rng: np.random.Generator) -> list[Any]:
        """Groups that contain every sample once, in random order."""

    @abc.abstractmethod
    def everything(self) -> list[Any]:
        """Groups that contain all samples, and all mirror images if missions are mirrored."""

    @abc.abstractmethod
    def squared_error(self, group: Any) -> tuple[Tensor, float]:
        """Sum of the network's squared errors over the counted samples of a group, and the number
        of these samples."""


def feed_for(network: Network, sequences: Sequences, config: TrainingConfig) -> Feed:
    """Choose the feed for a network; the network must be on its device already."""
    kind = SampleFeed if isinstance(network, FixedMemory) else WindowFeed
    return kind(network, sequences, config)


def recalled_columns(config: NetworkConfig) -> int:
    """Number of values in a fixed memory at one sample; 0 for other networks."""
    with torch.random.fork_rng(devices=[]):
        network = build_network(config)
    if not isinstance(network, FixedMemory):
        return 0
    with torch.no_grad():
        sample = torch.zeros(1, 1, config.inputs)
        return int(network.recall(sample, network.initial_state(1))[0].shape[-1])


@dataclasses.dataclass
class WindowFeed(Feed):
    """Feed of windows of missions, see `learn.data.sequences.cut_windows`."""

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
    """Indices of samples, and True for those to mirror."""

    places: NDArray[np.int64]
    mirrored: NDArray[np.bool_] | None


class SampleFeed(Feed):
    """Feed of single samples of all missions, with the fixed memory at each sample."""

    def __init__(self, network: Network, sequences: Sequences, config: TrainingConfig) -> None:
        assert isinstance(network, FixedMemory)
        self.network, self.config = network, config
        device = next(network.parameters()).device
        counted = np.concatenate(sequences.weights) > 0.0
        self._recalled = recall(network, sequences)[torch.from_numpy(counted)].to(device)
        self._wanted = torch.from_numpy(np.concatenate(sequences.targets)[counted]).to(device)
        self._image: tuple[Tensor, float] | None = None
        """Signs of memory and target in the mirror image; None if missions are not mirrored."""
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


def recall(network: FixedMemory, sequences: Sequences) -> Tensor:
    """Fixed memory at every sample, (samples, recalled), mission by mission."""
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
