"""Stated deviations, depth rates by the log's density, and the geometry of bank and compass."""

import dataclasses

import gsw
import identify_logs as simulated
import numpy as np
import pytest
from scipy.optimize import least_squares

from twin.frames import euler_to_matrix
from twin.identify import choose, load_calibration, load_logs
from twin.identify.fit import _covariance, _stalled, _too_shallow
from twin.identify.logged_missions import AFLOAT, log_of
from twin.identify.residuals import DepthRates
from twin.identify.speed import horizontal, motion_of
from twin.identify.translation import Translation
from twin.identify.unknowns import PARAMETERS
from twin.mission import Mission
from twin.mission.segments import SawTooth
from twin.records.trajectory import Trajectory
from twin.sensors import Compass
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")


@pytest.fixture(scope="module")
def flown() -> Trajectory:
    plan = Mission(
        name="dive",
        start_heading_deg=0.0,
        segments=(SawTooth(max_depth_m=150.0, pitch_deg=25.0, net_mass_kg=0.25, yos=1),),
    )
    return simulated.measured(VEHICLE, plan, 5)


@pytest.fixture(scope="module")
def logs(tmp_path_factory, flown):
    flown.signals["measured_density"] = flown["true_density"]
    return load_logs(simulated.stored(tmp_path_factory.mktemp("deviations") / "a.zarr", [flown]))


@pytest.mark.parametrize("kept", ["pitch_offset", "pitch_scale", "lift_ratio"])
def test_a_kept_value_adds_the_change_that_its_usual_error_makes(logs, kept):
    """With the kept value off by its usual error, a fit of the same weights moves by as much."""
    fitted, nominal = choose(["neutral_density", "drag"]), load_calibration("glider")
    (parameter,) = choose([kept])
    others = [p.name for p in PARAMETERS if p not in fitted]
    problem = DepthRates(logs, nominal, fitted)
    x, _ = problem.fit(np.zeros(2), 2)
    found = []
    for part in (0.2, -0.2):
        off = part * parameter.held / parameter.spread
        wrong = DepthRates(logs, parameter.at(nominal, parameter.get(nominal), off), fitted)
        wrong.weights = problem.weights
        ends = {"xtol": 1e-10, "ftol": 1e-12}
        found.append(least_squares(wrong.residual, x, jac=wrong.jacobian, **ends).x)
    moved = (found[0] - found[1]) / 0.4
    exact, whole = (
        _covariance(problem, x, names) for names in (others, [n for n in others if n != kept])
    )
    assert (np.abs(moved) > np.sqrt(np.diag(exact))).any()
    size = np.sqrt(np.diag(whole))
    off = (whole - exact - np.outer(moved, moved)) / np.outer(size, size)
    assert np.abs(off).max() < 0.03


