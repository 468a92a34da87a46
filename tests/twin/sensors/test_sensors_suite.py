"""The suite's contract: names, ideal equality, seeds, independence, replay, errors, live steps."""

import dataclasses
import pickle

import numpy as np
import pytest
from processes import python

import twin
from twin.errors import InputError
from twin.records.schema import VARIABLES, Variable, declare
from twin.sensors import (
    Compass,
    Dvl,
    Encoders,
    Gps,
    Imu,
    Onboard,
    Outset,
    Pressure,
    Sensor,
    SensorSuite,
)
from twin.sensors.base import Surroundings
from twin.sensors.live import LiveSuite
from twin.water.density import DensityProfile

DT = 0.5
PARTS = ("shift", "rotation", "pump")
TRUTH_SIGNALS = (
    *SensorSuite().reads(()),
    *(f"{group}_{part}" for part in PARTS for group in ("true", "commanded")),
)
MEASURED_SIGNALS = tuple(entry.name for entry in SensorSuite().writes(TRUTH_SIGNALS))
N = 3000
SEED = np.random.SeedSequence(7, spawn_key=(3,))


@pytest.fixture(scope="module")
def truth():
    """A dive from the surface with slow wiggles in every signal."""
    t = np.arange(N) * DT
    wiggle = np.random.default_rng(1).uniform(0.5, 1.5, len(TRUTH_SIGNALS))
    values = {
        name: 0.05 * w * np.sin(2e-2 * w * t) for name, w in zip(TRUTH_SIGNALS, wiggle, strict=True)
    }
    values["true_depth"] = 0.1 + np.maximum(t - 60.0, 0.0) * 0.1
    values["true_pitch"] -= 22.0
    values["true_heading"] = np.mod(350.0 + 0.05 * t, 360.0)
    values["true_immersion"] = np.where(t < 60.0, 0.99, 1.0)
    for array in values.values():
        array.flags.writeable = False  # the suite must not change the truth
    return values


def measure(suite, truth, seed=SEED, **extra):
    return suite.measure(truth, dt=DT, rng_seed=seed, bottom_depth=160.0, **extra)


def same(a, b):
    return np.array_equal(a, b, equal_nan=True)


def test_every_measured_signal_comes_in_order_and_shape(truth):
    out = measure(SensorSuite.preset("field"), truth)
    assert tuple(out) == MEASURED_SIGNALS
    assert all(array.shape == (N,) for array in out.values())
    never_nan = [n for n in MEASURED_SIGNALS if "gps" not in n and "dvl" not in n]
    assert all(np.isfinite(out[name]).all() for name in never_nan)


def test_ideal_measures_the_truth_exactly(truth):
    out = measure(SensorSuite.preset("ideal"), truth)
    exact = [name for name in MEASURED_SIGNALS if name.replace("measured", "true", 1) in truth]
    assert len(exact) == 13
    for name in exact:
        assert np.array_equal(out[name], truth[name.replace("measured", "true", 1)]), name
    dry = truth["true_immersion"] < 1.0
    assert np.array_equal(out["measured_gps_north"][dry], truth["true_north"][dry])
    assert np.isnan(out["measured_gps_north"][~dry]).all()
    weight = DensityProfile.constant().pressure(truth["true_depth"], latitude=36.8)
    assert np.array_equal(out["measured_pressure"], weight)


def test_the_same_seed_gives_the_same_bits_and_is_left_alone(truth):
    suite = SensorSuite.preset("field")
    first, second = measure(suite, truth), measure(suite, truth)
    assert all(same(first[name], second[name]) for name in MEASURED_SIGNALS)
    assert SEED.n_children_spawned == 0
    other = measure(suite, truth, np.random.SeedSequence(7, spawn_key=(4,)))
    noisy = [name for name in MEASURED_SIGNALS if not same(first[name], other[name])]
    # Encoders only round and the mode may agree; everything else has noise.
    quiet = {"measured_shift", "measured_rotation", "measured_pump", "measured_dvl_mode"}
    assert set(noisy) | quiet == set(MEASURED_SIGNALS)


