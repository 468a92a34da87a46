"""Stores that several tests read."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from navigation import add_fixes, trimmed_mission, write_store

# pytest's importlib mode does not put this folder on the path; the helpers are loaded by place.
_SPEC = importlib.util.spec_from_file_location(
    "learn_missions", Path(__file__).with_name("missions.py")
)
missions = importlib.util.module_from_spec(_SPEC)
sys.modules["learn_missions"] = missions
_SPEC.loader.exec_module(missions)


@pytest.fixture(scope="session")
def small_store(tmp_path_factory):
    """Eight missions: five for training, two for validation, one for test."""
    path = tmp_path_factory.mktemp("stores") / "small.zarr"
    lengths = [1200, 900, 1500, 1100, 1300, 1000, 1400, 1250]
    return missions.write_synthetic_store(path, lengths, [0, 0, 1, 0, 2, 0, 1, 0])


@pytest.fixture(scope="session")
def flown_store(tmp_path_factory):
    """Four missions with everything that dead reckoning needs: two train, then one and one."""
    rng = np.random.default_rng(5)
    flown = []
    for k in range(4):
        sign = 1.0 if k % 2 else -1.0
        signals = trimmed_mission(
            900 + 100 * k,
            net_mass=sign * rng.uniform(0.2, 0.4),
            shift=sign * rng.uniform(0.015, 0.025),
            rotation=np.deg2rad(rng.uniform(-40, 40)),
            depth=50.0 if sign > 0 else 500.0,
        )
        add_fixes(signals, [0, 800])
        flown.append(signals)
    path = tmp_path_factory.mktemp("flown") / "flown.zarr"
    return write_store(path, flown, [0, 0, 1, 2], attributes={"preset": "test", "seed": 5})
