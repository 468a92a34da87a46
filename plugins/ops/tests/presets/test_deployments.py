"""Deployments with and without a fault: exactly half, the same draw of the same seed."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from factory.importing import EMPTY, Channel, DeploymentLog, DiveRules, LoggedFixes, Tally
from factory.importing.dives.dive_store import build
from glider_twin_ops.presets import deployments
from glider_twin_ops.presets.deployment import DeploymentPlan, check_steered, fault_kinds, faulty_of
from glider_twin_ops.presets.deployments import first_draw, log_of
from glider_twin_ops.presets.pilot import LogGaps
from twin import SawTooth, load_vehicle
from twin.errors import InputError, MissionError, TwinError


def test_one_of_each_pair_has_a_fault():
    for seed in range(5):
        faulty = [faulty_of(seed, index) for index in range(40)]
        assert sum(faulty) == 20
        assert all(a != b for a, b in zip(faulty[::2], faulty[1::2], strict=True))


def test_a_draw_follows_from_seed_and_number():
    plan = DeploymentPlan(vehicle=load_vehicle("slocum-200"), seed=5, kinds=("attached",))
    one, again = (plan.draw(3, 0, True) for _ in range(2))
    assert one.fault == again.fault
    assert one.scenario.mission == again.scenario.mission
    assert one.kind == "attached"
    assert 0.0 < one.fault.start < one.scenario.run_time()
    low, high = type(one.fault).sizes
    assert low <= one.fault.size <= high
    healthy = plan.draw(3, 0, False)
    assert healthy.kind == "none"
    assert np.isnan(healthy.onset)


def test_what_a_vehicle_cannot_have_is_refused():
    with pytest.raises(InputError, match="cannot show fault 'blade_lost'"):
        fault_kinds(load_vehicle("slocum-200"), ("blade_lost",))
    with pytest.raises(InputError, match="preset 'field' is none of"):
        DeploymentPlan(vehicle=load_vehicle("slocum-200"), preset="field")


def test_hours_are_filled_by_draws_that_are_made_once(monkeypatch):
    plan = DeploymentPlan(vehicle=load_vehicle("slocum-200"), seed=5)
    made, draw = [], DeploymentPlan.draw

    def counted(self, index, attempt, faulty):
        made.append((index, attempt))
        return draw(self, index, attempt, faulty)

    monkeypatch.setattr(DeploymentPlan, "draw", counted)
    draws = deployments._lasting(plan, 200.0)
    assert sum(one.scenario.run_time() for one in draws) >= 200.0 * 3600.0
    assert len(draws) % 2 == 0
    assert len(set(made)) == len(made)
    assert [one.number for one in draws] == list(range(len(draws)))


def test_a_draw_that_guidance_cannot_plan_is_drawn_again_and_a_wrong_wish_is_not(monkeypatch):
    plan = DeploymentPlan(vehicle=load_vehicle("slocum-200"), seed=5)

    def refused(self, index, attempt, faulty):
        if attempt < 2:
            raise MissionError("too heavy")
        return SimpleNamespace(attempt=attempt)

    monkeypatch.setattr(DeploymentPlan, "draw", refused)
    assert first_draw(plan, 0).attempt == 2
    monkeypatch.setattr(deployments, "ATTEMPTS", 2)
    with pytest.raises(TwinError, match="2 draws cannot be flown; the last: too heavy"):
        first_draw(plan, 0)
    monkeypatch.undo()
    wrong = DeploymentPlan(vehicle=plan.vehicle, kinds=("attached",), size=-1.0)
    with pytest.raises(InputError, match="drag"):
        first_draw(wrong, 0 if faulty_of(0, 0) else 1)


def test_a_sound_vehicle_that_circles_is_drawn_again():
    time = np.arange(0.0, 8000.0, 4.0)
    flown = {"true_depth": np.full(time.size, 50.0), "commanded_heading": np.full(time.size, 30.0)}
    flown["true_heading"] = np.where(time < 4000.0, 30.0, 200.0)

    class Flown(SimpleNamespace):
        def __getitem__(self, name):
            return self.signals[name]

    track = Flown(time=time, signals=flown)
    check_steered(SimpleNamespace(fault=SimpleNamespace(start=4000.0)), track)
    with pytest.raises(TwinError, match="circled before"):
        check_steered(SimpleNamespace(fault=None), track)


def test_echoes_that_are_missing_stay_missing_in_the_log():
    time = np.arange(0.0, 12_000.0, 4.0)
    dived = 60.0 * np.abs(np.sin(np.pi * time / 3000.0))
    heard = np.arange(time.size) % 20 == 0  # one of twenty
    channels = {
        "measured_depth": Channel(time, dived),
        "measured_pitch": Channel(time, np.where(np.gradient(dived) > 0.0, -25.0, 25.0)),
        "measured_heading": Channel(time, np.full(time.size, 30.0)),
        "measured_altitude": Channel(time[heard], 80.0 - dived[heard]),
    }
    log = DeploymentLog(
        deployment="one", platform="simulated", channels=channels, magnetic_variation=EMPTY,
        fixes=LoggedFixes(np.zeros(0), np.zeros(0), np.zeros(0)), simulated=True,
    )  # fmt: skip
    dives, _ = build(
        [log], kind="slocum", period=4.0, rules=DiveRules(), tally=Tally(), files=["one"]
    )
    under = np.isfinite(dives["measured_depth"].values)
    told = np.isfinite(dives["measured_altitude"].values)[under].mean()
    assert told == pytest.approx(0.05, abs=0.02)


def test_a_propelled_vehicle_has_no_deployments_of_a_glider(tmp_path):
    with pytest.raises(InputError, match="'remus' has a propeller; choose a glider"):
        deployments.make_deployments(tmp_path / "none.zarr", vehicle="remus", hours=2.0)
    assert not list(tmp_path.iterdir())


def test_a_pilot_changes_settings_and_the_log_has_gaps():
    """Depths from 20 m to the rated one, blocks of equal settings, test dives with one yo."""
    plan = DeploymentPlan(vehicle=load_vehicle("slocum-200"), preset="piloted", seed=5)
    teeth, gaps = [], []
    for index in range(12):
        draw = first_draw(plan, index)
        assert draw.scenario.mission == first_draw(plan, index).scenario.mission
        teeth.append([s for s in draw.scenario.mission.segments if isinstance(s, SawTooth)])
        gaps.append(draw.gaps)
    depths = np.array([tooth.max_depth_m for each in teeth for tooth in each])
    assert depths.min() < 30.0
    assert 150.0 < depths.max() < 200.0 * 1.15  # jitter of 3 % about the rated depth
    for each in teeth:
        changes = np.abs(np.diff([math.log(tooth.max_depth_m) for tooth in each]))
        assert np.median(changes) < 0.1 < changes.max()
    assert any(each[0].yos == 1.0 and each[0].max_depth_m < 70.0 for each in teeth)
    for name in ("thruster", "without_ctd", "lost"):
        having = sum(bool(getattr(one, name)) for one in gaps)
        assert 0 < having < len(gaps)
    assert "compass_turned" in plan.kinds
    assert "compass_turned" not in DeploymentPlan(vehicle=plan.vehicle).kinds


def test_a_compass_that_turns_leaves_the_logged_heading_as_ordered_and_turns_the_way():
    vehicle = load_vehicle("slocum-200")
    plan = DeploymentPlan(vehicle=vehicle, preset="piloted", kinds=("compass_turned",), size=12.0)
    draw = next(d for k in range(4) if (d := first_draw(plan, k)).fault is not None)
    fault = dataclasses.replace(draw.fault, start=3600.0)
    flight = dataclasses.replace(draw.scenario, faults=(fault,), duration=7200.0, current=None)
    draw = dataclasses.replace(draw, fault=fault, scenario=flight, gaps=LogGaps())
    run = twin.simulate(flight, sensors="ideal")
    log = log_of(draw, {**run.signals, "time": run.time}, plan)
    ordered, reads = (log.channels[f"{n}_heading"].values for n in ("commanded", "measured"))
    known = np.isfinite(run["commanded_heading"])
    np.testing.assert_array_equal(ordered, run["commanded_heading"][known])

    def off(values, late):
        used = (run["true_depth"] > 10.0)[known] & ((run.time > 4500.0) == late)[known]
        away = (values - ordered + 180.0) % 360.0 - 180.0
        return np.median(away[used & ((run.time < 3600.0) | (run.time > 4500.0))[known]])

    for late in (False, True):
        assert off(reads[known], late) == pytest.approx(0.0, abs=2.0)
    turned = off(run["true_heading"][known], True)
    assert turned == pytest.approx(-fault.degrees, abs=2.0)


def test_gaps_take_samples_out_and_a_thruster_is_in_the_log():
    time, dive = 1e9 + 10.0 * np.arange(100), np.arange(100) // 10
    names = ("measured_depth", "measured_temperature")
    channels = {name: Channel(time, np.ones(100)) for name in names}
    gaps = LogGaps(thruster=(2,), without_ctd=(5, 6), lost=((300.0, 400.0),))
    found = gaps.applied(channels, time, dive)
    left = {name: set(((one.time - time[0]) // 100.0).tolist()) for name, one in found.items()}
    assert left["measured_depth"] == set(range(10)) - {3}
    assert left["measured_temperature"] == set(range(10)) - {3, 5, 6}
    ran = gaps.ran(time, dive)["thruster"]
    assert np.array_equal(ran.values > 0.0, dive == 2)
    assert LogGaps().ran(time, dive) == {}
