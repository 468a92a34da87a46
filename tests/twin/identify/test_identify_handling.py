"""Handling: turns, pitch and loops come back from a log; what cannot fly is not written."""

import contextlib
import dataclasses
import io
import itertools
import json
import math
from pathlib import Path

import identify_logs as simulated
import numpy as np
import pytest
import xarray as xr

from twin.__main__ import PROGRAM
from twin.errors import InputError, MissionError
from twin.identify import identify, load_calibration, load_logs
from twin.identify.answer import confused
from twin.identify.comparison import PRIOR, bootstrap, cut
from twin.identify.handling import handle, with_travel, with_usual_glide
from twin.identify.linear_motion import (
    Glide,
    Phase,
    linearised,
    loop_modes,
    plane_of,
    trimmed,
    with_gains,
)
from twin.identify.logged_missions import ATTITUDE_WINDOW, _rates, start_vehicle
from twin.identify.pitch import with_righting_arm
from twin.identify.proof import failures
from twin.identify.turning_fit import munk_moment
from twin.identify.vehicle_file import largest_step, vehicle_xml
from twin.mission import Mission
from twin.mission.glide_balance import steady_glide
from twin.mission.segments import SawTooth
from twin.mission.shipped_missions import load_mission_for
from twin.physics.stiffness import file_timestep
from twin.records.attributes import READER_VERSION
from twin.records.store import write_store
from twin.vehicle.vehicle import load_vehicle, parse_vehicle
from twin.version import IMPORT_VERSION

NET_MASS = 0.25
NEUTRAL = math.radians(12.0)
"""Rotation at which the true vehicle goes straight"""
HEADINGS = (0.0, 40.0, 340.0, 60.0, 20.0, 300.0, 350.0, 30.0)


@pytest.fixture(scope="module")
def truth():
    """The Sea-Wing with what wings do in sideslip changing its sign with their lift, as vehicles
    that are flown do: turns to the other side in climbs, at equal banks."""
    nominal = load_calibration("glider")
    munk = munk_moment(nominal)
    turning = nominal.with_vehicle(
        roll_moment=(-3.0, -60.0),
        yaw_moment=(0.1 * munk, -500.0),
        yaw_moment_lift=(2.0 * munk,),
        pump={"position": (-0.2, 0.0, 0.0)},
        rotation={"neutral": NEUTRAL},
        heading_pid=(1.0, 0.002, 0.0),
    )
    return with_righting_arm(turning, 5e-3).vehicle


@pytest.fixture(scope="module")
def store(tmp_path_factory, truth):
    return logged(tmp_path_factory.mktemp("handling") / "log.zarr", truth)


def logged(path, truth):
    """Three missions that change their heading in each dive and climb, with field sensors."""
    runs = []
    for seed, (dive, climb) in enumerate(((22.0, 27.0), (28.0, 23.0), (25.0, 25.0))):
        segments = tuple(
            SawTooth(
                max_depth_m=120.0,
                pitch_deg=dive,
                climb_pitch_deg=climb,
                net_mass_kg=NET_MASS,
                heading_deg=heading,
                duration_s=420.0,
            )
            for heading in HEADINGS
        )
        plan = Mission(name="turns", segments=segments, duration_s=420.0 * len(HEADINGS))
        flown = simulated.measured(truth, plan, seed)
        flown.signals["measured_density"] = flown["true_density"]
        runs.append(flown)
    return simulated.stored(path, runs)


def fitted(store):
    logs = load_logs(store)
    nominal = load_calibration("glider")
    return logs, identify(logs, nominal, parameters=["neutral_density", "drag"])


