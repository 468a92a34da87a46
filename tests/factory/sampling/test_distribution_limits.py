"""Distributions at their limits: narrow gaps between exclusions, and weights of 0."""

from __future__ import annotations

import numpy as np
import pytest

from factory.sampling.distribution import parse_distribution
from twin.errors import InputError

DRAWS = 400


def drawn(text: str) -> list[float | str]:
    """Draws of the distribution that `text` describes."""
    rng, distribution = np.random.default_rng(3), parse_distribution(text)
    return [distribution.draw(rng) for _ in range(DRAWS)]


@pytest.mark.parametrize("left", [0.5, 0.15, 0.01])
def test_exclusions_may_leave_a_small_part(left):
    """15 % and even 1 % of the range can be drawn; every draw lies there, evenly."""
    edge = 10.0 * (1.0 - left)
    values = np.array(drawn(f"uniform(0, 10) except (0, {edge})"))
    assert values.min() >= edge
    assert values.max() < 10.0
    # five standard errors of the mean of an even spread
    middle, width = (edge + 10.0) / 2, 10.0 - edge
    assert abs(values.mean() - middle) < 5 * width / np.sqrt(12 * DRAWS)


def test_exclusions_that_leave_nothing_are_refused():
    for text in ("uniform(0, 10) except (-1, 11)", "uniform(0, 10) except (0, 9.995)"):
        with pytest.raises(InputError, match="leave nothing to draw"):
            parse_distribution(text)
    # together they leave nothing, each alone leaves half
    with pytest.raises(InputError, match="leave nothing to draw"):
        parse_distribution("uniform(0, 10) except (0, 5) (5, 10)")


def test_an_exclusion_outside_the_range_costs_nothing():
    assert np.mean(drawn("uniform(0, 10) except (20, 400)")) == pytest.approx(5.0, abs=0.8)


def test_a_logarithmic_range_that_is_all_excluded_is_told_when_it_is_drawn():
    everything = parse_distribution("loguniform(1, 10) except (0.5, 20)")
    with pytest.raises(InputError, match="leave almost nothing to draw"):
        everything.draw(np.random.default_rng(0))


def test_an_option_of_weight_0_is_known_and_never_drawn():
    choice = parse_distribution("choice(saw-tooth: 0, spiral: 0.5, hold)")
    assert choice.text() == "choice(saw-tooth: 0, spiral: 0.5, hold)"
    assert not choice.allows("saw-tooth")
    assert choice.allows("spiral")
    found = drawn(choice.text())
    assert set(found) == {"spiral", "hold"}
    # a third and two thirds
    assert found.count("spiral") / DRAWS == pytest.approx(1 / 3, abs=0.12)


def test_weights_that_are_all_0_are_refused():
    with pytest.raises(InputError, match="nor all 0"):
        parse_distribution("choice(saw-tooth: 0, spiral: 0)")


def test_a_single_option_may_have_any_weight_above_0():
    assert set(drawn("choice(spiral: 0.001)")) == {"spiral"}
