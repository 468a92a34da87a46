"""Every seam of `learn`: shipped kinds are whole, half ones are refused, users' own come in."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import learn
from learn.networks.base import Network
from learn.training.optimiser import (
    SETTINGS,
    FullBatchOptimiser,
    MinibatchOptimiser,
    Optimiser,
)
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
    (Path(__file__).parents[2] / "docs" / "reference" / name).read_text(encoding="utf-8")
    for name in ("networks.md", "evaluation.md")
)
REGISTRIES = {
    "NETWORKS": learn.NETWORKS,
    "OPTIMISERS": learn.OPTIMISERS,
}


@pytest.fixture(autouse=True)
def own_kinds(monkeypatch):
    """What a test registers or installs is gone after it."""
    for registry in REGISTRIES.values():
        monkeypatch.setattr(registry, "_registered", {})
        vars(registry).pop("_offered", None)
    yield
    for registry in REGISTRIES.values():
        vars(registry).pop("_offered", None)


@pytest.mark.parametrize("name", ["NETWORKS", "OPTIMISERS"])
def test_the_docs_have_a_row_for_each_kind(name):
    for kind, cls in REGISTRIES[name].items():
        assert f"| `{kind}` | {cls.summary} |" in PAGE
    rows = re.findall(r"\| `(\w+)` \| ", PAGE)
    assert set(REGISTRIES[name]) <= set(rows)


def test_the_docs_name_every_registry_and_its_entry_points():
    for name, registry in REGISTRIES.items():
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


def test_an_unknown_name_says_how_to_bring_one_in():
    with pytest.raises(
        InputError,
        match=r"unknown network 'lstn': did you mean 'lstm'\? .*glider_twin\.networks$",
    ):
        learn.NETWORKS["lstn"]


class Whole(Network):
    summary = "a line"

    def __init__(self, config):
        super().__init__(config)
        self.line = torch.nn.Linear(config.inputs, 1)
        self.state_size = 0

    def forward(self, x, state=None):
        return self.line(x), self.initial_state(x.shape[1])


class NoSummary(Whole):
    summary = ""


class NoForward(Network):
    summary = "nothing"


class WrongSizes(Whole):
    sizes = ("hidden", "width")


class NoStateSize(Whole):
    def __init__(self, config):
        Network.__init__(self, config)
        self.line = torch.nn.Linear(config.inputs, 1)


class WrongShape(Whole):
    def forward(self, x, state=None):
        return self.line(x)[..., 0], self.initial_state(x.shape[1])


class WrongState(Whole):
    def forward(self, x, state=None):
        return self.line(x), x.new_zeros(x.shape[1], 3)


class Forgetful(Whole):
    def __init__(self, config):
        super().__init__(config)
        self.state_size = 1

    def forward(self, x, state=None):
        y = torch.cumsum(self.line(x), 0)  # the state it is given is not used
        return y, y[-1]


class Clairvoyant(Whole):
    def forward(self, x, state=None):
        return self.line(x.flip(0)), self.initial_state(x.shape[1])

    def step(self, x, state):
        return self.line(x), state


class Idle(Whole):
    def __init__(self, config):
        super().__init__(config)
        self.spare = torch.nn.Linear(2, 2)


class Untrained(Whole):
    def __init__(self, config):
        super().__init__(config)
        self.line.requires_grad_(False)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (object, r"must be a class derived from learn\.Network"),
        (NoSummary, r"lacks `summary`.*NoSummary\)"),
        (NoForward, r"lacks the method `forward`.*NoForward\)"),
        (WrongSizes, r"names size 'width'; there are hidden"),
        (NoStateSize, r"does not set state_size"),
        (WrongShape, r"outputs of shape \(7, 2\), not \(time, batch, 1\)"),
        (WrongState, r"a state of shape \(2, 3\), not \(batch, state_size\)"),
        (Forgetful, r"step after step it gives something else"),
        (Clairvoyant, r"step after step it gives something else"),
        (Idle, r"the output does not depend on weight spare"),
        (Untrained, r"no weights to train"),
    ],
)
def test_half_a_network_is_refused(kind, message):
    with pytest.raises(InputError, match=message):
        learn.NETWORKS.register("half")(kind)
    assert "half" not in learn.NETWORKS


class Sgd(MinibatchOptimiser):
    summary = "plain descent"

    def build(self, parameters, config):
        return torch.optim.SGD(parameters, lr=config.rate)


class NoBuild(MinibatchOptimiser):
    summary = "nothing"


class Neither(Optimiser):
    summary = "no way to call it"


class OtherSettings(Sgd):
    settings = ("momentum",)


class Uphill(Sgd):
    def build(self, parameters, config):
        return torch.optim.SGD(parameters, lr=config.rate, maximize=True)


class NotTorch(Sgd):
    def build(self, parameters, config):
        return list(parameters)


class Partial(FullBatchOptimiser):
    summary = "nothing to step with"

    def build(self, objective, start, config):
        return object()


class Stuck(FullBatchOptimiser):
    summary = "it does not move"

    def build(self, objective, start, config):
        method = ScaledConjugateGradient(objective, start)
        method.step = lambda: False
        return method


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Whole, r"must be a class derived from learn\.training\.optimiser\.Optimiser"),
        (NoBuild, r"lacks the method `build`"),
        (Neither, r"must derive from MinibatchOptimiser or FullBatchOptimiser"),
        (OtherSettings, r"names setting 'momentum'; there are rate"),
        (Uphill, r"8 steps do not lower the error of a line"),
        (NotTorch, r"build gives list, not a torch\.optim\.Optimizer"),
        (Partial, r"lacks parameters, error, scale"),
        (Stuck, r"do not lower the error of a parabola"),
    ],
)
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


class NoChannels(Still):
    channels = ()


class UnknownChannel(Still):
    channels = ("measured_dept",)


class Cheat(Still):
    channels = ("true_surge",)


class OddColour(Still):
    colour = "pink"


class NoStep(VelocityEstimator):
    kind = "half"
    summary = "nothing"
    channels = ("measured_depth",)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (NoStep, r"lacks the method `step`"),
        (NoChannels, r"lacks `channels`"),
        (UnknownChannel, r"unknown signal 'measured_dept': did you mean 'measured_depth'"),
        (Cheat, r"a velocity estimator must not see the truth"),
        (OddColour, r"unknown colour 'pink'"),
    ],
)
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