@pytest.fixture(scope="module")
def told(store, tmp_path_factory):
    """(Handling, its progress, answer, words, written file) of the command, run once.

    What the proof says is marked on its way, so that it is the proof's that the handling holds.
    """
    out, said, kept, parts = tmp_path_factory.mktemp("told") / "mine.xml", io.StringIO(), [], []
    words = ["identify", str(store), "--vehicle", "glider", "--out", str(out)]
    words += ["--parameters", "neutral_density", "drag"]

    def watched(*given, progress, **options):
        def report(part):
            parts.append(part)
            progress(part)

        made = handle(*given, progress=report, **options)
        assert made.failures[-1:] == ("marked",)
        kept.append(dataclasses.replace(made, failures=made.failures[:-1]))
        return kept[0]

    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(said):
        patch.setattr("twin.identify.handling.failures", lambda *x: (*failures(*x), "marked"))
        patch.setattr("twin.identify.handle", watched)
        assert PROGRAM.main([*words, "--json"]) == 0
    return kept[0], parts, json.loads(said.getvalue()), words, out


@pytest.fixture(scope="module")
def handling(told):
    made, parts, *_ = told
    assert parts == sorted(parts), "progress goes back"
    assert 0.0 < parts[0] < parts[-1] == 1.0
    return made


def phases_of(net_mass):
    return Phase(pitch=-0.42, net_mass=net_mass), Phase(pitch=0.42, net_mass=-net_mass)


def glides(vehicle):
    """Straight glides down and up, to linearise about."""
    for phase in phases_of(NET_MASS):
        state, _ = trimmed(vehicle, phase)
        yield Glide(state[0], state[2], phase.pitch, phase.net_mass)


def test_turns_and_banks_of_both_phases_come_back(handling, truth):
    """Which coefficient makes a turn may stay open; how much the vehicle turns may not."""
    vehicle = handling.identification.calibration.vehicle
    for glide in glides(truth):
        turn, roll = linearised(vehicle, glide).gains()
        wanted_turn, wanted_roll = linearised(truth, glide).gains()
        assert turn == pytest.approx(wanted_turn, rel=0.25)
        assert roll == pytest.approx(wanted_roll, rel=0.1)
    dive, climb = (linearised(truth, glide).gains()[0] for glide in glides(truth))
    assert dive > 0.0 > climb  # it does turn the other way


def test_the_rotation_that_goes_straight_is_found_written_and_flown(handling):
    """The asymmetry of a log is the vehicle file's: its battery rests where the log's does."""
    assert handling.neutral == pytest.approx(NEUTRAL, abs=math.radians(3.0))
    calibration = handling.identification.calibration
    again = parse_vehicle(vehicle_xml(calibration, {}), Path("mine.xml"))
    assert again.part("rotation").rest == pytest.approx(handling.neutral)


def test_a_hull_that_turns_by_itself_is_kept_straight_otherwise_in_dives_and_climbs(
    tmp_path, truth
):
    bent = truth.replace(
        yaw_moment_offset=(math.radians(-1.0) * munk_moment(load_calibration("glider")),)
    )
    handling = handle(*fitted(logged(tmp_path / "log.zarr", bent)), proof=False)
    own = handling.identification["yaw_moment_offset"]
    assert abs(own.value + 1.0) < 3.0 * own.deviation
    again = parse_vehicle(vehicle_xml(handling.identification.calibration, {}), Path("mine.xml"))
    for phase, side in zip(handling.phases, (1.0, -1.0), strict=True):
        wanted = trimmed(bent, phase)[1][1]
        assert side * (wanted - NEUTRAL) > math.radians(12.0)
        assert trimmed(again, phase)[1][1] == pytest.approx(wanted, abs=math.radians(4.0))


def test_a_hull_that_no_rotation_keeps_straight_is_refused_with_a_reason(truth):
    bent = truth.replace(yaw_moment_offset=(munk_moment(load_calibration("glider")),))
    with pytest.raises(MissionError, match=r"turns by itself .* no position of its rotation"):
        trimmed(bent, phases_of(NET_MASS)[0])


