"""Energy: work of the pump, drives and hotel load, as signals of missions and in summaries."""

import json
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.__main__ import PROGRAM
from twin.errors import UnknownName, VehicleError
from twin.records.mission_dataset import summarise
from twin.records.reader import MissionStore
from twin.vehicle.consumption import Consumption, needed_signals
from twin.vehicle.parts import Move
from twin.vehicle.vehicle import load_vehicle, parse_vehicle


@pytest.fixture(scope="module")
def dive():
    return twin.simulate(duration=1500.0)


def test_the_pump_takes_its_work_against_the_sea(dive):
    """p dV over the efficiency, of what is pushed out; letting in is free."""
    vehicle, losses = load_vehicle("glider"), Consumption()
    volume, depth = dive["true_pump"] * 1e-6, dive["true_depth"]
    pressure = vehicle.reference_density * vehicle.gravity * depth + losses.hull_vacuum
    middle = 0.5 * (pressure[1:] + pressure[:-1])
    work = np.where(np.diff(volume) > 0.0, middle * np.diff(volume), 0.0).sum()
    assert dive["true_energy_pump"][-1] == pytest.approx(work / losses.pump_efficiency, rel=1e-9)
    still = np.flatnonzero(np.diff(volume) < 0.0)
    assert np.diff(dive["true_energy_pump"])[still] == pytest.approx(0.0)


LOSSLESS = Consumption(
    hotel_power=0.0, pump_efficiency=1.0, hull_vacuum=0.0, screw_efficiency=1.0,
    rail_friction=0.0, bearing_torque=0.0,
)  # fmt: skip


@pytest.mark.parametrize(
    ("part", "before", "after", "pitch", "raised"),
    [
        ("shift", 0.0, 0.01, 90.0, 0.01),  # forward is up where the nose is up
        ("shift", 0.01, 0.0, 90.0, 0.0),
        ("shift", 0.01, 0.0, -90.0, 0.01),
        ("shift", 0.0, 0.01, -90.0, 0.0),
        ("shift", 0.0, 0.01, 30.0, 0.005),
        ("shift", 0.0, 0.01, 0.0, 0.0),
        # [rad] from below the axis to beside it, in parts of the eccentricity
        ("rotation", 0.0, 0.5 * np.pi, 0.0, 1.0),
        ("rotation", 0.0, -0.5 * np.pi, 0.0, 1.0),
        ("rotation", 0.5 * np.pi, 0.0, 0.0, 0.0),
        ("rotation", 0.0, 0.5 * np.pi, 60.0, 0.5),
        ("rotation", 0.0, 0.5 * np.pi, 90.0, 0.0),  # the axis is upright
    ],
)
def test_a_battery_takes_the_work_of_raising_it(part, before, after, pitch, raised):
    vehicle = load_vehicle("glider")
    metres = raised * (vehicle.battery.eccentricity if part == "rotation" else 1.0)
    move = Move(before, after, depth=50.0, pitch=np.radians(pitch), duration=1.0)
    taken = vehicle.part(part).energy(vehicle, move, LOSSLESS)
    weight = vehicle.battery.mass * vehicle.gravity
    assert taken == pytest.approx(weight * metres, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("pitch", "part"), [(30.0, 0.5), (-30.0, 0.0), (90.0, 1.0)])
def test_signals_tell_the_pitch_in_degrees(pitch, part):
    """10 cm forward is 5 cm up where the nose is 30 degrees up, and down where it is down."""
    vehicle, time = load_vehicle("glider"), np.array([0.0, 10.0])
    signals = {name: np.zeros(2) for name in needed_signals(vehicle)}
    signals |= {"true_pitch": np.full(2, pitch), "true_shift": np.array([-0.05, 0.05])}
    taken = LOSSLESS.signals(vehicle, signals, time)["true_energy_shift"]
    weight = vehicle.battery.mass * vehicle.gravity
    np.testing.assert_allclose(taken, [0.0, 0.1 * part * weight], rtol=1e-9, atol=1e-9)


