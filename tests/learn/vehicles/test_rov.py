"""Networks of an ROV: `learn fit` needs a store of preset `rov` and no option."""

import numpy as np
import pytest

import learn
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from learn.__main__ import PROGRAM
from learn.data.preparation import prepare
from learn.training.fit_config import fit_settings
from twin.errors import InputError
from twin.navigation.estimators import open_velocity_estimator
from twin.navigation.features import select_features
from twin.records.reader import MissionStore
from twin.vehicle.vehicle import load_vehicle

PARTS = load_vehicle("bluerov2").part_names


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    path = tmp_path_factory.mktemp("rov") / "missions.zarr"
    recipe = make_recipe(preset="rov", hours=1.0, vehicle="bluerov2", engine="lanes", seed=3)
    generate(recipe, path, workers=1)
    return path


def test_the_inputs_of_an_rov_are_its_commands_and_no_mission_is_mirrored(store):
    config = fit_settings(store)
    assert [name for name in config.features if name.endswith(tuple(PARTS))] == [
        f"commanded_{name}" for name in PARTS
    ]
    assert {"sin_roll", "yaw_rate", "specific_force_y", "depth_rate"} <= set(config.features)
    assert not {"glide_speed", "gravity_glide_speed"} & set(config.features)
    assert not config.mirror
    with pytest.raises(InputError, match="--no-mirror"):  # by itself only in the settings of a fit
        prepare(store, target="sway", features=config.features)


def test_inputs_without_thrusters_are_mirrored(store):
    assert fit_settings(store, features=("attitude", "gyroscope", "accelerometer")).mirror
    assert not fit_settings(store, features=("attitude", "controls")).mirror
    assert fit_settings(store, inputs="thrusters").features == select_features(
        ("attitude", "gyroscope", "accelerometer", "depth_rate", "commands"), (), PARTS
    )


def test_fit_without_options_learns_more_than_rest(store, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["fit", str(store), "--name", "rov", "--seconds", "3", "--members", "1"]
    assert PROGRAM.main([*words, "--no-report", "--workers", "1"]) == 0
    assert "missions are not mirrored: parts such as thrusters" in capsys.readouterr().err
    run = learn.open_run(tmp_path / "runs" / "rov")
    figures = learn.evaluate(run, store).figures
    with MissionStore(store) as reader:
        still = np.mean([np.nanmean(reader.row("true_surge", k) ** 2) for k in range(len(reader))])
    assert 0.0 < figures["surge_mse"] < 0.5 * still
    network = open_velocity_estimator(f"network:{run.folder}", load_vehicle("bluerov2"), run.period)
    assert network.deviation.noise == pytest.approx(0.3 * network.deviation.scale)  # its cruise