def test_pitch_by_battery_and_pump_comes_back(handling, truth):
    found = handling.identification
    assert found["righting_arm"].value == pytest.approx(5.0, rel=0.15)
    assert found["pump_position"].value == pytest.approx(-0.2, abs=0.1)
    for phase in handling.phases:
        mine = trimmed(found.calibration.vehicle, phase)[1]
        theirs = trimmed(truth, phase)[1]
        assert mine[0] == pytest.approx(theirs[0], abs=8e-4)  # [m] of 2e-2


def test_what_comes_out_flies_and_its_loops_settle(handling):
    assert handling.failures == ()
    vehicle = handling.identification.calibration.vehicle
    assert vehicle.heading_pid != load_vehicle("glider").heading_pid
    correlation = handling.identification.correlation
    assert correlation.shape == (len(handling.identification.determined),) * 2
    np.testing.assert_allclose(np.diag(correlation), 1.0)


def test_missions_that_say_no_pitch_glide_as_the_log(handling):
    calibration = handling.identification.calibration
    pitch, net_mass = calibration.vehicle.usual_glide
    assert pitch == min(abs(phase.pitch) for phase in handling.phases)
    assert math.radians(22.0) < pitch < math.radians(26.0)
    assert net_mass == pytest.approx(NET_MASS, rel=0.1)
    again = parse_vehicle(vehicle_xml(calibration, {}), Path("mine.xml"))
    assert again.usual_glide == pytest.approx((pitch, net_mass))


def test_a_usual_glide_that_the_battery_does_not_hold_is_made_flatter_and_said():
    """A pump far from the centre: at one net mass both ways the climb takes the battery further."""
    calibration = load_calibration("slocum-1000")
    vehicle = calibration.vehicle.replace(pump={"position": (0.47, 0.0, 0.0)})
    vehicle = vehicle.replace(shift={"low": -0.03, "high": 0.012})
    phases = (Phase(pitch=-0.5, net_mass=0.17), Phase(pitch=0.49, net_mass=-0.22))
    tight, note = with_usual_glide(calibration.replace(vehicle=vehicle), phases)
    pitch, net_mass = tight.vehicle.usual_glide
    assert net_mass == pytest.approx(0.195)
    assert 0.2 < pitch < 0.48
    assert f"{math.degrees(pitch):.1f} deg, where the log has 28.1" in note
    slide = vehicle.steered("pitch")
    for sense in (1.0, -1.0):
        shift = steady_glide(vehicle, -sense * pitch, sense * net_mass).shift
        assert slide.low + 0.001 < shift < slide.high - 0.001
    roomy = vehicle.replace(shift={"low": -0.1, "high": 0.1})
    kept, note = with_usual_glide(calibration.replace(vehicle=roomy), phases)
    assert (kept.vehicle.usual_glide[0], note) == (0.49, "")


def test_no_mission_given_is_flown_at_the_pitch_that_the_vehicle_holds():
    """The shipped section asks for 26 degrees; this battery holds its usual 18 both ways only."""
    vehicle = load_vehicle("slocum-200").replace(usual_glide=(math.radians(18.0), 0.2))
    vehicle = vehicle.replace(shift={"low": -0.004, "high": 0.004})
    with pytest.raises(MissionError, match="pitch_deg = 26"):
        load_mission_for(vehicle, "section")
    with pytest.warns(UserWarning, match=r"flown at the 18.0 deg of the vehicle's usual glide"):
        plan = load_mission_for(vehicle)
    assert [one.pitch_deg for one in plan.segments] == pytest.approx([18.0, 18.0])
    assert plan.ascent_pitch_deg == pytest.approx(18.0)  # its own 35 is out of reach likewise
    stuck = vehicle.replace(shift={"low": -1e-4, "high": 1e-4})
    with pytest.raises(MissionError, match="pitch_deg = 26"):
        load_mission_for(stuck)


