"""Generate: all missions of a recipe into one store, resumable at any moment.

The bytes of a mission follow from the recipe and its number alone. So blocks of missions are flown
by whatever runs them, in any order, and twice if need be; nobody coordinates and nothing conflicts.

Into store: missions into any zarr store that a program has opened, such as one of icechunk.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from factory.generation import completion
from factory.generation.completion import complete
from factory.generation.executors import Job, local_pool
from factory.generation.mission_block import BlockDone, fly_block, sound_block
from factory.generation.site import Site, locked
from factory.generation.store_assembly import assemble, open_tree, shard_manifest
from factory.generation.target import check_target, failures_in, give_name
from factory.sampling.drawn_plan import HOUR
from factory.sampling.recipe import Recipe
from twin.errors import StoreError, TwinError
from twin.numbers import processors
from twin.records.storage.object_storage import files_at
from twin.records.storage.store_arrays import check_empty, copy_into
from twin.records.storage.store_path import StorePath, store_path
from twin.records.storage.stored_files import LocalFiles

if TYPE_CHECKING:
    from twin.records.storage.store_arrays import AnyStore


WAITING = 4
"""Blocks for each worker that wait at the executor: it never runs dry, and holds few at a time"""
UNKNOWN_WORKERS = 64
"""Blocks that wait at an executor that does not say how many workers it has"""
Watcher = Callable[[float, int], None]
"""Called with the hours [h] of a finished mission and the attempts that it needed beyond one."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What a run did."""

    store: StorePath | AnyStore
    """where the missions are: a path, an address or an open zarr store"""
    missions: int
    hours: float
    """[h] of all missions in the store"""
    flown: int
    """missions that this run flew; the others were there"""
    flown_hours: float
    """[h]"""
    failed: int
    """attempts that failed and were replaced, in the whole store"""
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
    out: str | StorePath,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    resume: bool = False,
    overwrite: bool = False,
    history: str = "factory.generate",
    watch: Watcher | None = None,
) -> Summary:
    """Make the store at `out`.

    Args:
      workers: processes of this machine; None: as many as it may use CPUs.
      out: a path, or an address such as s3://bucket/missions.zarr.
      executor: what flies the blocks instead of such processes: any executor of
        `concurrent.futures`, that of a dask client too. It must reach `out` by the same path.
      resume: continue a store that an earlier run left incomplete; start one if there is none.
      overwrite: replace what is there, once the new store is complete.
      history: what the log beside the store says that the run was called with.

    Raises:
      StoreError: something is in the way, another recipe is to be resumed, or the disk refuses.
        Finished blocks are kept, and `resume` goes on from them.
      TwinError: a mission that no attempt could fly, or a dead worker.
    """
    begun = time.perf_counter()
    store = store_path(out)
    if executor is not None and isinstance(store, Path):
        store = store.absolute()  # its processes may work in other folders
    workers = check_workers(workers, executor)
    job = Job(recipe, Site(store, recipe.digest))
    with told(store):
        check_target(recipe, store, resume=resume, overwrite=overwrite)  # before a lock is made
        with locked(store):
            if check_target(recipe, store, resume=resume, overwrite=overwrite, alone=True):
                job.site.clear()
                return summary_of(recipe, store, begun, flown=[], failed=failures_in(store))
            job.site.begin(recipe)
            job.site.sweep()
            completion.note(store, recipe, history)
            flown = _fly(job, workers, executor, watch)
            _, failed = complete(job)
            give_name(job)
    return summary_of(recipe, store, begun, flown=flown, failed=failed)


def check_workers(workers: int | None, executor: Executor | None) -> int:
    """Processes to start; raises StoreError for an impossible number."""
    if workers is None:
        return processors()
    if executor is not None:
        raise StoreError("give either workers or an executor, which has its own")
    if workers < 1:
        raise StoreError(f"--workers {workers} must be at least 1")
    return workers


@contextlib.contextmanager
def told(store: StorePath) -> Iterator[None]:
    """Say of the errors of a disk or a storage what is kept and how to go on."""
    try:
        yield
    except OSError as error:
        what = f"cannot write {error.filename or store}: {error.strerror or error}"
        if isinstance(store, Path):
            what += "; finished missions are kept: make room or a writable place, then continue "
            what += "with --resume"
        elif not isinstance(error, PermissionError | NotADirectoryError):  # else none was begun
            what += "; finished missions are kept: continue with --resume"
        raise StoreError(what) from error


def waiting_blocks(job: Job, blocks: list[int] | None = None) -> tuple[list[int], list[int]]:
    """Blocks, of these or of all, that have to be flown, and shards that have to be assembled."""
    wanted = set(job.layout.blocks if blocks is None else blocks)
    shards = [shard for shard in job.layout.shards if shard_manifest(job, shard) is None]
    needed = [b for shard in shards for b in job.layout.blocks_of_shard(shard) if b in wanted]
    return [block for block in needed if not sound_block(job, block)], shards


