"""Features step by step: the values of whole missions, for every feature, and their state."""

from __future__ import annotations

import numpy as np
import pytest
from navigation import PERIOD, synthetic_mission

from twin.errors import InputError
from twin.navigation.features import FEATURES, Feature, FeatureSteps, Term, feature_matrix, register


def rows(signals):
    names = list(signals)
    return [
        dict(zip(names, row, strict=True))
        for row in np.stack([signals[name] for name in names], axis=1)
    ]


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
    samples = rows(synthetic_mission(200, 5))
    steps = FeatureSteps(list(FEATURES), PERIOD)
    whole = [steps.step(sample) for sample in samples]
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


def test_all_features_together_are_the_matrix():
    signals = synthetic_mission(120, 6)
    steps = FeatureSteps(list(FEATURES), PERIOD)
    stepped = np.array([steps.step(sample) for sample in rows(signals)])
    assert np.allclose(stepped, feature_matrix(signals, list(FEATURES), PERIOD, 0), atol=1e-5)


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
