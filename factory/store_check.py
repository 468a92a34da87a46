"""Store checks: checks of files and signals for every store, simulated or logged.

`kinematic_problems` compares position, velocity, attitude, rates and current of a mission.
"""

from __future__ import annotations

import contextlib
import functools
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.frames import euler_to_matrix
from twin.records.reader import MissionStore
from twin.records.schema import TIME
from twin.records.storage.checksums import damaged_files, has_checksums, read_checksums
from twin.records.storage.sharded import fast_reading
from twin.records.storage.store_path import StorePath

Block = Mapping[str, NDArray[np.float32]]
MissionCheck = Callable[[Any, int, Block, Mapping[str, "StoreCheck"]], None]
"""Function of a store, a mission's number, its signals, and the checks that record the results"""
MISSIONS_AT_ONCE = 16
"""Minimum number of missions that are read together; 16 of some hours take about 100 MB."""
SAMPLES_AT_ONCE = 16 * 7200
"""Minimum number of samples that are read together; a request for few samples would waste time"""
WHOLE_SHARD = 4
"""Largest shard that is read whole, as a multiple of the missions that are read together"""
MAX_NAMED = 20
"""Maximum number of problems of one check that are named; further ones are counted."""
NUMBER = re.compile(r"(?<=[\s=])-?\d[\d.e+-]*")
"""Number in a problem's text, but not in the name of a file or array"""


@dataclass
class StoreCheck:
    """Number of checks of one type, and the problems found."""

    name: str
    done: int = 0
    problems: list[str] = field(default_factory=list)

    def expect(self, condition: bool, problem: str) -> None:
        """Count a check; add `problem` if `condition` is False."""
        self.done += 1
        if not condition:
            self.problems.append(problem)

    def alike(self) -> list[str]:
        """List the problems in order. Problems that differ only in numbers, such as all missions of
        a damaged file, become the first of them with the count of the others."""
        groups: dict[str, list[str]] = {}
        for problem in self.problems:
            groups.setdefault(NUMBER.sub("#", problem), []).append(problem)
        return [
            first + (f" (and {len(others)} more like it)" if others else "")
            for first, *others in groups.values()
        ]


@dataclass(frozen=True)
class StoreReport:
    """Results of all checks of a store."""

    missions: int
    bytes_read: int
    checks: tuple[StoreCheck, ...]

    @property
    def ok(self) -> bool:
        """True if no check found a problem."""
        return not any(check.problems for check in self.checks)


def check_files(store: StorePath, workers: int = 1) -> StoreCheck:
    """Compare every file of a store with the list of checksums, in `workers` threads.

    Stores of versions before 0.2 have no list, so their files are not checked.
    """
    check = StoreCheck("files")
    if has_checksums(store):
        check.problems += [str(damage) for damage in damaged_files(store, workers=workers)]
        with contextlib.suppress(StoreError):  # a damaged list is a problem already
            check.done = len(read_checksums(store))
    return check


def check_missions(
    stored: MissionStore,
    names: list[str],
    checks: Mapping[str, StoreCheck],
    check: MissionCheck,
    watch: Callable[[int], None] | None,
    workers: int,
) -> int:
    """Read every mission, shard by shard, and call `check` with the store, the mission's number,
    its signals and `checks`.

    Args:
      check: a module's function, because other processes find it by its name.
      watch: function called with the number of missions just read.
      workers: number of processes that read; the results do not depend on it.

    Returns:
      The number of bytes read.
    """
    from factory.generation.executors import local_pool

    total, bytes_read = len(stored), 0
    size, fast = _blocks(stored, names)
    ranges = [range(first, min(first + size, total)) for first in range(0, total, size)]
    task = functools.partial(_check_range, stored.path, fast, names, tuple(checks), check)
    with contextlib.ExitStack() as stack:
        stack.callback(_opened.cache_clear)
        found: Iterable[tuple[dict[str, StoreCheck], int]] = map(task, ranges)
        if workers > 1 and len(ranges) > 1:
            pool = stack.enter_context(local_pool(min(workers, len(ranges)), fork=False))
            found = pool.map(task, ranges)
        for missions, (parts, read) in zip(ranges, found, strict=True):
            for name, part in parts.items():
                checks[name].done += part.done
                checks[name].problems += part.problems
            bytes_read += read
            if watch is not None:
                watch(len(missions))
    return bytes_read


