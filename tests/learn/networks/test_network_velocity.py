"""A trained run on board: sample by sample what its networks say of whole missions."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
import torch
from glides import changed, glides
from navigation import PERIOD, synthetic_mission

import twin
from learn.data.dataset import MissionSequence, load_missions
from learn.data.sequences import Normalisation
from learn.networks.base import NetworkConfig, build_network
from learn.networks.network_estimator import FASTEST, NetworkFlight, NetworkVelocity
from learn.networks.predictor import Ensemble, Predictor
from learn.run import open_run
from learn.seams import NETWORKS
from twin.errors import InputError, StoreError
from twin.logs.flight_estimator import ESTIMATORS
from twin.navigation.estimators import VELOCITY_ESTIMATORS
from twin.navigation.estimators.base import VelocityDeviation
from twin.navigation.features import select_features
from twin.navigation.navigator import Navigator
from twin.navigation.settings import ESTIMATED, estimate

ROOT = Path(__file__).resolve().parents[3]
OLD = ROOT / "tests" / "data" / "e2ff189"
FEATURES = select_features(without=["gravity"])


def ensemble(kind, target, matrix, members=1, features=FEATURES):
    def member(seed):
        torch.manual_seed(seed)
        config = NetworkConfig(kind=kind, inputs=len(features), period=PERIOD, hidden=6, layers=2)
        scales = Normalisation(
            features=tuple(features),
            mean=tuple(float(x) for x in matrix.mean(0)),
            scale=tuple(float(x) + 1e-3 for x in matrix.std(0)),
            target=target, target_mean=0.3, target_scale=0.1,
        )  # fmt: skip
        return Predictor(build_network(config), scales)

    return Ensemble(tuple(member(seed) for seed in range(members)))


def walk(estimator, signals, first=0, last=None):
    samples = len(signals["measured_depth"])
    found = []
    for k in range(first, samples if last is None else last):
        velocity = estimator.step({name: signals[name][k] for name in estimator.channels})
        found.append((velocity.surge, velocity.sway))
    return np.array(found)


@pytest.mark.parametrize("kind", NETWORKS.shipped())
def test_a_network_step_by_step_is_that_of_whole_missions(kind):
    signals = synthetic_mission(240, 3)
    mission = MissionSequence(index=0, split="test", period=PERIOD, signals=signals)
    matrix = mission.features(FEATURES)
    networks = {name: ensemble(kind, name, matrix) for name in ("surge", "sway")}
    estimator = NetworkVelocity(networks, PERIOD)
    found = walk(estimator, signals)
    for k, name in enumerate(("surge", "sway")):
        whole, _ = networks[name].predict([mission])[0]
        assert np.allclose(found[:, k], whole, atol=2e-6)
        assert np.ptp(whole) > 1e-3
    estimator.reset()
    walk(estimator, signals, last=100)
    other = NetworkVelocity(networks, PERIOD)
    other.restore(estimator.state())
    assert np.array_equal(walk(other, signals, first=100), found[100:])


ABSURD = {"measured_depth": (65535.0, math.nan, 4000.0), "measured_density": (0.0, 1e300),
          "measured_pitch": (math.inf, -1e6), "measured_yaw_rate": (math.nan, 30.0)}  # fmt: skip
"""Of a sensor once: sentinels, overflows, a bit that flipped"""


def test_one_absurd_sample_leaves_no_trace_after_a_second():
    signals, _, _ = glides(changed(drag=1.08), pitches=(-25.0,))
    vehicle = twin.load_vehicle("glider")
    signals |= estimate(signals, vehicle, PERIOD, mission=0)
    mission = MissionSequence(index=0, split="test", period=PERIOD, signals=signals)
    features = ("sin_pitch", "depth_rate", "yaw_rate", "flight_surge", "flight_attack")
    matrix = mission.features(features)
    networks = {n: ensemble("ema", n, matrix, features=features) for n in ("surge", "sway")}
    clean, struck = (NetworkVelocity(networks, PERIOD, vehicle) for _ in range(2))
    missing = struck.step({"measured_pitch": -20.0})  # no exception, and no memory
    assert (missing.surge, missing.sway) == (0.0, 0.0)
    struck.reset()
    blows = [(c, v) for c, values in ABSURD.items() for v in values if c in struck.channels]
    assert len(blows) > 5
    for k in range(20 * len(blows)):
        sample = {name: signals[name][k] for name in clean.channels}
        wanted, bad = clean.step(sample), dict(sample)
        if k % 20 == 10:
            channel, value = blows[k // 20]
            bad[channel] = value
        found = struck.step(bad)
        assert struck.held == ((channel,) if k % 20 == 10 else ())
        assert math.isfinite(found.surge + found.sway)
        if k % 20 >= 12:
            assert found.surge == pytest.approx(wanted.surge, abs=0.01)
            assert found.sway == pytest.approx(wanted.sway, abs=0.01)


def test_a_channel_that_falls_silent_is_a_state_and_comes_back():
    signals = synthetic_mission(60, 5)
    mission = MissionSequence(index=0, split="test", period=PERIOD, signals=signals)
    networks = {n: ensemble("ema", n, mission.features(FEATURES)) for n in ("surge", "sway")}
    estimator = NetworkVelocity(networks, PERIOD)
    walk(estimator, signals, last=30)
    sample = {name: signals[name][30] for name in estimator.channels}
    silent = {k: v for k, v in sample.items() if k != "measured_pitch"}
    for _ in range(500):
        said = estimator.step(silent)
        assert estimator.held == ("measured_pitch",)
        assert abs(said.surge) <= FASTEST
    estimator.step(sample)
    assert estimator.held == ()


def test_networks_that_read_the_flight_filter_navigate_with_it():
    signals, _, _ = glides(changed(drag=1.08), pitches=(-25.0, 32.0))
    vehicle = twin.load_vehicle("glider")
    signals |= estimate(signals, vehicle, PERIOD, mission=0)
    mission = MissionSequence(index=0, split="test", period=PERIOD, signals=signals)
    features = ("sin_pitch", "flight_surge", "flight_attack")
    matrix = mission.features(features)
    networks = {n: ensemble("ema", n, matrix, features=features) for n in ("surge", "sway")}
    estimator = NetworkVelocity(networks, PERIOD, vehicle)
    assert not set(estimator.channels) & set(ESTIMATED)
    found = walk(estimator, signals, last=1500)
    whole, _ = networks["surge"].predict([mission])[0]
    assert np.allclose(found[:, 0], whole[:1500], atol=2e-6)
    assert np.ptp(whole) > 1e-3
    estimator.reset()
    walk(estimator, signals, last=1100)
    other = NetworkVelocity(networks, PERIOD, vehicle)
    other.restore(estimator.state())
    assert np.array_equal(walk(other, signals, first=1100, last=1500), found[1100:])
    with pytest.raises(InputError, match="read the flight filter, which needs a vehicle"):
        NetworkVelocity(networks, PERIOD)


def test_it_states_what_validation_showed_and_not_how_far_members_differ():
    signals = synthetic_mission(60, 4)
    mission = MissionSequence(index=0, split="test", period=PERIOD, signals=signals)
    matrix = mission.features(FEATURES)
    networks = {name: ensemble("mlp", name, matrix, members=3) for name in ("surge", "sway")}
    stated = VelocityDeviation(scale=0.004, noise=0.002)
    estimator = NetworkVelocity(networks, PERIOD, deviation=stated)
    for k in range(60):
        last = estimator.step({name: signals[name][k] for name in estimator.channels})
    for k, name in enumerate(("surge", "sway")):
        mean, _ = networks[name].predict([mission])[0]
        assert (last.surge, last.sway)[k] == pytest.approx(mean[-1], abs=1e-6)
    assert last.covariance is None
    filter_ = Navigator(estimator, latitude=30.0, compass=0.7).filter
    assert (filter_.parameters.speed_scale, filter_.parameters.compass) == (0.004, 0.7)


def test_a_run_folder_opens_as_one_and_navigates():
    estimator = NetworkVelocity.open(str(OLD / "run"), twin.load_vehicle("glider"), 0.5)
    run = open_run(OLD / "run")
    assert estimator.period == run.period
    mission = load_missions(OLD / "simulated.zarr", estimator.channels, period=run.period)[0]
    found = walk(estimator, mission.signals)
    whole, _ = run.networks()["surge"].predict([mission])[0]
    assert np.allclose(found[:, 0], whole, atol=1e-5)
    flown = twin.simulate(
        mission="default", duration=90.0, sensors="ideal", navigate=estimator,
        sample_period=run.period,
    )  # fmt: skip
    assert np.isfinite(flown["measured_onboard_north"]).all()


def test_it_is_an_entry_point_and_opens_the_shipped_networks(tmp_path):
    points = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    place = f"{NetworkVelocity.__module__}:{NetworkVelocity.__name__}"
    assert points[VELOCITY_ESTIMATORS.group] == {NetworkVelocity.kind: place}
    assert VELOCITY_ESTIMATORS.check("network", NetworkVelocity) is NetworkVelocity
    vehicle = twin.load_vehicle("glider")
    shipped = NetworkVelocity.open("", vehicle, 2.0)
    assert shipped.period == 2.0
    assert "measured_density" not in shipped.channels
    with pytest.raises((InputError, StoreError)):
        NetworkVelocity.open(str(tmp_path), vehicle, 0.5)


def test_a_state_of_other_networks_is_refused():
    matrix = MissionSequence(
        index=0, split="test", period=PERIOD, signals=synthetic_mission(50, 1)
    ).features(FEATURES)
    small = NetworkVelocity({n: ensemble("mlp", n, matrix) for n in ("surge", "sway")}, PERIOD)
    large = NetworkVelocity({n: ensemble("gru", n, matrix) for n in ("surge", "sway")}, PERIOD)
    with pytest.raises(InputError, match="of other networks"):
        large.restore(small.state())


# --- A trained run as an estimator of `twin flight`


STORE = OLD / "simulated.zarr"


def test_the_velocities_are_those_of_the_run():
    estimator = NetworkFlight.open(str(OLD / "run"))
    found = twin.estimate_flight(STORE, estimator=estimator)
    assert found.estimator == "network"
    predicted = {one.mission: one for one in estimator.run.predict(STORE)}
    assert found.flown
    for one in found.missions:
        if one.dive.motion is None:
            continue
        step = round(estimator.run.period / found.store.period)
        surge = predicted[one.dive.mission].surge
        np.testing.assert_allclose(one.dive.motion.surge[::step][: len(surge)], surge, rtol=1e-6)
        assert np.isfinite(one.dive.motion.heave).all()
        under = one.dive.depth > 1.0
        assert np.hypot(*one.dive.velocity.T)[under].mean() > 0.1


def test_network_flight_is_an_entry_point_and_opens_the_shipped_networks(tmp_path):
    points = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    place = f"{NetworkFlight.__module__}:{NetworkFlight.__name__}"
    assert points[ESTIMATORS.group] == {NetworkFlight.kind: place}
    assert ESTIMATORS.check("network", NetworkFlight) is NetworkFlight
    assert NetworkFlight.open("").run is None
    with pytest.raises((InputError, StoreError)):
        NetworkFlight.open(str(tmp_path))
