"""Plans: the hours that were asked for, and a split of missions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from factory.sampling.distribution import parse_distribution
from factory.sampling.draw import HOUR, SPLITS, TEST, TRAIN, VALIDATION, plan_missions, samples_in
from twin.errors import InputError

HALF_TO_ONE = parse_distribution("uniform(0.5, 1)")


@given(st.floats(0.05, 200.0), st.integers(0, 1000))
@settings(max_examples=60)
def test_the_missions_make_the_hours_and_each_split_has_one(hours, seed):
    plan = plan_missions(HALF_TO_ONE, hours=hours, seed=seed)
    assert abs(plan.hours - hours) <= 0.25 / HOUR + 1e-9  # half a sample
    assert {plan.splits.count(split) > 0 for split in (TRAIN, VALIDATION, TEST)} == {True}
    assert len(plan.splits) == len(plan.durations_s)
    assert all(duration % 0.5 == 0.0 for duration in plan.durations_s)
    assert plan.samples == samples_in(max(plan.durations_s))
    if hours >= 3.0:
        assert min(plan.durations_s) >= 0.5 * HOUR - 0.5
        assert max(plan.durations_s) <= 1.0 * HOUR + 0.5


def test_the_split_is_70_15_15_by_mission():
    plan = plan_missions(HALF_TO_ONE, hours=300.0, seed=0)
    counts = np.bincount(plan.splits, minlength=len(SPLITS))
    others = round(0.15 * len(plan))
    assert counts.tolist() == [len(plan) - 2 * others, others, others]


def test_durations_follow_their_distribution():
    hours = np.array(plan_missions(HALF_TO_ONE, hours=600.0, seed=3).durations_s) / HOUR
    ordered = np.sort(hours)
    expected = np.linspace(0.5, 1.0, len(ordered))
    # Kolmogorov-Smirnov: 1.95 / sqrt(n) is the 0.1 % point
    assert np.abs(ordered - expected).max() / 0.5 < 1.95 / np.sqrt(len(ordered))


def test_the_plan_depends_on_the_seed_alone():
    assert plan_missions(HALF_TO_ONE, hours=20.0, seed=1) == plan_missions(
        HALF_TO_ONE, hours=20.0, seed=1
    )
    assert plan_missions(HALF_TO_ONE, hours=20.0, seed=1) != plan_missions(
        HALF_TO_ONE, hours=20.0, seed=2
    )


@pytest.mark.parametrize(
    ("hours", "message"),
    [
        (0.0, "--hours 0 must be above 0"),
        (-3.0, "--hours -3 must be above 0"),
        (float("nan"), "nan is not a number"),
        (float("inf"), "give at most 1e\\+07"),
        (0.01, "give at least 0.05"),
    ],
)
def test_impossible_hours_are_refused(hours, message):
    with pytest.raises(InputError, match=message):
        plan_missions(HALF_TO_ONE, hours=hours, seed=0)


def test_durations_must_be_durations():
    with pytest.raises(InputError, match=r"mission\.duration_h"):
        plan_missions(parse_distribution("uniform(-1, 1)"), hours=50.0, seed=0)
    with pytest.raises(InputError, match=r"mission\.duration_h"):
        plan_missions(parse_distribution("short"), hours=5.0, seed=0)


def test_a_seed_plans_the_same_missions_in_every_version():
    """A recipe that is kept makes its store again; lengths and splits have streams of their own."""
    plan = plan_missions(HALF_TO_ONE, hours=4.0, seed=1)
    assert plan.durations_s == (3387.0, 3410.0, 2165.5, 2502.0, 2935.5)
    assert plan.splits == (2, 0, 0, 1, 0)
