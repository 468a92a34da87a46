"""The navigator: dead reckoning sample by sample, with fixes, a state, and what compasses err."""

import dataclasses

import numpy as np
import pytest
from navigation import PERIOD, add_fixes, steady_mission

from twin.errors import InputError
from twin.navigation.compass_deviation import DEG, CompassDeviation, sensitivities
from twin.navigation.current import CurrentParameters
from twin.navigation.dead_reckoning import (
    AttitudeSeries,
    horizontal_error,
    integrate,
    rotate_to_ned,
    water_track,
)
from twin.navigation.estimators.base import BodyVelocity, VelocityDeviation, VelocityEstimator
from twin.navigation.navigator import Navigator
from twin.sensors.ahrs import Compass
from twin.vehicle.vehicle import load_vehicle


class Given(VelocityEstimator):
    """Says what it is told."""

    channels = ("measured_depth",)

    def __init__(self, surge, sway, period=PERIOD):
        self.surge, self.sway, self.period = surge, sway, period
        self.reset()

    def reset(self):
        self.count = 0

    def step(self, sample):
        self.count += 1
        return BodyVelocity(surge=self.surge, sway=self.sway)

    def state(self):
        return {"count": np.array(self.count)}

    def restore(self, state):
        self.count = int(state["count"])


def navigator_of(estimator=None, **given):
    return Navigator(estimator or Given(0.4, 0.0), latitude=30.0, **given)


def measured(samples, gps=True, fixes=None, **motion):
    """Readings of a steady mission and its true track (time, 2), both from the same place on.

    fixes: samples with a fix; None: as the mission has them, without any.
    """
    signals = steady_mission(samples, **{"velocity": (0.4, 0.0, 0.02), **motion})
    truth = np.stack([signals["true_north"], signals["true_east"]], axis=1)
    if fixes is not None:
        add_fixes(signals, fixes)
    lacking = () if gps else ("measured_gps_north", "measured_gps_east")
    return {
        n: v for n, v in signals.items() if n.startswith("measured_") and n not in lacking
    }, truth


def walk(navigator, signals, first=0, last=None):
    rows = np.stack(list(signals.values()), axis=1)[first:last].tolist()
    found = [navigator.step(dict(zip(signals, row, strict=True))) for row in rows]
    return np.array([(state.north, state.east) for state in found])


def test_without_a_current_it_is_the_track_of_dead_reckoning():
    signals, _ = measured(1500, gps=False, velocity=(0.4, 0.02, 0.03), turn_rate=0.01)
    found = walk(navigator_of(Given(0.4, 0.02)), signals)
    track = water_track(
        np.full(1500, 0.4), np.full(1500, 0.02), signals["measured_depth"],
        AttitudeSeries.of(signals), PERIOD,
    )  # fmt: skip
    # the depth rate of the whole track looks a sample ahead: the first one has none here
    assert horizontal_error(found, track).max() < 0.05
    way = np.hypot(*np.diff(track, axis=0).T).sum()
    assert way > 200.0


def test_fixes_teach_it_the_current():
    signals, truth = measured(4000, current=(0.1, -0.2), fixes=[0, 1999, 3999])
    navigator = navigator_of()
    off = horizontal_error(walk(navigator, signals), truth)
    assert off[1998] == pytest.approx(np.hypot(0.1, 0.2) * 999.0, rel=0.01)
    assert off[1999] < 6.0
    assert off[3998] < 0.3 * off[1998]
    assert off[3999] < 6.0
    current, _ = navigator.filter.current
    assert current == pytest.approx((0.1, -0.2), abs=0.05)


@pytest.mark.parametrize(("start", "learned"), [((0.0, 0.0), True), (None, False)])
def test_from_a_known_start_the_first_fix_teaches_the_current(start, learned):
    signals, truth = measured(2000, current=(0.1, -0.05), fixes=[1800])
    for name, begin in zip(("north", "east"), truth[0], strict=True):
        signals[f"measured_gps_{name}"] -= begin
    navigator = navigator_of(start=start)
    walk(navigator, signals)
    current, _ = navigator.filter.current
    assert np.allclose(current, (0.1, -0.05), atol=0.03) == learned
    if not learned:
        assert np.array_equal(current, (0.0, 0.0))


