"""Fixtures of the tests that draw."""

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


@pytest.fixture(scope="session")
def trajectory():
    """The short mission with sensors."""
    return measured(simulate(short_scenario()))


@pytest.fixture(scope="session")
def subject():
    """The short mission without tracks."""
    return short_subject()


@pytest.fixture(scope="session")
def dives(tmp_path_factory):
    """A log of three dives."""
    return write_dives(tmp_path_factory.mktemp("dives"), 3)


@pytest.fixture(scope="session")
def store(tmp_path_factory):
    """Two short missions, with sensors."""
    return write_short_store(tmp_path_factory.mktemp("short") / "short.zarr")


@pytest.fixture(scope="session")
def page(store):
    """The first of them as a page, as the command writes it."""
    out = store.with_name("dive.html")
    assert PROGRAM.main(["render", str(store), "--html", str(out)]) == 0
    return out


@pytest.fixture(scope="session")
def log_page(dives):
    """The dives together as a page."""
    out = dives.with_name("dives.html")
    assert PROGRAM.main(["render", str(dives), "--missions", "all", "--html", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def browser():
    """A page of a browser."""
    with Browser() as one:
        yield one
