"""Extension points of `learn`: shipped types are whole, half ones refused, users' own come in."""

import json
import os
import runpy
import shutil
import subprocess
import sys

import numpy as np
import pytest
import torch
from examples import OWN, ROOT

import learn
from learn.__main__ import PROGRAM
from learn.data.sequences import Normalisation
from learn.networks.base import Network, build_network
from learn.networks.onnx_export import StepModel, step_model
from learn.networks.predictor import Predictor
from learn.training.optimiser import SETTINGS, FullBatchOptimiser, MinibatchOptimiser, Optimiser
from learn.training.scg import ScaledConjugateGradient
from twin.errors import InputError
from twin.navigation.estimators.base import (
    VELOCITY_ESTIMATORS,
    Estimate,
    VelocityEstimator,
    WindowedEstimator,
    check_estimate,
)

PAGE = "".join(
    (ROOT / "docs" / "reference" / name).read_text(encoding="utf-8")
    for name in ("networks.md", "evaluation.md")
)
REGISTRIES = {"NETWORKS": learn.NETWORKS, "OPTIMISERS": learn.OPTIMISERS}


@pytest.fixture(autouse=True)
def own_kinds(monkeypatch):
    """What a test registers or installs is gone after it."""
    registries = (*REGISTRIES.values(), VELOCITY_ESTIMATORS)
    for registry in registries:
        monkeypatch.setattr(registry, "_registered", {})
        vars(registry).pop("_offered", None)
    yield
    for registry in registries:
        vars(registry).pop("_offered", None)


def test_the_docs_have_a_row_for_each_kind_and_name_every_registry():
    for name, registry in REGISTRIES.items():
        assert [k for k, cls in registry.items() if f"| `{k}` | {cls.summary} |" not in PAGE] == []
        assert f"`learn.{name}`" in PAGE
        assert f"`{registry.group}`" in PAGE


def test_names_are_known_without_the_heavy_libraries():
    program = (
        "import sys, learn; print(*learn.NETWORKS, *learn.OPTIMISERS); "
        "import learn.commands.fit, learn.commands.evaluate; "
        "print('fit' in dir(learn), [m for m in ('torch', 'numpy', 'matplotlib', 'xarray') "
        "if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    names, rest = done.stdout.splitlines()
    assert names.split() == [name for registry in REGISTRIES.values() for name in registry]
    assert rest == "True []"


def test_a_shipped_name_an_odd_one_and_another_class_are_refused():
    with pytest.raises(InputError, match=r"network 'mlp' exists already: choose another name"):
        learn.NETWORKS.register("mlp")(learn.NETWORKS["gru"])
    with pytest.raises(InputError, match="its name must be of letters, digits, - and _"):
        learn.NETWORKS.register("my network")(learn.NETWORKS["mlp"])
    learn.NETWORKS.register("twice")(learn.NETWORKS["mlp"])
    learn.NETWORKS.register("twice")(learn.NETWORKS["mlp"])  # a module that is run again
    with pytest.raises(InputError, match=r"network 'twice' exists already: choose another name"):
        learn.NETWORKS.register("twice")(learn.NETWORKS["gru"])
    assert learn.NETWORKS["twice"] is learn.NETWORKS["mlp"]


class Whole(Network):
    summary = "a line"

    def __init__(self, config):
        super().__init__(config)
        self.line = torch.nn.Linear(config.inputs, 1)
        self.state_size = 0

    def forward(self, x, state=None):
        return self.line(x), self.initial_state(x.shape[1])


def half(base, **attributes):
    """A class derived from `base` with other attributes."""
    return type("Half", (base,), attributes)


def begun(change):
    """`__init__` of a network that does more."""

    def begin(self, config):
        Whole.__init__(self, config)
        change(self)

    return begin


def forgetful(self, x, state=None):
    y = torch.cumsum(self.line(x), 0)  # the state it is given is not used
    return y, y[-1]


def clairvoyant(self, x, state=None):
    return self.line(x.flip(0)), self.initial_state(x.shape[1])


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (object, r"must be a class derived from learn\.Network"),
        (half(Whole, summary=""), r"lacks `summary`.*Half\)"),
        (half(Network, summary="nothing"), r"lacks the method `forward`.*Half\)"),
        (half(Whole, sizes=("hidden", "width")), r"names size 'width'; there are hidden"),
        (half(Whole, __init__=begun(lambda n: vars(n).pop("state_size"))),
         r"does not set state_size"),
        (half(Whole, forward=lambda self, x, state=None: (
            self.line(x)[..., 0], self.initial_state(x.shape[1]))),
         r"outputs of shape \(7, 2\), not \(time, batch, 1\)"),
        (half(Whole, forward=lambda self, x, state=None: (
            self.line(x), x.new_zeros(x.shape[1], 3))),
         r"a state of shape \(2, 3\), not \(batch, state_size\)"),
        (half(Whole, __init__=begun(lambda n: setattr(n, "state_size", 1)), forward=forgetful),
         r"step after step it gives something else"),
        (half(Whole, forward=clairvoyant, step=lambda self, x, state: (self.line(x), state)),
         r"step after step it gives something else"),
        (half(Whole, __init__=begun(lambda n: setattr(n, "spare", torch.nn.Linear(2, 2)))),
         r"the output does not depend on weight spare"),
        (half(Whole, __init__=begun(lambda n: n.line.requires_grad_(False))),
         r"no weights to train"),
    ],
)  # fmt: skip
def test_half_a_network_is_refused(kind, message):
    with pytest.raises(InputError, match=message):
        learn.NETWORKS.register("half")(kind)
    assert "half" not in learn.NETWORKS


