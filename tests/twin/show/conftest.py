"""Fixtures of the tests that draw."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser
from pictures import write_short_store


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two short missions, with sensors."""
    return write_short_store(tmp_path_factory.mktemp("short") / "short.zarr")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A page of a browser."""
    with Browser() as one:
        yield one
