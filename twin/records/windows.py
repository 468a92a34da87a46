"""Windows: sections of missions of equal length, read fast enough for training.

A store keeps each signal of a mission as one compressed chunk, so a slice of a few samples costs
as much as the whole mission. `Windows` decodes a mission once, all signals side by side, and
copies windows out of memory. A store larger than the memory is read buffer by buffer, in an order
that mixes the store and reads each mission once an epoch.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import os
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from numbers import Integral
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError, unknown_name
from twin.records.attributes import SPLITS
from twin.records.reader import MissionStore
from twin.records.storage.sharded import fast_reading
from twin.records.storage.store_path import StorePath, store_path

Floats = NDArray[np.float32]
Missions = dict[int, Floats]
"""Decoded signals by mission, each (samples, channels)"""

MEMORY = 2.0**31
"""[byte] Largest memory that decoded missions take by default"""
Places = NDArray[np.int64]
"""Positions of missions in a list of wanted missions"""

BLOCKS = 16
"""Number of randomly chosen blocks of neighbouring missions in a buffer. Neighbours are read
together, and many blocks mix the store well."""
AT_A_TIME = 2**20
"""Number of samples of several missions that are decoded together, one signal after the other"""


class Windows:
    """Windows of a store by number: a sequence, and a data set for torch's `DataLoader`.

    `windows[k]` is (length, channels), `windows.read([3, 1])` (2, length, channels), float32 in the
    units of the store; NaN where a signal has gaps. A mission gives as many whole windows as fit.
    Each process that reads windows opens the store itself.
    """

    _open: tuple[int, MissionStore] | None
    _kept: OrderedDict[int, Floats]
    _bytes: int

    def __init__(
        self,
        store: str | StorePath,
        channels: Sequence[str],
        *,
        length: int,
        stride: int | None = None,
        split: str = "all",
        memory: float = MEMORY,
    ) -> None:
        """Find the windows; signals are read on access.

        Args:
          store: path or address of a store of missions, simulated or logged.
          channels: signals, in the order of the last axis.
          length: samples of a window.
          stride: samples from the start of a window to the start of the next; None: `length`.
          split: train, validation, test or all.
          memory: [byte] for decoded missions; the longest mission must fit.

        Raises:
          InputError: a length or stride that is no positive whole number, memory too small for
            the longest mission, or no channels.
          StoreError: no store, an unknown split or channel, or no mission as long as a window.
        """
        stride = length if stride is None else stride
        for name, value in (("length", length), ("stride", stride), ("memory", memory)):
            whole = name == "memory" or isinstance(value, Integral)
            if not (value > 0 and whole):
                must = "a number of samples" if value > 0 else "above zero"
                raise InputError(f"windows: {name} is {value:g}, it must be {must}")
        if split not in (*SPLITS, "all"):
            raise StoreError(unknown_name("split", split, [*SPLITS, "all"]))
        if isinstance(channels, str) or not channels:
            raise InputError("windows: give channels as a list, such as ['measured_pitch']")
        self.path = store_path(store)
        self.channels, self.length, self.stride = tuple(channels), length, stride
        self._memory = memory
        self._pid: int | None = os.getpid()
        self._drop_missions()
        reader = self._reader()
        known = reader.signals()
        for name in self.channels:
            if name not in known:
                raise StoreError(f"store {self.path}: {unknown_name('channel', name, known)}")
        rows = np.arange(len(reader))
        if split != "all":
            rows = rows[np.array(reader.splits) == split]
        reader.check_samples(rows)
        samples = reader.samples[rows]
        longest = int(samples.max(initial=0))
        if memory < self._sample_bytes * longest:
            raise InputError(
                f"windows: memory is {memory:g} bytes, the longest mission of {self.path} takes "
                f"{self._sample_bytes * longest}; give memory for two, or fewer channels"
            )
        counts = np.maximum((samples - length) // stride + 1, 0)
        self.period = reader.period
        """[s] Time between samples"""
        self._samples = dict(zip(rows.tolist(), samples.tolist(), strict=True))
        self.missions: NDArray[np.int64] = np.repeat(rows, counts)
        """Row in the store of each window."""
        firsts = np.arange(len(self.missions)) - np.repeat(np.cumsum(counts) - counts, counts)
        self.starts: NDArray[np.int64] = firsts * stride
        """First sample of each window in its mission."""
        if not len(self.missions):
            raise StoreError(
                f"store {self.path} has no mission of {length} samples in split {split!r}: the "
                f"longest has {longest}; take shorter windows"
            )

    def __len__(self) -> int:
        return len(self.missions)

    def __repr__(self) -> str:
        return (
            f"<Windows: {len(self)} of {self.length} samples every {self.period:g} s, "
            f"{len(self._samples)} missions of {self.path}: {', '.join(self.channels)}>"
        )

    def __getitem__(self, number: int | slice) -> Floats:
        """Read a window, (length, channels), or a slice of windows, (windows, length, channels)."""
        if isinstance(number, slice):
            return self.read(range(*number.indices(len(self))))
        if not -len(self) <= number < len(self):
            raise IndexError(f"there are {len(self)} windows, not {number}")
        window: Floats = self.read([number])[0]
        return window

    def __getitems__(self, numbers: Sequence[int]) -> Floats:
        """Read a batch for torch's `DataLoader`."""
        return self.read(numbers)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __getstate__(self) -> dict[str, Any]:
        """State for pickling, without open files and decoded missions."""
        return self.__dict__ | {"_open": None, "_kept": OrderedDict(), "_bytes": 0, "_pid": None}

    def close(self) -> None:
        """Close the store's files and drop the decoded missions."""
        if self._open is not None:
            self._open[1].close()
        self._drop_missions()

    @property
    def fits(self) -> bool:
        """True if all missions fit into the memory together."""
        return self._size(self._samples) <= self._memory

    def load(self) -> Self:
        """Decode all missions now if they fit; worker processes forked later share them.

        Raises:
          StoreError: a file is damaged.
        """
        if self.fits:
            self._keep_missions(list(self._samples))
        return self

    def read(self, numbers: Sequence[int] | NDArray[np.integer[Any]]) -> Floats:
        """Read windows by number, (numbers, length, channels).

        Raises:
          IndexError: there is no such window.
          StoreError: a file is damaged.
        """
        wanted = np.asarray(numbers, np.int64)
        missions = self.missions[wanted]
        if self.fits:
            return self._copy_windows(self._keep_missions(np.unique(missions).tolist()), wanted)
        found = np.empty((len(wanted), self.length, len(self.channels)), np.float32)
        for mission in np.unique(missions).tolist():  # each mission is decoded only once
            places = np.flatnonzero(missions == mission)
            found[places] = self._copy_windows(self._keep_missions([mission]), wanted[places])
        return found

    def _copy_windows(self, some: Missions, numbers: NDArray[np.int64]) -> Floats:
        """Copy windows by number out of decoded missions."""
        found = np.empty((len(numbers), self.length, len(self.channels)), np.float32)
        missions, starts = self.missions[numbers].tolist(), self.starts[numbers].tolist()
        for place, (mission, start) in enumerate(zip(missions, starts, strict=True)):
            found[place] = some[mission][start : start + self.length]
        return found

    def order(self, seed: int | None = None, epoch: int = 0) -> NDArray[np.int64]:
        """Order all windows, by number, for fast reading; each occurs once.

        Seed, epoch and memory decide the order. If the missions do not fit into the memory, windows
        are shuffled within buffers of random missions. Seed None keeps the store's order.
        """
        return np.concatenate(self._order(seed, epoch))

    def batches(self, size: int, *, seed: int | None = None, epoch: int = 0) -> Iterator[Floats]:
        """Yield every window once, in batches of at most `size`, (size, length, channels).

        Windows follow in the order of `order`. While one buffer is in use, the next one is read.

        Raises:
          InputError: a size below one.
          StoreError: a file is damaged.
        """
        if size < 1:
            raise InputError(f"windows: a batch of {size} is invalid; give 1 or more")
        parts = self._order(seed, epoch)
        if self.fits:
            self.load()

        def ready(part: NDArray[np.int64]) -> Missions:
            missions = np.unique(self.missions[part]).tolist()
            return self._keep_missions(missions) if self.fits else self._decoded(missions)

        with ThreadPoolExecutor(1, "windows") as reader:
            coming = reader.submit(ready, parts[0])
            for part, after in itertools.zip_longest(parts, parts[1:]):
                some = coming.result()
                if after is not None:
                    coming = reader.submit(ready, after)
                for first in range(0, len(part), size):
                    yield self._copy_windows(some, part[first : first + size])
                del some  # frees this buffer before the next read begins

    def _order(self, seed: int | None, epoch: int) -> list[NDArray[np.int64]]:
        """Order the numbers of the windows, buffer by buffer."""
        rng = None if seed is None else np.random.default_rng([seed, epoch])
        rows, counts = np.unique(self.missions, return_counts=True)
        first = np.cumsum(counts) - counts
        lengths = np.array([self._samples[row] for row in rows.tolist()])
        size = int(lengths.sum())
        if not self.fits:  # half the memory: one buffer is read while another one is in use
            size = max(int(self._memory / 2.0 / self._sample_bytes), 1)
        parts: list[Places] = buffers(lengths, size, rng)
        numbers = [
            np.concatenate([np.arange(first[k], first[k] + counts[k]) for k in part])
            for part in parts
        ]
        return numbers if rng is None else [rng.permutation(part) for part in numbers]

    @property
    def _sample_bytes(self) -> int:
        return 4 * len(self.channels)

    def _size(self, missions: Sequence[int] | dict[int, int]) -> int:
        return self._sample_bytes * sum(self._samples[mission] for mission in missions)

    def _keep_missions(self, missions: Sequence[int]) -> Missions:
        """Decode missions and keep as many as fit; the ones unused for longest are dropped first.

        Args:
          missions: numbers in rising order; a single one if not all missions of the store fit.
        """
        kept = self._kept
        missing = [mission for mission in missions if mission not in kept]
        if missing:
            self._bytes += self._size(missing)
            while kept and self._bytes > self._memory:
                gone, _ = kept.popitem(last=False)
                self._bytes -= self._size([gone])
            kept.update(self._decoded(missing))
        elif not self.fits:
            for mission in missions:
                kept.move_to_end(mission)
        return kept

    def _decoded(self, missions: Sequence[int]) -> Missions:
        """Decode missions from the store."""
        reader = self._reader()
        found = {
            mission: np.empty((self._samples[mission], len(self.channels)), np.float32)
            for mission in missions
        }
        longest = max((self._samples[mission] for mission in missions), default=1)
        step = max(AT_A_TIME // longest, 1)
        for first in range(0, len(missions), step):
            some = missions[first : first + step]
            for column, name in enumerate(self.channels):
                for mission, values in zip(some, reader.rows(name, some), strict=True):
                    found[mission][:, column] = values[: self._samples[mission]]
        return found

    def _reader(self) -> MissionStore:
        """Open the store once in each process: a fork lacks the threads that read it."""
        here = os.getpid()
        self._pid = here if self._pid is None else self._pid
        if self._open is None or self._open[0] != here:
            fast = fast_reading(self.path) if here == self._pid else contextlib.nullcontext()
            with fast:
                self._open = (here, MissionStore(self.path))
        return self._open[1]

    def _drop_missions(self) -> None:
        self._open, self._kept, self._bytes = None, OrderedDict(), 0


def buffers(
    lengths: NDArray[np.int64], size: int, rng: np.random.Generator | None = None
) -> list[Places]:
    """Group missions into buffers that are in memory together; each mission is in one buffer.

    Args:
      lengths: samples of each mission.
      size: approximate samples of a buffer; a longer mission is a buffer of its own.
      rng: samples the order of the blocks of neighbouring missions; None keeps the store's order.

    Returns:
      The missions of each buffer, in rising order.
    """
    total = int(lengths.sum())
    count = max(1, math.ceil(total / size))
    if count == 1:
        return [np.arange(len(lengths))]
    blocks = _even_parts(lengths, np.arange(len(lengths)), count * BLOCKS)
    if rng is not None:
        blocks = [blocks[k] for k in rng.permutation(len(blocks))]
    samples = np.array([lengths[block].sum() for block in blocks])
    return [
        np.sort(np.concatenate([blocks[k] for k in part]))
        for part in _even_parts(samples, np.arange(len(blocks)), count)
    ]


def _even_parts(lengths: NDArray[np.int64], items: Places, count: int) -> list[Places]:
    """Split items into at most `count` runs of about equal total length."""
    middles = np.cumsum(lengths) - lengths / 2.0
    part = np.floor(middles * (count / lengths.sum())).astype(np.int64)
    return np.split(items, np.flatnonzero(np.diff(part)) + 1)