class Sgd(MinibatchOptimiser):
    summary = "plain descent"

    def build(self, parameters, config):
        return torch.optim.SGD(parameters, lr=config.rate)


def stuck(self, objective, start, config):
    method = ScaledConjugateGradient(objective, start)
    method.step = lambda: False
    return method


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Whole, r"must be a class derived from learn\.training\.optimiser\.Optimiser"),
        (half(MinibatchOptimiser, summary="nothing"), r"lacks the method `build`"),
        (half(Optimiser, summary="nothing"),
         r"must derive from MinibatchOptimiser or FullBatchOptimiser"),
        (half(Sgd, settings=("momentum",)), r"names setting 'momentum'; there are rate"),
        (half(Sgd, build=lambda self, parameters, config: torch.optim.SGD(
            parameters, lr=config.rate, maximize=True)),
         r"8 steps do not lower the error of a line"),
        (half(Sgd, build=lambda self, parameters, config: list(parameters)),
         r"build gives list, not a torch\.optim\.Optimizer"),
        (half(FullBatchOptimiser, summary="nothing to step with",
              build=lambda self, objective, start, config: object()),
         r"lacks parameters, error, scale"),
        (half(FullBatchOptimiser, summary="it does not move", build=stuck),
         r"do not lower the error of a parabola"),
    ],
)  # fmt: skip
def test_half_an_optimiser_is_refused(kind, message):
    with pytest.raises(InputError, match=message):
        learn.OPTIMISERS.register("half")(kind)
    assert "half" not in learn.OPTIMISERS


def test_settings_of_optimisers_are_settings_of_a_training():
    names = set(learn.TrainingConfig.__dataclass_fields__)
    assert set(SETTINGS) <= names
    used = {word for kind in learn.OPTIMISERS.values() for word in kind.settings}
    assert used == set(SETTINGS)


class Still(WindowedEstimator):
    kind = "half"
    summary = "no way at all"
    channels = ("measured_depth",)

    def batch(self, signals):
        zeros = np.zeros(len(signals["measured_depth"]))
        return Estimate(surge=zeros, sway=zeros)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (half(VelocityEstimator, kind="half", summary="nothing", channels=("measured_depth",)),
         r"lacks the method `step`"),
        (half(Still, channels=()), r"lacks `channels`"),
        (half(Still, channels=("measured_dept",)),
         r"unknown signal 'measured_dept': did you mean 'measured_depth'"),
        (half(Still, channels=("true_surge",)), r"a velocity estimator must not see the truth"),
        (half(Still, colour="pink"), r"unknown colour 'pink'"),
    ],
)  # fmt: skip
def test_half_a_velocity_estimator_is_refused(kind, message):
    with pytest.raises(InputError, match=message):
        VELOCITY_ESTIMATORS.add(kind)