def _blocks(stored: MissionStore, names: list[str]) -> tuple[int, bool]:
    """Number of missions to read together, and whether to use the fast pipeline. The fast pipeline
    verifies checksums only in shards that are read whole, so it is used for small shards."""
    size = max(MISSIONS_AT_ONCE, SAMPLES_AT_ONCE // max(stored.dataset.sizes[TIME], 1))
    arrays = (stored.dataset.variables[name].encoding for name in names)
    shard = math.lcm(*((e.get("shards") or e.get("chunks") or (1,))[0] for e in arrays))
    return (shard * max(size // shard, 1), True) if shard <= WHOLE_SHARD * size else (size, False)


def _check_range(
    store: StorePath,
    fast: bool,
    names: list[str],
    kinds: tuple[str, ...],
    check: MissionCheck,
    missions: range,
) -> tuple[dict[str, StoreCheck], int]:
    """Check some missions; returns the results and the number of bytes read."""
    stored, checks = _opened(store, fast), {kind: StoreCheck(kind) for kind in kinds}
    block = read_block(stored, names, missions, checks["chunks"])
    for row, mission in enumerate(missions):
        check(stored, mission, {name: values[row] for name, values in block.items()}, checks)
    return checks, sum(values.nbytes for values in block.values())


@functools.lru_cache(maxsize=1)
def _opened(store: StorePath, fast: bool) -> MissionStore:
    """Open a store once in each process, with the fast pipeline or with zarr's own. The fast one
    takes a twentieth of the time if missions are short."""
    from factory.generation.generated_store import open_missions

    with fast_reading(store) if fast else contextlib.nullcontext():
        return open_missions(store)


def read_block(run: MissionStore, names: list[str], missions: range, check: StoreCheck) -> Block:
    """Read all signals of some missions. If that fails, read mission by mission with zarr's own
    pipeline, which compares each checksum, to find the damage."""
    from factory.generation.generated_store import open_missions

    block: dict[str, NDArray[np.float32]] = {}
    for name in names:
        check.done += len(missions)
        try:
            block[name] = run.dataset[name][missions.start : missions.stop].values
            continue
        except Exception:
            pass  # one of these missions is damaged: each is read alone below
        rows = []
        with open_missions(run.path) as careful:
            for mission in missions:
                try:
                    rows.append(careful.row(name, mission))
                except StoreError as error:
                    check.problems.append(str(error))
                    rows.append(np.full(run.dataset.sizes[TIME], np.nan, np.float32))
        block[name] = np.stack(rows)
    return block


def check_signal(
    what: str,
    name: str,
    row: NDArray[np.float32],
    samples: int,
    checks: Mapping[str, StoreCheck],
    *,
    complete: bool,
    limits: tuple[float, float],
) -> NDArray[np.float32]:
    """Check a signal: NaN after `samples`, values within `limits`, and no NaN if `complete`.
    Returns the signal without padding; `what` names the mission in problems."""
    inside = row[:samples]
    problem = f"{what}: {name} has values after its {samples} samples"
    checks["padding"].expect(bool(np.isnan(row[samples:]).all()), problem)
    finite = np.isfinite(inside)
    if complete:
        checks["finite"].expect(
            bool(finite.all()),
            f"{what}: {name} is not finite in {len(inside) - finite.sum()} samples, first at "
            f"sample {int(np.argmin(finite))}",
        )
    low, high = limits
    values = inside[finite]
    least, most = (float(values.min()), float(values.max())) if values.size else limits
    checks["range"].expect(
        low <= least and most <= high,
        f"{what}: {name} runs from {least:g} to {most:g}, possible are {low:g} to {high:g}",
    )
    return inside


Array = NDArray[np.float64]

STEP_TOLERANCE_M = 0.3
"""[m] Largest difference of position change and integrated velocity in a step; a launch has 0.08"""
DRIFT_TOLERANCE_M = 1.0
"""[m] Largest sum of these differences over a mission"""
VELOCITY_TOLERANCE = 1e-4
"""[m/s] Largest velocity over ground minus (through the water + current); rounding causes 2e-6"""
TURN_TOLERANCE = 0.2
"""[rad] Largest sum of a mission's attitude changes minus rates; inflections cause 0.03"""


def kinematic_problems(truth: Mapping[str, Array], period: float) -> list[str]:
    """Find contradictions between position, velocity, attitude, rates and current of a mission.

    Args:
      truth: true_* signals of shape (time,), angles in degrees as stored.
      period: [s] Time between samples.
    """
    position = _columns(truth, "true_", "north", "east", "depth")
    velocity = _columns(truth, "true_velocity_", "north", "east", "down")
    through = _columns(truth, "true_", "surge", "sway", "heave")
    current = _columns(truth, "true_current_", "north", "east", "down")
    rates = _columns(truth, "true_", "roll_rate", "pitch_rate", "yaw_rate")
    angles = np.radians(_columns(truth, "true_", "roll", "pitch", "heading"))
    if not all(np.isfinite(a).all() for a in (position, velocity, through, current, rates, angles)):
        return []  # `check_signal` reports the NaN
    to_ned = euler_to_matrix(*angles.T)
    moved = np.diff(position, axis=0) - period * (velocity[1:] + velocity[:-1]) / 2
    turn = np.einsum("tji,tjk->tik", to_ned[:-1], to_ned[1:])
    # (R - R') / 2 of a rotation R is, as a vector, its axis times the sine of its angle
    angle = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0],
         turn[:, 1, 0] - turn[:, 0, 1]], axis=-1
    )  # fmt: skip
    sine = np.linalg.norm(angle, axis=-1)
    turned = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))
    angle *= np.divide(turned, sine, out=np.ones_like(sine), where=sine > 0.0)[:, None]
    over_ground = np.einsum("tij,tj->ti", to_ned, through) + current
    turning = np.cumsum(angle - period * (rates[1:] + rates[:-1]) / 2, axis=0)
    figures = (
        ("velocity over ground is not velocity through the water plus current",
         over_ground - velocity, VELOCITY_TOLERANCE, "m/s"),
        ("position does not follow velocity", moved, STEP_TOLERANCE_M, "m"),
        ("position drifts from the summed velocity", np.cumsum(moved, axis=0), DRIFT_TOLERANCE_M,
         "m"),
        ("attitude does not follow the rates", turning, TURN_TOLERANCE, "rad"),
    )  # fmt: skip
    problems = []
    for what, errors, tolerance, unit in figures:
        error = np.abs(errors).max(axis=-1, initial=0.0)
        if error.size and (most := error.max()) > tolerance:
            at = f"at sample {int(np.argmax(error))}, at most {tolerance:g}"
            problems.append(f"{what}: {most:.3g} {unit} {at}")
    return problems


def _columns(signals: Mapping[str, Array], prefix: str, *names: str) -> Array:
    return np.stack([signals[prefix + name] for name in names], axis=-1)
