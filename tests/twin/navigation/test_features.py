"""Features: causal, free of truth, right on known signals, over missions and step by step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from navigation import PERIOD, synthetic_mission

from twin.errors import InputError, StoreError
from twin.mission.controller import Schedule
from twin.navigation.features import (
    DEFAULT_GROUPS,
    FEATURES,
    FLIGHT,
    INPUT_SETS,
    SENSORS,
    Feature,
    FeatureSteps,
    Term,
    channels_of,
    feature_matrix,
    groups,
    mirror_signs,
    register,
    select_features,
    trailing_mean,
    trailing_slope,
)
from twin.navigation.settings import sources
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.records.schema import VARIABLES


def test_no_feature_reads_the_truth():
    for feature in FEATURES.values():
        for channel in sources(feature.channels):
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
        "depth_rate_slow",
        "glide_speed",
        *groups()["controls"],
    )


def test_a_vehicle_without_a_sensor_reads_none_of_its_channels():
    for sensor, channels in SENSORS.items():
        left = channels_of(select_features(FEATURES, without=[sensor]))
        assert left
        assert not set(left) & set(channels), sensor
        assert set(channels) <= set(VARIABLES)
    assert "glide_speed" not in select_features(without=["attitude"])


def test_the_inputs_of_every_glider_need_no_raw_imu():
    channels = channels_of(select_features(INPUT_SETS["glider"]))
    assert not [name for name in channels if "rate" in name or "force" in name]
    assert {"measured_pitch", "measured_depth", "measured_pump"} <= set(channels)


def test_pitch_from_gravity_is_that_of_a_resting_vehicle():
    samples, pitch, roll = 60, np.deg2rad(-27.0), np.deg2rad(12.0)
    direction = [np.sin(pitch), -np.cos(pitch) * np.sin(roll), -np.cos(pitch) * np.cos(roll)]
    signals = {
        f"measured_specific_force_{axis}": np.full(samples, 9.81 * part)
        for axis, part in zip("xyz", direction, strict=True)
    }
    signals["measured_depth"] = 0.2 * PERIOD * np.arange(samples)
    signals["measured_pitch"] = np.full(samples, np.rad2deg(pitch))
    assert FEATURES["gravity_pitch_sine"].compute(signals, PERIOD) == pytest.approx(np.sin(pitch))
    known = FEATURES["glide_speed"].compute(signals, PERIOD)
    assert FEATURES["gravity_glide_speed"].compute(signals, PERIOD) == pytest.approx(known)
    falling = {name: np.zeros(samples) for name in signals}
    assert not FEATURES["gravity_pitch_sine"].compute(falling, PERIOD).any()


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


def test_a_mirrored_flight_has_the_signs_of_the_features():
    """The twin flown with the rotation of its battery reversed is the mirror image."""
    chosen = [
        name
        for name in FEATURES
        if FEATURES[name].group not in ("commands", FLIGHT, "flight_steady")
    ]
    flights = []
    for side in (1.0, -1.0):
        rows = [[0.0, 0.01, side * 0.5, -150.0], [150.0, -0.01, side * 0.5, 200.0]]
        table = np.array(rows)
        plan = Schedule(times=table[:, 0], commands=table[:, 1:])
        flights.append(simulate(Scenario(mission=plan, duration=300.0)).signals)
    seen, image = (
        feature_matrix(
            {name.replace("true", "measured"): flight[name] for name in flight}, chosen, 0.5, 0
        )
        for flight in flights
    )
    largest = np.abs(seen).max(0)
    assert largest.min() > 0.0
    assert (np.abs(image - seen * mirror_signs(chosen)) <= 1e-5 * largest).all()
    assert np.allclose(flights[0]["true_surge"], flights[1]["true_surge"], atol=1e-6)
    assert np.allclose(flights[0]["true_sway"], -flights[1]["true_sway"], atol=1e-6)
    assert np.abs(flights[0]["true_sway"]).max() > 0.005


# --- the slow ones look back ten seconds: no less, no more --------------------------------------

STEP = 60
"""sample at which a signal jumps or begins to change"""


def at_rest(**given):
    """A level vehicle at rest at 50 m, with `given` channels (samples,) in place of it."""
    still = {
        "measured_roll": 0.0, "measured_pitch": 0.0, "measured_heading": 0.0,
        "measured_depth": 50.0, "measured_specific_force_x": 0.0,
        "measured_specific_force_y": 0.0, "measured_specific_force_z": -9.81,
    }  # fmt: skip
    samples = len(next(iter(given.values())))
    return {**{name: np.full(samples, value) for name, value in still.items()}, **given}


def step(before, after, samples=200):
    return np.where(np.arange(samples) < STEP, before, after)


@pytest.mark.parametrize(("period", "window"), [(0.5, 20), (1.0, 10), (2.0, 5)])
@pytest.mark.parametrize("name", ["roll", "pitch"])
def test_a_slow_sine_is_the_mean_of_the_last_ten_seconds(name, period, window):
    found = FEATURES[f"sin_{name}_slow"].compute(
        at_rest(**{f"measured_{name}": step(0.0, 30.0)}), period
    )
    assert found[STEP - 1] == 0.0
    risen = 0.5 * np.arange(1, window + 1) / window  # sin 30 deg, sample by sample
    assert found[STEP : STEP + window] == pytest.approx(risen)
    assert found[STEP + window :] == pytest.approx(0.5)


@pytest.mark.parametrize(("period", "window"), [(0.5, 20), (2.0, 5)])
@pytest.mark.parametrize(
    ("feature", "channel", "rate"),
    [
        ("depth_rate_slow", "measured_depth", 0.2),
        ("pitch_change_slow", "measured_pitch", 0.3),
        ("roll_change_slow", "measured_roll", -0.3),
        ("heading_change_slow", "measured_heading", 0.5),
    ],
)
def test_a_slow_rate_is_the_slope_over_the_last_ten_seconds(feature, channel, rate, period, window):
    """A ramp that begins at STEP: the slope is exact once the whole window lies on it."""
    ramp = rate * period * np.maximum(np.arange(200) - STEP, 0)
    found = FEATURES[feature].compute(at_rest(**{channel: ramp}), period)
    exact = rate if channel == "measured_depth" else np.deg2rad(rate)
    assert found[STEP + window - 1 :] == pytest.approx(exact)
    assert abs(found[STEP + window - 2]) < abs(exact) * (1 - 1e-3)
    assert found[: STEP + 1] == pytest.approx(0.0, abs=1e-12)


def test_pitch_from_gravity_is_that_of_the_mean_force_of_ten_seconds():
    """A jerk of one sample turns the mean of 20 samples by a twentieth, for 20 samples."""
    force = np.zeros(200)
    force[STEP] = 2.0
    found = FEATURES["gravity_pitch_sine"].compute(at_rest(measured_specific_force_x=force), 0.5)
    mean = 2.0 / 20
    assert found[STEP : STEP + 20] == pytest.approx(mean / np.hypot(mean, 9.81))
    assert not found[:STEP].any()
    assert found[STEP + 20 :] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "window"), [("gravity_glide_speed", 2), ("gravity_glide_speed_slow", 20)]
)
def test_glide_speed_from_gravity_uses_one_window_for_pitch_and_depth(name, window):
    """It settles on -z' s / (s^2 + 0.15^2) when both have seen a whole window of the glide."""
    sine, rate = np.sin(np.deg2rad(-25.0)), 0.15
    glide = at_rest(
        measured_depth=50.0 + rate * 0.5 * np.maximum(np.arange(200) - STEP + 1, 0),
        measured_specific_force_x=step(0.0, 9.81 * sine),
        measured_specific_force_z=step(-9.81, -9.81 * np.cos(np.arcsin(sine))),
    )
    found = FEATURES[name].compute(glide, 0.5)
    exact = -rate * sine / (sine**2 + 0.15**2)
    assert found[STEP + window - 1 :] == pytest.approx(exact)
    assert found[STEP + window - 2] != pytest.approx(exact, rel=1e-3)
    assert not found[: STEP - 1].any()


