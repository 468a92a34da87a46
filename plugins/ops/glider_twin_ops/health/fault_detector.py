"""Fault detector learned from labelled deployments, a rival of `assess`.

    detector = FaultDetector.fit(values, kinds, onsets, seed=0)
    odds, named = detector.judge(values[0])

The detector reads the same channels and no physics. The inputs of its network, which has one hidden
layer, are the differences of each channel's last dives from all before. Its outputs, after each
dive, are the scores of every kind of fault and of none.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import torch

from glider_twin_ops.health.judgement import NONE, follow
from twin.errors import InputError
from twin.numbers import Array

LAST = (1, 3, 8)
"""Numbers of last dives whose mean is compared with the mean of all dives before"""
FIRST = 4
"""Number of first dives that are not judged"""
FARTHEST = 8.0
"""Standard deviations at which a feature is clipped: a network does not extrapolate"""
UNTOLD = 3
"""Dives from the onset on that are left out of training, since a new fault is not yet visible"""
HIDDEN, STEPS, RATE, DECAY, DROPPED = 64, 400, 3e-3, 3e-3, 0.2
"""HIDDEN: number of hidden units. STEPS: of AdamW over all dives. RATE: learning rate. DECAY:
weight decay. DROPPED: dropout of inputs"""


@dataclasses.dataclass(frozen=True, eq=False)
class FaultDetector:
    """Trained detector."""

    kinds: tuple[str, ...]
    """Classes; the first means no fault"""
    network: torch.nn.Module
    """(dives, features) to scores (dives, kinds)"""

    @classmethod
    def fit(
        cls,
        values: Sequence[Array],
        kinds: Sequence[str],
        onsets: Sequence[int | None],
        *,
        seed: int = 0,
    ) -> FaultDetector:
        """Train on deployments; equal seeds give equal detectors.

        Args:
          values: channels of each deployment as `CHANNELS` has them, (dives, channels).
          kinds: kind of each deployment's fault, `none` without one.
          onsets: index of the first dive with the fault; None without one.

        Raises:
          InputError: there are no sound deployments, or none with a fault.
        """
        names = (NONE, *sorted(set(kinds) - {NONE}))
        if len(names) < 2 or NONE not in kinds:
            raise InputError("a detector learns from deployments with a fault and sound ones")
        inputs, labels = [], []
        for one, kind, onset in zip(values, kinds, onsets, strict=True):
            told = features(one)
            label = np.full(len(told), names.index(NONE))
            if onset is not None:
                label[onset:] = names.index(kind)
                label[onset : onset + UNTOLD] = -1
            label[:FIRST] = -1
            inputs.append(told[label >= 0])
            labels.append(label[label >= 0])
        x = torch.tensor(np.concatenate(inputs), dtype=torch.float32)
        y = torch.tensor(np.concatenate(labels))
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            network = torch.nn.Sequential(
                torch.nn.Dropout(DROPPED),
                torch.nn.Linear(x.shape[1], HIDDEN),
                torch.nn.Tanh(),
                torch.nn.Linear(HIDDEN, len(names)),
            )
            optimiser = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
            network.train()
            for _ in range(STEPS):
                optimiser.zero_grad()
                loss = torch.nn.functional.cross_entropy(network(x), y)
                loss.backward()
                optimiser.step()
        return cls(names, network.eval())

    def judge(self, values: Array) -> tuple[Array, list[str]]:
        """Judge a deployment after each of its dives.

        Args:
          values: channels of its dives, (dives, channels).

        Returns:
          log odds of a fault, (dives,), -inf in the first dives; the likeliest kind of each.
        """
        with torch.no_grad():
            scores = self.network(torch.tensor(features(values), dtype=torch.float32)).double()
        odds = (torch.logsumexp(scores[:, 1:], 1) - scores[:, 0]).numpy()
        odds[:FIRST] = -math.inf
        return odds, [self.kinds[1 + int(k)] for k in scores[:, 1:].argmax(1)]


def features(values: Array) -> Array:
    """Inputs of the network after each dive: (dives, channels x (len(LAST) + 1)).

    Means of the last dives less the mean of the dives before, over the standard deviation of that
    difference by the channel's noise so far; and whether the channel is present.
    """
    levels = follow(values)
    spread = np.sqrt(levels.expected)
    known = np.isfinite(values)
    total = np.cumsum(np.where(known, values, 0.0), axis=0)
    count = np.cumsum(known, axis=0).astype(float)
    found = []
    for last in LAST:
        before, many = (np.zeros_like(total) for _ in range(2))
        before[last:], many[last:] = total[:-last], count[:-last]
        some, few = total - before, count - many
        apart = some / np.maximum(few, 1.0) - before / np.maximum(many, 1.0)
        over = spread * np.sqrt(1.0 / np.maximum(few, 1.0) + 1.0 / np.maximum(many, 1.0))
        there = (few > 0) & (many > 1)
        found.append(np.where(there, np.clip(apart / over, -FARTHEST, FARTHEST), 0.0))
    return np.concatenate([*found, known.astype(float)], axis=1)
