"""The current filter: exact in time, equal to a dense Gaussian, calibrated on what it models."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import pytest

from twin.errors import InputError
from twin.navigation.current import (
    CurrentFilter,
    CurrentParameters,
    Leg,
    Reaches,
    begin_leg,
    chosen_constituents,
    pass_leg,
    replay,
    tune,
)
from twin.navigation.current.current_parameters import likely_logarithms, parameters_of, prior_cost
from twin.navigation.current.modes import HOUR, modes_of, passage

LATITUDE = 31.5
SOME = CurrentParameters(constituents=("M2", "K1"))
NOISE = 0.02**2 * np.eye(2)


@pytest.mark.parametrize("hours", [0.5, 3.0, 30.0])
def test_a_step_is_exact_in_whatever_pieces_it_is_made(hours):
    one = CurrentFilter(SOME, latitude=LATITUDE)
    many = CurrentFilter(SOME, latitude=LATITUDE)
    for filter_, pieces in ((one, 1), (many, 29)):
        filter_.fix((3.0, 4.0))
        for _ in range(pieces):
            filter_.step(hours * HOUR / pieces, (0.2, -0.1))
    for a, b in zip(one.position, many.position, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8)
    np.testing.assert_allclose(one.state()["covariance"], many.state()["covariance"], rtol=1e-6,
                               atol=1e-9)  # fmt: skip


def test_the_noise_of_a_mode_is_that_of_its_equation():
    modes, seconds = modes_of(SOME, LATITUDE), 4.0 * HOUR
    gone, walk = passage(modes, seconds), modes.density[0]
    stationary = modes.rate.real < 0.0
    expected = modes.variance * (1.0 - np.abs(gone.kept) ** 2)
    np.testing.assert_allclose(gone.noise[stationary], expected[stationary], rtol=1e-9)
    np.testing.assert_allclose(
        (gone.noise[0], gone.shared[0].real, gone.scattered[0]),
        (walk * seconds, walk * seconds**2 / 2.0, walk * seconds**3 / 3.0),
        rtol=1e-9,
    )


def test_the_inertial_part_turns_clockwise_in_the_north_and_not_in_the_south():
    turns = {}
    for latitude in (40.0, -40.0):
        modes = modes_of(SOME, latitude)
        turns[latitude] = modes.rate[modes.names.index("inertial")].imag
    assert turns[40.0] > 0.0  # north to east
    assert turns[-40.0] == -turns[40.0]
    assert 2.0 * math.pi / turns[40.0] / HOUR == pytest.approx(18.6, abs=0.1)


def test_smoothing_is_the_dense_gaussian_conditional():
    """All states at once by their joint covariance: another way to the same answer."""
    filter_ = CurrentFilter(SOME, latitude=LATITUDE, record=True)
    nodes = filter_._nodes
    assert nodes is not None
    filter_.fix((0.0, 0.0))
    rng = np.random.default_rng(3)
    position, current = np.eye(2, filter_.size), filter_._of_current(dive=False)
    measured = []  # node, what of its state, value, covariance
    for k in range(4):
        for _ in range(2):
            filter_.step(1800.0, rng.normal(0.0, 0.2, 2), NOISE)
        if k == 2:
            filter_.current_report((0.1, 0.05), 0.01 * np.eye(2))
            measured.append((len(nodes) - 1, current, (0.1, 0.05), 0.01 * np.eye(2)))
        place = filter_.position[0] + rng.normal(0.0, 200.0, 2)
        at = len(nodes) - 1
        found = filter_.fix(place)
        assert found is not None
        assert found.distance < 9.0  # no surprise: all is linear
        measured.append((at, position, place, 25.0 * np.eye(2)))
    size, count = filter_.size, len(nodes)
    prior, joint = [nodes[0].estimate], np.zeros((count * size, count * size))
    joint[:size, :size] = nodes[0].covariance
    for k in range(1, count):
        carry, one = nodes[k].carry, nodes[k - 1]
        prior.append(nodes[k].predicted + carry @ (prior[-1] - one.estimate))
        noise = nodes[k].predicted_covariance - carry @ one.covariance @ carry.T
        now, before = slice(k * size, (k + 1) * size), slice((k - 1) * size, k * size)
        joint[now, : k * size] = carry @ joint[before, : k * size]
        joint[: k * size, now] = joint[now, : k * size].T
        joint[now, now] = carry @ joint[before, before] @ carry.T + noise
    observed = np.zeros((2 * len(measured), count * size))
    for row, (at, of, _, _) in enumerate(measured):
        observed[2 * row : 2 * row + 2, at * size : (at + 1) * size] = of
    spread = observed @ joint @ observed.T
    for row, (*_, noise) in enumerate(measured):
        spread[2 * row : 2 * row + 2, 2 * row : 2 * row + 2] += noise
    values = np.concatenate([np.asarray(value, float) for _, _, value, _ in measured])
    gain = np.linalg.solve(spread, observed @ joint).T
    mean = np.concatenate(prior) + gain @ (values - observed @ np.concatenate(prior))
    covariance = joint - gain @ observed @ joint
    smooth = filter_.smooth()
    np.testing.assert_allclose(smooth.position, mean.reshape(count, size)[:, :2], atol=1e-3)
    blocks = covariance.reshape(count, size, count, size)
    for k in range(count):
        np.testing.assert_allclose(smooth.position_covariance[k], blocks[k, :2, k, :2], atol=1e-2)
    np.testing.assert_allclose(smooth.current, mean.reshape(count, size) @ current.T, atol=1e-6)


def test_it_goes_on_from_a_saved_state_as_if_nothing_had_been():
    one, other = (CurrentFilter(SOME, latitude=LATITUDE) for _ in range(2))
    one.fix((0.0, 0.0))
    one.step(5000.0, (0.2, 0.1), NOISE)
    other.restore(one.state())
    for filter_ in (one, other):
        filter_.step(4000.0, (0.3, 0.1), NOISE)
        filter_.fix((2500.0, 700.0))
        filter_.ground_velocity((0.4, 0.2), NOISE)
    for name, values in one.state().items():
        np.testing.assert_array_equal(values, other.state()[name], err_msg=name)
    with pytest.raises(InputError, match="lacks covariance"):
        other.restore({n: v for n, v in one.state().items() if n != "covariance"})
    with pytest.raises(InputError, match="with the same parameters"):
        CurrentFilter(latitude=0.0, parameters=CurrentParameters(constituents=())).restore(
            one.state()
        )


def test_a_forecast_is_what_the_fix_is_compared_with():
    filter_ = CurrentFilter(SOME, latitude=LATITUDE)
    filter_.fix((0.0, 0.0))
    filter_.step(10000.0, (0.2, 0.1))
    filter_.fix((3000.0, 500.0))
    start, _ = filter_.position
    ahead = filter_.forecast(filter_.time + np.array([9000.0, 4500.0]), (0.25, 0.0))
    filter_.step(9000.0, (0.25, 0.0))
    place, _ = filter_.position
    np.testing.assert_allclose(ahead.displacement[0], place - start - (2250.0, 0.0), atol=1e-6)
    np.testing.assert_allclose(ahead.current[0], filter_.current[0], atol=1e-12)
    assert ahead.displacement_covariance[1, 0, 0] < ahead.displacement_covariance[0, 0, 0]
    with pytest.raises(InputError, match="must be later"):
        filter_.forecast([0.0])


def leg(start: float, over_ground: Iterable[float], through: Iterable[float]) -> Leg:
    """A dive of three hours."""
    ground, water = tuple(over_ground), tuple(through)
    return Leg(start=start, duration=3.0 * HOUR, over_ground=ground, through_water=water)


def taught(parameters: CurrentParameters, legs: Sequence[Leg]) -> CurrentFilter:
    """A filter that has made these legs."""
    filter_ = CurrentFilter(parameters, latitude=LATITUDE, time=legs[0].start)
    replay(filter_, legs)
    return filter_


def truth(rng: np.random.Generator, count: int, *, tide: float, wander: float) -> list[Leg]:
    """Legs of three hours with half an hour between, in a tide and a random walk."""
    legs, walk = [], np.zeros(2)
    for k in range(count):
        start = k * 3.5 * HOUR
        phase = 2.0 * np.pi * (start + 1.5 * HOUR) / (12.4206012 * HOUR)
        current = walk + tide * np.array([math.cos(phase), 0.5 * math.sin(phase)])
        current += rng.normal(0.0, 0.004, 2)
        through = rng.normal(0.0, 3000.0, 2)
        legs.append(leg(start, through + 3.0 * HOUR * current, through))
        walk = walk + rng.normal(0.0, wander, 2)
    return legs


def errors(parameters: CurrentParameters, legs: list[Leg], after: int) -> tuple[float, float]:
    """[m/s] mean error of the forecasts and of the last dive's current."""
    filter_ = CurrentFilter(parameters, latitude=LATITUDE, time=legs[0].start)
    found, last = [], []
    for k, one in enumerate(legs):
        begin_leg(filter_, one)
        ahead = filter_.forecast([one.end], one.velocity)
        if k >= after:
            found.append(np.hypot(*(ahead.displacement[0] / one.duration - one.current)))
            last.append(np.hypot(*(one.current - legs[k - 1].current)))
        pass_leg(filter_, one)
    return float(np.mean(found)), float(np.mean(last))


