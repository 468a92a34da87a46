"""Stores that several tests read."""

import pytest
from learn_missions import write_synthetic_store
from navigation import write_flown_store

import learn.api
import learn.finishing


@pytest.fixture(scope="session")
def small_store(tmp_path_factory):
    """Eight missions: five for training, two for validation, one for test."""
    path = tmp_path_factory.mktemp("stores") / "small.zarr"
    lengths = [1200, 900, 1500, 1100, 1300, 1000, 1400, 1250]
    return write_synthetic_store(path, lengths, [0, 0, 1, 0, 2, 0, 1, 0])


@pytest.fixture(scope="session")
def flown_store(tmp_path_factory):
    """Four missions with everything that dead reckoning needs: two train, then one and one."""
    return write_flown_store(tmp_path_factory.mktemp("flown") / "flown.zarr")


@pytest.fixture(autouse=True)
def judged_by_the_store_alone(monkeypatch):
    """Leave out further missions, which have a test of their own and take a minute."""
    monkeypatch.setattr(learn.finishing, "LEAST_JUDGED", 0)
    monkeypatch.setitem(learn.api.evaluate.__kwdefaults__, "least", 0)
