"""Identification: the flight equations, the vehicle file, logs that cannot be used, the command."""

import dataclasses
import io
import json
import re

import identify_logs as simulated
import mujoco
import numpy as np
import pytest
import xarray as xr

from twin.__main__ import PROGRAM
from twin.cli.console import Progress
from twin.commands.identify import _Stages
from twin.errors import InputError, StoreError, VehicleError
from twin.identify import (
    AttitudeFlight,
    estimate_speed,
    fly,
    identify,
    load_calibration,
    load_logs,
    motion_of,
)
from twin.identify.logged_missions import gliding
from twin.identify.pitch import PITCHING, righting_arm
from twin.identify.turning_fit import TURNING
from twin.identify.unknowns import PARAMETERS, choose, with_known
from twin.identify.vehicle_file import vehicle_xml, write_vehicle
from twin.mission.controller import Schedule
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.records.attributes import CONVENTIONS, READER_VERSION
from twin.records.storage.checksums import store_hash
from twin.records.store import write_store
from twin.show.identification import residual_figure
from twin.vehicle.steady_motion import balance
from twin.vehicle.vehicle import load_vehicle, parse_vehicle
from twin.version import IMPORT_VERSION

VEHICLE = load_vehicle("glider")


@pytest.fixture(scope="module")
def run():
    """One dive of a vehicle with a drag that its file does not have."""
    return simulated.flown(simulated.changed(VEHICLE, drag=1.3), 7)


@pytest.fixture(scope="module")
def store(tmp_path_factory, run):
    return simulated.stored(tmp_path_factory.mktemp("identify") / "log.zarr", [run])


@pytest.fixture(scope="module")
def nominal():
    return load_calibration("glider")


@pytest.fixture(scope="module")
def found(store, nominal):
    return identify(load_logs(store), nominal)


@pytest.fixture(scope="module")
def pair(store, nominal):
    """Trim and drag alone."""
    return identify(load_logs(store), nominal, parameters=["neutral_density", "drag"])


def level(value, samples=400):
    return np.full(samples, float(value))


def test_a_heavy_start_and_a_light_stiff_vehicle_do_not_stop_the_search(store, nominal, pair):
    """Ballast far off and a drag at which steps of a second are unstable: both are found."""
    logs = load_logs(store)
    shifted = [dataclasses.replace(log, pump=log.pump - 400.0) for log in logs]
    found = identify(shifted, nominal, parameters=["neutral_density", "drag"])
    assert found["drag"].value == pytest.approx(pair["drag"].value, rel=0.02)
    stiff = simulated.changed(VEHICLE, drag=40.0)
    motion = motion_of(logs[0], nominal.replace(vehicle=stiff))
    assert np.isfinite(motion.speed).all()
    assert motion.speed.max() < 1.0


def test_side_force_grows_with_drag():
    nominal = load_calibration("graver-2005")
    (drag,) = choose(["drag"])
    scaled = drag.set(nominal, 3.0 * nominal.vehicle.flow_frame.drag[0])
    assert scaled.vehicle.flow_frame.side_force[0] == pytest.approx(
        3.0 * nominal.vehicle.flow_frame.side_force[0]
    )


def test_without_ctd_the_sea_is_compressed_like_sea_water():
    import gsw

    calibration = load_calibration("graver-2005").replace(
        water_density=float(gsw.rho(35.165, 10.0, 0.0))
    )
    depth = np.array([0.0, 300.0, 1000.0])
    known = gsw.rho(35.165, 10.0, gsw.p_from_z(-depth, 30.0))
    np.testing.assert_allclose(calibration.sea_density(depth), known, atol=0.05)


def test_a_vehicle_without_ctd_in_a_store_of_others_is_identified(tmp_path, run, nominal):
    path = simulated.stored(tmp_path / "two.zarr", [run, run])
    dataset = xr.open_zarr(path).load()
    dataset["measured_density"][0] = np.nan
    write_store(dataset, tmp_path / "mixed.zarr")
    without = load_logs(tmp_path / "mixed.zarr", [0])
    assert len(without) == 1
    assert without[0].density is None
    assert identify(without, nominal)["drag"].determined
    both = load_logs(tmp_path / "mixed.zarr")
    assert [log.index for log in both] == [1]  # its buoyancy is known, the other's is not


