"""`import learn`: what is public, what it costs, and that no module takes a name."""

import inspect
import json
import subprocess
import sys

import numpy as np
import pytest

import learn
from learn.data.dataset import load_missions
from learn.files import read_sealed
from twin.errors import InputError

FUNCTIONS = [name for name in learn.__all__ if inspect.isfunction(getattr(learn, name))]


def python(program):
    """What a program prints in an interpreter of its own."""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_importing_it_costs_nothing():
    """Counted in modules, which a busy machine loads as well: those of Python and a few of ours."""
    loaded = "print(*sorted(m.split('.')[0] for m in sys.modules))"
    bare = python(f"import sys, typing, socket, inspect; {loaded}").split()
    ours = python(f"import sys, learn; {loaded}").split()
    assert not {"torch", "numpy", "xarray", "tyro", "zarr", "mujoco"} & set(ours)
    assert len(ours) - len(bare) < 90, sorted(set(ours) - set(bare))


def test_every_public_name_is_there_and_documented():
    assert sorted(learn.__all__) == dir(learn)
    assert {"fit", "evaluate", "export", "open_run"} <= set(FUNCTIONS)
    for name in FUNCTIONS:
        text = inspect.getdoc(getattr(learn, name))
        assert "Raises:" in text, name
        documented = text.partition("Args:")[2]
        for parameter in inspect.signature(getattr(learn, name)).parameters:
            assert f"{parameter}:" in documented, (name, parameter)
    with pytest.raises(AttributeError, match="did you mean 'fit'"):
        _ = learn.fitt


SETTINGS = {"features": ("sin_pitch", "depth_rate"), "network": "mlp", "hidden": 6, "layers": 1}


@pytest.fixture(scope="module")
def run(flown_store, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
        folder = tmp_path_factory.mktemp("face") / "run"
        return learn.fit(flown_store, folder=folder, epochs=2, members=2, seed=4, **SETTINGS)


def test_fit_gives_a_run_and_prints_nothing(flown_store, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    folder = tmp_path / "run"
    said = []
    found = learn.fit(flown_store, folder=folder, epochs=1, members=1, say=said.append, **SETTINGS)
    assert capsys.readouterr() == ("", "")
    assert isinstance(found, learn.Run)
    assert found.folder == folder
    assert found.figures == read_sealed(folder / "evaluation.json", "")
    assert any("evaluating on test missions" in line for line in said)
    with pytest.raises(InputError, match="exists; use --resume, --overwrite"):
        learn.fit(flown_store, folder=folder, epochs=1, members=1, **SETTINGS)
    again = learn.fit(folder=folder, resume=True)
    assert again.description["settings"] == found.description["settings"]


def test_evaluate_takes_a_run_or_its_folder(run, flown_store):
    one = learn.evaluate(run, flown_store, split="validation", baselines=("pitch_plus_alpha",))
    other = learn.evaluate(run.folder, split="validation", baselines=("pitch_plus_alpha",))
    assert json.dumps(one.figures) == json.dumps(other.figures)
    assert one.figures["missions"] == 1
    assert list(one.evaluation.methods) == ["network", "floor", "pitch_plus_alpha"]
    with pytest.raises(InputError, match="unknown baseline 'efk': did you mean 'ekf'"):
        learn.evaluate(run, flown_store, baselines=("efk",))


def test_predictions_are_what_the_evaluation_judges(run, flown_store):
    predictions = run.predict(flown_store, split="test")
    missions = load_missions(flown_store, ("true_surge", "true_sway"), split="test")
    assert [p.mission for p in predictions] == [m.index for m in missions]
    for name in ("surge", "sway"):
        error = np.concatenate(
            [
                getattr(p, name).astype(float) - m.target(name)
                for p, m in zip(predictions, missions, strict=True)
            ]
        )
        assert np.square(error).mean() == pytest.approx(run.figures[f"{name}_mse"], rel=1e-5)
    assert predictions[0].time[1] == 0.5
    assert predictions[0].surge_sd.max() > 0.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"network": "mlp", "delays": 3}, r"network 'mlp' has no --delays .*has: elman"),
        ({"network": "elman", "memories": (2.0,)}, r"network 'elman' has no --memories .*has: ema"),
        ({"window": 64}, r"network 'ema' has no --window: .*take a network that has: elman, lstm"),
        ({"network": "mlp", "washin": 4}, r"network 'mlp' has no --washin"),
        ({"memories": (8.0, 2.0)}, r"memories must rise, not 8, 2"),
        ({"memories": ()}, r"memories must be 1 to 64 times, not 0; .* is mlp"),
        ({"memories": (0.0, 2.0)}, r"times above 0 and up to 86400 s, not 0.0"),
        (
            {"network": "elman", "optimiser": "scg", "window": 64},
            r"optimiser 'scg' has no --window",
        ),
        ({"optimiser": "sgd"}, r"unknown optimiser 'sgd'"),
        ({"inputs": "glidr"}, r"unknown set of inputs 'glidr': did you mean 'glider'"),
    ],
)
def test_settings_without_a_use_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        learn.fit_settings("s.zarr", **settings)
