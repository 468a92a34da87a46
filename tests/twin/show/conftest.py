"""Fixtures of the tests that draw."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser
from pictures import (
    measured,
    short_scenario,
    short_subject,
    write_dives,
    write_short_store,
)

from twin.__main__ import PROGRAM
from twin.physics.simulation import simulate
from twin.records.trajectory import Trajectory
from twin.show.render.subject import Subject


@pytest.fixture(scope="session")
def trajectory() -> Trajectory:
    """The short mission with sensors."""
    return measured(simulate(short_scenario()))


@pytest.fixture(scope="session")
def subject() -> Subject:
    """The short mission without tracks."""
    return short_subject()


@pytest.fixture(scope="session")
def dives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of three dives."""
    return write_dives(tmp_path_factory.mktemp("dives"), 3)


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


@pytest.fixture(scope="session")
def log_page(dives: Path) -> Path:
    """The dives together as a page."""
    out = dives.with_name("dives.html")
    assert PROGRAM.main(["render", str(dives), "--missions", "all", "--html", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A page of a browser."""
    with Browser() as one:
        yield one
