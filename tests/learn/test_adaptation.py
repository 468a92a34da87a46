"""A run that adapts to a vehicle: `learn adapt`, and what is flown, judged, exported after it."""

import dataclasses
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import learn
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from learn.__main__ import PROGRAM
from learn.data.dataset import load_missions
from learn.evaluation.score import summarise_scores
from learn.networks.c_export import FLAGS, c_header, export_c, find_compiler, run_c
from learn.networks.familiarity import Tether
from learn.networks.network_estimator import NetworkVelocity
from learn.networks.predictor import Adapted
from learn.report import verdicts
from learn.run import ADAPTATION, FAMILIARITY, FILTER, TETHER, Run, open_run, write_description
from twin.errors import InputError, StoreError
from twin.navigation.features import channels_of
from twin.navigation.flight_filter import FlightSpread, FlightStart
from twin.navigation.settings import ESTIMATED, estimate_adapted
from twin.records.store import open_store, write_store
from twin.vehicle.vehicle import load_vehicle

SMALL = {"epochs": 1, "hidden": 6, "layers": 1, "members": 1, "workers": 1}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a run of the preset `family`, and two missions of a fouled hull."""
    folder = tmp_path_factory.mktemp("adaptation")
    dives = {"mission.duration_h": "1.5", "mission.yos": "1", "mission.max_depth_m": "60"}
    generate(
        make_recipe(preset="family", hours=3.0, seed=1, changes=dives), folder / "train.zarr",
        workers=1,
    )  # fmt: skip
    fouled = dives | {"vehicle.k_d0": "1.5", "vehicle.k_d": "1.5"}
    generate(
        make_recipe(preset="field", hours=3.0, seed=2, changes=fouled), folder / "heavy.zarr",
        workers=1,
    )  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
        patch.chdir(folder)
        learn.fit(folder / "train.zarr", folder=folder / "runs" / "first", **SMALL)
    return folder


def test_an_adapted_run_is_judged_flown_and_exported_as_any_other(place):
    origin = open_run(place / "runs" / "first")
    run, fit = learn.adapt(origin, place / "heavy.zarr", place / "runs" / "calypso", missions=(0,))
    assert fit.start is not None
    assert fit.factors["drag"][0] == pytest.approx(np.log(1.5), abs=0.08)
    again = open_run(run.folder)
    assert again.adapted == run.adapted != origin.adapted
    assert again.description[ADAPTATION]["from"] == str(origin.folder)
    ours, theirs = (one.predict(place / "heavy.zarr")[0] for one in (again, origin))
    (mission,) = load_missions(
        place / "heavy.zarr", [*ESTIMATED, "true_surge", *channels_of(again.features)], limit=1
    )
    true = mission.signals["true_surge"]
    gliding = mission.signals["measured_depth"] > 5.0
    errors = [np.sqrt(np.mean((p.surge - true)[gliding] ** 2)) for p in (ours, theirs)]
    assert errors[0] < 0.7 * errors[1]  # of so small a network
    assert np.array_equal(ours.sway, theirs.sway)  # the networks read what they were trained on

    vehicle = load_vehicle()
    estimator = NetworkVelocity.open(str(run.folder), vehicle, mission.period)
    kept = 4000
    found, stated = np.empty(kept), np.empty((kept, 2))
    for k in range(kept):
        found[k] = estimator.step({c: mission.signals[c][k] for c in estimator.channels}).surge
        stated[k] = tuple(estimator.intervals.values())
    assert np.allclose(found, ours.surge[:kept], atol=2e-5)
    assert stated[:, 0].max() > 1.01 * stated[:, 0].min()  # less in steady glides
    assert stated[:, 1].min() >= again.error_model().sway_interval > 0.0
    other = NetworkVelocity.open(str(run.folder), vehicle, mission.period)
    other.restore(estimator.state())
    sample = {c: mission.signals[c][kept] for c in estimator.channels}
    assert other.step(sample) == estimator.step(sample)
    coverage = learn.evaluate(again, place / "heavy.zarr", split="all", baselines=())
    assert 0.0 < coverage.figures["uncertainty"]["surge_within"] < 1.0
    if shutil.which("cc") is not None:
        networks = again.networks()
        start = networks["surge"].start
        signals = dict(mission.signals)
        signals |= estimate_adapted(signals, vehicle, mission.period, start)
        one = type(mission)(index=0, split="all", period=mission.period, signals=signals)
        parity = export_c(networks, place / "glider_velocity.h", one, vehicle)
        assert parity.largest < 1e-5
        said, _ = run_c(parity.path, networks, one, find_compiler())
        assert np.abs(said[:, 0] - theirs.surge).max() > 5e-3  # it is the adapted one
        assert np.allclose(said[:kept, 2:], stated, rtol=1e-4)


@pytest.mark.parametrize("adapts", [False, True])
def test_on_another_kind_of_vehicle_the_surge_is_held_to_the_filter_s(place, adapts):
    run = open_run(place / "runs" / "first")
    assert run.description[TETHER]["models"] == ["glider"]
    assert run.tether(None) is run.tether(load_vehicle()) is None
    assert run.strange(load_vehicle()) == ""
    assert "trained on glider and on none of the kind of slocum" in run.strange(
        load_vehicle("slocum-200")
    )
    slocum, own = load_vehicle("slocum-200"), load_vehicle()
    assert (
        run.networks(slocum)["surge"].tether
        == run.tether(slocum)
        == Tether(run.description[TETHER]["most"])
    )
    (mission,) = load_missions(
        place / "heavy.zarr", [*ESTIMATED, *channels_of(run.features)], limit=1
    )
    held, free = run.networks(slocum), run.networks(own)
    if adapts:
        start = FlightStart.of(np.full(7, 0.01), np.diag((0.1 * FlightSpread().prior) ** 2), 1e-2)
        adapted = Adapted(start=start, deviation=0.002)
        held, free = (
            {n: dataclasses.replace(e, adapted=adapted) for n, e in one.items()}
            for one in (held, free)
        )
        mission.signals.update(estimate_adapted(mission.signals, own, mission.period, start))
    ours, theirs = (one["surge"].predict([mission])[0][0] for one in (held, free))
    assert np.abs(ours - theirs).max() > 5e-3  # so small a network is far off
    estimator, kept = NetworkVelocity(held, mission.period, own), 2000
    other = NetworkVelocity(held, mission.period, own)
    for k in range(kept):
        sample = {c: mission.signals[c][k] for c in estimator.channels}
        assert estimator.step(sample).surge == pytest.approx(ours[k], abs=2e-5)
    other.restore(estimator.state())
    sample = {c: mission.signals[c][kept] for c in estimator.channels}
    assert other.step(sample) == estimator.step(sample)
    if shutil.which("cc") is not None:
        assert export_c(held, place / "held.h", mission, own).largest < 1e-5
        assert "For the vehicle glider alone." in (place / "held.h").read_text()
    broken = Run(run.folder, run.description | {TETHER: {"models": []}})
    with pytest.raises(StoreError, match="its tether is not one"):
        broken.networks(own)


def test_the_weight_of_the_filter_goes_with_its_variance():
    size = 7
    start = FlightStart.of(np.zeros(size), np.eye(size), 1e-2)
    adapted = Adapted(start=start, deviation=0.002)
    assert adapted.weight(1.0, 0.002) == pytest.approx(0.5)
    assert adapted.weight(1.0, 0.0) == 1.0
    assert adapted.weight(0.0, 0.0) == 0.0


def test_the_command_says_what_it_found_and_what_does_not_do(place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    words = ["adapt", "first", "heavy.zarr", "--missions", "1", "--labels", "dvl", "--name", "two"]
    assert PROGRAM.main([*words, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["changed"] is True
    assert said["adaptation"]["log"] is True
    assert PROGRAM.main(words) == 2  # a run of that name is there
    assert PROGRAM.main([*words, "--overwrite"]) == 0
    table = capsys.readouterr().out
    assert "of held-back glides" in table
    for name, unit in (("drag", "ln of the factor"), ("ballast", "kg"), ("pitch_x", "rad")):
        assert re.search(rf"^{name} .* {unit}$", table, re.MULTILINE)
    assert PROGRAM.main([*words[:3], "--missions", "7"]) == 2
    assert "has no mission 7: it has 3" in capsys.readouterr().err
    origin = open_run("first")
    with pytest.raises(InputError, match="--dives 0"):
        learn.adapt(origin, "heavy.zarr", Path("runs/none"), dives=0)
    assert not Path("runs/none").exists()


@pytest.mark.parametrize(
    ("lacks", "labels", "told"),
    [("roll_rate", "none", "reads it; `twin identify` fits a glider"),
     ("dvl_surge", "dvl", "`--labels none`"), ("depth", "none", "the files that hold it$")],
)  # fmt: skip
def test_a_log_that_lacks_a_channel_is_sent_where_it_is_taken(place, tmp_path, lacks, labels, told):
    """Not to networks without the flight filter, which adapting refuses."""
    whole = open_store(place / "heavy.zarr").isel(mission=slice(0, 1)).load()
    store = write_store(whole.drop_vars(f"measured_{lacks}"), tmp_path / "bare.zarr")
    with pytest.raises(StoreError, match=f"no channel measured_{lacks}.*{told}") as refused:
        learn.adapt(place / "runs" / "first", store, tmp_path / "x", labels=labels)
    assert "--without" not in str(refused.value)
    whole["measured_pitch"][0, 9] = np.nan
    store = write_store(whole, tmp_path / "hole.zarr")
    with pytest.raises(StoreError, match=r"not finite at 1 samples.*repair the store$"):
        learn.adapt(place / "runs" / "first", store, tmp_path / "x", labels=labels)


def test_networks_that_do_not_read_the_filter_cannot_adapt(place):
    run = open_run(place / "runs" / "first")
    plain = [name for name in run.features if not name.startswith("flight_")]
    run = dataclasses.replace(
        run, description={**run.description, "settings": {"features": plain, "members": 1}}
    )
    with pytest.raises(InputError, match="do not read the flight filter"):
        learn.adapt(run, place / "heavy.zarr", place / "runs" / "x")


def test_networks_that_learned_to_read_another_filter_are_refused(place):
    run = open_run(place / "runs" / "first")
    before = {name: v for name, v in run.description["versions"].items() if name != FILTER}
    with pytest.raises(StoreError, match=r"flight filter 1, and this program has 3: fit the run"):
        Run(run.folder, run.description | {"versions": before}).networks()
    plain = [name for name in run.features if not name.startswith("flight_")]
    settings = run.description["settings"] | {"features": plain}
    Run(run.folder, run.description | {"versions": before, "settings": settings}).networks()


def test_a_damaged_adaptation_is_named(place):
    run = open_run(place / "runs" / "first")
    broken = place / "runs" / "broken"
    shutil.copytree(run.folder, broken)
    start = {"constants": [0.0], "deviations": [1.0], "correlation": [[1.0]], "depth_rate": 1e-2}
    write_description(broken, {**run.description, ADAPTATION: {"start": start}})
    with pytest.raises(StoreError, match="its adaptation is not one"):
        open_run(broken).networks()


def test_a_hull_outside_of_the_training_is_told_of_in_reports_and_on_board(place):
    origin = open_run(place / "runs" / "first")
    familiar = origin.familiar
    inside = np.array(familiar.mean)
    assert familiar.outside(inside)[0] == 0.0
    heavy = inside + np.eye(len(inside))[0] * 6.0 * familiar.deviation[0]
    assert familiar.outside(heavy) == (pytest.approx(2.0), "drag")
    # a training that knew only hulls as their file says
    narrow = {"mean": [0.0] * 7, "deviation": FlightSpread(drag=0.058).prior.tolist()}
    sure = Run(origin.folder, {**origin.description, FAMILIARITY: narrow})
    wide, told = (
        learn.evaluate(one, place / "heavy.zarr", split="all", baselines=()).figures["outside"]
        for one in (origin, sure)
    )
    assert told["share"] == 1.0
    assert told["constant"] == "drag"
    assert told["median"] == pytest.approx(np.log(1.5) / (3.0 * 0.058), rel=0.1)
    assert 0.0 <= wide["share"] <= 1.0
    sentence = next(s for s in verdicts(told_of(told)) if s.startswith("Hulls outside"))
    assert "100 % of the missions" in sentence
    assert "learn adapt" in sentence

    networks, vehicle = sure.networks(), load_vehicle()
    estimator = NetworkVelocity(networks, sure.period, vehicle)
    assert estimator.outside == 0.0
    (mission,) = load_missions(place / "heavy.zarr", estimator.channels, limit=1)
    rows = [{c: mission.signals[c][k] for c in estimator.channels} for k in range(4000)]
    for row in rows:
        estimator.step(row)
    assert estimator.outside > 1.0
    if shutil.which("cc") is not None:
        said = _outside_in_c(networks, vehicle, sure.period, rows, place)
        wanted = (estimator.outside, *estimator.intervals.values())
        assert said == pytest.approx(wanted, rel=1e-5)
        known = sure.error_model().surge_interval
        assert said[1] == pytest.approx(known * estimator.outside, rel=1e-5)
    broken = Run(origin.folder, {**origin.description, FAMILIARITY: {"mean": [0.0]}})
    with pytest.raises(StoreError, match="its familiarity has no mean of 7 constants"):
        broken.networks()


def told_of(outside):
    empty = summarise_scores(())
    return {**empty, "baselines": {}, "floor": empty, "outside": outside}


def _outside_in_c(networks, vehicle, period, rows, folder):
    (folder / "glider_velocity.h").write_text(c_header(networks, period, vehicle))
    samples = ",".join("{" + ",".join(repr(float(v)) for v in row.values()) + "}" for row in rows)
    (folder / "outside.c").write_text(
        f"""
#include "glider_velocity.h"
#include <stdio.h>
static const glider_sample samples[] = {{{samples}}};
int main(void)
{{
    static glider_state state;
    glider_velocity velocity;
    glider_reset(&state);
    for (int k = 0; k < {len(rows)}; k++)
        glider_step(&state, samples + k, &velocity);
    const float stated[] = {{velocity.surge_deviation, velocity.sway_deviation}};
    printf("%.9g %.9g %.9g", (double)glider_outside(&state), (double)stated[0], (double)stated[1]);
    return 0;
}}
"""
    )
    command = [*find_compiler(), *FLAGS, "outside.c", "-o", "outside", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    said = subprocess.run([folder / "outside"], capture_output=True, check=True).stdout
    return tuple(map(float, said.split()))
