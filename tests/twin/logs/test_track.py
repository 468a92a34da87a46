"""Corrected tracks: they meet their fixes, follow a tide within dives, and know how well."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from twin.errors import UnknownName
from twin.logs import Drift, Fixes, corrected_track, estimate_flight, linear_track
from twin.logs.corrected_track import USUAL_CHANGE, currents, drift_of, track_velocity
from twin.logs.flight_summary import HIGHEST, phase_speed
from twin.logs.track import (
    PHASE,
    SHEAR_SHARE,
    VELOCITY_SHARE,
    SmoothedWay,
    smoothed_tracks,
    stays,
    track_parameters,
)
from twin.navigation.current import CurrentParameters
from twin.navigation.current.modes import modes_of, passage

PERIOD = 60.0
DIVE, SURFACE = 180, 10
"""Samples of a dive and of a stay: 3 h and 10 min"""
LATITUDE = 45.0
SPEED = 0.3
"""[m/s] through the water"""
TIDE = 0.2
"""[m/s] north"""


def way_of(current: np.ndarray, rng: np.random.Generator, wrong: np.ndarray | float = 0.0):
    """A way in a current, its fixes at the ends of dives, and the truth."""
    count = len(current)
    heading = np.repeat(rng.uniform(0.0, 6.28, -(-count // 45)), 45)[:count]
    swum = SPEED * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    truth = np.concatenate([np.zeros((1, 2)), np.cumsum(PERIOD * 0.5 * (
        (swum + current)[1:] + (swum + current)[:-1]), axis=0)])  # fmt: skip
    ends = np.arange(0, count, DIVE + SURFACE)
    sample = np.unique(np.concatenate([ends, ends[1:] - SURFACE]))
    sample = sample[sample < count]
    fixes = Fixes(sample=sample, position=truth[sample] + rng.normal(0.0, 5.0, (len(sample), 2)))
    return SmoothedWay(velocity=swum - wrong, fixes=fixes, start=0.0), truth


def tidal(count: int) -> np.ndarray:
    phase = 2.0 * np.pi * PERIOD * np.arange(count) / (12.4206012 * 3600.0)
    return TIDE * np.stack([np.cos(phase), 0.3 * np.sin(phase)], axis=1)


def test_the_velocity_of_a_track_on_board_has_no_jump_at_a_fix():
    """East at 0.2 m/s, and 0.4 m/s after a fix that shifts the track; gaps are bridged."""
    east = np.array([0.0, 12.0, 24.0, 36.0, 536.0, 560.0, 584.0, 608.0])
    north = np.where(np.arange(8) < 4, 0.0, -300.0)
    track = np.stack([north, east], axis=1)
    track[[1, 6]] = np.nan
    fixes = Fixes(sample=np.array([0, 4]), position=track[[0, 4]])
    found = track_velocity(track, PERIOD, fixes)
    np.testing.assert_allclose(found[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], [0.2] * 4 + [0.4] * 4)
    assert track_velocity(np.full((3, 2), np.nan), PERIOD, fixes) is None


def test_in_a_tide_it_errs_by_far_less_than_the_linear_correction():
    way, truth = way_of(tidal(10 * (DIVE + SURFACE)), np.random.default_rng(2))
    parameters = track_parameters([[way]], PERIOD, LATITUDE)
    ((position, deviation),) = smoothed_tracks([way], PERIOD, LATITUDE, parameters)
    linear, _ = linear_track(way.velocity, PERIOD, way.fixes, Drift(diffusivity=1.0, change=0.1))
    under = slice(0, int(way.fixes.sample[-1]) + 1)

    def error(track: np.ndarray) -> float:
        return float(np.sqrt(np.mean((track - truth)[under] ** 2)))

    assert error(position) < 0.4 * error(linear)
    np.testing.assert_allclose(position[way.fixes.sample], way.fixes.position, atol=1e-6)
    np.testing.assert_allclose(deviation[way.fixes.sample], way.fixes.deviation)
    assert deviation[DIVE // 2] > way.fixes.deviation


def test_its_deviation_is_right_for_the_currents_and_errors_that_it_models():
    """Currents and velocities drawn from the filter's own equations, 25 times."""
    rng = np.random.default_rng(8)
    parameters = CurrentParameters(
        constituents=("M2",), speed_scale=0.0, compass=0.0, dive=0.0, mean=0.05
    )
    modes = modes_of(parameters, LATITUDE)
    gone = passage(modes, PERIOD)
    count, normalised = 6 * (DIVE + SURFACE), []
    keep = np.exp(-PERIOD / PHASE)
    spread = float(np.hypot(VELOCITY_SHARE * SPEED, SHEAR_SHARE * parameters.mean))
    for _ in range(25):
        z = np.sqrt(modes.variance) * (rng.normal(size=(2, len(modes))) * [[1.0], [1j]]).sum(axis=0)
        wrong, current, errors = rng.normal(0.0, spread, 2), [], []
        for _ in range(count):
            current.append((z.sum().real, z.sum().imag))
            errors.append(wrong)
            z = gone.kept * z + np.sqrt(gone.noise) * (
                rng.normal(size=(2, len(modes))) * [[1.0], [1j]]
            ).sum(axis=0)
            wrong = keep * wrong + np.sqrt(1.0 - keep**2) * rng.normal(0.0, spread, 2)
        way, truth = way_of(np.array(current), rng, np.array(errors))
        ((position, deviation),) = smoothed_tracks([way], PERIOD, LATITUDE, parameters)
        inside = np.arange(count) % (DIVE + SURFACE) < DIVE
        inside &= np.arange(count) <= way.fixes.sample[-1]
        missed = (position - truth)[inside] / deviation[inside, None]
        normalised.append(np.mean(missed**2))
    assert np.sqrt(np.mean(normalised)) == pytest.approx(1.0, abs=0.15)


