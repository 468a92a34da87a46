"""Evaluation: figures that can be worked out by hand, and bad stores."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from navigation import PERIOD, add_fixes, steady_mission, trimmed_mission, write_store

from learn.data.dataset import MissionSequence, load_missions
from learn.data.labels import LabelConfig
from learn.evaluation.deviation import Coverage, ErrorModel, fit_error_model, surge_interval
from learn.evaluation.evaluation import evaluate
from learn.evaluation.judged_tracks import TrackCollector, compare
from learn.evaluation.score import ReferenceVelocity, score_mission, summarise_scores, visible
from learn.networks.predictor import Adapted
from twin.cli.console import to_json
from twin.errors import InputError, StoreError
from twin.navigation.estimators import baselines
from twin.navigation.estimators.base import Estimate
from twin.navigation.flight_filter import FlightStart
from twin.records.reader import MissionStore
from twin.records.tracks import read_tracks
from twin.vehicle.vehicle import load_vehicle

ISSUE_KEYS = (
    *("missions", "surge_mse", "sway_mse", "surge_mse_after_30s", "sway_mse_after_30s"),
    *("dr_water_percent_mean", "dr_water_percent_p90"),
    *("dr_velocity_percent_mean", "dr_velocity_percent_p90"),
    *("dr_ground_percent_mean", "dr_ground_percent_p90"),
)


CHANNELS = tuple(steady_mission(2))


class Oracle:
    """Stands for an ensemble: the truth of each mission, scaled and shifted."""

    start = None
    spread = None

    def __init__(self, target, truth, scale=1.0, shift=0.0, spread=0.0):
        self.members = (SimpleNamespace(features=("sin_pitch", "depth_rate")),)
        self.target, self.truth = target, truth
        self.scale, self.shift, self.spread = scale, shift, spread

    def predict(self, missions):
        return [
            (
                self.scale * self.truth[m.index][f"true_{self.target}"] + self.shift,
                np.full(m.samples, self.spread),
            )
            for m in missions
        ]


def oracles(missions, **surge):
    return {"surge": Oracle("surge", missions, **surge), "sway": Oracle("sway", missions)}


def fixed_mission(**more):
    """Two dives between fixes, in a uniform current."""
    signals = trimmed_mission(4000, heading=0.3, **more)
    add_fixes(signals, [0, 20, 1800, 1810, 3990])
    return signals


@pytest.fixture(scope="module")
def missions():
    return [
        trimmed_mission(1500, heading=0.3, current=(0.05, 0.0)),
        trimmed_mission(1200, net_mass=-0.3, shift=-0.02, depth=400.0, heading=2.0),
        fixed_mission(current=(0.03, -0.1)),
    ]


@pytest.fixture(scope="module")
def store(missions, tmp_path_factory):
    return write_store(tmp_path_factory.mktemp("evaluate") / "s.zarr", missions, [2, 0, 2])


def test_the_json_object_has_every_key_of_every_method(store, missions):
    found = to_json(evaluate(oracles(missions), store, split="all").to_json())
    json.dumps(found, allow_nan=False)
    assert set(found["baselines"]) == set(baselines())
    for figures in (found, found["floor"], *found["baselines"].values()):
        assert set(ISSUE_KEYS) <= set(figures)
    onboard = found["baselines"]["onboard"]
    assert onboard["surge_mse"] is None
    assert onboard["dr_velocity_percent_mean"] is None
    assert found["baselines"]["dvl"]["dr_water_percent_mean"] is None  # it never had lock
    assert found["missions"] == 3


def test_the_split_is_obeyed(store, missions):
    assert evaluate(oracles(missions), store, baselines=()).to_json()["missions"] == 2
    found = evaluate(oracles(missions), store, split="train", baselines=())
    assert [s.mission for s in found.methods["network"].scores] == [1]


def test_true_velocities_with_ideal_sensors_leave_nothing(store, missions):
    found = evaluate(oracles(missions), store, split="all", baselines=()).to_json()
    for figures in (found, found["floor"]):
        assert figures["surge_mse"] < 1e-12
        for track in ("water", "velocity"):
            assert figures[f"dr_{track}_percent_mean"] < 1e-3


def test_a_scaled_surge_gives_the_error_that_the_kinematics_say(missions, tmp_path):
    straight = missions[:1]
    path = write_store(tmp_path / "s.zarr", straight, [2])
    found = evaluate(oracles(straight, scale=1.02), path, baselines=()).to_json()
    surge, pitch = straight[0]["true_surge"][0], np.deg2rad(straight[0]["true_pitch"][0])
    assert found["surge_mse"] == pytest.approx((0.02 * surge) ** 2, rel=1e-4)
    speed = np.hypot(
        straight[0]["true_velocity_north"][0] - 0.05, straight[0]["true_velocity_east"][0]
    )
    # Heave is solved from the depth rate, so an error of surge counts 1 / cos(pitch).
    expected = 100 * 0.02 * surge / np.cos(pitch) / speed
    assert found["dr_water_percent_mean"] == pytest.approx(expected, rel=1e-3)
    assert found["dr_water_max_percent_mean"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("name", ["surge", "sway"])
@pytest.mark.parametrize(("interval", "within"), [(0.012, 1.0), (0.008, 0.0)])
def test_a_constant_error_is_as_large_whatever_the_velocity(name, interval, within):
    """0.01 m/s beside a velocity that is not 0, in both; the Doppler log tells the truth."""
    signals = steady_mission(400, velocity=(0.4, -0.1, 0.0), pitch=0.0)
    signals["measured_dvl_mode"] = np.full(400, 2.0)  # lock on the water
    for axis in ("surge", "sway", "heave"):
        signals[f"measured_dvl_{axis}"] = signals[f"true_{axis}"]
    reference = ReferenceVelocity.of(mission_of(signals))
    truth = {"surge": reference.surge, "sway": reference.sway}
    estimate = Estimate(**{**truth, name: truth[name] + 0.01})
    figures = summarise_scores([score_mission(reference, estimate)])
    assert figures[f"{name}_mse"] == pytest.approx(1e-4)
    coverage = Coverage(ErrorModel(surge_interval=interval, sway_interval=interval))
    coverage.add(reference, {"network": estimate})
    assert coverage.figures()[f"{name}_within"] == within
    assert coverage.figures()["surge_within" if name == "sway" else "sway_within"] == 1.0
    log = Estimate(ground_track=reference.ground_track)
    compared = compare(reference, estimate, log, LabelConfig(source="dvl"))
    assert compared.squared[name] == pytest.approx(1e-4 * compared.samples)
    assert compared.samples > 300


def test_over_ground_the_current_is_missed(store, missions):
    reference = ReferenceVelocity.of(load_missions(store, CHANNELS, split="test")[0])
    truth = Estimate(surge=reference.surge, sway=reference.sway)
    score = score_mission(reference, truth)
    assert score.tracks["ground"].end_m == pytest.approx(0.05 * 1499 * PERIOD, rel=1e-3)
    assert score.tracks["water"].end_m < 0.01


def test_after_30_s_leaves_out_the_launch(missions):
    reference = ReferenceVelocity.of(mission_of(missions[0]))
    surge = reference.surge.copy()
    surge[:60] += 0.1
    figures = summarise_scores([score_mission(reference, Estimate(surge=surge, sway=surge))])
    assert figures["surge_mse"] == pytest.approx(0.01 * 60 / 1500)
    assert figures["surge_mse_after_30s"] == pytest.approx(0.0, abs=1e-20)


def mission_of(signals, index=0):
    return MissionSequence(index=index, split="test", period=PERIOD, signals=signals)


def test_attitude_errors_count_in_water_but_not_in_velocity(missions):
    signals = dict(missions[0])
    signals["measured_heading"] = signals["measured_heading"] + 1.0
    reference = ReferenceVelocity.of(mission_of(signals))
    score = score_mission(reference, Estimate(surge=reference.surge, sway=reference.sway))
    assert score.tracks["water"].percent == pytest.approx(100 * np.deg2rad(1.0), rel=1e-3)
    assert score.tracks["velocity"].percent < 1e-6


def test_dives_are_judged_by_what_is_known_of_the_current(missions):
    signals = fixed_mission(current=(0.03, -0.1))
    reference = ReferenceVelocity.of(mission_of(signals))
    dives = score_mission(reference, Estimate(surge=reference.surge, sway=reference.sway)).dives
    assert {name: len(found) for name, found in dives.items()} == {
        "none": 1,
        "previous": 1,
        "corrected": 1,
    }
    seconds = (3990 - 1810) * PERIOD
    assert dives["none"][0].end_m == pytest.approx(np.hypot(0.03, 0.1) * seconds, rel=1e-6)
    assert dives["previous"][0].end_m < 1e-6
    assert dives["corrected"][0].max_m < 1e-6


def test_the_onboard_track_counts_before_its_fixes_and_through_water_without_any(missions):
    signals = fixed_mission(current=(0.0, 0.0))
    off = 7.0 * (np.arange(4000) > 1900)
    signals["measured_onboard_north"] = signals["true_north"] + off
    reference = ReferenceVelocity.of(mission_of(signals))
    track = np.stack([signals[f"measured_onboard_{n}"] for n in ("north", "east")], 1)
    logged = Estimate(ground_track=track, uses_fixes=True)
    score = score_mission(reference, logged)
    assert score.tracks == {}
    assert score.dives["previous"][0].end_m == pytest.approx(7.0)
    free = trimmed_mission(500)
    free["measured_onboard_north"] = free["true_north"] + 3.0
    reference = ReferenceVelocity.of(mission_of(free))
    track = np.stack([free[f"measured_onboard_{n}"] for n in ("north", "east")], 1)
    score = score_mission(reference, Estimate(ground_track=track, uses_fixes=True))
    assert score.tracks["water"].end_m == pytest.approx(3.0)


def test_baselines_never_see_truth(store):
    mission = load_missions(store, CHANNELS, split="test")[0]
    assert not [name for name in visible(mission) if name.startswith("true_")]
    assert "measured_depth" in visible(mission)


def test_the_nominal_vehicle_comes_from_the_store(tmp_path):
    slocum = load_vehicle("graver-2005")
    path = write_store(tmp_path / "s.zarr", [], attributes={"vehicle_mjcf": slocum.xml})
    assert MissionStore(path).vehicle.mass == slocum.mass
    path = write_store(tmp_path / "plain.zarr", [])
    assert MissionStore(path).vehicle.mass == load_vehicle("glider").mass


def test_a_baseline_without_its_channels_is_left_out_and_said(missions, tmp_path):
    path = write_store(tmp_path / "s.zarr", missions[:1], [2], drop=("measured_dvl_mode",))
    found = evaluate(oracles(missions), path)
    assert found.missing == {
        "dvl": "the store has no channel measured_dvl_mode",
        "flight_filter": "the store has no channel measured_density",
    }
    assert found.to_json()["baselines"]["dvl"]["dr_ground_percent_mean"] is None


# --- bad stores -------------------------------------------------------------------------------


def test_no_store_and_an_empty_store(missions, tmp_path):
    with pytest.raises(StoreError, match="no store at"):
        evaluate(oracles(missions), tmp_path / "none.zarr")
    empty = write_store(tmp_path / "empty.zarr", [])
    with pytest.raises(StoreError, match="holds no missions"):
        evaluate(oracles(missions), empty)


def test_a_store_without_a_split_says_what_to_do(missions, tmp_path):
    path = write_store(tmp_path / "s.zarr", missions[:1])
    with pytest.raises(StoreError, match="--split all"):
        evaluate(oracles(missions), path)
    assert evaluate(oracles(missions), path, split="all", baselines=()).to_json()["missions"] == 1


@pytest.mark.parametrize("channel", ["true_surge", "measured_depth", "measured_heading"])
def test_a_missing_channel_is_named(missions, tmp_path, channel):
    path = write_store(tmp_path / "s.zarr", missions[:1], [2], drop=(channel,))
    with pytest.raises(StoreError, match=f"no channel {channel}"):
        evaluate(oracles(missions), path)


@pytest.mark.parametrize("channel", ["true_sway", "measured_roll", "measured_pump"])
def test_a_channel_that_is_not_finite_is_named_with_its_mission(missions, tmp_path, channel):
    broken = {name: values.copy() for name, values in missions[1].items()}
    broken[channel][33] = np.nan
    path = write_store(tmp_path / "s.zarr", [missions[0], broken], [2, 2])
    with pytest.raises(StoreError, match=rf"mission 1: channel {channel} .*sample 33"):
        evaluate(oracles(missions), path)


# --- tracks -----------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [".nc", ".zarr", ".npz", ".csv"])
def test_tracks_are_read_back_by_the_renderer(store, missions, tmp_path, ending):
    collector = TrackCollector()
    evaluate(oracles(missions), store, watch=collector.add)
    path = collector.write(tmp_path / f"tracks{ending}")
    tracks = {track.name: track for track in read_tracks(path, 2)}
    assert {"network", "network_corrected", "onboard", "steady_flight"} <= set(tracks)
    assert "floor" not in tracks
    corrected = tracks["network_corrected"]
    assert len(corrected.time) == 4000
    truth = missions[2]
    error = np.hypot(corrected.north - truth["true_north"], corrected.east - truth["true_east"])
    assert error[20:].max() < 0.01
    assert {track.name for track in read_tracks(path, 0)} >= {"network", "ekf"}


def test_other_endings_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"\.csv, \.nc, \.npz, \.zarr"):
        TrackCollector().write(tmp_path / "tracks.txt")


# --- uncertainty ------------------------------------------------------------------------------


def test_the_error_model_is_what_validation_missions_showed(store, missions):
    found = evaluate(oracles(missions, shift=0.01), store, split="all", baselines=())
    scores = found.methods["network"].scores
    seconds = [s.samples * PERIOD for s in scores]
    model = fit_error_model(scores, seconds, ideal_compass=True)
    pitch = np.deg2rad(missions[0]["true_pitch"][0])
    assert model.velocity_sd == pytest.approx(0.01 / np.cos(pitch) / np.sqrt(2), rel=0.03)
    assert model.surge_sd == pytest.approx(0.01 / np.cos(pitch), rel=0.03)  # sway's is none
    assert model.heading_sd == 0.0
    coverage = Coverage(model)
    evaluate(oracles(missions, shift=0.01), store, split="all", baselines=(), watch=coverage.add)
    assert coverage.figures()["within_2sd"] == 1.0
    bold = Coverage(ErrorModel(velocity_sd=1e-4, heading_sd=0.0))
    evaluate(oracles(missions, shift=0.01), store, split="all", baselines=(), watch=bold.add)
    assert bold.figures()["within_2sd"] == 0.0


def test_the_surges_interval_holds_what_validation_missions_showed(store, missions):
    """68 % of samples; wider outside of the training, narrower where an adapted run is sure."""
    errors = [np.linspace(-0.01, 0.01, n) for n in (400, 900)]
    scores = evaluate(oracles(missions), store, split="all", baselines=()).methods["network"].scores
    swayed = [0.1 * e for e in errors]
    model = fit_error_model(scores, [1.0] * len(scores), errors, swayed, ideal_compass=True)
    assert model.surge_interval == pytest.approx(0.0068, rel=0.02)
    assert model.sway_interval == pytest.approx(0.00068, rel=0.02)
    for shift, outside, wanted in ((0.006, 0.5, 1.0), (0.008, 0.5, 0.0), (0.008, 1.5, 1.0)):
        coverage = Coverage(model, outside=lambda _, far=outside: far)
        evaluate(oracles(missions, shift=shift), store, baselines=(), watch=coverage.add)
        assert coverage.figures()["surge_within"] == wanted
        assert coverage.figures()["sway_within"] == 1.0
    signals = {"adapted_surge": np.full(2, 0.4), "adapted_steady": np.array([0.0, 1.0]),
               "adapted_surge_sd": np.full(2, 0.003)}  # fmt: skip
    one = MissionSequence(index=0, split="all", period=1.0, signals=signals)
    start = FlightStart.of(np.zeros(7), np.eye(7), 1e-2)
    said = surge_interval(model, one, Adapted(start=start, deviation=0.004), 1.5)
    left = model.surge_interval**2 - 0.004**4 / (0.004**2 + 0.003**2)
    assert said == pytest.approx([model.surge_interval, np.sqrt(left)])


def test_an_ensembles_spread_widens_the_uncertainty(store, missions):
    narrow, wide = (Coverage(ErrorModel(velocity_sd=1e-3, heading_sd=0.0)) for _ in range(2))
    evaluate(oracles(missions), store, baselines=(), watch=narrow.add)
    evaluate(oracles(missions, spread=0.02), store, baselines=(), watch=wide.add)
    ratio = wide.figures()["position_sd_m_mean"] / narrow.figures()["position_sd_m_mean"]
    assert ratio > 10.0
