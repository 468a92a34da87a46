"""Hashes of every array of a store, and those of the arrays that must not change."""

from __future__ import annotations

import json
from pathlib import Path

KEPT = Path(__file__).resolve().parent / "data" / "arrays.json"
PRESETS = ("paper", "field")
SEED = 1


def expected_hashes(hours: int, preset: str) -> dict[str, str]:
    """Those of `factory generate --seed 1` by this version of the physics."""
    kept: dict[str, dict[str, dict[str, str]]] = json.loads(KEPT.read_text())
    return kept[f"{hours} h"][preset]


def differences(found: dict[str, str], expected: dict[str, str]) -> list[str]:
    """Arrays that differ, are gone or are new."""
    return sorted(n for n in found.keys() | expected.keys() if found.get(n) != expected.get(n))
