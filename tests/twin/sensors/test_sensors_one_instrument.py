"""Attitude and heading err as the IMU that they are made of: no second measurement of gravity."""

import math

import numpy as np
import pytest

from twin.sensors import Attitude, Compass, Imu, SensorSuite
from twin.sensors.imu import FORCE_SIGNALS, GYRO_SIGNALS

DT = 0.5
DEG = math.pi / 180.0
G = 9.80665
N = 2400
PITCH = -25.0


def glide(n=N, roll=0.0, pitch=PITCH, heading=60.0):
    """A steady glide: no turning, and the specific force of gravity alone."""
    sin_r, cos_r = math.sin(roll * DEG), math.cos(roll * DEG)
    sin_p, cos_p = math.sin(pitch * DEG), math.cos(pitch * DEG)
    values = {"roll": roll, "pitch": pitch, "heading": heading} | dict.fromkeys(GYRO_SIGNALS, 0.0)
    force = (G * sin_p, -G * sin_r * cos_p, -G * cos_r * cos_p)
    values |= dict(zip(FORCE_SIGNALS, force, strict=True))
    return {f"true_{name}": np.full(n, value) for name, value in values.items()}


def measured(truth, *, drawn, attitude=None, compass=None, imu=None, seed=0):
    """What IMU, attitude and compass make of a truth with these constants."""
    imu, attitude = imu or Imu.ideal(), attitude or Attitude(rms_deg=0.0)
    compass = compass or Compass(noise_deg=0.0)
    zero = dict.fromkeys((*Imu.draws, *Compass.draws), 0.0)
    signals = dict(truth)
    for sensor in (imu, attitude, compass):
        signals |= sensor.measure(
            signals, dt=DT, drawn=zero | drawn, rng=np.random.default_rng(seed)
        )
    return signals


def tilt(signals):
    """Pitch [degree] by the accelerometers alone."""
    x, y, z = (signals[f"measured_{name}"] for name in FORCE_SIGNALS)
    return np.arctan2(x, np.hypot(y, z)) / DEG


def test_an_accelerometer_bias_tilts_attitude_by_the_bias_over_gravity():
    out = measured(glide(pitch=0.0), drawn={"accel_bias_x": 0.02, "accel_bias_y": 0.01})
    assert out["measured_pitch"] == pytest.approx(math.atan(0.02 / G) / DEG, rel=1e-3)
    assert out["measured_roll"] == pytest.approx(-math.atan(0.01 / G) / DEG, rel=1e-3)


@pytest.mark.parametrize("pitch", [-25.0, 0.0, 30.0])
def test_a_gyro_bias_adds_itself_times_the_time_constant(pitch):
    bias = 0.04 * DEG
    truth = glide(pitch=pitch)
    about_y = measured(truth, drawn={"gyro_bias_y": bias})["measured_pitch"] - pitch
    about_z = measured(truth, drawn={"gyro_bias_z": bias})
    assert about_y == pytest.approx(0.04 * 5.0, rel=1e-6)
    # a yaw gyro turns heading by 1 / cos and, nose up, roll by tan of pitch
    turned = about_z["measured_heading"] - truth["true_heading"]
    rolled = 0.04 * 5.0 * math.tan(pitch * DEG)
    assert about_z["measured_roll"] == pytest.approx(rolled, abs=1e-9)
    levelled = math.tan(60.0 * DEG) * math.sin(rolled * DEG) / math.cos(pitch * DEG) / DEG
    assert np.abs(turned - 0.04 * 5.0 / math.cos(pitch * DEG)).max() <= abs(levelled) * 1.5 + 1e-9


@pytest.mark.parametrize("roll", [-40.0, 25.0])
def test_at_a_bank_pitch_turns_by_both_gyros_as_euler_s_equation_says(roll):
    """Pitch' = q cos(roll) - r sin(roll): to starboard a yaw to starboard takes the nose down."""
    truth = glide(roll=roll, pitch=0.0)
    for axis, share in (("y", math.cos(roll * DEG)), ("z", -math.sin(roll * DEG))):
        out = measured(truth, drawn={f"gyro_bias_{axis}": 0.04 * DEG})
        assert out["measured_pitch"] == pytest.approx(0.04 * 5.0 * share, rel=1e-6)


