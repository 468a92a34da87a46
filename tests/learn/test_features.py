"""Features: causal, free of truth, correct on signals with known answers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from learn_missions import PERIOD, synthetic_mission

from learn.features import (
    DEFAULT_GROUPS,
    FEATURES,
    GROUPS,
    channels_of,
    feature_matrix,
    fit_normalisation,
    select_features,
    trailing_mean,
    trailing_slope,
)
from twin.errors import InputError, StoreError
from twin.schema import VARIABLES


def test_no_feature_reads_the_truth():
    for feature in FEATURES.values():
        for channel in feature.channels:
            assert VARIABLES[channel].group in ("measured", "commanded"), feature.name
            assert "gps" not in channel, feature.name
            assert "dvl" not in channel, feature.name
            assert "onboard" not in channel, feature.name


def test_features_read_only_the_channels_they_name():
    signals = synthetic_mission(200, 0)
    for feature in FEATURES.values():
        only = {channel: signals[channel] for channel in feature.channels}
        assert np.isfinite(feature.compute(only, PERIOD)).all(), feature.name


def test_defaults_leave_heading_and_depth_out():
    chosen = select_features()
    channels = channels_of(chosen)
    assert "measured_heading" not in channels
    assert "depth" not in chosen
    shifted = synthetic_mission(300, 1)
    before = feature_matrix(shifted, chosen, PERIOD, 0)
    shifted["measured_depth"] = shifted["measured_depth"] + 100.0
    after = feature_matrix(shifted, chosen, PERIOD, 0)
    assert np.allclose(before, after, atol=1e-6)


def test_turning_the_world_changes_no_feature():
    everything = tuple(FEATURES)
    signals = synthetic_mission(400, 2)
    before = feature_matrix(signals, everything, PERIOD, 0)
    signals["measured_heading"] = np.mod(signals["measured_heading"] + 123.0, 360.0)
    assert np.allclose(before, feature_matrix(signals, everything, PERIOD, 0), atol=1e-6)


@pytest.mark.parametrize("name", sorted(FEATURES))
def test_features_are_causal(name):
    signals = synthetic_mission(300, 3)
    before = FEATURES[name].compute(signals, PERIOD)
    rng = np.random.default_rng(0)
    changed = {k: np.concatenate([v[:200], v[200:] + rng.random(100)]) for k, v in signals.items()}
    after = FEATURES[name].compute(changed, PERIOD)
    # Running sums are exact to rounding only.
    assert np.allclose(before[:200], after[:200], rtol=1e-12, atol=1e-12)
    assert not np.allclose(before[200:], after[200:])


@given(slope=st.floats(-5, 5), samples=st.integers(2, 30), period=st.floats(0.1, 2.0))
def test_the_slope_of_a_line_is_exact(slope, samples, period):
    line = 3.0 + slope * period * np.arange(60)
    found = trailing_slope(line, samples, period)
    assert np.allclose(found[samples - 1 :], slope, atol=1e-9)
    assert found[0] == pytest.approx(0.0, abs=1e-9)


def test_two_samples_are_the_backward_difference():
    values = np.random.default_rng(0).random(20)
    assert np.allclose(trailing_slope(values, 2, 0.5)[1:], np.diff(values) / 0.5)


def test_trailing_mean():
    values = np.random.default_rng(1).random(30) + 100.0
    found = trailing_mean(values, 4)
    expected = [values[max(0, k - 3) : k + 1].mean() for k in range(30)]
    assert np.allclose(found, expected, atol=1e-12)


def test_glide_speed_finds_the_speed_along_a_steady_glide():
    n = 200
    pitch = np.full(n, -35.0)
    speed = 0.4
    depth = speed * np.sin(np.deg2rad(35.0)) * PERIOD * np.arange(n)
    signals = {"measured_pitch": pitch, "measured_depth": depth}
    sine = np.sin(np.deg2rad(35.0))
    expected = speed * sine**2 / (sine**2 + 0.15**2)
    for name in ("glide_speed", "glide_speed_slow"):
        found = FEATURES[name].compute(signals, PERIOD)
        assert found[50:] == pytest.approx(expected, rel=1e-9)


def test_heading_rate_has_no_jump_at_north():
    heading = np.mod(350.0 + 0.5 * np.arange(100), 360.0)
    found = FEATURES["heading_change"].compute({"measured_heading": heading}, PERIOD)
    assert found[1:] == pytest.approx(np.deg2rad(1.0))


def test_masks_take_groups_and_names_and_keep_the_order():
    chosen = select_features([*DEFAULT_GROUPS, "glide_speed"], without=["imu", "cos_roll"])
    assert chosen == (
        "sin_roll",
        "sin_pitch",
        "cos_pitch",
        "depth_rate",
        "glide_speed",
        *GROUPS["controls"],
    )


def test_wrong_masks_are_explained():
    with pytest.raises(InputError, match="unknown feature or feature group 'inu': did you mean"):
        select_features(["inu"])
    with pytest.raises(InputError, match="no input feature is left"):
        select_features(["imu"], without=["imu"])


def test_nan_names_mission_channel_and_time():
    signals = synthetic_mission(100, 0)
    signals["measured_pitch"][[40, 41]] = np.nan
    with pytest.raises(StoreError, match=r"measured_pitch of mission 7 .* 2 samples, first at 20"):
        feature_matrix(signals, select_features(), PERIOD, 7)
    del signals["measured_pitch"]
    with pytest.raises(StoreError, match="mission 7 has no channel measured_pitch"):
        feature_matrix(signals, select_features(), PERIOD, 7)


def test_normalisation_gives_unit_inputs_and_leaves_constants_alone():
    rng = np.random.default_rng(0)
    matrices = [rng.normal(3.0, 2.0, (500, 2)).astype(np.float32) for _ in range(3)]
    matrices = [np.concatenate([m, np.full((500, 1), 7.0, np.float32)], 1) for m in matrices]
    targets = [rng.normal(0.3, 0.1, 500).astype(np.float32) for _ in range(3)]
    found = fit_normalisation(matrices, targets, features=("a", "b", "c"), target="surge")
    values = found.inputs(np.concatenate(matrices))
    assert np.allclose(values.mean(0), 0.0, atol=1e-4)
    assert np.allclose(values.std(0), [1.0, 1.0, 0.0], atol=1e-4)
    assert found.scale[2] == 1.0
    assert found.target_scale == pytest.approx(0.1, rel=0.1)
