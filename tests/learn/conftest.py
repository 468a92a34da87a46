"""Stores that several tests read."""

import importlib.util
import sys
from pathlib import Path

import pytest
from navigation import write_flown_store

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
    return write_flown_store(tmp_path_factory.mktemp("flown") / "flown.zarr")
