"""Networks for a vehicle of other parts: a torpedo with a propeller, a rudder, an elevator."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import learn
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from learn.__main__ import PROGRAM
from learn.data.stores import parts_of
from learn.training.fit_config import fit_settings
from twin.errors import InputError
from twin.navigation.features import FEATURES, GLIDER_PARTS, feature, mirror_signs, select_features
from twin.vehicle.vehicle import load_vehicle

FILE = Path(__file__).parents[2] / "vehicles" / "torpedo.xml"
PARTS = ("propeller", "rudder", "elevator")
GLIDING = ("pitch_plus_alpha", "steady_flight", "ekf", "flight_filter")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("torpedo") / "missions.zarr"
    changes = {
        "mission.duration_h": "uniform(0.1, 0.15)",
        "mission.segment_duration_s": "uniform(100, 200)",
    }
    generate(make_recipe(hours=0.5, changes=changes, vehicle=str(FILE)), path, workers=1)
    return path


def test_fit_and_evaluate_run_and_say_what_does_not_suit(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    # test_doppler_labels draws the pages of such a vehicle
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    words = ["--seconds", "1", "--members", "1", "--workers", "1", "--name", "torpedo"]
    assert PROGRAM.main(["fit", str(store), *words]) == 0
    said = capsys.readouterr()
    assert "leaving out the paper's test" in said.out + said.err
    assert PROGRAM.main(["evaluate", "torpedo", str(store), "--out", "page"]) == 0
    said = capsys.readouterr()
    assert f"no baseline {', '.join(GLIDING)}: vehicle 'torpedo' has a propeller" in said.err
    assert "networks" in said.out
    run = learn.open_run(Path("runs/torpedo"))
    features = run.networks()["surge"].members[0].features
    assert features[-3:] == ("measured_propeller", "measured_rudder", "measured_elevator")
    figures = learn.evaluate(run, store).figures
    assert 0.0 < figures["surge_mse"] < 1.0
    assert all(figures["baselines"][name]["surge_mse"] is None for name in GLIDING)


def test_inputs_that_the_vehicle_lacks_are_named(store: Path) -> None:
    with pytest.raises(InputError, match=r"'shift' reads measured_shift.*propeller, rudder"):
        fit_settings(store=store, inputs="glider")


def test_a_group_holds_what_the_vehicle_has_of_it() -> None:
    assert select_features(["controls"], (), PARTS) == tuple(f"measured_{p}" for p in PARTS)
    assert select_features(["commands"], (), PARTS) == tuple(f"commanded_{p}" for p in PARTS)
    left = select_features(["attitude", "controls"], ["controls"], PARTS)
    assert left == select_features(["attitude"])
    mixed = select_features(["controls"], (), ("pump", "rudder"))
    assert mixed == ("pump", "measured_rudder")
    with pytest.raises(InputError, match="no input feature is left"):
        select_features(["control_rate"], (), PARTS)


def test_features_of_a_glider_are_those_of_the_table() -> None:
    assert (
        select_features(FEATURES) == select_features(FEATURES, (), GLIDER_PARTS) == tuple(FEATURES)
    )
    with pytest.raises(InputError, match="measured_shift"):
        feature("measured_shift")  # its feature is called shift
    with pytest.raises(InputError, match="sin_pitch"):
        feature("sin_pich")


def test_mirrored_missions_turn_the_rudder_round_and_not_the_elevator(store: Path) -> None:
    signs = mirror_signs([f"measured_{part}" for part in PARTS], parts_of(store))
    np.testing.assert_array_equal(signs, [1.0, -1.0, 1.0])


def test_an_oblique_fin_cannot_be_mirrored() -> None:
    fin = load_vehicle(FILE).part("rudder")
    oblique = dataclasses.replace(fin, axis=(0.0, 0.6, 0.8))
    assert oblique.mirrored() is None
    assert dataclasses.replace(fin, position=(-0.7, 0.1, 0.0)).mirrored() is None
    with pytest.raises(InputError, match="--no-mirror"):
        mirror_signs(["measured_rudder"], {"rudder": oblique.mirrored()})
