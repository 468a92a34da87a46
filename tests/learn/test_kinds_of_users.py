"""A user's own kinds, each in one file outside the package, from training to export."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch

import learn
from learn.__main__ import PROGRAM
from learn.networks.onnx_export import StepModel
from twin.errors import InputError
from twin.navigation.estimators.base import VELOCITY_ESTIMATORS, BodyVelocity, VelocityEstimator

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def own_kinds(monkeypatch):
    """What a test registers is gone after it."""
    for registry in (learn.NETWORKS, learn.OPTIMISERS, VELOCITY_ESTIMATORS):
        monkeypatch.setattr(registry, "_registered", {})


def program(folder, *words):
    """Run the file of the docs as a program in a folder."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the file of the docs."""
    folder = tmp_path_factory.mktemp("user")
    page = (ROOT / "docs" / "reference" / "networks.md").read_text("utf-8")
    (text,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (folder / "leaky.py").write_text(text)
    return folder


def test_a_network_of_ones_own_trains_reloads_evaluates_and_exports(
    place, flown_store, monkeypatch, capsys
):
    small = ("--hidden", 5, "--members", 1, "--epochs", 1, "--features", "sin_pitch", "depth_rate")
    words = ("leaky.py", "fit", flown_store, "--name", "mine", "--network", "leaky", *small)
    done = program(place, *words, "--workers", 2, "--json")  # in processes of their own
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["settings"]["network"]["kind"] == "leaky"
    assert "leaky, hidden 5\n" in (place / "runs" / "mine" / "README.md").read_text()

    done = program(place, "leaky.py", "evaluate", "mine", flown_store, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["surge_mse"] > 0.0

    done = program(place, "leaky.py", "export", "mine", "--json")
    assert done.returncode == 0, done.stderr
    model = StepModel(place / "runs" / "mine" / "onnx" / "surge-0.onnx")
    assert model.features == ("sin_pitch", "depth_rate")

    # without the file the run says what is missing
    monkeypatch.chdir(place)
    assert PROGRAM.main(["evaluate", "mine", str(flown_store)]) == 2
    said = capsys.readouterr().err
    assert "unknown network 'leaky'" in said
    assert "import __main__" not in said
    assert "name its file in GLIDER_TWIN_PLUGINS" in said
    assert len(said.strip().splitlines()) == 1


def test_a_module_is_named_when_its_network_is_not_registered(flown_store, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    (tmp_path / "my_kinds.py").write_text(
        "import learn\nfrom learn.networks.fixed_memory import Memoryless\n"
        "@learn.NETWORKS.register('mine')\nclass Mine(Memoryless):\n    summary = 'mine'\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    __import__("my_kinds")
    settings = {"network": "mine", "features": ("sin_pitch",), "epochs": 1, "members": 1}
    run = learn.fit(flown_store, folder=tmp_path / "run", hidden=4, **settings)
    assert learn.evaluate(run).figures["missions"] == 1
    monkeypatch.setattr(learn.NETWORKS, "_registered", {})  # as in a session without that import
    with pytest.raises(InputError, match=r"surge-0\.json: unknown network 'mine'.*import my_kinds"):
        learn.evaluate(tmp_path / "run")


def test_a_network_that_torch_cannot_export_is_explained(tmp_path):
    from learn.data.sequences import Normalisation
    from learn.networks.base import build_network
    from learn.networks.onnx_export import step_model
    from learn.networks.predictor import Predictor

    class Branching(learn.Network):
        summary = "it looks at its numbers"

        def __init__(self, config):
            super().__init__(config)
            self.line = torch.nn.Linear(config.inputs, 1)
            self.state_size = 0

        def forward(self, x, state=None):
            y = self.line(x)
            return (y if float(y.detach().sum()) < 1e9 else -y), self.initial_state(x.shape[1])

    learn.NETWORKS.register("branching")(Branching)
    network = build_network(learn.NetworkConfig(kind="branching", inputs=1))
    scales = Normalisation(
        features=("depth_rate",), mean=(0.0,), scale=(1.0,), target="surge",
        target_mean=0.0, target_scale=1.0,
    )  # fmt: skip
    with pytest.raises(InputError, match="torch cannot export network 'branching'"):
        step_model(Predictor(network, scales), 0.5)


class Sgd(learn.MinibatchOptimiser):
    summary = "plain descent"

    def build(self, parameters, config):
        return torch.optim.SGD(parameters, lr=config.rate)


class Still(VelocityEstimator):
    kind = "my_still"
    title = "standing still"
    summary = "no way at all"
    channels = ("measured_depth",)

    def step(self, sample):
        return BodyVelocity(surge=0.0, sway=0.0)


def test_an_optimiser_and_a_velocity_estimator_of_ones_own(flown_store, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.show.figures.page_layout.DPI", 20)
    learn.OPTIMISERS.register("my_sgd")(Sgd)
    VELOCITY_ESTIMATORS.add(Still)
    settings = {"features": ("sin_pitch",), "network": "mlp", "hidden": 4, "members": 1}
    run = learn.fit(
        flown_store,
        folder=tmp_path / "run",
        optimiser="my_sgd",
        epochs=1,
        **settings,
    )
    assert run.description["settings"]["training"]["optimiser"] == "my_sgd"
    assert run.figures["baselines"]["my_still"]["surge_mse"] > 0.0
    page = run.report.read_text()
    assert "standing still" in page