def legs_of(log, calibration, under, rng, dives=12):
    """Dives on legs of two, in a current of each dive's own, under a compass that is off."""
    offset = rng.normal(0.0, 2.0)
    made = []
    for k in range(dives):
        turned = dataclasses.replace(log, heading=log.heading + 1.3 * (k // 2))
        swum = horizontal(turned, calibration.replace(heading_offset=np.deg2rad(offset)), under)
        current = rng.normal(0.0, 0.012, 2)
        ground = [
            log.period * v.sum() + c * log.duration for v, c in zip(swum, current, strict=True)
        ]
        made.append(dataclasses.replace(turned, displacement=tuple(ground), follows=k > 0))
    return made, offset


def test_the_compass_is_as_far_off_as_its_deviation_says(logs):
    """A turn is seen in the currents of two dives, and each current's scatter counts once."""
    nominal, fitted = load_calibration("glider"), choose(["heading_offset"])
    under, z, problem = motion_of(logs[0], nominal), [], None
    for seed in range(80):
        dives, offset = legs_of(logs[0], nominal, under, np.random.default_rng(seed))
        problem = problem or DepthRates(dives, nominal, fitted, fixes=True)
        problem.logs = dives  # which differ in displacement alone: flown once
        x, _ = problem.fit(np.zeros(1), 2, max_nfev=4)
        (off,) = np.sqrt(np.diag(problem.considered(x, ())[0]))
        assert off < 0.8
        z.append((x[0] - offset / fitted[0].spread) / off)
    assert 0.85 < np.sqrt(np.mean(np.square(z))) < 1.3  # counted twice: 0.75
    assert abs(np.mean(z)) < 0.4


@pytest.mark.parametrize(("part", "named"), [(0.6, (1,)), (0.9, ())])
def test_a_dive_that_falls_as_stalled_wings_do_is_named(logs, part, named):
    slow = dataclasses.replace(logs[0], index=1, depth_rate=part * logs[0].depth_rate)
    problem = DepthRates([logs[0], slow], load_calibration("glider"), ())
    assert _stalled(problem, np.zeros(0)) == named


def test_depth_rates_are_those_of_the_measured_density(flown):
    """Depth rates of the standard ocean are 0.1 to 0.6 % too slow in this water."""
    true, water = flown["true_depth"].astype(float), flown["true_density"].astype(float)
    pressure = simulated.THERMOCLINE.pressure(true, latitude=30.0)
    signals = {n: v.astype(float) for n, v in flown.signals.items() if n.startswith("measured_")}
    signals["measured_depth"] = np.asarray(-gsw.z_from_p(pressure, 30.0))
    rates = []
    for density in (water, np.full(len(water), 1028.4)):
        log = log_of(0, signals | {"measured_density": density}, 2.0, None, False)
        rates.append(log.depth_rate)
    there = np.gradient(true, 2.0)
    for sign in (1.0, -1.0):
        some = (true > 20.0) & (true < 130.0) & (sign * there > 0.05)
        ours, standard = (rate[some].sum() / there[some].sum() for rate in rates)
        assert ours == pytest.approx(1.0, abs=3e-4)
        assert standard < 0.998


def test_the_deepest_dives_tell_one_hull_from_another(logs):
    nominal, log = load_calibration("slocum-1000"), logs[0]
    shallow = [log] * 12
    deep = dataclasses.replace(log, depth=log.depth * 450.0 / log.depth.max())
    assert "hulls differ" in _too_shallow(shallow, nominal)
    assert "hulls differ" in _too_shallow([*shallow, deep, deep], nominal)
    assert _too_shallow([*shallow, deep, deep, deep], nominal) == ""


def test_a_compass_with_all_cycles_is_corrected():
    """D and E of 2 deg: the sensor's own deviation, taken off by the calibration's cycles."""
    coefficients = {"a0": 1.0, "b": -1.5, "c": 0.7, "d": 2.0, "e": -2.0}
    heading = np.arange(0.0, 360.0, 15.0)
    signals = {
        **{f"true_{n}": np.zeros(len(heading)) for n in ("roll", "pitch", "yaw_rate")},
        "true_heading": heading,
    }
    drawn = dict.fromkeys(Compass.draws, 0.0)
    drawn |= {f"compass_{key}_deg": value for key, value in coefficients.items()}
    compass = dataclasses.replace(Compass.ideal(), offset_deg=1.0)
    read = compass.measure(
        signals, dt=1.0, drawn=drawn, rng=np.random.default_rng(0), surroundings=None
    )["measured_heading"]
    cycles = tuple(np.deg2rad([-coefficients[key] for key in "cbed"]))
    calibration = load_calibration("glider").replace(
        heading_offset=np.deg2rad(-1.0), heading_cycles=cycles
    )
    found = np.rad2deg(calibration.true_heading(np.deg2rad(read)))
    off = (found - heading + 180.0) % 360.0 - 180.0
    assert np.abs((read - heading + 180.0) % 360.0 - 180.0).max() > 3.0
    assert np.abs(off).max() < 0.3  # [deg] squares of the deviations


def test_horizontal_velocity_of_a_banked_spiral_is_the_rotated_one(logs):
    """Heave goes to port in a bank to starboard, as sway and surge by the full rotation."""
    log, calibration = logs[0], load_calibration("glider").replace(pitch_offset=0.02)
    n = len(log.depth)
    turning = dataclasses.replace(
        log,
        roll=np.full(n, np.deg2rad(35.0)),
        pitch=np.full(n, np.deg2rad(-25.0)),
        heading=np.linspace(0.0, 12.0, n),
        depth=np.full(n, 50.0),
    )
    motion = Translation(surge=np.full(n, 0.3), sway=np.full(n, -0.05), heave=np.full(n, 0.12))
    matrix = euler_to_matrix(turning.roll, calibration.true_pitch(turning.pitch), turning.heading)
    north, east, down = np.einsum("tij,j->it", matrix, [0.3, -0.05, 0.12])
    found = horizontal(turning, calibration, motion)
    np.testing.assert_allclose(found, [north, east], atol=1e-12)
    sink = motion.sink_rate(turning.roll, calibration.true_pitch(turning.pitch))
    np.testing.assert_allclose(sink, down, atol=1e-12)


@pytest.mark.parametrize(("pitch", "moves"), [(-45.0, False), (45.0, True)])
def test_a_hull_floats_by_its_tail_nose_down_only(logs, pitch, moves):
    """At half a hull's length of depth the tail of a glider that hangs nose down is in the air."""
    log, calibration = logs[0], load_calibration("glider")
    n = len(log.depth)
    depth = AFLOAT + 0.4 * VEHICLE.hull_length
    still = dataclasses.replace(
        log,
        depth=np.full(n, depth),
        depth_rate=np.zeros(n),
        roll=np.zeros(n),
        pitch=np.full(n, np.deg2rad(pitch)),
        rates=np.zeros((3, n)),
        pump=np.full(n, np.sign(pitch) * 150.0),
        density=np.full(n, VEHICLE.reference_density),
        temperature=None,
    )
    assert (motion_of(still, calibration).speed[-1] > 0.1) == moves