def test_recorded_constants_replay_exactly(truth):
    suite = SensorSuite.preset("field")
    drawn = suite.draw(SEED)
    assert list(drawn) == list(suite.drawn_units())
    assert all(isinstance(value, float) for value in drawn.values())
    free, replay = measure(suite, truth), measure(suite, truth, drawn=drawn)
    assert all(same(free[name], replay[name]) for name in MEASURED_SIGNALS)
    changed = measure(suite, truth, drawn=drawn | {"pressure_offset_dbar": 5.0})
    differs = {name for name in MEASURED_SIGNALS if not same(free[name], changed[name])}
    assert "measured_pressure" in differs
    assert not {n for n in differs if not any(k in n for k in ("pressure", "depth", "onboard"))}


@pytest.mark.parametrize(
    ("device", "config", "own"),
    [
        ("imu", Imu.ideal(), ("rate", "force", "dvl_", "roll", "pitch", "heading", "onboard")),
        ("compass", Compass.ideal(), ("heading", "onboard")),
        ("pressure", Pressure.ideal(), ("depth", "pressure", "onboard")),
        ("gps", Gps.ideal(), ("gps", "onboard")),
        ("dvl", Dvl(fitted=False), ("dvl",)),
        ("onboard", Onboard(window=5.0), ("onboard",)),
    ],
)
def test_switching_one_device_leaves_the_others_bits(truth, device, config, own):
    """The DVL reads the gyro, the AHRS the whole IMU, the track depth, heading and GPS."""
    field = SensorSuite.preset("field")
    other = field.replace(**{device: config})
    before, after = measure(field, truth), measure(other, truth)
    changed = {name for name in MEASURED_SIGNALS if not same(before[name], after[name])}
    assert changed
    assert all(any(part in name for part in own) for name in changed)
    drawn, kept = field.draw(SEED), other.draw(SEED)
    assert [n for n in drawn if drawn[n] != kept[n] and not n.startswith(_prefixes(device))] == []


def _prefixes(device):
    return ("gyro", "accel") if device == "imu" else (device,)


def test_strided_and_float32_truth_gives_the_same_result(truth):
    table = np.stack([truth[name] for name in TRUTH_SIGNALS], axis=1)
    columns = {name: table[:, i] for i, name in enumerate(TRUTH_SIGNALS)}
    field = SensorSuite.preset("field")
    whole, strided = measure(field, truth), measure(field, columns)
    assert all(same(whole[name], strided[name]) for name in MEASURED_SIGNALS)
    single = measure(field, {name: array.astype(np.float32) for name, array in columns.items()})
    assert single["measured_depth"] == pytest.approx(whole["measured_depth"], rel=1e-5)


def test_wrong_input_is_explained(truth):
    suite = SensorSuite()
    with pytest.raises(InputError, match="did you mean 'field'"):
        SensorSuite.preset("feild")
    with pytest.raises(InputError, match="truth lacks true_sway"):
        measure(suite, {k: v for k, v in truth.items() if k != "true_sway"})
    with pytest.raises(InputError, match="one mission at a time"):
        measure(suite, truth | {"true_roll": np.zeros((2, N))})
    with pytest.raises(InputError, match="dt is 0 s"):
        suite.measure(truth, dt=0.0, rng_seed=SEED)
    with pytest.raises(InputError, match="bottom_depth is nan"):
        suite.measure(truth, dt=DT, rng_seed=SEED, bottom_depth=np.nan)
    with pytest.raises(InputError, match="bottom_depth has shape"):
        suite.measure(truth, dt=DT, rng_seed=SEED, bottom_depth=np.ones(3))
    with pytest.raises(InputError, match="latitude 95 deg"):
        measure(suite, truth, latitude=95.0)