def _fly(job: Job, workers: int, executor: Executor | None, watch: Watcher | None) -> list[int]:
    """Fly what is missing and assemble the shards; the missions flown now."""
    recipe, layout = job.recipe, job.layout
    blocks, shards = waiting_blocks(job)
    if blocks and executor is None:
        recipe.warm()
    flown = [mission for block in blocks for mission in layout.missions_of_block(block)]
    if watch is not None:
        for mission in sorted(set(range(len(recipe.plan))) - set(flown)):
            watch(recipe.plan.durations_s[mission] / HOUR, 0)
    left = {shard: set(layout.blocks_of_shard(shard)) & set(blocks) for shard in shards}

    def done(block: BlockDone) -> None:
        if watch is not None:
            missions = layout.missions_of_block(block.number)
            for mission, failures in zip(missions, block.failures, strict=True):
                watch(recipe.plan.durations_s[mission] / HOUR, failures)
        left[layout.shard_of_block(block.number)].discard(block.number)

    if len(layout.shards) == 1 and executor is None:
        # one shard: this process assembles it, and gets zarr ready while the others fly
        if blocks:
            with local_pool(min(workers, len(blocks)), fork=job.site.local) as pool:
                flying = _run(pool, job, blocks, workers)
                open_tree(job).prepare()
                for block in flying:
                    done(block)
        for shard in shards:
            assemble(job, shard)
        return flown
    with contextlib.ExitStack() as stack:
        tasks: Executor = executor or stack.enter_context(
            local_pool(min(workers, max(1, len(blocks))), fork=job.site.local)
        )
        assembling = [tasks.submit(assemble, job, s) for s in shards if not left[s]]
        for block in _run(tasks, job, blocks, None if executor else workers):
            done(block)
            shard = layout.shard_of_block(block.number)
            if not left[shard]:
                assembling.append(tasks.submit(assemble, job, shard))
        for future in concurrent.futures.as_completed(assembling):
            _result(future)
    return flown


def _run(pool: Executor, job: Job, blocks: list[int], workers: int | None) -> Iterator[BlockDone]:
    """Have blocks flown; yields each as it is kept, in any order."""
    todo = iter(blocks)
    most = UNKNOWN_WORKERS if workers is None else WAITING * workers
    flying: set[Future[BlockDone]] = set()

    def hand_out() -> None:
        for block in todo:
            flying.add(pool.submit(fly_block, job, block))
            if len(flying) >= most:
                return

    hand_out()

    def collect() -> Iterator[BlockDone]:
        while flying:
            finished, _ = concurrent.futures.wait(
                flying, return_when=concurrent.futures.FIRST_COMPLETED
            )
            for future in finished:
                flying.discard(future)
                yield _result(future)
            hand_out()

    return collect()


def _result(future: Future[Any]) -> Any:
    """What a task returns; raises what stopped it."""
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise TwinError(
            "a worker process ended abruptly; too little memory is the usual reason. Finished "
            "blocks are kept: --resume goes on from them, with fewer --workers if need be"
        ) from error


def summary_of(
    recipe: Recipe, store: StorePath, begun: float, *, flown: list[int], failed: int
) -> Summary:
    """What a run that began at `begun` [s] of the clock for durations did."""
    durations = recipe.plan.durations_s
    return Summary(
        store=store,
        missions=len(recipe.plan),
        hours=recipe.plan.hours,
        flown=len(flown),
        flown_hours=sum(durations[mission] for mission in flown) / HOUR,
        failed=failed,
        wall_s=time.perf_counter() - begun,
        stored_bytes=files_at(store).stored_bytes(),
    )


def generate_into(
    recipe: Recipe,
    store: AnyStore,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    watch: Watcher | None = None,
) -> Summary:
    """Make the missions in a temporary folder of this machine, then copy every key.

    Nothing is committed: a store with sessions, as icechunk has, keeps them by one commit of its
    own when this returns.

    Args:
      store: empty, and open for writing.
      workers, executor, watch: as of `generate`.

    Returns:
      What was done, of `store`.

    Raises:
      StoreError: the store is read-only or holds something, and as `generate`.
    """
    check_empty(store)
    with tempfile.TemporaryDirectory(prefix="glider-twin-") as folder:
        made = Path(folder) / "missions.zarr"
        summary = generate(recipe, made, workers=workers, executor=executor, watch=watch)
        copy_into(LocalFiles(made), store)
    return dataclasses.replace(summary, store=store)