def test_tuned_on_a_tide_it_forecasts_the_tide():
    legs = truth(np.random.default_rng(1), 50, tide=0.2, wander=0.003)
    tuned = tune(legs[:20], latitude=LATITUDE)
    assert not tuned.parameters.persists
    assert tuned.parameters.semidiurnal > 5.0 * tuned.parameters.eddy
    found, last = errors(tuned.parameters, legs, 20)
    assert found < 0.15 * last


def test_tuned_on_a_random_walk_it_is_persistence():
    legs = truth(np.random.default_rng(2), 50, tide=0.0, wander=0.05)
    tuned = tune(legs[:20], latitude=LATITUDE)
    found, last = errors(tuned.parameters, legs, 20)
    assert found < 1.06 * last
    alone, _ = errors(CurrentParameters.persistence(0.14), legs, 20)
    assert alone == pytest.approx(last, rel=0.08)  # the nested special case


def test_it_learns_the_error_of_the_speed():
    legs = truth(np.random.default_rng(4), 30, tide=0.05, wander=0.003)
    said = [leg(one.start, one.over_ground, np.array(one.through_water) / 0.9) for one in legs]
    assert taught(SOME, said).calibration[0] == pytest.approx(-0.1, abs=0.02)


def test_its_ellipses_hold_what_they_say_on_currents_of_another_size():
    legs = truth(np.random.default_rng(5), 200, tide=0.0, wander=0.2)
    filter_ = CurrentFilter(SOME, latitude=LATITUDE, time=0.0)
    held = []
    for one in legs:
        begin_leg(filter_, one)
        ahead = filter_.forecast([one.end], one.velocity)
        missed = np.array(one.over_ground) - np.array(one.through_water) - ahead.displacement[0]
        distance = missed @ np.linalg.solve(ahead.displacement_covariance[0], missed)
        held.append(distance <= 4.605)
        pass_leg(filter_, one)
    assert 0.86 <= np.mean(held[20:]) <= 0.94