def afloat_then_under(current):
    """Afloat for 200 s with a first fix after 110, a dive, and a fix at its end; all noisy."""
    signals, truth = measured(4000, current=current)
    depth = signals["measured_depth"]
    signals["measured_depth"] = np.maximum(depth - depth[400], 0.3)
    rng, fixes = np.random.default_rng(2), [220, 260, 300, 340, 380, 3999]
    for name, true in zip(("north", "east"), (truth - truth[0]).T, strict=True):
        signals[f"measured_gps_{name}"][fixes] = true[fixes] + 12.0 * rng.standard_normal(6)
    return signals


def test_fixes_without_a_dive_between_say_where_it_is_and_nothing_of_the_current():
    signals = afloat_then_under((0.0, 0.0))
    navigator = navigator_of(Given(0.0, 0.0), start=(0.0, 0.0))
    found = walk(navigator, signals, last=420)
    current, covariance = navigator.filter.current
    assert np.array_equal(current, (0.0, 0.0))  # the noise of the first fix was 0.1 m/s
    assert covariance[0, 0] > 0.14**2
    fix = [signals[f"measured_gps_{n}"][380] for n in ("north", "east")]
    assert found[380] == pytest.approx(fix)
    assert navigator.legs == navigator.innovations == []


def test_a_dive_is_a_leg_with_what_its_fix_said():
    signals = afloat_then_under((0.1, -0.05))
    navigator, other = (navigator_of(start=(0.0, 0.0)) for _ in range(2))
    walk(navigator, signals, last=2000)
    other.restore(navigator.state())
    for one in (navigator, other):
        walk(one, signals, first=2000)
    (leg,), (said,) = navigator.legs, navigator.innovations
    assert (leg.start, leg.duration) == (380 * PERIOD, (3999 - 380) * PERIOD)
    assert leg.current == pytest.approx((0.1, -0.05), abs=0.02)
    assert said.residual == pytest.approx(leg.duration * leg.current, abs=1e-6)
    assert other.legs == [leg]
    np.testing.assert_array_equal(other.innovations[0].residual, said.residual)


def test_the_filter_begins_with_what_estimator_and_compass_state():
    class Sure(Given):
        deviation = VelocityDeviation(scale=0.004, noise=0.003, memory=90.0)

    filter_ = navigator_of(Sure(0.4, 0.0), compass=0.7).filter
    assert (filter_.parameters.speed_scale, filter_.parameters.compass) == (0.004, 0.7)
    assert filter_.memory == 90.0
    signals = afloat_then_under((0.0, 0.0))
    spreads = []
    for estimator, compass in ((Sure(0.4, 0.0), 0.7), (Given(0.4, 0.0), None)):
        navigator = navigator_of(estimator, compass=compass)
        walk(navigator, signals, last=3899)
        state = navigator.step({name: float(values[3899]) for name, values in signals.items()})
        spreads.append(np.trace(state.covariance))
    assert spreads[0] < 0.99 * spreads[1]
    with pytest.raises(InputError, match="give it as their `compass`"):
        navigator_of(current=CurrentParameters(), compass=0.7)
    with pytest.raises(InputError, match="noise is -1"):
        VelocityDeviation(noise=-1.0)


def test_it_goes_on_from_a_saved_state_and_begins_again():
    signals, _ = measured(900, turn_rate=0.02)
    signals["measured_gps_north"][300], signals["measured_gps_east"][300] = 10.0, 20.0
    navigator, other = (navigator_of(Given(0.4, 0.01)) for _ in range(2))
    whole = walk(navigator, signals)
    navigator.reset()
    walk(navigator, signals, last=500)
    other.restore(navigator.state())
    assert np.array_equal(walk(other, signals, first=500), whole[500:])
    assert other.estimator.count == 900


def locked(signals, current, first, last, outliers=()):
    """A Doppler log in bottom lock for some samples: the steady velocity and the current."""
    roll, pitch, heading = (np.deg2rad(signals[f"true_{n}"]) for n in ("roll", "pitch", "heading"))
    velocity = np.stack([signals[f"true_{n}"] for n in ("surge", "sway", "heave")], axis=1)
    attitude = AttitudeSeries(roll=roll, pitch=pitch, heading=heading)
    over = rotate_to_ned(velocity, attitude) + np.array([*current, 0.0])
    axes = rotate_to_ned(np.broadcast_to(np.eye(3), (len(over), 3, 3)).transpose(1, 0, 2), attitude)
    log = np.einsum("ikj,kj->ki", axes, over)
    mode = np.zeros(len(log))
    mode[first:last] = 1.0
    log[mode == 0.0] = np.nan
    log[list(outliers)] += 3.0
    for name, values in zip(("surge", "sway", "heave"), log.T, strict=True):
        signals[f"measured_dvl_{name}"] = values
    signals["measured_dvl_mode"] = mode


