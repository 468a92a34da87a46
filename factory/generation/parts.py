"""Parts of a generation: one store by many independent commands, such as tasks of a job array.

Part i of n flies every n-th shard. Parts may run at once, one after the other or twice, on machines
that share a file system or an object storage.
`finish` completes the store, or lists the parts that have to run again.
"""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass

from factory.generation.completion import note
from factory.generation.generation import (
    Summary,
    Watcher,
    fly,
    generate,
    missing_shards,
    report_shard,
    reported,
)
from factory.generation.job import Job, Layout, check_target, locked, recipe_begun, recipe_of
from factory.sampling.draw import HOUR
from factory.sampling.recipe import Recipe
from twin.errors import InputError, StoreError
from twin.records.presence import begun, is_complete
from twin.records.storage.store_path import StorePath, store_path

SLURM_TASK = "SLURM_ARRAY_TASK_ID"
SLURM_COUNT, SLURM_FIRST = "SLURM_ARRAY_TASK_COUNT", "SLURM_ARRAY_TASK_MIN"
ARRAY = "array.json"
"""File in the working folder with the first index and the number of the job array's parts"""


@dataclass(frozen=True)
class StorePart:
    """Part `index` of `count`, counted from `first`."""

    index: int
    count: int
    first: int = 0

    def shards(self, layout: Layout) -> range:
        """Numbers of the part's shards."""
        return layout.shards[self.index - self.first :: self.count]


def parse_part(text: str) -> StorePart:
    """Parse a part from `i/n`, with i from 0 to n - 1.

    Raises:
      InputError: the text has another form, or i is too large.
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
    """Return the part for this task of a Slurm job array; None outside a job array."""
    if SLURM_TASK not in environment:
        return None
    try:
        return StorePart(*(int(environment[n]) for n in (SLURM_TASK, SLURM_COUNT, SLURM_FIRST)))
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{SLURM_TASK}={environment[SLURM_TASK]} without a usable {SLURM_COUNT} and "
            f"{SLURM_FIRST} ({error}): give --shard i/n"
        ) from error


def hours_of(recipe: Recipe, part: StorePart) -> float:
    """[h] Simulated time of a part's missions."""
    layout = Layout(len(recipe.plan), recipe.abreast)
    durations = recipe.plan.durations_s
    missions = (m for shard in part.shards(layout) for m in layout.missions_of(shard))
    return sum(durations[m] for m in missions) / HOUR


def generate_part(
    recipe: Recipe,
    out: str | StorePath,
    part: StorePart,
    *,
    history: str = "factory.generate",
    watch: Watcher | None = None,
) -> tuple[int, int]:
    """Fly the missing shards of one part; returns the missions flown now and the part's missions.

    Raises:
      StoreError: `out` cannot hold the store, or the disk refuses.
      InputError: no such part, or all attempts at a mission failed.
    """
    store = store_path(out)
    job = Job(recipe, store)
    with reported(store):
        if check_target(recipe, store, resume=True, overwrite=False):
            return 0, 0
        with locked(store, shared=True):
            job.begin()
            part = _recount_part(job, part)
            note(store, recipe, f"{history} (part {part.index} of {part.count})")
            mine = part.shards(job.layout)
            missing = missing_shards(job, mine, watch)
            for shard in missing:
                report_shard(job, shard, fly(job, shard), watch)
    flown, missions = (
        sum(len(job.layout.missions_of(s)) for s in some) for some in (missing, mine)
    )
    return flown, missions


def finish(out: str | StorePath) -> tuple[Summary, Recipe]:
    """Complete a store whose parts have all run; returns the summary and the recipe.

    Raises:
      StoreError: parts are missing (the message lists them), or the store was not begun.
    """
    store = store_path(out)
    places = begun(store)
    if not places and not is_complete(store):
        raise StoreError(
            f"{store} was not begun: run its parts first, `factory generate --shard 0/8 "
            f"--out {store}` and so on"
        )
    if len(places) > 1:
        raise StoreError(f"{store} was begun with {len(places)} recipes: {places[0].parent}")
    recipe = recipe_begun(places[0]) if places else recipe_of(store)
    job = Job(recipe, store)
    with reported(store):
        if not check_target(recipe, store, resume=True, overwrite=False):
            with locked(store):
                missing = missing_shards(job, job.layout.shards)
            if missing:
                raise StoreError(_describe_missing(job, missing))
    return generate(recipe, store, resume=True, history="factory finish"), recipe


def _recount_part(job: Job, part: StorePart) -> StorePart:
    """Return the part with the count of the array's first run. If some tasks run again, Slurm
    counts only these.

    Raises:
      InputError: no such part.
    """
    if not job.files.exists(ARRAY):
        array = {"first": part.first, "count": part.count}
        job.files.write(ARRAY, json.dumps(array).encode(), safe=True)
    first, count = _read_array(job)
    if not 0 <= part.index - first < count:
        raise InputError(
            f"part {part.index}: {job.store} was begun in {count} parts, {first} to "
            f"{first + count - 1}"
        )
    return StorePart(part.index, count, first)


def _read_array(job: Job) -> tuple[int, int]:
    """Read the first index and the number of parts that the array's first task wrote.

    Raises:
      StoreError: the file is damaged.
    """
    try:
        kept = json.loads(job.files.read_small(ARRAY))
        first, count = int(kept["first"]), int(kept["count"])
        if count < 1:
            raise ValueError(f"{count} parts")
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise StoreError(
            f"{job.folder / ARRAY} is damaged ({type(error).__name__}): remove it, then run any "
            "part of the array again"
        ) from error
    return first, count


def _describe_missing(job: Job, shards: list[int]) -> str:
    """Error message with the parts that have to run again, as an option for Slurm."""
    missing = sum(len(job.layout.missions_of(shard)) for shard in shards)
    start = f"{missing} of {job.layout.missions} missions of {job.store} are missing"
    if not job.files.exists(ARRAY):
        return f"{start}: complete it with the command that began it and --resume"
    first, count = _read_array(job)
    parts = sorted({shard % count + first for shard in shards})
    groups = itertools.groupby(enumerate(parts), lambda one: one[1] - one[0])
    runs = [[part for _, part in group] for _, group in groups]  # as Slurm writes them: 1,3-5
    array = ",".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)
    return f"{start}; run these parts of {count} again: --array={array}"
