"""A pool of models: the weight goes to what was likely, and comes back."""

import dataclasses
import math

import numpy as np
import pytest

from glider_twin_ops.forecast.members import INTERVAL, draw_models, draw_water
from glider_twin_ops.forecast.pool import (
    CURRENT_PRIORS,
    FEWEST,
    FIELD,
    FILTER,
    MEAN,
    PERSISTENCE,
    TIDE,
    CurrentPool,
    Mixture,
    Pool,
    Prior,
    tidal_fit,
)
from twin.errors import InputError
from twin.navigation.current import Leg

TWO = {"right": Prior(1.0, 0.1), "wrong": Prior(1.0, 0.1)}


def learned(pool, values, right, wrong):
    for value in values:
        pool.expect([right, wrong])
        pool.learn(value)
    return pool


def test_a_mixture_spreads_within_its_models_and_between_them():
    rng = np.random.default_rng(0)
    weights = np.array([0.3, 0.7])
    means = np.array([[0.0, 1.0], [2.0, 0.0]])
    spreads = np.array([[[1.0, 0.2], [0.2, 0.5]], [[0.4, 0.0], [0.0, 0.9]]])
    found = Mixture(names=("a", "b"), weights=weights, means=means, covariances=spreads)
    which = rng.choice(2, size=200_000, p=weights)
    both = zip(means, spreads, strict=True)
    draws = np.array([rng.multivariate_normal(m, s, 200_000) for m, s in both])
    drawn = draws[which, np.arange(200_000)]
    np.testing.assert_allclose(found.mean, drawn.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(found.covariance, np.cov(drawn, rowvar=False), atol=0.03)


def test_the_likely_model_gets_the_weight_and_loses_it_when_the_sea_changes():
    rng = np.random.default_rng(1)
    pool = learned(Pool(TWO), 0.05 * rng.standard_normal((30, 2)), (0.0, 0.0), (0.4, 0.0))
    assert pool.weights["right"] > 0.95
    assert sum(pool.weights.values()) == pytest.approx(1.0)
    changed = np.array([0.4, 0.0]) + 0.05 * rng.standard_normal((12, 2))
    learned(pool, changed, (0.0, 0.0), (0.4, 0.0))
    assert pool.weights["wrong"] > 0.9


def test_the_scale_of_errors_is_learned_and_one_surprise_does_not_set_it():
    rng = np.random.default_rng(2)
    values = 0.03 * rng.standard_normal((150, 2))
    pool = Pool({"only": Prior(1.0, 0.5), "other": Prior(1.0, 0.5)})
    learned(pool, values, (0, 0), (0, 0))
    before = pool.scales["only"]
    assert before == pytest.approx(0.03, rel=0.5)
    learned(pool, [[3.0, 0.0]], (0, 0), (0, 0))
    assert pool.scales["only"] < 2.0 * before


def test_the_first_prior_counts_before_anything_is_found():
    pool = Pool({"a": Prior(3.0, 0.1), "b": Prior(1.0, 0.2)})
    found = pool.expect([[0.0, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(found.weights, [0.75, 0.25])
    np.testing.assert_allclose(found.covariances[1], 0.04 * 5.0 / 3.0 * np.eye(2))


def test_a_model_that_says_nothing_has_no_part_and_keeps_its_weight():
    pool = Pool({"a": Prior(1.0, 0.1), "b": Prior(1.0, 0.1), "silent": Prior(2.0, 0.1)})
    for _ in range(3):
        found = pool.expect([[0.0, 0.0], [0.3, 0.0], [np.nan, np.nan]])
        assert found.names == ("a", "b")
        part = pool.learn([0.0, 0.0])
        assert part[2] == 0.0
    assert pool.weights["silent"] == pytest.approx(0.5, abs=1e-3)
    assert pool.weights["a"] > 10.0 * pool.weights["b"]
    assert pool.scales["silent"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Pool({}), "at least one model"),
        (lambda: Pool({"a": Prior(0.0, 0.1)}), "model a has weight 0"),
        (lambda: Pool(TWO).learn([0.0, 0.0]), "call expect first"),
        (lambda: Pool(TWO).expect([[np.nan], [np.nan]]), "none of the pool's models"),
    ],
)
def test_what_a_pool_cannot_do_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()


# --- models

HOUR = 3600.0
M2 = 12.4206012 * HOUR


def legs_in(current, count, noise=0.0):
    """Legs whose mean current is that of a function of time [s], (2, time), and noise [m/s]."""
    rng, found, lasting = np.random.default_rng(7), [], 3.5 * HOUR
    for k in range(count):
        time = np.linspace(4.0 * HOUR * k, 4.0 * HOUR * k + lasting, 401)
        mean = np.trapezoid(current(time), time, axis=1) / lasting + noise * rng.standard_normal(2)
        ground, way = lasting * (mean + np.array([0.2, 0.1])), (lasting * 0.2, lasting * 0.1)
        found.append(
            Leg(start=time[0], duration=lasting, over_ground=tuple(ground), through_water=way)
        )
    return found


def tidal(time):
    turn = 2.0 * np.pi * time / M2
    return np.stack([0.1 + 0.3 * np.cos(turn), -0.05 + 0.2 * np.sin(turn)])


def test_persistence_is_the_last_current_and_nothing_else():
    *known, last = legs_in(tidal, 6)
    pool = CurrentPool(latitude=31.0, time=0.0)
    assert np.isnan(pool.alone(PERSISTENCE, last)[0]).all()
    for leg in known:
        pool.learn(leg)
    np.testing.assert_allclose(pool.alone(PERSISTENCE, last)[0], known[4].current)
    three = np.mean([leg.current for leg in known[2:]], axis=0)
    np.testing.assert_allclose(pool.alone(MEAN, last)[0], three)


def test_a_tidal_fit_foretells_a_tide_once_it_has_seen_a_period():
    legs = legs_in(tidal, 12)
    for k in range(1, FEWEST):  # their mean
        mean = np.mean([each.current for each in legs[:k]], axis=0)
        np.testing.assert_allclose(tidal_fit(legs[:k], legs[k], 5.0), mean, atol=1e-12)
    np.testing.assert_allclose(tidal_fit(legs[:-1], legs[-1], 5.0), legs[-1].current, atol=1e-4)


def test_a_tidal_fit_forgets_what_is_older_than_its_days():
    legs = legs_in(lambda time: np.stack([np.where(time < 3e5, 0.5, 0.1), 0.0 * time]), 60)
    np.testing.assert_allclose(tidal_fit(legs[:-1], legs[-1], 2.0), [0.1, 0.0], atol=1e-6)


def drawn(pool, count):
    """Currents of members after the pool's last dive, and their deviation at the start."""
    water = draw_water(pool.filters[FILTER], 8.0 * HOUR, count, np.random.default_rng(0), 1e9)
    found, deviation = draw_models(water, pool, np.random.default_rng(1))
    return found.current, deviation


@pytest.mark.parametrize("certain", [None, PERSISTENCE, FILTER])
def test_drawn_currents_have_the_mean_and_the_variance_that_the_pool_states(certain):
    """Moments of the mixture, and of one model alone, whose heavy tails widen its variance."""
    priors = CURRENT_PRIORS if certain is None else {
        name: Prior(1.0 if name == certain else 1e-9, one.scale)
        for name, one in CURRENT_PRIORS.items()
    }  # fmt: skip
    legs = legs_in(tidal, 9, noise=0.02)
    pool = CurrentPool(latitude=31.0, time=0.0, priors=priors)
    for leg in legs:
        pool.learn(leg)
    current, deviation = drawn(pool, 120_000)
    start = current[1:, 0]
    assert start.var(axis=0).mean() == pytest.approx(deviation**2, rel=0.03)
    assert start.mean(axis=0) == pytest.approx(current[0, 0], abs=4.0 * deviation / 120_000**0.5)


def test_drawn_currents_are_those_of_their_time():
    """Half an interval late, a tide would be off by 0.03 m/s."""
    priors = {
        name: Prior(1.0 if name == TIDE else 1e-9, one.scale)
        for name, one in CURRENT_PRIORS.items()
    }
    pool = CurrentPool(latitude=31.0, time=0.0, priors=priors)
    for leg in legs_in(tidal, 14):
        pool.learn(leg)
    assert pool.pool.weights[TIDE] > 0.95
    current, _ = drawn(pool, 60)
    time = pool.filters[FILTER].time + INTERVAL * np.arange(current.shape[1])
    tide = tidal(time).T
    found = np.median(current[1:] - current[1:, :1], axis=0)  # less each member's own error
    np.testing.assert_allclose(found, tide - tide[0], atol=0.004)


def run(legs, field=None, taught=1):
    """The pool's misses and those of its models alone [m/s], after so many legs."""
    told = legs if field is None else [dataclasses.replace(leg, field=field) for leg in legs]
    pool = CurrentPool(latitude=31.0, time=0.0, field=field is not None)
    missed = []
    for k, leg in enumerate(told):
        if k >= taught:
            ahead = dataclasses.replace(leg, over_ground=(math.nan, math.nan))
            each = {name: pool.alone(name, ahead)[0] for name in pool.pool.names}
            each["pool"] = pool.expect(ahead).mean
            missed.append({name: math.dist(v, leg.current) for name, v in each.items()})
        pool.learn(leg)
    return pool, {name: np.mean([one[name] for one in missed]) for name in missed[0]}


@pytest.mark.parametrize("sea", ["tide", "walk", "jumps"])
def test_the_pool_is_near_its_best_model_in_every_sea(sea):
    rng = np.random.default_rng(5)
    walk = np.cumsum(0.04 * rng.standard_normal((2, 61)), axis=1)
    held = 0.3 * rng.standard_normal((2, 12)).repeat(6, axis=1)[:, :61]
    flows = {
        "tide": tidal,
        "walk": lambda time: walk[:, (time / (4.0 * HOUR)).astype(int)],
        "jumps": lambda time: held[:, (time / (4.0 * HOUR)).astype(int)],
    }
    pool, missed = run(legs_in(flows[sea], 60, noise=0.03), taught=30)
    best = min(value for name, value in missed.items() if name != "pool")
    assert missed["pool"] < 1.05 * best + 0.003
    assert missed["pool"] < 0.9 * max(missed.values())
    assert {*pool.pool.names} == {PERSISTENCE, MEAN, TIDE, FILTER}


def test_a_field_is_a_model_of_its_own():
    legs = legs_in(tidal, 8)
    pool, missed = run(legs, field=(0.4, 0.4))
    assert pool.pool.weights[FIELD] < 0.02  # of a field that is wrong
    assert missed["pool"] < missed[FIELD]