def test_several_missions_of_a_deployment_are_smoothed_together():
    """The dives before and after tell the course of the current within one."""
    way, truth = way_of(tidal(8 * (DIVE + SURFACE)), np.random.default_rng(3))
    parameters = track_parameters([[way]], PERIOD, LATITUDE)
    parts = []
    for k in range(8):
        first = k * (DIVE + SURFACE)
        own = (way.fixes.sample >= first) & (way.fixes.sample <= first + DIVE)
        parts.append(
            SmoothedWay(
                velocity=way.velocity[first : first + DIVE + 1],
                fixes=Fixes(
                    sample=way.fixes.sample[own] - first,
                    position=way.fixes.position[own] - truth[first],
                ),
                start=PERIOD * first,
            )
        )
    together = smoothed_tracks(parts[::-1], PERIOD, LATITUDE, parameters)[::-1]  # any order
    alone = [smoothed_tracks([part], PERIOD, LATITUDE, parameters)[0] for part in parts]
    middle = slice(2, 6)
    errors = [
        np.sqrt(np.mean([np.mean((one[0] - truth[k * (DIVE + SURFACE):][: DIVE + 1]
                                  + truth[k * (DIVE + SURFACE)]) ** 2)
                         for k, one in list(enumerate(tracks))[middle]]))
        for tracks in (together, alone)
    ]  # fmt: skip
    assert errors[0] < 0.7 * errors[1]
    assert np.mean([t[1].max() for t in together]) < np.mean([t[1].max() for t in alone])


def test_before_the_first_and_after_the_last_fix_it_grows_unsure():
    way, truth = way_of(np.full((500, 2), 0.05), np.random.default_rng(4))
    few = (way.fixes.sample > 100) & (way.fixes.sample < 400)
    fixes = Fixes(sample=way.fixes.sample[few], position=way.fixes.position[few])
    position, deviation = corrected_track(way.velocity, PERIOD, fixes, LATITUDE)
    assert deviation[0] > deviation[80] > deviation[fixes.sample[0]]
    assert deviation[-1] > deviation[420] > deviation[fixes.sample[-1]]
    for end in (0, -1):
        assert np.hypot(*(position - truth)[end]) < 4.0 * deviation[end]


