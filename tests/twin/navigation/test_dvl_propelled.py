"""DVL-aided dead reckoning of a vehicle whose flight is not modelled: a torpedo."""

import numpy as np
import pytest
from navigation import PERIOD, steady_mission
from torpedo import TORPEDO

from twin.frames import euler_to_matrix
from twin.navigation.dead_reckoning import horizontal_error, true_ground_track
from twin.navigation.estimators.dvl import SHORT_LOSS_S, Dvl
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle(str(TORPEDO))
SAMPLES = 3000
CURRENT = (0.15, -0.1)
BOTTOM, WATER, LOST = 1.0, 2.0, 0.0


def logged(mode, current=CURRENT, **motion):
    """A mission with a Doppler log without errors in these modes."""
    signals = steady_mission(len(mode), velocity=(1.0, -0.03, 0.02), current=current, **motion)
    angles = [np.deg2rad(signals[f"true_{n}"]) for n in ("roll", "pitch", "heading")]
    ground = np.stack([signals[f"true_velocity_{n}"] for n in ("north", "east", "down")], axis=-1)
    body = np.einsum("tij,ti->tj", euler_to_matrix(*angles), ground)
    for k, name in enumerate(("surge", "sway", "heave")):
        log = np.where(mode == BOTTOM, body[:, k], signals[f"true_{name}"])
        signals[f"measured_dvl_{name}"] = np.where(mode == LOST, np.nan, log)
    signals["measured_dvl_mode"] = mode
    return signals


def modes(*parts):
    return np.concatenate([np.full(samples, mode) for mode, samples in parts])


def reckoned(signals):
    """Error over ground [m] at every sample, and the estimate."""
    estimate = Dvl(VEHICLE, PERIOD).batch({c: signals[c] for c in Dvl.needs(VEHICLE)})
    assert estimate.ground_track is not None
    return horizontal_error(estimate.ground_track, true_ground_track(signals)), estimate


def test_it_suits_a_vehicle_that_does_not_glide_and_asks_for_no_pump():
    assert not Dvl.unsuited(VEHICLE)
    assert "measured_pump" not in Dvl.needs(VEHICLE)
    assert "measured_pump" in Dvl.needs(load_vehicle("glider"))


def test_bottom_lock_needs_no_knowledge_of_the_current():
    error, estimate = reckoned(logged(modes((BOTTOM, SAMPLES)), turn_rate=0.004))
    assert error.max() < 0.01  # the trapezoids of a turn
    assert estimate.surge is None


def test_a_long_loss_after_bottom_lock_holds_the_velocity_over_ground():
    lost = 240
    error, _ = reckoned(logged(modes((BOTTOM, 1000), (LOST, lost), (BOTTOM, 1000))))
    assert lost * PERIOD > SHORT_LOSS_S
    assert error.max() < 0.01
    turned, _ = reckoned(
        logged(modes((BOTTOM, 1000), (LOST, lost), (BOTTOM, 1000)), turn_rate=0.01)
    )
    # the body's velocity is held, in which the current turns with the vehicle: wrong by that much
    assert 1.0 < turned[-1] < 2.0 * np.hypot(*CURRENT) * lost * PERIOD


def test_the_current_is_learned_where_water_lock_ends_and_carried_into_the_next():
    pattern = modes((WATER, 300), (BOTTOM, 900), (WATER, 900))
    error, _ = reckoned(logged(pattern, pitch=0.0))
    unknown = np.hypot(*CURRENT) * 300 * PERIOD
    assert error[300] == pytest.approx(unknown, rel=0.05)  # before the first bottom lock
    assert error[-1] - error[300] < 0.02 * np.hypot(*CURRENT) * 900 * PERIOD


def test_water_lock_in_still_water_gives_velocities_and_track():
    error, estimate = reckoned(logged(modes((WATER, SAMPLES)), current=(0.0, 0.0)))
    assert error.max() < 1e-6
    assert estimate.surge == pytest.approx(1.0)


def test_spikes_do_not_move_the_track():
    signals = logged(modes((BOTTOM, SAMPLES)))
    signals["measured_dvl_surge"][500:2500:100] += 0.4
    error, _ = reckoned(signals)
    assert error.max() < 0.05  # 20 of them as they stand are 4 m


def test_a_log_without_a_mode_at_some_samples_counts_them_as_lost():
    signals = logged(modes((BOTTOM, SAMPLES)))
    signals["measured_dvl_mode"][100:110] = np.nan
    error, _ = reckoned(signals)
    assert error.max() < 0.01
