"""A vehicle that is no glider passes through the whole of `twin`."""

import functools
import json
from pathlib import Path

import numpy as np
import pytest
from pictures import call, needs_gl
from torpedo import GEOMETRY_ONLY, TORPEDO

import twin
from twin.checks.agreement import check_manoeuvres
from twin.errors import InputError, MissionError, NoSteadyState, VehicleError
from twin.fossen import FossenModel
from twin.identify import load_calibration
from twin.mission import Mission
from twin.mission.controller import Command
from twin.mission.segments import Hold
from twin.physics.fleet import Fleet
from twin.physics.scenario import Scenario
from twin.physics.settle import trim
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle, parse_vehicle

LIMITS = {"speed_m_s": 1e-3, "attitude_deg": 0.1, "position_percent": 0.3}


@pytest.fixture(scope="module")
def torpedo():
    return load_vehicle(TORPEDO)


@pytest.fixture(scope="module")
def survey(torpedo):
    return twin.simulate(vehicle=torpedo, mission="survey")


@pytest.fixture(scope="module")
def store(survey, tmp_path_factory):
    from twin.records.mission_dataset import dataset_of
    from twin.records.store import write_store

    path = tmp_path_factory.mktemp("torpedo") / "survey.zarr"
    return write_store(dataset_of([survey], attributes=survey.provenance), path)


# --- trim and check -------------------------------------------------------------------------------


def test_both_models_trim_any_part_alike(capsys):
    found = []
    for model in ("mujoco", "fossen"):
        words = ("--set", "propeller=80", "--set", "rudder=0.1, elevator=-0.05", "--model", model)
        code, out, _ = call(capsys, "trim", "--vehicle", TORPEDO, *words, "--json")
        assert code == 0
        found.append(json.loads(out))
    ours, theirs = found
    assert ours["positions"] == {"propeller": 80.0, "rudder": 0.1, "elevator": -0.05}
    assert ours["speed_m_s"] == pytest.approx(1.14, abs=0.01)
    assert ours["pitch_deg"] < -10.0
    assert ours["turn_rate_rad_s"] > 0.05
    for name in ("speed_m_s", "pitch_deg", "roll_deg", "turn_rate_rad_s", "sideslip_deg"):
        assert ours[name] == pytest.approx(theirs[name], abs=1e-7), name


@pytest.mark.parametrize("model", ["mujoco", "fossen"])
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ((), 2, "its parts: propeller (0 to 160), rudder (-0.3 to 0.3)"),
        (("--set", "propellor=80"), 2, "did you mean 'propeller'?"),
        (("--set", "propeller=800"), 2, "give a value from 0 to 160 rad/s"),
        (("--set", "propeller"), 2, "--set 'propeller' must be a part and its position"),
        (("--set", "rudder=0", "--set", "rudder=0.1"), 2, "--set gives rudder twice"),
        (("--net-mass", "0.2"), 2, "has no pump; its parts: propeller, rudder, elevator"),
    ],
)
def test_trim_teaches(capsys, model, words, code, message):
    found, out, err = call(capsys, "trim", "--vehicle", TORPEDO, "--model", model, *words)
    assert (found, out) == (code, "")
    assert message in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("hydrodynamics", ["coefficients", "ellipsoid"])
def test_set_says_the_same_as_the_gliders_own_options(hydrodynamics):
    glider = load_vehicle("glider")
    if hydrodynamics == "ellipsoid":
        glider = glider.with_law("ellipsoid")
    usual = trim(glider, 0.02, 0.0, 0.3)
    positions = {"shift": 0.02, "pump": glider.pump_for_net_mass(0.3)}
    assert trim(glider, positions=positions) == usual
    theirs = FossenModel(glider).trim(positions=positions)
    assert theirs.speed_m_s == pytest.approx(usual.speed_m_s, abs=1e-8)
    assert theirs.angle_of_attack_deg == pytest.approx(usual.angle_of_attack_deg, abs=1e-6)


@pytest.mark.parametrize(
    ("fins", "told"),
    [
        ({}, "nothing that steers it is turned: give rudder or elevator a position, or drive it"),
        ({"elevator": 0.05}, "turn elevator less, or drive it at another speed with propeller"),
    ],
)
def test_advice_names_only_what_is_turned(torpedo, fins, told):
    """Fins too small to hold the hull: no position of theirs at rest can be turned less."""
    small = torpedo.replace(rudder={"area": 0.003}, elevator={"area": 0.003})
    for solve in (functools.partial(trim, small), FossenModel(small).trim):
        with pytest.raises(NoSteadyState, match=told):
            solve(positions={"propeller": 100.0, **fins})


def test_manoeuvres_agree_with_fossen(torpedo):
    differences = check_manoeuvres(torpedo, count=4, duration=200.0)
    assert {d.distance_m > 100.0 for d in differences} == {True}
    for name, limit in LIMITS.items():
        assert max(getattr(d, name) for d in differences) < limit, name


