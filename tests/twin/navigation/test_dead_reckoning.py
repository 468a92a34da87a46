"""Dead reckoning against tracks known in closed form, by the depth rate and by a Doppler log."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from navigation import PERIOD, add_fixes, steady_mission, trimmed_mission
from torpedo import TORPEDO

from twin.errors import InputError, StoreError
from twin.frames import euler_to_matrix
from twin.navigation.dead_reckoning import (
    LEAST_COSINE,
    AttitudeSeries,
    depth_averaged_current,
    depth_rate,
    dive_track,
    find_dives,
    gps_fixes,
    ground_track,
    heave_from_depth_rate,
    horizontal_error,
    integrate,
    rotate_to_ned,
    true_ground_track,
    true_water_path,
    true_water_track,
    water_track,
)
from twin.navigation.estimators.dvl import (
    SHORT_LOSS_S,
    SMOOTHING_S,
    SMOOTHINGS,
    Dvl,
    outliers,
    smoothed,
    spikes,
)
from twin.vehicle.vehicle import load_vehicle

ANGLE = st.floats(-1.2, 1.2)
SPEED = st.floats(-1.0, 1.0)


def attitude_of(roll, pitch, heading) -> AttitudeSeries:
    return AttitudeSeries(
        roll=np.atleast_1d(roll), pitch=np.atleast_1d(pitch), heading=np.atleast_1d(heading)
    )


def reckon(signals, surge=None, sway=None):
    return water_track(
        signals["true_surge"] if surge is None else surge,
        signals["true_sway"] if sway is None else sway,
        signals["measured_depth"],
        AttitudeSeries.of(signals),
        PERIOD,
    )


@given(SPEED, SPEED, SPEED, ANGLE, ANGLE, st.floats(0, 6.3))
def test_rotation_is_the_matrix_of_the_euler_angles(u, v, w, roll, pitch, heading):
    turned = rotate_to_ned(np.array([[u, v, w]]), attitude_of(roll, pitch, heading))
    assert turned[0] == pytest.approx(euler_to_matrix(roll, pitch, heading) @ [u, v, w], abs=1e-12)


@given(SPEED, SPEED, SPEED, ANGLE, ANGLE)
def test_heave_is_recovered_from_the_depth_rate_where_it_can_be(u, v, w, roll, pitch):
    if np.cos(roll) * np.cos(pitch) < LEAST_COSINE:
        return
    down = (euler_to_matrix(roll, pitch, 0.0) @ [u, v, w])[2]
    assert heave_from_depth_rate(down, u, v, roll, pitch) == pytest.approx(w, abs=1e-9)


def test_the_solved_heave_is_exact_to_a_fifth_of_a_cosine_and_fades_beyond():
    """0.1 m/s of depth rate at rest otherwise: w = 0.1 / cos(roll) down to a cosine of 0.2."""
    assert LEAST_COSINE == 0.2
    for cosine in (1.0, 0.5, 0.21, 0.19, 0.1, 0.05, 0.0):
        heave = heave_from_depth_rate(0.1, 0.0, 0.0, np.arccos(cosine), 0.0)
        expected = 0.1 / cosine if cosine > 0.2 else 0.1 * cosine / 0.04  # 0.1 cos / 0.2^2
        assert heave == pytest.approx(expected, abs=1e-12)


def test_heave_moves_a_rolled_vehicle_east():
    # The paper's equation (2) has no heave in its east row.
    moved = rotate_to_ned(np.array([[0.0, 0.0, 1.0]]), attitude_of(0.5, 0.0, 0.0))
    assert moved[0] == pytest.approx([0.0, -np.sin(0.5), np.cos(0.5)])


def test_straight_glide_is_exact():
    signals = steady_mission(2000, velocity=(0.45, 0.03, 0.02), roll=0.2, pitch=-0.6)
    assert horizontal_error(reckon(signals), true_ground_track(signals)).max() < 1e-9


def test_spiral_error_falls_with_the_square_of_the_time_step():
    def error(turn_rate):
        signals = steady_mission(4000, velocity=(0.4, -0.02, 0.01), roll=-0.2, turn_rate=turn_rate)
        return horizontal_error(reckon(signals), true_ground_track(signals)).max()

    # A circle of n samples: halving the angle per step quarters the error of the same arc length,
    # and the circle is twice as large.
    assert error(0.004) < 5e-4
    assert error(0.008) / error(0.004) == pytest.approx(2.0, rel=0.1)


def test_a_circle_closes():
    turn_rate = 2.0 * np.pi / 1000.0
    signals = steady_mission(2001, turn_rate=turn_rate)
    track = reckon(signals)
    assert np.hypot(*track[-1]) < 1e-6
    radius = np.ptp(track[:, 0]) / 2
    path = true_water_path(signals, PERIOD)[-1]
    assert radius == pytest.approx(path / (2 * np.pi), rel=1e-4)


def test_uniform_current_splits_into_water_and_ground():
    current = (0.12, -0.05)
    still, drifting = steady_mission(1500), steady_mission(1500, current=current)
    assert reckon(still) == pytest.approx(reckon(drifting), abs=1e-12)
    assert true_water_track(drifting, PERIOD) == pytest.approx(reckon(still), abs=1e-9)
    time = PERIOD * np.arange(1500)
    drift = true_ground_track(drifting) - true_water_track(drifting, PERIOD)
    assert drift == pytest.approx(time[:, None] * np.array(current), abs=1e-9)
    assert true_water_path(drifting, PERIOD) == pytest.approx(true_water_path(still, PERIOD))


@pytest.mark.parametrize("current", [(0.0, 0.0), (0.12, -0.05)])
def test_tracks_count_from_their_first_sample_wherever_that_is(current):
    here = steady_mission(1000, current=current)
    off = {"true_north": 1500.0, "true_east": -820.0}
    there = here | {name: here[name] + metres for name, metres in off.items()}
    for track in (true_ground_track(there), true_water_track(there, PERIOD)):
        assert track[0] == pytest.approx([0.0, 0.0])
    np.testing.assert_allclose(true_ground_track(there), true_ground_track(here), atol=1e-9)
    np.testing.assert_allclose(
        true_water_track(there, PERIOD), true_water_track(here, PERIOD), atol=1e-9
    )
    assert horizontal_error(reckon(there), true_water_track(there, PERIOD)).max() < 1e-9


def test_surge_error_goes_into_the_track_over_cos_pitch():
    # With z' measured, N = u / cos(theta) + z' tan(theta).
    signals = steady_mission(1000, pitch=-0.5, heading=0.0)
    wrong = reckon(signals, surge=signals["true_surge"] + 0.01) - reckon(signals)
    assert wrong[-1, 0] == pytest.approx(0.01 / np.cos(0.5) * PERIOD * 999)


def test_integration_is_trapezoidal():
    time = np.linspace(0.0, 3.0, 7)
    assert integrate(2.0 * time, 0.5) == pytest.approx(time**2)
    assert depth_rate(time**2, 0.5)[1:-1] == pytest.approx(2.0 * time[1:-1])


def test_a_missing_or_broken_channel_is_named():
    signals = steady_mission(50)
    signals["measured_pitch"][7] = np.nan
    with pytest.raises(StoreError, match=r"measured_pitch is not finite at 1 of 50.*sample 7"):
        AttitudeSeries.of(signals)
    del signals["measured_roll"]
    with pytest.raises(StoreError, match="no channel measured_roll"):
        AttitudeSeries.of(signals)


# --- dives ------------------------------------------------------------------------------------


def two_dives(current=(0.1, -0.03)):
    signals = steady_mission(4000, current=current, turn_rate=1e-3)
    add_fixes(signals, [0, 10, 20, 1800, 1810, 3600])
    return signals


def test_dives_are_the_long_gaps_between_fixes():
    dives = find_dives(two_dives(), PERIOD)
    assert [(dive.start, dive.end) for dive in dives] == [(20, 1800), (1810, 3600)]
    assert find_dives(steady_mission(4000), PERIOD) == []


@pytest.mark.parametrize("period", [0.5, 1.0, 5.0])
def test_five_minutes_without_a_fix_make_a_dive_at_any_sample_period(period):
    """Shorter gaps are missed fixes at the surface."""
    short, long = round(295.0 / period), round(300.0 / period)
    signals = steady_mission(short + long + 1)
    add_fixes(signals, [0, short, short + long])
    assert [(d.start, d.end) for d in find_dives(signals, period)] == [(short, short + long)]
    assert find_dives(signals, period)[0].seconds(period) == pytest.approx(300.0)


def test_depth_averaged_current_of_a_uniform_current_is_exact():
    signals = two_dives()
    track = reckon(signals)
    for dive in find_dives(signals, PERIOD):
        found = depth_averaged_current(dive, track, PERIOD)
        assert found == pytest.approx([0.1, -0.03], abs=1e-6)


def test_the_previous_dives_current_makes_the_second_dive_exact():
    signals = two_dives()
    first, second = find_dives(signals, PERIOD)
    moved = reckon(signals)
    truth = true_ground_track(signals)
    known = ground_track(moved, signals, PERIOD, knowledge="previous")
    assert horizontal_error(known, truth)[second.start :].max() < 1e-3
    # On the first dive nothing is known: it misses the current times the duration.
    missed = np.hypot(0.1, 0.03) * (first.end - 1 - first.start) * PERIOD
    assert horizontal_error(known, truth)[first.end - 1] == pytest.approx(missed, rel=1e-6)
    none = ground_track(moved, signals, PERIOD, knowledge="none")
    assert horizontal_error(none, truth)[second.end - 1] > 80.0


def test_every_fix_re_initialises_the_track():
    signals = two_dives()
    index, fixes = gps_fixes(signals)
    for knowledge in ("none", "previous", "corrected"):
        track = ground_track(reckon(signals), signals, PERIOD, knowledge=knowledge)
        assert track[index] == pytest.approx(fixes)


def test_correction_afterwards_removes_a_steady_velocity_error_and_closes_at_the_fix():
    signals = two_dives(current=(0.0, 0.0))
    dive = find_dives(signals, PERIOD)[0]
    straight = steady_mission(4000)
    add_fixes(straight, [20, 1800])
    moved = reckon(straight, surge=straight["true_surge"] + 0.02)
    track = ground_track(moved, straight, PERIOD, knowledge="corrected")
    inside = dive.span
    assert horizontal_error(track, true_ground_track(straight))[inside].max() < 1e-9
    current = depth_averaged_current(dive, reckon(signals), PERIOD)
    assert dive_track(dive, reckon(signals), current, PERIOD)[-1] == pytest.approx(dive.end_fix)


def test_unknown_knowledge_is_refused_with_the_nearest():
    signals = two_dives()
    with pytest.raises(InputError, match="did you mean 'previous'"):
        ground_track(reckon(signals), signals, PERIOD, knowledge="previus")


# --- aided by a Doppler log -----------------------------------------------------------------------


GLIDER, TORPEDO_VEHICLE = load_vehicle("glider"), load_vehicle(str(TORPEDO))
SAMPLES = 3000
CURRENT = (0.15, -0.1)
BOTTOM, WATER, LOST = 1.0, 2.0, 0.0


def with_log(signals, mode):
    """A mission with a Doppler log without errors in these modes."""
    angles = [np.deg2rad(signals[f"true_{n}"]) for n in ("roll", "pitch", "heading")]
    ground = np.stack([signals[f"true_velocity_{n}"] for n in ("north", "east", "down")], axis=-1)
    body = np.einsum("tij,ti->tj", euler_to_matrix(*angles), ground)
    for k, name in enumerate(("surge", "sway", "heave")):
        log = np.where(mode == BOTTOM, body[:, k], signals[f"true_{name}"])
        signals[f"measured_dvl_{name}"] = np.where(mode == LOST, np.nan, log)
    signals["measured_dvl_mode"] = np.asarray(mode, float)
    return signals


def logged(*parts, current=CURRENT, **motion):
    """A torpedo's mission with its log in (mode, samples) one after the other."""
    mode = np.concatenate([np.full(samples, mode) for mode, samples in parts])
    motion = {"velocity": (1.0, -0.03, 0.02), "current": current, **motion}
    return with_log(steady_mission(len(mode), **motion), mode)


