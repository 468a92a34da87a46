"""A vehicle's twin beside its logs: what is compared, and what is said of a log that lacks some."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from logs import SHARED, stored
from simulated_logs import CLIMB_PITCH, PITCH, simulated_log

from factory.importing.import_run import import_logs
from factory.samples import Flight
from factory.samples.gliders import write_seaexplorer
from twin.__main__ import PROGRAM
from twin.errors import InputError, StoreError, VehicleError
from twin.identify import check_logs
from twin.identify.log_figures import (
    FigureSamples,
    limit_cycle,
    oscillation_of,
    turn_per_actuator,
)
from twin.identify.replayed_dive import legs_of, turning_of
from twin.records.store import write_store
from twin.vehicle.vehicle import load_vehicle

VEHICLE = "rogue"
FIGURES = {"depth_rate_m_s", "speed_m_s", "pitch_deg", "turn_per_actuator", "heading_sd_deg"}
TORPEDO = Path(__file__).resolve().parents[2] / "vehicles" / "torpedo.xml"


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle(VEHICLE)


@pytest.fixture(scope="module")
def log(vehicle, tmp_path_factory):
    return simulated_log(tmp_path_factory.mktemp("log"), vehicle)


@pytest.fixture(scope="module")
def own(log, vehicle):
    """The log beside the vehicle that flew it."""
    return check_logs(log, vehicle)


def changed(store: Path, out: Path, **signals: float | None) -> Path:
    """A copy of a store of logs; a signal becomes a constant, or is taken out with None."""
    dataset = xr.open_zarr(store).load()
    for name, value in signals.items():
        if value is None:
            dataset = dataset.drop_vars(name)
        else:
            dataset[name] = dataset["measured_depth"] * 0.0 + value
    return write_store(dataset, out)


# --- the comparison -------------------------------------------------------------------------------


def test_a_vehicle_flies_as_its_own_log(own):
    assert own.beyond == []
    for name, way, pitch in (("dive", 1.0, -PITCH), ("climb", -1.0, CLIMB_PITCH)):
        phase = own.phases[name]
        assert phase.twin is not None
        assert way * phase.log.depth_rate > 0.05
        assert phase.twin.depth_rate == pytest.approx(phase.log.depth_rate, rel=0.01)
        assert phase.twin.speed == pytest.approx(phase.log.speed, rel=0.01)
        assert phase.log.pitch == pytest.approx(pitch, abs=0.5)
        assert phase.twin.pitch == pytest.approx(phase.log.pitch, abs=0.1)
        assert phase.twin.parts["pump"] == pytest.approx(phase.log.parts["pump"], abs=1.0)
        assert phase.twin.heading_sd is not None
        assert phase.twin.heading_sd < 1.0
        assert phase.twin.oscillation is None


def test_an_asymmetry_that_the_file_lacks_is_beyond_its_limit(log, vehicle):
    """The log's rudder goes straight at 0: a file whose rudder does so elsewhere is another's."""
    rudder = vehicle.steering["heading"]
    found = check_logs(log, vehicle.replace(**{rudder: {"neutral": 0.1}}))
    said = [text for text in found.beyond if "what turns it is at" in text]
    assert len(said) == 2  # dive and climb
    assert "the file flies no such asymmetry" in said[0]


def test_dives_under_the_thruster_are_left_out_of_the_check(tmp_path, log, vehicle):
    dataset = xr.open_zarr(log).load()
    dataset["thruster_fraction"] = ("mission", np.ones(dataset.sizes["mission"]))
    powered = write_store(dataset, tmp_path / "powered.zarr")
    with pytest.raises(StoreError, match=r"without its thruster \(\d+ ran it\)"):
        check_logs(powered, vehicle)


def test_the_twin_turns_as_its_own_log_by_its_part(log, vehicle, own):
    dive = own.phases["dive"]
    assert dive.same_part
    assert dive.twin is not None
    assert dive.log.turn_per_actuator == pytest.approx(0.043, rel=0.1)
    assert dive.twin.turn_per_actuator == pytest.approx(dive.log.turn_per_actuator, rel=0.1)
    loose = vehicle.replace(
        yaw_moment=(vehicle.flow_frame.yaw_moment[0], 0.5 * vehicle.flow_frame.yaw_moment[1])
    )
    turned = check_logs(log, loose).phases["dive"].twin
    assert turned is not None
    assert turned.turn_per_actuator is not None
    assert abs(turned.turn_per_actuator / dive.twin.turn_per_actuator - 1.0) > 0.1


def test_another_drag_is_seen(log, vehicle):
    draggy = vehicle.replace(drag=tuple(1.5 * k for k in vehicle.flow_frame.drag))
    said = check_logs(log, draggy).describe()
    for phase in ("dive", "climb"):
        assert said["phases"][phase]["ratio"]["depth_rate_m_s"] < 0.9
    assert not said["ok"]
    assert any("depth rate" in text for text in said["beyond"])


def test_the_twin_flies_in_the_water_of_the_log(log, vehicle, tmp_path):
    dense = changed(log, tmp_path / "dense.zarr", measured_density=1003.0)
    phases = check_logs(dense, vehicle).describe()["phases"]
    assert phases["dive"]["ratio"]["depth_rate_m_s"] < 0.95
    assert phases["climb"]["ratio"]["depth_rate_m_s"] > 1.05


def test_what_is_said_is_json_with_the_figures_of_each_phase(own):
    said = json.loads(json.dumps(own.describe()))
    assert said["dives"] == 1
    assert said["legs"] == {"dive": 2, "climb": 2}
    assert set(said["phases"]) == {"dive", "climb"}
    for phase in said["phases"].values():
        assert set(phase["log"]) >= FIGURES
        assert set(phase["twin"]) >= FIGURES
        assert set(phase["limit_cycle"]) == {"log", "twin"}
        assert phase["ratio"]["depth_rate_m_s"] == pytest.approx(
            phase["twin"]["depth_rate_m_s"] / phase["log"]["depth_rate_m_s"]
        )


def test_what_the_log_lacks_is_said(log, vehicle, own, tmp_path):
    lacking = changed(
        log, tmp_path / "lacking.zarr", measured_heading=None, measured_rotation=None,
        true_surge=None,
    )  # fmt: skip
    found = check_logs(lacking, vehicle)
    text = " ".join(found.notes)
    for said in ("no heading", "no density", "no position of what turned it", "it measured none"):
        assert said in text
    log_figures = found.phases["dive"].log
    assert log_figures.heading_sd is None
    assert log_figures.turn_per_actuator is None
    assert log_figures.speed == pytest.approx(own.phases["dive"].log.speed, rel=0.02)


def test_a_rudder_is_not_compared_with_a_battery(log, vehicle, tmp_path):
    ruddered = changed(log, tmp_path / "fin.zarr", measured_rotation=None, measured_fin=3.0)
    found = check_logs(ruddered, vehicle)
    assert found.describe()["turning"]["signal"] == "measured_fin"
    assert "cannot be compared" in " ".join(found.notes)
    assert all(p["ratio"]["turn_per_actuator"] is None for p in found.describe()["phases"].values())


def test_a_rudder_of_any_name_is_the_logs_fin():
    torpedo = load_vehicle(TORPEDO)
    turning = turning_of(torpedo, {"measured_fin"})
    assert turning is not None
    assert (turning.part, turning.signal, turning.same) == ("rudder", "measured_fin", True)


def test_lanes_fly_the_dives_to_the_same_figures(tmp_path):
    # not ROGUE, whose moving battery the Fossen model flies without its reaction
    glider = load_vehicle("glider")
    log = simulated_log(tmp_path, glider)
    usual, lanes = (check_logs(log, glider, engine=engine) for engine in ("mujoco", "lanes"))
    assert usual.beside_mujoco is None
    assert "engine" not in usual.describe()
    said = lanes.describe()
    assert said["engine"] == "lanes"
    way = lanes.flights[0].distance_through_water()[-1]  # type: ignore[union-attr]
    assert 0.0 < said["beside_mujoco"]["position_m"] < 0.003 * way
    assert lanes.beyond == usual.beyond
    for name, phase in usual.phases.items():
        theirs, ours = phase.twin, lanes.phases[name].twin
        assert theirs is not None
        assert ours is not None
        assert ours.depth_rate == pytest.approx(theirs.depth_rate, rel=1e-3)
        assert ours.speed == pytest.approx(theirs.speed, rel=1e-3)
        assert ours.pitch == pytest.approx(theirs.pitch, abs=0.02)
        # on the log's own turns
        assert ours.turn_per_actuator == pytest.approx(theirs.turn_per_actuator, rel=0.01)
    assert all(one.provenance["ended"] == "flown" for one in lanes.flights)  # type: ignore[union-attr]


def test_the_command_says_how_far_lanes_end_from_mujoco(log, capsys):
    words = ["check", "--logs", str(log), "--vehicle", VEHICLE, "--engine"]
    PROGRAM.main([*words, "lanes"])
    assert "dives flown in lanes; of the first one, MuJoCo ends" in capsys.readouterr().out
    assert PROGRAM.main([*words, "lane"]) == 2
    assert PROGRAM.main(["check", "--engine", "lanes"]) == 2
    assert "--engine is of the comparison with logs" in capsys.readouterr().err


# --- errors ---------------------------------------------------------------------------------------


def test_simulated_stores_are_refused(log, vehicle):
    with pytest.raises(StoreError, match="is simulated"):
        check_logs(log.with_name("flown.zarr"), vehicle)


@pytest.mark.parametrize(
    ("signals", "error", "message"),
    [
        ({"measured_pitch": None}, StoreError, "measured_pitch"),
        ({"measured_pump": None}, StoreError, "measured_pump"),
        ({"measured_depth": 4.0}, StoreError, "no whole dive"),
        ({"measured_pump": 9000.0}, InputError, "pump is at 9000 cm3"),
    ],
)
def test_a_log_that_no_glide_explains_is_refused(log, vehicle, tmp_path, signals, error, message):
    with pytest.raises(error, match=message):
        check_logs(changed(log, tmp_path / "bare.zarr", **signals), vehicle)


def test_another_vehicle_or_mission_is_refused(log, vehicle):
    with pytest.raises(VehicleError, match="has no pump"):
        check_logs(log, TORPEDO)
    with pytest.raises(StoreError, match="not 7"):
        check_logs(log, vehicle, missions=[7])


# --- the parts of it ------------------------------------------------------------------------------


def test_legs_are_descents_and_climbs_and_no_waves():
    down, up = np.linspace(0.0, 80.0, 200), np.linspace(80.0, 10.0, 200)
    again = np.linspace(10.0, 60.0, 150)
    depth = np.concatenate([np.zeros(50), down, up, again])
    depth += 0.5 * np.sin(np.arange(len(depth)) / 3.0)
    legs = legs_of(depth)
    assert [leg.phase for leg in legs] == ["dive", "climb", "dive"]
    assert legs[0].bottom == pytest.approx(80.0, abs=0.6)
    assert legs[1].first == legs[0].last
    assert legs[2].last == pytest.approx(len(depth) - 1, abs=10)
    assert legs_of(np.full(30, 3.0)) == []


def leg(heading: np.ndarray, turning: np.ndarray, period: float = 2.0) -> FigureSamples:
    series = {"heading": heading, "turning": turning}
    steady = np.ones(len(heading), bool)
    return FigureSamples(period=period, series=series, positions={}, steady=steady)


@pytest.mark.parametrize("slope", [0.02, -0.015])
@pytest.mark.parametrize("lag", [0.0, 20.0])
def test_turn_per_actuator_is_found_in_a_closed_loop_with_noise(slope, lag):
    rng = np.random.default_rng(3)
    count, period = 2000, 2.0
    heading, turning = np.zeros(count), np.zeros(count)
    rate = 0.0
    for k in range(1, count):
        target = 30.0 if k % 800 > 400 else 0.0
        error = target - heading[k - 1] + rng.normal(0.0, 1.0)
        turning[k] = float(np.clip(np.sign(slope) * 1.5 * error - 4.0, -40.0, 40.0))
        wanted = slope * (turning[k] + 4.0)
        rate = wanted if lag == 0.0 else rate + period / lag * (wanted - rate)
        heading[k] = heading[k - 1] + period * rate
    found = turn_per_actuator([leg(heading + rng.normal(0.0, 0.3, count), turning)])
    assert found == pytest.approx(slope, rel=0.1)


def test_turn_per_actuator_is_not_guessed():
    rng = np.random.default_rng(5)
    heading = np.cumsum(rng.normal(0.0, 0.2, 500))
    assert turn_per_actuator([leg(heading, np.full(500, 3.0))]) is None
    assert turn_per_actuator([leg(heading, rng.normal(0.0, 10.0, 500))]) is None


def test_a_swing_that_goes_on_is_found_and_one_that_dies_out_is_not():
    time = np.arange(0.0, 900.0, 1.0)
    noise = np.random.default_rng(1).normal(0.0, 0.3, len(time))
    swing = 4.0 * np.sin(2.0 * np.pi * time / 12.0)
    found = oscillation_of("roll", swing + noise, 1.0)
    assert found is not None
    assert found.period_s == pytest.approx(12.0, rel=0.02)
    assert found.amplitude_deg == pytest.approx(4.0, rel=0.1)
    assert oscillation_of("roll", swing * np.exp(-time / 100.0) + noise, 1.0) is None
    assert oscillation_of("roll", 5.0 * noise, 1.0) is None
    growing = oscillation_of("pitch", swing * (1.0 + time / 300.0), 1.0)
    assert growing is not None
    assert growing.growth > 1.5
    assert limit_cycle([{"roll": found}, {}, {}, {}, {}], 0.25) is None
    common = limit_cycle([{"roll": found}, {"pitch": growing}, {"roll": found}], 0.5)
    assert common is not None
    assert (common.signal, common.legs) == ("roll", pytest.approx(2 / 3))


def test_a_heading_loop_of_the_wrong_sign_is_beyond_its_limits(log, vehicle):
    wrong = vehicle.replace(heading_pid=tuple(-k for k in vehicle.heading_pid))
    found = check_logs(log, wrong)
    assert not found.describe()["ok"]
    assert any("heading" in text or "swings" in text for text in found.beyond)


# --- the command ----------------------------------------------------------------------------------


def test_the_command_prints_json_and_writes_a_page(log, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("twin.show.figures.page_layout.DPI", 30)
    words = ["check", "--logs", str(log), "--vehicle", VEHICLE]
    code = PROGRAM.main([*words, "--json", "--page", str(tmp_path / "page")])
    said = json.loads(capsys.readouterr().out)
    assert (code == 0) == said["ok"]
    assert said["vehicle"] == load_vehicle(VEHICLE).name
    assert said["store"] == str(log)
    assert set(said["phases"]["climb"]["twin"]) >= FIGURES
    text = Path(said["page"]).read_text()
    assert "turn rate per actuator" in text
    assert (tmp_path / "page" / "dive-0.png").is_file()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--logs", "x.zarr"], "--logs needs --vehicle"),
        (["--page", "here"], "--page is of the comparison with logs"),
        (["--logs", "x.zarr", "--vehicle", "rogue", "--seed", "1"], "--seed is of the manoeuvres"),
        (["--logs", "nowhere.zarr", "--vehicle", "rogue"], "no store at nowhere.zarr"),
    ],
)
def test_the_command_refuses_what_it_would_ignore(words, says, capsys):
    assert PROGRAM.main(["check", *words]) == 2
    assert says in capsys.readouterr().err


# --- logs of real vehicles ------------------------------------------------------------------------


def test_a_seaexplorers_battery_is_found(tmp_path, vehicle):
    path = write_seaexplorer(tmp_path / "sea001.1.gli.csv", Flight(dives=2))
    dataset, _ = import_logs("seaexplorer", [path])
    turning = turning_of(vehicle, set(dataset))
    assert turning is not None
    assert (turning.signal, turning.same) == ("measured_rotation", True)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the public logs are not here")
def test_real_logs_turn_the_other_way_in_climbs(tmp_path):
    folder = SHARED / "seaexplorer_pyglider"
    store = stored(tmp_path / "sea046.zarr", "seaexplorer", [folder / "sea046_M45_gli.csv.gz"])
    said = check_logs(store, "seaexplorer").describe()["phases"]
    dive, climb = (said[name]["log"]["turn_per_actuator"] for name in ("dive", "climb"))
    assert 0.01 < dive < 0.03
    assert -0.04 < climb < -0.01
    shutil.rmtree(store)
