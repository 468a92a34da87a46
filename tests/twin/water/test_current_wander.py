"""The correlation time of a wandering current, told from another one by five percent."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.water.current.gauss_markov import GaussMarkov


@pytest.mark.parametrize("correlation_time", [600.0, 10800.0])
def test_values_one_correlation_time_apart_keep_a_part_of_one_over_e(correlation_time):
    """Drawn at that interval, x[k+1] regressed on x[k]: a time 5 % longer would give 0.386."""
    current = GaussMarkov(
        speed=1.0, direction_deg=0.0, speed_std=0.1, direction_std_deg=20.0,
        correlation_time=correlation_time, interval=correlation_time, seed=5,
    )  # fmt: skip
    count = 80_000
    _, speed, direction = current.draw(correlation_time * count)
    # four standard errors of a correlation: 4 sqrt((1 - 1/e^2) / count) = 0.013
    for x in (speed, direction):
        assert np.corrcoef(x[:-1], x[1:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.013)