def test_estimates_that_are_not_told_apart_are_named_with_what_would(handling):
    found = handling.identification
    names = found.determined
    correlation = np.eye(len(names))
    pitching = [names.index(name) for name in ("shift_offset", "righting_arm", "pump_position")]
    for a, b in itertools.pairwise(pitching):
        correlation[a, b] = correlation[b, a] = -0.96
    trim = [names.index(name) for name in ("neutral_density", "drag")]
    correlation[trim[0], trim[1]] = correlation[trim[1], trim[0]] = 0.94
    (text,) = confused(dataclasses.replace(found, correlation=correlation))
    assert text.startswith("shift_offset, righting_arm and pump_position could not be separated")
    assert "0.96" in text
    assert "pump volumes" in text
    assert "--known" not in text
    correlation[trim[0], trim[1]] = correlation[trim[1], trim[0]] = 0.97
    first, _ = confused(dataclasses.replace(found, correlation=correlation))
    assert first.startswith("neutral_density and drag")
    assert "--known neutral_density=" in first


def test_command_prints_correlations_and_refuses_a_vehicle_that_does_not_fly(
    told, capsys, monkeypatch
):
    handling, _, answer, words, out = told
    assert answer["failures"] == []
    assert set(answer["correlation"]) >= {"drag", "righting_arm", "roll_authority"}
    assert load_vehicle(out).flow_frame.yaw_moment_lift[0] != 0.0
    assert load_vehicle(out).part("pump").position[0] != 0.0
    bad = dataclasses.replace(handling, failures=("it does not steer in the climb",))
    monkeypatch.setattr("twin.identify.identify", lambda *_, **__: handling.identification)
    monkeypatch.setattr("twin.identify.handle", lambda *_, **__: bad)
    assert PROGRAM.main([*words, "--overwrite"]) == 2
    assert "is not written" in capsys.readouterr().err


def test_the_printed_vehicle_with_its_battery_above_the_axis_is_said_to_fail():
    """No righting arm: nothing trims, and the answer names the phase."""
    calibration = load_calibration("glider")
    vehicle = with_righting_arm(calibration, -2e-3).vehicle
    phases = phases_of(0.3)
    found = failures(calibration.replace(vehicle=vehicle), phases)
    assert len(found) >= 2
    assert "dive" in found[0]


def test_a_loop_grows_when_its_gain_does(truth):
    """The margin is a margin: some multiple of the placed gain is too much."""
    phases = phases_of(NET_MASS)
    vehicle = with_gains(load_calibration("glider").replace(vehicle=truth), phases).vehicle
    state, positions = trimmed(vehicle, phases[0])
    plane = plane_of(vehicle, state, positions, "heading")
    assert plane.gain > 0.0

    def growth(factor):
        pid = [factor * gain for gain in vehicle.heading_pid]
        lag = vehicle.steered("heading").lag
        return loop_modes(plane, pid, lag, vehicle.control_period).real.max()

    assert growth(1.0) < 0.0 < growth(1000.0)
    assert growth(-1.0) > 0.0


def test_block_bootstrap_knows_of_days_that_differ():
    """Samples of a day share an error that the usual formula takes for independent ones."""
    rng = np.random.default_rng(3)
    days, samples = 12, 50
    jacobian = np.concatenate([np.ones((days * samples, 1)), np.eye(1) * 1e-3])
    error = np.repeat(rng.normal(size=days), samples)
    residual = np.concatenate([error - error.mean(), [0.0]])
    blocks = np.concatenate([np.repeat(np.arange(days), samples), [PRIOR]])
    usual = 1.0 / np.sqrt(days * samples)
    found = float(np.sqrt(bootstrap(jacobian, residual, blocks)[0, 0]))
    assert found == pytest.approx(error.std() / np.sqrt(days), rel=0.2)
    assert found > 4.0 * usual


@pytest.mark.parametrize(("dives", "pieces"), [(1, 8), (2, 8), (3, 9), (8, 8), (11, 11)])
def test_few_dives_are_cut_and_what_was_known_is_not(dives, pieces):
    blocks = np.array([*np.repeat(np.arange(dives), 40), PRIOR, PRIOR, PRIOR])
    parts = cut(blocks)
    assert len(np.unique(parts[:-3])) == pieces
    assert (parts[-3:] == PRIOR).all()


