"""Memory: whether the training data of networks side by side stay in memory or are streamed."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from learn.data.dataset import AT_A_TIME
from learn.data.preparation import sample_bytes, training_lengths
from learn.networks.predictor import groups_by_length
from learn.training.feed import recalled_columns
from learn.training.settings import FitConfig
from twin.errors import InputError
from twin.records.storage.buffers import buffers

GB = 1e9
SHARE = 0.5
"""Of the memory that is free: the rest is for the programs, their libraries and what else runs"""
READING = 400
"""Bytes of a sample while its channels become features"""
CGROUPS = Path("/sys/fs/cgroup")


@dataclasses.dataclass(frozen=True)
class Residence:
    """Where the training data are."""

    resident: bool
    """In memory; else they are read from the store whenever they are needed"""
    told: str
    """The choice and its reason in one line"""


def choose_residence(
    configs: Sequence[FitConfig], together: int, memory: float | None = None
) -> Residence:
    """Decide for networks of which `together` are trained at a time.

    Args:
      memory: [GB] for the training data of all of them; None: half of what this machine has free.

    Raises:
      InputError: not even the buffers fit.
      StoreError: a store cannot be opened.
    """
    if memory is not None and not (np.isfinite(memory) and memory > 0.0):
        raise InputError(f"--memory {memory:g} must be a number of GB above 0")
    allowed = free_memory() * SHARE if memory is None else memory * GB
    sizes = [_sizes(config) for config in configs]
    whole, streamed = (together * max(column) for column in zip(*sizes, strict=True))
    networks = f"{together} networks at a time" if together > 1 else "one network at a time"
    limit = (
        f"{allowed / GB:.2g} GB (half of the memory that is free; --memory changes it)"
        if memory is None
        else f"the {memory:g} GB of --memory"
    )
    if whole <= allowed:
        return Residence(
            True,
            f"training data stay in memory: {whole / GB:.2g} GB for {networks}, within {limit}",
        )
    if streamed <= allowed:
        return Residence(
            False,
            f"training data are streamed from the store: {whole / GB:.2g} GB for {networks} exceed "
            f"{limit}; {streamed / GB:.2g} GB are in memory at once",
        )
    needed = math.ceil(streamed / GB * 1e3) / 1e3
    raise InputError(
        f"streaming the training data takes {streamed / GB:.2g} GB of memory for {networks}, more "
        f"than {limit}: give --memory {needed:g} where there is as much, fewer --workers, "
        f"or a --buffer of fewer samples than {configs[0].training.buffer}"
    )


def _sizes(config: FitConfig) -> tuple[int, int]:
    """Bytes of one network's data: all of them, and the most that streaming holds at once.

    While one buffer is trained on and the next one is read, two groups of validation missions may
    be in memory as well. What a fixed memory recalls of a buffer is there twice while it is made.
    """
    train, validation = training_lengths(
        config.store, config.division, config.period, config.held_out
    )
    lengths = train if config.division == "samples" else np.concatenate([train, validation])
    sample = sample_bytes(len(config.features))
    # the period changes what is recalled, and not how much of it
    shape = dataclasses.replace(config.network, inputs=len(config.features), period=1.0)
    recalled = 2 * recalled_columns(shape) * 4
    plan = buffers(train, config.training.buffer)
    held = max(int(train[part].sum()) for part in plan)
    judged = [int(validation[group].sum()) for group in groups_by_length(validation)]
    reading = max(AT_A_TIME, int(lengths.max())) * READING + held * recalled
    ahead = min(2, len(plan)) * held + 2 * max(judged, default=0)
    return int(lengths.sum()) * sample + reading, ahead * sample + reading


def free_memory() -> float:
    """Bytes that this process may take without another one's loss, in its container too."""
    free = [os.sysconf("SC_PHYS_PAGES") * float(os.sysconf("SC_PAGE_SIZE"))]
    text = _read(Path("/proc/meminfo"))
    free += [
        float(line.split()[1]) * 1024.0 for line in text.splitlines() if "MemAvailable" in line
    ]
    limit, used = _read(CGROUPS / "memory.max").strip(), _read(CGROUPS / "memory.current").strip()
    if limit.isdigit() and used.isdigit():
        lines = _read(CGROUPS / "memory.stat").splitlines()
        cached = sum(float(line.split()[1]) for line in lines if line.startswith("inactive_file "))
        free.append(float(limit) - float(used) + cached)
    return max(0.0, min(free))


def _read(path: Path) -> str:
    """A file of the system; empty where it has none."""
    try:
        return path.read_text()
    except OSError:
        return ""
