"""Shard: the unit of work: its missions are flown, its files made whole, its marker left.

A task flies the missions of a shard and encodes them one after the other into files of a folder of
its own. Then each file gets its name in the tree, and the marker is written last, when they are on
the disk. A shard without a marker is flown again; one that two processes make at once has the same
bytes twice.
"""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import hashlib
import json
import math
import socket
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.generation.attempts import FailedAttempt, FlownMission, fly_missions
from factory.generation.bookkeeping import rows
from factory.generation.job import Job
from factory.sampling.drawn_plan import samples_in
from factory.sampling.mission_water import mission_coordinates, mission_place
from factory.sampling.recipe import Recipe, versions
from twin.bounded import FREE_BYTES
from twin.errors import StoreError
from twin.physics.mujoco_model import quiet_mujoco
from twin.records.presence import RECIPE
from twin.records.storage.shard_file import ShardWriter
from twin.records.storage.stored_files import FileSum

Signals = Mapping[str, NDArray[Any]]
"""By name: (samples,) of one mission"""
MOST_SAMPLES = 500_000
"""Of missions that fly together, whose logs are in memory at once: about 400 bytes each"""
DIGEST = 32
"""[byte] of a marker's SHA-256, with which its file begins"""
_ALONE = threading.RLock()
_TRIM = getattr(ctypes.CDLL(None), "malloc_trim", None)
"""glibc's; None with another C library"""


@dataclass(frozen=True)
class ShardDone:
    """Result of a task that flew a shard."""

    number: int
    failures: tuple[int, ...]
    """attempts that each mission needed beyond one"""


@dataclass(frozen=True, kw_only=True)
class Marker:
    """Record of a finished shard, so that it is neither repeated nor mistaken."""

    number: int
    recipe: str
    """hash of the recipe"""
    files: dict[str, FileSum]
    """by key in the tree"""
    failures: list[FailedAttempt]
    """every attempt that failed and was replaced"""
    versions: Mapping[str, str]
    """of what can change a bit of a result"""
    rows: dict[str, NDArray[Any]]
    """values of each mission, as `bookkeeping.rows` gives them"""

    def to_bytes(self) -> bytes:
        """As it is kept: SHA-256 of the rest, a line of JSON, the rows one after the other."""
        table: dict[str, Any] = {**vars(self)}
        table["files"] = {key: dataclasses.astuple(one) for key, one in self.files.items()}
        table["rows"] = {name: (one.dtype.str, one.shape) for name, one in self.rows.items()}
        text = json.dumps(table).encode() + b"\n"
        data = text + b"".join(one.tobytes() for one in self.rows.values())
        return hashlib.sha256(data).digest() + data

    @classmethod
    def of_bytes(cls, data: bytes) -> Marker:
        """Read a marker; raises ValueError, KeyError or TypeError where the file is damaged."""
        if hashlib.sha256(data[DIGEST:]).digest() != data[:DIGEST]:
            raise ValueError("it does not have its own digest")
        place = data.index(b"\n", DIGEST) + 1
        table = json.loads(data[DIGEST:place])
        table["files"] = {key: FileSum(*one) for key, one in table["files"].items()}
        table["failures"] = [FailedAttempt(*one) for one in table["failures"]]
        for name, (kind, shape) in table["rows"].items():
            count = math.prod(shape)
            values = np.frombuffer(data, kind, count, place).reshape(shape)
            table["rows"][name] = values
            place += values.nbytes
        return cls(**table)


def read_marker(job: Job, number: int) -> Marker | None:
    """The marker of a shard; None when there is none, or a damaged one: the shard is flown again.

    Raises:
      StoreError: it is that of another shard or recipe.
    """
    key = job.marker(number)
    try:
        found = Marker.of_bytes(job.files.read_small(key, FREE_BYTES))
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    if (found.number, found.recipe) != (number, job.digest):
        raise StoreError(
            f"{job.files.name}/{key} is of shard {found.number} of recipe {found.recipe[:12]}, "
            f"expected is {number} of recipe {job.digest[:12]}: remove that folder, or use another "
            "--out"
        )
    return found


def finished(job: Job, number: int, sizes: Mapping[str, int]) -> Marker | None:
    """The marker of a shard whose files are all in the tree, by the `sizes` there; else None."""
    found = read_marker(job, number)
    there = found and all(sizes.get(key) == one.bytes for key, one in found.files.items())
    return found if there else None


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """One task at a time in this process, whose executor may have threads: MuJoCo's warnings,
    numba's tables and staging folders are those of the whole process.

    Afterwards what the task freed goes back to the system. glibc would keep it in pieces, and a
    process that flies for days would hold more and more.
    """
    with _ALONE:
        try:
            yield
        finally:
            if _TRIM is not None:
                _TRIM(0)


@alone()
def fly_shard(job: Job, number: int) -> ShardDone:
    """Fly the missions of a shard and put its files in the tree.

    Raises:
      InputError: a mission that no attempt could fly. OSError: the disk refuses.
      StoreError: another process has made the shard with other bytes.
    """
    if not job.files.exists(RECIPE):
        raise StoreError(
            f"{socket.gethostname()} does not see {job.files.name}: all machines that fly missions "
            "must have --out under the same path, or use an address such as s3://bucket/name.zarr"
        )
    recipe, layout = job.recipe, job.layout
    size, samples = layout.shard_missions, recipe.plan.samples
    flown: list[FlownMission] = []
    with job.staging() as folder, ShardWriter(folder, missions=size, samples=samples) as writer:
        for group in together(recipe, layout.missions_of(number)):
            for one, signals in fly_whole(recipe, group):
                flown.append(one)
                writer.add(signals)
        sums = {f"{name}/c/{number}/0": one for name, one in writer.finish().items()}
        marker = Marker(
            number=number,
            recipe=job.digest,
            files=sums,
            failures=[failure for one in flown for failure in one.failures],
            versions=versions(recipe.vehicle),
            rows=rows(recipe, flown),
        )
        before = read_marker(job, number) and finished(job, number, dict(job.tree.sizes()))
        if before is None:
            job.tree.take({key: folder / key.partition("/")[0] for key in sums})
            job.tree.settle()
            job.files.write(job.marker(number), marker.to_bytes(), safe=True)
        elif before.files != sums:
            raise StoreError(_differ(number, before, marker))
    return ShardDone(number, tuple(len(one.failures) for one in flown))


def _differ(number: int, before: Marker, now: Marker) -> str:
    """Two processes that should have made the same bytes and did not."""
    names = sorted(before.files.keys() | now.files.keys())
    name = next(n for n in names if before.files.get(n) != now.files.get(n))
    sums = [m.files[name].sha256[:12] if name in m.files else "no file" for m in (before, now)]
    other = ", ".join(
        f"{n} {before.versions.get(n)} and {now.versions.get(n)}"
        for n in sorted(before.versions.keys() | now.versions.keys())
        if before.versions.get(n) != now.versions.get(n)
    )
    return (
        f"shard {number} was made twice with different bytes ({name}: {sums[0]} and {sums[1]}; "
        f"{other or 'by the same versions'}): the processors round differently. Make a store on "
        "one kind of machine"
    )


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
