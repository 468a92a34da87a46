"""The benchmarks of `make bench` run as they are told to, and print their figures."""

import importlib
import json
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from examples import ROOT
from logs import SHARED, stored

import benchmarks.left_out_kinds
import factory
from benchmarks import (
    command,
    current_sampling,
    one_scene,
    sensor_cost,
    suite_step,
    vector_env,
    window_reading,
)
from benchmarks.closed_loop import attitude_floor, box, suite_of
from benchmarks.current_floor import Dives, misses_of, way_errors
from benchmarks.real_logs import yo_yos
from benchmarks.smoothed_tracks import figures
from factory.importing import import_logs
from factory.samples import Flight
from glider_twin_protocols.auv_samples import write_mat
from twin.errors import InputError
from twin.records.store import write_store
from twin.sensors import SensorSuite

MAKEFILE = Path(__file__).parents[2] / "Makefile"


def numbers(line):
    """The numbers after the name that a line begins with."""
    return [float(word) for word in re.findall(r"(?<= )[0-9.]+(?= |$)", line)]


def test_make_bench_names_programs_that_can_be_run():
    names = re.search(r"^BENCHMARKS := (.*)$", MAKEFILE.read_text(), re.M)
    assert names is not None
    programs = [importlib.import_module(f"benchmarks.{name}") for name in names[1].split()]
    assert len(programs) > 8
    for program in programs:
        assert f"python -m {program.__name__}" in (program.__doc__ or "")


def test_every_device_of_the_preset_has_a_cost(monkeypatch, capsys):
    monkeypatch.setattr(sensor_cost, "REPEATS", 1)
    sensor_cost.main()
    _, *rows = capsys.readouterr().out.partition("\n\n")[0].splitlines()
    assert [row.split()[0] for row in rows] == list(SensorSuite.preset("field"))
    assert all(numbers(row)[0] > 0.0 for row in rows)


def test_currents_and_tasks_have_a_cost(monkeypatch, capsys):
    monkeypatch.setattr(current_sampling, "REPEATS", 1)
    current_sampling.main()
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) > 8
    assert all(float(row.split()[-2]) > 0.0 for row in rows)
    monkeypatch.setattr(suite_step, "REPEATS", 1)
    monkeypatch.setattr(sys, "argv", ["suite_step"])
    suite_step.costs()
    _, *rows = capsys.readouterr().out.splitlines()
    assert {"hold", "depth"} <= {row.split()[0] for row in rows}
    assert all(np.all(np.array(numbers(row)) > 0.0) for row in rows)


def test_windows_are_read_in_every_way(monkeypatch, capsys):
    monkeypatch.setattr(window_reading, "ROUNDS", 1)
    monkeypatch.setattr(window_reading, "SLICES", 1)
    assert window_reading.main(hours=1.0, memory_mb=0.5) == 0
    rows = capsys.readouterr().out.splitlines()[2:]
    assert len(rows) == 6


# --- The closed loop's budget: which device is ideal, and what the attitude alone costs


def test_one_device_or_all_others_are_made_ideal():
    field, ideal = SensorSuite.preset("field"), SensorSuite.preset("ideal")
    without, only = suite_of("field", without="compass"), suite_of("field", only="compass")
    for name in field:
        assert without[name] == (ideal if name == "compass" else field)[name]
        assert only[name] == (field if name == "compass" else ideal)[name]
    with pytest.raises(SystemExit, match="did you mean 'compass'"):
        suite_of("field", without="compas")


class Run(dict):
    """As a trajectory."""

    time = 0.5 * np.arange(1000)


def test_the_floor_is_what_a_wrong_heading_makes_of_the_way():
    zeros = np.zeros(1000)
    run = Run(true_surge=zeros + 0.4, true_sway=zeros, true_heave=zeros)
    for name in ("roll", "pitch", "heading"):
        run[f"true_{name}"] = zeros
        run[f"measured_{name}"] = zeros + (1.0 if name == "heading" else 0.0)
    way = 0.4 * 0.5 * 600
    assert attitude_floor(run, 600) == pytest.approx(2.0 * way * math.sin(math.radians(0.5)))


