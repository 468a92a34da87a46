"""Echoes are counted beside those that earlier dives had at the same heights above the floor."""

import math

import numpy as np
import pytest

from glider_twin_ops.health.deployment_dives import LEAST, Echoes

REACH = 40.0
"""[m] in which the altimeter of these dives hears the floor"""


def dive(deepest, floor=120.0, lost=0.0, seed=0, samples=300):
    """Depth and altitude of a dive and its climb [m]; the altimeter looks ahead in dives alone."""
    down = np.linspace(0.0, deepest, samples)
    depth = np.concatenate([down, down[::-1]])
    height = floor - depth
    heard = (height < REACH) & (np.arange(2 * samples) < samples)
    heard &= np.random.default_rng(seed).random(2 * samples) >= lost
    return depth, np.where(heard, height, math.nan)


def parts(*dives):
    echoes = Echoes()
    return [echoes.part(*one) for one in dives]


def test_the_first_dive_has_nothing_beside_it():
    first, second = parts(dive(110.0), dive(110.0))
    assert math.isnan(first)
    assert second == pytest.approx(1.0, abs=0.05)


def test_a_shallower_dive_is_not_taken_for_a_blind_altimeter():
    """Of its deepest fifth it hears less than others do; at the same heights it hears the same."""
    found = parts(dive(115.0), dive(90.0), dive(115.0))
    assert found[1:] == pytest.approx([1.0, 1.0], abs=0.1)
    assert math.isnan(parts(dive(115.0), dive(70.0))[1])  # nothing is to be heard there


def test_nose_up_it_hears_nothing_and_is_not_blind():
    """Some sink on for tens of metres after their turn, and turn at other depths each time."""
    found, echoes = [], Echoes()
    for turn in (105.0, 95.0, 110.0, 92.0):
        depth, altitude = dive(115.0)
        pitch = np.where(depth > turn, 20.0, -26.0)
        found.append(echoes.part(depth, np.where(pitch > 0.0, math.nan, altitude), pitch))
    assert found[1:] == pytest.approx(np.ones(3), abs=0.1)
    depth, altitude = dive(115.0)
    lost = [np.where(depth > 95.0, math.nan, altitude), altitude]
    assert parts((depth, altitude), (depth, lost[0]))[1] < 0.6  # without a pitch it looks blind


def test_a_slope_is_followed_from_dive_to_dive():
    floors = 120.0 - 3.0 * np.arange(8)
    found = parts(*(dive(110.0 - 3.0 * k, floor) for k, floor in enumerate(floors)))
    assert found[1:] == pytest.approx(np.ones(7), abs=0.15)


def test_a_deeper_floor_is_not_taken_for_a_blind_altimeter():
    found = parts(dive(115.0), dive(200.0, floor=230.0), dive(200.0, floor=230.0), dive(115.0))
    assert found[1:3] == pytest.approx([1.0, 1.0], abs=0.15)
    silent = parts(dive(115.0), dive(200.0, floor=800.0), dive(200.0, floor=230.0))
    assert math.isnan(silent[1])  # below where the floor was heard: nobody knows what is due
    assert not silent[2] < 0.85


def test_a_blind_one_teaches_nothing():
    sound, blind = [dive(110.0)] * 3, [dive(110.0, lost=0.8, seed=k) for k in range(30)]
    found = parts(*sound, *blind, dive(110.0))
    assert max(found[3:-1]) < 0.4
    assert found[-1] == pytest.approx(1.0, abs=0.05)


def test_one_that_was_blind_from_the_beginning_tells_nothing():
    few = dive(110.0, lost=1.0)
    assert np.isfinite(few[1]).sum() < LEAST
    assert all(math.isnan(one) for one in parts(few, few, dive(110.0)))
    assert math.isnan(Echoes().part(np.zeros(1), np.zeros(1)))
