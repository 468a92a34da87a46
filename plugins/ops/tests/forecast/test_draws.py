"""Draws of water and vehicles have the mean and spread of what is known."""

import math

import numpy as np
import pytest

from glider_twin_ops.forecast.expected_dive import BOTH, STEADY, GroundPool
from glider_twin_ops.forecast.members import (
    INTERVAL,
    draw_field_error,
    draw_ground,
    draw_water,
    draw_ways,
    scaled_speed,
)
from glider_twin_ops.forecast.pool import Mixture
from twin import load_vehicle
from twin.errors import VehicleError
from twin.identify import draw_vehicles, identified, load_calibration
from twin.identify.vehicle_file import vehicle_xml
from twin.mission import steady_glide
from twin.navigation.current import CurrentFilter
from twin.vehicle.vehicle import parse_vehicle

MEMBERS = 4000
HOURS = 8


@pytest.fixture(scope="module")
def filter_():
    """Of a current of 0.1 m/s north and 0.05 east that three dives have told."""
    found = CurrentFilter(latitude=45.0)
    for _ in range(3):
        found.locate((0.0, 0.0))
        found.step(7200.0, (0.2, 0.0))
        found.fix((0.3 * 7200.0, 0.05 * 7200.0))
    return found


def test_draws_of_the_water_spread_as_the_filter_forecasts(filter_):
    end = HOURS * 3600.0
    drawn = draw_water(filter_, end, MEMBERS, np.random.default_rng(1), dive=1e9)
    steps = round(end / INTERVAL)
    ahead = filter_.forecast(filter_.time + end, None)
    weights = np.ones(steps + 1)
    weights[[0, -1]] = 0.5
    moved = INTERVAL * np.einsum("t,mtk->mk", weights, drawn.current[:, : steps + 1])
    np.testing.assert_allclose(moved[1:].mean(axis=0), ahead.displacement[0], rtol=0.06)
    ratio = np.cov(moved[1:], rowvar=False)[0, 0] / ahead.displacement_covariance[0, 0, 0]
    assert ratio == pytest.approx(1.0, abs=0.1)
    # the first member is the mean of what is known
    np.testing.assert_allclose(moved[0], ahead.displacement[0], rtol=0.01)
    scale, _ = filter_.calibration
    assert drawn.speed_scale[0] == pytest.approx(scale)


def test_each_dive_adds_something_of_its_own(filter_):
    spread = [
        np.std(draw_water(filter_, 36e3, MEMBERS, np.random.default_rng(2), dive).current.mean(1))
        for dive in (1e9, 3600.0)
    ]
    assert spread[1] < spread[0]  # what differs from dive to dive averages out


@pytest.mark.parametrize("told", [True, False])
def test_the_error_of_a_field_is_what_fixes_have_told_of_it(filter_, told):
    rng = np.random.default_rng(3)
    water = draw_water(filter_, 36e3, MEMBERS, rng, 1e9)
    drawn = draw_field_error(water, filter_, (0.02, 0.05), 0.1, rng, told=told)
    start = drawn.current[1:, 0]
    if told:  # the field lacks most of the 0.08 m/s that the fixes showed
        assert 0.03 < start[:, 0].mean() < 0.08
        assert start[:, 0].std() < 0.1
    else:
        assert abs(start.mean()) < 0.005
        assert start.std() == pytest.approx(0.1, rel=0.05)
        assert drawn.current[1:, -1].std() == pytest.approx(0.1, rel=0.05)  # stationary


def known_vehicle(**changes):
    """A vehicle file that says how surely its trim and drag are known."""
    vehicle = load_vehicle("glider")
    drag = vehicle.flow_frame.drag[0]
    said = {
        "parameters": {
            "neutral_density": {"value": vehicle.reference_density, "deviation": 0.05,
                                "determined": True},
            "drag": {"value": drag, "deviation": 0.04 * drag, "determined": True},
            "mass": {"value": vehicle.mass, "deviation": None, "determined": False},
            "pitch_offset": {"value": 0.0, "deviation": 0.4, "determined": True},
        },
        "correlation": {"parameters": ["neutral_density", "drag", "pitch_offset"],
                        "matrix": [[1, 0.8, 0], [0.8, 1, 0], [0, 0, 1]]},
        **changes,
    }  # fmt: skip
    xml = vehicle_xml(load_calibration(vehicle), said)
    return parse_vehicle(xml, vehicle.path)


def test_identified_vehicles_are_drawn_with_their_correlation():
    vehicle = known_vehicle()
    drawn, names = draw_vehicles(vehicle, 600, np.random.default_rng(4), speed=True)
    assert names == ("drag", "neutral_density")  # of the hull; the sensors' offsets move nothing
    assert drawn[0] is vehicle
    drag = np.log([v.flow_frame.drag[0] for v in drawn[1:]])
    trim = np.array([v.reference_density for v in drawn[1:]])
    assert drag.std() == pytest.approx(0.04, rel=0.1)
    assert trim.std() == pytest.approx(0.05, rel=0.1)
    assert np.corrcoef(drag, trim)[0, 1] == pytest.approx(0.8, abs=0.05)


def test_a_speed_that_the_fixes_told_is_not_drawn_again():
    drawn, names = draw_vehicles(known_vehicle(), 5, np.random.default_rng(5), speed=False)
    assert names == ("neutral_density",)
    assert {v.flow_frame.drag[0] for v in drawn} == {drawn[0].flow_frame.drag[0]}