@pytest.mark.parametrize(("net", "pitch"), [(0.3, -0.6), (-0.3, 0.5), (0.15, -0.3)])
def test_flight_settles_into_the_balance_of_forces(net, pitch):
    rates = np.zeros((3, 400))
    flight = AttitudeFlight(
        vehicle=VEHICLE,
        period=0.5,
        net_mass=level(net),
        immersion=level(1),
        roll=level(0.05),
        pitch=level(pitch),
        rates=rates,
    )
    (motion,) = fly([flight])
    speed, alpha, beta, gliding = balance(VEHICLE, level(net), level(0.05), level(pitch), rates)
    assert gliding.all()
    # the balance is a fixed point iteration that ends with this error at 17 degrees of pitch
    assert motion.speed[-1] == pytest.approx(speed[-1], abs=3e-5)
    assert motion.angle_of_attack[-1] == pytest.approx(alpha[-1], abs=1e-4)
    assert np.arcsin(motion.sway[-1] / motion.speed[-1]) == pytest.approx(beta[-1], abs=1e-4)


def test_flight_gives_the_velocities_of_the_twin(run):
    """The same vehicle with the true attitude, density and pump: moments apart, the same."""
    vehicle = simulated.changed(VEHICLE, drag=1.3)
    signals = {name: run[f"true_{name}"] for name in ("roll", "pitch", "depth", "net_mass")}
    rates = np.stack([run[f"true_{n}_rate"] for n in ("roll", "pitch", "yaw")])
    flight = AttitudeFlight(
        vehicle=vehicle,
        period=simulated.PERIOD,
        net_mass=np.where(signals["depth"] < 0.5, 0.0, signals["net_mass"]),
        immersion=np.clip(run["true_immersion"], 0.3, 1.0),
        roll=np.deg2rad(signals["roll"]),
        pitch=np.deg2rad(signals["pitch"]),
        rates=rates,
    )
    (motion,) = fly([flight])
    deep = signals["depth"] > 10.0
    for name, most in (("surge", 0.004), ("sway", 0.002), ("heave", 0.004)):
        error = (getattr(motion, name) - run[f"true_{name}"])[deep]
        assert np.sqrt(np.mean(error**2)) < most


def test_speed_after_calibration_is_better_than_with_the_nominal_vehicle(store, run, found):
    true = np.sqrt(sum(run[f"true_{n}"] ** 2 for n in ("surge", "sway", "heave")))

    def error(vehicle):
        one = estimate_speed(store, 0, vehicle)
        return np.sqrt(np.mean((one.speed - true[: len(one.speed)])[one.use] ** 2))

    assert error(found.calibration) < 0.012 < 0.02 < error("glider")


def test_lift_is_kept_at_nominal_without_fixes_unless_asked_for(found):
    kept = found["lift_ratio"]
    assert not kept.determined
    assert kept.value == kept.nominal == VEHICLE.flow_frame.lift[1] / VEHICLE.flow_frame.drag[0]
    assert "fixes" in kept.note
    assert not found["thermal_lag"].determined
    assert "temperature" in found["thermal_lag"].note


@pytest.mark.parametrize(
    "parameter",
    [p for p in (*PARAMETERS, *PITCHING, *TURNING) if p.channel != "fin"],  # it has no rudder
    ids=lambda p: p.name,
)
def test_parameters_read_back_what_was_set(parameter, nominal):
    value = parameter.value(parameter.get(nominal) or 1.0, 0.3)
    again = parameter.set(nominal, value)
    assert parameter.get(again) == pytest.approx(value, rel=1e-12)
    if parameter.name == "roll_authority":
        assert righting_arm(again) == pytest.approx(righting_arm(nominal))


def test_known_values_are_not_estimated(store, nominal):
    found = identify(load_logs(store), with_known(nominal, {"mass": 70.0}), known=["mass"])
    assert found.calibration.vehicle.mass == pytest.approx(70.0)
    assert found["mass"].note == "given as known"


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (["drga"], "did you mean 'drag'"),
        (["mass"], r"nothing is left to estimate .*mass: given as known"),
    ],
)
def test_what_cannot_be_estimated_is_told(store, nominal, parameters, message):
    with pytest.raises(InputError, match=message):
        identify(load_logs(store), nominal, parameters=parameters, known=["mass"])


