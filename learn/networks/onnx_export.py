"""ONNX export: one time step of a network with explicit state, for on-board use.

    features (1, inputs), state (1, state_size)  ->  velocity (1, 1), next_state (1, state_size)

Features are in their own units and the velocity in m/s: the normalisation is inside. All values are
float32 and all shapes are fixed. The file's metadata hold the features in order, their units, the
velocity, the sample period and the version of this layout. The graph is torch's own export of
`Network.step`, so that a type of network needs no second description.

`Parity` holds the difference between an exported network and the trained one.
"""

from __future__ import annotations

import copy
import dataclasses
import json
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from learn.data.dataset import MissionSequence
from learn.networks.predictor import Predictor
from twin.errors import InputError, StoreError
from twin.extras import preload_triton, require
from twin.navigation.features import feature, is_known
from twin.records.storage.whole import whole_file

TOLERANCE = 1e-5
"""[m/s] Limit of the difference from the trained network over a mission."""


@dataclasses.dataclass(frozen=True)
class Parity:
    """Difference between an exported model and the trained network on one mission."""

    path: Path
    mission: int
    samples: int
    largest: float
    """[m/s] Largest absolute difference."""
    rms: float
    """[m/s] Root mean square difference of surge or of sway, the larger of both."""
    step_us: float
    """[us] Time per step with one thread."""


Floats = NDArray[np.float32]

LAYOUT = 1
"""Version of the input and output names and of the metadata."""
OPSET = 18
"""ONNX operator set (2022): the oldest that torch's exporter writes."""
IR_VERSION = 8
"""Version of the ONNX file format that belongs to OPSET."""
INPUTS = ("features", "state")
OUTPUTS = ("velocity", "next_state")
EXPORTER_MODULES = r"(torch|onnxscript|onnx_ir|copyreg)(\.|$)"
"""Modules whose warnings are silenced; a user's network warns from another module."""


class _Step(nn.Module):
    """One step with normalisation: (features, state) to (velocity, next_state)."""

    mean: Tensor
    scale: Tensor

    def __init__(self, predictor: Predictor) -> None:
        super().__init__()
        scales = predictor.normalisation
        self.network = predictor.network
        self.register_buffer("mean", torch.tensor([scales.mean], dtype=torch.float32))
        self.register_buffer("scale", torch.tensor([scales.scale], dtype=torch.float32))
        self.target_mean, self.target_scale = scales.target_mean, scales.target_scale

    def forward(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        y, next_state = self.network.step((features - self.mean) / self.scale, state)
        return self.target_scale * y + self.target_mean, next_state


def step_model(predictor: Predictor, period: float) -> onnx.ModelProto:
    """Export one step of a predictor as an ONNX model.

    Args:
      period: [s] sample period of the training.

    Raises:
      InputError: torch cannot export the network, such as a user's own class.
    """
    preload_triton()  # torch.export imports triton where it is installed
    network = predictor.network
    kind = network.config.kind
    step = _Step(dataclasses.replace(predictor, network=copy.deepcopy(network).cpu())).eval()
    given = (torch.zeros(1, len(predictor.features)), step.network.initial_state(1))
    try:
        with _quiet_exporter(), torch.no_grad():
            program = torch.onnx.export(
                step,
                given,
                input_names=INPUTS,
                output_names=OUTPUTS,
                opset_version=OPSET,
                dynamo=True,
                verbose=False,
            )
    except torch.onnx.errors.OnnxExporterError as error:
        reason = " ".join(str(error.__cause__ or error).split())
        raise InputError(
            f"torch cannot export network {kind!r} ({reason[:200]}): its step must be made of "
            "operators that torch.onnx.export knows, without data-dependent branches"
        ) from error
    assert program is not None
    model = program.model_proto
    _strip(model)
    model.ir_version, model.producer_name = IR_VERSION, "glider-twin"
    model.producer_version = ""
    model.graph.name = f"{predictor.target} step"
    onnx.helper.set_model_props(
        model,
        {
            "layout": str(LAYOUT),
            "target": predictor.target,
            "unit": "m s-1",
            "period_s": f"{period:g}",
            "network": json.dumps(dataclasses.asdict(network.config)),
            "features": json.dumps(
                {name: {"unit": feature(name).unit} for name in predictor.features}
            ),
        },
    )
    onnx.checker.check_model(model, full_check=True)
    return model


@contextmanager
def _quiet_exporter() -> Iterator[None]:
    """Silence warnings of torch's exporter on its deprecations and on missing torchvision."""
    logger = logging.getLogger("torch.onnx._internal.exporter._registration")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=EXPORTER_MODULES)
            yield
    finally:
        logger.setLevel(level)