def test_a_box_is_swung_before_on_request():
    plain, swung = box(100.0), box(100.0, swing=2)
    assert [one.kind for one in swung.segments] == ["spiral", "spiral", "waypoint"]
    assert swung.segments[2] == plain.segments[0]


# --- The floor of a navigator that knows the law of the sea's currents


HOUR = 3600.0


def steady(rng, seas, noise, scale=0.0):
    """Three dives of an hour in one steady current, north alone, of 0.1 m/s either way."""
    way = np.array([900.0 + 0j, 800.0j, -700.0 + 0j])
    current = HOUR * rng.normal(0.0, 0.1, 1) * np.ones(3) + 0j
    error = scale * rng.standard_normal() * way
    error = error + noise * (rng.standard_normal(3) + 1j * rng.standard_normal(3))
    drawn = HOUR * rng.normal(0.0, 0.1, (seas, 1)) * np.ones(3) + 0j
    return Dives(over_ground=way + current + error, way=way, current=current, seas=drawn)


def test_what_one_dive_told_leaves_the_noise_of_the_ways():
    """Normal currents and errors: the miss is Kalman's, and the first one the current's."""
    rng, noise = np.random.default_rng(0), 20.0
    size = np.array([1e-6, 1e-6, noise])
    found = np.array([misses_of(steady(rng, 300, noise), size, 300) for _ in range(400)])
    mean_of_two = np.sqrt(np.pi / 2.0)  # mean length of two normal numbers of deviation 1
    before = 0.1 * HOUR / np.sqrt(2.0)  # of each axis, since every angle is as likely
    for k in (1, 2):
        known = 1.0 / np.sqrt(before**-2 + k * noise**-2)
        expected = mean_of_two * np.hypot(known, noise)
        assert found[:, k].mean() == pytest.approx(expected, rel=0.1)
    assert found[:, 0].mean() == pytest.approx(0.1 * HOUR * np.sqrt(2.0 / np.pi), rel=0.15)


def test_errors_of_the_ways_are_found_beside_the_true_current():
    rng = np.random.default_rng(1)
    missions = [steady(rng, 0, 15.0, scale=0.04) for _ in range(300)]
    scale, turn, noise = way_errors(missions)
    assert scale == pytest.approx(0.04, rel=0.15)
    assert noise == pytest.approx(15.0, rel=0.1)
    assert turn < 0.01


# --- Depth rates of yo-yos: of logs, of a twin, and what cannot be compared


SHORE = SHARED / "lrauv_shore_2013"


def triangle(down, up, period=2.0):
    """Three yo-yos of 50 m."""
    one = np.concatenate([np.arange(0.0, 50.0, down * period), np.arange(50.0, 0.0, -up * period)])
    return np.tile(one, 3)


def test_rates_are_those_of_the_legs():
    found = yo_yos.rates([(triangle(0.2, 0.25), 2.0)])
    assert np.median(found.down) == pytest.approx(0.2, rel=0.01)
    assert np.median(found.up) == pytest.approx(0.25, rel=0.01)
    assert len(found.down) == len(found.up) == 3
    assert found.bottom == pytest.approx(50.0, abs=0.5)


def test_a_leg_with_a_hole_is_left_out():
    depth = triangle(0.2, 0.25)
    depth[20:80] = np.nan  # in the first descent
    assert len(yo_yos.rates([(depth, 2.0)]).down) == 2
    with pytest.raises(InputError, match="the depth never turns round"):
        yo_yos.rates([(np.full(100, 3.0), 2.0)])


def test_the_pitch_of_the_logs_rates():
    assert yo_yos.matching_pitch([10.0, 20.0], [0.1, 0.3], 0.2) == pytest.approx(15.0)
    assert math.isnan(yo_yos.matching_pitch([10.0, 20.0], [0.1, 0.3], 0.4))