def test_bottom_lock_of_a_doppler_log_tells_the_current():
    signals = steady_mission(3000, velocity=(0.4, 0.0, 0.02), turn_rate=0.002, current=(0.1, -0.2))
    locked(signals, (0.1, -0.2), 600, 1800, outliers=(700, 950, 1300))
    truth = np.stack([signals["true_north"], signals["true_east"]], axis=1)
    signals = {n: v for n, v in signals.items() if n.startswith("measured_") and "gps" not in n}
    found = walk(navigator_of(), signals)
    off = horizontal_error(found, truth)
    assert off[599] == pytest.approx(np.hypot(0.1, 0.2) * 299.5, rel=0.02)
    assert off[1799] - off[720] < 3.0  # 67 m without the log
    assert off[2999] - off[1799] < 0.1 * np.hypot(0.1, 0.2) * 600.0  # the current holds
    blind = {n: v for n, v in signals.items() if "dvl" not in n}
    assert horizontal_error(walk(navigator_of(), blind), truth)[-1] > 300.0
    half, other = navigator_of(), navigator_of()
    walk(half, signals, last=1000)
    other.restore(half.state())
    assert np.array_equal(walk(other, signals, first=1000), found[1000:])


def test_a_slow_estimator_holds_in_between():
    slow = Given(0.4, 0.0, period=2.0)
    walk(navigator_of(slow, period=PERIOD), measured(200)[0])
    assert slow.count == 50
    with pytest.raises(InputError, match=r"a sample every 2 s, and there is one every 0.8 s"):
        navigator_of(slow, period=0.8)


def test_a_sample_without_attitude_is_refused():
    with pytest.raises(InputError, match="no finite measured_heading"):
        navigator_of().step({"measured_depth": 1.0, "measured_roll": 0.0, "measured_pitch": 0.0})


# --- the deviation of its compass -----------------------------------------------------------------


IRON = np.array([0.8, -1.1, 0.6, 0.3, -0.2]) * DEG
VEHICLE = load_vehicle("glider")
SURGE = 0.4
"""m/s"""


def box(seconds: float = 1500.0, turn: float = 90.0, sides: int = 4) -> dict[str, np.ndarray]:
    """True attitude [rad], rates [rad/s] round a box in dives and climbs, rolled in its turns."""
    side, corner = round(seconds / PERIOD), round(turn / PERIOD)
    rate = np.concatenate([np.r_[np.full(corner, 0.5 * np.pi / turn), np.zeros(side)]] * sides)
    time = PERIOD * np.arange(len(rate))
    heading = 0.3 + integrate(rate, PERIOD)
    roll = np.convolve(rate, np.full(40, 1.0 / 40.0), "same") * 15.0
    pitch = 0.45 * np.sin(2.0 * np.pi * time / 700.0)
    p = np.gradient(roll, PERIOD) - rate * np.sin(pitch)
    swing = np.gradient(pitch, PERIOD)
    q = swing * np.cos(roll) + rate * np.sin(roll) * np.cos(pitch)
    r = -swing * np.sin(roll) + rate * np.cos(roll) * np.cos(pitch)
    return {"roll": roll, "pitch": pitch, "heading": heading, "rates": np.stack([p, q, r], axis=1)}


def shown(true: dict[str, np.ndarray]) -> np.ndarray:
    """Headings [rad] of a compass with this iron: true less the deviation at the shown one."""
    found = true["heading"].copy()
    for _ in range(3):
        rows = [
            sensitivities(*angles)
            for angles in zip(true["roll"], true["pitch"], found, strict=True)
        ]
        found = true["heading"] - np.array(rows) @ IRON
    return found


