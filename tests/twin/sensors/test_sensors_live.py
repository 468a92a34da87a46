"""Live sensors: every sensor measures sample by sample what it measures of a whole mission."""

import dataclasses

import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.sensors import Dvl, Gps, Outset, Sensor, SensorSuite
from twin.sensors.base import Surroundings
from twin.sensors.live import LiveSuite
from twin.water.density import DensityProfile

SEED = np.random.SeedSequence(11)
DT = 0.5
DENSITY = DensityProfile.thermocline()
CURRENT = twin.parse_current("uniform:0.2,-0.1+tide:m2=0.1").compile(2000.0, twin.Origin())


@pytest.fixture(scope="module")
def truth():
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
    return LiveSuite(suite, names, n, dt=DT, rng_seed=SEED, surroundings=surroundings(truth))


def row(truth, k):
    return {name: values[k] for name, values in truth.items()}


def batch(suite, truth):
    return suite.measure(
        truth, dt=DT, rng_seed=SEED, density=DENSITY, current=CURRENT, bottom_depth=60.0
    )


def close(found, wanted):
    assert np.array_equal(np.isnan(found), np.isnan(wanted))
    scale = max(1.0, float(np.nanmax(np.abs(wanted), initial=0.0)))
    return np.allclose(found, wanted, rtol=1e-9, atol=1e-9 * scale, equal_nan=True)


@pytest.mark.parametrize("preset", ["ideal", "field", "survey-field"])
def test_sample_by_sample_is_the_whole_mission(truth, preset):
    suite = SensorSuite.preset(preset)
    sensors = live(suite, truth)
    steps = [sensors.step(row(truth, k)) for k in range(len(truth["true_depth"]))]
    wanted = batch(suite, truth)
    found = sensors.measured()
    assert set(found) == set(wanted) == set(sensors.channels)
    for name, values in wanted.items():
        assert close(found[name], values), name
    assert np.isfinite(wanted["measured_gps_north"]).sum() > 200
    heading = [step["measured_heading"] for step in steps]
    assert close(np.array(heading), wanted["measured_heading"])
    log = np.array([step["measured_dvl_surge"] for step in steps])  # known a sample later
    assert close(log[1:], wanted["measured_dvl_surge"][:-1])


def test_sensors_go_on_from_a_saved_state(truth):
    suite, n = SensorSuite(), len(truth["true_depth"])
    whole, sensors = live(suite, truth), live(suite, truth)
    half = int(np.flatnonzero(np.isfinite(batch(suite, truth)["measured_gps_north"]))[40])
    for k in range(n):
        whole.step(row(truth, k))
        if k < half:
            sensors.step(row(truth, k))
    other = live(suite, truth)
    other.restore(sensors.state())
    for k in range(half, n):
        other.step(row(truth, k))
    for name, values in whole.measured().items():
        assert np.array_equal(other.measured()[name], values, equal_nan=True), name
    with pytest.raises(InputError, match="of other sensors or of a longer mission"):
        live(suite, truth, samples=10).restore(sensors.state())


def test_a_mission_that_ends_early_has_readings_of_its_last_sample(truth):
    suite = SensorSuite(dvl=Dvl(mean_loss_time=0.0))
    sensors = live(suite, truth)
    for k in range(150):
        sensors.step(row(truth, k))
    ended = sensors.measured()
    assert np.isfinite(ended["measured_dvl_surge"][-1])
    sensors.step(row(truth, 150))
    later = sensors.measured()
    assert np.array_equal(later["measured_dvl_surge"][:149], ended["measured_dvl_surge"][:149])


def test_a_sensor_that_measures_whole_missions_only_is_named(truth):
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Late(Gps):
        name = "late"

        def begin(self, outset):
            return Sensor.begin(self, outset)

    with pytest.raises(InputError, match="sensor 'late' measures whole missions only"):
        Late().begin(Outset(samples=10, signals=(), dt=DT, drawn={}, rng=np.random.default_rng(0)))


def test_more_samples_than_drawn_for_and_missing_signals_are_explained(truth):
    sensors = live(SensorSuite(), truth, samples=1)
    sensors.step(row(truth, 0))
    with pytest.raises(InputError, match="made for 1 samples"):
        sensors.step(row(truth, 1))
    with pytest.raises(InputError, match=r"lacks .*true_pitch"):
        LiveSuite(SensorSuite(), ["true_depth"], 5, dt=DT, rng_seed=SEED)
