"""Navigated environments: observations of what is known on board, rewards of the truth."""

from __future__ import annotations

import numpy as np
import pytest

from twin import control
from twin.errors import InputError
from twin.navigation.settings import Navigation

IDEAL = Navigation(estimator="ekf", sensors="ideal")
ACTION = [0.3, 0.1, -0.6]


def fly(name, steps=60, navigate=None, random=2):
    environment = control.load(
        name, task_kwargs={"random": random}, environment_kwargs={"navigate": navigate}
    )
    rows = [environment.reset()]
    rows += [environment.step(ACTION) for _ in range(steps)]
    return environment, rows


@pytest.mark.parametrize("name", control.ALL_TASKS)
def test_perfect_sensors_show_nearly_the_truth(name):
    _, truth = fly(name)
    _, believed = fly(name, navigate=IDEAL)
    for one, other in zip(truth[2:], believed[2:], strict=True):
        assert one.reward == pytest.approx(other.reward, abs=1e-12)
        assert list(one.observation) == list(other.observation)
        for key in ("attitude", "depth", "actuators"):
            assert other.observation[key] == pytest.approx(one.observation[key], abs=1e-6), key
    # the rates are those of the sample, and the velocity is estimated
    assert believed[-1].observation["rates"] == pytest.approx(
        truth[-1].observation["rates"], abs=1e-3
    )
    assert believed[-1].observation["velocity"] == pytest.approx(
        truth[-1].observation["velocity"], abs=0.08
    )


def test_the_current_is_estimated_and_not_shown():
    _, truth = fly("waypoints")
    _, believed = fly("waypoints", navigate=IDEAL)
    assert np.abs(truth[-1].observation["current"]).max() > 0.01
    assert believed[-1].observation["current"] == pytest.approx(0.0, abs=1e-9)


def test_every_episode_has_errors_of_its_own_that_its_seed_repeats():
    environment, first = fly("hold", 5, navigate="ekf")
    second = [environment.reset(), *(environment.step(ACTION) for _ in range(5))]
    _, again = fly("hold", 5, navigate="ekf")
    depth = [
        rows[-1].observation["depth"][0] - rows[0].observation["depth"][0]
        for rows in (first, second)
    ]
    assert np.array_equal(first[-1].observation["attitude"], again[-1].observation["attitude"])
    assert depth[0] != depth[1]


def test_a_specification_measures_nothing():
    environment, _ = fly("hold", 3, navigate="ekf")
    before = environment.task.believed._on_board.sensors.count
    environment.observation_spec()
    assert environment.task.believed._on_board.sensors.count == before == 4


def test_what_cannot_be_navigated_is_refused():
    with pytest.raises(InputError, match="needs a time limit"):
        control.load(
            "hold", task_kwargs={"time_limit": float("inf")}, environment_kwargs={"navigate": "ekf"}
        )
    with pytest.raises(InputError, match="unknown velocity estimator 'efk'"):
        control.load("hold", environment_kwargs={"navigate": "efk"})
