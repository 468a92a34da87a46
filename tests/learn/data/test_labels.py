"""Labels from a Doppler log: water track, bottom track less a known current, and gaps."""

import dataclasses

import numpy as np
import pytest
from navigation import PERIOD, steady_mission, write_store

from learn.data.dataset import MissionSequence, filled
from learn.data.labels import STORE_CURRENT, LabelConfig, count_labels, label_config, measured
from learn.data.preparation import prepare
from learn.data.stores import few_labels, few_missions, labels_in
from learn.networks.base import NetworkConfig
from learn.training.fit_config import FitConfig, fit_settings
from learn.training.fitting import fit
from learn.training.optimiser import TrainingConfig
from twin.errors import InputError, StoreError
from twin.frames import euler_to_matrix
from twin.navigation.features import select_features

CURRENT = (0.12, -0.2)
LOCK = np.repeat([1.0, 2.0, 0.0, 1.0], [300, 200, 50, 450])
"""Mode of the log: bottom, water, none, bottom"""
DVL = LabelConfig(source="dvl", known_current="store")


def surveyed(current=CURRENT, mode=LOCK, **motion):
    """A turning dive whose Doppler log has no errors."""
    signals = steady_mission(
        len(mode), current=current, turn_rate=0.01, roll=0.1,
        velocity=(0.9, -0.05, 0.03), **motion,
    )  # fmt: skip
    angles = [np.deg2rad(signals[f"true_{n}"]) for n in ("roll", "pitch", "heading")]
    ground = np.stack([signals[f"true_velocity_{n}"] for n in ("north", "east", "down")], axis=-1)
    body = np.einsum("tij,ti->tj", euler_to_matrix(*angles), ground)
    for k, name in enumerate(("surge", "sway", "heave")):
        log = np.where(mode == 1, body[:, k], signals[f"true_{name}"])
        signals[f"measured_dvl_{name}"] = np.where(mode > 0, log, np.nan)
    signals["measured_dvl_mode"] = np.array(mode)
    return signals


def mission(signals=None, **more):
    signals = surveyed(**more) if signals is None else signals
    return MissionSequence(index=4, split="train", period=PERIOD, signals=signals)


@pytest.mark.parametrize("known", ["store", f"{CURRENT[0]},{CURRENT[1]}"])
def test_bottom_track_less_the_known_current_is_the_velocity_through_the_water(known):
    found = measured(mission(), LabelConfig(source="dvl", known_current=known))
    np.testing.assert_array_equal(found.usable, LOCK > 0)
    assert not found.removed.any()
    assert found.velocities["surge"][LOCK > 0] == pytest.approx(0.9, abs=1e-12)
    assert found.velocities["sway"][LOCK > 0] == pytest.approx(-0.05, abs=1e-12)


def test_without_a_known_current_water_track_alone_is_learned_from():
    found = measured(mission(), LabelConfig(source="dvl"))
    np.testing.assert_array_equal(found.usable, LOCK == 2)
    assert found.velocities["surge"][LOCK == 2] == pytest.approx(0.9)
    assert (found.bottom.sum(), found.water.sum()) == (750, 200)


def test_a_current_that_is_taken_for_still_water_goes_into_the_labels():
    found = measured(mission(), LabelConfig(source="dvl", known_current="0,0"))
    off = np.hypot(*(found.velocities[n][:300] - v for n, v in (("surge", 0.9), ("sway", -0.05))))
    assert off.max() > 0.8 * np.hypot(*CURRENT)


