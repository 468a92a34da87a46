"""ONNX step models against the networks that they were made from."""

import json
import logging
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from navigation import PERIOD, trimmed_mission
from onnx import helper

from learn.commands.trained import ExportNetwork
from learn.data.dataset import MissionSequence
from learn.data.sequences import Normalisation
from learn.networks.base import NetworkConfig, build_network
from learn.networks.onnx_export import (
    INPUTS,
    OUTPUTS,
    TOLERANCE,
    StepModel,
    export_step,
    step_model,
)
from learn.networks.predictor import Predictor
from learn.seams import NETWORKS
from twin.cli.console import Console
from twin.errors import InputError, StoreError

FEATURES = ("sin_roll", "sin_pitch", "cos_pitch", "depth_rate", "pump")


def predictor(kind="elman", **sizes):
    torch.manual_seed(3)
    sizes = {"hidden": 7, "layers": 2, **sizes}
    config = NetworkConfig(kind=kind, inputs=len(FEATURES), period=PERIOD, **sizes)
    scales = Normalisation(
        features=FEATURES,
        mean=(0.0, -0.1, 0.9, 0.05, -50.0),
        scale=(0.2, 0.5, 0.1, 0.2, 250.0),
        target="surge",
        target_mean=0.4,
        target_scale=0.12,
    )
    return Predictor(build_network(config), scales)


@pytest.fixture(scope="module")
def mission():
    signals = trimmed_mission(600)
    rng = np.random.default_rng(0)
    for name in ("measured_pitch", "measured_roll", "measured_pump"):
        signals[name] = signals[name] + 5.0 * np.sin(np.arange(600) / 20) + rng.normal(size=600)
    return MissionSequence(index=4, split="test", period=PERIOD, signals=signals)


@pytest.mark.parametrize(
    ("kind", "sizes"),
    [
        *((kind, {}) for kind in NETWORKS),
        ("elman", {"delays": 1, "layers": 1}),
        ("elman", {"delays": 5, "layers": 3, "hidden": 50}),
        ("tcn", {"kernel": 2, "dilation": 3, "layers": 3}),
        ("tcn", {"hidden": len(FEATURES)}),
        ("gru", {"layers": 1}),
    ],
)
def test_every_kind_steps_like_the_network_over_a_mission(kind, sizes, mission, tmp_path):
    parity = export_step(predictor(kind, **sizes), tmp_path / "step.onnx", mission)
    assert parity.largest <= TOLERANCE
    assert parity.samples == 600
    # The comparison means something only if the velocity moves.
    velocity = StepModel(parity.path).run(mission.features(FEATURES))
    assert velocity.std() > 20 * TOLERANCE


def test_the_model_is_float32_and_says_what_it_needs(tmp_path):
    model = step_model(predictor(), PERIOD)
    graph = model.graph
    assert [value.name for value in graph.input] == list(INPUTS)
    assert [value.name for value in graph.output] == list(OUTPUTS)
    assert {t.data_type for t in graph.initializer} <= {
        onnx.TensorProto.FLOAT,
        onnx.TensorProto.INT64,
    }
    about = {entry.key: entry.value for entry in model.metadata_props}
    assert list(json.loads(about["features"])) == list(FEATURES)
    assert json.loads(about["features"])["pump"] == {"unit": "cm3"}
    assert about["period_s"] == "0.5"
    assert about["unit"] == "m s-1"
    assert about["layout"] == "1"
    for value in (*graph.input, *graph.output):
        assert all(size.HasField("dim_value") for size in value.type.tensor_type.shape.dim)


@pytest.mark.parametrize("kind", ["elman", "gru"])
def test_a_model_names_no_folder_of_the_machine_that_made_it(kind):
    data = step_model(predictor(kind), PERIOD).SerializeToString()
    for folder in (Path(torch.__file__).parents[1], Path(__file__).parents[3]):
        assert str(folder).encode() not in data


def test_exporting_leaves_the_network_and_the_loggers_as_they_were():
    whole = predictor("elman")
    before = {name: value.clone() for name, value in whole.network.state_dict().items()}
    logger = logging.getLogger("torch.onnx._internal.exporter._registration")
    level = logger.level
    whole.network.train()
    step_model(whole, PERIOD)
    assert whole.network.training
    assert logger.level == level
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, before[name])


def test_a_model_with_other_inputs_is_refused(tmp_path):
    node = helper.make_node("Identity", ["x"], ["y"])
    values = [helper.make_tensor_value_info(name, 1, [1, 3]) for name in ("x", "y")]
    graph = helper.make_graph([node], "other", values[:1], values[1:])
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=8), tmp_path / "o.onnx")
    with pytest.raises(StoreError, match=r"has inputs x and outputs y; .*features, state"):
        StepModel(tmp_path / "o.onnx")


def test_another_layout_an_unknown_feature_and_no_model_are_explained(tmp_path):
    model = step_model(predictor(), PERIOD)
    entries = {entry.key: entry for entry in model.metadata_props}
    entries["features"].value = json.dumps({"magic": {"unit": "1"}})
    onnx.save(model, tmp_path / "m.onnx")
    with pytest.raises(StoreError, match="needs feature 'magic'"):
        StepModel(tmp_path / "m.onnx")
    entries["layout"].value = "99"
    onnx.save(model, tmp_path / "m.onnx")
    with pytest.raises(StoreError, match="has layout 99"):
        StepModel(tmp_path / "m.onnx")
    with pytest.raises(StoreError, match="learn export"):
        StepModel(tmp_path / "none.onnx")
    (tmp_path / "text.onnx").write_text("not a model")
    with pytest.raises(StoreError, match="not a model that onnxruntime reads"):
        StepModel(tmp_path / "text.onnx")


def test_a_model_that_differs_is_not_kept(mission, tmp_path, monkeypatch):
    network = predictor()
    monkeypatch.setattr(
        "learn.networks.onnx_export.step_model", lambda p, period: step_model(other, period)
    )
    other = predictor("lstm")
    with pytest.raises(StoreError, match="differs by"):
        export_step(network, tmp_path / "step.onnx", mission)
    assert not (tmp_path / "step.onnx").exists()


# --- `learn export` says how to install what it needs, before it reads anything


@pytest.mark.parametrize("package", ["onnx", "onnxscript", "onnxruntime"])
def test_export_needs_the_extra_onnx(package, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf'{package},.* pip install "glider-twin\[onnx\]"$'):
        ExportNetwork(run_folder=tmp_path / "none").run(Console("learn"))


def test_running_a_model_needs_the_extra_onnx(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(InputError, match=r'pip install "glider-twin\[onnx\]"$'):
        StepModel(tmp_path / "none.onnx")
