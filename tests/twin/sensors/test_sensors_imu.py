"""The IMU's errors: Allan deviation against the data sheets, constants against their draws."""

import dataclasses
import math

import allantools
import numpy as np
import pytest

from twin.errors import InputError
from twin.sensors import IMU_PRESETS, Attitude, Encoders, Imu
from twin.sensors.imu import FORCE_SIGNALS, GAUSS_MARKOV_PEAK_TIME, GYRO_SIGNALS

DT = 0.5
STATIC = 500_000  # samples: 69 h, some 1300 times the peak's averaging time


def zeros(n):
    return {f"true_{name}": np.zeros(n) for name in GYRO_SIGNALS + FORCE_SIGNALS}


def no_constants(imu):
    return dict.fromkeys(imu.draw(np.random.default_rng(0)), 0.0)


def deviation(record, tau):
    (_, value, _, _) = allantools.oadev(record, rate=1 / DT, data_type="freq", taus=[tau])
    return value[0]


@pytest.fixture(scope="module")
def static_record():
    imu = Imu()
    return imu.measure(zeros(STATIC), dt=DT, drawn=no_constants(imu), rng=np.random.default_rng(20))


@pytest.mark.parametrize("axis", range(3))
def test_allan_deviation_at_one_second_is_the_noise_density(static_record, axis):
    sheet = Imu()
    gyro = deviation(static_record[f"measured_{GYRO_SIGNALS[axis]}"], 1.0)
    accel = deviation(static_record[f"measured_{FORCE_SIGNALS[axis]}"], 1.0)
    assert gyro == pytest.approx(math.radians(0.005), rel=0.05)
    assert accel == pytest.approx(25e-6 * 9.80665, rel=0.05)
    assert sheet.gyro_noise_density == pytest.approx(8.73e-5, rel=1e-3)


def test_allan_deviation_peaks_at_the_bias_instability(static_record):
    tau = round(GAUSS_MARKOV_PEAK_TIME * Imu().correlation_time)
    gyro = [deviation(static_record[f"measured_{name}"], tau) for name in GYRO_SIGNALS]
    accel = [deviation(static_record[f"measured_{name}"], tau) for name in FORCE_SIGNALS]
    # White noise and random walk add 3 % there; 1300 intervals and three axes leave 3 %.
    assert np.mean(gyro) == pytest.approx(math.radians(8.0) / 3600.0, rel=0.1)
    assert np.mean(accel) == pytest.approx(0.04e-3 * 9.80665, rel=0.1)


@pytest.mark.parametrize("name", [name for name in IMU_PRESETS if name != "ideal"])
def test_each_preset_reproduces_its_noise_density(name):
    imu = Imu.preset(name)
    record = imu.measure(
        zeros(60_000), dt=DT, drawn=no_constants(imu), rng=np.random.default_rng(3)
    )
    gyro = [deviation(record[f"measured_{axis}"], 1.0) for axis in GYRO_SIGNALS]
    accel = [deviation(record[f"measured_{axis}"], 1.0) for axis in FORCE_SIGNALS]
    assert np.mean(gyro) == pytest.approx(imu.gyro_noise_density, rel=0.05)
    assert np.mean(accel) == pytest.approx(imu.accel_noise_density, rel=0.05)


def test_rate_random_walk_reads_k_at_three_seconds():
    walk = 1e-3
    imu = dataclasses.replace(Imu.ideal(), gyro_rate_random_walk=walk, correlation_time=10.0)
    record = imu.measure(
        zeros(200_000), dt=DT, drawn=no_constants(imu), rng=np.random.default_rng(4)
    )
    got = np.mean([deviation(record[f"measured_{name}"], 30.0) for name in GYRO_SIGNALS])
    assert got == pytest.approx(walk * math.sqrt(30.0 / 3.0), rel=0.05)


def test_constants_act_as_bias_scale_and_turned_axes():
    imu = Imu.ideal()
    drawn = no_constants(imu) | {
        "gyro_bias_x": 0.01,
        "accel_scale_y": 0.002,
        "accel_misalignment_z": 0.001,
    }
    truth = zeros(4) | {
        "true_specific_force_x": np.full(4, 1.0),
        "true_specific_force_y": np.full(4, 3.0),
        "true_specific_force_z": np.full(4, -9.8),
    }
    out = imu.measure(truth, dt=DT, drawn=drawn, rng=np.random.default_rng(0))
    assert out["measured_roll_rate"] == pytest.approx(0.01)
    # A triad turned by +0.001 rad about z sees x grow by the y component.
    assert out["measured_specific_force_x"] == pytest.approx(1.0 + 0.003)
    assert out["measured_specific_force_y"] == pytest.approx(3.0 * 1.002 - 0.001)
    assert out["measured_specific_force_z"] == pytest.approx(-9.8)


def test_draws_have_the_declared_spread():
    imu = Imu()
    drawn = [imu.draw(np.random.default_rng(seed)) for seed in range(2000)]
    for name, std in (
        ("gyro_bias_y", imu.gyro_turn_on_bias),
        ("accel_scale_x", imu.accel_scale),
        ("gyro_misalignment_z", math.radians(imu.misalignment_deg)),
    ):
        values = [d[name] for d in drawn]
        assert np.std(values) == pytest.approx(std, rel=0.06)
        assert abs(np.mean(values)) < 4 * std / math.sqrt(2000)


def test_the_filters_own_error_is_correlated():
    n = 400_000
    truth = {"true_roll": np.zeros(n), "true_pitch": np.full(n, -30.0)}
    attitude = Attitude(rms_deg=0.25, time_constant=0.0)
    out = attitude.measure(truth, dt=DT, drawn={}, rng=np.random.default_rng(5))
    error = out["measured_pitch"] + 30.0
    assert error.std() == pytest.approx(0.25, rel=0.05)
    assert out["measured_roll"].std() == pytest.approx(0.25, rel=0.05)
    lag = round(120.0 / DT)
    assert np.corrcoef(error[:-lag], error[lag:])[0, 1] == pytest.approx(math.exp(-1), abs=0.06)
    assert abs(np.corrcoef(error, out["measured_roll"])[0, 1]) < 0.1


def test_encoders_round_to_their_resolution():
    truth = {f"true_{name}": np.linspace(-0.04, 0.05, 997) for name in ("shift",)}
    truth |= {"true_rotation": np.linspace(-90, 90, 997), "true_pump": np.linspace(-300, 300, 997)}
    truth |= {name.replace("true", "commanded"): values for name, values in truth.items()}
    encoders = Encoders(shift_resolution=1e-4, rotation_resolution_deg=0.5, pump_resolution=0.0)
    out = encoders.measure(truth, dt=DT, drawn={}, rng=np.random.default_rng(0))
    steps = out["measured_shift"] / 1e-4
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert np.abs(out["measured_rotation"] - truth["true_rotation"]).max() <= 0.25 + 1e-12
    assert np.array_equal(out["measured_pump"], truth["true_pump"])


def test_wrong_settings_and_names_are_explained():
    with pytest.raises(InputError, match=r"Imu\.gyro_scale is -1: it must be finite"):
        Imu(gyro_scale=-1.0)
    with pytest.raises(InputError, match="did you mean 'MTi-630'"):
        Imu.preset("MTi-360")
    with pytest.raises(InputError, match=r"Attitude\.correlation_time is 0"):
        Attitude(correlation_time=0.0)
    with pytest.raises(InputError, match="unknown drawn sensor value"):
        Imu().measure(zeros(3), dt=DT, drawn={}, rng=np.random.default_rng(0))