def test_configurations_load_without_numba_or_gsw():
    code = (
        "import sys, twin.sensors; twin.sensors.SensorSuite.preset('field'); "
        "sys.exit(bool({'numba', 'gsw', 'scipy'} & set(sys.modules)))"
    )
    assert python("-c", code).returncode == 0


def test_the_shipped_suite_measures_what_it_always_has():
    """Order and names of stores and of replays."""
    assert TRUTH_SIGNALS[:3] == ("true_roll_rate", "true_pitch_rate", "true_yaw_rate")
    assert MEASURED_SIGNALS[6:9] == ("measured_roll", "measured_pitch", "measured_heading")
    assert MEASURED_SIGNALS[-5:-2] == ("measured_shift", "measured_rotation", "measured_pump")
    assert len(MEASURED_SIGNALS) == 22
    assert len(SensorSuite().drawn_units()) == 38


def test_encoders_follow_the_parts_of_the_vehicle(truth):
    """Any number of parts; setpoints of the motion are no parts."""
    two = {k: v for k, v in truth.items() if not k.endswith(("_shift", "_pump"))}
    two["commanded_pitch"] = two["commanded_heading"] = two["true_roll"]
    out = measure(SensorSuite(), two)
    assert [name for name in out if name.endswith(PARTS)] == ["measured_rotation"]
    fine = measure(SensorSuite(encoders=Encoders(resolutions={"rotation": 1.0})), two)
    assert np.array_equal(fine["measured_rotation"], np.rint(truth["true_rotation"]))
    with pytest.raises(InputError, match="unknown part with an encoder 'rotaton': did you mean"):
        measure(SensorSuite(encoders=Encoders(resolutions={"rotaton": 1.0})), two)


def test_a_part_of_a_new_name_gets_its_own_channel(truth):
    for group in ("true", "commanded"):
        declare(Variable(f"{group}_test_fin", "degree", "fin angle", limits=(-90.0, 90.0)))
    values = np.linspace(0.0, 1.0, N)
    more = truth | {"true_test_fin": values, "commanded_test_fin": values}
    out = measure(SensorSuite(), more)
    assert np.abs(out["measured_test_fin"] - values).max() <= 0.025 + 1e-12
    entry = SensorSuite().writes(more)[-3]
    assert (entry.name, entry.units) == ("measured_test_fin", "degree")
    assert entry.long_name == "fin angle, by its encoder"


def test_a_suite_is_a_mapping_that_survives_settings_and_pickles():
    suite = SensorSuite.preset("field-no-dvl")
    assert suite.dvl is suite["dvl"]
    assert list(suite)[:2] == ["imu", "attitude"]
    assert SensorSuite.from_settings(suite.settings()) == suite == pickle.loads(pickle.dumps(suite))
    assert suite != SensorSuite()
    assert repr(SensorSuite()) == "SensorSuite()"
    with pytest.raises(KeyError, match="did you mean 'dvl'"):
        suite["dv"]
    with pytest.raises(AttributeError, match="did you mean 'compass'"):
        _ = suite.compas
    with pytest.raises(AttributeError, match=r"use suite\.replace\(dvl="):
        suite.dvl = Dvl()
    with pytest.raises(InputError, match=r"setting of sensor 'dvl' 'fited': did you mean 'fitted'"):
        SensorSuite.from_settings({"dvl": {"fited": False}})


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        ({"turbidity": Dvl()}, "unknown sensor 'turbidity'.*registered first"),
        ({"dvl": Gps()}, "sensor 'dvl' is Gps.*give a Dvl object"),
        ({"dvl": None}, "sensor 'dvl' is None: give a Dvl object"),
        ({"gsp": Gps()}, "did you mean 'gps'"),
    ],
)
def test_a_device_that_no_suite_knows_is_refused(sensors, message):
    with pytest.raises(InputError, match=message):
        SensorSuite(**sensors)


