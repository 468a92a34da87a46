"""The width with which ellipses begin holds its part of a further deployment."""

import numpy as np
from scipy.stats import chi2

from benchmarks.surfacings import radii


def test_a_further_deployment_is_held_as_often_as_said():
    """Errors differ in size between deployments, long ones or short ones."""
    rng = np.random.default_rng(4)
    held = []
    for _ in range(400):
        sizes = np.exp(rng.standard_normal(17))
        *known, new = (
            size * chi2.rvs(2, size=count, random_state=rng)
            for size, count in zip(sizes, rng.integers(4, 150, 17), strict=True)
        )
        half, ninety = radii([one.tolist() for one in known])
        held.append([np.mean(new <= half), np.mean(new <= ninety)])
    half, ninety = np.mean(held, axis=0)
    assert 0.47 < half < 0.58
    assert 0.89 < ninety < 0.97


def test_a_long_deployment_counts_as_much_as_a_short_one():
    assert radii([[1.0] * 1000, [4.0] * 10, [4.0] * 10])[0] == 4.0