def test_without_a_fix_it_begins_at_the_origin():
    nothing = Fixes(sample=np.zeros(0, np.intp), position=np.zeros((0, 2)))
    position, deviation = corrected_track(np.full((101, 2), 0.1), PERIOD, nothing)
    np.testing.assert_allclose(position[[0, -1]], [[0.0, 0.0], [600.0, 600.0]], atol=1e-6)
    assert deviation[0] < 0.01
    assert deviation[-1] > 100.0
    assert corrected_track(np.zeros((1, 2)), PERIOD, nothing)[0].shape == (1, 2)


def test_a_stay_is_a_run_of_fixes():
    fixes = Fixes(sample=np.array([0, 1, 2, 60, 61, 200]), position=np.zeros((6, 2)))
    assert stays(fixes, 10.0) == [(0, 2), (3, 4), (5, 5)]
    assert stays(fixes, 100.0) == [(0, 2), (3, 4), (5, 5)]


def dive_of(down: float, up: float):
    """Sinks and rises so much faster than its model's 0.1 m/s."""
    half = 400
    descending = np.arange(2 * half) < half
    return SimpleNamespace(
        descending=descending,
        ascending=~descending,
        sink_rate=np.where(descending, 0.1, -0.1),
        water_up=np.where(descending, 0.1 - 0.1 * down, -0.1 + 0.1 * up),
        velocity=np.full((2 * half, 2), 0.3),
    )


def test_a_heavy_vehicle_is_faster_down_and_slower_up():
    speed = phase_speed([dive_of(1.2, 0.9)], 2.0)
    assert (speed.descent, speed.climb) == pytest.approx((1.2, 0.9), rel=1e-9)  # in a still sea
    scaled = speed.scaled(dive_of(1.2, 0.9))
    assert scaled[10] == pytest.approx(0.36, abs=0.005)
    assert scaled[-10] == pytest.approx(0.27, abs=0.005)
    assert phase_speed([dive_of(3.0, 1.0)], 2.0).descent == HIGHEST
    assert phase_speed([], 2.0).descent == 1.0


def test_the_sea_s_own_motion_is_not_taken_for_ballast():
    dive = dive_of(1.2, 1.0)
    swell = 0.5 * np.sin(np.arange(800) / 9.0)
    rough = SimpleNamespace(**{**vars(dive), "water_up": dive.water_up + swell})
    assert 1.0 < phase_speed([rough], 2.0).descent < 1.05


def test_an_unknown_correction_is_named(tmp_path):
    with pytest.raises(UnknownName, match="did you mean 'linear'"):
        estimate_flight(tmp_path / "no.zarr", track="linaer")


def test_parameters_of_several_records_are_found_together():
    rng = np.random.default_rng(5)
    ways = [
        way_of(np.zeros((DIVE + SURFACE + 1, 2)) + rng.normal(0, 0.03, 2), rng)[0]
        for _ in range(12)
    ]
    weak = track_parameters([[way] for way in ways], PERIOD, LATITUDE)
    few = track_parameters([[ways[0]]], PERIOD, LATITUDE)
    assert weak.mean < 0.08
    assert weak.mean < few.mean
    assert weak.constituents == ("M2", "K1")


# --- the linear correction ------------------------------------------------------------------------


STEP = 2.0
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
    position, deviation = linear_track(velocity, STEP, given, DRIFT)
    np.testing.assert_allclose(position[given.sample], given.position, atol=1e-9)
    np.testing.assert_allclose(deviation[given.sample], given.deviation)
    # between two fixes the rate is that through the water and one constant current, which
    # continues before the first fix and after the last one
    extra = np.diff(position, axis=0) / STEP - 0.5 * (velocity[1:] + velocity[:-1])
    for one in (extra[:300], extra[300:]):
        np.testing.assert_allclose(one, np.broadcast_to(one[100], one.shape), atol=1e-9)
    assert np.abs(extra[0] - extra[-1]).max() > 0.05


