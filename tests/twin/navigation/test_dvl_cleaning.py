"""Cleaning of a Doppler log's velocities: known outliers, gaps, and which way it looks."""

import numpy as np
import pytest

from twin.navigation.estimators.dvl import SMOOTHING_S, SMOOTHINGS, outliers, smoothed

PERIOD = 0.5
SAMPLES = 600
ALL = np.ones(SAMPLES, bool)


def noisy(level=0.9, noise=0.002, seed=1):
    return level + noise * np.random.default_rng(seed).standard_normal(SAMPLES)


@pytest.mark.parametrize("causal", [False, True])
def test_known_outliers_are_found_and_little_else(causal):
    values = noisy()
    values[[50, 51, 300, 301, 302]] += (0.4, -0.3, 0.2, 0.2, 0.2)
    found = np.flatnonzero(outliers(values, ALL, causal=causal))
    assert {50, 51, 300, 301, 302} <= set(found)
    assert len(found) < 0.03 * SAMPLES  # a median deviation of 11 samples is itself uncertain


@pytest.mark.parametrize("causal", [False, True])
def test_the_onset_of_a_turn_is_no_outlier(causal):
    values = np.clip(0.03 * (np.arange(SAMPLES) - 200), 0.0, 0.15)  # 0.15 m/s in 2.5 s
    found = outliers(values + noisy(0.0, 2e-4), ALL, causal=causal)
    assert found.sum() <= (6 if causal else 0)


def test_outliers_beside_a_gap_are_judged_by_what_is_there():
    values = noisy()
    valid = ALL.copy()
    valid[100:200] = False
    values[100:200] = np.nan
    values[[99, 205]] += (0.3, -0.3)
    found = outliers(values, valid)
    assert found[[99, 205]].all()
    assert not found[100:200].any()
    assert not outliers(np.full(9, np.nan), np.zeros(9, bool)).any()


@pytest.mark.parametrize("kind", SMOOTHINGS)
def test_smoothing_keeps_a_constant_right_up_to_a_gap_and_leaves_the_gap(kind):
    valid = ALL.copy()
    valid[100:140] = valid[:3] = False
    values = np.where(valid, 0.8, np.nan)
    out = smoothed(values, valid, PERIOD, kind)
    np.testing.assert_array_equal(np.isfinite(out), valid)
    assert out[valid] == pytest.approx(0.8, abs=1e-12)


@pytest.mark.parametrize("kind", ["gaussian", "causal"])
def test_smoothing_averages_noise_away(kind):
    values = noisy(0.0, 0.01)
    out = smoothed(values, ALL, PERIOD, kind)
    # white noise under weights w falls to sqrt(sum w^2) of itself
    steps = np.arange(-8, 9) if kind == "gaussian" else np.arange(9)
    weights = np.exp(-0.5 * (steps * PERIOD / SMOOTHING_S) ** 2)
    expected = np.sqrt(np.sum(weights**2)) / np.sum(weights)
    assert out.std() / values.std() == pytest.approx(expected, rel=0.15)


def test_only_the_causal_kind_does_without_the_future():
    values, later = noisy(), noisy()
    later[400:] += 0.5
    past = slice(0, 400)
    for kind, same in (("causal", True), ("gaussian", False), ("none", True)):
        a, b = (smoothed(v, ALL, PERIOD, kind)[past] for v in (values, later))
        assert np.array_equal(a, b) is same, kind
    a, b = (outliers(v, ALL, causal=True)[past] for v in (values, later))
    assert np.array_equal(a, b)
    lone, step = noisy(), noisy()
    lone[399] = step[399] = 1.2
    step[400:] += 0.3  # the future says that the sample was no outlier
    assert [bool(outliers(v, ALL)[399]) for v in (lone, step)] == [True, False]
    assert [bool(outliers(v, ALL, causal=True)[399]) for v in (lone, step)] == [True, True]


def test_the_causal_kind_lags_as_it_says():
    ramp = 0.01 * PERIOD * np.arange(SAMPLES)
    lag = (ramp - smoothed(ramp, ALL, PERIOD, "causal"))[50:] / 0.01
    assert lag == pytest.approx(0.8 * SMOOTHING_S, abs=0.25 * SMOOTHING_S)
    assert smoothed(ramp, ALL, PERIOD, "gaussian")[50:-50] == pytest.approx(ramp[50:-50])