def reckoned(signals, vehicle=TORPEDO_VEHICLE):
    """Error over ground [m] at every sample, and the estimate."""
    estimate = Dvl(vehicle, PERIOD).batch({c: signals[c] for c in Dvl.needs(vehicle)})
    assert estimate.ground_track is not None
    return horizontal_error(estimate.ground_track, true_ground_track(signals)), estimate


def test_a_torpedo_on_the_bottom_without_lock_does_not_go_on():
    signals = logged((BOTTOM, 400), (LOST, 2000))
    way = reckoned(signals)[1].ground_track
    assert np.hypot(*(way[-1] - way[1000])) > 500.0
    lying = {name: np.array(values) for name, values in signals.items()}
    lying["measured_depth"][400:] = lying["measured_depth"][400]
    lying["measured_pitch"][400:] = -21.0
    channels = {name: lying[name] for name in Dvl.needs(TORPEDO_VEHICLE)}
    found = Dvl(TORPEDO_VEHICLE, PERIOD).batch(channels).ground_track
    assert np.hypot(*(found[-1] - found[500])) < 1e-6
    moving, still = (
        Dvl(TORPEDO_VEHICLE, PERIOD).last({n: values[380:end] for n, values in channels.items()})
        for end in (402, 500)
    )
    assert moving.surge == pytest.approx(1.0, abs=0.3)
    assert (still.surge, still.sway) == (0.0, 0.0)