def _strip(model: onnx.ModelProto) -> None:
    """Remove stack traces from the model: they name folders of the exporting machine."""
    graph = model.graph
    for part in (*graph.node, *graph.initializer, *graph.input, *graph.output, *graph.value_info):
        part.ClearField("metadata_props")
        part.ClearField("doc_string")
    for part in (model, graph):
        part.ClearField("metadata_props")
        part.ClearField("doc_string")


class StepModel:
    """Exported model in onnxruntime, run one step at a time as on board."""

    def __init__(self, path: Path) -> None:
        """Open a file that `step_model` made.

        Raises:
          InputError: onnxruntime is not installed.
          StoreError: the file is missing or not ONNX, or has other inputs and outputs, another
            layout, or features unknown to this version.
        """
        require("onnxruntime", extra="onnx", purpose="running an exported model")
        import onnxruntime

        if not path.is_file():
            raise StoreError(f"no model at {path}; make one with `learn export`")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        try:
            self._session = onnxruntime.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime's exceptions have no common base class
            message = " ".join(str(error).split())
            raise StoreError(f"{path} is not a model that onnxruntime reads: {message}") from error
        found = tuple(i.name for i in self._session.get_inputs())
        made = tuple(o.name for o in self._session.get_outputs())
        if found != INPUTS or made != OUTPUTS:
            raise StoreError(
                f"{path} has inputs {', '.join(found)} and outputs {', '.join(made)}; a step model "
                f"has {', '.join(INPUTS)} and {', '.join(OUTPUTS)}; export it again"
            )
        about = self._session.get_modelmeta().custom_metadata_map
        if about.get("layout") != str(LAYOUT):
            raise StoreError(
                f"{path} has layout {about.get('layout')}, this program reads {LAYOUT}; "
                "export it again"
            )
        self.target: str = about["target"]
        self.features: tuple[str, ...] = tuple(json.loads(about["features"]))
        unknown = [name for name in self.features if not is_known(name)]
        if unknown:
            raise StoreError(f"{path} needs feature {unknown[0]!r}, which this version lacks")
        self._state_size = int(self._session.get_inputs()[1].shape[1])

    def run(self, features: Floats) -> Floats:
        """[m/s] Velocity, (time,), for features (time, inputs) in their units, from zero state."""
        state = np.zeros((1, self._state_size), np.float32)
        velocity = np.empty(len(features), np.float32)
        for k, row in enumerate(np.asarray(features, np.float32)):
            y, state = self._session.run(list(OUTPUTS), {INPUTS[0]: row[None], INPUTS[1]: state})
            velocity[k] = y[0, 0]
        return velocity


def export_step(predictor: Predictor, path: Path, mission: MissionSequence) -> Parity:
    """Write a step model and compare it with the trained network over a whole mission.

    Raises:
      StoreError: the file cannot be written, or differs from the trained network by more than
        TOLERANCE. Then an earlier file at `path` stays.
    """
    import time

    with whole_file(path) as place:
        onnx.save(step_model(predictor, mission.period), str(place))
        model = StepModel(place)
        features = mission.features(model.features)
        start = time.perf_counter()
        stepped = model.run(features)
        seconds = time.perf_counter() - start
        (trained,) = predictor.predict([mission])
        off = np.abs(stepped - trained)
        largest = float(off.max())
        if not largest <= TOLERANCE:
            raise StoreError(
                f"the exported {predictor.target} model differs by {largest:.2g} m/s from the "
                f"network on mission {mission.index} (allowed {TOLERANCE:g}); it was not kept. A "
                "network with a state that amplifies rounding does so: train it longer, or with "
                "another --seed"
            )
    rms, step_us = float(np.sqrt(np.mean(off**2))), 1e6 * seconds / mission.samples
    return Parity(path, mission.index, mission.samples, largest, rms, step_us)