def test_vehicles_without_an_identification_are_all_alike():
    vehicle = load_vehicle("glider")
    assert identified(vehicle) == {}
    drawn, names = draw_vehicles(vehicle, 3, np.random.default_rng(6), speed=True)
    assert names == ()
    assert all(one is vehicle for one in drawn)


def test_a_correlation_of_other_parameters_is_refused():
    vehicle = known_vehicle(correlation={"parameters": ["drag"], "matrix": [[1.0]]})
    with pytest.raises(VehicleError, match="correlation cannot be read"):
        draw_vehicles(vehicle, 3, np.random.default_rng(7), speed=True)


@pytest.mark.parametrize("scale", [0.06, -0.06])
def test_a_scaled_speed_is_the_speed_of_the_same_glide(scale):
    vehicle = load_vehicle("glider")
    plain, scaled = (
        steady_glide(one, math.radians(-26.0), 0.3)
        for one in (vehicle, scaled_speed(vehicle, scale))
    )
    assert scaled.speed / plain.speed == pytest.approx(1.0 + scale, rel=1e-3)
    assert scaled.angle_of_attack == pytest.approx(plain.angle_of_attack, abs=1e-3)


def test_members_go_as_dives_so_far_went_beside_how_they_were_sent():
    """Of two kinds of way, by weight; about the mean of all, which the first member has."""
    apart, scale, freedom, count = np.array([0.1, -0.2]), 0.03, 5.0, 200_000
    ahead = Mixture(
        names=("to its waypoints", "as the last dive"),
        weights=np.array([0.75, 0.25]),
        means=np.array([[0.3, 0.0], [0.3, 0.0]]) + np.array([[0.0, 0.0], apart]),
        covariances=np.tile(scale**2 * freedom / (freedom - 2.0) * np.eye(2), (2, 1, 1)),
    )
    off = draw_ways(ahead, freedom, count, np.random.default_rng(3))
    assert off[0] == pytest.approx(0.25 * apart)
    assert off[1:].mean(axis=0) == pytest.approx(0.25 * apart, abs=1e-3)
    assert np.cov(off[1:], rowvar=False) == pytest.approx(ahead.covariance, rel=0.05)


def going(velocities, foretold):
    """A pool of the ground after dives, and its forecast beside one of way and current [m/s]."""
    rng, pool = np.random.default_rng(8), GroundPool()
    covariances = np.array([0.05**2 * np.eye(2)])
    for velocity, through in zip([*velocities, None], foretold, strict=True):
        one, still = (
            Mixture(names=("one",), weights=np.ones(1), means=np.array([mean]),
                    covariances=covariances)
            for mean in (through, (0.0, 0.0))
        )  # fmt: skip
        ahead = pool.expect(one, still)
        if velocity is not None:
            pool.learn(np.array(velocity) + 0.01 * rng.standard_normal(2))
    return pool, ahead


def test_a_glider_that_goes_on_over_ground_is_forecast_so_and_only_then():
    """The last three dives' velocity gains the weight where way and current foretell another."""
    steady, ahead = going([(0.2, 0.1)] * 12, [(0.1, 0.3)] * 13)
    assert steady.pool.weights[STEADY] > 0.95
    assert ahead.mean == pytest.approx([0.2, 0.1], abs=0.02)
    turns = [(0.3, 0.0), (-0.3, 0.0)] * 6
    turning, ahead = going(turns, [*turns, (0.3, 0.0)])
    assert turning.steady == pytest.approx([-0.1, 0.0], abs=0.02)
    assert turning.pool.weights[STEADY] < 0.05
    assert ahead.mean == pytest.approx([0.3, 0.0], abs=0.03)


def test_members_go_over_ground_as_the_last_dives_by_the_weight_of_that():
    pool, _ = going([(0.2, 0.1)] * 3, [(0.22, 0.05)] * 4)
    count, flown = 200_000, np.array([0.25, 0.0])
    course = np.zeros((count, 3, 2))
    course[1:, :, 0] = 0.01 * np.where(np.arange(1, count) % 2, 1.0, -1.0)[:, None]
    found, part = draw_ground(course, flown, pool, np.random.default_rng(9))
    assert part == pool.pool.weights[STEADY]
    assert 0.05 < part < 0.95
    freedom = pool.pool.freedom
    heavy = freedom / (freedom - 2.0)
    moved = found[1:, 0, 1] != 0.0
    both = found[1:][~moved][:, 0, 0]  # the others, as wide as the mixture has them
    assert both.var() == pytest.approx(heavy * (0.01 * pool.pool.scales[BOTH]) ** 2, rel=0.01)
    assert moved.mean() == pytest.approx(part, abs=0.01)
    assert found[0] == pytest.approx(np.tile(part * (pool.steady - flown), (3, 1)))
    assert found[1:][moved][:, 0].mean(axis=0) == pytest.approx(pool.steady - flown, abs=2e-3)
    variance = heavy * pool.pool.scales[STEADY] ** 2
    assert found[1:][moved][:, 0].var(axis=0) == pytest.approx([variance] * 2, rel=0.05)
    assert (found[1:][moved] == found[1:][moved][:, :1]).all()  # for as long as they fly
