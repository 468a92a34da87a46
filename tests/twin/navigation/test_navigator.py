"""The navigator: the track of dead reckoning, sample by sample, with fixes and a state."""

from __future__ import annotations

import numpy as np
import pytest
from navigation import PERIOD, steady_mission

from twin.errors import InputError
from twin.navigation.current import CurrentParameters
from twin.navigation.dead_reckoning import (
    AttitudeSeries,
    horizontal_error,
    rotate_to_ned,
    water_track,
)
from twin.navigation.estimators.base import BodyVelocity, VelocityDeviation, VelocityEstimator
from twin.navigation.navigator import Navigator


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


def walk(navigator, signals, first=0, last=None):
    last = len(signals["measured_depth"]) if last is None else last
    found = []
    for k in range(first, last):
        state = navigator.step({name: float(values[k]) for name, values in signals.items()})
        found.append((state.north, state.east))
    return np.array(found)


def test_without_a_current_it_is_the_track_of_dead_reckoning():
    signals = steady_mission(1500, velocity=(0.4, 0.02, 0.03), turn_rate=0.01)
    measured = {n: v for n, v in signals.items() if n.startswith("measured_") and "gps" not in n}
    found = walk(Navigator(Given(0.4, 0.02), latitude=30.0), measured)
    track = water_track(
        np.full(1500, 0.4), np.full(1500, 0.02), signals["measured_depth"],
        AttitudeSeries.of(signals), PERIOD,
    )  # fmt: skip
    # the depth rate of the whole track looks a sample ahead: the first one has none here
    assert horizontal_error(found, track).max() < 0.05
    way = np.hypot(*np.diff(track, axis=0).T).sum()
    assert way > 200.0


def test_fixes_teach_it_the_current():
    signals = steady_mission(4000, velocity=(0.4, 0.0, 0.02), current=(0.1, -0.2))
    for name in ("north", "east"):
        fixes = np.full(4000, np.nan)
        fixes[[0, 1999, 3999]] = signals[f"true_{name}"][[0, 1999, 3999]]
        signals[f"measured_gps_{name}"] = fixes
    measured = {n: v for n, v in signals.items() if n.startswith("measured_")}
    navigator = Navigator(Given(0.4, 0.0), latitude=30.0)
    found = walk(navigator, measured)
    truth = np.stack([signals["true_north"], signals["true_east"]], axis=1)
    off = horizontal_error(found, truth)
    assert off[1998] == pytest.approx(np.hypot(0.1, 0.2) * 999.0, rel=0.01)
    assert off[1999] < 6.0
    assert off[3998] < 0.3 * off[1998]
    assert off[3999] < 6.0
    current, _ = navigator.filter.current
    assert current == pytest.approx((0.1, -0.2), abs=0.05)


@pytest.mark.parametrize(("start", "learned"), [((0.0, 0.0), True), (None, False)])
def test_from_a_known_start_the_first_fix_teaches_the_current(start, learned):
    signals = steady_mission(2000, velocity=(0.4, 0.0, 0.02), current=(0.1, -0.05))
    begin = {name: signals[f"true_{name}"][0] for name in ("north", "east")}
    for name in ("north", "east"):
        fixes = np.full(2000, np.nan)
        fixes[1800] = signals[f"true_{name}"][1800] - begin[name]
        signals[f"measured_gps_{name}"] = fixes
    measured = {n: v for n, v in signals.items() if n.startswith("measured_")}
    navigator = Navigator(Given(0.4, 0.0), latitude=30.0, start=start)
    walk(navigator, measured)
    current, _ = navigator.filter.current
    assert np.allclose(current, (0.1, -0.05), atol=0.03) == learned
    if not learned:
        assert np.array_equal(current, (0.0, 0.0))


def afloat_then_under(current):
    """Afloat for 200 s with a first fix after 110, a dive, and a fix at its end; all noisy."""
    signals = steady_mission(4000, velocity=(0.4, 0.0, 0.02), current=current)
    start = 400
    depth = signals["measured_depth"]
    signals["measured_depth"] = np.maximum(depth - depth[start], 0.3)
    rng = np.random.default_rng(2)
    for name in ("north", "east"):
        truth = signals[f"true_{name}"] - signals[f"true_{name}"][0]
        fixes = np.full(4000, np.nan)
        for k in (220, 260, 300, 340, 380, 3999):
            fixes[k] = truth[k] + 12.0 * rng.standard_normal()
        signals[f"measured_gps_{name}"] = fixes
    return {n: v for n, v in signals.items() if n.startswith("measured_")}


def test_fixes_without_a_dive_between_say_where_it_is_and_nothing_of_the_current():
    measured = afloat_then_under((0.0, 0.0))
    navigator = Navigator(Given(0.0, 0.0), latitude=30.0, start=(0.0, 0.0))
    found = walk(navigator, measured, last=420)
    current, covariance = navigator.filter.current
    assert np.array_equal(current, (0.0, 0.0))  # the noise of the first fix was 0.1 m/s
    assert covariance[0, 0] > 0.14**2
    fix = [measured[f"measured_gps_{n}"][380] for n in ("north", "east")]
    assert found[380] == pytest.approx(fix)
    assert navigator.legs == navigator.innovations == []


