"""Shard: the unit of work, which flies some missions and writes their signals and a marker.

A task flies the missions of a shard and encodes each into files of a temporary folder. The task
then moves the files into the tree of the job, and writes the marker when all files are on the disk.
A shard without a marker is flown again. Two processes that fly one shard at once make the same
bytes. If a mission fails, its parameters are sampled again with another seed, that of the next
attempt. Recipe and number of a mission decide all these seeds, and thereby its bytes.
"""

from __future__ import annotations

import contextlib
import ctypes
import re
import socket
import tempfile
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.generation.completion import FailedAttempt, FlownMission, Marker, finished
from factory.generation.job import Job
from factory.sampling.conditions import mission_coordinates, mission_place
from factory.sampling.draw import samples_in, sensor_seed
from factory.sampling.fly import REPLACED, Draw, FlownSignals, fly_abreast
from factory.sampling.recipe import Recipe, versions
from twin.errors import InputError, SimulationUnstable, StepTooLong, StoreError, TwinError
from twin.physics.mujoco_model import quiet_mujoco
from twin.records.presence import RECIPE
from twin.records.schema import VARIABLES
from twin.records.storage.disk import WRITING
from twin.records.storage.sharded import ShardWriter, stored_values
from twin.vehicle.consumption import ENERGY

Signals = Mapping[str, NDArray[Any]]
"""Signals of one mission by name, each (samples,), in the values of the store"""
MOST_SAMPLES = 500_000
"""Maximum number of samples in a batch of missions; each sample takes about 400 bytes of memory."""
MAX_ATTEMPTS = 20
"""Number of failed attempts at a mission after which its distributions count as impossible"""
_TASK_LOCK = threading.RLock()
_TRIM = getattr(ctypes.CDLL(None), "malloc_trim", None)
"""glibc's function that returns freed memory to the system; None with another C library"""


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Run one task at a time in this process, even if the executor has threads. MuJoCo's warnings,
    numba's tables and staging folders belong to the whole process.

    Afterwards return freed memory to the system. glibc would keep it in fragments, and a process
    that flies for days would grow.
    """
    with _TASK_LOCK:
        try:
            yield
        finally:
            if _TRIM is not None:
                _TRIM(0)


@alone()
def fly_shard(job: Job, number: int) -> tuple[int, ...]:
    """Fly the missions of a shard and put the shard's files into the tree of the job.

    Returns:
      The number of failed attempts at each mission.

    Raises:
      InputError: all attempts at a mission failed. OSError: the disk refuses.
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
    beside = tempfile.TemporaryDirectory(
        prefix=f".shard{WRITING}",
        dir=job.folder if isinstance(job.folder, Path) else None,
        ignore_cleanup_errors=True,
    )
    with beside as place, ShardWriter(Path(place), missions=size, samples=samples) as writer:
        for group in together(recipe, layout.missions_of(number)):
            for one, signals in fly_missions(recipe, group):
                flown.append(one)
                writer.add(signals)
        sums = {f"{name}/c/{number}/0": one for name, one in writer.finish().items()}
        marker = Marker(number, job.digest, sums, flown, versions(recipe.vehicle))
        before = finished(job, number)
        if before is None:
            job.tree.take({key: writer.folder / key.partition("/")[0] for key in sums})
            job.files.write(job.marker(number), marker.to_bytes(), safe=True)
        elif before.files != sums:
            raise StoreError(_describe_difference(number, before, marker))
    return tuple(len(one.failures) for one in flown)


def _describe_difference(number: int, before: Marker, now: Marker) -> str:
    """Error message for two processes that made a shard with different bytes."""
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
    """Group missions into batches whose logs fit into a worker's memory."""
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


def fly_missions(recipe: Recipe, missions: Sequence[int]) -> list[tuple[FlownMission, Signals]]:
    """Fly missions, as a batch if the recipe's engine can; record and replace failed attempts.

    Returns:
      The record of each mission, and its signals and coordinates for the store.

    Raises:
      InputError: all attempts at a mission failed; the message names the distributions to narrow.
    """
    made: dict[int, tuple[FlownMission, Signals]] = {}
    failures: dict[int, list[FailedAttempt]] = {mission: [] for mission in missions}

    def failed(mission: int, error: TwinError) -> None:
        attempt, time_s = len(failures[mission]), getattr(error, "time_s", None)
        failures[mission].append(FailedAttempt(mission, attempt, reason(error), time_s))
        if attempt + 1 == MAX_ATTEMPTS:
            raise InputError(
                f"mission {mission} failed {MAX_ATTEMPTS} times, last: {reason(error)}; "
                f"{_advise_narrowing(recipe, reason(error))}"
            )

    while len(made) < len(missions):
        draws: dict[int, Draw] = {}
        for mission in missions:
            if mission in made:
                continue
            attempt = len(failures[mission])
            try:
                parameters = recipe.parameters(mission, attempt)
            except REPLACED as error:
                failed(mission, error)
                continue
            seed = sensor_seed(recipe.seed, mission, attempt)
            draws[mission] = Draw(parameters=parameters, sensor_seed=seed)
        numbers, current = list(draws), recipe.given_current
        with quiet_mujoco():  # no warnings: an unstable mission is recorded and replaced
            for index, flight in fly_abreast(
                list(draws.values()), recipe.vehicle, recipe.suite, current=current,
                engine=recipe.engine,
            ):  # fmt: skip
                mission = numbers[index]
                if isinstance(flight, TwinError):
                    failed(mission, flight)
                    continue
                parameters, signals = draws[mission].parameters, rounded_signals(flight)
                place = mission_place(parameters, current)
                flown = FlownMission(
                    mission=mission,
                    attempt=len(failures[mission]),
                    samples=len(flight.trajectory.time),
                    parameters=parameters,
                    place=place,
                    sensors=flight.drawn,
                    failures=tuple(failures[mission]),
                )
                made[mission] = flown, {**signals, **mission_coordinates(signals, place)}
    return [made[mission] for mission in missions]


def _advise_narrowing(recipe: Recipe, reason: str) -> str:
    """Advice to narrow the distributions that `reason` names, or else those that the user set."""
    words = set(re.findall(r"\w+", reason))
    named = [name for name in recipe.table if name.partition(".")[2] in words] or [*recipe.changes]
    if not named:
        return f"preset {recipe.preset!r} does not suit vehicle {recipe.vehicle.name!r}"
    now = ", ".join(f"{name} (now {recipe.distributions[name].text()})" for name in named)
    return f"narrow with --set: {now}"


def reason(error: TwinError) -> str:
    """Describe why an attempt failed, in words that every replay repeats."""
    if isinstance(error, SimulationUnstable) and not isinstance(error, StepTooLong):
        return f"went unstable at {error.time_s:.1f} s"
    return str(error)


def rounded_signals(flight: FlownSignals) -> dict[str, NDArray[np.float32]]:
    """Round every signal to the store's decimals, in the schema's order.

    Energy is left out, because `MissionStore.energy` computes it from the stored signals and
    vehicle; it would add a fifteenth to the size of a store.
    """
    signals = flight.signals
    return {
        name: stored_values(signals[name], variable.decimals)
        for name, variable in VARIABLES.items()
        if name in signals and not name.startswith(ENERGY)
    }
