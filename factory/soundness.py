"""Soundness: read every chunk of a store and check that its values are possible.

The limits are wide: they catch damage, wrong units and wrong signs, not unusual missions.

`replay_mission` flies a stored mission again from the store's recipe and compares every byte.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.generation.generated_store import GeneratedStore
from factory.generation.shard import reason
from factory.sampling.draw import HOUR, Parameters, sensor_seed
from factory.sampling.fly import REPLACED, FlownSignals, fly
from factory.sampling.mission_kinds import SURFACE
from factory.sampling.presets import PRESETS
from factory.sampling.recipe import VERSIONS, Recipe, differences, sha256, versions
from factory.store_check import (
    Block,
    MissionCheck,
    StoreCheck,
    StoreReport,
    check_missions,
    check_signal,
    kinematic_problems,
)
from twin.errors import StoreError, TwinError
from twin.geodesy import offset
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.true_signals import simulated_signals
from twin.records.attributes import (
    ATTEMPT,
    DEPLOYMENT,
    DIVE,
    DIVE_DURATION,
    DURATION,
    N_SAMPLES,
    SPLIT,
    SPLITS,
    START_TIME,
    SUSPECT,
    VEHICLE_MJCF,
    VEHICLE_SHA256,
)
from twin.records.logged import LogStore
from twin.records.reader import MissionStore
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.schema.limits import depth_faults, recorded_limits, simulated_limits
from twin.records.storage.sharded import DTYPE, stored_values
from twin.version import __version__

Array = NDArray[np.float64]
Watch = Callable[[int], None]
"""Function called with the number of missions or dives just read"""
OF_ALL = (N_SAMPLES, SPLIT, TIME, MISSION)
"""Arrays that every store has"""
FLOWN = (*OF_ALL, DURATION, ATTEMPT)
"""Arrays that every store of `factory generate` has"""
LOGGED = (*OF_ALL, DEPLOYMENT, DIVE, START_TIME, DIVE_DURATION, "measured_gap")
"""Arrays that every imported store has"""
WITH_DEPTH = ("measured_depth", "measured_pressure", "measured_phase")
"""Arrays that an imported store has all or none of; it has none if the log's rows are no dives and
contain no depth."""
COMPLETE = frozenset({"measured_gap", *WITH_DEPTH})
"""Logged signals without NaN, because the import interpolates gaps and marks them"""
CODES = {"measured_gap": (0.0, 1.0), "measured_phase": (0.0, 1.0, 2.0, 3.0)}
OFFSET_TOLERANCE = 0.02, 2.0
"""[1], [m] Tolerance of displacements: fraction of the distance of the fixes; smallest tolerance"""


def verify_store(
    run: GeneratedStore, watch: Watch | None = None, *, workers: int = 1
) -> StoreReport:
    """Read and check all arrays of a store of `factory generate`, in `workers` processes.
    `factory.store_check.check_files` checks the files."""
    parts = ("metadata", "parameters", "chunks", "padding", "finite", "range", "kinematics")
    checks = {name: StoreCheck(name) for name in parts}
    check, names = checks["metadata"], run.signals()
    check.problems += [f"array {n!r} is gone" for n in run.gone_arrays()]
    check.expect(
        sha256(run.attributes[VEHICLE_MJCF]) == run.attributes[VEHICLE_SHA256],
        "the vehicle's MJCF text does not have the recorded SHA-256",
    )
    if not check.problems:  # the vehicle decides which signals must exist
        _check_needed(run, FLOWN, check)
        for name in simulated_signals(run.vehicle):
            check.expect(name in names, f"signal {name!r} is missing")
        _check_layout(run, "mission", DURATION, check)
    if not check.problems:
        _check_parameters(run, checks["parameters"])
    return _check_all(run, checks, _check_mission, watch, workers)


def verify_logs(logs: LogStore, watch: Watch | None = None, *, workers: int = 1) -> StoreReport:
    """Read and check all arrays of a store of logs, as `verify_store`."""
    parts = ["metadata", "order", "fixes", "chunks", "padding", "finite", "range", "depth"]
    checks = {name: StoreCheck(name) for name in (*parts, SUSPECT)}
    check = checks["metadata"]
    check.problems += [f"array {n!r} is gone" for n in logs.gone_arrays()]
    deep = any(name in logs.dataset.variables for name in WITH_DEPTH)
    _check_needed(logs, (*LOGGED, *(WITH_DEPTH if deep else ())), check)
    if not check.problems:
        _check_layout(logs, "dive", DIVE_DURATION, check, least=2, slack=1e-6)
        rows = int(logs.report["rows"])
        problem = f"the report of the import speaks of {rows} dives, not {len(logs)}"
        check.expect(rows == len(logs), problem)
    if not check.problems:
        _check_order(logs, checks["order"])
        _check_fixes(logs, checks["fixes"])
        for dive, why in enumerate(logs.suspect):
            checks[SUSPECT].expect(not why, f"dive {dive}: {why}")
    return _check_all(logs, checks, _check_dive, watch, workers)


def _check_all(
    stored: GeneratedStore | LogStore, checks: dict[str, StoreCheck], check: MissionCheck,
    watch: Watch | None, workers: int,
) -> StoreReport:  # fmt: skip
    """Read and check all missions if the metadata are sound."""
    read = 0
    if not checks["metadata"].problems:
        read = check_missions(stored, stored.signals(), checks, check, watch, workers)
    return StoreReport(len(stored), read, tuple(checks.values()))


def _check_needed(stored: MissionStore, needed: Iterable[str], check: StoreCheck) -> None:
    for name in needed:
        check.expect(name in stored.dataset.variables, f"array {name!r} is missing")


def _check_layout(
    stored: MissionStore, what: str, lasting: str, check: StoreCheck, *, least: int = 1,
    slack: float = 0.0,
) -> None:  # fmt: skip
    """Check units, time axis (within `slack` [s]), and samples by the array `lasting` [s]."""
    for name in stored.signals():
        units, wanted = stored.dataset[name].attrs.get("units"), VARIABLES[name].units
        check.expect(units == wanted, f"{name}: units {units!r}, not {wanted!r}")
    if check.problems:
        return
    period, time = float(stored.declared_period or 0.0), stored.array(TIME)
    check.expect(
        bool(np.allclose(time, np.arange(len(time)) * period, rtol=0.0, atol=slack)),
        f"time does not run from 0 in steps of {period:g} s",
    )
    durations = np.asarray(stored.array(lasting), float)
    for mission, (samples, duration) in enumerate(zip(stored.samples, durations, strict=True)):
        expected = max(least, round(float(duration) / period) + 1)
        problem = f"{what} {mission}: {samples} samples, not {expected}"
        check.expect(samples == expected <= len(time), problem)


def _check_parameters(run: GeneratedStore, check: StoreCheck) -> None:
    """Check that each sampled value is allowed by its distribution and reproduced by its seed."""
    preset = PRESETS.get(str(run.settings["preset"]))
    given = preset is not None and preset.fixed_missions
    if not given:
        counts = {split: run.splits.count(split) for split in SPLITS}
        check.expect(min(counts.values()) >= 1, f"a split without a mission: {counts}")
        hours = float(run.settings["hours"])
        check.expect(
            abs(run.hours - hours) < 1.0 / HOUR,
            f"the missions last {run.hours:g} h, not {hours:g} h",
        )
    recipe = None
    try:
        recipe = run.recipe
    except TwinError as error:
        # missions of other versions cannot be sampled again; their values are checked anyway
        if run.settings.get(VERSIONS) == versions(run.vehicle):
            check.problems.append(str(error))
    for mission in range(len(run)):
        parameters = run.parameters(mission)
        other = "" if recipe is None else drawn_otherwise(run, recipe, mission, parameters)
        check.expect(not other, f"mission {mission}: {other}")
        drawn = [(name, value, False) for name, value in parameters.values.items()]
        drawn += [
            (name, value, segment["mission.kind"] == SURFACE.name)
            for segment in parameters.segments
            for name, value in segment.items()
        ]
        for name, value, surface in drawn:
            unused = value != value or (surface and name == "mission.kind")
            distribution = run.distributions[name]
            allowed = unused or given or distribution.allows(value)
            wrong = "" if allowed else f"{value} cannot be drawn from {distribution.text()}"
            check.expect(allowed, f"mission {mission}: {name} = {wrong}")


def drawn_otherwise(run: GeneratedStore, recipe: Recipe, mission: int, stored: Parameters) -> str:
    """Describe the first stored parameter that differs from its value sampled again, else empty."""
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
    run: GeneratedStore, mission: int, rows: Block, checks: Mapping[str, StoreCheck]
) -> None:
    samples, truth = int(run.samples[mission]), {}
    for name, row in rows.items():
        truth[name] = check_signal(
            f"mission {mission}", name, row, samples, checks,
            complete=not VARIABLES[name].gaps, limits=simulated_limits(name),
        ).astype(float)  # fmt: skip
    for problem in kinematic_problems(truth, run.period):
        checks["kinematics"].problems.append(f"mission {mission}: {problem}")
    checks["kinematics"].done += 4


def _check_order(logs: LogStore, check: StoreCheck) -> None:
    """Check that dives of a deployment follow each other."""
    check.expect(bool(np.isfinite(logs.starts).all()), "start_time is not finite everywhere")
    duration = logs.number(DIVE_DURATION)
    for deployment in dict.fromkeys(logs.deployments):
        missions = [k for k, name in enumerate(logs.deployments) if name == deployment]
        for before, after in itertools.pairwise(missions):
            end = logs.starts[before] + duration[before]
            check.expect(
                bool(logs.starts[after] >= end - logs.period),
                f"dive {after} begins before dive {before} ends",
            )


def _check_fixes(logs: LogStore, check: StoreCheck) -> None:
    """Check that fixes are on Earth and that displacements agree with them."""
    north, east = (logs.number(f"displacement_{name}") for name in ("north", "east"))
    for mission in range(len(logs)):
        start, end = logs.fixes(mission)
        for name, fix in (("start", start), ("end", end)):
            if not np.isfinite(fix).all():
                continue
            check.expect(
                abs(fix[0]) <= 90.0 and abs(fix[1]) <= 360.0,
                f"dive {mission}: no place at its {name}: {fix[0]}, {fix[1]}",
            )
        if np.isfinite([*start, *end]).all():
            between = offset(np.float64(end[0]), np.float64(end[1]), *start)
            error = float(np.hypot(between[0] - north[mission], between[1] - east[mission]))
            relative, least = OFFSET_TOLERANCE
            check.expect(
                error <= max(least, relative * float(np.hypot(*between))),
                f"dive {mission}: its displacement is {error:.3g} m off what lies between its "
                "fixes",
            )


def _check_dive(
    logs: LogStore, mission: int, rows: Block, checks: Mapping[str, StoreCheck]
) -> None:
    samples = int(logs.samples[mission])
    what = f"dive {mission}"
    for name, row in rows.items():
        inside = check_signal(
            what, name, row, samples, checks,
            complete=name in COMPLETE, limits=recorded_limits(name),
        )  # fmt: skip
        if name in CODES:
            odd = np.setdiff1d(inside[np.isfinite(inside)], CODES[name])
            codes = ", ".join(f"{code:g}" for code in odd)
            checks["range"].expect(not odd.size, f"{what}: {name} has the unknown code {codes}")
    if "measured_depth" not in rows:
        return
    depth = rows["measured_depth"][:samples].astype(float)
    pressure = rows["measured_pressure"][:samples].astype(float)
    faults = depth_faults(depth, pressure, logs.period)
    said = "; ".join(f"{fault}: {found}" for fault, found in faults)
    checks["depth"].expect(not faults, f"{what}: {said}")


@dataclass(frozen=True, kw_only=True)
class ReplayComparison:
    """Comparison of a replayed mission with the stored one."""

    mission: int
    signals: int
    """Number of compared signals"""
    samples: int
    bytes_compared: int
    different: dict[str, float]
    """Largest difference of each signal whose bytes differ"""
    other_versions: tuple[str, ...]
    """Libraries with another version than the store's, which may change the last bits"""

    @property
    def identical(self) -> bool:
        """True if all bytes are equal."""
        return not self.different


