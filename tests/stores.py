"""Small stores that many tests read, made once."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from factory.generation.generation import generate
from factory.generation.job import unfinished
from factory.sampling.distribution import Parameter
from factory.sampling.draw import Parameters, draw_parameters
from factory.sampling.parameters import declared, override, parameter_table
from factory.sampling.recipe import Recipe, make_recipe
from twin.records.presence import generating
from twin.vehicle.vehicle import Vehicle, load_vehicle

SHORT = {
    "mission.duration_h": "uniform(0.03, 0.06)",
    "mission.segment_duration_s": "uniform(30, 90)",
}
"""Missions of two to four minutes with several segments each."""
FIELD_SHORT = {
    "mission.duration_h": "uniform(0.1, 0.15)",
    "mission.max_depth_m": "uniform(12, 25)",
    "mission.min_depth_m": "uniform(3, 6)",
    "mission.surface_duration_s": "uniform(60, 90)",
    "water.bottom_below_m": "uniform(20, 200)",
}
"""Missions of six to nine minutes that dive and surface, often with the bottom in DVL reach."""


def short_recipe(**settings: Any) -> Recipe:
    """A recipe of preset paper whose missions take milliseconds."""
    changes = {**SHORT, **settings.pop("changes", {})}
    return make_recipe(**{"hours": 0.2, "changes": changes, **settings})


def make_store(recipe: Recipe, out: Path, **options: Any) -> Path:
    """Generate with one worker."""
    generate(recipe, out, **{"workers": 1, **options})
    return out


@cache
def _table(vehicle: str) -> tuple[Vehicle, dict[str, Parameter]]:
    flown = load_vehicle(vehicle)
    return flown, parameter_table(flown)


def drawn(
    spread: str,
    mission: int = 0,
    attempt: int = 0,
    seed: int = 0,
    *,
    duration: float = 3600.0,
    vehicle: str = "glider",
    **changes: str | float,
) -> Parameters:
    """Parameters of a mission, drawn from a column of the table with changes."""
    flown, table = _table(vehicle)
    changed = {name.replace("__", "."): text for name, text in changes.items()}
    return draw_parameters(
        table, override(declared(spread, table), changed), duration_s=duration, vehicle=flown,
        seed=seed, mission=mission, attempt=attempt,
    )  # fmt: skip


def missions_kept(store: Path) -> int:
    """Missions that an unfinished store has."""
    begun = unfinished(store) if generating(store).is_dir() else None
    return begun.missions_kept if begun else 0


@pytest.fixture(scope="session")
def recipe() -> Callable[..., Recipe]:
    return short_recipe


@pytest.fixture(scope="session")
def paper_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_store(short_recipe(), tmp_path_factory.mktemp("paper") / "missions.zarr")


@pytest.fixture(scope="session")
def field_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = make_recipe(preset="field", hours=0.5, changes=FIELD_SHORT)
    return make_store(made, tmp_path_factory.mktemp("field") / "missions.zarr")


@pytest.fixture
def copied(paper_store: Path, tmp_path: Path) -> Path:
    """A copy of `paper_store` that a test may change."""
    return shutil.copytree(paper_store, tmp_path / "copied.zarr")
