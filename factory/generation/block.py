"""Block: the missions of one unit of work, flown and kept.

A block's file holds every signal of its missions one after the other, without padding, compressed
as in the store: an .npz whose entries are Blosc's bytes. It lives until its shard is assembled.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numcodecs
import numpy as np
from numpy.typing import NDArray

from factory.generation.attempts import fly_mission
from factory.generation.bookkeeping import rows
from factory.generation.flown_mission import FlownMission
from factory.generation.job import Job
from factory.generation.manifest import Manifest, leave_manifest, read_manifest
from factory.recipe.recipe import versions
from twin.errors import StoreError
from twin.physics.quiet import quiet_mujoco
from twin.records.checksums import FileSum
from twin.records.sharded import COMPRESSOR, LEVEL

Signals = Mapping[str, NDArray[Any]]
"""By name: (samples,) of one mission."""
TABLE, SIGNAL, ROWS = "table", "signal.", "rows."
"""Entries of the file: JSON that says how to read the others; a signal; values of each mission."""


@dataclass(frozen=True)
class BlockDone:
    """What the task that flew a block tells."""

    number: int
    failures: tuple[int, ...]
    """attempts that each mission needed beyond one"""


def fly_block(job: Job, number: int) -> BlockDone:
    """Fly the missions of a block and keep them; a finished one is left as it is.

    Raises:
      InputError: a mission that no attempt could fly. OSError: the disk refuses.
      StoreError: another process has made the block with other bytes.
    """
    recipe, site = job.ready(), job.site
    flown: list[FlownMission] = []
    signals: list[Signals] = []
    for mission in job.layout.missions_of_block(number):
        with quiet_mujoco():  # an unstable mission is recorded with its parameters instead
            one, measured = fly_mission(recipe, mission)
        flown.append(one)
        signals.append(measured)
    data = pack(flown, signals, rows(recipe, flown))
    manifest = Manifest(
        unit=f"block {number}",
        recipe=site.recipe,
        first=flown[0].mission,
        last=flown[-1].mission,
        files={site.block(number): site.files.put(site.block(number), data)},
        failures=sum(len(one.failures) for one in flown),
        versions=versions(),
    )
    leave_manifest(site.files, site.block_manifest(number), manifest)
    return BlockDone(number, tuple(len(one.failures) for one in flown))


def block_manifest(job: Job, number: int) -> Manifest | None:
    """The manifest of a block that is finished; None when it must be flown."""
    site = job.site
    found = read_manifest(
        site.files, site.block_manifest(number), unit=f"block {number}", recipe=site.recipe
    )
    if found is None or not _all_there(job, found.files):
        return None
    return found


def _all_there(job: Job, files: Mapping[str, FileSum]) -> bool:
    return all(job.site.files.size(key) == one.bytes for key, one in files.items())


def pack(
    flown: Sequence[FlownMission],
    signals: Sequence[Signals],
    values: Mapping[str, NDArray[Any]],
) -> bytes:
    """The file of a block, the same bytes for the same missions."""
    table: dict[str, Any] = {
        "samples": [one.samples for one in flown],
        "failures": [
            [one.mission, failure.attempt, failure.reason, failure.time_s]
            for one in flown
            for failure in one.failures
        ],
        "signals": {},
    }
    entries: dict[str, NDArray[Any]] = {}
    for name in dict.fromkeys(name for one in signals for name in one):
        parts = [one[name] for one in signals if name in one]
        table["signals"][name] = {
            "dtype": parts[0].dtype.str,
            "missions": [row for row, one in enumerate(signals) if name in one],
        }
        entries[SIGNAL + name] = np.frombuffer(_blosc(parts[0].dtype).encode(np.concatenate(parts)), np.uint8)
    entries |= {ROWS + name: array for name, array in values.items()}
    entries[TABLE] = np.frombuffer(json.dumps(table).encode(), np.uint8)
    archive = io.BytesIO()
    np.savez(archive, **entries)
    return archive.getvalue()


def _blosc(dtype: np.dtype[Any]) -> numcodecs.Blosc:
    return numcodecs.Blosc(cname=COMPRESSOR, clevel=LEVEL, shuffle=numcodecs.Blosc.SHUFFLE)


class Block:
    """A finished block, read back.

    Raises:
      StoreError: its file is damaged.
    """

    def __init__(self, job: Job, manifest: Manifest):
        self.missions = manifest.missions
        (key, expected), = manifest.files.items()
        self._what = f"{job.site.files.name}/{key}"
        try:
            data = job.site.files.read(key)
            if FileSum.of(data) != expected:
                raise StoreError(f"{self._what} is damaged: its SHA-256 is another one")
            self._archive = np.load(io.BytesIO(data), allow_pickle=False)
            self._table = json.loads(self._archive[TABLE].tobytes())
        except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise StoreError(f"{self._what} is damaged ({type(error).__name__})") from error
        self.samples: list[int] = self._table["samples"]

    @property
    def signals(self) -> dict[str, np.dtype[Any]]:
        """Names and types of what its missions have."""
        return {n: np.dtype(entry["dtype"]) for n, entry in self._table["signals"].items()}

    @property
    def failures(self) -> list[tuple[int, int, str, float | None]]:
        """Mission, attempt, reason and time [s] of every attempt that failed."""
        return [(m, a, reason, time) for m, a, reason, time in self._table["failures"]]

    def rows(self) -> dict[str, NDArray[Any]]:
        """What there is one of for each mission."""
        start = len(ROWS)
        return {n[start:]: self._archive[n] for n in self._archive.files if n.startswith(ROWS)}

    def fill(self, name: str, into: NDArray[Any]) -> None:
        """Put a signal into (missions of the block, time), as far as they have it."""
        if name not in self._table["signals"]:
            return
        entry = self._table["signals"][name]
        dtype = np.dtype(entry["dtype"])
        packed = self._archive[SIGNAL + name]
        values = np.frombuffer(_blosc(dtype).decode(packed), dtype)
        start = 0
        for row in entry["missions"]:
            samples = self.samples[row]
            into[row, :samples] = values[start : start + samples]
            start += samples