# --- a glider ---------------------------------------------------------------------------------


def test_bottom_lock_gives_the_track_over_ground():
    signals = steady_mission(1000, current=(0.1, -0.2), pitch=0.0, heading=0.0)
    error, estimate = reckoned(with_log(signals, np.full(1000, BOTTOM)), GLIDER)
    assert error.max() < 1e-6
    assert estimate.surge is None  # it says nothing on the velocity through the water


def test_water_lock_gives_the_velocity_through_the_water():
    signals = with_log(trimmed_mission(1000, current=(0.1, 0.0)), np.full(1000, WATER))
    estimate = Dvl(GLIDER, PERIOD).batch(signals)
    assert estimate.surge == pytest.approx(signals["true_surge"])
    track = water_track(
        estimate.surge, estimate.sway, signals["measured_depth"], AttitudeSeries.of(signals), PERIOD
    )
    assert horizontal_error(track, true_water_track(signals, PERIOD)).max() < 1e-6


def test_the_current_found_in_bottom_lock_is_carried_into_water_lock():
    current = (0.1, -0.05)
    signals = trimmed_mission(6000, current=current, heading=0.0)
    with_log(signals, np.where(np.arange(6000) < 3000, BOTTOM, WATER))
    error, _ = reckoned(signals, GLIDER)
    assert error[-1] < 0.02 * np.hypot(*current) * 3000 * PERIOD


