"""The compass' deviation, learned from what gyros and compass say of the same turns."""

import dataclasses

import numpy as np
import pytest
from navigation import PERIOD

from twin.navigation.compass_deviation import DEG, CompassDeviation, sensitivities
from twin.navigation.dead_reckoning import AttitudeSeries, integrate, rotate_to_ned
from twin.navigation.estimators.base import BodyVelocity, VelocityEstimator
from twin.navigation.navigator import Navigator
from twin.sensors.ahrs import Compass
from twin.vehicle.vehicle import load_vehicle

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
