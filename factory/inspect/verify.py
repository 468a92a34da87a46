"""Verify: read every chunk of a store and check that it says something possible.

The limits are wide: what they catch is damage, wrong units and wrong signs, not unusual missions.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.recipe.kinds.surface import SURFACE
from factory.recipe.plan import HOUR
from factory.recipe.presets import PRESETS
from factory.recipe.recipe import VERSIONS, Recipe, sha256, versions
from factory.recipe.sampling import Parameters, sensor_seed
from factory.stores.generated import GeneratedStore
from twin.errors import StoreError, TwinError
from twin.frames import euler_to_matrix
from twin.physics.part_signals import simulated_signals
from twin.records.attributes import (
    ATTEMPT,
    DURATION,
    N_SAMPLES,
    SPLIT,
    SPLITS,
    VEHICLE_MJCF,
    VEHICLE_SHA256,
)
from twin.records.checksums import damaged_files, has_checksums, read_checksums
from twin.records.limits import simulated_limits
from twin.records.reader import MissionStore
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.store_path import StorePath

Array = NDArray[np.float64]
Block = Mapping[str, NDArray[np.float32]]

STEP_TOLERANCE_M = 0.3
"""[m] position change of one sample against its velocities; a launch from rest makes 0.08"""
DRIFT_TOLERANCE_M = 1.0
"""[m] the same, summed over a mission"""
VELOCITY_TOLERANCE = 1e-4
"""[m/s] over ground = through the water + current; rounding makes 2e-6"""
TURN_TOLERANCE = 0.2
"""[rad] attitude changes against the rates, summed over a mission; inflections make 0.03"""
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


def verify_store(run: GeneratedStore, watch: Callable[[int], None] | None = None) -> Report:
    """Read and check all that the store says; `check_files` compares its files. `watch` is called
    with the number of missions just read."""
    names = run.signals()
    checks = {
        name: Check(name)
        for name in ("metadata", "parameters", "chunks", "padding", "finite", "range", "kinematics")
    }
    _check_metadata(run, names, checks["metadata"])
    if checks["metadata"].problems:
        return Report(len(run), 0, tuple(checks.values()))
    _check_parameters(run, checks["parameters"])
    bytes_read = check_missions(
        run, names, checks, lambda mission, rows: _check_mission(run, mission, rows, checks), watch
    )
    return Report(len(run), bytes_read, tuple(checks.values()))


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


def _check_metadata(run: GeneratedStore, names: list[str], check: Check) -> None:
    data = run.dataset
    check.problems += [f"array {n!r} is gone" for n in run.gone_arrays()]
    check.expect(
        sha256(run.attributes[VEHICLE_MJCF]) == run.attributes[VEHICLE_SHA256],
        lambda: "the vehicle's MJCF text does not have the recorded SHA-256",
    )
    if check.problems:
        return  # which signals there must be depends on the vehicle
    for needed in (N_SAMPLES, SPLIT, DURATION, ATTEMPT, TIME, MISSION):
        check.expect(needed in data.variables, lambda n=needed: f"array {n!r} is missing")  # type: ignore[misc]
    for name in simulated_signals(run.vehicle):
        check.expect(name in names, lambda n=name: f"signal {n!r} is missing")  # type: ignore[misc]
    for name in names:
        units = data[name].attrs.get("units")
        wanted = VARIABLES[name].units
        check.expect(
            units == wanted,
            lambda n=name, u=units, w=wanted: f"{n}: units {u!r}, not {w!r}",  # type: ignore[misc]
        )
    if check.problems:
        return
    period = float(run.declared_period or 0.0)
    time = run.array(TIME)
    check.expect(
        bool(np.array_equal(time, np.arange(len(time)) * period)),
        lambda: f"time does not run from 0 in steps of {period:g} s",
    )
    for mission, samples in enumerate(run.samples):
        wanted_samples = round(float(run.array(DURATION)[mission]) / period) + 1
        check.expect(
            samples == wanted_samples <= len(time),
            lambda m=mission, s=samples, w=wanted_samples: f"mission {m}: {s} samples, not {w}",  # type: ignore[misc]
        )


def _check_parameters(run: GeneratedStore, check: Check) -> None:
    """Every drawn value is one that its distribution allows."""
    preset = PRESETS.get(str(run.settings["preset"]))
    given = preset is not None and preset.fixed_missions
    if not given:
        counts = {split: run.splits.count(split) for split in SPLITS}
        check.expect(min(counts.values()) >= 1, lambda: f"a split without a mission: {counts}")
        hours = float(run.settings["hours"])
        check.expect(
            abs(run.hours - hours) < 1.0 / HOUR,
            lambda: f"the missions last {run.hours:g} h, not {hours:g} h",
        )
    recipe = None
    try:
        recipe = run.recipe
    except TwinError as error:
        # another program's missions cannot be drawn again here; its values are checked all the same
        if run.settings.get(VERSIONS) == versions():
            check.problems.append(str(error))
    for mission in range(len(run)):
        parameters = run.parameters(mission)
        other = "" if recipe is None else drawn_otherwise(run, recipe, mission, parameters)
        check.expect(not other, lambda m=mission, o=other: f"mission {m}: {o}")  # type: ignore[misc]
        drawn = [(name, value, False) for name, value in parameters.values.items()]
        drawn += [
            (name, value, segment["mission.kind"] == SURFACE.name)
            for segment in parameters.segments
            for name, value in segment.items()
        ]
        for name, value, surface in drawn:
            unused = value != value or (surface and name == "mission.kind")
            allowed = unused or given or run.distributions[name].allows(value)
            check.expect(
                allowed,
                lambda m=mission, n=name, v=value: (  # type: ignore[misc]
                    f"mission {m}: {n} = {v} cannot be drawn from {run.distributions[n].text()}"
                ),
            )


def drawn_otherwise(run: GeneratedStore, recipe: Recipe, mission: int, stored: Parameters) -> str:
    """What of a mission is not what its seed, number and attempt give; empty when all is."""
    attempt = run.attempt(mission)
    try:
        drawn = recipe.parameters(mission, attempt)
    except TwinError as error:
        return f"attempt {attempt} cannot be drawn: {error}"
    pairs: dict[str, tuple[Any, Any]] = {
        n: (stored.values.get(n), value) for n, value in drawn.values.items()
    }
    if len(stored.segments) != len(drawn.segments):
        pairs["segments"] = len(stored.segments), len(drawn.segments)
    for i, (one, other) in enumerate(zip(stored.segments, drawn.segments, strict=False)):
        pairs |= {f"segment {i} {n}": (one.get(n), value) for n, value in other.items()}
    constants = recipe.suite.draw(sensor_seed(recipe.seed, mission, attempt))
    kept = run.sensor_constants(mission)
    pairs |= {f"sensor {n}": (kept.get(n), value) for n, value in constants.items()}
    for name, (had, has) in pairs.items():
        if had != has and not (had != had and has != has):
            return f"{name} is {had}, and seed {recipe.seed} and attempt {attempt} give {has}"
    return ""


def _check_mission(
    run: GeneratedStore, mission: int, rows: Block, checks: Mapping[str, Check]
) -> None:
    samples = int(run.samples[mission])
    what = f"mission {mission}"
    for name, row in rows.items():
        inside, padding = row[:samples], row[samples:]
        check_padding(what, name, padding, samples, checks["padding"])
        check_finite_range(
            what, name, inside, not VARIABLES[name].gaps, simulated_limits(name), checks["finite"],
            checks["range"],
        )  # fmt: skip
    truth = {name: row[:samples].astype(float) for name, row in rows.items()}
    for problem in kinematic_problems(truth, run.period):
        checks["kinematics"].problems.append(f"mission {mission}: {problem}")
    checks["kinematics"].done += 4


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


def kinematic_problems(truth: Mapping[str, Array], period: float) -> list[str]:
    """What does not fit together among position, velocity, attitude, rates and current.

    Args:
      truth: true_* signals of shape (time,), degrees as stored.
      period: [s] between samples.
    """
    position = _columns(truth, "true_", "north", "east", "depth")
    velocity = _columns(truth, "true_velocity_", "north", "east", "down")
    through = _columns(truth, "true_", "surge", "sway", "heave")
    current = _columns(truth, "true_current_", "north", "east", "down")
    rates = _columns(truth, "true_", "roll_rate", "pitch_rate", "yaw_rate")
    angles = np.radians(_columns(truth, "true_", "roll", "pitch", "heading"))
    if not all(np.isfinite(a).all() for a in (position, velocity, through, current, rates, angles)):
        return []  # the check of finite values names them
    to_ned = euler_to_matrix(*angles.T)
    moved = np.diff(position, axis=0) - period * (velocity[1:] + velocity[:-1]) / 2
    turn = np.einsum("tji,tjk->tik", to_ned[:-1], to_ned[1:])
    # half the antisymmetric part of a rotation is its axis times the sine of its angle
    angle = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0],
         turn[:, 1, 0] - turn[:, 0, 1]], axis=-1
    )  # fmt: skip
    sine = np.linalg.norm(angle, axis=-1)
    turned = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))
    angle *= np.divide(turned, sine, out=np.ones_like(sine), where=sine > 0.0)[:, None]
    figures = (
        (
            "velocity over ground is not velocity through the water plus current",
            np.abs(np.einsum("tij,tj->ti", to_ned, through) + current - velocity),
            VELOCITY_TOLERANCE,
            "m/s",
        ),
        ("position does not follow velocity", np.abs(moved), STEP_TOLERANCE_M, "m"),
        (
            "position drifts from the summed velocity",
            np.abs(np.cumsum(moved, axis=0)),
            DRIFT_TOLERANCE_M,
            "m",
        ),
        (
            "attitude does not follow the rates",
            np.abs(np.cumsum(angle - period * (rates[1:] + rates[:-1]) / 2, axis=0)),
            TURN_TOLERANCE,
            "rad",
        ),
    )
    return [
        f"{what}: {error.max():.3g} {unit} at sample {int(np.argmax(error.max(axis=-1)))}, "
        f"at most {tolerance:g}"
        for what, error, tolerance, unit in figures
        if error.size and error.max() > tolerance
    ]


def _columns(signals: Mapping[str, Array], prefix: str, *names: str) -> Array:
    return np.stack([signals[prefix + name] for name in names], axis=-1)
