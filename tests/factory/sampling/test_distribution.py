"""Distributions: their text form, what they draw, and what they refuse."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factory.sampling.distribution import (
    Choice,
    Fixed,
    LogUniform,
    Normal,
    Uniform,
    parse_distribution,
)
from twin.errors import InputError

numbers = st.floats(-1e6, 1e6, allow_nan=False)
intervals = st.tuples(numbers, numbers).map(sorted).filter(lambda pair: pair[0] < pair[1])
distributions = st.one_of(
    numbers.map(Fixed),
    intervals.map(lambda pair: Uniform(*pair)),
    intervals.map(lambda p: Uniform(*p, ((p[0] - 1.0, p[0] + 0.4 * (p[1] - p[0])),))),
    st.tuples(numbers, st.floats(1e-6, 1e6)).map(lambda pair: Normal(*pair)),
    st.tuples(st.floats(1e-6, 1e3), st.floats(1.1, 1e3)).map(
        lambda pair: LogUniform(pair[0], pair[0] * pair[1])
    ),
    st.lists(st.sampled_from(["saw-tooth", "spiral", "M2", 1.0, 2.5]), min_size=1, unique=True).map(
        lambda options: Choice(tuple(options), tuple(1.0 + i for i in range(len(options))))
    ),
)


@given(distributions)
def test_the_text_is_read_back_as_the_same_distribution(distribution):
    assert parse_distribution(distribution.text()) == distribution


@given(distributions, st.integers(0, 2**32))
def test_every_draw_is_allowed(distribution, seed):
    rng = np.random.default_rng(seed)
    for _ in range(5):
        assert distribution.allows(distribution.draw(rng))


def test_none_is_a_fixed_nan_and_a_number_is_itself():
    none = parse_distribution("none")
    assert isinstance(none, Fixed)
    assert isinstance(none.value, float)
    assert math.isnan(none.value)
    assert none.allows(math.nan)
    assert not none.allows(1.0)
    assert parse_distribution(35) == parse_distribution("35") == Fixed(35.0)
    assert parse_distribution("M2") == Fixed("M2")


def test_moments_are_the_declared_ones():
    rng = np.random.default_rng(7)
    n = 20_000

    def sample(text):
        distribution = parse_distribution(text)
        return np.array([distribution.draw(rng) for _ in range(n)], float)

    # five standard errors of the mean of n draws
    uniform = sample("uniform(15, 45)")
    assert abs(uniform.mean() - 30.0) < 5 * 30.0 / math.sqrt(12 * n)
    normal = sample("normal(2, 0.5)")
    assert abs(normal.mean() - 2.0) < 5 * 0.5 / math.sqrt(n)
    assert abs(normal.std() - 0.5) < 5 * 0.5 / math.sqrt(2 * n)
    logs = np.log(sample("loguniform(40, 500)"))
    assert abs(logs.mean() - math.log(math.sqrt(40 * 500))) < 5 * logs.std() / math.sqrt(n)
    holes = sample("uniform(0, 10) except (2, 4) (9, 20)")
    assert not np.any((holes > 2) & (holes < 4))
    assert holes.max() <= 9.0
    # density is even over what is left: 2 of the 7 units lie below the first hole
    assert abs((holes < 2).mean() - 2 / 7) < 5 * math.sqrt(2 / 7 * 5 / 7 / n)
    choice = parse_distribution("choice(a: 3, b)")
    share = np.mean([choice.draw(rng) == "a" for _ in range(n)])
    assert abs(share - 0.75) < 5 * math.sqrt(0.75 * 0.25 / n)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("unifrom(1, 2)", "did you mean 'uniform'?"),
        ("uniform(2, 1)", "low < high"),
        ("uniform(1)", r"\(1\) must hold two numbers"),
        ("uniform(1, x)", "must hold two numbers"),
        ("uniform(0, 1) except (0, 1)", "leave nothing to draw"),
        ("uniform(0, 10) except (-1, 11)", "leave nothing to draw"),
        ("uniform(0, 10) except (0, 9.995)", "leave nothing to draw"),
        ("uniform(0, 10) except (0, 5) (5, 10)", "leave nothing to draw"),  # each leaves half
        ("uniform(0, 1) except (1, 0)", "is empty"),
        ("loguniform(0, 2)", "above 0"),
        ("normal(0, 0)", "positive deviation"),
        ("normal(0, 1) except (0, 1)", "no except"),
        ("choice()", "options"),
        ("choice(a, a)", "differ"),
        ("choice(a: x)", "the weight of 'a' is 'x'"),
        ("choice(a: -1, b)", "not be negative"),
        ("choice(saw-tooth: 0, spiral: 0)", "nor all 0"),
        ("1..2", "not a distribution"),
        ("uniform(1, 2", "not a distribution"),
        ("inf", "finite"),
        (True, "give a number or a text"),
        ([1, 2], "give a number or a text"),
    ],
)
def test_bad_texts_name_the_parameter_and_the_fault(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_distribution(text, "mission.pitch_deg")
    assert "\n" not in str(caught.value)
    if isinstance(text, str) and "uniform" in text:
        assert "mission.pitch_deg" in str(caught.value)


DRAWS = 400


def drawn(text):
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


def test_a_single_option_may_have_any_weight_above_0():
    assert set(drawn("choice(spiral: 0.001)")) == {"spiral"}
