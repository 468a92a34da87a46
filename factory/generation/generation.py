"""Generation: make the store of a recipe, in parallel and resumable at any moment.

Steps that make a store:

- Plan. The recipe gives the duration of each mission. The recipe and a mission's number alone
  decide the mission's bytes. `Layout` groups the missions into shards.
- Workers. Any worker can fly any shard, in any order, even twice, without coordination.
- Shard. A worker flies the shard's missions and puts a file of each signal into the tree of the job
  (`fly_shard`).
- Marker. The worker then writes the shard's marker. A run flies only shards without a marker, so a
  kill costs only the shards in flight.
- Finish. `complete` writes all other arrays from the markers, the metadata last, and
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
"""Function called with the duration [h] of a finished mission and its number of failed attempts"""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Summary of a run of `generate`."""

    store: StorePath | AnyStore
    """Path, address or open zarr store with the missions"""
    missions: int
    hours: float
    """[h] Simulated time of all missions in the store"""
    flown: int
    """Number of missions that this run flew; all others were finished before"""
    flown_hours: float
    """[h] Simulated time of the missions that this run flew"""
    failed: int
    """Number of failed and replaced attempts in the whole store"""
    wall_s: float
    """[s] Elapsed time of this run"""
    stored_bytes: int
    """[byte] Size of the store's files"""

    @property
    def times_real_time(self) -> float:
        """[1] Simulated time over elapsed time of this run."""
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
      workers: number of local processes; None: the number of CPUs that this process may use.
      out: a path, or an address such as s3://bucket/missions.zarr.
      executor: executor of `concurrent.futures` that flies the shards instead of local processes,
        such as a dask client's. It must reach `out` by the same path.
      resume: complete an unfinished store; start the store if there is none.
      overwrite: replace an existing store once the new store is complete.
      history: command to write into the log beside the store.

    Raises:
      StoreError: `out` exists, the unfinished store has another recipe, or the disk refuses.
        Finished shards are kept, and `resume` continues from them.
      TwinError: all attempts at a mission failed, or a worker died.
    """
    begun = time.perf_counter()
    store = store_path(out)
    if executor is not None and isinstance(store, Path):
        store = store.absolute()  # the executor's processes may have other working folders
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
                for shard, failures in _fly_shards(executor, job, shards):
                    report_shard(job, shard, failures, watch)
            complete(job)
            job.give_name()
    return _summary(job, begun, shards)


@contextlib.contextmanager
def reported(store: StorePath) -> Iterator[None]:
    """Turn errors of a disk or storage into a StoreError that says how to continue."""
    try:
        yield
    except OSError as error:
        what = f"cannot write {error.filename or store}: {error.strerror or error}"
        if isinstance(store, Path):
            what += "; finished missions are kept: make room or a writable place, then continue "
            what += "with --resume"
        elif not isinstance(error, PermissionError | NotADirectoryError):  # before any mission
            what += "; finished missions are kept: continue with --resume"
        raise StoreError(what) from error


def missing_shards(job: Job, shards: Sequence[int], watch: Watcher | None = None) -> list[int]:
    """Find the shards that have to be flown; report the missions of the finished shards."""
    sizes = dict(job.tree.sizes())
    missing = [shard for shard in shards if finished(job, shard, sizes) is None]
    for shard in shards:
        if shard not in missing:
            report_shard(job, shard, (0,) * len(job.layout.missions_of(shard)), watch)
    return missing


def report_shard(job: Job, shard: int, failures: Sequence[int], watch: Watcher | None) -> None:
    """Report each mission of a finished shard to `watch`, with its number of failed attempts."""
    if watch is not None:
        for mission, more in zip(job.layout.missions_of(shard), failures, strict=True):
            watch(job.recipe.plan.durations_s[mission] / HOUR, more)


def fly(job: Job, shard: int) -> tuple[int, ...]:
    """Fly a shard with `fly_shard`, which only workers import."""
    from factory.generation.shard import fly_shard

    return fly_shard(job, shard)


def _fly_shards(
    pool: Executor | None, job: Job, shards: Sequence[int]
) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Fly shards in a pool; yields each finished shard, in any order, with its failed attempts."""
    flying: dict[Future[tuple[int, ...]], int] = {}
    try:
        for shard in shards:
            assert pool is not None
            flying[pool.submit(fly, job, shard)] = shard
        load_zarr()  # imports zarr while the workers fly
        for future in concurrent.futures.as_completed(flying):
            yield flying[future], future.result()
    except BrokenProcessPool as error:
        raise TwinError(
            "a worker process ended abruptly; too little memory is the usual reason. Finished "
            "shards are kept: --resume goes on from them, with fewer --workers if need be"
        ) from error


def _summary(job: Job, begun: float, flown: Iterable[int]) -> Summary:
    """Summarise a run that began at `begun` [s] of `perf_counter` and flew the shards `flown`."""
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
    """Make the missions in a temporary folder of this machine, then copy all files into `store`.

    For a store with sessions, such as icechunk's, the caller must commit the session afterwards.

    Args:
      store: empty zarr store, open for writing.
      workers, executor, watch: as in `generate`.

    Returns:
      Summary of the run, with `store`.

    Raises:
      StoreError: the store is read-only or not empty, or as `generate`.
    """
    check_empty(store)
    with tempfile.TemporaryDirectory(prefix="glider-twin-") as folder:
        made = Path(folder) / "missions.zarr"
        summary = generate(recipe, made, workers=workers, executor=executor, watch=watch)
        copy_into(files_at(made), store)
    return dataclasses.replace(summary, store=store)
