"""The slow features look back ten seconds: no less, no more, and on every signal they use."""

from __future__ import annotations

import numpy as np
import pytest

from twin.navigation.features import FEATURES

STEP = 60
"""sample at which a signal jumps or begins to change"""


def signals(**given):
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
        signals(**{f"measured_{name}": step(0.0, 30.0)}), period
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
    found = FEATURES[feature].compute(signals(**{channel: ramp}), period)
    exact = rate if channel == "measured_depth" else np.deg2rad(rate)
    assert found[STEP + window - 1 :] == pytest.approx(exact)
    assert abs(found[STEP + window - 2]) < abs(exact) * (1 - 1e-3)
    assert found[: STEP + 1] == pytest.approx(0.0, abs=1e-12)


def test_pitch_from_gravity_is_that_of_the_mean_force_of_ten_seconds():
    """A jerk of one sample turns the mean of 20 samples by a twentieth, for 20 samples."""
    force = np.zeros(200)
    force[STEP] = 2.0
    found = FEATURES["gravity_pitch_sine"].compute(signals(measured_specific_force_x=force), 0.5)
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
    glide = signals(
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
