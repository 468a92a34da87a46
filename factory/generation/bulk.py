"""Generate: all missions of a recipe into one store, resumable at any moment."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from factory.generation.checkpoint import Journal
from factory.generation.mission_record import Record
from factory.generation.shards import finish_store, shard_range, shards, write_shard
from factory.generation.workers import Pool
from factory.recipe.plan import HOUR
from factory.recipe.recipe import Recipe, differences
from twin.errors import StoreError
from twin.records.store import IMPORT_REPORT

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
    store, journal = Path(out), Journal(Path(out))
    if workers is None:
        workers = len(os.sched_getaffinity(0))
    if workers < 1:
        raise StoreError(f"--workers {workers} must be at least 1")
    try:
        complete = _prepare(recipe, journal, resume=resume, overwrite=overwrite)
        if complete:
            return _summary(recipe, store, begun, flown=[], failed=_count_failed(store))
        with journal.locked() as lock:
            flown, records = _fill(recipe, journal, min(workers, len(recipe.plan)), lock, watch)
            finish_store(recipe, store, records, history)
            journal.remove()
    except OSError as error:
        raise StoreError(
            f"cannot write {error.filename or store}: {error.strerror or error}; finished missions "
            "are kept: make room or a writable place, then go on with --resume"
        ) from error
    failed = sum(len(record.failures) for record in records)
    return _summary(recipe, store, begun, flown=flown, failed=failed)


def _prepare(recipe: Recipe, journal: Journal, *, resume: bool, overwrite: bool) -> bool:
    """Make `journal` ready for this recipe; True when the store is already complete."""
    store, settings = journal.store, recipe.describe()
    if store.is_symlink() and not store.exists():
        raise StoreError(f"{store} is a link to nothing; choose another --out")
    present = store.exists() and not journal.blank
    complete = (store / "zarr.json").is_file()
    if present and not (complete or journal.exists):
        raise StoreError(f"{store} exists and is not a store; choose another --out")
    if present and overwrite:
        with journal.locked():  # not while another run writes it
            shutil.rmtree(store)
        present = complete = False
    if present and not resume:
        if complete:
            raise StoreError(f"store {store} already exists; use --overwrite or another --out")
        raise StoreError(
            f"store {store} is incomplete: --resume completes it, --overwrite starts again"
        )
    if present:
        old = _store_settings(store) if complete else journal.settings()
        changed = differences(old, settings)
        if changed:
            more = len(changed) - MAX_DIFFERENCES
            listing = "; ".join(changed[:MAX_DIFFERENCES]) + (f"; {more} more" if more > 0 else "")
            raise StoreError(
                f"store {store} was started with other settings ({listing}): resume with the old "
                "ones, or use --overwrite or another --out"
            )
        return complete
    journal.start(settings)
    return False


def _store_settings(store: Path) -> dict[str, object]:
    try:
        attributes = json.loads((store / "zarr.json").read_bytes())["attributes"]
    except (OSError, ValueError, KeyError) as error:
        raise StoreError(
            f"store {store} is damaged: its zarr.json cannot be read ({error}); make it anew"
        ) from error
    if IMPORT_REPORT in attributes:
        raise StoreError(
            f"store {store} holds logs of real vehicles, there is nothing to resume: choose "
            "another --out"
        )
    try:
        settings: dict[str, object] = json.loads(attributes["settings"])
    except (OSError, ValueError, KeyError) as error:
        raise StoreError(
            f"store {store} does not say what it was made with; it is damaged or not the factory's "
            f"({type(error).__name__})"
        ) from error
    return settings


def _fill(
    recipe: Recipe, journal: Journal, workers: int, lock: int, watch: Watcher | None
) -> tuple[list[int], list[Record]]:
    """Fly what is missing and write the shards; the missions flown now, and all records."""
    records: dict[int, list[Record]] = {}
    waiting: dict[int, set[int]] = {}
    for shard in shards(recipe):
        note = journal.read_shard_note(shard)
        missions = shard_range(recipe, shard)
        if note is not None:
            records[shard] = note
            journal.drop_parts(missions)
        else:
            waiting[shard] = {m for m in missions if journal.read_part(m) is None}
    if watch is not None:
        missing = {mission for missions in waiting.values() for mission in missions}
        for mission, duration in enumerate(recipe.plan.durations_s):
            if mission not in missing:
                watch(duration / HOUR, 0)
    flown: list[int] = []

    def settle(shard: int) -> None:
        if not waiting[shard]:
            records[shard] = write_shard(recipe, journal, shard)
            del waiting[shard]

    for shard in list(waiting):
        settle(shard)
    todo = sorted(mission for missions in waiting.values() for mission in missions)
    if todo:
        with Pool(recipe, journal, workers=min(workers, len(todo)), lock=lock) as pool:
            for done in pool.run(todo):
                flown.append(done.mission)
                if watch is not None:
                    watch(recipe.plan.durations_s[done.mission] / HOUR, done.failures)
                shard = next(s for s, missions in waiting.items() if done.mission in missions)
                waiting[shard].remove(done.mission)
                settle(shard)
    return flown, [record for shard in sorted(records) for record in records[shard]]


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
    attributes = json.loads((store / "zarr.json").read_bytes())["attributes"]
    return len(json.loads(attributes["failed_missions"]))
