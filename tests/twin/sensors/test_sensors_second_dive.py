"""What the vehicle learns from a second fix, and the depth that it makes of its pressure."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from twin.sensors import Onboard, Pressure, Surroundings
from twin.water.density import DensityProfile

DT = 0.5
DIVE = 3600
"""samples of a dive: half an hour"""
RATE, PITCH = 0.15, -25.0


def track_of(currents, **settings):
    """The on-board track over one steady dive per current (north, east) [m/s]; fixes between.

    The vehicle glides to the east and its algorithm has the right speed, so that a dive's
    depth-averaged current is exactly its current.
    """
    n = DIVE * len(currents) + 1
    speed = RATE / math.tan(math.radians(25.0 + 3.0))
    velocity = np.repeat(currents, DIVE, axis=0) + np.array([0.0, speed])
    truth = np.concatenate([[[0.0, 0.0]], np.cumsum(velocity * DT, axis=0)])
    signals = {
        "measured_depth": 20.0 + RATE * DT * np.arange(n),
        "measured_pitch": np.full(n, PITCH),
        "measured_heading": np.full(n, 90.0),
        "measured_gps_north": np.full(n, np.nan),
        "measured_gps_east": np.full(n, np.nan),
    }
    for at in range(0, n, DIVE):
        signals["measured_gps_north"][at], signals["measured_gps_east"][at] = truth[at]
    return Onboard(**settings).track(signals, dt=DT), truth


@pytest.mark.parametrize("use_current", [True, False])
def test_every_dive_gives_its_own_depth_averaged_current(use_current):
    """Also the second and third, which already drift with the current of the dive before."""
    currents = [(0.08, -0.05), (0.02, 0.06), (-0.10, 0.0)]
    track, _ = track_of(currents, use_current=use_current)
    for dive, current in enumerate(currents, start=1):
        found = track.current_north[dive * DIVE], track.current_east[dive * DIVE]
        # the held speed of the first seconds is the only difference
        assert found == pytest.approx(current, abs=2e-4)


def test_a_steady_current_stays_known_after_the_first_dive():
    track, truth = track_of([(0.08, -0.05)] * 3)
    later = slice(DIVE + 1, None)
    assert np.abs(track.north - truth[:, 0])[later].max() < 0.5
    assert np.abs(track.east - truth[:, 1])[later].max() < 0.5


def test_a_depth_rate_against_the_pitch_gives_no_speed():
    """Nose down and rising at 0.3 m/s, as in an upwelling: the last speed that made sense is held.

    The window's depth rate passes through 0 on the way, and so does the speed.
    """
    n, turn = 2400, 1200
    step = np.where(np.arange(n) < turn, RATE, -0.3) * DT
    signals = {
        "measured_depth": 400.0 + np.cumsum(step),
        "measured_pitch": np.full(n, PITCH),
        "measured_heading": np.zeros(n),
        "measured_gps_north": np.full(n, np.nan),
        "measured_gps_east": np.full(n, np.nan),
    }
    speed = np.diff(Onboard().track(signals, dt=DT).north) / DT
    glide = RATE / math.tan(math.radians(25.0 + 3.0))
    assert speed[turn - 2] == pytest.approx(glide)
    assert np.ptp(speed[turn + 40 :]) == pytest.approx(0.0, abs=1e-9)
    assert speed[-1] < 0.1 * glide


def normal_gravity(latitude: float) -> float:
    """[m/s2] at sea level: the international gravity formula of 1980 (Moritz 2000)."""
    sine2 = math.sin(math.radians(latitude)) ** 2
    return 9.780327 * (
        1.0 + 0.0053024 * sine2 - 0.0000058 * math.sin(math.radians(2 * latitude)) ** 2
    )


@pytest.mark.parametrize("latitude", [0.0, 36.8, 70.0])
def test_pressure_is_the_weight_of_the_water_above_and_gives_the_depth_back(latitude):
    """Hydrostatics: p = rho g z; gravity grows by 0.01 % over the first 500 m."""
    gauge = dataclasses.replace(Pressure.ideal(), vehicle_density=1025.0)
    depth = np.array([5.0, 100.0, 500.0])
    out = gauge.measure(
        {"true_depth": depth}, dt=DT, drawn={"pressure_offset_dbar": 0.0, "pressure_gain": 0.0},
        rng=np.random.default_rng(0),
        surroundings=Surroundings(density=DensityProfile.constant(1025.0), latitude=latitude),
    )  # fmt: skip
    dbar = 1025.0 * normal_gravity(latitude) * depth / 1e4
    np.testing.assert_allclose(out["measured_pressure"], dbar, rtol=2e-4)
    np.testing.assert_allclose(out["measured_depth"], depth, rtol=2e-4)


def test_an_error_of_the_gauge_becomes_metres_of_its_own_water():
    """1 dbar is 1e4 / (rho g) m: 0.9956 m at 36.8 deg, whichever density the vehicle assumes."""
    drawn = {"pressure_offset_dbar": 1.0, "pressure_gain": 0.0}
    for assumed in (None, 1025.0):
        gauge = Pressure(noise=0.0, vehicle_density=assumed)
        out = gauge.measure(
            {"true_depth": np.array([50.0])}, dt=DT, drawn=drawn, rng=np.random.default_rng(0),
            surroundings=Surroundings(density=DensityProfile.constant(1025.0), latitude=36.8),
        )  # fmt: skip
        metres = 1e4 / (1025.0 * normal_gravity(36.8))
        assert out["measured_depth"][0] - 50.0 == pytest.approx(metres, rel=1e-3)