def test_an_outlier_in_one_velocity_is_taken_out_of_both_and_counted():
    signals = surveyed()
    signals["measured_dvl_surge"][[20, 400]] += 0.3
    signals["measured_dvl_sway"][700] -= 0.3
    found = measured(mission(signals), DVL)
    assert list(np.flatnonzero(found.removed)) == [20, 400, 700]
    for values in found.velocities.values():
        assert np.isnan(values[[20, 400, 700]]).all()
    assert found.velocities["surge"][21] == pytest.approx(0.9)
    counts = count_labels([mission(signals), mission()], DVL)
    assert (counts.samples, counts.bottom, counts.water) == (2000, 1500, 400)
    assert (counts.outliers, counts.used) == (3, 1900 - 3)
    assert counts.current_mean == pytest.approx(np.hypot(*CURRENT))
    text = " ".join(counts.sentences(DVL))
    assert "1897 of 2000 samples (94.8 %)" in text
    assert "3 outliers (0.15 % of the samples)" in text
    assert "mean speed 0.233 m/s" in text
    assert "No current was known" in " ".join(counts.sentences(LabelConfig(source="dvl")))


@pytest.mark.parametrize("samples", [1, 2, 7])
def test_the_current_s_mean_speed_is_that_of_the_samples_however_few(samples):
    short = {name: values[:samples] for name, values in surveyed().items()}
    counts = count_labels([mission(short)], LabelConfig(source="dvl", known_current="0.3,0.4"))
    assert counts.samples == samples
    assert (counts.current_mean, counts.current_max) == pytest.approx((0.5, 0.5))


def test_labels_reach_the_training_with_their_gaps_and_change_no_input(tmp_path):
    signals = surveyed()
    signals["measured_dvl_surge"][20] += 0.3
    path = write_store(tmp_path / "s.zarr", [signals] * 3, [0, 1, 2])
    features = select_features(without=["imu"])
    for target, level in (("surge", 0.9), ("sway", -0.05)):
        arguments = {"target": target, "features": features, "mirror": False}
        truth = prepare(path, **arguments)
        data = prepare(path, **arguments, labels=DVL)
        for ours, theirs in ((data.train, truth.train), (data.validation, truth.validation)):
            np.testing.assert_array_equal(ours.inputs[0], theirs.inputs[0])
            assert theirs.weights[0].all()
            lost = sorted({*np.flatnonzero(LOCK == 0), 20})
            np.testing.assert_array_equal(np.flatnonzero(ours.weights[0] == 0), lost)
            assert np.isfinite(ours.targets[0]).all()
        wanted = data.train.targets[0] * data.normalisation.target_scale
        wanted = wanted + data.normalisation.target_mean
        assert wanted[data.train.weights[0] > 0] == pytest.approx(level, abs=1e-6)


def test_division_by_samples_leaves_gaps_out_of_every_part(tmp_path):
    path = write_store(tmp_path / "s.zarr", [surveyed()] * 2, [0, 1])
    features = select_features(without=["imu"])
    data = prepare(path, target="surge", features=features, division="samples", labels=DVL)
    for part in (data.train, data.validation):
        assert not part.weights[0][LOCK == 0].any()
    assert data.train.weights[0].sum() == pytest.approx(0.7 * 950, rel=0.1)


def test_a_store_without_a_usable_sample_says_what_to_do(tmp_path):
    path = write_store(tmp_path / "s.zarr", [surveyed(mode=np.ones(400))] * 2, [0, 1])
    features = select_features(without=["imu"])
    blind = LabelConfig(source="dvl")
    advice = (
        r"never had water lock.*\(bottom lock in 100 % of the samples\).* of up to 0\.23 m/s: give "
        r"--known-current store.* 0,0; or one with water lock.*--labels truth"
    )
    with pytest.raises(StoreError, match=advice):
        prepare(path, target="surge", features=features, labels=blind)
    with pytest.raises(StoreError, match=r"learn surge or sway from.*--known-current store"):
        labels_in(path, blind)
    still = [surveyed(current=(0.0, 0.0), mode=np.ones(400))] * 2
    path = write_store(tmp_path / "still.zarr", still, [0, 1])
    with pytest.raises(StoreError, match="stands still: give --known-current 0,0; or learn from"):
        prepare(path, target="surge", features=features, labels=blind)
    path = write_store(tmp_path / "unknown.zarr", still, [0, 1], drop=STORE_CURRENT)
    with pytest.raises(StoreError, match="Give --known-current NORTH,EAST in m/s, 0,0 in still"):
        prepare(path, target="surge", features=features, labels=blind)
    path = write_store(tmp_path / "t.zarr", [surveyed(mode=np.zeros(400))] * 2, [0, 1])
    with pytest.raises(StoreError, match=r"never had lock; or learn from the truth"):
        prepare(path, target="surge", features=features, labels=DVL)
    path = write_store(tmp_path / "u.zarr", [surveyed()] * 2, [0, 1], drop=("measured_dvl_mode",))
    with pytest.raises(StoreError, match="no channel measured_dvl_mode"):
        prepare(path, target="surge", features=features, labels=DVL)


