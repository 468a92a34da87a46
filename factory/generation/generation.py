"""Generate: all missions of a recipe into one store, resumable at any moment.

How a store is made:

- Plan. The recipe says how long each mission lasts, and its bytes follow from the recipe and its
  number alone. `Layout` cuts the missions into shards.
- Workers. Shards are flown by whatever runs them, in any order, and twice if need be; nobody
  coordinates and nothing conflicts.
- Shard. A worker flies its missions and puts a file of each signal into the tree of the job
  (`fly_shard`).
- Marker. Then it leaves the shard's marker. A run flies the shards that have none, so that a kill
  at any moment costs the shards that were being flown.
- Finish. `complete` writes from the markers what is not in the shards, the metadata last, and
  `Job.give_name` gives the store its name in one step.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from factory.generation.completion import (
    complete,
    failures_in,
    finished,
    note,
)
from factory.generation.executors import local_pool
from factory.generation.job import Job, check_target, locked
from factory.sampling.draw import HOUR
from factory.sampling.recipe import Recipe
from twin.errors import StoreError, TwinError
from twin.numbers import processors
from twin.records.storage.sharded import check_empty, copy_into, load_zarr
from twin.records.storage.store_path import StorePath, files_at, store_path

if TYPE_CHECKING:
    from twin.records.storage.sharded import AnyStore


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
      executor: what flies the shards instead of such processes: any executor of
        `concurrent.futures`, that of a dask client too. It must reach `out` by the same path.
      resume: continue a store that an earlier run left incomplete; start one if there is none.
      overwrite: replace what is there, once the new store is complete.
      history: what the log beside the store says that the run was called with.

    Raises:
      StoreError: something is in the way, another recipe is to be resumed, or the disk refuses.
        Finished shards are kept, and `resume` goes on from them.
      TwinError: a mission that no attempt could fly, or a dead worker.
    """
    begun = time.perf_counter()
    store = store_path(out)
    if executor is not None and isinstance(store, Path):
        store = store.absolute()  # its processes may work in other folders
    if workers is not None and executor is not None:
        raise StoreError("give either workers or an executor, which has its own")
    if workers is not None and workers < 1:
        raise StoreError(f"--workers {workers} must be at least 1")
    job = Job(recipe, store)
    with reported(store):
        check_target(recipe, store, resume=resume, overwrite=overwrite)  # before a lock is made
        with locked(store):
            if check_target(recipe, store, resume=resume, overwrite=overwrite, alone=True):
                job.clear()
                return _summary(job, begun, [])
            job.begin()
            job.sweep()
            note(store, recipe, history)
            shards = missing_shards(job, job.layout.shards, watch)
            with contextlib.ExitStack() as pool:
                if executor is None and shards:
                    recipe.warm()
                    most = min(workers or processors(), len(shards))
                    executor = pool.enter_context(local_pool(most, fork=job.local))
                for shard, failures in _flown(executor, job, shards):
                    report_shard(job, shard, failures, watch)
            complete(job)
            job.give_name()
    return _summary(job, begun, shards)


@contextlib.contextmanager
def reported(store: StorePath) -> Iterator[None]:
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


def missing_shards(job: Job, shards: Sequence[int], watch: Watcher | None = None) -> list[int]:
    """Shards, of these, that have to be flown; the missions of the others are reported."""
    sizes = dict(job.tree.sizes())
    missing = [shard for shard in shards if finished(job, shard, sizes) is None]
    for shard in shards:
        if shard not in missing:
            report_shard(job, shard, (0,) * len(job.layout.missions_of(shard)), watch)
    return missing


def report_shard(job: Job, shard: int, failures: Sequence[int], watch: Watcher | None) -> None:
    """Report the missions of a finished shard, with the attempts that each needed beyond one."""
    if watch is not None:
        for mission, more in zip(job.layout.missions_of(shard), failures, strict=True):
            watch(job.recipe.plan.durations_s[mission] / HOUR, more)


def fly(job: Job, shard: int) -> tuple[int, ...]:
    """Fly a shard in a worker, which alone needs what flies; see `fly_shard`."""
    from factory.generation.shard import fly_shard

    return fly_shard(job, shard)


def _flown(
    pool: Executor | None, job: Job, shards: Sequence[int]
) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Have shards flown; yields each as it is kept, in any order, with its failures."""
    flying: dict[Future[tuple[int, ...]], int] = {}
    try:
        for shard in shards:
            assert pool is not None
            flying[pool.submit(fly, job, shard)] = shard
        load_zarr()  # while others fly
        for future in concurrent.futures.as_completed(flying):
            yield flying[future], future.result()
    except BrokenProcessPool as error:
        raise TwinError(
            "a worker process ended abruptly; too little memory is the usual reason. Finished "
            "shards are kept: --resume goes on from them, with fewer --workers if need be"
        ) from error


def _summary(job: Job, begun: float, flown: Iterable[int]) -> Summary:
    """Summary of a run that began at `begun` [s] of `perf_counter` and flew some shards."""
    plan, layout = job.recipe.plan, job.layout
    missions = [mission for shard in flown for mission in layout.missions_of(shard)]
    return Summary(
        store=job.store,
        missions=len(plan),
        hours=plan.hours,
        flown=len(missions),
        flown_hours=sum(plan.durations_s[mission] for mission in missions) / HOUR,
        failed=failures_in(job.store),
        wall_s=time.perf_counter() - begun,
        stored_bytes=files_at(job.store).stored_bytes(),
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
        copy_into(files_at(made), store)
    return dataclasses.replace(summary, store=store)
