"""Deployments that are watched: a source, settings, the command, and passes without figures."""

import functools

import pytest

from glider_twin_ops.watching import WatchedDeployment
from twin.__main__ import PROGRAM


def made(place, source, **settings):
    """A deployment below a folder, of ten members and two hours."""
    usual = {"members": 10, "hours": 2.0}
    found = WatchedDeployment(folder=place / "calypso", source=str(source), **usual | settings)
    found.write()
    return found


@pytest.fixture(scope="session")
def deployment():
    return made


@pytest.fixture
def source(tmp_path):
    (tmp_path / "arrived").mkdir()
    return tmp_path / "arrived"


@pytest.fixture
def watched(tmp_path, source):
    return functools.partial(made, tmp_path, source)


@pytest.fixture
def run(capsys):
    """Code, output and errors of `twin watch`."""

    def run(*words):
        code = PROGRAM.main(["watch", *map(str, words)])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.fixture
def figures():
    """For the tests of what is drawn."""


@pytest.fixture
def no_figures(request, monkeypatch):
    """Drawing is a third of a pass."""
    if "figures" not in request.fixturenames:
        monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
