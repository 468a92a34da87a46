"""Block: the missions of one unit of work, flown and kept.

A block's file holds every signal of its missions one after the other, without padding, compressed
as in the store: an .npz whose entries are Blosc's bytes. It lives until its shard is assembled.
"""

from __future__ import annotations

import io
import json
import socket
import struct
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numcodecs
import numpy as np
from numpy.typing import NDArray

from factory.generation.attempts import FailedAttempt, FlownMission, fly_missions
from factory.generation.bookkeeping import rows
from factory.generation.executors import Job, alone
from factory.generation.manifest import Manifest, all_there, leave_manifest, read_manifest
from factory.sampling.drawn_plan import samples_in
from factory.sampling.mission_water import mission_coordinates, mission_place
from factory.sampling.recipe import Recipe, versions
from twin.bounded import check_archive
from twin.errors import StoreError
from twin.physics.mujoco_model import quiet_mujoco
from twin.records.presence import RECIPE
from twin.records.storage.sharded import COMPRESSOR, LEVEL
from twin.records.storage.stored_files import file_sum

Signals = Mapping[str, NDArray[Any]]
"""By name: (samples,) of one mission."""
MOST_SAMPLES = 500_000
"""Of missions that fly together, whose logs are in memory at once: about 400 bytes each"""
BLOSC = numcodecs.Blosc(cname=COMPRESSOR, clevel=LEVEL, shuffle=numcodecs.Blosc.SHUFFLE)
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
    with alone():
        return _fly_block(job, number)


def _fly_block(job: Job, number: int) -> BlockDone:
    recipe, site = job.recipe, job.site
    if not site.files.exists(RECIPE):
        raise StoreError(
            f"{socket.gethostname()} does not see {site.files.name}: all machines that fly blocks "
            "must have --out under the same path, or use an address such as s3://bucket/name.zarr"
        )
    flown: list[FlownMission] = []
    signals: list[Signals] = []
    for missions in together(recipe, job.layout.missions_of_block(number)):
        for one, measured in fly_whole(recipe, missions):
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
        versions=versions(recipe.vehicle),
    )
    leave_manifest(site.files, site.block_manifest(number), manifest)
    return BlockDone(number, tuple(len(one.failures) for one in flown))


def together(recipe: Recipe, missions: Iterable[int]) -> Iterator[list[int]]:
    """Missions in groups that fly together, whose logs fit into the memory of a worker."""
    group: list[int] = []
    samples = 0
    for mission in missions:
        more = samples_in(recipe.plan.durations_s[mission])
        if group and (len(group) == recipe.abreast or samples + more > MOST_SAMPLES):
            yield group
            group, samples = [], 0
        group.append(mission)
        samples += more
    if group:
        yield group


def fly_whole(recipe: Recipe, missions: Sequence[int]) -> Iterator[tuple[FlownMission, Signals]]:
    """Fly missions together; all that a store has of each with (mission, time)."""
    with quiet_mujoco():  # an unstable mission is recorded and replaced instead
        made = fly_missions(recipe, missions)
    for one, measured in made:
        place = mission_place(one.parameters, recipe.given_current)
        yield one, {**measured, **mission_coordinates(measured, place)}


def block_manifest(job: Job, number: int) -> Manifest | None:
    """The manifest of a block that is finished; None when it must be flown."""
    site = job.site
    found = read_manifest(
        site.files, site.block_manifest(number), unit=f"block {number}", recipe=site.recipe
    )
    return found if found is not None and all_there(site.files, found.files) else None


def sound_block(job: Job, number: int) -> bool:
    """Whether a block is finished and every byte of it is as it was written."""
    found = block_manifest(job, number)
    if found is None:
        return False
    try:
        with Block(job, found):
            return True
    except StoreError:
        return False


def pack(
    flown: Sequence[FlownMission],
    signals: Sequence[Signals],
    values: Mapping[str, NDArray[Any]],
) -> bytes:
    """The file of a block, the same bytes for the same missions."""
    table: dict[str, Any] = {
        "samples": [one.samples for one in flown],
        "failures": [failure for one in flown for failure in one.failures],
        "signals": {},
    }
    entries: dict[str, NDArray[Any]] = {}
    for name in dict.fromkeys(name for one in signals for name in one):
        parts = [one[name] for one in signals if name in one]
        table["signals"][name] = {
            "dtype": parts[0].dtype.str,
            "missions": [row for row, one in enumerate(signals) if name in one],
        }
        packed = BLOSC.encode(np.concatenate(parts))
        entries[SIGNAL + name] = np.frombuffer(packed, np.uint8)
    entries |= {ROWS + name: array for name, array in values.items()}
    entries[TABLE] = np.frombuffer(json.dumps(table).encode(), np.uint8)
    archive = io.BytesIO()
    np.savez(archive, allow_pickle=False, **entries)
    return archive.getvalue()


class Block:
    """A finished block, read back signal by signal; a context manager.

    Raises:
      StoreError: its file is damaged or gone.
    """

    def __init__(self, job: Job, manifest: Manifest):
        self.missions = manifest.missions
        ((key, expected),) = manifest.files.items()
        what = f"{job.site.files.name}/{key}"
        self._files = job.site.files
        try:
            self._path = path = self._files.fetch(key, job.site.staging)
            if file_sum(path) != expected:
                raise StoreError(f"{what} is damaged: remove it, then use --resume")
            check_archive(path, what, StoreError)
            self._archive = np.load(path, allow_pickle=False)
            self._table = json.loads(self._archive[TABLE].tobytes())
            self.samples: list[int] = self._table["samples"]
        except FileNotFoundError as error:
            raise StoreError(f"{what} has disappeared; --resume flies it again") from error
        except (ValueError, KeyError, TypeError, RecursionError, zipfile.BadZipFile) as error:
            if isinstance(error, StoreError):
                raise
            raise StoreError(
                f"{what} is not a block ({type(error).__name__}): remove it and continue with "
                "--resume"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._archive.close()
        self._files.give_back(self._path)

    @property
    def signals(self) -> dict[str, np.dtype[Any]]:
        """Names and types of what its missions have."""
        return {n: np.dtype(entry["dtype"]) for n, entry in self._table["signals"].items()}

    @property
    def failures(self) -> list[FailedAttempt]:
        """Every attempt that failed."""
        return [FailedAttempt(*row) for row in self._table["failures"]]

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
        samples = sum(self.samples[row] for row in entry["missions"])
        if _decoded_size(packed) != samples * dtype.itemsize:
            raise StoreError(f"{self._path} is damaged: remove it, then use --resume")
        values = np.frombuffer(BLOSC.decode(packed), dtype)
        start = 0
        for row in entry["missions"]:
            samples = self.samples[row]
            into[row, :samples] = values[start : start + samples]
            start += samples


def _decoded_size(packed: NDArray[np.uint8]) -> int:
    """[byte] that Blosc's header declares; 0 where it is none."""
    header = packed[:16].tobytes()
    return int(struct.unpack_from("<I", header, 4)[0]) if len(header) == 16 else 0