def test_the_command_prints_logs_and_twin(tmp_path, capsys):
    flight = Flight(depth=40.0, speed=1.0, pitch=15.0, surface=600.0, step=2.0)
    stored(tmp_path / "shore.zarr", "lrauv", [write_mat(tmp_path / "log.mat", flight)])
    words = [str(tmp_path / "shore.zarr"), "--vehicle", "tethys", "--pitch", "12", "18", "--json"]
    assert command.run(yo_yos.main, words) == 0
    answer = json.loads(capsys.readouterr().out)
    logs, gentle, steep = answer["rows"]
    assert logs["down [m/s]"] == pytest.approx(math.sin(math.radians(15.0)), rel=0.1)
    assert gentle["down [m/s]"] < logs["down [m/s]"] < steep["down [m/s]"]
    assert 12.0 < answer["matching_pitch_deg"]["down"] < 18.0
    assert command.run(yo_yos.main, [str(tmp_path / "none.zarr")]) == 2
    assert "none.zarr" in capsys.readouterr().err


@pytest.mark.skipif(not SHORE.is_dir(), reason="needs the shared LRAUV logs")
def test_the_shore_logs(tmp_path):
    write_store(import_logs("lrauv", [SHORE])[0], tmp_path / "shore.zarr")
    found = yo_yos.logged(tmp_path / "shore.zarr")
    # as others computed it from the same files: 0.230 and 0.245
    assert np.median(found.down) == pytest.approx(0.23, abs=0.005)
    assert np.median(found.up) == pytest.approx(0.245, abs=0.005)


# --- The benchmarks of many vehicles run and print what they measure


pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")


def test_rates_stand_beside_their_limit(monkeypatch, capsys):
    monkeypatch.setattr(vector_env, "ROUNDS", 1)
    monkeypatch.setattr(vector_env, "SECONDS", 0.01)
    vector_env.main(vehicles=8, lanes=9)
    head, columns, *rows = capsys.readouterr().out.splitlines()
    assert "8 vehicles" in head
    assert "9 in lanes" in head
    names = ["task", "vector", "bare", "batch", "part", "single", "times", "lanes", "us"]
    assert columns.split() == names
    assert [row.split()[0] for row in rows] == list(vector_env.TASKS)
    assert all(float(cell) > 0.0 for row in rows for cell in row.split()[1:])


def test_a_scene_has_as_many_gliders_as_asked_for():
    model = one_scene.scene(2)
    assert model.nu == 2 * one_scene.scene(1).nu
    assert one_scene.cost(model) > 0.0


# --- The smoother beside the linear correction on simulated missions with all their errors


def test_under_water_it_errs_by_at_most_0_6_of_the_linear_correction(tmp_path):
    path = tmp_path / "field.zarr"
    factory.generate(path, preset="field", hours=10.0, seed=7200)
    found = figures(path)
    assert found["smoother_by_linear"] <= 0.6
    assert found["smoother_normalised"] == pytest.approx(1.0, abs=0.25)


# --- Networks on kinds of gliders that were left out of their training: its figures


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    return benchmarks.left_out_kinds


def test_the_ratio_is_of_means_of_the_same_missions(bench):
    near = np.linspace(0.2, 2.0, 40)
    each = {0: 3.0 * near, 5: 2.0 * near}
    methods = {
        "flight filter": {0: near},
        "networks of the others": each,
        "networks of the kind": {0: near, 5: near},
    }
    answer = bench.figures({"spray": methods})
    ratio = answer["spray"]["ratio"]
    assert ratio["value"] == pytest.approx(2.0)
    assert ratio["interval"] == pytest.approx((2.0, 2.0))  # paired: it is twice on every mission
    shown = answer["spray"]["methods"]["networks of the others"]["5"]
    low, high = shown["interval"]
    assert shown["dr_velocity_percent"] == pytest.approx(each[5].mean())
    assert low < each[5].mean() < high
    filtered, others, own = bench.rows(answer)
    assert "5 dives, %" not in filtered  # it does not adapt
    assert others["ratio"] == "2.00 (2.00 to 2.00)"
    assert "ratio" not in own


def test_no_kind_is_tested_on_the_seed_that_it_was_trained_on(bench):
    tiers = bench.recipes(100.0)
    assert list(tiers) == list(bench.KINDS)
    seeds = [one["seed"] for tier in tiers.values() for one in (tier.train, tier.test)]
    assert len(set(seeds)) == 2 * len(tiers)
    for kind, tier in tiers.items():
        assert tier.train["vehicle"] == tier.test["vehicle"] == kind
        assert tier.test["changes"]["vehicle.k_d0"] == "1.4"
