"""Verify: read every chunk of a store and check that it says something possible.

The limits are wide: what they catch is damage, wrong units and wrong signs, not unusual missions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from factory.generation.generated_store import GeneratedStore
from factory.sampling.draw import Parameters, sensor_seed
from factory.sampling.drawn_plan import HOUR
from factory.sampling.presets import PRESETS
from factory.sampling.recipe import VERSIONS, Recipe, sha256, versions
from factory.sampling.surveys import SURFACE
from factory.store_check import (
    Block,
    StoreCheck,
    StoreReport,
    check_finite_range,
    check_missions,
    check_padding,
    kinematic_problems,
)
from twin.errors import TwinError
from twin.physics.true_signals import simulated_signals
from twin.records.attributes import (
    ATTEMPT,
    DURATION,
    N_SAMPLES,
    SPLIT,
    SPLITS,
    VEHICLE_MJCF,
    VEHICLE_SHA256,
)
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.schema.limits import simulated_limits


def verify_store(
    run: GeneratedStore, watch: Callable[[int], None] | None = None, *, workers: int = 1
) -> StoreReport:
    """Read and check all that the store says; `check_files` compares its files. `watch` is called
    with the number of missions just read, by as many processes as there are `workers`."""
    names = run.signals()
    checks = {
        name: StoreCheck(name)
        for name in ("metadata", "parameters", "chunks", "padding", "finite", "range", "kinematics")
    }
    _check_metadata(run, names, checks["metadata"])
    if checks["metadata"].problems:
        return StoreReport(len(run), 0, tuple(checks.values()))
    _check_parameters(run, checks["parameters"])
    bytes_read = check_missions(run, names, checks, _check_mission, watch, workers)
    return StoreReport(len(run), bytes_read, tuple(checks.values()))


def _check_metadata(run: GeneratedStore, names: list[str], check: StoreCheck) -> None:
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


def _check_parameters(run: GeneratedStore, check: StoreCheck) -> None:
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
        if run.settings.get(VERSIONS) == versions(run.vehicle):
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
    run: GeneratedStore, mission: int, rows: Block, checks: Mapping[str, StoreCheck]
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