def test_losses_of_lock_are_filled():
    mode = np.full(2000, WATER)
    mode[300:310] = mode[900:1500] = LOST
    signals = with_log(trimmed_mission(2000), mode)
    estimate = Dvl(GLIDER, PERIOD).batch(signals)
    assert np.isfinite(estimate.surge).all()
    assert estimate.surge == pytest.approx(signals["true_surge"], abs=3e-4)


def test_without_any_lock_nothing_is_estimated():
    estimate = Dvl(GLIDER, PERIOD).batch(trimmed_mission(300))
    assert estimate.surge is None
    assert estimate.ground_track is None


# --- a vehicle whose flight is not modelled ---------------------------------------------------


def test_it_suits_a_vehicle_that_does_not_glide_and_asks_for_no_pump():
    assert not Dvl.unsuited(TORPEDO_VEHICLE)
    assert "measured_pump" not in Dvl.needs(TORPEDO_VEHICLE)
    assert "measured_pump" in Dvl.needs(load_vehicle("glider"))


def test_bottom_lock_needs_no_knowledge_of_the_current():
    error, estimate = reckoned(logged((BOTTOM, SAMPLES), turn_rate=0.004))
    assert error.max() < 0.01  # the trapezoids of a turn
    assert estimate.surge is None


def test_a_long_loss_after_bottom_lock_holds_the_velocity_over_ground():
    lost = 240
    parts = (BOTTOM, 1000), (LOST, lost), (BOTTOM, 1000)
    error, _ = reckoned(logged(*parts))
    assert lost * PERIOD > SHORT_LOSS_S
    assert error.max() < 0.01
    turned, _ = reckoned(logged(*parts, turn_rate=0.01))
    # the body's velocity is held, in which the current turns with the vehicle: wrong by that much
    assert 1.0 < turned[-1] < 2.0 * np.hypot(*CURRENT) * lost * PERIOD


def test_the_current_is_learned_where_water_lock_ends_and_carried_into_the_next():
    error, _ = reckoned(logged((WATER, 300), (BOTTOM, 900), (WATER, 900), pitch=0.0))
    unknown = np.hypot(*CURRENT) * 300 * PERIOD
    assert error[300] == pytest.approx(unknown, rel=0.05)  # before the first bottom lock
    assert error[-1] - error[300] < 0.02 * np.hypot(*CURRENT) * 900 * PERIOD


def test_water_lock_in_still_water_gives_velocities_and_track():
    error, estimate = reckoned(logged((WATER, SAMPLES), current=(0.0, 0.0)))
    assert error.max() < 1e-6
    assert estimate.surge == pytest.approx(1.0)


def test_spikes_do_not_move_the_track():
    signals = logged((BOTTOM, SAMPLES))
    signals["measured_dvl_surge"][500:2500:100] += 0.4
    error, _ = reckoned(signals)
    assert error.max() < 0.05  # 20 of them as they stand are 4 m


def test_a_log_without_a_mode_at_some_samples_counts_them_as_lost():
    signals = logged((BOTTOM, SAMPLES))
    signals["measured_dvl_mode"][100:110] = np.nan
    error, _ = reckoned(signals)
    assert error.max() < 0.01