@pytest.mark.parametrize("name", ["graver-2005", "glider", "rogue"])
def test_written_vehicle_loads_flies_and_says_where_it_comes_from(tmp_path, name):
    calibration = load_calibration(name, pitch_scale=0.9, pitch_offset=0.01)
    for parameter in (*PARAMETERS, *PITCHING):
        calibration = parameter.at(calibration, parameter.get(calibration), 0.2)
    path = write_vehicle(calibration, tmp_path / "mine.xml", {"store": 'a "log" & <more>'})
    again = load_calibration(path)
    for parameter in (*PARAMETERS, *PITCHING):
        assert parameter.get(again) == pytest.approx(parameter.get(calibration), rel=1e-8)
    np.testing.assert_allclose(again.vehicle.added_mass, calibration.vehicle.added_mass, rtol=1e-8)
    np.testing.assert_allclose(
        again.vehicle.static_inertia, calibration.vehicle.static_inertia, rtol=1e-8
    )
    model = mujoco.MjModel.from_xml_path(str(path))
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, "identification") >= 0
    heavy = Schedule(times=[0.0], commands=[[0.01, 0.0, -150.0]])
    dive = simulate(Scenario(vehicle=again.vehicle, mission=heavy, duration=60.0))
    assert dive["true_depth"][-1] > 2.0
    second = vehicle_xml(again, {"store": "another"})
    assert second.count('name="identification"') == second.count('name="sensor_errors"') == 1
    assert parse_vehicle(second, path).flow_frame.drag == again.vehicle.flow_frame.drag
    with pytest.raises(InputError, match="already exists; use --overwrite"):
        write_vehicle(calibration, path, {})


def test_changed_numbers_say_log_dates_and_deviation_and_no_older_source(tmp_path):
    """A number that stays keeps its comment; written again, a comment is replaced, not added to."""
    calibration = with_known(load_calibration("slocum-200"), {"compressibility": 6.0, "drag": 9.3})
    calibration = calibration.with_vehicle(usual_glide=(0.4, 0.2))
    drag = {"value": 9.3, "deviation": 0.41, "unit": "kg m-1"}
    said = {
        "store": "a--b.zarr",
        "dates": ["2023-09-02", "2023-09-05"],
        "parameters": {"drag": drag},
    }
    source = "identified from a-b.zarr, 2023-09-02 to 2023-09-05"
    for name in ("first.xml", "second.xml"):
        path = write_vehicle(calibration, tmp_path / name, said)
        lines = {
            found.group(1): line
            for line in path.read_text().splitlines()
            if (found := re.search(r'<numeric name="(\w+)"', line))
        }
        assert lines["usual_glide"].endswith(f"<!-- pitch [rad], net mass [kg] {source} -->")
        assert lines["hull_compressibility"].endswith(f"<!-- [1/Pa] {source} -->")
        assert lines["drag"].endswith(
            f"<!-- K_D0 [kg/m], K_D [kg/m/rad2] {source}: drag 9.3 +- 0.41 [kg m-1] -->"
        )
        assert "Teledyne Webb's data sheet" in lines["rated_depth"]
        calibration = load_calibration(path).with_vehicle(usual_glide=(0.41, 0.2))
        calibration = with_known(calibration, {"compressibility": 6.1, "drag": 9.4})


@pytest.mark.parametrize("asked", [False, True])
def test_the_command_says_three_sentences_and_correlations_when_asked(store, capsys, asked):
    words = ["identify", str(store), "--vehicle", "glider", "--no-handling"]
    words += ["--parameters", "drag", "neutral_density"]
    assert PROGRAM.main([*words, *["--correlations"] * asked]) == 0
    said = capsys.readouterr().out
    assert ("correlation of the estimates" in said) == asked
    assert re.search(r"depth rate is within \d\.\d\d cm/s of the log's \(RMS; glider", said)
    assert "No currents between fixes were compared" in said
    assert "Deviations include the usual errors of the values that are kept" in said


