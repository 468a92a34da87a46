"""Propelled vehicles: made-up runs by every method, runs that are left out, and public runs."""

import dataclasses
import json

import numpy as np
import pytest
from logs import SHARED, sailfish_columns

from benchmarks import command
from benchmarks.real_logs import propelled, propelled_networks
from benchmarks.real_logs.__main__ import main
from benchmarks.real_logs.propelled_combination import gain
from benchmarks.real_logs.propelled_runs import Run, gather, gridded
from benchmarks.real_logs.propelled_speeds import METHODS
from benchmarks.real_logs.row import Row, keep, markdown
from benchmarks.real_logs.row import kept as read
from factory.samples import write_csv
from learn.networks.base import NetworkConfig
from twin.navigation.propelled_surge import Propulsion, ThrustBalance

TIME = np.arange(0.0, 240.0)


def made(number, vehicle="made-up"):
    """A run that drives and dives for two minutes and stands before and after."""
    rng = np.random.default_rng(number)
    on = (TIME > 30.0) & (TIME < 150.0)
    speed = np.where(on, 0.8 + 0.1 * number, 0.0)
    depth = np.where(on, 4.0 + 2.0 * np.sin(0.1 * TIME), 4.0)
    chain = Propulsion(speed, speed, depth, np.zeros(TIME.size), 1.0)
    surge = ThrustBalance(thrust=1.2).surge(chain) + 0.01 * rng.normal(size=TIME.size)
    rates = 0.02 * rng.normal(size=(3, TIME.size)) * (0.1 + surge)
    signals = dict(zip("pqr", rates, strict=True))
    rate = np.gradient(depth)
    signals |= {
        "roll": np.zeros(TIME.size), "heading": np.zeros(TIME.size), "depth": depth,
        "pitch": -np.arcsin(np.clip(rate / np.maximum(surge, 0.5), -0.9, 0.9)), "propeller": speed,
    }  # fmt: skip
    sway = -1.1 * signals["r"]
    return Run(
        vehicle=vehicle, name=str(number), period=1.0, signals=signals, surge=surge, sway=sway
    )


def answers(runs):
    """Folds of runs by vehicle, and what the methods answer."""
    jobs = propelled.folds(runs, None, 0, None)
    return jobs, [propelled.run(job) for job in jobs]


def test_every_method_is_scored_and_the_balance_of_thrust_knows_an_unseen_run():
    runs = {"made-up": [made(k) for k in range(4)], "other": [made(5, "other"), made(6, "other")]}
    rows = propelled.rows_of(runs, *answers(runs))
    assert {row.task for row in rows} == set(propelled.TASKS)
    surge = {r.method: r for r in rows if r.task == propelled.SURGE and r.data == "made-up"}
    assert set(METHODS) < set(surge)
    assert surge["balance of thrust"].value < 0.3 * surge["constant speed"].value
    assert surge["combination"].value < 0.5 * surge["constant speed"].value
    bounds = {r.method: r.value for r in rows if r.task == propelled.BOUND and r.data == "made-up"}
    assert bounds[propelled.FLOORS[1]] < surge["linear in rpm"].value  # one of its lines
    assert propelled.FLOORS[1] in markdown(rows, propelled.BOUND)
    assert surge["balance of thrust"].low < surge["balance of thrust"].value
    standing = {r.method: r.value for r in rows if r.task == propelled.STANDING}
    assert standing["standing, found"] > 60.0
    assert standing["moving, taken for standing"] < 2.0
    path = {r.method: r.value for r in rows if r.task == propelled.PATH and r.data == "made-up"}
    assert path["constant speed"] < path[propelled.PLAIN]
    ratio = {r.method: r for r in rows if r.task == propelled.RATIO and r.data == "made-up"}
    assert ratio["combination"].high < 1.0
    assert all(one.value < 1.02 for one in ratio.values())  # methods that do harm are shrunk
    assert "| other |" in markdown(rows, propelled.LEFT_OUT).replace("made-up | ", "| ")


