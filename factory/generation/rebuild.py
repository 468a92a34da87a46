"""Repair: a damaged store made whole again, bit for bit, by flying only the damaged missions.

Everything in a store follows from its recipe. What the list of checksums says is sound is kept; of
a damaged file of a signal only the missions whose chunks cannot be decoded are flown again; the
rest is drawn and written again. The repaired store takes the place of the damaged one in one step.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.generation.attempts import FailedAttempt, FlownMission
from factory.generation.bookkeeping import rows
from factory.generation.completion import (
    FAILED_ATTEMPT,
    FAILED_MISSION,
    FAILED_REASON,
    FAILED_TIME,
    RECIPE_COPY,
    complete,
)
from factory.generation.executors import Job
from factory.generation.generation import told
from factory.generation.mission_block import Signals, fly_whole
from factory.generation.site import Site, locked
from factory.generation.store_assembly import leave_shard, open_tree
from factory.generation.target import give_name
from factory.sampling.draw import sensor_seed
from factory.sampling.drawn_plan import samples_in
from factory.sampling.recipe import Recipe, read_recipe, recipe_document
from twin.errors import StoreError
from twin.records import attributes as names
from twin.records.coordinates import COORDINATE_DTYPES, COORDINATES
from twin.records.schema import VARIABLES
from twin.records.storage.checksums import damaged_files, has_checksums, read_checksums
from twin.records.storage.sharded import DTYPE, METADATA, fill_value, read_rows
from twin.records.storage.store_path import StorePath, store_path
from twin.records.storage.stored_files import FileSum, LocalFiles


@dataclass(frozen=True, kw_only=True)
class Repaired:
    """What a repair did."""

    damaged: tuple[str, ...]
    """files that were not what the store's list says"""
    flown: tuple[int, ...]
    """missions that were flown again"""


def repair(store: str | StorePath) -> Repaired:
    """Make a damaged store of `factory generate` whole again.

    Raises:
      StoreError: both copies of its recipe are damaged, it was made with other versions of what
        can change a bit, or it came out otherwise; it is left as it is.
    """
    path = _local(store)
    damaged = {damage.path for damage in damaged_files(path)}
    if not damaged:
        return Repaired(damaged=(), flown=())
    recipe = _recipe(path)
    job = Job(recipe, Site(path, recipe.digest))
    with told(path), locked(path):
        job.site.files.remove_all()
        job.site.begin(recipe)
        wreck = _Wreck(job, path, damaged)
        for shard in job.layout.shards:
            wreck.mend(shard)
        files, _ = complete(job)
        wreck.compare(files)
        give_name(job)
    return Repaired(damaged=tuple(sorted(damaged)), flown=tuple(sorted(wreck.flown)))


