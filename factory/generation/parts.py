"""Parts: one store made by many commands that know nothing of each other, as job arrays are.

Part i of n flies every n-th block and assembles each shard whose blocks are all there. Parts may
run at once, one after the other, twice, on machines that share a file system or an object storage.
`finish` completes the store, or says which parts have to run again.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from factory.generation import completion
from factory.generation.completion import complete
from factory.generation.executors import Job
from factory.generation.generation import (
    Summary,
    Watcher,
    summary_of,
    told,
    waiting_blocks,
)
from factory.generation.manifest import Layout
from factory.generation.mission_block import block_manifest, fly_block
from factory.generation.site import Site, locked
from factory.generation.store_assembly import assemble, shard_manifest
from factory.generation.target import check_target, failures_in, give_name, recipe_begun, recipe_of
from factory.sampling.drawn_plan import HOUR
from factory.sampling.recipe import Recipe
from twin.errors import InputError, StoreError
from twin.records.presence import begun, is_complete
from twin.records.storage.store_path import StorePath, store_path

SLURM_TASK, SLURM_COUNT, SLURM_FIRST = (
    "SLURM_ARRAY_TASK_ID",
    "SLURM_ARRAY_TASK_COUNT",
    "SLURM_ARRAY_TASK_MIN",
)
ARRAY = "array.json"
"""In the working folder: first index and number of the parts of a job array"""


@dataclass(frozen=True)
class StorePart:
    """Part `index` of `count`, counted from `first`."""

    index: int
    count: int
    first: int = 0

    def blocks(self, layout: Layout) -> list[int]:
        """Its blocks."""
        return [b for b in layout.blocks if b % self.count == self.index - self.first]


def parse_part(text: str) -> StorePart:
    """From `i/n`, i from 0 to n - 1.

    Raises:
      InputError: it is something else.
    """
    index, slash, count = text.partition("/")
    if not (slash and index.isdecimal() and count.isdecimal()):
        raise InputError(f"--shard {text}: give i/n, such as 0/8 for the first of eight parts")
    part = StorePart(int(index), int(count))
    if not part.index < part.count:
        raise InputError(
            f"--shard {text}: parts are counted from 0 to n - 1, so the last of {count} is "
            f"{part.count - 1}/{part.count}"
        )
    return part


def slurm_part(environment: Mapping[str, str] = os.environ) -> StorePart | None:
    """The part of this task of a Slurm job array; None outside of one."""
    if SLURM_TASK not in environment:
        return None
    try:
        return StorePart(
            int(environment[SLURM_TASK]),
            int(environment[SLURM_COUNT]),
            int(environment[SLURM_FIRST]),
        )
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{SLURM_TASK}={environment[SLURM_TASK]} without a usable {SLURM_COUNT} and "
            f"{SLURM_FIRST} ({error}): give --shard i/n"
        ) from error


def hours_of(recipe: Recipe, part: StorePart) -> float:
    """Simulated hours of the missions of a part."""
    layout = Layout(len(recipe.plan), recipe.abreast)
    durations = recipe.plan.durations_s
    missions = (m for b in part.blocks(layout) for m in layout.missions_of_block(b))
    return sum(durations[m] for m in missions) / HOUR


def generate_part(
    recipe: Recipe,
    out: str | StorePath,
    part: StorePart,
    *,
    history: str = "factory.generate",
    watch: Watcher | None = None,
) -> tuple[int, int]:
    """Fly the blocks of one part that are not there; missions flown now, and missions of the part.

    Raises:
      StoreError: something else is under the name, or the disk refuses. InputError: no such part,
        or a mission that no attempt could fly.
    """
    store = store_path(out)
    job = Job(recipe, Site(store, recipe.digest))
    layout = job.layout
    with told(store):
        if check_target(recipe, store, resume=True, overwrite=False):
            return 0, 0
        with locked(store, shared=True):
            job.site.begin(recipe)
            part = _fixed(job.site, part)
            completion.note(store, recipe, f"{history} (part {part.index} of {part.count})")
            mine = part.blocks(layout)
            todo, _ = waiting_blocks(job, mine)
            for block in mine:
                if block not in todo:
                    _tell(job, block, [], watch)
            for block in todo:
                done = fly_block(job, block)
                _tell(job, block, done.failures, watch)
            for shard in layout.shards:
                if _ready(job, shard):
                    assemble(job, shard)
    count = sum(len(layout.missions_of_block(b)) for b in mine)
    return sum(len(layout.missions_of_block(b)) for b in todo), count


def finish(out: str | StorePath) -> tuple[Summary, Recipe]:
    """Complete a store whose parts have all run; what was done, and the recipe.

    Raises:
      StoreError: parts are missing, which the message lists, or nothing was begun.
    """
    started = time.perf_counter()
    store = store_path(out)
    places = begun(store)
    if not places and is_complete(store):
        recipe = recipe_of(store)
        return summary_of(recipe, store, started, flown=[], failed=failures_in(store)), recipe
    if not places:
        raise StoreError(
            f"{store} was not begun: run its parts first, `factory generate --shard 0/8 "
            f"--out {store}` and so on"
        )
    if len(places) > 1:
        raise StoreError(f"{store} was begun with {len(places)} recipes: {places[0].parent}")
    recipe = recipe_begun(places[0])
    job = Job(recipe, Site(store, recipe.digest))
    with told(store):
        if check_target(recipe, store, resume=True, overwrite=False):
            failed = failures_in(store)
            return summary_of(recipe, store, started, flown=[], failed=failed), recipe
        with locked(store):
            blocks, shards = waiting_blocks(job)
            if blocks:
                raise StoreError(_missing(job, blocks))
            job.site.sweep()
            for shard in shards:
                assemble(job, shard)
            _, failed = complete(job)
            give_name(job)
    return summary_of(recipe, store, started, flown=[], failed=failed), recipe


def _fixed(site: Site, part: StorePart) -> StorePart:
    """The part as the first task of the array counted them: when some tasks run again, Slurm
    counts only these.

    Raises:
      InputError: no such part.
    """
    if not site.files.exists(ARRAY):
        array = {"first": part.first, "count": part.count}
        site.files.write_safe(ARRAY, json.dumps(array).encode())
    kept = _array(site)
    fixed = StorePart(part.index, kept.count, kept.first)
    if not 0 <= fixed.index - fixed.first < fixed.count:
        last = fixed.first + fixed.count - 1
        raise InputError(
            f"part {part.index}: {site.store} was begun in {fixed.count} parts, {fixed.first} to "
            f"{last}"
        )
    return fixed


def _array(site: Site) -> StorePart:
    """How the first task of the array counted its parts, as its first one.

    Raises:
      StoreError: the file that says so is damaged.
    """
    try:
        kept = json.loads(site.files.read_small(ARRAY))
        first = StorePart(int(kept["first"]), int(kept["count"]), int(kept["first"]))
        if first.count < 1:
            raise ValueError(f"{first.count} parts")
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise StoreError(
            f"{site.folder / ARRAY} is damaged ({type(error).__name__}): remove it, then run any "
            "part of the array again"
        ) from error
    return first


def _ready(job: Job, shard: int) -> bool:
    """Whether a shard can be assembled, and is not."""
    if shard_manifest(job, shard) is not None:
        return False
    return all(block_manifest(job, block) for block in job.layout.blocks_of_shard(shard))


def _tell(job: Job, block: int, failures: Sequence[int], watch: Watcher | None) -> None:
    if watch is not None:
        durations = job.recipe.plan.durations_s
        for row, mission in enumerate(job.layout.missions_of_block(block)):
            watch(durations[mission] / HOUR, failures[row] if failures else 0)


def _missing(job: Job, blocks: list[int]) -> str:
    """Which parts have to run again, in words that can be pasted."""
    site, missing = job.site, sum(len(job.layout.missions_of_block(b)) for b in blocks)
    start = f"{missing} of {job.layout.missions} missions of {site.store} are missing"
    if not site.files.exists(ARRAY):
        return f"{start}: complete it with the command that began it and --resume"
    array = _array(site)
    parts = sorted({block % array.count + array.first for block in blocks})
    return f"{start}; run these parts of {array.count} again: --array={_ranges(parts)}"


def _ranges(numbers: list[int]) -> str:
    """Numbers as Slurm writes them: 1,3-5."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ",".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)
