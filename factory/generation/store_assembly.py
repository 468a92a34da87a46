"""Assembly: the finished blocks of a shard into one file for each signal."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.generation.attempts import FailedAttempt
from factory.generation.executors import Job, alone
from factory.generation.manifest import Manifest, all_there, leave_manifest, read_manifest
from factory.generation.mission_block import Block, block_manifest
from factory.sampling.recipe import versions
from twin.bounded import FREE_BYTES, check_archive
from twin.errors import StoreError
from twin.records.storage.sharded import ShardedStore, fill_value
from twin.records.storage.stored_files import FileSum

FAILURES = "failures"
"""Entry of a shard's rows: JSON of the attempts that failed"""


def open_tree(job: Job) -> ShardedStore:
    """The store that grows."""
    layout, plan = job.layout, job.recipe.plan
    return ShardedStore(
        job.site.tree,
        missions=len(plan),
        samples=plan.samples,
        shard_missions=layout.shard_missions,
        row_missions=layout.row_missions,
        staging=job.site.staging,
    )


def assemble(job: Job, number: int) -> int:
    """Write shard `number` from its blocks, and forget these; returns its number.

    Nothing is done when the shard is there.

    Raises:
      StoreError: a block is missing or damaged; `generate` flies it again.
      OSError: the disk refuses.
    """
    with alone():
        return _assemble_once(job, number)


def _assemble_once(job: Job, number: int) -> int:
    site, layout = job.site, job.layout
    if shard_manifest(job, number) is None:
        try:
            _assemble_blocks(job, number)
        except (StoreError, OSError):
            if shard_manifest(job, number) is None:
                raise
            # another part assembled it meanwhile, and its blocks are gone
    for block in layout.blocks_of_shard(number):
        site.files.remove(site.block_manifest(block))  # first: it vouches for the other
        site.files.remove(site.block(block))
    return number


def _assemble_blocks(job: Job, number: int) -> None:
    manifests: list[Manifest] = []
    for block in job.layout.blocks_of_shard(number):
        manifest = block_manifest(job, block)
        if manifest is None:
            raise StoreError(
                f"block {block} has disappeared from {job.site.files.name}; --resume flies it again"
            )
        manifests.append(manifest)
    target = open_tree(job)
    try:
        _assemble(job, number, manifests, target)
    finally:
        target.close()


def _assemble(job: Job, number: int, manifests: list[Manifest], target: ShardedStore) -> None:
    missions = job.layout.missions_of_shard(number)
    files: dict[str, FileSum] = {}
    with contextlib.ExitStack() as stack:
        blocks = [stack.enter_context(Block(job, manifest)) for manifest in manifests]
        signals = {name: dtype for block in blocks for name, dtype in block.signals.items()}
        for name, dtype in signals.items():
            values = np.full((len(missions), target.samples), fill_value(dtype), dtype)
            for block in blocks:
                first = block.missions.start - missions.start
                block.fill(name, values[first : first + len(block.missions)])
            key, found = target.write_shard(number, name, values)
            files[key] = found
        failures = [failure for block in blocks for failure in block.failures]
        rows = _joined([block.rows() for block in blocks])
    leave_shard(job, number, files, rows, failures)


def leave_shard(
    job: Job,
    number: int,
    files: Mapping[str, FileSum],
    rows: Mapping[str, NDArray[Any]],
    failures: Sequence[FailedAttempt],
) -> None:
    """Keep what there is one of for each mission of a shard whose signals are in the tree, and say
    that it is in place.

    Args:
      files: of its signals, by key.
      rows: as `bookkeeping.rows` gives them.
      failures: every attempt that failed.
    """
    site, missions = job.site, job.layout.missions_of_shard(number)
    archive = io.BytesIO()
    table = np.frombuffer(json.dumps(failures).encode(), np.uint8)
    np.savez(archive, allow_pickle=False, **{FAILURES: table, **rows})
    site.files.write(site.shard_rows(number), archive.getvalue())
    site.tree.settle()
    leave_manifest(
        site.files,
        site.shard_manifest(number),
        Manifest(
            unit=f"shard {number}",
            recipe=site.recipe,
            first=missions[0],
            last=missions[-1],
            files=files,
            failures=len(failures),
            versions=versions(job.recipe.vehicle),
        ),
    )


def shard_manifest(job: Job, number: int) -> Manifest | None:
    """The manifest of a shard that is in place; None when it must be assembled."""
    site = job.site
    found = read_manifest(
        site.files, site.shard_manifest(number), unit=f"shard {number}", recipe=site.recipe
    )
    if found is None or not all_there(site.tree, found.files):
        return None
    try:
        ShardRows(job, number)
    except StoreError:
        return None
    return found


class ShardRows:
    """What there is one of for each mission of a shard, read back.

    Raises:
      StoreError: the file is damaged.
    """

    def __init__(self, job: Job, number: int):
        key = job.site.shard_rows(number)
        try:
            data = job.site.files.read_small(key, FREE_BYTES)
            check_archive(data, key, StoreError)
            archive = np.load(io.BytesIO(data), allow_pickle=False)
            self.arrays: dict[str, NDArray[Any]] = {n: archive[n] for n in archive.files}
            failed = json.loads(self.arrays.pop(FAILURES).tobytes())
            self.failures = [FailedAttempt(*row) for row in failed]
        except Exception as error:  # whatever a damaged archive raises
            what = f"{job.site.files.name}/{key}"
            raise StoreError(f"{what} cannot be read ({type(error).__name__})") from error


def _joined(parts: list[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Rows of one block after the other; those of segments as wide as the widest."""
    joined = {}
    for name, first in parts[0].items():
        arrays = [part[name] for part in parts]
        joined[name] = np.concatenate(arrays) if first.ndim == 1 else stacked(arrays)
    return joined


def stacked(arrays: list[NDArray[Any]], width: int = 0) -> NDArray[Any]:
    """Arrays (missions, segments) one below the other, filled up to the widest, or to `width`."""
    width = max(width, *(array.shape[1] for array in arrays))
    empty = np.nan if arrays[0].dtype.kind == "f" else -1
    return np.concatenate(
        [
            np.pad(array, ((0, 0), (0, width - array.shape[1])), constant_values=empty)
            for array in arrays
        ]
    )
