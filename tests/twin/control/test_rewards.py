"""The shapes of rewards are those of dm_control, number for number."""

from __future__ import annotations

import numpy as np
import pytest
from dm_control.utils import rewards as theirs

from twin.control import rewards
from twin.errors import InputError

SETTINGS = [
    {"bounds": (-0.1, 0.3), "margin": 0.7},
    {"bounds": (0.0, 0.2), "margin": 1.3, "sigmoid": "long_tail"},
    {"bounds": (0.5, np.inf), "margin": 0.5, "sigmoid": "linear", "value_at_margin": 0.0},
    {"bounds": (-1.0, -1.0), "margin": 2.0, "sigmoid": "linear", "value_at_margin": 0.3},
    {"bounds": (-0.2, 0.2)},
]


@pytest.mark.parametrize("settings", SETTINGS)
def test_values_are_dm_controls(settings):
    x = np.concatenate([np.random.default_rng(0).normal(0.0, 1.5, 400), [-0.1, 0.2, 0.3, 0.5]])
    expected = theirs.tolerance(x, **settings)
    np.testing.assert_array_equal(rewards.tolerance(x, **settings), expected)
    assert 0.0 < expected.mean() < 1.0
    for value in x[:5].tolist():
        found = rewards.tolerance(value, **settings)
        assert isinstance(found, float)
        assert found == theirs.tolerance(value, **settings)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"bounds": (1.0, 0.0)}, "bounds 1.0 to 0.0"),
        ({"margin": -1.0}, "margin -1.0"),
        ({"margin": 1.0, "sigmoid": "gausian"}, "did you mean 'gaussian'"),
        ({"margin": 1.0, "value_at_margin": 0.0}, "value_at_margin 0.0"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(settings, told):
    with pytest.raises(InputError, match=told):
        rewards.tolerance(0.5, **settings)
