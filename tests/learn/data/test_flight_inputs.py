"""Inputs of the flight filter: for stores of gliders with a CTD, from the store to the C code."""

import dataclasses

import numpy as np
import pytest

import learn
import learn.run
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from learn.data.dataset import load_missions
from learn.data.stores import input_groups
from learn.networks.network_estimator import NetworkVelocity
from twin.errors import InputError, StoreError
from twin.navigation.features import FLIGHT, INPUT_SETS, leave_out, select_features
from twin.navigation.flight_filter import ANY, CLEAN, HULLS
from twin.navigation.flight_filter_kernels import CHANNELS
from twin.navigation.settings import ESTIMATED, estimate
from twin.vehicle.vehicle import load_vehicle

FEATURES = ("flight_surge", "flight_sway", "flight_attack")


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    path = tmp_path_factory.mktemp("field") / "field.zarr"
    changes = {"mission.duration_h": "0.4", "mission.max_depth_m": "60"}
    generate(make_recipe(preset="field", hours=2.4, seed=4, changes=changes), path, workers=1)
    return path


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    path = tmp_path_factory.mktemp("paper") / "paper.zarr"
    generate(make_recipe(hours=0.5, changes={"mission.duration_h": "0.5"}), path, workers=1)
    return path


def test_networks_of_a_glider_with_a_ctd_read_the_flight_filter(field, paper):
    assert input_groups("full", field) == (*INPUT_SETS["full"], FLIGHT)
    assert input_groups("glider", field) == INPUT_SETS["glider"]
    assert input_groups("full", paper) == INPUT_SETS["full"]
    assert set(learn.fit_settings(field).features) > set(FEATURES)
    assert not set(learn.fit_settings(paper).features) & set(FEATURES)
    assert not set(learn.fit_settings(field, without=["flight"]).features) & set(FEATURES)
    # what reads a sensor that the vehicle lacks is left out with it
    for sensor in ("imu", "attitude", "controls"):
        assert not set(select_features(("attitude", "depth_rate", FLIGHT), [sensor])) & set(
            FEATURES
        )


def test_missions_have_what_is_estimated_of_them(field):
    (one,) = load_missions(field, [*ESTIMATED, "true_surge"], limit=1)
    measured = {name: one.signals[name] for name in CHANNELS}
    wanted = estimate(measured, load_vehicle(), one.period, mission=0)
    for name in ESTIMATED:
        assert np.array_equal(one.signals[name], wanted[name])
    gliding = one.signals["measured_depth"] > 10.0
    error = one.signals["estimated_surge"] - one.signals["true_surge"]
    assert np.abs(np.median(error[gliding])) < 0.02 < one.signals["true_surge"][gliding].mean()


def test_a_store_without_a_ctd_is_refused_with_what_to_leave_out(paper):
    with pytest.raises(StoreError, match=r"no channel measured_density.*--without flight_surge"):
        load_missions(paper, ESTIMATED)
    readers = "flight_surge flight_sway flight_attack flight_steady`"
    assert leave_out(["measured_density"]).endswith(readers)


def test_a_run_learns_from_it_and_leaves_the_papers_test_out(field, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    said = []
    run = learn.fit(
        field, folder=tmp_path / "run", epochs=1, members=1, hidden=6, layers=1, say=said.append
    )
    assert set(run.features) > set(FEATURES)
    assert (run.hulls, run.spread) == (CLEAN, HULLS[CLEAN])
    assert any("leaving out the paper's test: its water has one density" in line for line in said)
    assert not (run.folder / "paper-test.json").exists()
    parity = learn.export(run, to="c")["velocity"]
    assert parity.largest < 1e-5
    assert "measured_density" in parity.path.read_text()
    # under way it begins its filter as the training did
    one = load_missions(field, [*ESTIMATED, "true_surge"], limit=1, spread=run.spread)[0]
    stepped = NetworkVelocity(run.networks(), run.period, load_vehicle())
    channels = {name: one.signals[name] for name in stepped.channels if name in one.signals}
    missing = [name for name in stepped.channels if name not in channels]
    channels |= load_missions(field, missing, limit=1)[0].signals
    said = [
        stepped.step({name: float(values[k]) for name, values in channels.items()}).surge
        for k in range(one.samples)
    ]
    assert np.abs(said - run.predict(field)[0].surge).max() < 1e-5
    with pytest.raises(InputError, match="set of inputs"):
        learn.fit_settings(field, inputs="ful")


def test_a_run_begins_its_filter_with_the_hulls_of_its_training(field, tmp_path):
    heavy = tmp_path / "heavy.zarr"
    changes = {
        "mission.duration_h": "0.4", "mission.max_depth_m": "60", "vehicle.k_d0": "1.4",
        "vehicle.k_d": "1.4",
    }  # fmt: skip
    generate(make_recipe(preset="field", hours=1.2, seed=4, changes=changes), heavy, workers=1)
    assert learn.fit_settings(field).hulls == CLEAN
    assert learn.fit_settings(heavy).hulls == ANY
    assert learn.fit_settings([field, heavy]).hulls == ANY
    assert learn.fit_settings(field, without=["flight"]).hulls == ANY  # it reads no filter
    clean, any_hull = (
        load_missions(field, ESTIMATED, limit=1, spread=spread)[0].signals["estimated_surge"]
        for spread in (HULLS[CLEAN], None)
    )
    assert 1e-4 < np.abs(clean - any_hull).max() < 0.05


def test_words_for_hulls_that_are_none_are_refused(field, tmp_path):
    with pytest.raises(InputError, match="unknown hulls 'clear': did you mean 'clean'"):
        dataclasses.replace(learn.fit_settings(field), hulls="clear")
    run = learn.run.Run(tmp_path, {"settings": {"hulls": "clear"}})
    with pytest.raises(StoreError, match="unknown hulls 'clear'"):
        run.spread  # noqa: B018