# --- cleaning ---------------------------------------------------------------------------------

CLEANED = 600
ALL = np.ones(CLEANED, bool)


def noisy(level=0.9, noise=0.002, seed=1):
    return level + noise * np.random.default_rng(seed).standard_normal(CLEANED)


@pytest.mark.parametrize("causal", [False, True])
def test_known_outliers_are_found_and_little_else(causal):
    values = noisy()
    values[[50, 51, 300, 301, 302]] += (0.4, -0.3, 0.2, 0.2, 0.2)
    found = np.flatnonzero(outliers(values, ALL, causal=causal))
    assert {50, 51, 300, 301, 302} <= set(found)
    assert len(found) < 0.03 * CLEANED  # a median deviation of 11 samples is itself uncertain


@pytest.mark.parametrize("causal", [False, True])
def test_the_onset_of_a_turn_is_no_outlier(causal):
    values = np.clip(0.03 * (np.arange(CLEANED) - 200), 0.0, 0.15)  # 0.15 m/s in 2.5 s
    found = outliers(values + noisy(0.0, 2e-4), ALL, causal=causal)
    assert found.sum() <= (6 if causal else 0)


def test_outliers_beside_a_gap_are_judged_by_what_is_there():
    values = noisy()
    valid = ALL.copy()
    valid[100:200] = False
    values[100:200] = np.nan
    values[[99, 205]] += (0.3, -0.3)
    found = outliers(values, valid)
    assert found[[99, 205]].all()
    assert not found[100:200].any()
    assert not outliers(np.full(9, np.nan), np.zeros(9, bool)).any()


@pytest.mark.parametrize("kind", SMOOTHINGS)
def test_smoothing_keeps_a_constant_right_up_to_a_gap_and_leaves_the_gap(kind):
    valid = ALL.copy()
    valid[100:140] = valid[:3] = False
    values = np.where(valid, 0.8, np.nan)
    out = smoothed(values, valid, PERIOD, kind)
    np.testing.assert_array_equal(np.isfinite(out), valid)
    assert out[valid] == pytest.approx(0.8, abs=1e-12)


@pytest.mark.parametrize("kind", ["gaussian", "causal"])
def test_smoothing_averages_noise_away(kind):
    values = noisy(0.0, 0.01)
    out = smoothed(values, ALL, PERIOD, kind)
    # white noise under weights w falls to sqrt(sum w^2) of itself
    steps = np.arange(-8, 9) if kind == "gaussian" else np.arange(9)
    weights = np.exp(-0.5 * (steps * PERIOD / SMOOTHING_S) ** 2)
    expected = np.sqrt(np.sum(weights**2)) / np.sum(weights)
    assert out.std() / values.std() == pytest.approx(expected, rel=0.15)


def test_only_the_causal_kind_does_without_the_future():
    values, later = noisy(), noisy()
    later[400:] += 0.5
    past = slice(0, 400)
    for kind, same in (("causal", True), ("gaussian", False), ("none", True)):
        a, b = (smoothed(v, ALL, PERIOD, kind)[past] for v in (values, later))
        assert np.array_equal(a, b) is same, kind
    a, b = (outliers(v, ALL, causal=True)[past] for v in (values, later))
    assert np.array_equal(a, b)
    lone, step = noisy(), noisy()
    lone[399] = step[399] = 1.2
    step[400:] += 0.3  # the future says that the sample was no outlier
    assert [bool(outliers(v, ALL)[399]) for v in (lone, step)] == [True, False]
    assert [bool(outliers(v, ALL, causal=True)[399]) for v in (lone, step)] == [True, True]


def test_the_causal_kind_lags_as_it_says():
    ramp = 0.01 * PERIOD * np.arange(CLEANED)
    lag = (ramp - smoothed(ramp, ALL, PERIOD, "causal"))[50:] / 0.01
    assert lag == pytest.approx(0.8 * SMOOTHING_S, abs=0.25 * SMOOTHING_S)
    assert smoothed(ramp, ALL, PERIOD, "gaussian")[50:-50] == pytest.approx(ramp[50:-50])


def test_hampel_finds_spikes_and_nothing_else():
    rng = np.random.default_rng(1)
    values = 0.4 + 0.002 * rng.standard_normal(500)
    values[[50, 51, 300]] += (0.4, -0.3, 0.2)
    found = np.flatnonzero(spikes(values, np.ones(500, bool)))
    assert {50, 51, 300} <= set(found)
    assert len(found) < 15  # one in a hundred samples of plain noise
