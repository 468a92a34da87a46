"""Fixtures of the tests that draw."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser
from pictures import write_short_store

from twin.__main__ import PROGRAM


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two short missions, with sensors."""
    return write_short_store(tmp_path_factory.mktemp("short") / "short.zarr")


@pytest.fixture(scope="session")
def page(store: Path) -> Path:
    """The first of them as a page, as the command writes it."""
    out = store.with_name("dive.html")
    assert PROGRAM.main(["render", str(store), "--html", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A page of a browser."""
    with Browser() as one:
        yield one
