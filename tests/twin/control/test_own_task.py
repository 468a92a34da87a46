"""A task of one's own: one file for dm_control, Gymnasium and many vehicles at once."""

# ruff: noqa: E402 - the packages are those of an extra
import os

import numpy as np
import pytest
from examples import OWN, own_type
from processes import python

gymnasium = pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")

from twin import control
from twin.control.environment import build
from twin.control.physics import Physics
from twin.control.registry import TASKS
from twin.control.task import Episode, GliderTask, place_marker
from twin.errors import InputError
from twin.physics.start import Start
from twin.plugins import PLUGINS
from twin.vehicle.vehicle import load_vehicle

ID = "glider_twin/Cruise-v0"


@pytest.fixture(scope="module")
def cruise():
    """The file of the example, imported."""
    with own_type("cruise"):
        yield __import__("cruise")
    TASKS.unregister("cruise")
    del gymnasium.registry[ID]


def test_one_file_flies_alike_in_all_three(cruise):
    pytest.importorskip("dm_control", reason="the extra 'suite' is not installed")
    one = gymnasium.make(ID)
    many = gymnasium.make_vec(ID, num_envs=3)
    first, _ = one.reset(seed=7)
    others, _ = many.reset(seed=6)
    np.testing.assert_allclose(others[1], first, rtol=1e-5, atol=1e-6)
    assert np.ptp(others[:, -1]) > 0.01  # each has a goal of its own
    action = np.array([0.2, 0.0, -0.5], np.float32)
    for _ in range(20):
        found, reward, *_ = one.step(action)
        founds, rewards, *_ = many.step(np.tile(action, (3, 1)))
    np.testing.assert_allclose(founds[1], found, rtol=1e-4, atol=1e-5)
    assert rewards[1] == pytest.approx(reward, abs=1e-6)
    environment = control.load("cruise", task_kwargs={"random": 1})
    time_step = environment.reset()
    while not time_step.last():
        time_step = environment.step(action)
        assert 0.0 <= time_step.reward <= 1.0
    assert {"attitude", "to_target"} <= time_step.observation.keys()
    many.close()


def test_the_name_alone_finds_a_task_of_a_plugin_file():
    program = (
        "import gymnasium;"
        f"print(gymnasium.make_vec('twin.control:{ID}', num_envs=2).reset(seed=0)[0].shape)"
    )
    done = python("-c", program, env={**os.environ, PLUGINS: str(OWN / "cruise.py")})
    assert done.stdout.strip() == "(2, 15)", done.stderr


def environment_of(task_class, **more):
    glider = load_vehicle("glider")
    task = type("Half", (task_class,), more)(glider, max_depth=100.0, random=0)
    return build(Physics.from_vehicle(glider), task, time_limit=10.0, settings=None)


DRAWN = {"draw_episode": lambda self, random: Episode(start=Start(depth=20.0), goal={"aim": 1.0})}
SEEN = {"observe_goal": lambda self, physics: {}, "get_reward": lambda self, physics: 1.0}


def test_what_a_task_lacks_is_named_at_once():
    with pytest.raises(
        InputError, match=r"Half is only half there: write draw_episode, get_reward"
    ):
        environment_of(GliderTask, observe_goal=SEEN["observe_goal"])
    whole = environment_of(GliderTask, goals={"aim": ()}, **DRAWN, **SEEN)
    whole.reset()
    assert whole.task.aim == 1.0
    with pytest.raises(InputError, match="no method reference"):
        whole.task.reference(whole.physics)


def test_a_goal_without_its_shape_and_a_marker_without_its_site_are_named():
    with pytest.raises(InputError, match=r"task Half sets the goal aim: .*goals = \{NAME"):
        environment_of(GliderTask, **DRAWN, **SEEN).reset()
    environment = environment_of(GliderTask, goals={"aim": ()}, **DRAWN, **SEEN)
    with pytest.raises(InputError, match=r"no site 'target'.*with_marker"):
        place_marker(environment.physics, 0.0, 0.0, 10.0)
