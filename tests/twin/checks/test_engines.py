"""The two engines side by side, and what a bench of the second one flies."""

import dataclasses
import json

import numpy as np
import pytest

from twin.__main__ import PROGRAM
from twin.checks import engines
from twin.checks.agreement import Difference, draw_manoeuvre
from twin.checks.step_cost import CURRENT, DENSITY, bench_lanes, bench_scenario
from twin.physics.lanes import Lane, LaneBlock
from twin.physics.scenario import ENGINES
from twin.physics.simulation import simulate
from twin.records.reader import MissionStore
from twin.vehicle.vehicle import load_vehicle


def test_many_manoeuvres_are_flown_by_both_engines(capsys):
    words = ["check", "--many", "3", "--vehicle", "slocum-200", "--seed", "4", "--json"]
    assert PROGRAM.main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ok"]
    assert found["manoeuvres"] == 3
    (one,) = found["vehicles"]
    assert (one["vehicle"], one["flown"], one["unstable"]) == ("slocum-200", 3, [])
    for name, limit in engines.LIMITS.items():
        values = [found["quantiles"][name][share] for share in ("50", "90", "99", "100")]
        assert 0.0 < values[0] <= values[1] <= values[2] <= values[3] < limit
    assert found["worst"]["seed"] in (4, 5, 6)
    # MuJoCo's integrator has order 2: its change falls by four when its step is halved
    assert one["steps"]["falls"]["mujoco"] == pytest.approx(4.0, rel=0.25)
    error = one["steps"]["lanes_error"]
    assert 0.0 < error["attitude_deg"] < 0.1
    assert 0.0 < error["position_percent"] < 0.3


def test_the_worst_manoeuvre_is_that_of_its_seed():
    """Each of the figures is what both engines make of that seed again."""
    vehicles = [load_vehicle("graver-2005"), load_vehicle("slocum-200")]
    found = engines.check_engines(vehicles, count=4, seed=7)
    assert [[d.seed for d in one.differences] for one in found.vehicles] == [[7, 9], [8, 10]]
    name, difference = found.worst()  # type: ignore[misc]
    vehicle = load_vehicle(name)
    manoeuvre = draw_manoeuvre(vehicle, difference.seed)
    ours, theirs = (
        simulate(manoeuvre.scenario(vehicle, duration=600.0, engine=engine)) for engine in ENGINES
    )
    assert engines.compare(ours, theirs, difference.seed) == difference


def test_what_is_beyond_a_limit_is_told():
    sound = Difference(
        seed=1, speed_m_s=1e-4, attitude_deg=0.01, position_percent=0.01, distance_m=200.0
    )
    few = [sound] * 99 + [dataclasses.replace(sound, seed=2, attitude_deg=0.4)]
    one = engines.VehicleAgreement(vehicle="mine", differences=few, unstable=[], steps=None)
    assert one.beyond() == []  # one in a hundred may be there, within five times the limit
    far = dataclasses.replace(one, differences=[*few, dataclasses.replace(sound, speed_m_s=0.1)])
    assert any("100 % of the manoeuvres are within 0.1 in speed_m_s" in t for t in far.beyond())
    lost = dataclasses.replace(one, unstable=[3])
    assert lost.beyond() == ["mine: manoeuvre 3 went unstable"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["check", "--many", "0"], "--many must be at least 1"),
        (["check", "--many", "3", "--timestep", "0.1"], "--timestep does not go with --many"),
        (["check", "--many", "3", "--seed", "-1"], "--seed must be 0 or more"),
        (["bench", "--engine", "lanes", "--rounds", "3"], "leave it out with lanes"),
    ],
)
def test_options_that_do_not_go_together_are_refused(words, message, capsys):
    assert PROGRAM.main(words) == 2
    assert message in capsys.readouterr().err


def test_the_bench_flies_what_users_fly(tmp_path, capsys):
    """A lane of its block has the log of `twin simulate --engine lanes`, bit for bit."""
    vehicle = load_vehicle("tethys")
    lanes = [Lane(bench_scenario(vehicle, number)) for number in range(9)]
    logs = LaneBlock(lanes).fly()
    out = tmp_path / "run.zarr"
    words = ["--vehicle", "tethys", "--current", CURRENT, "--density", DENSITY, "--json"]
    assert PROGRAM.main(["simulate", "--engine", "lanes", "--out", str(out), *words]) == 0
    assert json.loads(capsys.readouterr().out)["engine"] == "lanes"
    flown = simulate(bench_scenario(vehicle))
    rows, _ = logs[0]
    states = np.concatenate([rows["qpos"], rows["qvel"], rows["act"], rows["ctrl"]], axis=1)
    np.testing.assert_array_equal(states, flown.states)
    with MissionStore(out) as store:
        kept = store.row("true_north", 0)
    np.testing.assert_array_equal(kept, rows["qpos"][:, 0].astype(kept.dtype))
    np.testing.assert_array_equal(rows["current"][:, 0], flown["true_current_north"])
    assert len({float(log["qpos"][-1, 0]) for log, _ in logs}) == len(lanes)  # each goes its way


def test_the_bench_of_lanes_tells_its_parts():
    found = bench_lanes(load_vehicle("tethys"), threads=1)
    assert (found.missions, found.timestep_s) == (64, 0.05)
    assert 1000.0 < found.times_real_time_to_signals < found.times_real_time
    assert found.times_real_time_one_core < found.limit_one_core
    assert found.part_of_limit == found.times_real_time_one_core / found.limit_one_core
    assert found.ns_per_step == pytest.approx(5e7 / found.times_real_time_one_core)
