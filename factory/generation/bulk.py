"""Generate: all missions of a recipe into one store, resumable at any moment."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from factory.generation.checkpoint import Checkpoint
from factory.generation.flown_mission import FlownMission
from factory.generation.shards import (
    open_target,
    shard_range,
    shards,
    small_arrays,
    store_attributes,
    write_shard,
)
from factory.generation.workers import Pool
from factory.recipe.plan import HOUR
from factory.recipe.recipe import Recipe, differences
from twin.errors import StoreError
from twin.records.attributes import FAILED_MISSIONS, SETTINGS, is_logged
from twin.records.sharded import ShardedStore
from twin.records.store import is_complete, read_attributes

MAX_DIFFERENCES = 5
"""Differences named when a resume is refused."""
Watcher = Callable[[float, int], None]
"""Called with the hours [h] of a finished mission and the attempts that it needed beyond one."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What a run did."""

    store: Path
    missions: int
    hours: float
    """[h] of all missions in the store"""
    flown: int
    """missions that this run flew; the others were there"""
    flown_hours: float
    """[h]"""
    failed: int
    """attempts that failed and were replaced"""
    wall_s: float
    """[s] this run took"""
    stored_bytes: int
    """size of the store's files"""

    @property
    def times_real_time(self) -> float:
        """Simulated over elapsed time of this run."""
        return self.flown_hours * HOUR / self.wall_s


def generate(
    recipe: Recipe,
    out: str | Path,
    *,
    workers: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    history: str = "factory.generate",
    watch: Watcher | None = None,
) -> Summary:
    """Make the store at `out`.

    Args:
      workers: processes; None: as many as this process may use CPUs.
      resume: continue a store that an earlier run left incomplete; start one if there is none.
      overwrite: replace what is there.
      history: how the store's `history` says that it was made.

    Raises:
      StoreError: something is in the way, another recipe is to be resumed, or the disk refuses.
        Finished missions are kept, and `resume` goes on from them.
      TwinError: a mission that no attempt could fly, or a dead worker.
    """
    begun = time.perf_counter()
    store, checkpoint = Path(out), Checkpoint(Path(out))
    if workers is None:
        workers = len(os.sched_getaffinity(0))
    if workers < 1:
        raise StoreError(f"--workers {workers} must be at least 1")
    try:
        complete = _prepare(recipe, checkpoint, resume=resume, overwrite=overwrite)
        if complete:
            return _summary(recipe, store, begun, flown=[], failed=_count_failed(store))
        with checkpoint.locked() as lock:
            target = open_target(recipe, checkpoint)
            flown, missions = _fill(
                recipe, checkpoint, target, min(workers, len(recipe.plan)), lock, watch
            )
            target.finish(
                small_arrays(recipe, missions), store_attributes(recipe, missions, history)
            )
            checkpoint.remove()
    except OSError as error:
        raise StoreError(
            f"cannot write {error.filename or store}: {error.strerror or error}; finished missions "
            "are kept: make room or a writable place, then go on with --resume"
        ) from error
    failed = sum(len(mission.failures) for mission in missions)
    return _summary(recipe, store, begun, flown=flown, failed=failed)


def _prepare(recipe: Recipe, checkpoint: Checkpoint, *, resume: bool, overwrite: bool) -> bool:
    """Make `checkpoint` ready for this recipe; True when the store is already complete."""
    store, settings = checkpoint.store, recipe.describe()
    if store.is_symlink() and not store.exists():
        raise StoreError(f"{store} is a link to nothing; choose another --out")
    present = store.exists() and not checkpoint.blank
    complete = is_complete(store)
    if present and not (complete or checkpoint.exists):
        raise StoreError(f"{store} exists and is not a store; choose another --out")
    if present and overwrite:
        with checkpoint.locked():  # not while another run writes it
            shutil.rmtree(store)
        present = complete = False
    if present and not resume:
        if complete:
            raise StoreError(f"store {store} already exists; use --overwrite or another --out")
        raise StoreError(
            f"store {store} is incomplete: --resume completes it, --overwrite starts again"
        )
    if present:
        old = _store_settings(store) if complete else checkpoint.settings()
        changed = differences(old, settings)
        if changed:
            more = len(changed) - MAX_DIFFERENCES
            listing = "; ".join(changed[:MAX_DIFFERENCES]) + (f"; {more} more" if more > 0 else "")
            raise StoreError(
                f"store {store} was started with other settings ({listing}): resume with the old "
                "ones, or use --overwrite or another --out"
            )
        return complete
    checkpoint.start(settings)
    return False


def _store_settings(store: Path) -> dict[str, object]:
    attributes = read_attributes(store)
    if is_logged(attributes):
        raise StoreError(
            f"store {store} holds logs of real vehicles, there is nothing to resume: choose "
            "another --out"
        )
    try:
        settings: dict[str, object] = json.loads(attributes[SETTINGS])
    except (OSError, ValueError, KeyError) as error:
        raise StoreError(
            f"store {store} does not say what it was made with; it is damaged or not the factory's "
            f"({type(error).__name__})"
        ) from error
    return settings


def _fill(
    recipe: Recipe, checkpoint: Checkpoint, target: ShardedStore, workers: int, lock: int,
    watch: Watcher | None,
) -> tuple[list[int], list[FlownMission]]:  # fmt: skip
    """Fly what is missing and write the shards; the missions flown now, and all missions."""
    kept: dict[int, list[FlownMission]] = {}
    waiting: dict[int, set[int]] = {}
    for shard in shards(recipe):
        found = checkpoint.read_shard(shard)
        missions = shard_range(recipe, shard)
        if found is not None:
            kept[shard] = found
            checkpoint.drop(missions)
        else:
            waiting[shard] = {m for m in missions if checkpoint.read_mission(m) is None}
    todo = sorted(mission for missions in waiting.values() for mission in missions)
    if watch is not None:
        for mission in sorted(set(range(len(recipe.plan))) - set(todo)):
            watch(recipe.plan.durations_s[mission] / HOUR, 0)

    def settle(shard: int) -> None:
        if not waiting[shard]:
            kept[shard] = write_shard(recipe, checkpoint, target, shard)
            del waiting[shard]

    def settle_all() -> None:
        for shard in list(waiting):
            settle(shard)

    if not todo:
        settle_all()
    else:
        with Pool(recipe, checkpoint, workers=min(workers, len(todo)), lock=lock) as pool:
            flying = pool.run(todo)
            # only now that the workers are forked and busy: zarr has threads
            target.prepare()
            settle_all()
            for done in flying:
                if watch is not None:
                    watch(recipe.plan.durations_s[done.mission] / HOUR, done.failures)
                shard = next(s for s, missions in waiting.items() if done.mission in missions)
                waiting[shard].remove(done.mission)
                settle(shard)
    return todo, [flown for shard in sorted(kept) for flown in kept[shard]]


def _summary(
    recipe: Recipe, store: Path, begun: float, *, flown: list[int], failed: int
) -> Summary:
    durations = recipe.plan.durations_s
    return Summary(
        store=store,
        missions=len(recipe.plan),
        hours=recipe.plan.hours,
        flown=len(flown),
        flown_hours=sum(durations[mission] for mission in flown) / HOUR,
        failed=failed,
        wall_s=time.perf_counter() - begun,
        stored_bytes=sum(f.stat().st_size for f in store.rglob("*") if f.is_file()),
    )


def _count_failed(store: Path) -> int:
    return len(json.loads(read_attributes(store)[FAILED_MISSIONS]))