def test_energy_rises_with_time_and_its_parts_add_up(dive):
    names = [name for name in dive if name.startswith("true_energy_")]
    assert names == [f"true_energy_{n}" for n in ("hotel", "shift", "rotation", "pump")]
    assert all((np.diff(dive[name]) >= 0.0).all() and dive[name][0] == 0.0 for name in names)
    assert dive["true_energy_hotel"][-1] == pytest.approx(0.3 * dive.time[-1])
    figures = summarise(dive)
    assert sum(figures["energy_kJ"].values()) == pytest.approx(figures["total_energy_kJ"])
    km = figures["horizontal_distance_m"] / 1e3
    assert figures["energy_per_km_kJ"] == pytest.approx(figures["total_energy_kJ"] / km)


def test_a_summary_of_what_has_no_energy_is_null(dive):
    bare = {n: v for n, v in dive.signals.items() if not n.startswith("true_energy_")}
    figures = summarise(twin.Trajectory(time=dive.time, signals=bare, states=dive.states))
    assert figures["energy_kJ"] == {}
    assert np.isnan(figures["energy_per_km_kJ"])


def test_a_stored_mission_gives_the_energy_of_the_flown_one(dive, tmp_path):
    path = dive.save(tmp_path / "dive.zarr")
    with MissionStore(path) as store:
        again = store.energy(0)
        double = store.energy(0, Consumption(hotel_power=0.6))
    for name, values in again.items():
        assert values == pytest.approx(dive[name], rel=1e-4, abs=0.02), name
    assert double["true_energy_hotel"] == pytest.approx(2.0 * again["true_energy_hotel"])
    assert twin.open_trajectory(path)["true_energy_pump"] == pytest.approx(
        dive["true_energy_pump"], rel=1e-6
    )


def test_a_vehicle_says_its_own_hotel_load():
    glider = load_vehicle("glider")
    own = '\n  <custom><numeric name="hotel_power" data="1.5"/>'
    vehicle = parse_vehicle(glider.xml.replace("\n  <custom>", own, 1), Path("own.xml"))
    assert Consumption.of(vehicle) == Consumption(hotel_power=1.5)
    run = twin.simulate(vehicle=vehicle, duration=60.0)
    assert run["true_energy_hotel"][-1] == pytest.approx(1.5 * 60.0)
    wrong = parse_vehicle(vehicle.xml.replace('data="1.5"', 'data="-1"'), Path("own.xml"))
    with pytest.raises(VehicleError, match=r"own\.xml: consumption: hotel_power = -1"):
        Consumption.of(wrong)


def test_a_missing_signal_is_named(dive):
    few = {"true_depth": dive["true_depth"], "true_pitch": dive["true_pitch"]}
    with pytest.raises(UnknownName, match="true_shift"):
        Consumption().signals(load_vehicle("glider"), few, dive.time)


def test_simulate_prints_energy_and_takes_sensors(capsys, tmp_path):
    out = tmp_path / "run.zarr"
    words = f"simulate --duration 300 --sensors field --seed 3 --out {out}".split()
    assert PROGRAM.main([*words, "--density", "thermocline", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert set(answer["energy_kJ"]) == {"hotel", "shift", "rotation", "pump"}
    assert answer["energy_per_km_kJ"] > 0.0
    stored = twin.open_trajectory(out)
    same = twin.simulate(duration=300.0, sensors="field", seed=3, density="thermocline")
    for name in ("measured_pitch", "measured_temperature", "measured_dvl_surge"):
        assert stored[name] == pytest.approx(same[name], rel=1e-6, nan_ok=True), name


def test_simulate_says_where_there_is_no_ctd(capsys):
    assert PROGRAM.main(["simulate", "--duration", "60", "--sensors", "field"]) == 0
    assert "this water column has only density" in capsys.readouterr().err
    assert PROGRAM.main(["simulate", "--duration", "60", "--seed", "4"]) == 2
    assert "--seed is for the sensors" in capsys.readouterr().err
    assert PROGRAM.main(["simulate", "--duration", "60", "--sensors", "feild"]) == 2
    assert "did you mean 'field'" in capsys.readouterr().err