def test_a_steady_current_is_corrected_to_nothing():
    velocity, current = through_water(), np.array([0.08, -0.05])
    truth, _ = linear_track(velocity + current, STEP, fixes([0], [(0.0, 0.0)]), DRIFT)
    given = fixes([0, 400], [tuple(truth[0]), tuple(truth[400])])
    position, _ = linear_track(velocity, STEP, given, DRIFT)
    np.testing.assert_allclose(position, truth, atol=1e-6)  # after the last fix too


def test_two_fixes_of_one_stay_at_the_surface_tell_no_current():
    """5 m of noise within 2 s would be a current of 2.5 m/s for the rest of the mission."""
    given = fixes([598, 599], [(100.0, 0.0), (105.0, 0.0)])
    position, _ = linear_track(np.zeros((601, 2)), STEP, given, DRIFT)
    np.testing.assert_allclose(position[0], [100.0, 0.0])
    np.testing.assert_allclose(position[-1], [105.0, 0.0])


def test_the_deviation_is_that_of_a_random_walk_tied_to_both_fixes():
    """Against walks of that diffusivity, bridged in the same way."""
    rng, samples, walks = np.random.default_rng(5), 401, 400
    sigma = np.sqrt(DRIFT.diffusivity * STEP)
    steps = rng.normal(0.0, sigma, (walks, samples - 1, 2))
    truth = np.concatenate([np.zeros((walks, 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    errors = []
    for walk in truth:
        given = Fixes(
            sample=np.array([0, samples - 1]), position=walk[[0, samples - 1]], deviation=1e-6
        )
        position, deviation = linear_track(np.zeros((samples, 2)), STEP, given, DRIFT)
        errors.append(position - walk)
    seen = np.std(np.stack(errors), axis=(0, 2))
    np.testing.assert_allclose(seen[20:-20], deviation[20:-20], rtol=0.12)


def test_without_fixes_the_track_starts_at_the_origin_and_grows_unsure():
    drift = Drift(diffusivity=2.0, change=0.03, usual=(0.1, 0.0))
    position, deviation = linear_track(np.zeros((501, 2)), STEP, fixes([], []), drift)
    np.testing.assert_allclose(position[-1], [100.0, 0.0])
    assert deviation[0] == 0.0
    assert (np.diff(deviation) > 0.0).all()
    assert deviation[-1] > 0.03 * 1000.0


def dive(velocity, current: tuple[float, float], start: float, mission: int, **known):
    samples = len(velocity)
    swum = 0.5 * STEP * (velocity[1:] + velocity[:-1]).sum(axis=0)
    end = swum + STEP * (samples - 1) * np.array(current)
    given = dataclasses.replace(fixes([0, samples - 1], [(0.0, 0.0), tuple(end)]), **known)
    depth = 40.0 * np.sin(np.linspace(0.0, np.pi, samples))
    return currents(mission, velocity, depth, STEP, given, start)


def test_the_current_of_a_dive_and_its_deviation():
    (found,) = dive(through_water(), (0.08, -0.05), 0.0, 3)
    assert (found.north, found.east) == pytest.approx((0.08, -0.05), abs=1e-9)
    assert (found.mission, found.duration) == (3, 1200.0)
    assert found.deviation < 0.03
    (exact,) = dive(through_water(), (0.08, -0.05), 0.0, 3, deviation=1e-9)
    by_fixes = found.deviation**2 - exact.deviation**2
    assert by_fixes == pytest.approx(2.0 * (5.0 / 1200.0) ** 2)  # two fixes, each off by 5 m
    assert exact.deviation > 0.01  # speed and heading
    flat = fixes([0, 600], [(0.0, 0.0), (50.0, 0.0)])
    assert currents(0, through_water(), np.zeros(601), STEP, flat, 0.0) == []


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