def test_damaged_sensor_errors_are_named(tmp_path):
    path = write_vehicle(load_calibration("graver-2005"), tmp_path / "a.xml", {})
    text = path.read_text()
    head = text.index('name="sensor_errors" data="') + len('name="sensor_errors" data="')
    path.write_text(text[:head] + "x " + text[head:])
    with pytest.raises(VehicleError, match="sensor_errors"):
        load_calibration(path)


def test_store_hash_follows_the_content(store, tmp_path, run):
    assert store_hash(store) == store_hash(store)
    other = simulated.stored(tmp_path / "b.zarr", [simulated.add_pitch_offset(run, 1e-3)])
    simulated.add_pitch_offset(run, -1e-3)
    assert store_hash(other) != store_hash(store)


def test_logs_that_cannot_be_used_are_named(tmp_path, store, nominal):
    dataset = xr.open_zarr(store).load()
    for drop in ("measured_pump", "measured_pitch"):
        path = tmp_path / f"no_{drop}.zarr"
        write_store(dataset.drop_vars(drop), path)
        with pytest.raises(StoreError, match=drop):
            load_logs(path)
    shallow = dataset.copy()
    shallow["measured_depth"] = shallow["measured_depth"] * 0.01
    write_store(shallow, tmp_path / "shallow.zarr")
    with pytest.raises(StoreError, match="no dive"):
        load_logs(tmp_path / "shallow.zarr")
    with pytest.raises(StoreError, match="no mission 5; it holds 0 to 0"):
        load_logs(store, [5])
    short = dataset.isel(time=slice(0, 80))
    short["n_samples"] = short["n_samples"] * 0 + 80
    write_store(short, tmp_path / "short.zarr")
    with pytest.raises(InputError, match="at least 100"):
        identify(load_logs(tmp_path / "short.zarr"), nominal)


def test_missions_under_the_thruster_are_left_out_and_counted(tmp_path, run, nominal, capsys):
    path = simulated.stored(tmp_path / "log.zarr", [run, run])
    dataset = xr.open_zarr(path).load()
    dataset["thruster_fraction"] = ("mission", [0.0, 0.99])
    write_store(dataset, path, overwrite=True)
    command = ["identify", str(path), "--vehicle", "glider", "--no-handling", "--json"]
    assert PROGRAM.main([*command, "--parameters", "drag"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["powered_rows_left_out"] == 1
    assert json.loads(said.out)["missions"] == 1
    assert "1 of 2 missions ran their thruster" in said.err
    with pytest.raises(InputError, match="all 1 missions ran their thruster"):
        identify(load_logs(path, [1]), nominal)
    kept, powered = gliding(load_logs(path))
    assert [log.index for log in kept] == [0]
    assert powered == (1,)
    three = [dataclasses.replace(kept[0], index=k, follows=k > 0, powered=k == 1) for k in range(3)]
    # the current after a mission that is left out is not that before it
    assert [log.follows for log in gliding(three)[0]] == [False, False]


def test_a_fit_far_worse_than_usual_says_what_to_look_at(tmp_path, run, nominal):
    """A propeller that no signal tells of: slower down and faster up than any glide."""
    driven = dataclasses.replace(run, signals=dict(run.signals))
    driven.signals["measured_pump"] = -driven.signals["measured_pump"]
    logs = load_logs(simulated.stored(tmp_path / "log.zarr", [driven]))
    with pytest.raises(InputError, match=r"times what is usual \(1 cm/s\).*in dives and .* worst"):
        identify(logs, nominal, parameters=["drag"])


def test_figure_draws(store, pair):
    figure = residual_figure(pair, load_logs(store))
    assert len(figure.axes) == 4
    assert "RMSE" in figure.axes[2].get_title(loc="left")


def test_command_writes_vehicle_and_one_json_object(tmp_path, store, capsys):
    out = tmp_path / "mine.xml"
    arguments = ["identify", str(store), "--vehicle", "glider", "--out", str(out), "--json"]
    assert PROGRAM.main(arguments) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["parameters"]["drag"]["determined"] is True
    assert load_vehicle(out).flow_frame.drag[0] == pytest.approx(
        answer["parameters"]["drag"]["value"]
    )
    assert motion_of(load_logs(store)[0], load_calibration(out)).speed.max() < 1.0
    assert PROGRAM.main(arguments) == 2
    assert "use --overwrite" in capsys.readouterr().err


def test_a_written_vehicle_that_still_water_would_drive_is_told_of(tmp_path, store, capsys):
    shipped, driven = tmp_path / "shipped.xml", tmp_path / "driven.xml"
    xml, bend = load_vehicle("glider").xml, '<numeric name="yaw_moment_offset" data="100"/>'
    shipped.write_text(xml)
    driven.write_text(xml.replace("</custom>", f"{bend}</custom>"))
    said = []
    for vehicle in (shipped, driven):
        out = tmp_path / f"mine-{vehicle.name}"
        words = ["identify", str(store), "--vehicle", str(vehicle), "--out", str(out)]
        words += ["--no-handling", "--model", "steady", "--parameters", "drag"]
        assert PROGRAM.main(words) == 0
        said.append(capsys.readouterr().err)
    # its fitted K_D is of small angles; a hull across the flow has the drag of a cylinder
    mine = load_vehicle(tmp_path / "mine-shipped.xml")
    cylinder = 0.5 * 1.1 * mine.reference_density * mine.hull_length * mine.hull_diameter
    assert mine.flow_frame.cross_flow_drag == pytest.approx(max(cylinder, mine.flow_frame.drag[1]))
    assert "still water" not in said[0]
    assert "of its energy from still water when it moves" in said[1]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--out", "a.txt"], "must end in .xml"),
        (["--missions", "1-x"], "numbers such as 0-11,14"),
        (["--pitch-scale", "7"], "between 0.5 and 2"),
        (["--parameters", "lift"], "unknown parameter 'lift'"),
        (["--vehicle", "graver-2055"], "did you mean 'graver-2005'"),
        (["--known", "mass"], "such as mass=70"),
        (["--known", "mass=-3"], "must be above 0"),
    ],
)
def test_command_refuses_bad_input_in_one_line(store, more, message, capsys):
    assert PROGRAM.main(["identify", str(store), *more]) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert "\n" not in error


