"""Baselines: on steady glides that a vehicle flies, and sample by sample; the EKF is honest."""

import numpy as np
import pytest
from navigation import PERIOD, steady_mission, trimmed_mission
from torpedo import TORPEDO

import twin
from twin.errors import InputError, StoreError
from twin.fossen import FossenModel, FossenState
from twin.mission.controller import Schedule
from twin.navigation.dead_reckoning import bridge, hold, smooth
from twin.navigation.estimators import (
    BodyVelocity,
    VelocityEstimator,
    baselines,
    open_velocity_estimator,
    usual_velocity_estimator,
)
from twin.navigation.estimators.ekf import DEPTH, NET_ERROR, SURGE, SWAY, Ekf, EkfNoise, _predict
from twin.navigation.estimators.flight import (
    OnboardReckoning,
    PitchPlusAlpha,
    SteadyFlight,
    steady_angle_of_attack,
)
from twin.seams import VELOCITY_ESTIMATORS
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")
GLIDES = {
    "dive": {"net_mass": 0.3, "shift": 0.02},
    "climb": {"net_mass": -0.3, "shift": -0.02},
    "spiral": {"net_mass": 0.3, "shift": 0.02, "rotation": np.deg2rad(45.0)},
    "climbing spiral": {"net_mass": -0.3, "shift": -0.02, "rotation": np.deg2rad(-25.0)},
}


@pytest.fixture(scope="module", params=GLIDES)
def glide(request):
    depth = 50.0 if GLIDES[request.param]["net_mass"] > 0 else 400.0
    return trimmed_mission(1200, depth=depth, **GLIDES[request.param])


SHIPPED = VELOCITY_ESTIMATORS.shipped()


@pytest.mark.parametrize("name", SHIPPED)
def test_each_baseline_needs_no_more_than_the_channels_it_names(name):
    signals = trimmed_mission(300)
    signals["measured_density"] = np.full(len(signals["measured_depth"]), VEHICLE.reference_density)
    baseline = VELOCITY_ESTIMATORS[name](VEHICLE, PERIOD)
    seen = {c: signals[c] for c in baseline.needs(VEHICLE)}
    baseline.batch(seen)
    seen.pop(baseline.channels[0])
    if name != "dvl":  # its velocities may have gaps, its attitude may not
        with pytest.raises(StoreError, match=baseline.channels[0]):
            baseline.batch(seen)


def test_steady_flight_finds_the_steady_glide(glide):
    estimate = SteadyFlight(VEHICLE, PERIOD).batch(glide)
    inside = slice(40, -40)  # smoothing is one-sided at the ends
    assert estimate.surge[inside] == pytest.approx(glide["true_surge"][inside], abs=2e-4)
    assert estimate.sway[inside] == pytest.approx(glide["true_sway"][inside], abs=3e-4)


def test_steady_flight_speed_hardly_depends_on_a_wrong_drag(glide):
    heavy = VEHICLE.replace(drag=(1.2 * VEHICLE.flow_frame.drag[0], VEHICLE.flow_frame.drag[1]))
    estimate = SteadyFlight(heavy, PERIOD).batch(glide)
    # 20 % of drag are 9 % of the buoyancy's speed; the depth rate leaves the angle of attack.
    assert estimate.surge[600] == pytest.approx(glide["true_surge"][600], rel=0.012)


def test_the_ekf_settles_on_the_steady_glide(glide):
    estimate = Ekf(VEHICLE, PERIOD).batch(glide)
    assert estimate.surge[-1] == pytest.approx(glide["true_surge"][-1], abs=1e-3)
    assert estimate.sway[-1] == pytest.approx(glide["true_sway"][-1], abs=5e-4)


def test_pitch_plus_alpha_on_a_straight_glide_errs_by_its_constant():
    signals = trimmed_mission(1200)
    baseline = PitchPlusAlpha(VEHICLE, PERIOD)
    estimate = baseline.batch(signals)
    assert (estimate.sway == 0).all()
    pitch = np.deg2rad(-signals["true_pitch"][0])
    down = signals["true_velocity_down"][0]
    alpha = baseline.angle_of_attack
    assert estimate.surge[600] == pytest.approx(down / np.sin(pitch + alpha) * np.cos(alpha))
    assert estimate.surge[600] == pytest.approx(signals["true_surge"][600], rel=0.02)


def test_the_constant_angle_of_attack_is_the_trimmed_one():
    model = FossenModel(VEHICLE)
    for shift in (0.012, 0.02, 0.03):
        dive = model.steady_motion(shift, 0.0, 0.3).trim
        climb = model.steady_motion(-shift, 0.0, -0.3).trim
        for steady in (dive, climb):
            found = np.rad2deg(steady_angle_of_attack(VEHICLE, np.deg2rad(abs(steady.pitch_deg))))
            # Lift at zero angle differs in sign between dive and climb; the constant is between.
            assert found == pytest.approx(abs(steady.angle_of_attack_deg), abs=0.12)


@pytest.mark.parametrize("offset", [-1.4, 0.0, 1.4])
def test_at_the_surface_nobody_makes_way_even_with_a_gauge_that_is_off(offset):
    rest = {"velocity": (0.0, 0.0, 0.0), "pitch": -0.4, "pump": 400.0}
    signals = steady_mission(1200, depth=0.5 + offset, **rest)
    for name in ("pitch_plus_alpha", "steady_flight"):
        estimate = VELOCITY_ESTIMATORS[name](VEHICLE, PERIOD).batch(signals)
        assert (estimate.surge == 0).all(), name
    estimate = Ekf(VEHICLE, PERIOD).batch(signals)
    assert np.abs(estimate.surge[-1]) < 0.02