def test_undetermined_keeps_its_known_deviation():
    jacobian = np.concatenate([np.zeros((100, 1)), np.eye(1)])
    blocks = np.concatenate([np.repeat(np.arange(10), 10), [PRIOR]])
    found = float(bootstrap(jacobian, np.zeros(101), blocks)[0, 0])
    assert found == pytest.approx(1.0, rel=0.25)


def test_rates_without_gyroscopes_are_slopes_of_least_squares():
    """White noise of the angles comes into a slope by the formula of a straight line's fit."""
    count, period, noise = 40_000, 2.0, 1e-3
    rng = np.random.default_rng(5)
    roll = rng.normal(0.0, noise, count)
    level = np.zeros(count)
    rates = _rates({}, roll, level, 0.01 * period * np.arange(count), period)
    window = round(ATTITUDE_WINDOW / period) | 1
    expected = noise / period * np.sqrt(12.0 / (window * (window**2 - 1.0)))
    assert rates[0].std() == pytest.approx(expected, rel=0.05)
    assert rates[2].mean() == pytest.approx(0.01, rel=1e-3)


def test_travel_grows_with_the_log(store):
    logs = [dataclasses.replace(log, shift=log.shift + 0.08) for log in load_logs(store)]
    calibration = with_travel(logs, load_calibration("glider"))
    slide = calibration.vehicle.part("shift")
    assert slide.low <= 0.0 < 0.08 < slide.high


@pytest.mark.parametrize(
    ("said", "deeper", "vehicle"),
    [
        ({"source_format": "slocum"}, 1.0, "slocum-200"),
        ({"source_format": "slocum"}, 6.0, "slocum-1000"),
        ({"source_format": "seaglider"}, 1.0, "seaglider"),
        ({"source_format": "og1", "platform": "SeaExplorer 035"}, 1.0, "seaexplorer"),
        ({"source_format": "lrauv"}, 1.0, None),
    ],
)
def test_the_start_is_the_shipped_vehicle_of_the_logs_kind(tmp_path, store, said, deeper, vehicle):
    dataset = xr.open_zarr(store).load().assign_attrs({**said, READER_VERSION: IMPORT_VERSION})
    dataset["measured_depth"] = deeper * dataset["measured_depth"]
    dataset["measured_pump"] = 0.5 * dataset["measured_pump"]
    path = write_store(dataset, tmp_path / "log.zarr")
    if vehicle is None:
        with pytest.raises(InputError, match="give --vehicle"):
            start_vehicle(path)
    else:
        assert start_vehicle(path).path.stem == vehicle


def test_a_simulated_store_starts_from_a_file_of_its_own(store):
    assert start_vehicle(store).flow_frame.yaw_moment_lift == (0.0,)


def test_the_written_step_is_a_tenth_of_a_second_and_the_written_hull_swells():
    """However a real glider's rates are damped: that is solved for. A fast hull's is shorter."""
    calibration = load_calibration("seaglider").replace(thermal_expansion=5e-5, thermal_lag=300.0)
    constant, _ = calibration.vehicle.flow_frame.yaw_moment
    damped = calibration.with_vehicle(yaw_moment=(constant, -3000.0))
    assert largest_step(calibration.vehicle) == largest_step(damped.vehicle) == 0.1
    again = parse_vehicle(vehicle_xml(damped, {}), calibration.vehicle.path)
    assert file_timestep(again) == 0.1
    assert again.hull_thermal_expansion == pytest.approx(5e-5)
    assert again.hull_thermal_lag == pytest.approx(300.0)
    assert again.hull_reference_temperature == 10.0
    assert largest_step(load_vehicle("rogue").replace(usual_glide=(0.7, 0.6))) == 0.05
