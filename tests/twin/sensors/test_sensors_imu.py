"""Figures of the data sheets, and the IMU's Allan deviation and constants against them."""

import dataclasses
import math

import allantools
import numpy as np
import pytest

from twin.errors import InputError
from twin.sensors import IMU_PRESETS, Attitude, Compass, Dvl, Encoders, Imu, Pressure, SensorSuite
from twin.sensors.imu import (
    DRIFT_HORIZON,
    FORCE_SIGNALS,
    GAUSS_MARKOV_PEAK,
    GAUSS_MARKOV_PEAK_TIME,
    GYRO_SIGNALS,
)

DT = 0.5
DEG = math.pi / 180.0
G = 9.80665
STATIC = 500_000  # samples: 69 h, some 1300 times the peak's averaging time


def zeros(n):
    return {f"true_{name}": np.zeros(n) for name in GYRO_SIGNALS + FORCE_SIGNALS}


def measure(imu, truth, seed, **constants):
    drawn = dict.fromkeys(Imu.draws, 0.0) | constants
    return imu.measure(truth, dt=DT, drawn=drawn, rng=np.random.default_rng(seed))


def deviations(record, names, tau):
    """Allan deviation at an averaging time [s] of each of these readings."""
    return [
        allantools.oadev(record[f"measured_{n}"], rate=1 / DT, data_type="freq", taus=[tau])[1][0]
        for n in names
    ]


@pytest.fixture(scope="module")
def static_record():
    return measure(Imu(), zeros(STATIC), 20)


def test_the_default_imu_is_the_3dm_gx5_25_of_its_data_sheet():
    """LORD data sheet 8400-0093."""
    imu = Imu()
    assert imu.gyro_turn_on_bias == pytest.approx(0.04 * DEG)  # +-0.04 deg/s
    assert imu.gyro_noise_density == pytest.approx(0.005 * DEG)  # 0.005 deg/s/sqrt(Hz)
    assert imu.gyro_bias_instability == pytest.approx(8.0 * DEG / 3600.0)  # 8 deg/h
    assert imu.gyro_scale == 0.0005  # 0.05 %
    assert imu.accel_turn_on_bias == pytest.approx(0.002 * G)  # 0.002 g
    assert imu.accel_noise_density == pytest.approx(25e-6 * G)  # 25 ug/sqrt(Hz)
    assert imu.accel_bias_instability == pytest.approx(0.04e-3 * G)  # 0.04 mg
    assert imu.accel_scale == 0.0003  # 0.03 %
    assert imu.misalignment_deg == 0.05
    assert imu.correlation_time == 100.0
    # with the IMU's own errors 0.25 deg in all: tests of attitude as one instrument
    assert (Attitude().rms_deg, Attitude().time_constant) == (0.08, 5.0)
    assert Attitude().correlation_time == 120.0
    assert IMU_PRESETS["3DM-GX5-25"] == imu


def test_other_devices_have_the_noise_of_their_sheets():
    noise = {
        "3DM-GX5-25-80ug": (0.005, 80e-6),
        "AHRS-M2": (0.04, 250e-6),
        "MTi-630": (0.007, 60e-6),
        "MV5-AR": (0.0075, 85e-6),
    }
    for name, (gyro, accel) in noise.items():
        assert Imu.preset(name).gyro_noise_density == pytest.approx(gyro * DEG), name
        assert Imu.preset(name).accel_noise_density == pytest.approx(accel * G), name


def test_the_default_dvl_and_pressure_gauge_are_those_of_their_sheets():
    dvl = Dvl()
    # LinkQuest 600 kHz micro: 0.3 to 110 m, 1 % +- 1 mm/s, 5 Hz.
    assert (dvl.min_range, dvl.max_range, dvl.ping_rate) == (0.3, 110.0, 5.0)
    assert (dvl.scale, dvl.bottom_noise) == (0.005, 0.001)
    assert (dvl.tilt_deg, dvl.max_beam_angle_deg) == (30.0, 60.0)
    assert (dvl.cell_min, dvl.cell_max, dvl.water_noise) == (20.0, 60.0, 0.0035)
    gauge = Pressure()
    # 0.1 % of 1000 dbar, half of it each in zero and slope.
    assert (gauge.full_scale, gauge.offset, gauge.gain) == (1000.0, 0.0005, 0.0005)
    assert (gauge.noise, gauge.vehicle_density) == (0.01, "standard ocean")
    compass = Compass()
    assert (compass.offset_deg, compass.hard_iron_deg, compass.soft_iron_deg) == (0.3, 0.7, 0.3)
    assert (compass.battery_deg, compass.noise_deg) == (0.5, 0.2)


def test_a_mission_draws_these_spreads():
    suite = SensorSuite()
    drawn = [suite.draw(np.random.SeedSequence([7, k])) for k in range(1500)]
    expected = {
        "gyro_bias_x": 0.04 * DEG, "accel_bias_z": 0.002 * G, "gyro_scale_y": 0.0005,
        "accel_misalignment_x": 0.05 * DEG, "compass_a0_deg": 0.3, "compass_b_deg": 0.7,
        "compass_e_deg": 0.3, "compass_battery_y_deg": 0.5, "pressure_offset_dbar": 0.5,
        "pressure_gain": 0.0005, "dvl_scale": 0.005, "dvl_misalignment_z": 0.5 * DEG,
        "ctd_temperature_offset": 0.001, "ctd_conductivity_offset": 0.00015,
    }  # fmt: skip
    for name, deviation in expected.items():
        values = [one[name] for one in drawn]
        assert np.std(values) == pytest.approx(deviation, rel=0.08), name
        assert abs(np.mean(values)) < 4 * deviation / math.sqrt(len(drawn)), name