def test_what_an_estimator_gives_is_checked():
    good = Estimate(surge=np.zeros(5), sway=np.zeros(5))
    assert check_estimate("b", good, 5) is good
    with pytest.raises(InputError, match=r"'b' gives tuple instead of an Estimate"):
        check_estimate("b", (1, 2), 5)
    with pytest.raises(InputError, match=r"'b' gives surge of shape \(5,\), not \(6,\)"):
        check_estimate("b", good, 6)


def test_entry_points_bring_kinds_in_and_half_ones_are_refused(tmp_path, monkeypatch):
    (tmp_path / "house_kinds.py").write_text(
        "from learn.networks.fixed_memory import Memoryless\n"
        "class House(Memoryless):\n    summary = 'of the house'\n"
        "class Half(Memoryless):\n    summary = ''\n"
    )
    info = tmp_path / "house-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: house\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        "[glider_twin.networks]\nhouse = house_kinds:House\nhalf = house_kinds:Half\n"
        "gone = house_kinds:Gone\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert list(learn.NETWORKS)[-3:] == ["house", "half", "gone"]
    assert learn.NETWORKS["house"].summary == "of the house"
    assert learn.NETWORKS.place("house") == "house_kinds:House"
    assert learn.NetworkConfig(kind="house").kind == "house"
    with pytest.raises(
        InputError, match=r"'half' is only half there: it lacks `summary`.*\(house_kinds:Half\)"
    ):
        learn.NETWORKS["half"]
    with pytest.raises(InputError, match=r"house_kinds:Gone, which cannot be loaded"):
        learn.NETWORKS["gone"]


def test_a_class_that_no_other_process_finds_needs_one_worker(small_store, tmp_path):
    class Hidden(Whole):
        pass

    learn.NETWORKS.register("hidden_one")(Hidden)
    settings = {"network": "hidden_one", "features": ("sin_pitch",), "epochs": 1, "members": 1}
    with pytest.raises(InputError, match=r"cannot be imported by another process.*1 worker"):
        learn.fit(small_store, folder=tmp_path / "run", workers=2, **settings)
    assert not (tmp_path / "run").exists()


# --- A user's own kinds, each in one file outside the package, from training to export


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the file of the examples."""
    folder = tmp_path_factory.mktemp("user")
    shutil.copy(OWN / "leaky.py", folder)
    return folder


def test_a_network_of_ones_own_trains_reloads_evaluates_and_exports(
    place, flown_store, monkeypatch, capsys
):
    """Run the file of the examples as a program, which trains in processes of their own."""
    small = "--hidden 5 --members 1 --epochs 1 --features sin_pitch depth_rate --workers 2"
    words = f"leaky.py fit {flown_store} --name mine --network leaky {small} --json --no-report"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *words.split()], cwd=place, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["settings"]["network"]["kind"] == "leaky"
    monkeypatch.chdir(place)
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    for command in ("report mine", f"evaluate mine {flown_store}", "export mine"):
        monkeypatch.setattr(learn.NETWORKS, "_registered", {})
        monkeypatch.setattr(sys, "argv", f"leaky.py {command} --json".split())
        with pytest.raises(SystemExit) as ended:
            runpy.run_path("leaky.py", run_name="__main__")
        said = capsys.readouterr()
        assert not ended.value.code, said.err
        assert json.loads(said.out).get("surge_mse", 1.0) > 0.0
    assert "leaky, hidden 5\n" in (place / "runs" / "mine" / "README.md").read_text()
    model = StepModel(place / "runs" / "mine" / "onnx" / "surge-0.onnx")
    assert model.features == ("sin_pitch", "depth_rate")
    # without the file the run says what is missing
    monkeypatch.setattr(learn.NETWORKS, "_registered", {})
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


def test_an_optimiser_and_a_velocity_estimator_of_ones_own(flown_store, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.show.figures.page_layout.DPI", 20)
    learn.OPTIMISERS.register("my_sgd")(Sgd)
    VELOCITY_ESTIMATORS.add(half(Still, kind="my_still", title="standing still"))
    settings = {"features": ("sin_pitch",), "network": "mlp", "hidden": 4, "members": 1}
    run = learn.fit(flown_store, folder=tmp_path / "run", optimiser="my_sgd", epochs=1, **settings)
    assert run.description["settings"]["training"]["optimiser"] == "my_sgd"
    assert run.figures["baselines"]["my_still"]["surge_mse"] > 0.0
    page = run.report.read_text()
    assert "standing still" in page
