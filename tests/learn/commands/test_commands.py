"""The commands from end to end, on stores small enough to train on in a second."""

import json
import re
import shutil
from pathlib import Path

import pytest
from navigation import write_flown_store

from factory.commands.generate import DEFAULT_OUT
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from learn.__main__ import PROGRAM
from learn.files import SEAL, write_json, write_sealed
from learn.finishing import _paper_test
from learn.networks.base import NetworkConfig
from learn.report.result_tables import paper_sentence
from learn.run import DEFAULT_STORE, newest_run, open_run
from learn.training.fit_config import FitConfig
from learn.training.fitting import fit
from learn.training.optimiser import TrainingConfig
from learn.training.resources import training_resources
from twin.errors import InputError, StoreError, WriteError
from twin.navigation.estimators import baselines
from twin.records.tracks import read_tracks

SMALL = {"epochs": 1, "hidden": 6, "layers": 1, "members": 1, "workers": 1}
QUICK = tuple(word for name, value in SMALL.items() for word in (f"--{name}", str(value)))


def call(capsys, *words):
    """Exit code, standard output and standard error of `learn`."""
    code = PROGRAM.main([str(word) for word in words])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A working directory with a store and one finished run, made by the command."""
    folder = tmp_path_factory.mktemp("place")
    store = write_flown_store(folder / "data" / "missions.zarr")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("twin.show.figures.page_layout.DPI", 30)
        assert PROGRAM.main(["fit", str(store), "--name", "first", "--json", *QUICK]) == 0
    return folder


@pytest.fixture(autouse=True)
def no_figures(monkeypatch):
    """Drawing takes most of the time of these tests; `place` and test_report draw."""
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")


@pytest.fixture
def here(place, monkeypatch):
    monkeypatch.chdir(place)
    return place


def test_fit_writes_everything_a_run_needs(here):
    folder = here / "runs" / "first"
    assert {p.name for p in folder.iterdir()} == {
        *("run.json", "metrics.jsonl", "evaluation.json", "README.md", "report"),
        "checksums.json",
        *(f"{target}-0{end}" for target in ("surge", "sway") for end in (".json", ".safetensors")),
    }
    run = open_run(folder)
    assert run.description["settings"]["network"]["hidden"] == 6
    assert (
        run.description["networks"]["surge-0"]["seed"]
        != (run.description["networks"]["sway-0"]["seed"])
    )
    assert {row["network"] for row in run.metrics()} == {"surge-0", "sway-0"}
    assert run.report.is_file()
    assert run.error_model().velocity_sd > 0
    assert run.figures["missions"] == 1


def assert_same_networks(one, other):
    for target in ("surge", "sway"):
        name = f"{target}-0.safetensors"
        assert (one / name).read_bytes() == (other / name).read_bytes()


def test_a_name_in_use_is_refused_and_resume_completes_it(here, capsys):
    code, _, err = call(capsys, "fit", "--name", "first", *QUICK)
    assert code == 2
    assert "--resume, --overwrite or another --name" in err
    half = here / "runs" / "half"
    shutil.copytree(here / "runs" / "first", half)
    (half / "sway-0.json").unlink()
    description = json.loads((half / "run.json").read_text())
    write_sealed(half / "run.json", {**description, "complete": False})
    with pytest.raises(StoreError, match="not finished"):
        open_run(half)
    before = (half / "surge-0.safetensors").stat().st_mtime_ns
    code, out, err = call(
        capsys, "fit", description["settings"]["store"], "--name", "half", "--resume", *QUICK
    )
    assert code == 0, err
    assert "networks" in out
    assert out.rstrip().endswith("report: runs/half/report/index.html")
    assert (half / "surge-0.safetensors").stat().st_mtime_ns == before
    assert open_run(half).networks()["sway"].target == "sway"
    code, _, err = call(
        capsys,
        *("fit", description["settings"]["store"], "--name", "half", "--resume", "--seed", "9"),
        *QUICK,
    )
    assert code == 2
    assert "was started with seed 0 instead of 9" in err


def test_two_processes_train_the_same_networks_as_one(here):
    settings = open_run("first").description["settings"]
    config = FitConfig(
        store=settings["store"],
        features=tuple(settings["features"]),
        network=NetworkConfig(**settings["network"]),
        training=TrainingConfig(**settings["training"]),
    )
    with training_resources(2) as resources:
        run = fit(config, here / "runs" / "aside", resources)
    assert_same_networks(run.folder, here / "runs" / "first")
    assert {row["network"] for row in run.metrics()} == {"surge-0", "sway-0"}


def test_an_error_in_a_process_reaches_the_caller(here, tmp_path):
    store = write_flown_store(tmp_path / "s.zarr", splits=(2, 2))
    quick = TrainingConfig(epochs=1, seconds=0)
    config = FitConfig(store=str(store), features=("sin_pitch",), training=quick)
    with (
        training_resources(2) as resources,
        pytest.raises(StoreError, match="no missions for training"),
    ):
        fit(config, tmp_path / "run", resources)


def test_fit_answers_with_one_object_and_labels_the_papers_division_as_leaking(here, capsys):
    options = ("--division", "samples", "--without", "imu", "--json", "--overwrite")
    code, out, err = call(capsys, "fit", "--name", "two", *options, *QUICK, "--members", "2")
    assert code == 0, err
    found = json.loads(out)
    assert found["report"] == "runs/two/report/index.html"
    assert "roll_rate" not in found["settings"]["features"]
    assert set(found["baselines"]) == set(baselines())
    assert set(found["networks"]) == {"surge-0", "surge-1", "sway-0", "sway-1"}
    assert found["split"] == "all"
    assert len(open_run("two").networks()["surge"].members) == 2
    assert "leaks" in (here / "runs" / "two" / "README.md").read_text()


def test_a_run_is_trained_alone_and_reported_later(here, capsys):
    code, out, err = call(capsys, "fit", "--name", "bare", "--no-report", "--json", *QUICK)
    assert code == 0, err
    folder = here / "runs" / "bare"
    assert set(json.loads(out)) == {"run", "settings", "networks"}
    assert not (folder / "report").exists()
    assert_same_networks(folder, here / "runs" / "first")
    code, out, err = call(capsys, "report", "bare", "--json")
    assert code == 0, err
    assert "evaluating on test missions" in err
    first = open_run("first").figures
    assert json.loads(out)["surge_mse"] == first["surge_mse"]
    assert {p.name for p in folder.iterdir()} == {p.name for p in (here / "runs/first").iterdir()}


def test_evaluate_takes_the_newest_run_and_the_store_that_it_was_trained_on(
    here, capsys, monkeypatch
):
    code, out, err = call(capsys, "evaluate", "--json")
    assert code == 0, err
    found = json.loads(out)
    assert found["run"] == str(newest_run().folder)
    assert found["store"] == str(DEFAULT_STORE) == str(DEFAULT_OUT)
    assert found["split"] == "test"
    assert found["floor"]["surge_mse"] == 0.0
    monkeypatch.setattr("learn.run.Run.store", Path("elsewhere.zarr"))
    code, _, err = call(capsys, "evaluate", "first")
    assert code == 2
    assert "no store at elsewhere.zarr" in err


def test_evaluate_writes_tracks_and_a_page(here, capsys, tmp_path):
    code, out, err = call(
        capsys,
        *("evaluate", "first", DEFAULT_STORE, "--split", "all"),
        *("--tracks", tmp_path / "t.npz", "--out", tmp_path / "page"),
    )
    assert code == 0, err
    assert "EKF" in out
    assert (tmp_path / "page" / "index.html").is_file()
    assert {t.name for t in read_tracks(tmp_path / "t.npz", 3)} >= {"network", "steady_flight"}


def test_compare_and_export(here, capsys, tmp_path):
    code, out, err = call(capsys, "compare", "first", "first", "--json")
    assert code == 0, err
    assert len(json.loads(out)["runs"]) == 2
    code, out, err = call(capsys, "compare", "--json")
    assert code == 0, err
    assert list(json.loads(out)["runs"]) == [newest_run().name]
    code, out, err = call(capsys, "export", "first", "--out", tmp_path / "onnx", "--json")
    assert code == 0, err
    models = json.loads(out)["models"]
    assert set(models) == {"surge-0", "sway-0"}
    assert all(model["largest"] <= 1e-5 for model in models.values())
    if shutil.which("cc"):
        code, out, err = call(capsys, "export", "first", "--to", "c", "--out", tmp_path / "c")
        assert code == 0, err
        assert "a sample holds: measured_roll, measured_pitch" in out
        assert [place.name for place in (tmp_path / "c").iterdir()] == ["glider_velocity.h"]
    code, out, err = call(capsys, "compare", "first", "--store", DEFAULT_STORE, "--split", "all")
    assert code == 0, err
    assert "steady flight" in out


def test_the_help_of_fit_names_the_defaults_that_apply(here, capsys):
    code, out, _ = call(capsys, "fit", "--help")
    assert code == 0
    words = " ".join(re.sub(r"[│\n]", " ", out).split())
    assert "--inputs {full,glider,thrusters}" in words
    network, training = NetworkConfig(), TrainingConfig()
    for value, label in (
        (network.kind, "type of network"),
        (network.hidden, "units per hidden layer"),
        (network.layers, "hidden layers"),
        (f"{training.seconds:g}", "two are trained side by side"),
        (training.window, "longer ones teach a longer memory"),
        (training.washin, "in which the network finds its state"),
    ):
        assert re.search(rf"{label} \[default: {value}[,\]]", words), label


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("evaluate", "nothing"), "is not a run"),
        (("evaluate", "data/missions.zarr"), "as in `learn evaluate runs/"),
        (("evaluate", "first", "none.zarr"), "no store at none.zarr"),
        (("evaluate", "first", "--tracks", "t.txt"), "the ending must be one of"),
        (("evaluate", "first", "--split", "tset"), "did you mean 'test'"),
        (("fit", "none.zarr"), "no store at none.zarr"),
        (("fit", "--features", "attitud"), "did you mean 'attitude'"),
        (("fit", "--name", "a/b"), "must be a plain name"),
        (("fit", "--name", ""), "must be a plain name"),
        (("fit", "--name", "a\nb"), "must be a plain name"),
        (("fit", "--name", "a" * 101), "must be a plain name of at most 100"),
        (("fit", "--resume"), "needs the --name"),
        (("fit", "--network", "rnn"), "(allowed: elman, ema, gru, lstm, mlp, tcn)"),
        (("fit", "--device", "cud"), "did you mean 'cuda'"),
        (("evaluate", "first", "--tracks", "data"), "the ending must be one of"),
        (("evaluate", "first", "--out", "data/missions.zarr/zarr.json"), "is a file, not a folder"),
        (("evaluate", "first", "--tracks", "runs/first/run.json/t.npz"), "is a file, not a folder"),
        (("compare", "nothing"), "is not a run"),
        (("export", "first", "--store", "none.zarr"), "no store at"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(here, capsys, words, message):
    code, _, err = call(capsys, *words)
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1


def test_a_store_without_training_missions_is_refused(here, capsys, tmp_path):
    store = write_flown_store(tmp_path / "s.zarr", splits=(2, 2))
    code, _, err = call(capsys, "fit", store, "--name", "untrained", *QUICK)
    assert code == 2
    assert "no missions for training" in err


def test_a_run_of_another_format_is_refused(here, tmp_path):
    shutil.copytree(here / "runs" / "first", tmp_path / "old")
    description = json.loads((tmp_path / "old" / "run.json").read_text())
    (tmp_path / "old" / "run.json").write_text(json.dumps({**description, "format": 0}))
    with pytest.raises(StoreError, match="has format 0"):
        open_run(tmp_path / "old")
    (tmp_path / "old" / "run.json").write_text("{")
    with pytest.raises(StoreError, match="is damaged"):
        open_run(tmp_path / "old")


def test_networks_of_another_schema_or_in_the_wrong_place_are_refused(here, tmp_path):
    shutil.copytree(here / "runs" / "first", tmp_path / "bad")
    path = tmp_path / "bad" / "surge-0.json"
    kept = path.read_text()
    path.write_text(json.dumps({**json.loads(kept), "format": 99}))
    with pytest.raises(StoreError, match="format 99"):
        open_run(tmp_path / "bad").networks()
    for end in (".json", ".safetensors"):
        shutil.copy(tmp_path / "bad" / f"sway-0{end}", path.with_suffix(end))
    with pytest.raises(StoreError, match="network for sway, not surge"):
        open_run(tmp_path / "bad").networks()


def damage(folder, name, change):
    """Change a JSON file of a copy of the first run."""
    path = folder / name
    found = json.loads(path.read_text())
    change(found)
    if SEAL in found:
        write_sealed(path, found)
    else:
        path.write_text(json.dumps(found))


DAMAGES = {
    "a figure is gone": ("evaluation.json", lambda f: f.pop("surge_mse"), "no 'surge_mse'"),
    "baselines are gone": ("evaluation.json", lambda f: f.pop("baselines"), "no 'baselines'"),
    "of the floor": ("evaluation.json", lambda f: f["floor"].pop("dives"), "no 'dives'"),
    "settings": ("run.json", lambda f: f.pop("settings"), "no 'settings'"),
    "network": ("run.json", lambda f: f["settings"].pop("network"), "no 'network'"),
    "a short mean": (
        "surge-0.json", lambda f: f["normalisation"]["mean"].pop(), "normalisation.mean has"
    ),
    "a mean that is no number": (
        "surge-0.json", lambda f: f["normalisation"]["mean"].__setitem__(0, None),
        "normalisation.mean is not finite",
    ),
    "an error model": (
        "run.json", lambda f: f["error_model"].update(colour=1), "error_model is not one"
    ),
}  # fmt: skip


@pytest.mark.parametrize("which", DAMAGES)
def test_a_damaged_file_of_a_run_is_named(here, capsys, tmp_path, which):
    name, change, message = DAMAGES[which]
    folder = tmp_path / "bad"
    shutil.copytree(here / "runs" / "first", folder)
    damage(folder, name, change)
    command = {"evaluation.json": "compare", "surge-0.json": "export"}.get(name, "evaluate")
    code, _, err = call(capsys, command, folder)
    assert code == 2
    assert f"bad/{name} is damaged" in err
    assert message in err
    assert len(err.strip().splitlines()) == 1
    (folder / name).write_text((folder / name).read_text()[:-20])
    code, _, err = call(capsys, command, folder)
    assert code == 2
    assert f"bad/{name} is damaged" in err


def test_a_place_that_refuses_is_found_out_before_the_evaluation(here, capsys, monkeypatch):
    def evaluated(*_, **__):
        raise AssertionError("evaluated for nothing")

    monkeypatch.setattr("learn.api.evaluate_run", evaluated)
    code, _, err = call(capsys, "evaluate", "first", "--tracks", "runs/first/run.json/t.csv")
    assert code == 2
    assert "is a file, not a folder" in err


def test_json_files_are_written_whole(tmp_path, monkeypatch):
    path = tmp_path / "figures.json"
    write_json(path, {"a": 1})

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(WriteError, match=r"cannot write .*figures\.json: No space"):
        write_json(path, {"a": 2})
    assert json.loads(path.read_text()) == {"a": 1}


def test_a_baseline_that_cannot_run_has_null_figures(here, capsys, tmp_path):
    store = tmp_path / "less.zarr"
    shutil.copytree(here / "data" / "missions.zarr", store)
    root = json.loads((store / "zarr.json").read_text())
    for gone in ("measured_dvl_surge", "measured_onboard_north"):
        shutil.rmtree(store / gone)
        del root["consolidated_metadata"]["metadata"][gone]
    (store / "zarr.json").write_text(json.dumps(root))
    code, out, err = call(capsys, "evaluate", "first", store, "--json")
    assert code == 0, err
    assert "onboard: the store has no channel measured_onboard_north" in err
    assert "dvl: the store has no channel measured_dvl_surge" in err
    assert err.count("no baseline") == 1
    found = json.loads(out)["baselines"]
    assert set(found) == set(baselines())
    assert found["dvl"].keys() == found["ekf"].keys()
    for name in ("surge_mse", "dr_water_percent_mean", "dr_ground_m_p90"):
        assert found["dvl"][name] is None
        assert found["ekf"][name] is not None
    assert found["dvl"]["dives"]["previous"]["dr_percent_median"] is None


def test_the_papers_test_is_announced_only_where_it_is_flown(here):
    said = []
    run = open_run("first")
    assert _paper_test(run, said.append) is None
    assert said == []


def test_export_names_the_features_once_and_fits_a_terminal(here, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(here / "runs" / "first", "runs/first")
    shutil.copytree(here / "data", "data")
    code, out, err = call(capsys, "export")
    assert code == 0, err
    lines = [line for line in out.splitlines() if not line.startswith("checked over")]
    assert max(map(len, lines)) <= 100
    assert ", ".join(open_run("first").features) in " ".join(out.split())


def test_without_runs_the_newest_is_bad_input(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="no finished run"):
        newest_run()


def test_a_factory_store_brings_the_papers_test(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    generate(make_recipe(hours=2.5), DEFAULT_STORE, workers=1)
    code, out, err = call(capsys, "fit", "--name", "paper", "--json", *QUICK)
    assert code == 0, err
    found = json.loads((tmp_path / "runs" / "paper" / "paper-test.json").read_text())
    assert found["missions"] == 3
    # Ideal sensors and the very vehicle: nothing is left but the sampling at 2 Hz.
    assert found["floor"]["dr_water_percent_mean"] < 0.002
    assert found["baselines"]["ekf"]["dr_water_percent_mean"] < 0.05
    assert found["baselines"]["onboard"]["dr_water_percent_mean"] > 0.5
    page = (tmp_path / "runs" / "paper" / "report" / "index.html").read_text()
    assert "three currents" in page
    assert open_run(tmp_path / "runs" / "paper").error_model().heading_sd == 0.0
    answer = json.loads(out)
    assert answer["run"] == "runs/paper"
    assert answer["paper_test"]["surge_mse"] == found["surge_mse"]
    sentence = paper_sentence(found)
    assert f"surge {found['surge_mse']:.1e}" in sentence
    assert "prints surge 2.1e-04, sway 4.6e-06" in sentence