def test_the_sensitivities_are_those_of_the_compass_model():
    """The iron as the sensor model has it, to first order, at all attitudes."""
    rng = np.random.default_rng(3)
    small = 1e-3  # [degree], so that products do not count
    count = 200
    attitude = {
        "true_roll": rng.uniform(-30.0, 30.0, count),
        "true_pitch": rng.uniform(-40.0, 40.0, count),
        "true_heading": rng.uniform(0.0, 360.0, count),
    }
    zeros = np.zeros(count)
    signals = {
        **attitude,
        **{f"measured_{n}": attitude[f"true_{n}"] for n in ("roll", "pitch")},
        **{f"{k}_{n}": zeros for k in ("true", "measured") for n in ("pitch_rate", "yaw_rate")},
    }
    drawn = dict.fromkeys(Compass.draws, 0.0)
    b = rng.normal(0.0, small, 3)
    drawn |= {"compass_b_deg": -b[0], "compass_c_deg": -b[1], "compass_vertical_deg": b[2]}
    compass = dataclasses.replace(Compass.ideal(), dip_deg=0.0)
    reading = compass.measure(signals, dt=PERIOD, drawn=drawn, rng=rng)["measured_heading"]
    rows = np.array([sensitivities(*np.deg2rad(x)) for x in zip(*attitude.values(), strict=True)])
    missing = (attitude["true_heading"] - reading + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(rows[:, :3] @ b, missing, atol=1e-3 * small)


def learned(bias=(0.0, 0.0), noise: float = 0.0) -> CompassDeviation:
    true, rng = box(), np.random.default_rng(6)
    found = CompassDeviation(PERIOD)
    heading = shown(true)
    rates = true["rates"][:, 1:] + np.array(bias)
    for k, angle in enumerate(heading + noise * rng.normal(size=len(heading))):
        found.step(true["roll"][k], true["pitch"][k], angle, rates[k])
    return found


@pytest.mark.parametrize("bias", [(0.0, 0.0), (0.05 * DEG, -0.04 * DEG)])
def test_turns_tell_the_iron_whatever_the_gyros_biases_are(bias):
    found = learned(bias, noise=0.2 * DEG)
    off = np.abs(found.iron - IRON)
    assert (off < 1.2 * found.iron_deviation + 0.05 * DEG).all()
    assert np.hypot(*off[:2]) < 0.5 * np.hypot(*IRON[:2])
    assert found.iron_deviation[0] < 0.8 * CompassDeviation(PERIOD).iron_deviation[0]


def test_a_compass_that_is_right_is_left_alone():
    true, found = box(seconds=150.0, turn=40.0, sides=6), CompassDeviation(PERIOD)
    for k, angle in enumerate(true["heading"]):
        found.step(true["roll"][k], true["pitch"][k], angle, true["rates"][k, 1:])
    assert (np.abs(found.iron) < 0.03 * DEG).all()


def test_without_gyros_nothing_is_learned():
    found = CompassDeviation(PERIOD)
    for k in range(200):
        found.step(0.1, 0.4, 0.01 * k, np.full(2, np.nan))
    assert np.array_equal(found.iron, np.zeros(5))


class Steady(VelocityEstimator):
    """Knows the speed."""

    channels = ("measured_depth",)

    def step(self, sample):
        return BodyVelocity(surge=SURGE, sway=0.0, heave=0.0)


def flown(true, *, rates: bool) -> tuple[np.ndarray, Navigator]:
    heading = shown(true)
    navigator = Navigator(Steady(VEHICLE, PERIOD), latitude=30.0, start=(0.0, 0.0))
    for k, angle in enumerate(heading):
        sample = {
            "measured_depth": 50.0,
            "measured_roll": np.rad2deg(true["roll"][k]),
            "measured_pitch": np.rad2deg(true["pitch"][k]),
            "measured_heading": np.rad2deg(angle),
        }
        if rates:
            names = ("roll_rate", "pitch_rate", "yaw_rate")
            sample |= {f"measured_{n}": v for n, v in zip(names, true["rates"][k], strict=True)}
        state = navigator.step(sample)
    return np.array([state.north, state.east]), navigator


def test_the_way_before_a_turn_is_corrected_by_what_the_turn_tells():
    true = box()
    attitude = AttitudeSeries(roll=true["roll"], pitch=true["pitch"], heading=true["heading"])
    velocity = np.tile([SURGE, 0.0, 0.0], (len(true["roll"]), 1))
    end = integrate(rotate_to_ned(velocity, attitude)[:, :2], PERIOD)[-1]
    blind, _ = flown(true, rates=False)
    found, navigator = flown(true, rates=True)
    assert np.hypot(*(blind - end)) > 15.0
    assert np.hypot(*(found - end)) < 0.5 * np.hypot(*(blind - end))
    other = Navigator(Steady(VEHICLE, PERIOD), latitude=30.0, start=(0.0, 0.0))
    other.restore(navigator.state())
    again = dict.fromkeys((*navigator.channels, "measured_pitch_rate", "measured_yaw_rate"), 1.0)
    assert other.step(again).north == navigator.step(again).north
