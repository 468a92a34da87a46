"""Pictures of the tasks, without dm_control and as dm_control draws them; processes that draw."""

import os
import sys

import numpy as np
import pytest
from processes import python

from twin import control
from twin.control.environment import load_environment
from twin.errors import InputError
from twin.show.render.context import available_backend

pytestmark = pytest.mark.skipif(available_backend() is None, reason="nothing here can draw")


@pytest.fixture(scope="module")
def physics():
    environment = load_environment("waypoints", {"random": 0})
    environment.reset()
    yield environment.physics
    environment.physics.free()


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"camera_id": "chase", "height": 96, "width": 128},
        {"camera_id": 0, "depth": True},
        {"camera_id": "map", "segmentation": True},
    ],
    ids=lambda settings: "-".join(settings) or "free",
)
def test_a_picture_is_dm_controls(physics, settings):
    theirs = control.load("waypoints", task_kwargs={"random": 0})
    theirs.reset()
    expected, found = theirs.physics.render(**settings), physics.render(**settings)
    np.testing.assert_array_equal(theirs.physics.render(**settings), expected)
    theirs.physics.free()
    np.testing.assert_array_equal(physics.render(**settings), found)
    assert found.dtype == expected.dtype
    np.testing.assert_array_equal(found, expected)
    assert expected.std() > 0.1


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"camera_id": "chace"}, "did you mean 'chase'"),
        ({"camera_id": 99}, "camera_id 99: give -1 to"),
        ({"width": 10**5}, "width 100000: give 1 to .* pixels, or raise <global offwidth>"),
        ({"height": 0}, "height 0: give 1 to"),
        ({"depth": True, "segmentation": True}, "ask for one of them"),
    ],
)
def test_a_picture_that_cannot_be_is_refused(physics, settings, told):
    with pytest.raises(InputError, match=told):
        physics.render(**settings)


def test_after_free_it_draws_again(physics):
    first = physics.render(camera_id="side")
    physics.free()
    np.testing.assert_array_equal(physics.render(camera_id="side"), first)


FORKS = """
import multiprocessing, os, sys
from twin import control
from twin.control.environment import load_environment

def draw(face, told=None):
    environment = (
        control.load("hold", task_kwargs={"random": 0})
        if face == "dm_control"
        else load_environment("hold", {"random": 0})
    )
    environment.reset()
    try:
        told = f"drew {environment.physics.render(camera_id=0).shape}"
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
    print(told, flush=True)

if __name__ == "__main__":
    parent, child, how = sys.argv[1:]
    if parent != "nothing":
        draw(parent)
    process = multiprocessing.get_context(how).Process(target=draw, args=(child,))
    process.start()
    process.join(60)
    if process.is_alive():
        process.kill()
        print("it waits")
    sys.stdout.flush()
    os._exit(0)
"""


def forked(tmp_path, *words):
    """What a process that draws prints, and one that it starts."""
    (tmp_path / "forks.py").write_text(FORKS)
    path = os.pathsep.join(sys.path)
    return python("forks.py", *words, cwd=tmp_path, PYTHONPATH=path).stdout.splitlines()


@pytest.mark.parametrize(("parent", "child"), [("own", "own"), ("dm_control", "dm_control")])
def test_a_process_forked_from_one_that_drew_is_told_to_spawn(tmp_path, parent, child):
    first, second = forked(tmp_path, parent, child, "fork")
    assert first == "drew (240, 320, 3)"
    assert second.startswith("ForkedDrawing: this process was forked from process ")
    assert "multiprocessing.get_context('spawn')" in second


def test_a_process_that_is_spawned_draws_and_so_does_a_fork_of_one_that_did_not(tmp_path):
    drew = "drew (240, 320, 3)"
    assert forked(tmp_path, "own", "own", "spawn") == [drew, drew]
    assert forked(tmp_path, "nothing", "own", "fork") == [drew]
