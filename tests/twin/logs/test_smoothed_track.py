"""The smoothed track: it meets its fixes, follows a tide within dives, and knows how well."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.errors import UnknownName
from twin.logs import Drift, Fixes, corrected_track, estimate_flight, linear_track
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
