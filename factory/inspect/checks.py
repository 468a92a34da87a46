"""Checks: what is asked of every store, simulated or logged, and how a check says what it found."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.records.checksums import damaged_files, has_checksums, read_checksums
from twin.records.reader import MissionStore
from twin.records.schema import TIME
from twin.records.store_path import StorePath

Block = Mapping[str, NDArray[np.float32]]
MISSIONS_AT_ONCE = 16
"""Missions that are read and checked together: some 100 MB of hours of all signals"""
MAX_NAMED = 20
"""Problems of one check that are named; the others are counted."""


@dataclass
class Check:
    """One kind of check."""

    name: str
    done: int = 0
    problems: list[str] = field(default_factory=list)

    def expect(self, condition: bool, problem: Callable[[], str]) -> None:
        """Count a check, and its problem if it failed."""
        self.done += 1
        if not condition:
            self.problems.append(problem())


@dataclass(frozen=True)
class Report:
    """The outcome of all checks."""

    missions: int
    bytes_read: int
    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """No problem at all."""
        return not any(check.problems for check in self.checks)


def check_files(store: StorePath) -> Check:
    """Compare every file of a store with its list of checksums.

    Stores of versions before 0.2 have no list: nothing is checked of them.
    """
    check = Check("files")
    if has_checksums(store):
        check.problems += [str(damage) for damage in damaged_files(store)]
        with contextlib.suppress(StoreError):  # a damaged list is a problem already
            check.done = len(read_checksums(store))
    return check


def check_missions(
    stored: MissionStore,
    names: list[str],
    checks: Mapping[str, Check],
    check: Callable[[int, Block], None],
    watch: Callable[[int], None] | None,
) -> int:
    """Read every mission shard by shard and call `check` with its number and its signals.

    `watch` is called with the number of missions just read; returned are the bytes read.
    """
    bytes_read = 0
    for first in range(0, len(stored), MISSIONS_AT_ONCE):
        missions = range(first, min(first + MISSIONS_AT_ONCE, len(stored)))
        block = read_block(stored, names, missions, checks["chunks"])
        bytes_read += sum(values.nbytes for values in block.values())
        for row, mission in enumerate(missions):
            check(mission, {name: values[row] for name, values in block.items()})
        if watch is not None:
            watch(len(missions))
    return bytes_read


def read_block(run: MissionStore, names: list[str], missions: range, check: Check) -> Block:
    """All signals of some missions; where that fails, mission by mission to find the damage."""
    block: dict[str, NDArray[np.float32]] = {}
    for name in names:
        check.done += len(missions)
        try:
            block[name] = run.dataset[name][missions.start : missions.stop].values
            continue
        except Exception:
            pass  # somewhere in these missions: each is tried on its own below
        rows = []
        for mission in missions:
            try:
                rows.append(run.row(name, mission))
            except StoreError as error:
                check.problems.append(str(error))
                rows.append(np.full(run.dataset.sizes[TIME], np.nan, np.float32))
        block[name] = np.stack(rows)
    return block


def check_padding(
    what: str, name: str, padding: NDArray[np.float32], samples: int, check: Check
) -> None:
    """Nothing but NaN after the `samples` of `what`."""
    check.expect(
        bool(np.isnan(padding).all()),
        lambda: f"{what}: {name} has values after its {samples} samples",
    )


def check_finite_range(
    what: str,
    name: str,
    inside: NDArray[np.float32],
    complete: bool,
    limits: tuple[float, float],
    finite_check: Check,
    range_check: Check,
) -> None:
    """A signal of `what` without holes where it must be `complete`, and within its `limits`."""
    finite = np.isfinite(inside)
    if complete:
        finite_check.expect(
            bool(finite.all()),
            lambda: (
                f"{what}: {name} is not finite in {len(inside) - finite.sum()} samples, first "
                f"at sample {int(np.argmin(finite))}"
            ),
        )
    low, high = limits
    values = inside[finite]
    least, most = (float(values.min()), float(values.max())) if values.size else limits
    range_check.expect(
        low <= least and most <= high,
        lambda: f"{what}: {name} runs from {least:g} to {most:g}, possible are {low:g} to {high:g}",
    )