def test_the_peak_of_a_gauss_markov_process_is_where_its_allan_variance_says():
    """sigma^2(tau) = 2 s^2 T / tau [1 - T / (2 tau) (3 - 4 exp(-tau/T) + exp(-2 tau/T))].

    IEEE 952, annex C, for a process of standard deviation s and correlation time T.
    """
    tau = np.linspace(0.5, 5.0, 4501)
    curve = np.sqrt(2.0 / tau * (1 - (3 - 4 * np.exp(-tau) + np.exp(-2 * tau)) / (2 * tau)))
    assert pytest.approx(curve.max(), rel=2e-3) == GAUSS_MARKOV_PEAK
    assert pytest.approx(tau[curve.argmax()], rel=5e-3) == GAUSS_MARKOV_PEAK_TIME


def test_the_default_random_walk_equals_the_bias_instability_at_an_hour():
    """A random walk K has the Allan deviation K sqrt(tau / 3)."""
    assert DRIFT_HORIZON == 3600.0
    for name, imu in IMU_PRESETS.items():
        walks = np.array([imu.gyro_rate_random_walk, imu.accel_rate_random_walk])
        floors = [imu.gyro_bias_instability, imu.accel_bias_instability]
        assert walks * math.sqrt(3600.0 / 3.0) == pytest.approx(floors), name


def test_allan_deviation_at_one_second_is_the_noise_density_on_every_axis(static_record):
    gyro, accel = (deviations(static_record, n, 1.0) for n in (GYRO_SIGNALS, FORCE_SIGNALS))
    assert gyro == pytest.approx([math.radians(0.005)] * 3, rel=0.05)
    assert accel == pytest.approx([25e-6 * G] * 3, rel=0.05)


def test_allan_deviation_peaks_at_the_bias_instability(static_record):
    tau = round(GAUSS_MARKOV_PEAK_TIME * Imu().correlation_time)
    gyro, accel = (deviations(static_record, n, tau) for n in (GYRO_SIGNALS, FORCE_SIGNALS))
    # White noise and random walk add 3 % there; 1300 intervals and three axes leave 3 %.
    assert np.mean(gyro) == pytest.approx(math.radians(8.0) / 3600.0, rel=0.1)
    assert np.mean(accel) == pytest.approx(0.04e-3 * G, rel=0.1)


@pytest.mark.parametrize("name", [name for name in IMU_PRESETS if name != "ideal"])
def test_each_preset_reproduces_its_noise_density(name):
    imu = Imu.preset(name)
    record = measure(imu, zeros(60_000), 3)
    gyro, accel = (np.mean(deviations(record, n, 1.0)) for n in (GYRO_SIGNALS, FORCE_SIGNALS))
    assert gyro == pytest.approx(imu.gyro_noise_density, rel=0.05)
    assert accel == pytest.approx(imu.accel_noise_density, rel=0.05)


@pytest.mark.parametrize(
    ("triad", "correlation_time", "taus", "within"),
    [
        ("gyro", 10.0, (30.0,), 0.05),
        # at 100 s the slow processes are drawn every 5 s, which the walk must not feel; 500
        # intervals of 300 s on three axes leave 4 %
        ("gyro", Imu().correlation_time, (60.0, 300.0), 0.1),
        ("accel", Imu().correlation_time, (60.0, 300.0), 0.1),
    ],
)
def test_the_random_walk_reads_k_root_tau_over_three(triad, correlation_time, taus, within):
    walk = {f"{triad}_rate_random_walk": 1e-3}
    imu = dataclasses.replace(Imu.ideal(), correlation_time=correlation_time, **walk)
    record = measure(imu, zeros(300_000), 11)
    for tau in taus:
        found = deviations(record, GYRO_SIGNALS if triad == "gyro" else FORCE_SIGNALS, tau)
        assert np.mean(found) == pytest.approx(1e-3 * math.sqrt(tau / 3.0), rel=within)


def test_constants_act_as_bias_scale_and_turned_axes():
    force = {
        f"true_{n}": np.full(4, v) for n, v in zip(FORCE_SIGNALS, (1.0, 3.0, -9.8), strict=True)
    }
    constants = {"gyro_bias_x": 0.01, "accel_scale_y": 0.002, "accel_misalignment_z": 0.001}
    out = measure(Imu.ideal(), zeros(4) | force, 0, **constants)
    assert out["measured_roll_rate"] == pytest.approx(0.01)
    # A triad turned by +0.001 rad about z sees x grow by the y component.
    assert out["measured_specific_force_x"] == pytest.approx(1.0 + 0.003)
    assert out["measured_specific_force_y"] == pytest.approx(3.0 * 1.002 - 0.001)
    assert out["measured_specific_force_z"] == pytest.approx(-9.8)


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


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Imu(gyro_scale=-1.0), r"Imu\.gyro_scale is -1: it must be finite"),
        (lambda: Imu.preset("MTi-360"), "did you mean 'MTi-630'"),
        (lambda: Attitude(correlation_time=0.0), r"Attitude\.correlation_time is 0"),
        (lambda: Imu().measure(zeros(3), dt=DT, drawn={}, rng=np.random.default_rng(0)),
         "unknown drawn sensor value"),
    ],
)  # fmt: skip
def test_wrong_settings_and_names_are_explained(make, message):
    with pytest.raises(InputError, match=message):
        make()
