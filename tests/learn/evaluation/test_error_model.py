"""Deviations of positions from a model of the errors, against known answers."""

import numpy as np
import pytest
from navigation import PERIOD

from learn.evaluation.deviation import ErrorModel, position_sd
from twin.errors import InputError
from twin.navigation.dead_reckoning import integrate


def model(**changes) -> ErrorModel:
    still = {"velocity_sd": 0.0, "heading_sd": 0.0, "current_sd": 0.0, "fix_sd": 0.0}
    return ErrorModel(**{**still, **changes})


def test_a_velocity_bias_grows_in_proportion_to_time():
    velocity = np.zeros((3000, 2))
    sd = position_sd(velocity, PERIOD, model(velocity_sd=0.01, velocity_time=1e9))
    assert sd == pytest.approx(np.sqrt(2) * 0.01 * PERIOD * np.arange(3000), rel=1e-4, abs=1e-9)


def test_fast_velocity_errors_grow_with_the_root_of_time():
    velocity = np.zeros((20000, 2))
    sd = position_sd(velocity, PERIOD, model(velocity_sd=0.01, velocity_time=5.0))
    end = PERIOD * 19999
    assert sd[-1] == pytest.approx(0.01 * np.sqrt(2 * 2 * 5.0 * (end - 5.0)), rel=1e-6)


def test_the_deviation_is_what_a_simulation_of_the_error_gives():
    rng = np.random.default_rng(0)
    time_constant, sd, samples = 60.0, 0.02, 400
    decay = np.exp(-PERIOD / time_constant)
    error = np.empty((samples, 4000))
    error[0] = sd * rng.standard_normal(4000)
    for k in range(1, samples):
        fresh = sd * np.sqrt(1 - decay**2) * rng.standard_normal(4000)
        error[k] = decay * error[k - 1] + fresh
    drift = integrate(error, PERIOD)
    expected = position_sd(
        np.zeros((samples, 2)), PERIOD, model(velocity_sd=sd, velocity_time=time_constant)
    )
    assert drift[-1].std() == pytest.approx(expected[-1] / np.sqrt(2), rel=0.05)


def test_a_heading_error_moves_the_end_across_the_distance_made_good():
    velocity = np.tile([0.3, 0.4], (1001, 1))
    sd = position_sd(velocity, PERIOD, model(heading_sd=0.01))
    assert sd[-1] == pytest.approx(0.01 * 0.5 * 500.0)


def test_a_fix_resets_the_deviation_to_its_own():
    velocity = np.tile([0.3, 0.0], (1001, 1))
    believed = model(velocity_sd=0.01, heading_sd=0.01, current_sd=0.05, fix_sd=3.0)
    sd = position_sd(velocity, PERIOD, believed, fixes=np.array([600]))
    assert sd[599] > 15.0
    assert sd[600] == pytest.approx(3.0 * np.sqrt(2))
    assert (np.diff(sd[600:]) > 0).all()


def test_error_models_refuse_negative_deviations():
    with pytest.raises(InputError, match="velocity_sd is -1"):
        ErrorModel(velocity_sd=-1)