def test_the_slow_glide_speed_is_steady_under_noise_that_moves_the_quick_one():
    rng = np.random.default_rng(5)
    noise = 0.05 * rng.standard_normal(400)  # [m]
    glide = {
        "measured_depth": 0.15 * 0.5 * np.arange(400) + noise,
        "measured_pitch": np.full(400, -25.0),
    }
    quick, slow = (
        FEATURES[name].compute(glide, 0.5)[50:] for name in ("glide_speed", "glide_speed_slow")
    )
    # a difference of two samples against a slope over twenty: sqrt(2) / sqrt(12 / 20^3)
    assert quick.std() / slow.std() == pytest.approx(np.sqrt(2 * 20**3 / 12), rel=0.3)


# --- step by step -----------------------------------------------------------------------------


def rows(signals):
    return [dict(zip(signals, row, strict=True)) for row in zip(*signals.values(), strict=True)]


@pytest.mark.parametrize("name", FEATURES)
@pytest.mark.parametrize("period", [PERIOD, 4.0])
def test_a_feature_step_by_step_is_that_of_the_whole_mission(name, period):
    signals = synthetic_mission(300, 4)
    whole = FEATURES[name].compute(signals, period)
    steps = FeatureSteps([name], period)
    assert set(steps.channels) == set(FEATURES[name].channels)
    stepped = [steps.step(sample)[0] for sample in rows(signals)]
    assert np.allclose(stepped, whole, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(whole).max()))