def test_every_sensor_may_say_nothing_only_where_it_says_so():
    """A whole suite over a floor out of reach: no fix, no lock and no echo are no errors."""
    run = twin.simulate(duration=120.0, floor="depth:900", density="thermocline", sensors="field")
    silent = {n for n, v in run.items() if n.startswith("measured_") and np.isnan(v).any()}
    assert {"measured_altitude", "measured_gps_north"} <= silent
    assert all(VARIABLES[name].gaps for name in silent)


def truth_at_rest(n):
    """Level at a depth of 0 m and a heading of 0, without a motion."""
    still = {name: np.zeros(n) for name in TRUTH_SIGNALS}
    return still | {"true_specific_force_z": np.full(n, -9.80665), "true_immersion": np.ones(n)}


def test_the_survey_suite_has_the_figures_of_the_papers_tables():
    """Of many missions: attitude and heading RMS; the gyro's Allan floor and no turn-on bias."""
    suite, n = SensorSuite.preset("survey"), 40_000
    still = truth_at_rest(n)
    errors = {name: [] for name in ("roll", "pitch", "heading", "yaw_rate")}
    for seed in range(8):
        made = suite.measure(still, dt=DT, rng_seed=np.random.SeedSequence(seed))
        for name in errors:
            error = made[f"measured_{name}"] - still[f"true_{name}"]
            errors[name].append((error + 180.0) % 360.0 - 180.0)
    rms = {name: float(np.sqrt(np.mean(np.square(rows)))) for name, rows in errors.items()}
    assert rms["roll"] == pytest.approx(0.25, rel=0.1)
    assert rms["pitch"] == pytest.approx(0.25, rel=0.1)
    assert rms["heading"] == pytest.approx(0.8, rel=0.1)
    # over a correlation time and more the gyro's error is its bias instability's, some 8 deg/h
    drift = np.reshape(errors["yaw_rate"], (8, -1, 400)).mean(axis=-1)
    assert 4.0 < np.rad2deg(drift.std()) * 3600.0 < 4 * 8.0
    assert suite.dvl.misalignment_deg == 0.0
    assert SensorSuite.preset("survey-field").dvl.misalignment_deg > 0.0


def test_a_survey_vehicle_reckons_by_its_doppler_log():
    n, speed = 1200, 0.9
    still = truth_at_rest(n) | {
        "true_surge": np.full(n, speed), "true_velocity_north": np.full(n, speed),
        "true_north": speed * DT * np.arange(n), "true_depth": np.full(n, 20.0),
    }  # fmt: skip
    made = SensorSuite.preset("survey").measure(
        still, dt=DT, rng_seed=np.random.SeedSequence(4), bottom_depth=60.0
    )
    assert made["measured_onboard_north"][-1] == pytest.approx(speed * DT * (n - 1), rel=0.02)


# --- live: sample by sample what is measured of a whole mission -----------------------------------


LIVE_SEED = np.random.SeedSequence(11)
DENSITY = DensityProfile.thermocline()
CURRENT = twin.parse_current("uniform:0.2,-0.1+tide:m2=0.1").compile(2000.0, twin.Origin())


@pytest.fixture(scope="module")
def dived():
    """Two dives to the floor with a stay at the surface in between, and ten minutes afloat."""
    mission = twin.Mission(
        name="two",
        segments=[
            twin.SawTooth(pitch_deg=25.0, max_depth_m=25.0, yos=1),
            twin.Surface(duration_s=200.0),
            twin.SawTooth(pitch_deg=25.0, max_depth_m=25.0, yos=1),
            twin.Surface(duration_s=200.0),
        ],
    )
    run = twin.simulate(
        mission=mission, density=DENSITY, current="uniform:0.2,-0.1", floor="depth:60"
    )
    return {name: np.array(run[name]) for name in run}


def surroundings(truth):
    return Surroundings(density=DENSITY, current=CURRENT, bottom_depth=60.0)