def test_a_front_crossed_once_does_not_shake_the_tide():
    legs = truth(np.random.default_rng(6), 40, tide=0.2, wander=0.002)
    front = leg(legs[-1].end, (3.0 * HOUR, 0.0), (0.0, 0.0))
    filter_ = taught(parameters_of(likely_logarithms(), ("M2", "K1")), [*legs, front])
    assert np.hypot(*filter_.part("eddy")) > 0.5
    assert np.hypot(*filter_.part("M2")) < 0.3


def test_constituents_by_record_and_surfacings():
    for days, hours, names in (
        (1.0, 3.0, "M2 K1"),
        (10.0, 3.0, "M2 K1 S2 O1"),
        (30.0, 3.0, "M2 K1 S2 O1 N2"),
        (30.0, 8.0, "K1 O1"),  # 8 h alias the semidiurnal tide
        (30.0, 20.0, ""),
    ):
        assert chosen_constituents(24.0 * days, hours) == tuple(names.split())


def test_the_prior_costs_nothing_at_its_centre():
    assert prior_cost(likely_logarithms()) == 0.0
    assert prior_cost(likely_logarithms() + 0.3) > 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f: f.step(-1.0, (0.0, 0.0)), "zero or positive"),
        (lambda f: f.step(1.0, (0.0, math.nan)), "two finite numbers"),
        (lambda f: f.step(1.0, (0.0, 0.0), np.eye(3)), "matrix of 2 by 2"),
        (lambda f: f.fix((0.0, 0.0), 0.0), "must be positive"),
        (lambda f: f.ground_velocity((0.0, 0.0), NOISE), "give `step` a velocity first"),
        (lambda f: f.smooth(), "record=True"),
        (lambda _: CurrentParameters(eddy_time=0.0), "eddy_time of a current is 0; it must be"),
        (lambda _: CurrentParameters(eddy=-0.1), "zero or positive"),
        (lambda _: CurrentParameters(constituents=("M3",)), "did you mean 'M2'"),
        (lambda _: CurrentFilter(latitude=99.0), "from -90 to 90"),
        (lambda _: tune(truth(np.random.default_rng(0), 3, tide=0.1, wander=0.0)[::-1],
                        latitude=0.0), "sort them"),
    ],
)  # fmt: skip
def test_errors_teach(call, message):
    with pytest.raises(InputError, match=message):
        call(CurrentFilter(SOME, latitude=LATITUDE))


@pytest.mark.parametrize(("known", "reach"), [(8, (0.5, 2.0 * math.log(10.0))), (10, (0.6, 1.0))])
def test_a_reach_counts_the_fix_to_come_among_the_known_ones(known, reach):
    """The new one of 11 alike is below the sixth of ten in 6 of 11 cases, half at least; of nine it
    would have to be below a ninth, which is not known: the normal distribution's is taken."""
    found = Reaches.of(0.1 * k for k in range(known, 0, -1))
    assert found.now == pytest.approx(reach, rel=1e-4)
    rng, held = np.random.default_rng(8), np.zeros(2)
    for _ in range(2000):
        *earlier, new = rng.chisquare(2.0, known + 1).tolist()
        held += Reaches.of(earlier).held(new)
    assert (held / 2000.0 > np.array([0.5, 0.9]) - 0.015).all()
