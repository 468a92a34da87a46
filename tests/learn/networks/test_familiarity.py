"""Out-of-distribution score: other hulls of the training's kind are inside, however few it had."""

import numpy as np
import pytest

from learn.networks.familiarity import Familiarity


@pytest.mark.parametrize("count", [1, 3, 10, 60])
def test_hulls_of_the_same_kind_are_inside_whatever_the_number_of_missions(count):
    rng, prior = np.random.default_rng(count), np.ones(7)
    shares = []
    for _ in range(200):
        known = Familiarity.of(rng.standard_normal((count, 7)), prior)
        shares += [known.outside(hull)[0] > 1.0 for hull in rng.standard_normal((20, 7))]
    assert np.mean(shares) < 0.06  # seven constants, each beyond 3 deviations in 0.27 %


def test_a_hull_of_another_kind_is_outside_of_forty_missions():
    rng, hull = np.random.default_rng(0), np.zeros(7)
    known = Familiarity.of(0.05 * rng.standard_normal((40, 7)), np.full(7, 0.15))
    hull[0] = np.log(1.4)
    assert known.outside(hull) == (pytest.approx(2.0, rel=0.3), "drag")