def test_little_water_lock_is_worth_a_warning(tmp_path):
    mode = np.repeat([1.0, 2.0], [950, 50])
    path = write_store(tmp_path / "s.zarr", [surveyed(mode=mode)] * 2, [0, 1])
    blind = LabelConfig(source="dvl")
    warning = few_labels(path, blind, labels_in(path, blind))
    assert warning is not None
    assert "labels in 100 of 2000 samples alone" in warning
    assert "bottom lock in 95 %" in warning
    assert "--known-current store" in warning
    assert few_labels(path, DVL, labels_in(path, DVL)) is None
    path = write_store(tmp_path / "t.zarr", [surveyed()] * 2, [0, 1])
    assert few_labels(path, blind, labels_in(path, blind)) is None


def test_a_training_tells_its_warnings(tmp_path):
    mode = np.repeat([1.0, 2.0], [950, 50])
    path = write_store(tmp_path / "s.zarr", [surveyed(mode=mode)] * 2, [0, 1])
    config = FitConfig(
        store=str(path),
        features=select_features(without=["imu"]),
        network=NetworkConfig(kind="mlp", hidden=4, layers=1),
        training=TrainingConfig(seconds=0.0, epochs=1, validations=1),
        labels=LabelConfig(source="dvl"),
    )
    told = []
    fit(config, tmp_path / "run", warn=told.append)
    assert len(told) == 2
    assert "one mission for training" in told[0]
    assert "labels in 100 of 2000" in told[1]


def test_missions_for_training_need_labels_of_their_own(tmp_path):
    path = write_store(tmp_path / "s.zarr", [surveyed(mode=np.ones(1000)), surveyed()], [0, 1])
    with pytest.raises(StoreError, match="never had water lock"):
        labels_in(path, LabelConfig(source="dvl"))


def test_a_single_training_mission_is_worth_a_warning(tmp_path):
    missions = [surveyed()] * 3
    path = write_store(tmp_path / "s.zarr", missions, [1, 0, 2])
    warning = few_missions(path)
    assert warning is not None
    assert "has one mission for training (mission 1)" in warning
    assert few_missions(path, "samples") is None
    assert few_missions(write_store(tmp_path / "t.zarr", missions, [0, 1, 0])) is None


def test_a_single_mission_without_a_split_is_not_for_training(tmp_path):
    path = write_store(tmp_path / "s.zarr", [surveyed()], None)
    assert few_missions(path) is None
    assert "one mission for training" in str(few_missions(path, "samples"))


def test_a_current_that_the_store_has_not_is_asked_for():
    signals = surveyed()
    del signals["true_current_east"]
    with pytest.raises(StoreError, match=r"mission 4 has no channel true_current_east.*0,0"):
        measured(mission(signals), DVL)


# --- A camera


SEEN = np.repeat([True, False], [600, 400])


def filmed(seen=SEEN):
    """The surveyed dive by a camera without errors, which measures over ground."""
    signals = surveyed(mode=np.ones(len(seen)))
    for name in ("surge", "sway"):
        over_ground = signals.pop(f"measured_dvl_{name}")
        signals[f"measured_camera_{name}"] = np.where(seen, over_ground, np.nan)
    return signals