def test_a_dive_is_a_leg_with_what_its_fix_said():
    measured = afloat_then_under((0.1, -0.05))
    navigator = Navigator(Given(0.4, 0.0), latitude=30.0, start=(0.0, 0.0))
    walk(navigator, measured, last=2000)
    other = Navigator(Given(0.4, 0.0), latitude=30.0, start=(0.0, 0.0))
    other.restore(navigator.state())
    for one in (navigator, other):
        walk(one, measured, first=2000)
    (leg,), (said,) = navigator.legs, navigator.innovations
    assert (leg.start, leg.duration) == (380 * PERIOD, (3999 - 380) * PERIOD)
    assert leg.current == pytest.approx((0.1, -0.05), abs=0.02)
    assert said.residual == pytest.approx(leg.duration * leg.current, abs=1e-6)
    assert other.legs == [leg]
    np.testing.assert_array_equal(other.innovations[0].residual, said.residual)


def test_the_filter_begins_with_what_estimator_and_compass_state():
    class Sure(Given):
        deviation = VelocityDeviation(scale=0.004, noise=0.003, memory=90.0)

    filter_ = Navigator(Sure(0.4, 0.0), latitude=30.0, compass=0.7).filter
    assert (filter_.parameters.speed_scale, filter_.parameters.compass) == (0.004, 0.7)
    assert filter_.memory == 90.0
    measured = afloat_then_under((0.0, 0.0))
    spreads = []
    for estimator, compass in ((Sure(0.4, 0.0), 0.7), (Given(0.4, 0.0), None)):
        navigator = Navigator(estimator, latitude=30.0, compass=compass)
        for k in range(3900):
            state = navigator.step({name: float(values[k]) for name, values in measured.items()})
        spreads.append(np.trace(state.covariance))
    assert spreads[0] < 0.99 * spreads[1]
    with pytest.raises(InputError, match="give it as their `compass`"):
        Navigator(Given(0.4, 0.0), latitude=30.0, current=CurrentParameters(), compass=0.7)
    with pytest.raises(InputError, match="noise is -1"):
        VelocityDeviation(noise=-1.0)


def test_it_goes_on_from_a_saved_state_and_begins_again():
    signals = steady_mission(900, velocity=(0.4, 0.0, 0.02), turn_rate=0.02)
    signals["measured_gps_north"][:] = np.nan
    signals["measured_gps_east"][:] = np.nan
    signals["measured_gps_north"][300], signals["measured_gps_east"][300] = 10.0, 20.0
    measured = {n: v for n, v in signals.items() if n.startswith("measured_")}
    navigator = Navigator(Given(0.4, 0.01), latitude=30.0)
    whole = walk(navigator, measured)
    navigator.reset()
    walk(navigator, measured, last=500)
    other = Navigator(Given(0.4, 0.01), latitude=30.0)
    other.restore(navigator.state())
    assert np.array_equal(walk(other, measured, first=500), whole[500:])
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
    measured = {n: v for n, v in signals.items() if n.startswith("measured_") and "gps" not in n}
    truth = np.stack([signals["true_north"], signals["true_east"]], axis=1)
    navigator = Navigator(Given(0.4, 0.0), latitude=30.0)
    found = walk(navigator, measured)
    off = horizontal_error(found, truth)
    assert off[599] == pytest.approx(np.hypot(0.1, 0.2) * 299.5, rel=0.02)
    assert off[1799] - off[720] < 3.0  # 67 m without the log
    assert off[2999] - off[1799] < 0.1 * np.hypot(0.1, 0.2) * 600.0  # the current holds
    blind = {n: v for n, v in measured.items() if "dvl" not in n}
    assert (
        horizontal_error(walk(Navigator(Given(0.4, 0.0), latitude=30.0), blind), truth)[-1] > 300.0
    )
    half = Navigator(Given(0.4, 0.0), latitude=30.0)
    walk(half, measured, last=1000)
    other = Navigator(Given(0.4, 0.0), latitude=30.0)
    other.restore(half.state())
    assert np.array_equal(walk(other, measured, first=1000), found[1000:])


def test_a_slow_estimator_holds_in_between():
    signals = steady_mission(200)
    measured = {n: v for n, v in signals.items() if n.startswith("measured_")}
    slow = Given(0.4, 0.0, period=2.0)
    walk(Navigator(slow, latitude=30.0, period=PERIOD), measured)
    assert slow.count == 50
    with pytest.raises(InputError, match=r"a sample every 2 s, and there is one every 0.8 s"):
        Navigator(slow, latitude=30.0, period=0.8)


def test_a_sample_without_attitude_is_refused():
    with pytest.raises(InputError, match="no finite measured_heading"):
        Navigator(Given(0.4, 0.0), latitude=30.0).step(
            {"measured_depth": 1.0, "measured_roll": 0.0, "measured_pitch": 0.0}
        )
