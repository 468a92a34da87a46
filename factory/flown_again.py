"""Replay: fly a stored mission again, from what the store says, and compare every byte."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from factory.generation.attempts import reason
from factory.generation.generated_store import GeneratedStore
from factory.sampling.draw import sensor_seed
from factory.sampling.fly import REPLACED, fly
from factory.sampling.recipe import differences, versions
from factory.soundness import drawn_otherwise
from twin.errors import StoreError
from twin.physics.mujoco_model import quiet_mujoco
from twin.records.schema import VARIABLES
from twin.records.storage.sharded import DTYPE, stored_values
from twin.version import __version__


@dataclass(frozen=True, kw_only=True)
class ReplayComparison:
    """A replayed mission against the stored one."""

    mission: int
    signals: int
    """signals compared"""
    samples: int
    bytes_compared: int
    different: dict[str, float]
    """signal: largest difference, of those whose bytes differ"""
    other_versions: tuple[str, ...]
    """libraries whose version is not the store's: they may change the last bits"""

    @property
    def identical(self) -> bool:
        """Whether every byte is the same."""
        return not self.different


def replay_mission(run: GeneratedStore, mission: int) -> ReplayComparison:
    """Fly mission `mission` of the store again and compare.

    Raises:
      StoreError: no such mission, or its data cannot be read.
    """
    _check_physics(run)
    run.check_mission(mission)
    recipe = run.recipe
    other = drawn_otherwise(run, recipe, mission, run.parameters(mission))
    if other:
        raise StoreError(
            f"store {run.path}: mission {mission} is not of this recipe: {other}; `factory verify` "
            "finds all such missions"
        )
    flight = fly(
        recipe.parameters(mission, run.attempt(mission)),
        run.vehicle,
        run.suite,
        sensor_seed(run.seed, mission, run.attempt(mission)),
        current=run.given_current,
        drawn=run.sensor_constants(mission),
        engine=recipe.engine,
    )
    samples = int(run.samples[mission])
    if len(flight.trajectory.time) != samples:
        raise StoreError(
            f"mission {mission} has {samples} samples in the store and "
            f"{len(flight.trajectory.time)} in the replay: it was made by other code"
        )
    different: dict[str, float] = {}
    names = run.signals()
    for name in names:
        stored = run.row(name, mission)[:samples]
        again = stored_values(flight.signals[name], VARIABLES[name].decimals)
        if stored.astype(DTYPE).tobytes() != again.tobytes():
            gap = np.abs(stored.astype(float) - again)
            only_one = np.isnan(stored) != np.isnan(again)
            different[name] = float("inf") if only_one.any() else float(np.nanmax(gap))
    return ReplayComparison(
        mission=mission,
        signals=len(names),
        samples=samples,
        bytes_compared=len(names) * samples * DTYPE.itemsize,
        different=different,
        other_versions=tuple(differences(run.settings["versions"], versions(run.vehicle))),
    )


def _check_physics(run: GeneratedStore) -> None:
    """Raise StoreError when the store's missions flew by another physics."""
    theirs = str(run.settings["versions"].get("physics", 1))
    ours = run.vehicle.physics_version
    if theirs != str(ours):
        raise StoreError(
            f"the missions of {run.path} flew by version {theirs} of the physics, and this "
            f"glider-twin {__version__} flies version {ours} with this vehicle: they cannot fly "
            "again the same. The store stays readable; to replay it, install the program that made "
            "it"
        )


def replay_failure(run: GeneratedStore, mission: int, attempt: int) -> tuple[str, str]:
    """Fly a failed attempt again; returns its error then and its error now.

    Raises:
      StoreError: the store knows no such failure.
    """
    _check_physics(run)
    known = {(one.mission, one.attempt): one for one in run.failures()}
    if (mission, attempt) not in known:
        listing = ", ".join(f"{m} ({a})" for m, a in sorted(known)) or "none"
        raise StoreError(
            f"attempt {attempt} of mission {mission} did not fail; failures in the store as "
            f"mission (attempt): {listing}"
        )
    failure = known[mission, attempt]
    try:
        recipe = run.recipe
        parameters = recipe.parameters(mission, attempt)
        seed = sensor_seed(run.seed, mission, attempt)
        with quiet_mujoco():
            fly(
                parameters, run.vehicle, run.suite, seed,
                current=run.given_current, engine=recipe.engine,
            )  # fmt: skip
    except REPLACED as error:
        return failure.reason, reason(error)
    return failure.reason, "flew to its end"
