"""Hashes of every array of a store, and those of the arrays that must not change."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import xarray as xr

KEPT = Path(__file__).resolve().parent / "data" / "arrays.json"
PRESETS = ("paper", "field")
SEED = 1


def array_hashes(store: Path) -> dict[str, str]:
    """SHA-256 over type, shape and values of each array, by name."""
    with xr.open_zarr(store, decode_times=False) as data:
        return {
            str(name): hashlib.sha256(
                f"{array.dtype.str}{array.shape}".encode()
                + np.ascontiguousarray(array.values).tobytes()
            ).hexdigest()
            for name, array in sorted(data.variables.items(), key=lambda item: str(item[0]))
        }


def expected_hashes(hours: int, preset: str) -> dict[str, str]:
    """Those of `factory generate --seed 1` by this version of the physics."""
    kept: dict[str, dict[str, dict[str, str]]] = json.loads(KEPT.read_text())
    return kept[f"{hours} h"][preset]


def differences(found: dict[str, str], expected: dict[str, str]) -> list[str]:
    """Arrays that differ, are gone or are new."""
    return sorted(n for n in found.keys() | expected.keys() if found.get(n) != expected.get(n))