@pytest.mark.parametrize("known", ["store", f"{CURRENT[0]},{CURRENT[1]}"])
def test_a_cameras_velocity_less_the_known_current_is_the_one_through_the_water(known):
    config = LabelConfig(source="camera", known_current=known)
    found = measured(mission(filmed()), config)
    np.testing.assert_array_equal(found.usable, np.arange(1000) < 600)
    assert found.velocities["surge"][:600] == pytest.approx(0.9, abs=1e-12)
    assert found.velocities["sway"][:600] == pytest.approx(-0.05, abs=1e-12)
    counts = count_labels([mission(filmed())], config)
    assert (counts.used, counts.samples, counts.outliers) == (600, 1000, 0)
    assert "from a camera, not from the truth: 600 of 1000 samples" in counts.sentences(config)[0]


def test_a_camera_needs_a_known_current_and_no_second_smoothing(flown_store):
    with pytest.raises(InputError, match="over ground: give --known-current store or NORTH"):
        LabelConfig(source="camera")
    given = {"labels": "camera", "known_current": "0,0"}
    with pytest.raises(InputError, match="smoothed already: leave --smoothing out"):
        fit_settings(flown_store, **given, smoothing="none")
    assert fit_settings(flown_store, **given).labels.device == "camera"
    with pytest.raises(StoreError, match="no channel measured_camera_surge: no camera"):
        measured(mission(), LabelConfig(source="camera", known_current="0,0"))


def test_camera_labels_reach_the_training_with_their_gaps(tmp_path):
    path = write_store(tmp_path / "s.zarr", [filmed()] * 3, [0, 1, 2])
    labels = LabelConfig(source="camera", known_current="store")
    features = select_features(without=["imu"])
    data = prepare(path, target="surge", features=features, mirror=False, labels=labels)
    np.testing.assert_array_equal(data.train.weights[0] > 0, np.arange(1000) < 600)
    blind = write_store(tmp_path / "t.zarr", [filmed(np.zeros(400, bool))] * 2, [0, 1])
    with pytest.raises(StoreError, match="its camera saw none"):
        prepare(blind, target="surge", features=features, labels=labels)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"source": "gps"}, r"unknown source of labels 'gps'.*dvl, truth"),
        ({"smoothing": "gausian"}, r"unknown smoothing 'gausian': did you mean 'gaussian'"),
        ({"known_current": "still"}, r"current 'still' is unknown: give none, store or NORTH"),
        ({"known_current": "0.1"}, "is unknown: give none"),
        ({"known_current": "0,nan"}, "is unknown: give none"),
    ],
)
def test_unknown_words_are_named(settings, message):
    with pytest.raises(InputError, match=message):
        LabelConfig(**{"source": "dvl", **settings})


def test_settings_of_labels_are_kept_and_refused_where_they_have_no_use(flown_store, tmp_path):
    config = fit_settings(
        flown_store, labels="dvl", known_current="0.1,0", smoothing="causal", hidden=40
    )
    assert config.labels == LabelConfig(source="dvl", known_current="0.1,0", smoothing="causal")
    stored = {**dataclasses.asdict(config), "features": list(config.features)}
    assert FitConfig.of(stored, tmp_path) == config
    assert label_config(stored) == config.labels
    plain = fit_settings(flown_store, hidden=40)
    assert plain.labels == LabelConfig()
    assert any("source truth instead of dvl" in change for change in plain.differences(config))
    older = {k: v for k, v in dataclasses.asdict(plain).items() if k != "labels"}
    assert FitConfig.of(older, tmp_path) == plain
    for name in ("known_current", "smoothing"):
        with pytest.raises(InputError, match=f"--{name.replace('_', '-')} is about what a Doppler"):
            fit_settings(flown_store, **{name: "none"})


def test_the_holes_of_a_log_are_not_filled_with_labels():
    log = np.array([1.0, np.nan, np.nan, 0.7])
    np.testing.assert_array_equal(filled("measured_dvl_surge", log), log)
    np.testing.assert_array_equal(filled("measured_camera_surge", log), log)
    assert np.isfinite(filled("measured_pitch", log)).all()
