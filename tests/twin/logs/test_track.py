"""Corrected tracks, their deviation, and the currents that they are made of."""

import numpy as np
import pytest

from twin.logs import Drift, Fixes, linear_track
from twin.logs.corrected_track import USUAL_CHANGE, currents, drift_of

PERIOD = 2.0
DRIFT = Drift(diffusivity=2.0, change=0.03)


def through_water(samples: int = 601) -> np.ndarray:
    """A turning way through the water."""
    angle = np.linspace(0.0, 2.0, samples)
    return 0.3 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def fixes(sample: list[int], position: list[tuple[float, float]]) -> Fixes:
    return Fixes(sample=np.array(sample, np.intp), position=np.array(position).reshape(-1, 2))


def test_the_track_goes_through_every_fix_and_bends_between_as_the_dead_reckoning_does():
    velocity = through_water()
    given = fixes([10, 300, 590], [(5.0, -3.0), (120.0, 60.0), (100.0, 250.0)])
    position, deviation = linear_track(velocity, PERIOD, given, DRIFT)
    np.testing.assert_allclose(position[given.sample], given.position, atol=1e-9)
    np.testing.assert_allclose(deviation[given.sample], given.deviation)
    # between two fixes the rate is that through the water and one constant current
    extra = np.diff(position[10:301], axis=0) / PERIOD - 0.5 * (velocity[11:301] + velocity[10:300])
    np.testing.assert_allclose(extra, np.broadcast_to(extra[0], extra.shape), atol=1e-9)


def test_a_steady_current_is_corrected_to_nothing():
    velocity, current = through_water(), np.array([0.08, -0.05])
    truth, _ = linear_track(velocity + current, PERIOD, fixes([0], [(0.0, 0.0)]), DRIFT)
    given = fixes([0, 400], [tuple(truth[0]), tuple(truth[400])])
    position, _ = linear_track(velocity, PERIOD, given, DRIFT)
    np.testing.assert_allclose(position, truth, atol=1e-6)  # after the last fix too


def test_two_fixes_of_one_stay_at_the_surface_tell_no_current():
    """5 m of noise within 2 s would be a current of 2.5 m/s for the rest of the mission."""
    given = fixes([598, 599], [(100.0, 0.0), (105.0, 0.0)])
    position, _ = linear_track(np.zeros((601, 2)), PERIOD, given, DRIFT)
    np.testing.assert_allclose(position[0], [100.0, 0.0])
    np.testing.assert_allclose(position[-1], [105.0, 0.0])


def test_the_deviation_is_that_of_a_random_walk_tied_to_both_fixes():
    """Against walks of that diffusivity, bridged in the same way."""
    rng, samples, walks = np.random.default_rng(5), 401, 400
    sigma = np.sqrt(DRIFT.diffusivity * PERIOD)
    steps = rng.normal(0.0, sigma, (walks, samples - 1, 2))
    truth = np.concatenate([np.zeros((walks, 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    errors = []
    for walk in truth:
        given = Fixes(
            sample=np.array([0, samples - 1]), position=walk[[0, samples - 1]], deviation=1e-6
        )
        position, deviation = linear_track(np.zeros((samples, 2)), PERIOD, given, DRIFT)
        errors.append(position - walk)
    seen = np.std(np.stack(errors), axis=(0, 2))
    np.testing.assert_allclose(seen[20:-20], deviation[20:-20], rtol=0.12)


def test_without_fixes_the_track_starts_at_the_origin_and_grows_unsure():
    drift = Drift(diffusivity=2.0, change=0.03, usual=(0.1, 0.0))
    position, deviation = linear_track(np.zeros((501, 2)), PERIOD, fixes([], []), drift)
    np.testing.assert_allclose(position[-1], [100.0, 0.0])
    assert deviation[0] == 0.0
    assert (np.diff(deviation) > 0.0).all()
    assert deviation[-1] > 0.03 * 1000.0


def dive(velocity: np.ndarray, current: tuple[float, float], start: float, mission: int):
    samples = len(velocity)
    swum = 0.5 * PERIOD * (velocity[1:] + velocity[:-1]).sum(axis=0)
    end = swum + PERIOD * (samples - 1) * np.array(current)
    given = fixes([0, samples - 1], [(0.0, 0.0), tuple(end)])
    depth = 40.0 * np.sin(np.linspace(0.0, np.pi, samples))
    return currents(mission, velocity, depth, PERIOD, given, start)


def test_the_current_of_a_dive_and_its_deviation():
    (found,) = dive(through_water(), (0.08, -0.05), 0.0, 3)
    assert (found.north, found.east) == pytest.approx((0.08, -0.05), abs=1e-9)
    assert (found.mission, found.duration) == (3, 1200.0)
    # no better than its fixes, no worse than speed and heading allow
    assert np.sqrt(2.0) * 5.0 / 1200.0 < found.deviation < 0.03
    flat = fixes([0, 600], [(0.0, 0.0), (50.0, 0.0)])
    assert currents(0, through_water(), np.zeros(601), PERIOD, flat, 0.0) == []


def test_the_change_of_the_current_sets_the_diffusivity():
    steady = [dive(through_water(), (0.1, 0.0), 1200.0 * k, k)[0] for k in range(6)]
    turning = [dive(through_water(), (0.1, 0.05 * (-1) ** k), 1200.0 * k, k)[0] for k in range(6)]
    assert drift_of(steady).diffusivity == pytest.approx(0.0, abs=1e-12)
    # 0.1 m/s of change between dives of 1200 s misses the fix between them by 0.1 * 600 m
    assert drift_of(turning).diffusivity == pytest.approx(0.5 * 0.1**2 * 600.0)
    assert drift_of(turning).usual == pytest.approx((0.1, 0.0), abs=1e-9)
    assert drift_of(steady[:2]).change == USUAL_CHANGE  # too few to say
    apart = [dive(through_water(), (0.1, 0.0), 9000.0 * k, k)[0] for k in range(6)]
    assert drift_of(apart).change == USUAL_CHANGE  # they do not follow each other