@pytest.mark.parametrize("refines", [False, True])
@pytest.mark.parametrize("handles", [False, True])
def test_the_bar_is_full_when_the_last_stage_ends(refines, handles):
    progress = Progress(total=1.0, label="identify", unit="", stream=io.StringIO())
    stages = _Stages(progress, refines=refines, handles=handles)
    names = ["fit", *["refine"] * refines, *["handle"] * handles]
    for name in names:
        assert progress.done < 0.99
        report = stages.of(name)
        for part in (0.3, 1.0):
            before = progress.done
            report(part)
            assert progress.done > before
    assert progress.done == pytest.approx(1.0)


# --- help and progress of the command -------------------------------------------------------------


def test_the_help_says_what_no_fixes_does(capsys):
    assert PROGRAM.main(["identify", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "--no-fixes fit the vertical velocity only" in said
    assert "ten hours of log" in said.lower()


@pytest.mark.parametrize(("vehicle", "warned"), [("seaglider", True), ("slocum-200", False)])
def test_a_vehicle_of_another_kind_than_the_log_s_is_warned_of(vehicle, warned, tmp_path, capsys):
    data = xr.Dataset(
        {"n_samples": ("mission", [3])},
        {"time": [0.0, 0.5, 1.0]},
        {**CONVENTIONS, "source_format": "slocum", READER_VERSION: IMPORT_VERSION},
    )
    path = write_store(data, tmp_path / "real.zarr")
    assert PROGRAM.main(["identify", str(path), "--vehicle", vehicle]) == 2
    said = capsys.readouterr().err
    assert ("warning: vehicle seaglider (seaglider) is of another kind" in said) == warned


def test_a_share_is_percent_and_time_left_and_an_interrupted_task_has_no_last_line():
    clock, stream = iter(np.arange(0.0, 1000.0, 15.0)).__next__, io.StringIO()
    progress = Progress(
        total=1.0, label="identify", unit="", stream=stream, interval_s=30.0, clock=clock
    )
    with progress:
        for _ in range(6):
            progress.update(0.1)
        before = stream.getvalue()
        stop = KeyboardInterrupt()
        progress.__exit__(type(stop), stop, None)
        assert stream.getvalue() == before
    lines = before.splitlines()
    assert len(lines) >= 2
    for line in lines:
        assert re.fullmatch(r"identify: [^/]*%[^/]* left", line)
        assert " of " not in line
