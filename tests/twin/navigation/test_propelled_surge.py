"""Propelled vehicles without a Doppler log: limits of the speed, standstill, fitted balances."""

import numpy as np
import pytest

from twin.errors import InputError
from twin.navigation.propelled_surge import LiftBalance, Propulsion, ThrustBalance
from twin.navigation.standstill import COAST, largest_surge, quiet_rate, standing, yaw_noise

PERIOD = 1.0
TIME = PERIOD * np.arange(240)


def flown(surge, pitch_deg, attack_deg):
    """Depth [m] and pitch [rad] of a straight flight at an angle of attack."""
    pitch = np.full(TIME.size, np.radians(pitch_deg))
    return 30.0 - surge * np.sin(pitch - np.radians(attack_deg)) * TIME, pitch


@pytest.mark.parametrize("pitch", [-25.0, -14.0, 0.0, 14.0, 25.0])
@pytest.mark.parametrize("attack", [-8.0, 0.0, 8.0])
def test_the_speed_of_a_vehicle_under_way_is_below_its_largest(pitch, attack):
    depth, angle = flown(1.5, pitch, attack)
    assert (largest_surge(depth, angle, PERIOD) >= 1.5).all()
    assert not standing(angle, PERIOD, depth=depth).any()


def test_a_steep_flight_is_limited_and_a_level_one_is_not():
    assert largest_surge(*flown(1.5, -25.0, 0.0), PERIOD)[120] == pytest.approx(2.85, abs=0.15)
    assert np.isinf(largest_surge(*flown(1.5, -11.0, 0.0), PERIOD)).all()


def test_a_vehicle_that_lies_on_the_bottom_with_its_nose_down_stands():
    depth, angle = flown(0.0, -20.0, 0.0)
    assert standing(angle, PERIOD, depth=depth + 0.05 * np.sin(TIME)).all()
    rising = 30.0 - 0.1 * TIME  # by its buoyancy, nose down
    assert standing(angle, PERIOD, depth=rising).all()


def test_a_level_vehicle_stands_by_its_propeller_alone():
    depth, angle = flown(0.0, 0.0, 0.0)
    assert not standing(angle, PERIOD, depth=depth).any()
    speed = np.where((TIME > 50.0) & (TIME < 100.0), 900.0, 3.0)  # controllers report noise
    told = standing(angle, PERIOD, depth=depth, propeller=speed)
    np.testing.assert_array_equal(told, (TIME <= 50.0) | (TIME > 99.0 + COAST))
    # at the surface, a nose that is held down does not take a driven vehicle down
    depth, angle = flown(0.0, -20.0, 0.0)
    told = standing(angle, PERIOD, depth=depth, propeller=speed)
    assert not told[(TIME > 50.0) & (TIME < 100.0)].any()


def test_yaw_noise_divides_standing_from_moving_only_where_it_does():
    rng = np.random.default_rng(0)
    surge = np.where(TIME < 120.0, 0.0, 1.2)
    rate = rng.normal(size=TIME.size) * np.where(TIME < 120.0, 0.002, 0.02)
    noise = yaw_noise(rate, PERIOD)
    quiet = quiet_rate(noise, np.where(TIME == 7.0, np.nan, surge))
    assert 0.002 < quiet < 0.02
    told = standing(np.zeros(TIME.size), PERIOD, yaw_rate=rate, quiet=quiet)
    assert told[TIME < 100.0].mean() > 0.95
    assert not told[TIME > 140.0].any()
    assert quiet_rate(noise, np.full(TIME.size, 1.2)) == 0.0  # nothing stands
    assert quiet_rate(yaw_noise(rng.normal(size=TIME.size), PERIOD), surge) == 0.0  # chance
    assert not standing(np.zeros(TIME.size), PERIOD, yaw_rate=rate).any()


def test_one_sample_limits_nothing_and_unequal_lengths_are_named():
    assert not standing(np.full(1, -0.5), PERIOD, depth=np.full(1, 9.0)).any()
    with pytest.raises(InputError, match=r"depth \(3,\) and pitch \(2,\)"):
        largest_surge(np.zeros(3), np.zeros(2), PERIOD)


def test_the_balance_of_lift_finds_the_speed_of_an_unseen_flight():
    rng = np.random.default_rng(1)
    zero_lift, buoyancy = -0.02, -0.08

    def flight(surge):
        """Depth rate, and the trim that holds the depth nearly."""
        rate = 0.02 * rng.normal(size=surge.size)
        down = rate / surge - zero_lift - buoyancy / surge**2
        return rate, down + 1e-3 * rng.normal(size=surge.size)

    surge = rng.uniform(0.6, 1.9, 400)
    found = LiftBalance.fit(*flight(surge), surge)
    assert found.zero_lift == pytest.approx(zero_lift, abs=2e-3)
    assert found.buoyancy == pytest.approx(buoyancy, abs=2e-3)
    unseen = rng.uniform(0.6, 1.9, 200)
    errors = found.surge(*flight(unseen)) - unseen
    assert np.sqrt(np.mean(errors**2)) < 0.25 * unseen.std()
    assert found.surge(np.full(2, np.nan), np.zeros(2)) == pytest.approx(found.mean, abs=0.05)


def driven(model, on, depth, power):
    """A run of four minutes whose propeller turns from 30 s to `on`, and its surge."""
    turning = (TIME > 30.0) & (on > TIME)
    speed = np.where(turning, np.where(depth > 1.0, 0.9, 1.1) * power, 0.0)
    run = Propulsion(speed, np.where(turning, power, 0.0), depth, np.zeros(TIME.size), PERIOD)
    return run._replace(surge=model.surge(run))


def test_the_balance_of_thrust_finds_the_speed_of_an_unseen_run():
    true = ThrustBalance(thrust=1.5, fall=0.5, drag=0.3, shallow=0.7, delay=1.0, mix=0.3)
    deep, shallow = np.full(TIME.size, 5.0), np.full(TIME.size, 0.0)
    runs = [driven(true, 100.0, deep, 1.0), driven(true, 70.0, shallow, 1.2)]
    unseen = driven(true, 160.0, np.where(TIME < 90.0, 0.0, 4.0), 0.8)
    found = ThrustBalance.fit(runs)
    errors = found.surge(unseen._replace(surge=np.full(TIME.size, np.nan))) - unseen.surge
    assert np.abs(errors).max() < 0.08
    assert np.abs(ThrustBalance().surge(unseen) - unseen.surge).max() > 0.15
    assert unseen.surge[TIME > 230.0].max() < 0.15  # it coasts


def test_fits_of_few_samples_are_refused():
    few = np.full(9, 1.0)
    with pytest.raises(InputError, match="9 samples under way under water"):
        LiftBalance.fit(few, few, few)
    with pytest.raises(InputError, match="needs 30 samples with a surge"):
        ThrustBalance.fit([Propulsion(few, few, few, np.full(9, np.nan), PERIOD)])
