"""Small stores that many tests read, made once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from factory.generation.generation import generate
from factory.sampling.recipe import Recipe, make_recipe

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