def test_no_method_reads_the_velocity_of_the_run_that_is_left_out():
    runs = [made(k) for k in range(3)]
    _, before = answers({"made-up": runs})
    lost = dataclasses.replace(runs[0], surge=np.full(TIME.size, np.nan), sway=runs[0].sway + 1.0)
    jobs = propelled.folds({"made-up": [lost, *runs[1:]]}, None, 0, None)
    (after,) = propelled.run(jobs[0])
    for name, velocity in before[0][0].items():
        np.testing.assert_array_equal(velocity, after[name], err_msg=name)


def test_the_default_of_a_log_is_the_best_of_its_first_half():
    run = made(0)
    wrong = np.full((2, TIME.size), 0.4)
    found = {"constant speed": wrong, "combination": np.stack([run.surge, run.sway])}
    second, kept = propelled.halves(run, found)
    assert second.surge.size == TIME.size // 2
    np.testing.assert_array_equal(kept[propelled.DEFAULT][0], second.surge)
    still = dataclasses.replace(run, surge=np.zeros(TIME.size))
    assert propelled.halves(still, found) is None


def test_networks_are_kept_for_the_next_call(tmp_path, monkeypatch):
    asked = []

    def predicted(parts, tests, pretrained, seed):
        asked.append(tests[0].name)
        runs = [*(run for _, held in parts for run in held), *tests]
        return [{n: np.stack([r.surge, r.sway]) for n in propelled.NETWORKS} for r in runs]

    monkeypatch.setattr(propelled, "network_velocities", predicted)
    (job, *_) = propelled.folds({"made-up": [made(0), made(1)]}, {}, 0, tmp_path)
    (first,), (second,) = propelled.run(job), propelled.run(job)
    assert asked == ["0"]
    assert set(propelled.NETWORKS) < set(first)
    for name, velocity in first.items():
        np.testing.assert_array_equal(velocity, second[name])


def test_a_method_is_kept_by_what_it_gains_in_every_held_out_run():
    wanted = [made(k).surge - 0.9 for k in range(5)]
    for scale, kept in ((1.0, 1.0), (2.0, 0.5), (-1.0, 0.0)):
        assert gain([scale * off for off in wanted], wanted, range(5)) == pytest.approx(kept)
    signs = (1.0, -1.0, 1.0, -1.0, 0.1)
    by_chance = [sign * off for sign, off in zip(signs, wanted, strict=True)]
    assert gain(by_chance, wanted, range(5)) < 0.1
    assert gain(wanted, wanted, [7] * 5) == 0.0  # one vehicle says nothing of another


def iver2(folder, runs=3):
    """Write logs of an Iver2 whose last line is cut off."""
    folder.mkdir(parents=True)
    for k in range(runs):
        run = made(k)
        table = np.full((TIME.size, 35), 0.0)
        table[:, 0], table[:, 3] = TIME + 5.0, run.signals["depth"]
        table[:, 4:7] = np.degrees([run.signals[n] for n in ("roll", "pitch", "heading")]).T
        table[:, 10], table[:, 11] = -run.surge, -run.sway
        table[:, 17], table[:, 19] = 12.0 * run.signals["propeller"], 8e3 * run.signals["propeller"]
        table[:3, 10] = 999.0
        lines = [" ".join(f"{value:.3f}" for value in row) for row in table]
        name = folder / f"IverControlData-2022091305{k:02d}00.log"
        name.write_text("\n".join([*lines, "1.0 2.0"]) + "\n", encoding="utf-8")


def test_the_command_reads_both_kinds_of_tables_and_keeps_its_rows(tmp_path, capsys):
    iver2(tmp_path / "data" / "auv_iver2_2022")
    (tmp_path / "data" / "auv_sailfish").mkdir()
    write_csv(tmp_path / "data" / "auv_sailfish" / "20220701_0_0.csv", sailfish_columns())
    vehicles, refused = gather(tmp_path / "data")
    assert not refused
    assert {name: len(runs) for name, runs in vehicles.items()} == {"Iver2": 3, "Sailfish": 1}
    run = vehicles["Iver2"][1]
    assert np.isnan(run.surge[:3]).all()
    np.testing.assert_allclose(run.surge[3:], made(1).surge[3:], atol=1e-3)
    assert np.median(run.signals["propeller"][run.moving]) == pytest.approx(1.0, abs=0.15)
    options = ["--only", "propelled", "--no-networks", "--workers", "1", "--json"]
    kept = tmp_path / "rows.json"
    keep([Row(task="depth rate", data="a", method="m", kind="twin", value=1.0)], kept)
    code = command.run(main, [str(tmp_path / "data"), *options, "--keep", str(kept)])
    said = capsys.readouterr()
    assert code == 0, said.err
    tasks = {row["task"] for row in json.loads(said.out)["rows"]}
    assert {propelled.SURGE, propelled.PATH, propelled.LEFT_OUT} <= tasks
    assert {row.task for row in read(kept)} == {*tasks, "depth rate"}


