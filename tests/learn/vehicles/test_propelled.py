"""Networks for a vehicle of other parts: a torpedo with a propeller, a rudder, an elevator."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import learn
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from learn.__main__ import PROGRAM
from learn.data.labels import LabelConfig
from learn.data.stores import parts_of
from learn.report import result_tables
from learn.report.contents import Contents
from learn.report.run_page import FIGURES
from learn.report.track_figures import (
    BESIDE_DVL,
    doppler_error_figure,
    ground_lines,
    with_bottom_lock,
)
from learn.run import open_run
from learn.training.fit_config import fit_settings
from twin.errors import InputError
from twin.navigation.features import FEATURES, GLIDER_PARTS, feature, mirror_signs, select_features
from twin.vehicle.vehicle import load_vehicle

FILE = Path(__file__).parents[2] / "vehicles" / "torpedo.xml"
PARTS = ("propeller", "rudder", "elevator")
GLIDING = ("pitch_plus_alpha", "steady_flight", "ekf", "flight_filter")


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    path = tmp_path_factory.mktemp("torpedo") / "missions.zarr"
    changes = {
        "mission.duration_h": "uniform(0.1, 0.15)",
        "mission.segment_duration_s": "uniform(100, 200)",
    }
    generate(make_recipe(hours=0.5, changes=changes, vehicle=str(FILE)), path, workers=1)
    return path


def test_fit_and_evaluate_run_and_say_what_does_not_suit(store, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # the runs of Doppler logs below draw the pages of such a vehicle
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


def test_inputs_that_the_vehicle_lacks_are_named(store):
    with pytest.raises(InputError, match=r"'shift' reads measured_shift.*propeller, rudder"):
        fit_settings(store=store, inputs="glider")


def test_a_group_holds_what_the_vehicle_has_of_it():
    assert select_features(["controls"], (), PARTS) == tuple(f"measured_{p}" for p in PARTS)
    assert select_features(["commands"], (), PARTS) == tuple(f"commanded_{p}" for p in PARTS)
    left = select_features(["attitude", "controls"], ["controls"], PARTS)
    assert left == select_features(["attitude"])
    mixed = select_features(["controls"], (), ("pump", "rudder"))
    assert mixed == ("pump", "measured_rudder")
    with pytest.raises(InputError, match="no input feature is left"):
        select_features(["control_rate"], (), PARTS)


def test_features_of_a_glider_are_those_of_the_table():
    assert (
        select_features(FEATURES) == select_features(FEATURES, (), GLIDER_PARTS) == tuple(FEATURES)
    )
    with pytest.raises(InputError, match="measured_shift"):
        feature("measured_shift")  # its feature is called shift
    with pytest.raises(InputError, match="sin_pitch"):
        feature("sin_pich")


def test_mirrored_missions_turn_the_rudder_round_and_not_the_elevator(store):
    signs = mirror_signs([f"measured_{part}" for part in PARTS], parts_of(store))
    np.testing.assert_array_equal(signs, [1.0, -1.0, 1.0])


def test_an_oblique_fin_cannot_be_mirrored():
    fin = load_vehicle(FILE).part("rudder")
    oblique = dataclasses.replace(fin, axis=(0.0, 0.6, 0.8))
    assert oblique.mirrored() is None
    assert dataclasses.replace(fin, position=(-0.7, 0.1, 0.0)).mirrored() is None
    with pytest.raises(InputError, match="--no-mirror"):
        mirror_signs(["measured_rudder"], {"rudder": oblique.mirrored()})


# --- Networks of a propelled vehicle that learn from its Doppler log, and the page beside the log


TORPEDO = Path(__file__).parents[2] / "vehicles" / "torpedo.xml"
PLACE = {
    "mission.duration_h": "uniform(0.1, 0.15)",
    "mission.segment_duration_s": "uniform(100, 200)",
    "mission.max_depth_m": "25",
    "floor.depth_m": "45",
}


def made(path, **changes):
    recipe = make_recipe(
        hours=0.5,
        sensors="survey-field",
        changes={**PLACE, **changes},
        vehicle=str(TORPEDO),
        seed=3,
    )
    generate(recipe, path, workers=1)
    return path


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """Shallow and still water, instruments with errors."""
    path = tmp_path_factory.mktemp("doppler") / "still.zarr"
    return made(path, **{"current.speed": "0"})


@pytest.fixture(scope="module")
def run(still, tmp_path_factory):
    folder = tmp_path_factory.mktemp("doppler-run")
    words = ["--seconds", "1", "--members", "1", "--name", "dvl", "--hidden", "40", "--json"]
    words += ["--workers", "1"]
    labels = ["--labels", "dvl", "--known-current", "0,0"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("twin.show.figures.page_layout.DPI", 30)
        assert PROGRAM.main(["fit", str(still), *words, *labels]) == 0
    return open_run(folder / "runs/dvl")


@pytest.fixture(scope="module")
def judged(run, still):
    return learn.evaluate(run, still, split="all", baselines=("dvl",))


def test_the_run_says_what_it_learned_from(run):
    assert run.labels == LabelConfig(source="dvl", known_current="0,0")
    counts = run.description["label_counts"]
    assert counts["bottom"] > 0.8 * counts["samples"]
    assert 0.8 * counts["samples"] < counts["used"] < counts["samples"]
    assert counts["outliers"] > 0
    card = (run.folder / "README.md").read_text(encoding="utf-8")
    page = run.report.read_text(encoding="utf-8")
    for text in (card, page):
        assert "Networks learned from the Doppler log, not from the truth" in text
        assert "0,0 north, east, as given: mean speed 0.000 m/s" in text
    assert "0.0347" in page  # the paper's networks for a propelled vehicle, not those of its glider
    assert "2.12e-04" not in page


def test_figures_stand_beside_the_log(judged, run):
    beside = judged.figures["against_dvl"]
    assert beside["missions"] == judged.figures["missions"]
    assert 0.0 < beside["surge_mse"] < 1.0
    assert beside["samples"] > 0
    rows = {row["track"]: row["mean [%]"] for row in result_tables.doppler_rows(judged.figures)}
    own = judged.figures["baselines"]["dvl"]["dr_ground_percent_mean"]
    assert rows["DVL-aided, from the truth"] == own < 3.0
    # no two sides of a triangle are shorter than the third
    assert rows["networks, from DVL-aided"] <= rows["networks, from the truth"] + own
    stored = json.loads((run.folder / "evaluation.json").read_text())
    assert stored["against_dvl"]["surge_mse"] is not None


def test_the_comparison_is_of_tracks_over_ground(judged):
    shown = judged.shown[0]
    found = {c.mission: c for c in judged.evaluation.against_dvl}[shown.reference.mission.index]
    lines = ground_lines(shown, BESIDE_DVL)
    away = np.hypot(*(lines["network"] - lines["dvl"]).T)
    assert found.track.end_m == pytest.approx(away[-1])
    assert found.track.max_m == pytest.approx(away.max())
    assert found.track.path_m == pytest.approx(shown.reference.path[-1])


def test_the_papers_figures_are_drawn_where_the_log_saw_the_bottom(judged, run):
    contents = Contents(title="t", lead="l", test=judged)
    unlogged = dataclasses.replace(judged, shown=())
    for name in ("doppler_track", "doppler_track_3d", "doppler_errors"):
        drawn = FIGURES[name].draw(contents)
        assert drawn is not None
        assert drawn[1]
        assert FIGURES[name].draw(Contents(title="t", lead="l", test=unlogged)) is None
        assert (run.report.parent / f"{name}.png").is_file()
    shown = with_bottom_lock(judged.shown)
    assert shown is not None
    north, east, share = doppler_error_figure(shown).axes
    lines = ground_lines(shown, BESIDE_DVL)
    end = (lines["network"] - lines["truth"])[-1]
    for place, value in ((north, end[0]), (east, end[1])):
        assert place.lines[0].get_ydata()[-1] == pytest.approx(value, abs=0.2)
    assert share.get_ylim()[0] == 0.0
    assert with_bottom_lock(()) is None


def test_in_still_water_and_in_a_current_the_page_says_what_can_be_known(judged, run, tmp_path):
    assert any("The water stood still" in text for text in result_tables.verdicts(judged.figures))
    moving = made(tmp_path / "m.zarr", **{"current.speed": "0.3"})
    judged = learn.evaluate(run, moving, split="all", baselines=("dvl",))
    found, shown = judged.figures, judged.shown[0]
    text = " ".join(result_tables.verdicts(found))
    assert "no method can know it without sight of the bottom or a fix" in text
    network, away, own = (row["mean [%]"] for row in result_tables.doppler_rows(found))
    assert isinstance(own, float)
    assert own < 5.0 < network  # the log sees the current, the networks do not
    assert away > 5.0
    # no track over ground without a current that is known
    assert set(ground_lines(shown, BESIDE_DVL)) == {"truth", "dvl"}
    assert doppler_error_figure(shown).axes[0].lines


def test_an_on_board_track_by_a_doppler_log_is_none_through_the_water(run, still):
    found = learn.evaluate(run, still, split="all", baselines=("onboard",)).figures
    onboard = found["baselines"]["onboard"]
    assert onboard["dr_water_percent_mean"] is None
    assert onboard["dr_ground_percent_mean"] < 5.0
    assert "reckoned by a Doppler log" in result_tables.without_track(found, "water")