def test_geometry_alone_says_hull_and_added_mass():
    vehicle = parse_vehicle(GEOMETRY_ONLY, Path("geometry.xml"))
    # a slender ellipsoid resists more across than along (Lamb 1932, article 114)
    along, across = np.diag(vehicle.added_mass)[:2]
    assert 0.0 < along < 0.1 * across
    plan = Mission(
        name="level",
        start_depth_m=20.0,
        segments=(Hold(parts={"propeller": 60.0, "rudder": 0.05}, duration_s=60.0),),
        at_end="hold",
        duration_s=60.0,
    )
    run = twin.simulate(vehicle=vehicle, mission=plan)
    assert run["true_surge"][-1] > 0.4
    assert abs(run["true_yaw_rate"][-1]) > 0.01
    (found,) = check_manoeuvres(vehicle, count=1, duration=120.0)
    assert found.ok


# --- missions -------------------------------------------------------------------------------------


def test_the_survey_is_flown_and_summarised(capsys, survey):
    assert survey.provenance["ended"] == "flown"
    assert survey.actuators == ("propeller", "rudder", "elevator")
    assert 29.0 < survey["true_depth"].max() < 33.0
    assert survey["true_rudder"].max() <= np.rad2deg(0.3) + 1e-9
    code, out, _ = call(
        capsys, "simulate", "survey", "--vehicle", TORPEDO, "--duration", 60, "--json"
    )
    figures = json.loads(out)
    assert code == 0
    assert list(figures["parts"]) == ["propeller", "rudder", "elevator"]
    assert figures["parts"]["rudder"]["units"] == "degree"
    assert 50.0 < figures["parts"]["propeller"]["max"] < 160.0


@pytest.mark.parametrize("command", ["simulate", "view"])
def test_the_gliders_mission_names_the_one_that_suits(capsys, command, monkeypatch):
    monkeypatch.setattr("twin.show.render.require_screen", lambda: None)
    chosen = ("default",) if command == "simulate" else ("--plan", "default")
    code, _, err = call(capsys, command, *chosen, "--vehicle", TORPEDO)
    assert code == 2
    assert "the shipped mission for such a vehicle is 'survey'" in err
    with pytest.raises(MissionError, match=r"has no propeller .*'default'"):
        twin.simulate(mission="survey")


def test_wrong_parts_get_the_nearest_name(torpedo):
    scenario = {"vehicle": torpedo, "duration": 10.0}
    with pytest.raises(InputError, match="did you mean 'rudder'"):
        twin.simulate(**scenario, controller=lambda seen: Command(ruder=0.1))
    start = Start(depth=20.0, actuators={"elevater": 0.1})
    with pytest.raises(InputError, match="did you mean 'elevator'"):
        twin.simulate(**scenario, controller=lambda seen: Command(), start=start)
    hold = Hold(parts={"propellor": 60.0}, duration_s=10.0)
    with pytest.raises(MissionError, match="did you mean 'propeller'"):
        twin.simulate(vehicle=torpedo, mission=Mission(name="m", segments=(hold,)))
    with pytest.raises(InputError, match="a mission or a controller, not both"):
        twin.simulate(**scenario, mission="survey", controller=lambda seen: Command())
    flown = Scenario(vehicle=torpedo, mission=twin.load_mission("survey"), duration=10.0)
    with pytest.raises(InputError, match="only one of them can command"):
        twin.simulate(flown, controller=lambda seen: Command())


def test_a_fleet_is_of_one_kind(torpedo):
    plan = twin.load_mission("survey")
    scenarios = [
        Scenario(vehicle=torpedo, mission=plan, duration=60.0),
        Scenario(vehicle=load_vehicle("glider"), mission=twin.load_mission(), duration=60.0),
    ]
    with pytest.raises(
        InputError, match=r"vehicles of one kind: .*propeller.*shift.*simulate_many"
    ):
        Fleet(scenarios)


def test_identification_says_what_it_needs(capsys, store):
    code, out, err = call(capsys, "identify", "--vehicle", TORPEDO, store)
    assert (code, out) == (2, "")
    assert "survey.zarr has no measured_depth" in err
    assert len(err.splitlines()) == 1
    with pytest.raises(VehicleError, match="has no flight model"):
        load_calibration(TORPEDO)


# --- stores and pictures --------------------------------------------------------------------------


def test_a_store_keeps_parts_and_states(store, survey):
    read = twin.open_trajectory(store)
    assert read.actuators == survey.actuators
    np.testing.assert_array_equal(read.states, survey.states)
    assert read.state_columns == survey.state_columns
    assert read.state_columns[-6:] == tuple(
        f"{kind}_{part}" for kind in ("act", "ctrl") for part in survey.actuators
    )
    assert len(survey.state_columns) == survey.states.shape[1] == 7 + 6 + 3 + 3


