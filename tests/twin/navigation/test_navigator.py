"""The navigator: the track of dead reckoning, sample by sample, with fixes and a state."""

import numpy as np
import pytest
from navigation import PERIOD, add_fixes, steady_mission

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
