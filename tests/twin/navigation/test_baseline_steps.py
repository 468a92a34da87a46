"""Baselines sample by sample: what they say of the last sample of what was seen so far."""

import numpy as np
import pytest
from navigation import PERIOD
from torpedo import TORPEDO

import twin
from twin.errors import InputError
from twin.navigation.estimators import (
    BodyVelocity,
    VelocityEstimator,
    baselines,
    open_velocity_estimator,
    usual_velocity_estimator,
)
from twin.seams import VELOCITY_ESTIMATORS
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")
STEPPED = [name for name in VELOCITY_ESTIMATORS.shipped() if name != "onboard"]


@pytest.fixture(scope="module")
def flown():
    """Two inflections under water, by the sensors of `field`, with a bottom for the log."""
    mission = twin.Mission(
        name="under",
        segments=[
            twin.SawTooth(
                pitch_deg=25.0, max_depth_m=45.0, min_depth_m=33.0, yos=2, heading_deg=50.0
            )
        ],
        start_depth_m=30.0,
    )
    run = twin.simulate(mission=mission, sensors="field", bottom_depth=90.0, duration=450.0)
    density = np.array(run["true_density"])  # a CTD measures where water has a temperature
    return {name: np.array(run[name]) for name in run} | {"measured_density": density}


def steps(estimator, flown, first=0, last=None):
    last = len(flown["measured_depth"]) if last is None else last
    found = []
    for k in range(first, last):
        velocity = estimator.step({name: flown[name][k] for name in estimator.channels})
        found.append((velocity.surge, velocity.sway))
    return np.array(found)


@pytest.mark.parametrize("name", STEPPED)
def test_a_baseline_step_by_step_says_what_it_says_of_the_last_sample(name, flown):
    estimator = open_velocity_estimator(name, VEHICLE, PERIOD)
    found = steps(estimator, flown)
    for last in (50, 300, 700, 880):
        seen = {channel: values[: last + 1] for channel, values in flown.items()}
        whole = estimator.batch(seen)
        if whole.surge is None:  # of the log the evaluation asks for more water lock
            whole = estimator.batch(seen, least_water=0.0)
        assert found[last, 0] == pytest.approx(whole.surge[-1], abs=1e-9)
        assert found[last, 1] == pytest.approx(whole.sway[-1], abs=1e-9)
    under_way = (flown["true_depth"] > 10.0) & (np.arange(len(found)) > 200)
    error = (found[:, 0] - flown["true_surge"])[under_way]
    assert np.sqrt(np.mean(error**2)) < 0.1


@pytest.mark.parametrize("name", STEPPED)
def test_an_estimator_goes_on_from_its_state_and_begins_again(name, flown):
    one = open_velocity_estimator(name, VEHICLE, PERIOD)
    whole = steps(one, flown, last=400)
    one.reset()
    steps(one, flown, last=250)
    other = open_velocity_estimator(name, VEHICLE, PERIOD)
    other.restore(one.state())
    assert np.array_equal(steps(other, flown, 250, 400), whole[250:])


def test_estimators_refuse_what_they_cannot_do():
    torpedo = load_vehicle(str(TORPEDO))
    with pytest.raises(InputError, match="takes no argument, not 'x'"):
        open_velocity_estimator("ekf:x", VEHICLE, PERIOD)
    with pytest.raises(InputError, match=r"estimator 'steady_flight': vehicle .* does not glide"):
        open_velocity_estimator("steady_flight", torpedo, PERIOD)
    with pytest.raises(InputError, match="unknown velocity estimator 'efk': did you mean 'ekf'"):
        open_velocity_estimator("efk", VEHICLE, PERIOD)
    with pytest.raises(InputError, match="choose pitch_plus_alpha"):
        open_velocity_estimator("onboard", VEHICLE, PERIOD)
    with pytest.raises(InputError, match="no channel 'measured_depth'"):
        open_velocity_estimator("pitch_plus_alpha", VEHICLE, PERIOD).step({})
    assert usual_velocity_estimator(VEHICLE, PERIOD).kind == "ekf"
    assert usual_velocity_estimator(torpedo, PERIOD).kind == "dvl"


def test_an_estimator_that_is_only_half_there_is_refused():
    class Half(VelocityEstimator):
        kind = "half"
        summary = "half"

    with pytest.raises(InputError, match="only half there: it lacks the method `step`"):
        VELOCITY_ESTIMATORS.add(Half)


def test_an_estimator_with_a_step_alone_goes_over_whole_missions_and_is_a_baseline(flown):
    class Fast(VelocityEstimator):
        kind = "fast"
        summary = "half a metre a second, faster than the pitch"
        channels = ("measured_depth", "measured_pitch")

        def step(self, sample):
            return BodyVelocity(surge=0.5 * (sample["measured_depth"] > 1.0), sway=0.01)

    VELOCITY_ESTIMATORS.add(Fast)
    try:
        assert baselines()["fast"] is Fast
        assert "network" not in baselines()
        found = open_velocity_estimator("fast", VEHICLE, PERIOD).batch(flown)
    finally:
        VELOCITY_ESTIMATORS.unregister("fast")
    assert np.array_equal(found.surge, 0.5 * (flown["measured_depth"] > 1.0))
    assert (found.sway == 0.01).all()