def test_parts_keep_their_order_whatever_the_process_met_before(store, survey):
    from twin.records import schema

    met = list(schema.VARIABLES.items())
    parts = [entry for entry in met if entry[0].endswith(survey.actuators)]
    assert len(parts) >= 2 * len(survey.actuators)
    others = [entry for entry in met if entry not in parts]
    schema.VARIABLES.clear()
    schema.VARIABLES.update([*others, *reversed(parts)])
    try:
        assert twin.open_trajectory(store).actuators == survey.actuators
    finally:
        schema.VARIABLES.clear()
        schema.VARIABLES.update(met)


def test_a_part_must_not_bear_the_name_of_a_signal():
    text = TORPEDO.read_text(encoding="utf-8")
    renamed = text.replace('"rudder', '"roll').replace("rudder.", "roll.")
    vehicle = parse_vehicle(renamed, Path("renamed.xml"))
    with pytest.raises(VehicleError, match="must not be called 'roll'"):
        twin.simulate(vehicle=vehicle, controller=lambda seen: Command(), duration=10.0)


def test_every_figure_is_drawn(capsys, store, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.commands.plot.PRINT_DPI", 40)
    code, _, _ = call(capsys, "plot", store, "--figure", "all", "--out", tmp_path)
    assert code == 0
    assert {"overview.png", "actuator.png"} <= {path.name for path in tmp_path.iterdir()}


def test_readouts_name_the_parts_with_units(store):
    from twin.show.render.hud import readouts
    from twin.show.render.playback import poses

    trajectory = twin.open_trajectory(store)
    shown = {r.name: r.value for r in readouts(poses(trajectory, np.array([250.0])), 0)}
    assert shown["PROPELLER"].endswith(" rad/s")
    assert shown["RUDDER"] == "+8.0°"
    assert shown["ELEVATOR"].endswith("°")


def test_drawn_bodies_turn_as_their_parts_do(store):
    """The rudder by its angle about its axis, the propeller by the integral of its rate."""
    import mujoco

    from twin.show.render.painter import Motion
    from twin.show.render.playback import poses
    from twin.show.render.stage import build
    from twin.show.render.subject import Shot, Subject

    trajectory = twin.open_trajectory(store)
    vehicle = load_vehicle(TORPEDO)
    shot = Shot(camera="chase", start=200.0, end=260.0)
    stage = build(Subject(trajectory=trajectory, vehicle=vehicle), shot)
    data = mujoco.MjData(stage.model)
    motion = Motion(stage, data, lambda mesh, shape: None)
    times = np.array([250.0, 250.01])
    row = poses(trajectory, times)
    motion.place(row, 0, np.zeros(3))

    def turned(part):
        """Angle about the axis, from the body's rotation on the hull."""
        hull, body = data.body("vehicle/hull").xmat, data.body(f"vehicle/{part}").xmat
        relative = hull.reshape(3, 3).T @ body.reshape(3, 3)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, relative.ravel())
        axis = np.zeros(3)
        mujoco.mju_quat2Vel(axis, quaternion, 1.0)
        return axis

    rudder = turned("rudder")
    # the file's axis is up; deflections are right-handed about it
    np.testing.assert_allclose(rudder, [0.0, 0.0, np.deg2rad(8.0)], atol=1e-4)
    before = turned("propeller")[0]
    motion.place(row, 1, np.zeros(3))
    rate = np.interp(250.0, trajectory.time, trajectory["true_propeller"])
    step = (turned("propeller")[0] - before + np.pi) % (2 * np.pi) - np.pi
    assert step == pytest.approx(0.01 * rate, abs=1e-3)


@needs_gl
def test_the_picture_shows_a_propelled_vehicle(store, tmp_path, capsys):
    out = tmp_path / "chase.png"
    words = ("--camera", "chase", "--time", 250, "--size", "320x240", "--out", out)
    assert call(capsys, "render", store, *words)[0] == 0
    assert out.stat().st_size > 5_000


def test_a_live_flight_turns_the_propeller(torpedo):
    from twin.show.render.subject import Live

    live = Live(Scenario(vehicle=torpedo, mission=twin.load_mission("survey")))
    first, second = live.at(30.0), live.at(30.1)
    assert first.joints == ("propeller", "rudder", "elevator")
    turned = second.angles[0, 0] - first.angles[0, 0]
    assert turned == pytest.approx(0.1 * first.parts[0, 0], rel=0.05)


# --- cost -----------------------------------------------------------------------------------------


def test_the_bench_times_it(capsys):
    code, out, _ = call(
        capsys, "bench", "--vehicle", TORPEDO, "--rounds", 1, "--threads", 1, "--json"
    )
    assert code == 0
    assert json.loads(out)["us_per_step"] > 0.0
