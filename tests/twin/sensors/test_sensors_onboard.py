"""The vehicle's own track, and the depth it is made from."""

import dataclasses
import math

import numpy as np
import pytest

from twin.errors import InputError
from twin.sensors import Onboard, Pressure, Surroundings
from twin.water.density import DensityProfile, gravity

DT = 0.5
N = 7200
DEG = math.pi / 180


def measured(*, pitch=-25.0, rate=0.15, heading=60.0, start=20.0, n=N):
    t = np.arange(n) * DT
    return {
        "measured_depth": start + rate * t,
        "measured_pitch": np.full(n, pitch),
        "measured_heading": np.full(n, heading),
        "measured_gps_north": np.full(n, np.nan),
        "measured_gps_east": np.full(n, np.nan),
    }


@pytest.mark.parametrize(("pitch", "rate", "start"), [(-25.0, 0.15, 20.0), (25.0, -0.15, 600.0)])
def test_steady_glide_goes_at_depth_rate_over_tangent(pitch, rate, start):
    track = Onboard().track(measured(pitch=pitch, rate=rate, start=start), dt=DT)
    speed = 0.15 / math.tan((25.0 + 3.0) * DEG)
    distance = speed * (N - 1) * DT
    assert track.north[-1] == pytest.approx(distance * math.cos(60 * DEG), rel=1e-9)
    assert track.east[-1] == pytest.approx(distance * math.sin(60 * DEG), rel=1e-9)


def test_right_angle_of_attack_recovers_the_true_track():
    """Sea-Wing's published steady glide: 0.4729 m/s, alpha 1.457 deg, pitch -32.973 deg."""
    path = 32.973 + 1.457
    glide = measured(pitch=-32.973, rate=0.4729 * math.sin(path * DEG), heading=0.0)
    exact = Onboard(angle_of_attack_deg=1.457).track(glide, dt=DT)
    default = Onboard().track(glide, dt=DT)
    true = 0.4729 * math.cos(path * DEG) * (N - 1) * DT
    assert exact.north[-1] == pytest.approx(true, rel=1e-6)
    assert default.north[-1] == pytest.approx(0.944 * true, rel=0.002)  # what 3 deg costs


def test_speed_is_held_through_an_inflection_and_zero_at_the_surface():
    signals = measured()
    down = np.minimum(np.arange(N) * DT, 1800.0) * 0.15
    up = np.maximum(np.arange(N) * DT - 1800.0, 0.0) * 0.15
    signals["measured_depth"] = 0.3 + down - up
    signals["measured_pitch"] = np.where(np.arange(N) * DT < 1800.0, -25.0, 25.0)
    signals["measured_heading"][:] = 0.0
    speed = np.gradient(Onboard().track(signals, dt=DT).north, DT)
    glide = 0.15 / math.tan(28.0 * DEG)
    around = slice(round(1500 / DT), round(2100 / DT))
    assert speed[around].min() > 0.5 * glide
    # Window means of depth rate and pitch turn over together: never faster than 1.3 glides.
    assert speed[around].max() < 1.3 * glide
    assert speed[-3:] == pytest.approx(0.0, abs=1e-12)
    assert speed[2:8] == pytest.approx(0.0, abs=1e-12)


def test_fix_resets_and_gives_the_current_that_the_next_dive_uses():
    signals = measured(heading=90.0)
    speed = 0.15 / math.tan(28.0 * DEG)
    t = np.arange(N) * DT
    current = (0.08, -0.05)
    true = (current[0] * t, (speed + current[1]) * t)
    for at in (0, 3600, 3602):
        signals["measured_gps_north"][at], signals["measured_gps_east"][at] = (
            true[0][at],
            true[1][at],
        )
    track = Onboard().track(signals, dt=DT)
    assert track.north[3600] == true[0][3600]
    assert track.current_north[3599] == 0.0
    assert track.current_north[3600] == pytest.approx(current[0], rel=1e-3)
    assert track.current_east[-1] == pytest.approx(current[1], rel=1e-3)
    # Before the fix the current is missing, after it the track stays on the truth.
    assert true[0][3599] - track.north[3599] == pytest.approx(0.08 * 3599 * DT, rel=1e-6)
    assert track.north[-1] == pytest.approx(true[0][-1], abs=0.5)
    assert track.east[-1] == pytest.approx(true[1][-1], abs=0.5)
    without = Onboard(use_current=False).track(signals, dt=DT)
    assert true[0][-1] - without.north[-1] == pytest.approx(0.08 * (N - 1 - 3602) * DT, rel=1e-3)
    assert without.current_north[-1] == pytest.approx(current[0], rel=1e-3)


def pressure_of(device, depth, drawn, *, density=None, seed=0):
    return device.measure(
        {"true_depth": depth}, dt=DT, drawn=drawn, rng=np.random.default_rng(seed),
        surroundings=Surroundings(density=density),
    )  # fmt: skip


def test_pressure_offset_gain_and_noise():
    depth = np.full(100_000, 500.0)
    device = Pressure(vehicle_density=None)
    drawn = {"pressure_offset_dbar": 0.3, "pressure_gain": 0.0005}
    out = pressure_of(device, depth, drawn)
    true = DensityProfile.constant().pressure(500.0, latitude=36.8)
    assert out["measured_pressure"].mean() == pytest.approx(true * 1.0005 + 0.3, abs=2e-4)
    assert out["measured_pressure"].std() == pytest.approx(0.01, rel=0.02)
    slope = 1e4 / (1025.0 * gravity(36.8, 500.0))
    assert out["measured_depth"].mean() - 500.0 == pytest.approx(
        slope * (true * 0.0005 + 0.3), abs=2e-4
    )
    draws = [device.draw(np.random.default_rng(s)) for s in range(2000)]
    assert np.std([d["pressure_offset_dbar"] for d in draws]) == pytest.approx(0.5, rel=0.06)
    assert np.std([d["pressure_gain"] for d in draws]) == pytest.approx(0.0005, rel=0.06)