def replay_mission(run: GeneratedStore, mission: int) -> ReplayComparison:
    """Fly a mission of the store again and compare all bytes.

    Raises:
      StoreError: no such mission, data that cannot be read, or another version of the physics.
    """
    _check_physics(run)
    run.check_mission(mission)
    attempt = run.attempt(mission)
    other = drawn_otherwise(run, run.recipe, mission, run.parameters(mission))
    if other:
        raise StoreError(
            f"store {run.path}: mission {mission} is not of this recipe: {other}; `factory verify` "
            "finds all such missions"
        )
    flight = _fly_again(run, mission, attempt, run.sensor_constants(mission))
    samples, again = int(run.samples[mission]), len(flight.trajectory.time)
    if again != samples:
        raise StoreError(
            f"mission {mission} has {samples} samples in the store and {again} in the replay: it "
            "was made by other code"
        )
    different: dict[str, float] = {}
    names = run.signals()
    for name in names:
        stored = run.row(name, mission)[:samples]
        now = stored_values(flight.signals[name], VARIABLES[name].decimals)
        if stored.astype(DTYPE).tobytes() != now.tobytes():
            gap = np.abs(stored.astype(float) - now)
            only_one = np.isnan(stored) != np.isnan(now)
            different[name] = float("inf") if only_one.any() else float(np.nanmax(gap))
    return ReplayComparison(
        mission=mission,
        signals=len(names),
        samples=samples,
        bytes_compared=len(names) * samples * DTYPE.itemsize,
        different=different,
        other_versions=tuple(differences(run.settings[VERSIONS], versions(run.vehicle))),
    )