@pytest.mark.parametrize(("vehicle", "by_doppler_log"), [("glider", False), ("remus", True)])
def test_the_onboard_track_of_a_propelled_vehicle_may_have_seen_the_bottom(vehicle, by_doppler_log):
    """Without a fix it is a track over ground all the same; a glider's is one through the water."""
    track = {"measured_onboard_north": np.arange(9.0), "measured_onboard_east": np.zeros(9)}
    found = OnboardReckoning(load_vehicle(vehicle), PERIOD).batch(track)
    assert found.saw_bottom is by_doppler_log
    np.testing.assert_array_equal(found.ground_track[:, 0], np.arange(9.0))


# --- EKF --------------------------------------------------------------------------------------


def test_the_ekf_follows_a_manoeuvre_of_the_full_model():
    model = FossenModel(VEHICLE)
    heavy, light = (VEHICLE.pump_for_net_mass(mass) for mass in (0.3, -0.3))
    commands = Schedule(
        times=[0.0, 300.0, 900.0],
        commands=[(0.02, 0.0, heavy), (0.02, 0.7, heavy), (-0.02, 0.7, light)],
    )
    start = FossenState(position_ned=(0.0, 0.0, 20.0))
    flown = model.simulate(start, commands, 1500.0, sample_period=PERIOD)
    roll, pitch, heading = np.rad2deg(flown.attitude).T
    signals = {
        "measured_depth": flown.position_ned[:, 2],
        "measured_roll": roll,
        "measured_pitch": pitch,
        "measured_heading": heading,
        "measured_pump": flown.actuators[:, 2],
        "measured_shift": flown.actuators[:, 0],
        "measured_rotation": np.rad2deg(flown.actuators[:, 1]),
    }
    for k, name in enumerate(("roll", "pitch", "yaw")):
        signals[f"measured_{name}_rate"] = flown.rates[:, k]
    estimate = Ekf(VEHICLE, PERIOD).batch(signals)
    surge, sway = flown.v_rel[:, 0], flown.v_rel[:, 1]
    assert np.sqrt(np.mean((estimate.surge - surge) ** 2)) < 2e-3
    assert np.sqrt(np.mean((estimate.sway - sway) ** 2)) < 5e-4


def test_the_ekf_is_consistent_on_data_of_its_own_model():
    """Innovations are white with the predicted size, and errors match their covariance.

    Bar-Shalom et al. 2001, section 5.4: normalised squares average to their dimension.
    """
    noise = EkfNoise(net_mass=1e-3)
    runs = [_simulate_ekf_data(noise, seed) for seed in range(6)]
    nis, nees = [], []
    for signals, truth in runs:
        run = Ekf(VEHICLE, PERIOD, noise).run(signals)
        late = slice(200, None)
        nis.append(np.mean((run.innovations / run.innovation_sd)[late] ** 2))
        error = run.states - truth
        for k in (SURGE, SWAY, DEPTH, NET_ERROR):
            nees.append(np.mean(error[late, k] ** 2 / run.covariances[late, k, k]))
        white = (run.innovations / run.innovation_sd)[late]
        assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.1
    assert np.mean(nis) == pytest.approx(1.0, abs=0.06)
    assert np.mean(nees) == pytest.approx(1.0, abs=0.35)


def _simulate_ekf_data(noise: EkfNoise, seed: int):
    """Signals and true states (time, 5) of the filter's own stochastic model."""
    rng = np.random.default_rng(seed)
    samples = 1500
    signals = trimmed_mission(samples)
    model = Ekf(VEHICLE, PERIOD, noise).model
    pitch = np.deg2rad(signals["measured_pitch"][0])
    given = np.array([-np.sin(pitch), 0.0, np.cos(pitch), 0.0, 0.0, 0.0, 0.3])
    spread = np.sqrt(PERIOD * model.process)
    truth = np.zeros((samples, 5))
    truth[0, :3] = noise.initial_velocity * rng.standard_normal(3)
    truth[0, 4] = noise.initial_net_mass * rng.standard_normal()
    truth[0, 3] = 50.0
    for k in range(1, samples):
        ahead = _predict(model, tuple(truth[k - 1]), given, given, PERIOD)
        truth[k] = ahead + spread * rng.standard_normal(5)
    signals["measured_depth"] = truth[:, 3] + noise.depth * rng.standard_normal(samples)
    return signals, truth


def test_ekf_noise_must_be_positive():
    with pytest.raises(InputError, match="depth noise is 0"):
        EkfNoise(depth=0.0)


# --- helpers ----------------------------------------------------------------------------------


def test_smoothing_keeps_lines_and_averages_noise():
    line = np.arange(200.0)
    assert smooth(line, 10.0, PERIOD)[20:-20] == pytest.approx(line[20:-20])
    noise = np.random.default_rng(0).standard_normal(20000)
    assert smooth(noise, 10.0, PERIOD).std() == pytest.approx(1 / np.sqrt(21), rel=0.1)


def test_hold_and_bridge():
    values = np.array([1.0, 9.0, 3.0, 9.0, 5.0, 9.0])
    valid = np.array([False, False, True, False, True, False])
    assert hold(values, valid) == pytest.approx([0, 0, 3, 3, 5, 5])
    assert bridge(values, valid) == pytest.approx([0, 0, 3, 4, 5, 0])
    assert bridge(values, np.zeros(6, bool), outside=2.0) == pytest.approx(np.full(6, 2.0))


# --- sample by sample -----------------------------------------------------------------------------


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
