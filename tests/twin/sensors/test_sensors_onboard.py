"""The vehicle's own track by depth rate or Doppler log, and the depth that it makes of pressure."""

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


DIVE = 3600
"""samples of a dive: half an hour"""


def dives(currents, **settings):
    """The track and the truth over a steady dive per current (north, east) [m/s], fixes between.

    The vehicle glides to the east and its algorithm has the right speed, so that a dive's
    depth-averaged current is exactly its current.
    """
    n = DIVE * len(currents) + 1
    speed = 0.15 / math.tan(28.0 * DEG)
    velocity = np.repeat(currents, DIVE, axis=0) + np.array([0.0, speed])
    truth = np.concatenate([[[0.0, 0.0]], np.cumsum(velocity * DT, axis=0)])
    signals = measured(heading=90.0, n=n)
    for at in range(0, n, DIVE):
        signals["measured_gps_north"][at], signals["measured_gps_east"][at] = truth[at]
    return Onboard(**settings).track(signals, dt=DT), truth


@pytest.mark.parametrize("use_current", [True, False])
def test_every_dive_gives_its_own_depth_averaged_current(use_current):
    """Also the second and third, which already drift with the current of the dive before."""
    currents = [(0.08, -0.05), (0.02, 0.06), (-0.10, 0.0)]
    track, _ = dives(currents, use_current=use_current)
    assert track.current_north[DIVE - 1] == 0.0
    for dive, current in enumerate(currents, start=1):
        found = track.current_north[dive * DIVE], track.current_east[dive * DIVE]
        # the held speed of the first seconds is the only difference
        assert found == pytest.approx(current, abs=2e-4)


def test_a_fix_resets_the_track_and_a_steady_current_stays_known_after_the_first_dive():
    track, truth = dives([(0.08, -0.05)] * 3)
    assert (track.north[DIVE], track.east[DIVE]) == tuple(truth[DIVE])
    later = slice(DIVE + 1, None)
    assert np.abs(track.north - truth[:, 0])[later].max() < 0.5
    assert np.abs(track.east - truth[:, 1])[later].max() < 0.5
    # Before the fix the current is missing, and without its use after it too.
    missed = 0.08 * (DIVE - 1) * DT
    assert truth[DIVE - 1, 0] - track.north[DIVE - 1] == pytest.approx(missed, rel=1e-6)
    without, _ = dives([(0.08, -0.05)] * 3, use_current=False)
    assert truth[-2, 0] - without.north[-2] == pytest.approx(missed, rel=1e-3)


def test_a_depth_rate_against_the_pitch_gives_no_speed():
    """Nose down and rising at 0.3 m/s, as in an upwelling: the last speed that made sense is held.

    The window's depth rate passes through 0 on the way, and so does the speed.
    """
    n, turn = 2400, 1200
    signals = measured(heading=0.0, n=n)
    step = np.where(np.arange(n) < turn, 0.15, -0.3) * DT
    signals["measured_depth"] = 400.0 + np.cumsum(step)
    speed = np.diff(Onboard().track(signals, dt=DT).north) / DT
    glide = 0.15 / math.tan(28.0 * DEG)
    assert speed[turn - 2] == pytest.approx(glide)
    assert np.ptp(speed[turn + 40 :]) == pytest.approx(0.0, abs=1e-9)
    assert speed[-1] < 0.1 * glide


def pressure_of(device, depth, *, offset=0.0, gain=0.0, **around):
    return device.measure(
        {"true_depth": depth}, dt=DT, rng=np.random.default_rng(0),
        drawn={"pressure_offset_dbar": offset, "pressure_gain": gain},
        surroundings=Surroundings(**around),
    )  # fmt: skip


def test_pressure_offset_gain_and_noise():
    depth = np.full(100_000, 500.0)
    device = Pressure(vehicle_density=None)
    out = pressure_of(device, depth, offset=0.3, gain=0.0005)
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
    device = dataclasses.replace(Pressure.ideal(), vehicle_density=1025.0)
    depth = np.array([10.0, 100.0, 1000.0])
    dense = DensityProfile.constant(1030.125)  # 0.5 % more
    error = pressure_of(device, depth, density=dense)["measured_depth"] / depth - 1.0
    assert error == pytest.approx(0.005, abs=2e-4)  # plus gravity's 0.01 % at 1000 m
    assert error[2] > error[0]


@pytest.mark.parametrize("latitude", [0.0, 36.8, 70.0])
def test_depth_is_that_of_standard_ocean_at_the_latitude(latitude):
    """McDougall and Barker (2011): a column of 0 degC and 35 g/kg gives its own depth back."""
    import gsw

    depth = np.linspace(0.0, 1000.0, 1001)
    pressure = gsw.p_from_z(-depth, latitude)
    standard = DensityProfile(depth=depth, values=gsw.rho(35.16504, 0.0, pressure))
    device = Pressure(offset=0.0, gain=0.0, noise=0.0)
    out = pressure_of(device, depth, density=standard, latitude=latitude)
    assert out["measured_depth"] == pytest.approx(depth, abs=0.01)
    assert out["measured_pressure"] == pytest.approx(pressure, abs=0.01)
    # light water presses less and looks shallower, by its dynamic height
    warm = DensityProfile.from_temperature_salinity(depth, 20.0, 35.0, latitude=latitude)
    short = depth - pressure_of(device, depth, density=warm, latitude=latitude)["measured_depth"]
    anomaly = 1.0 - warm.values / standard.values
    layers = np.diff(depth) * 0.5 * (anomaly[1:] + anomaly[:-1])
    height = np.concatenate([[0.0], np.cumsum(layers)])
    assert short == pytest.approx(height, rel=0.02, abs=0.01)
    assert short[-1] > 3.0


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
    out = pressure_of(gauge, depth, density=DensityProfile.constant(1025.0), latitude=latitude)
    dbar = 1025.0 * normal_gravity(latitude) * depth / 1e4
    np.testing.assert_allclose(out["measured_pressure"], dbar, rtol=2e-4)
    np.testing.assert_allclose(out["measured_depth"], depth, rtol=2e-4)


def test_an_error_of_the_gauge_becomes_metres_of_its_own_water():
    """1 dbar is 1e4 / (rho g) m: 0.9956 m at 36.8 deg, whichever density the vehicle assumes."""
    for assumed in (None, 1025.0):
        gauge = Pressure(noise=0.0, vehicle_density=assumed)
        out = pressure_of(
            gauge, np.array([50.0]), offset=1.0, density=DensityProfile.constant(1025.0)
        )
        metres = 1e4 / (1025.0 * normal_gravity(36.8))
        assert out["measured_depth"][0] - 50.0 == pytest.approx(metres, rel=1e-3)


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


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Pressure(vehicle_density=1.025), "give 900 to 1100"),
        (lambda: Pressure(vehicle_density="ocean"),
         "give 'standard ocean', a density in kg/m3, or None"),
        (lambda: Onboard(window=0.0), r"Onboard\.window is 0: it must be above 0"),
        (lambda: Onboard().track({"measured_depth": np.zeros(3)}, dt=DT),
         "truth lacks 'measured_pitch'"),
        (lambda: Onboard(speed_by="dvls"), "did you mean 'dvl'"),
    ],
)  # fmt: skip
def test_wrong_settings_are_explained(make, message):
    with pytest.raises(InputError, match=message):
        make()