def test_constant_density_makes_a_depth_error_that_grows():
    still = {"pressure_offset_dbar": 0.0, "pressure_gain": 0.0}
    device = dataclasses.replace(Pressure.ideal(), vehicle_density=1025.0)
    depth = np.array([10.0, 100.0, 1000.0])
    dense = DensityProfile.constant(1030.125)  # 0.5 % more
    error = pressure_of(device, depth, still, density=dense)["measured_depth"] / depth - 1.0
    assert error == pytest.approx(0.005, abs=2e-4)  # plus gravity's 0.01 % at 1000 m
    assert error[2] > error[0]


@pytest.mark.parametrize("latitude", [0.0, 36.8, 70.0])
def test_depth_is_that_of_standard_ocean_at_the_latitude(latitude):
    """McDougall and Barker (2011): a column of 0 degC and 35 g/kg gives its own depth back."""
    import gsw

    depth = np.linspace(0.0, 1000.0, 1001)
    pressure = gsw.p_from_z(-depth, latitude)
    standard = DensityProfile(depth=depth, values=gsw.rho(35.16504, 0.0, pressure))
    still = {"pressure_offset_dbar": 0.0, "pressure_gain": 0.0}
    device = Pressure(offset=0.0, gain=0.0, noise=0.0)

    def read(profile):
        return device.measure(
            {"true_depth": depth}, dt=DT, drawn=still, rng=np.random.default_rng(0),
            surroundings=Surroundings(density=profile, latitude=latitude),
        )  # fmt: skip

    out = read(standard)
    assert out["measured_depth"] == pytest.approx(depth, abs=0.01)
    assert out["measured_pressure"] == pytest.approx(pressure, abs=0.01)
    # light water presses less and looks shallower, by its dynamic height
    warm = DensityProfile.from_temperature_salinity(depth, 20.0, 35.0, latitude=latitude)
    short = depth - read(warm)["measured_depth"]
    anomaly = 1.0 - warm.values / standard.values
    layers = np.diff(depth) * 0.5 * (anomaly[1:] + anomaly[:-1])
    height = np.concatenate([[0.0], np.cumsum(layers)])
    assert short == pytest.approx(height, rel=0.02, abs=0.01)
    assert short[-1] > 3.0


def test_wrong_settings_are_explained():
    with pytest.raises(InputError, match="give 900 to 1100"):
        Pressure(vehicle_density=1.025)
    with pytest.raises(InputError, match="give 'standard ocean', a density in kg/m3, or None"):
        Pressure(vehicle_density="ocean")
    with pytest.raises(InputError, match=r"Onboard\.window is 0: it must be above 0"):
        Onboard(window=0.0)
    with pytest.raises(InputError, match="truth lacks 'measured_pitch'"):
        Onboard().track({"measured_depth": np.zeros(3)}, dt=DT)


def by_dvl(*, mode, north=0.8, east=-0.3, n=N):
    """A Doppler log that sees a velocity over ground of (north, east) [m/s] at a heading of 60."""
    heading = 60 * DEG
    ahead = math.cos(heading) * north + math.sin(heading) * east
    beside = -math.sin(heading) * north + math.cos(heading) * east
    return measured(pitch=0.0, rate=0.0, n=n) | {
        "measured_roll": np.zeros(n),
        "measured_dvl_surge": np.full(n, ahead),
        "measured_dvl_sway": np.full(n, beside),
        "measured_dvl_heave": np.zeros(n),
        "measured_dvl_mode": np.full(n, float(mode)),
    }


def test_a_doppler_log_gives_the_track_over_ground_and_holds_its_last_velocity():
    signals = by_dvl(mode=1)
    lost = slice(100, 180)
    for name in ("surge", "sway", "heave"):
        signals[f"measured_dvl_{name}"][lost] = np.nan
    signals["measured_dvl_mode"][lost] = 0.0
    track = Onboard(speed_by="dvl").track(signals, dt=DT)
    np.testing.assert_allclose(track.north, 0.8 * DT * np.arange(N), atol=1e-8)
    np.testing.assert_allclose(track.east, -0.3 * DT * np.arange(N), atol=1e-8)
    assert not track.current_north.any(), "over ground there is no current to learn"


def test_in_water_lock_a_fix_gives_the_current_that_the_next_leg_takes_with_it():
    signals = by_dvl(mode=2)
    fix, drift = 2000, 0.1
    signals["measured_gps_north"][fix] = (0.8 + drift) * DT * fix
    signals["measured_gps_east"][fix] = -0.3 * DT * fix
    track = Onboard(speed_by="dvl").track(signals, dt=DT)
    assert track.current_north[fix:] == pytest.approx(drift)
    assert track.current_east[fix:] == pytest.approx(0.0, abs=1e-12)
    after = track.north[fix:] - track.north[fix]
    np.testing.assert_allclose(after, (0.8 + drift) * DT * np.arange(N - fix), atol=1e-6)
    without = Onboard(speed_by="dvl", use_current=False).track(signals, dt=DT)
    assert without.north[-1] - without.north[fix] == pytest.approx(0.8 * DT * (N - 1 - fix))


def test_the_speed_is_by_one_of_two():
    with pytest.raises(InputError, match="did you mean 'dvl'"):
        Onboard(speed_by="dvls")