def live(suite, truth, samples=None):
    names = [name for name in truth if name.startswith(("true_", "commanded_"))]
    n = len(truth["true_depth"]) if samples is None else samples
    return LiveSuite(suite, names, n, dt=DT, rng_seed=LIVE_SEED, surroundings=surroundings(truth))


def row(truth, k):
    return {name: values[k] for name, values in truth.items()}


def batch(suite, truth):
    return suite.measure(
        truth, dt=DT, rng_seed=LIVE_SEED, density=DENSITY, current=CURRENT, bottom_depth=60.0
    )


def close(found, wanted):
    assert np.array_equal(np.isnan(found), np.isnan(wanted))
    scale = max(1.0, float(np.nanmax(np.abs(wanted), initial=0.0)))
    return np.allclose(found, wanted, rtol=1e-9, atol=1e-9 * scale, equal_nan=True)


@pytest.mark.parametrize("preset", ["ideal", "field", "survey-field"])
def test_sample_by_sample_is_the_whole_mission(dived, preset):
    suite = SensorSuite.preset(preset)
    sensors = live(suite, dived)
    steps = [sensors.step(row(dived, k)) for k in range(len(dived["true_depth"]))]
    wanted = batch(suite, dived)
    found = sensors.measured()
    assert set(found) == set(wanted) == set(sensors.channels)
    for name, values in wanted.items():
        assert close(found[name], values), name
    assert np.isfinite(wanted["measured_gps_north"]).sum() > 200
    heading = [step["measured_heading"] for step in steps]
    assert close(np.array(heading), wanted["measured_heading"])
    log = np.array([step["measured_dvl_surge"] for step in steps])  # known a sample later
    assert close(log[1:], wanted["measured_dvl_surge"][:-1])


def test_sensors_go_on_from_a_saved_state(dived):
    suite, n = SensorSuite(), len(dived["true_depth"])
    whole, sensors = live(suite, dived), live(suite, dived)
    half = int(np.flatnonzero(np.isfinite(batch(suite, dived)["measured_gps_north"]))[40])
    for k in range(n):
        whole.step(row(dived, k))
        if k < half:
            sensors.step(row(dived, k))
    other = live(suite, dived)
    other.restore(sensors.state())
    for k in range(half, n):
        other.step(row(dived, k))
    for name, values in whole.measured().items():
        assert np.array_equal(other.measured()[name], values, equal_nan=True), name
    with pytest.raises(InputError, match="of other sensors or of a longer mission"):
        live(suite, dived, samples=10).restore(sensors.state())


def test_a_mission_that_ends_early_has_readings_of_its_last_sample(dived):
    suite = SensorSuite(dvl=Dvl(mean_loss_time=0.0))
    sensors = live(suite, dived)
    for k in range(150):
        sensors.step(row(dived, k))
    ended = sensors.measured()
    assert np.isfinite(ended["measured_dvl_surge"][-1])
    sensors.step(row(dived, 150))
    later = sensors.measured()
    assert np.array_equal(later["measured_dvl_surge"][:149], ended["measured_dvl_surge"][:149])


def test_a_sensor_that_measures_whole_missions_only_is_named(dived):
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Late(Gps):
        name = "late"

        def begin(self, outset):
            return Sensor.begin(self, outset)

    with pytest.raises(InputError, match="sensor 'late' measures whole missions only"):
        Late().begin(Outset(samples=10, signals=(), dt=DT, drawn={}, rng=np.random.default_rng(0)))


def test_more_samples_than_drawn_for_and_missing_signals_are_explained(dived):
    sensors = live(SensorSuite(), dived, samples=1)
    sensors.step(row(dived, 0))
    with pytest.raises(InputError, match="made for 1 samples"):
        sensors.step(row(dived, 1))
    with pytest.raises(InputError, match=r"lacks .*true_pitch"):
        LiveSuite(SensorSuite(), ["true_depth"], 5, dt=DT, rng_seed=LIVE_SEED)
