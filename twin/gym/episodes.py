"""Episodes: which random numbers an episode has, the same for one vehicle and for many."""

from __future__ import annotations

import numpy as np

LARGEST_SEED = 2**31


def episode_random(seed: int, episode: int) -> np.random.RandomState:
    """The random numbers of the `episode`-th reset after `seed`, which depend on nothing else."""
    sequence = np.random.SeedSequence(seed, spawn_key=(episode,))
    return np.random.RandomState(np.random.PCG64(sequence))