def test_steps_go_on_from_a_saved_state_and_begin_again_after_a_reset():
    signals = synthetic_mission(200, 5)
    samples, steps = rows(signals), FeatureSteps(list(FEATURES), PERIOD)
    whole = [steps.step(sample) for sample in samples]
    assert np.allclose(whole, feature_matrix(signals, list(FEATURES), PERIOD, 0), atol=1e-5)
    steps.reset()
    for sample in samples[:77]:
        steps.step(sample)
    saved = steps.state()
    steps.step(samples[3])  # what is saved does not change any more
    other = FeatureSteps(list(FEATURES), PERIOD)
    other.restore(saved)
    assert np.array_equal([other.step(sample) for sample in samples[77:]], whole[77:])
    with pytest.raises(InputError, match="of other features or of another period"):
        FeatureSteps(["depth_rate_slow"], PERIOD).restore(saved)


def test_a_sample_without_a_channel_or_with_a_nan_is_explained():
    steps = FeatureSteps(["glide_speed"], PERIOD)
    with pytest.raises(InputError, match=r"no channel 'measured_pitch'.*read measured_depth"):
        steps.step({"measured_depth": 1.0})
    with pytest.raises(InputError, match="measured_depth is not finite at sample 0"):
        steps.step({"measured_depth": np.nan, "measured_pitch": 0.0})


def test_a_feature_of_ones_own_is_computed_both_ways():
    push = Feature(
        name="pump_power",
        group="controls",
        unit="cm3 m s-1",
        terms=(
            Term(channel="measured_pump", look="slope", seconds=4.0),
            Term(channel="measured_depth"),
        ),
        combine=lambda rate, depth: rate * depth,
    )
    register(push)
    try:
        signals = synthetic_mission(80, 7)
        steps = FeatureSteps(["pump_power"], PERIOD)
        stepped = [steps.step(sample)[0] for sample in rows(signals)]
        assert np.allclose(stepped, push.compute(signals, PERIOD), rtol=1e-9, atol=1e-9)
    finally:
        FEATURES.unregister("pump_power")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"terms": (Term(channel="true_surge"),)}, "only what is measured"),
        ({"terms": ()}, "needs one term"),
        ({"terms": (Term(channel="measured_depth"), Term(channel="measured_pump"))}, "combine"),
        ({"unit": ""}, "lacks `unit`"),
    ],
)
def test_a_feature_that_is_only_half_there_is_refused(changes, message):
    whole = {"name": "half", "group": "own", "unit": "1", "terms": (Term(channel="measured_pump"),)}
    with pytest.raises(InputError, match=message):
        register(Feature(**{**whole, **changes}))
    assert "half" not in FEATURES
