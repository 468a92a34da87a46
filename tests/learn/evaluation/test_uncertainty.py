"""Predicted deviations against the errors that they predict."""

import math

import numpy as np
import pytest
from navigation import PERIOD, steady_mission

from learn.data.dataset import MissionSequence
from learn.evaluation.deviation import COMPASS_SD, ErrorModel, network_position_sd, position_sd
from learn.evaluation.score import ReferenceVelocity
from twin.errors import InputError
from twin.navigation.dead_reckoning import integrate
from twin.navigation.estimators.base import Estimate

SAMPLES = 1200
STILL = {"velocity_sd": 0.0, "heading_sd": 0.0, "current_sd": 0.0, "fix_sd": 0.0}


def reference(pitch):
    signals = steady_mission(SAMPLES, pitch=pitch, velocity=(0.4, 0.0, 0.0))
    return ReferenceVelocity.of(
        MissionSequence(index=0, split="test", period=PERIOD, signals=signals)
    )


def predicted(mission, **spread):
    """[m] at the end, for an estimate that claims these deviations of surge and sway [m/s]."""
    claims = {name: np.full(SAMPLES, value) for name, value in spread.items()}
    estimate = Estimate(surge=mission.surge, sway=mission.sway, **claims)
    model = ErrorModel(**{**STILL, "velocity_time": 1e9})
    return float(network_position_sd(mission, estimate, model)[-1])


def drawn(mission, *, surge_sd=0.0, sway_sd=0.0):
    """[m] root mean square error at the end, over missions whose surge and sway are biased."""
    rng = np.random.default_rng(0)
    exact = mission.track(Estimate(surge=mission.surge, sway=mission.sway), mission.measured)
    squares = []
    for _ in range(400):
        wrong = Estimate(
            surge=mission.surge + surge_sd * rng.standard_normal(),
            sway=mission.sway + sway_sd * rng.standard_normal(),
        )
        end = mission.track(wrong, mission.measured)[-1] - exact[-1]
        squares.append(end @ end)
    return math.sqrt(np.mean(squares))


@pytest.mark.parametrize("pitch", [0.0, -0.5, -1.0])
def test_a_networks_spread_of_surge_is_the_spread_of_the_end(pitch):
    """One error along the track: s t / cos(pitch), shared between north and east."""
    mission = reference(pitch)
    time = PERIOD * (SAMPLES - 1)
    exact = 0.01 * time / math.cos(pitch)
    assert predicted(mission, surge_sd=0.01) == pytest.approx(exact, rel=1e-3)
    assert drawn(mission, surge_sd=0.01) == pytest.approx(exact, rel=0.1)


@pytest.mark.parametrize("pitch", [0.0, -0.5])
def test_a_networks_spread_of_sway_is_the_spread_of_the_end(pitch):
    mission = reference(pitch)
    exact = 0.02 * PERIOD * (SAMPLES - 1)
    assert predicted(mission, sway_sd=0.02) == pytest.approx(exact, rel=1e-3)
    assert drawn(mission, sway_sd=0.02) == pytest.approx(exact, rel=0.1)


def test_spreads_and_the_models_own_error_add_as_variances():
    mission = reference(0.0)
    time = PERIOD * (SAMPLES - 1)
    both = predicted(mission, surge_sd=0.03, sway_sd=0.04)
    assert both == pytest.approx(0.05 * time, rel=1e-3)
    model = ErrorModel(**{**STILL, "velocity_sd": 0.01, "velocity_time": 1e9})
    estimate = Estimate(
        surge=mission.surge, sway=mission.sway, surge_sd=np.full(SAMPLES, 0.01 * math.sqrt(2.0))
    )
    # two components of the model's own and one of the network's, which is sqrt(2) larger
    sd = network_position_sd(mission, estimate, model)[-1]
    assert sd == pytest.approx(math.sqrt(2 + 2) * 0.01 * time, rel=1e-3)


def test_the_current_is_unknown_for_a_quarter_of_the_tide():
    """3 h of correlation: after 30 h of 0.1 m/s the end is off by s sqrt(4 T (t - T))."""
    assert ErrorModel().current_time == 3.0 * 3600.0
    hours, period = 30, 60.0
    velocity = np.zeros((hours * 60 + 1, 2))
    sd = position_sd(velocity, period, ErrorModel(**{**STILL, "current_sd": 0.1}))[-1]
    t, correlation = hours * 3600.0, 10800.0
    assert sd == pytest.approx(0.1 * math.sqrt(4 * correlation * (t - correlation)), rel=1e-3)


def test_the_default_error_model_is_the_papers():
    """0.8 deg of the paper's table on the 3DM-GX5-25; 3 to 5 m of a GPS fix."""
    assert pytest.approx(math.radians(0.8)) == COMPASS_SD
    model = ErrorModel()
    assert model.heading_sd == COMPASS_SD
    assert (model.velocity_sd, model.fix_sd, model.current_sd) == (0.005, 4.0, 0.0)
    assert model.velocity_time == 4.0 * 3600.0


# --- Deviations of positions from a model of the errors, against known answers


def model(**changes):
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
