"""IMU, attitude and compass: figures of the data sheets, deviation, and one error for all three."""

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
from twin.vehicle.vehicle import load_vehicle

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


# --- the compass ----------------------------------------------------------------------------------


HEADINGS = np.arange(0.0, 360.0, 2.0)


def steady(heading=HEADINGS, **constant):
    """Steady angles, and an AHRS without errors."""
    names = ("roll", "pitch", "shift", "rotation", "pitch_rate", "yaw_rate")
    angles = dict.fromkeys(names, 0.0) | constant
    found = {"true_heading": heading}
    for name, value in angles.items():
        steady = np.broadcast_to(float(value), heading.shape)
        found |= {f"true_{name}": steady, f"measured_{name}": steady}
    return found


def deviation(drawn, compass=None, **constant):
    """measured - true heading [deg] over all headings."""
    compass = compass or Compass.ideal()
    drawn = dict.fromkeys(compass.draw(np.random.default_rng(0)), 0.0) | drawn
    out = compass.measure(steady(**constant), dt=0.5, drawn=drawn, rng=np.random.default_rng(0))[
        "measured_heading"
    ]
    assert out.min() >= 0.0
    assert out.max() < 360.0
    return (out - HEADINGS + 180.0) % 360.0 - 180.0


def test_level_deviation_is_the_five_coefficient_formula():
    a0, b, c, d, e = 0.2, 0.5, -0.3, 0.25, 0.15
    got = deviation(
        {
            "compass_a0_deg": a0, "compass_b_deg": b, "compass_c_deg": c,
            "compass_d_deg": d, "compass_e_deg": e,
        }
    )  # fmt: skip
    psi = HEADINGS * DEG
    classical = a0 + b * np.sin(psi) + c * np.cos(psi) + d * np.sin(2 * psi) + e * np.cos(2 * psi)
    assert got == pytest.approx(classical, abs=0.02)  # second order: (0.6 deg)^2 = 0.006 deg
    assert np.abs(classical).max() > 0.5


def test_one_microtesla_in_25_turns_the_heading_by_2_3_degrees():
    eps = 1.0 / 25.0 / DEG
    assert np.abs(deviation({"compass_b_deg": eps})).max() == pytest.approx(2.3, abs=0.05)


def test_clean_compass_reads_the_true_heading_at_any_tilt():
    for roll, pitch in ((0, 0), (-14, -35), (40, 60), (-30, 85)):
        assert np.abs(deviation({}, roll=roll, pitch=pitch)).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "low", "high"), [("calibrated", 0.8, 1.0), ("uncalibrated", 4.5, 5.6)]
)
def test_preset_rms_over_headings_and_missions(name, low, high):
    compass = Compass.preset(name)
    rng = np.random.default_rng(11)
    square = []
    for seed in range(400):
        drawn = compass.draw(np.random.default_rng(seed))
        out = compass.measure(steady(rotation=30.0), dt=60.0, drawn=drawn, rng=rng)
        error = (out["measured_heading"] - HEADINGS + 180.0) % 360.0 - 180.0
        square.append(np.mean(error**2))
    assert low <= np.sqrt(np.mean(square)) <= high


def test_deviation_moves_with_the_battery_and_not_at_its_neutral_position():
    battery = {"compass_battery_x_deg": 0.5, "compass_battery_y_deg": 0.8}
    assert np.abs(deviation(battery)).max() < 1e-9
    turned = deviation(battery, rotation=90.0)
    # The y component has turned to z: on a level vehicle its deviation is gone, -0.8 cos(psi)
    # became 0, a change of +0.8 cos(psi); x is not changed.
    assert turned == pytest.approx(0.8 * np.cos(HEADINGS * DEG), abs=0.02)
    # Moving away by 0.05 m of 0.3 m leaves (0.3/0.35)^3 = 0.63 of the battery's field.
    away = deviation({"compass_battery_x_deg": 0.5}, shift=0.05)
    expected = (1 - (0.3 / 0.35) ** 3) * 0.5 * np.sin(HEADINGS * DEG)
    assert away == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("rotation", [0.0, 30.0, -30.0, 90.0, -90.0])
def test_the_field_of_the_battery_turns_as_its_mass_does(rotation):
    """A positive rotation carries what was below to port, and what was starboard downwards.

    A field to starboard (y) turns the reading of a vehicle that heads north to the west. It is
    calibrated away at rotation 0, so only its change counts.
    """
    battery, strength = load_vehicle("glider").battery, 5.0
    below = battery.position(0.0, math.radians(rotation))[1:] / battery.eccentricity
    to_port, downwards = -below[0], below[1]
    for axis, change in {"x": 0.0, "y": downwards - 1.0, "z": -to_port}.items():
        expected = -math.degrees(math.atan(math.radians(strength) * change))
        found = deviation({f"compass_battery_{axis}_deg": strength}, rotation=rotation)[0]
        assert found == pytest.approx(expected, abs=1e-9), axis


def test_noise_has_its_rms():
    compass = Compass(offset_deg=0, hard_iron_deg=0, soft_iron_deg=0, battery_deg=0)
    heading = np.full(200_000, 123.0)
    drawn = compass.draw(np.random.default_rng(1))
    out = compass.measure(steady(heading), dt=0.5, drawn=drawn, rng=np.random.default_rng(1))
    assert np.std(out["measured_heading"]) == pytest.approx(0.2, rel=0.03)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Compass.preset("calibrate"), "did you mean 'calibrated'"),
        (lambda: Compass(dip_deg=89.0), "beyond 85 deg"),
        (lambda: Compass(battery_distance=0.1), r"must exceed 0\.2 m"),
    ],
)
def test_wrong_settings_of_the_compass_are_explained(make, message):
    with pytest.raises(InputError, match=message):
        make()


# --- attitude and heading err as the IMU that they are made of ------------------------------------


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
