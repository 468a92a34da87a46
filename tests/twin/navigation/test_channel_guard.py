"""Channel guard: impossible values are replaced; a depth goes on with its rate."""

import math

import numpy as np
import pytest

from twin.errors import InputError
from twin.navigation.channel_guard import LOST_S, MOST_CARRIED_S, STEPPED, ChannelGuard

PERIOD, SINKING = 0.5, 0.2


def sunk(guard, count, first=0):
    for k in range(first, first + count):
        kept = guard.step({"measured_depth": 10.0 + SINKING * PERIOD * k, "measured_pitch": -20.0})
    return kept


@pytest.mark.parametrize("wrong", [math.nan, -40.0, 1e5])
def test_a_depth_that_jumps_is_carried_on_by_its_rate(wrong):
    guard = ChannelGuard(("measured_depth", "measured_pitch"), PERIOD)
    sunk(guard, 400)
    for k in range(400, 440):
        kept = guard.step({"measured_depth": wrong, "measured_pitch": math.nan})
        assert kept["measured_depth"] == pytest.approx(10.0 + SINKING * PERIOD * k, abs=1e-6)
        assert kept["measured_pitch"] == -20.0
        assert guard.held == ("measured_depth", "measured_pitch")
    back = sunk(guard, 1, 440)["measured_depth"]
    assert back == pytest.approx(10.0 + SINKING * PERIOD * 440)


def test_a_dead_gauge_does_not_sink_for_ever():
    guard = ChannelGuard(("measured_depth", "measured_pitch"), PERIOD)
    last = sunk(guard, 400)["measured_depth"]
    for _ in range(1000):
        kept = guard.step({"measured_depth": math.nan, "measured_pitch": -20.0})
    assert kept["measured_depth"] == pytest.approx(last + SINKING * MOST_CARRIED_S, abs=1e-6)
    assert guard.lost == pytest.approx(1000 * PERIOD / LOST_S)
    sunk(guard, 1, 1400)
    assert guard.lost > 10.0  # the values that came back are not believed at once
    sunk(guard, 2000, 1401)
    assert guard.lost < 0.01


def test_a_depth_that_steps_for_good_is_believed_and_reported():
    guard = ChannelGuard(("measured_depth", "measured_pitch"), PERIOD)
    sunk(guard, 400)
    assert guard.lost == 0.0
    for _ in range(60):
        kept = guard.step({"measured_depth": 0.9, "measured_pitch": -20.0})
    assert kept["measured_depth"] == 0.9
    assert 1.0 < guard.lost <= STEPPED  # the hold was short


def test_a_saved_guard_goes_on_alike():
    guard, again = (ChannelGuard(("measured_depth", "measured_pitch"), PERIOD) for _ in range(2))
    sunk(guard, 50)
    again.restore(guard.state())
    sample = {"measured_depth": math.nan, "measured_pitch": 3.0}
    assert guard.step(sample) == again.step(sample)
    with pytest.raises(InputError, match="other channels"):
        again.restore({"last": np.zeros(2), "age": np.ones(2)})