def test_values_on_a_grid_are_means_and_rates_come_from_the_attitude():
    time = np.arange(0.0, 60.0, 0.25)
    columns = {
        "roll": np.zeros(time.size), "pitch": np.zeros(time.size), "heading": 0.1 * time,
        "surge": np.where(time < 2.0, np.nan, time), "sway": np.zeros(time.size),
    }  # fmt: skip
    run = gridded("a", "b", time, columns)
    assert run.surge.size == 60
    assert np.isnan(run.surge[:2]).all()
    np.testing.assert_allclose(run.surge[2:], np.arange(2.0, 60.0) + 0.375)
    np.testing.assert_allclose(run.signals["r"], 0.1)


@pytest.mark.skipif(not (SHARED / "auv_iver2_2022").is_dir(), reason="the public logs are not here")
def test_public_runs_are_known_better_than_by_a_constant_speed():
    vehicles, _ = gather(SHARED)
    some = {name: runs for name, runs in vehicles.items() if name in ("Iver2", "Sailfish")}
    assert [len(runs) for runs in some.values()] == [14, 3]
    jobs = [job for job in propelled.folds(some, None, 0, None) if job.own]
    rows = propelled.rows_of(some, jobs, [propelled.run(job) for job in jobs])
    surge = {(r.data, r.method): r for r in rows if r.task == propelled.SURGE}
    assert surge["Iver2", "combination"].value < 0.16
    assert surge["Sailfish", "combination"].value < surge["Sailfish", "constant speed"].value
    assert surge["Iver2", "constant speed"].value > 0.4
    assert surge["Sailfish", "noise of the rates"].value < 0.6
    assert surge["Sailfish", "constant speed"].value > 0.7
    found = {(r.data, r.method): r.value for r in rows if r.task == propelled.STANDING}
    assert found["Iver2", "standing, found"] > 80.0
    assert found["Sailfish", "standing, found"] > 75.0


def test_each_network_predicts_held_out_and_left_out_runs(monkeypatch):
    small = NetworkConfig(kind="elman", hidden=4, layers=1, delays=2)
    monkeypatch.setattr(propelled_networks, "ELMAN", small)
    brief = dataclasses.replace(propelled_networks.SCG, epochs=10, validations=2)
    monkeypatch.setattr(propelled_networks, "SCG", brief)
    for name in (propelled.NETWORKS[0], propelled.NETWORKS[2]):
        monkeypatch.setitem(propelled_networks.TRAININGS, name, brief)
    runs = [made(k) for k in range(5)]
    lost = dataclasses.replace(runs[0], surge=np.where(TIME < 60.0, np.nan, runs[0].surge))
    names = propelled_networks.INPUTS[-1]
    slow = [dataclasses.replace(run, surge=0.5 * run.surge) for run in runs]  # as simulation is off
    table = {t: propelled_networks.pretrain(slow, names, t, 0) for t in propelled_networks.TARGETS}
    parts = [([lost, *runs[1:3]], [runs[3]])]
    found = propelled_networks.network_velocities(parts, [runs[4]], {names: table}, 0)
    assert [set(one) for one in found] == [set(propelled.NETWORKS)] * 2
    for one in found:
        assert all(velocity.shape == (2, TIME.size) for velocity in one.values())
        assert all(np.isfinite(velocity).all() for velocity in one.values())
    alone, tuned = (found[1][propelled.NETWORKS[k]][0] for k in (1, 2))
    assert np.abs(alone - tuned).max() > 1e-4  # real runs change what simulation taught