class _Wreck:
    """A damaged store whose sound parts are used."""

    def __init__(self, job: Job, path: Path, damaged: set[str]):
        self.job, self.path, self.damaged = job, path, damaged
        self.tree = Path(job.site.tree.name)
        self.flown: dict[int, tuple[FlownMission, Signals]] = {}
        try:
            self.sums: dict[str, FileSum] | None = read_checksums(path)
        except StoreError:
            self.sums = None  # the list is what is damaged: chunks tell by their own checksums
        self.attempts = self._rows(names.ATTEMPT)

    def mend(self, shard: int) -> None:
        """Put a shard into the tree of the new store."""
        missions = self.job.layout.missions_of_shard(shard)
        target, files = open_tree(self.job), dict[str, FileSum]()
        try:
            for name in self._signals(shard):
                key = f"{name}/c/{shard}/0"
                if self.sums is not None and key not in self.damaged:
                    _link(self.path / key, self.tree / key)
                    files[key] = self.sums[key]
                    continue
                kind = COORDINATE_DTYPES.get(name, DTYPE)
                values = np.full((len(missions), target.samples), fill_value(kind), kind)
                for row, mission in enumerate(missions):
                    found = self._row(name, mission)
                    if found is None:
                        signal = self._fly(mission)[1].get(name, np.zeros(0, kind))
                        values[row, : len(signal)] = signal
                    else:
                        values[row] = found
                _, files[key] = target.write_shard(shard, name, values)
        finally:
            target.close()
        flown = [self._mission(mission) for mission in missions]
        failures = [failure for one in flown for failure in one.failures]
        leave_shard(self.job, shard, files, rows(self.job.recipe, flown), failures)

    def compare(self, files: dict[str, FileSum]) -> None:
        """Raise StoreError when the new store is not what the old one's list says."""
        if self.sums is not None and files != self.sums:
            both = files.keys() | self.sums.keys()
            other = sorted(key for key in both if files.get(key) != self.sums.get(key))
            raise StoreError(
                f"{self.path} came out otherwise than it was ({', '.join(other[:3])}): it was made "
                "on a machine that rounds differently; it is left as it is"
            )

    def _signals(self, shard: int) -> list[str]:
        """Signals of which the shard has a file, by the list; else by what is there."""
        keys: Iterable[str] = self.sums or (
            path.relative_to(self.path).as_posix() for path in self.path.glob(f"*/c/{shard}/0")
        )
        end = f"/c/{shard}/0"
        found = [key.removesuffix(end) for key in keys if key.endswith(end)]
        return [name for name in found if name in VARIABLES or name in COORDINATES]

    def _fly(self, mission: int) -> tuple[FlownMission, Signals]:
        if mission not in self.flown:
            (self.flown[mission],) = fly_whole(self.job.recipe, [mission])
        return self.flown[mission]

    def _mission(self, mission: int) -> FlownMission:
        """A mission's bookkeeping, drawn again; flown where its attempts are not known."""
        recipe = self.job.recipe
        failures = None if self.attempts is None else self._failures_of(mission)
        if self.attempts is None or failures is None:
            return self._fly(mission)[0]
        attempt = int(self.attempts[mission])
        return FlownMission(
            mission=mission,
            attempt=attempt,
            samples=samples_in(recipe.plan.durations_s[mission]),
            parameters=recipe.parameters(mission, attempt),
            sensors=recipe.suite.draw(sensor_seed(recipe.seed, mission, attempt)),
            failures=failures,
        )

    def _failures_of(self, mission: int) -> tuple[FailedAttempt, ...] | None:
        assert self.attempts is not None
        if not self.attempts[mission]:
            return ()
        table = []
        for name in (FAILED_MISSION, FAILED_ATTEMPT, FAILED_REASON, FAILED_TIME):
            column = self._rows(name)
            if column is None:
                return None
            table.append(column)
        found = (FailedAttempt.of(*row) for row in zip(*table, strict=True))
        return tuple(one for one in found if one.mission == mission)

    def _rows(self, name: str) -> NDArray[Any] | None:
        """An array that is no signal; None where it is damaged."""
        if self.sums is None or any(key.startswith(f"{name}/") for key in self.damaged):
            return None
        return read_rows(self.path, name)

    def _row(self, name: str, mission: int) -> NDArray[Any] | None:
        """A signal of a mission, padding included; None where it cannot be decoded."""
        if f"{name}/{METADATA}" in self.damaged:
            return None
        try:
            return read_rows(self.path, name, mission)
        except Exception:  # whatever a decoder raises
            return None


def _local(store: str | StorePath) -> Path:
    """A store of this machine; raises StoreError for others."""
    path = store_path(store)
    if not isinstance(path, Path):
        raise StoreError(
            f"{path} lies in an object storage, where no repair is one step: copy it "
            "to this machine, repair the copy and put that in its place"
        )
    return path


def _recipe(path: Path) -> Recipe:
    """The recipe, from whichever of its two copies is sound."""
    wrong = ""
    for key in (METADATA, f"{RECIPE_COPY}/{METADATA}"):
        try:
            return read_recipe(recipe_document(_attributes(path, key)))
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            wrong = f"{key}: {error}"
    raise StoreError(
        f"{path} cannot be repaired, its recipe cannot be read ({wrong}); make it again"
    )


def _link(old: Path, new: Path) -> None:
    """The same file in both trees; a copy where the file system has no links."""
    new.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(old, new)
    except OSError:
        shutil.copy2(old, new)


def lost(store: str | StorePath) -> list[str] | None:
    """What is damaged of a store that no recipe can make again; None for a generated one.

    Raises:
      StoreError: there is no store, or it has no list of checksums.
    """
    path = _local(store)
    if not path.is_dir():
        raise StoreError(f"no store at {path}")
    if not has_checksums(path):
        raise StoreError(
            f"store {path} has no list of checksums, an older glider-twin wrote it: `factory "
            "verify` checks what it holds, and what is damaged must be made again"
        )
    if (path / RECIPE_COPY / METADATA).is_file() or _generated(path):
        return None
    return [str(damage) for damage in damaged_files(path)]


def _generated(path: Path) -> bool:
    try:
        return names.SETTINGS in _attributes(path, METADATA)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def _attributes(path: Path, key: str) -> dict[str, Any]:
    """The attributes of a group's metadata, whatever else is damaged."""
    found: dict[str, Any] = json.loads(LocalFiles(path).read_small(key))["attributes"]
    return found