def test_gravity_from_both_gains_nothing_on_the_bias():
    """Two independent measurements would err by 1/sqrt(2) of one, or less; these do not."""
    alone, both, share = [], [], []
    for mission in range(300):
        rng = np.random.default_rng(mission)
        imu = Imu()
        out = measured(glide(600), drawn=imu.draw(rng), imu=imu, attitude=Attitude(), seed=mission)
        accelerometer = tilt(out).mean() - PITCH
        attitude = out["measured_pitch"].mean() - PITCH
        alone.append(accelerometer)
        share.append(attitude)
        both.append(0.5 * (accelerometer + attitude))
    rms = [math.sqrt(np.mean(np.square(errors))) for errors in (alone, share, both)]
    assert rms[2] > rms[0]
    # what attitude adds to the accelerometers' error is the gyro's and its own: no information
    added = np.array(share) - np.array(alone)
    assert abs(np.corrcoef(added, alone)[0, 1]) < 0.12
    slope = np.polyfit(alone, share, 1)[0]
    assert slope == pytest.approx(1.0, abs=0.25)


def test_the_whole_error_is_the_quarter_degree_of_the_data_sheet():
    """3DM-GX5-25 with its Kalman filter; 0.5 deg with its complementary filter of 10 s."""
    for time_constant, sheet, within in ((5.0, 0.25, 0.03), (10.0, 0.5, 0.08)):
        square = []
        for mission in range(200):
            imu = Imu()
            drawn = imu.draw(np.random.default_rng(mission))
            attitude = Attitude(time_constant=time_constant)
            out = measured(glide(400), drawn=drawn, imu=imu, attitude=attitude, seed=mission)
            square += [np.mean((out["measured_pitch"] - PITCH) ** 2)]
            square += [np.mean(out["measured_roll"] ** 2)]
        assert math.sqrt(np.mean(square)) == pytest.approx(sheet, abs=within)


def test_a_roll_error_reaches_the_heading_by_the_tangent_of_the_dip():
    """Northward the vertical field leaks into the lateral axis: d(heading) = tan(dip) roll."""
    out = measured(glide(pitch=0.0, heading=0.0), drawn={"accel_bias_y": 0.02})
    heading = (out["measured_heading"] + 180.0) % 360.0 - 180.0
    expected = out["measured_roll"] * math.tan(60.0 * DEG)
    assert np.abs(heading) == pytest.approx(np.abs(expected), rel=0.01)


def test_the_filter_follows_the_gyros_through_a_shaking_hull():
    """An acceleration that the tilt mistakes for gravity passes at 1/(omega tau) of its size."""
    truth = glide(20_000, pitch=0.0)
    t = np.arange(20_000) * DT
    omega = 2.0 * math.pi / 100.0
    truth["true_specific_force_x"] = 0.1 * np.sin(omega * t)
    out = measured(truth, drawn={})
    apparent = math.atan(0.1 / G) / DEG
    gain = np.abs(out["measured_pitch"][4000:]).max() / apparent
    assert gain == pytest.approx(1.0 / math.hypot(1.0, omega * 5.0), rel=0.02)
    assert np.abs(measured(truth, drawn={}, attitude=Attitude.ideal())["measured_pitch"]).max() == 0


def test_every_attitude_stays_in_its_range():
    for roll, pitch in ((179.9, 10.0), (-179.9, -40.0), (20.0, 89.9), (5.0, -90.0)):
        drawn = {f"{kind}_{axis}": 0.02 for kind in ("accel_bias",) for axis in "xyz"}
        out = measured(glide(50, roll=roll, pitch=pitch), drawn=drawn | {"gyro_bias_x": 0.01})
        assert np.abs(out["measured_roll"]).max() <= 180.0
        assert np.abs(out["measured_pitch"]).max() <= 90.0
        assert np.isfinite(out["measured_heading"]).all()


def test_a_suite_of_an_older_store_measures_as_it_did():
    """Stores from before the filter name neither its time constant nor a misalignment."""
    older = {
        "attitude": {"rms_deg": 0.25, "correlation_time": 120.0},
        "compass": {"noise_deg": 0.2},
        "dvl": {"scale": 0.005},
        "pressure": {"vehicle_density": 1025.0},
    }
    suite = SensorSuite.from_settings(older)
    assert (suite.attitude.time_constant, suite.compass.time_constant) == (0.0, 0.0)
    assert suite.dvl.misalignment_deg == 0.0
    assert suite.pressure.vehicle_density == 1025.0
    ideal = {"attitude": {"rms_deg": 0.0, "correlation_time": 120.0}}
    assert SensorSuite.from_settings(ideal).attitude == Attitude.ideal()