def replay_failure(run: GeneratedStore, mission: int, attempt: int) -> tuple[str, str]:
    """Fly a failed attempt again; returns the recorded error and the error now.

    Raises:
      StoreError: the store has no such failure, or another version of the physics made the store.
    """
    _check_physics(run)
    known = {(one.mission, one.attempt): one.reason for one in run.failures()}
    if (mission, attempt) not in known:
        listing = ", ".join(f"{m} ({a})" for m, a in sorted(known)) or "none"
        raise StoreError(
            f"attempt {attempt} of mission {mission} did not fail; failures in the store as "
            f"mission (attempt): {listing}"
        )
    try:
        with quiet_mujoco():
            _fly_again(run, mission, attempt)
    except REPLACED as error:
        return known[mission, attempt], reason(error)
    return known[mission, attempt], "flew to its end"


def _fly_again(
    run: GeneratedStore, mission: int, attempt: int, drawn: Mapping[str, float] | None = None
) -> FlownSignals:
    recipe, seed = run.recipe, sensor_seed(run.seed, mission, attempt)
    return fly(
        recipe.parameters(mission, attempt), run.vehicle, run.suite, seed, drawn=drawn,
        current=run.given_current, engine=recipe.engine,
    )  # fmt: skip


def _check_physics(run: GeneratedStore) -> None:
    """Raise StoreError if another version of the physics flew the store's missions."""
    theirs, ours = str(run.settings[VERSIONS].get("physics", 1)), run.vehicle.physics_version
    if theirs != str(ours):
        raise StoreError(
            f"the missions of {run.path} flew by version {theirs} of the physics, and this "
            f"glider-twin {__version__} flies version {ours} with this vehicle: they cannot fly "
            "again the same. The store stays readable; to replay it, install the program that made "
            "it"
        )
