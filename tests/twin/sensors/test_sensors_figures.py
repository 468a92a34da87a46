"""Figures of the data sheets, written out, and what a record of each default sensor shows."""

from __future__ import annotations

import dataclasses
import math

import allantools
import numpy as np
import pytest

from twin.sensors import IMU_PRESETS, Attitude, Compass, Dvl, Imu, Pressure, SensorSuite
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
        if name == "ideal":
            continue
        for walk, floor in (
            (imu.gyro_rate_random_walk, imu.gyro_bias_instability),
            (imu.accel_rate_random_walk, imu.accel_bias_instability),
        ):
            assert walk * math.sqrt(3600.0 / 3.0) == pytest.approx(floor), name


@pytest.mark.parametrize("triad", ["gyro", "accel"])
def test_the_random_walk_reads_k_root_tau_over_three_at_the_shipped_correlation_time(triad):
    """At 100 s the slow processes are drawn every 5 s; the walk must not feel that."""
    walk = 1e-3
    field = {f"{triad}_rate_random_walk": walk}
    imu = dataclasses.replace(Imu.ideal(), correlation_time=Imu().correlation_time, **field)
    names = GYRO_SIGNALS if triad == "gyro" else FORCE_SIGNALS
    record = imu.measure(
        {f"true_{name}": np.zeros(300_000) for name in GYRO_SIGNALS + FORCE_SIGNALS},
        dt=DT,
        drawn=dict.fromkeys(imu.draw(np.random.default_rng(0)), 0.0),
        rng=np.random.default_rng(11),
    )
    for tau in (60.0, 300.0):
        found = [
            allantools.oadev(record[f"measured_{n}"], rate=1 / DT, data_type="freq", taus=[tau])[1]
            for n in names
        ]
        # 500 intervals of 300 s on three axes leave 4 % there
        assert np.mean(found) == pytest.approx(walk * math.sqrt(tau / 3.0), rel=0.1)
