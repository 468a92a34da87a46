"""ONNX export: one time step of a network with explicit state, for on-board use.

    features (1, inputs), state (1, state_size)  ->  velocity (1, 1), next_state (1, state_size)

Features are in their own units and the velocity in m/s: the scales are inside. Everything is
float32. The file's metadata say which features in which order, their units, the velocity, the
sample period and the version of this layout. The graph is written operator by operator, so that it
needs no exporter and has nothing in it that a small runtime lacks.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from learn.data.dataset import Mission
from learn.data.features import FEATURES
from learn.networks.network import NetworkConfig
from learn.networks.predictor import Predictor
from twin.errors import StoreError
from twin.extras import require

Floats = NDArray[np.float32]

LAYOUT = 1
"""Version of names and metadata."""
OPSET = 17
"""ONNX operator set (2022): old enough for embedded runtimes; tanh, MatMul and Split suffice."""
IR_VERSION = 8
"""Of the file format that goes with it."""
INPUTS = ("features", "state")
OUTPUTS = ("velocity", "next_state")
TOLERANCE = 1e-5
"""[m/s] largest difference to the trained network over a mission."""


class Graph:
    """Collects nodes; values are named by counting."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def op(self, kind: str, *inputs: str, **attributes: Any) -> str:
        """One node with one output; returns the output's name."""
        return self.ops(kind, 1, *inputs, **attributes)[0]

    def ops(self, kind: str, count: int, *inputs: str, **attributes: Any) -> list[str]:
        """One node with `count` outputs; returns their names."""
        place = len(self.nodes)
        names = [f"{kind.lower()}_{place}_{k}" for k in range(count)]
        self.nodes.append(helper.make_node(kind, list(inputs), names, **attributes))
        return names

    def constant(self, values: Any) -> str:
        """A constant of float32, or of int64 for integers; returns its name."""
        array = np.asarray(values)
        array = array.astype(np.int64 if array.dtype.kind == "i" else np.float32)
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name

    def affine(self, x: str, weight: Floats, bias: Floats | None) -> str:
        """x W^T + b."""
        product = self.op("MatMul", x, self.constant(weight.T))
        return product if bias is None else self.op("Add", product, self.constant(bias))

    def split(self, x: str, widths: Sequence[int]) -> list[str]:
        """Columns of x in parts of these widths."""
        if len(widths) == 1:
            return [x]
        return self.ops("Split", len(widths), x, self.constant(list(widths)), axis=1)

    def concat(self, parts: Sequence[str]) -> str:
        """Parts side by side."""
        return parts[0] if len(parts) == 1 else self.op("Concat", *parts, axis=1)

    def columns(self, x: str, start: int, end: int) -> str:
        """x[:, start:end]."""
        bounds = (self.constant([v]) for v in (start, end, 1))
        return self.op("Slice", x, *bounds)


Weights = Mapping[str, Floats]


def _elman(g: Graph, config: NetworkConfig, w: Weights, x: str, state: str) -> tuple[str, str]:
    width = config.delays * config.hidden
    ends = []
    for layer, history in enumerate(g.split(state, [width] * config.layers)):
        name = f"hidden.{layer}"
        total = g.op(
            "Add",
            g.affine(x, w[f"{name}.weight"], w[f"{name}.bias"]),
            g.affine(history, w[f"{name}.recurrent"], None),
        )
        x = g.op("Tanh", total)
        if config.delays > 1:
            ends.append(g.columns(history, config.hidden, width))
        ends.append(x)
    return g.affine(x, w["out.weight"], w["out.bias"]), g.concat(ends)


def _lstm(g: Graph, config: NetworkConfig, w: Weights, x: str, state: str) -> tuple[str, str]:
    parts = g.split(state, [config.hidden] * (2 * config.layers))
    outputs, cells = parts[: config.layers], parts[config.layers :]
    for layer in range(config.layers):
        gates = g.op(
            "Add",
            g.affine(x, w[f"cells.weight_ih_l{layer}"], w[f"cells.bias_ih_l{layer}"]),
            g.affine(outputs[layer], w[f"cells.weight_hh_l{layer}"], w[f"cells.bias_hh_l{layer}"]),
        )
        enter, forget, new, leave = g.split(gates, [config.hidden] * 4)
        kept = g.op("Mul", g.op("Sigmoid", forget), cells[layer])
        gained = g.op("Mul", g.op("Sigmoid", enter), g.op("Tanh", new))
        cells[layer] = g.op("Add", kept, gained)
        x = outputs[layer] = g.op("Mul", g.op("Sigmoid", leave), g.op("Tanh", cells[layer]))
    return g.affine(x, w["out.weight"], w["out.bias"]), g.concat([*outputs, *cells])


def _gru(g: Graph, config: NetworkConfig, w: Weights, x: str, state: str) -> tuple[str, str]:
    outputs = g.split(state, [config.hidden] * config.layers)
    for layer in range(config.layers):
        given = g.affine(x, w[f"cells.weight_ih_l{layer}"], w[f"cells.bias_ih_l{layer}"])
        past = g.affine(
            outputs[layer], w[f"cells.weight_hh_l{layer}"], w[f"cells.bias_hh_l{layer}"]
        )
        reset, update, new = g.split(given, [config.hidden] * 3)
        reset_past, update_past, new_past = g.split(past, [config.hidden] * 3)
        reset = g.op("Sigmoid", g.op("Add", reset, reset_past))
        update = g.op("Sigmoid", g.op("Add", update, update_past))
        new = g.op("Tanh", g.op("Add", new, g.op("Mul", reset, new_past)))
        # (1 - z) n + z h, written with one product less
        change = g.op("Mul", update, g.op("Sub", outputs[layer], new))
        x = outputs[layer] = g.op("Add", new, change)
    return g.affine(x, w["out.weight"], w["out.bias"]), g.concat(outputs)


def _tcn(g: Graph, config: NetworkConfig, w: Weights, x: str, state: str) -> tuple[str, str]:
    sizes = [config.inputs] + [config.hidden] * (config.layers - 1)
    spacings = [config.dilation**layer for layer in range(config.layers)]
    reaches = [(config.kernel - 1) * spacing for spacing in spacings]
    pasts = g.split(state, [r * s for r, s in zip(reaches, sizes, strict=True)])
    ends = []
    for layer, (size, spacing) in enumerate(zip(sizes, spacings, strict=True)):
        seen = g.concat([pasts[layer], x])
        ends.append(g.columns(seen, size, (reaches[layer] + 1) * size))
        taps, bias = w[f"taps.{layer}.weight"], w[f"taps.{layer}.bias"]
        total = g.constant(bias[None])
        for tap in range(config.kernel):
            sample = g.columns(seen, tap * spacing * size, (tap * spacing + 1) * size)
            total = g.op("Add", total, g.affine(sample, taps[:, :, tap], None))
        new = g.op("Tanh", total)
        x = g.op("Add", new, x) if size == config.hidden else new
    return g.affine(x, w["out.weight"], w["out.bias"]), g.concat(ends)


def _mlp(g: Graph, config: NetworkConfig, w: Weights, x: str, state: str) -> tuple[str, str]:
    for layer in range(config.layers):
        name = f"body.{2 * layer}"
        x = g.op("Tanh", g.affine(x, w[f"{name}.weight"], w[f"{name}.bias"]))
    name = f"body.{2 * config.layers}"
    return g.affine(x, w[f"{name}.weight"], w[f"{name}.bias"]), state


_BUILDERS = {"elman": _elman, "lstm": _lstm, "gru": _gru, "tcn": _tcn, "mlp": _mlp}


def step_model(predictor: Predictor, period: float) -> onnx.ModelProto:
    """The ONNX model of one step.

    Args:
      period: [s] between samples of the missions that it was trained on.
    """
    network, scales = predictor.network, predictor.normalisation
    weights = {k: v.detach().cpu().numpy() for k, v in network.state_dict().items()}
    graph = Graph()
    shifted = graph.op("Sub", INPUTS[0], graph.constant([scales.mean]))
    x = graph.op("Div", shifted, graph.constant([scales.scale]))
    y, state = _BUILDERS[network.config.kind](graph, network.config, weights, x, INPUTS[1])
    scaled = graph.op("Mul", y, graph.constant([[scales.target_scale]]))
    velocity = graph.op("Add", scaled, graph.constant([[scales.target_mean]]))
    for value, name in zip((velocity, state), OUTPUTS, strict=True):
        graph.nodes.append(helper.make_node("Identity", [value], [name]))

    def tensor(name: str, width: int) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, width])

    widths = (len(predictor.features), network.state_size)
    model = helper.make_model(
        helper.make_graph(
            graph.nodes,
            f"{predictor.target} step",
            [tensor(name, width) for name, width in zip(INPUTS, widths, strict=True)],
            [tensor(name, width) for name, width in zip(OUTPUTS, (1, widths[1]), strict=True)],
            graph.constants,
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="glider-twin",
    )
    helper.set_model_props(
        model,
        {
            "layout": str(LAYOUT),
            "target": predictor.target,
            "unit": "m s-1",
            "period_s": f"{period:g}",
            "network": json.dumps(dataclasses.asdict(network.config)),
            "features": json.dumps(
                {name: {"unit": FEATURES[name].unit} for name in predictor.features}
            ),
        },
    )
    onnx.checker.check_model(model, full_check=True)
    return model


class StepModel:
    """An exported model in onnxruntime, one step at a time, as a vehicle would run it."""

    def __init__(self, path: Path) -> None:
        """Open a file that `step_model` made.

        Raises:
          InputError: onnxruntime is not installed.
          StoreError: no such file, not ONNX, other names of inputs and outputs, another layout, or
            features that this version does not know.
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
        except Exception as error:  # onnxruntime's own kinds have no common base
            message = " ".join(str(error).split())
            raise StoreError(f"{path} is not a model that onnxruntime reads: {message}") from error
        found = tuple(i.name for i in self._session.get_inputs())
        made = tuple(o.name for o in self._session.get_outputs())
        if found != INPUTS or made != OUTPUTS:
            raise StoreError(
                f"{path} has inputs {', '.join(found)} and outputs {', '.join(made)}; a step model "
                f"has {', '.join(INPUTS)} and {', '.join(OUTPUTS)}; export it anew"
            )
        about = self._session.get_modelmeta().custom_metadata_map
        if about.get("layout") != str(LAYOUT):
            raise StoreError(
                f"{path} has layout {about.get('layout')}, this program reads {LAYOUT}; "
                "export it anew"
            )
        self.target: str = about["target"]
        self.features: tuple[str, ...] = tuple(json.loads(about["features"]))
        unknown = [name for name in self.features if name not in FEATURES]
        if unknown:
            raise StoreError(f"{path} needs feature {unknown[0]!r}, which this version lacks")
        self._state_size = int(self._session.get_inputs()[1].shape[1])

    def run(self, features: Floats) -> Floats:
        """Velocity [m/s], (time,), for features (time, inputs) in their own units, from rest."""
        state = np.zeros((1, self._state_size), np.float32)
        velocity = np.empty(len(features), np.float32)
        for k, row in enumerate(np.asarray(features, np.float32)):
            y, state = self._session.run(list(OUTPUTS), {INPUTS[0]: row[None], INPUTS[1]: state})
            velocity[k] = y[0, 0]
        return velocity


@dataclasses.dataclass(frozen=True)
class Parity:
    """An exported model against the trained network on one mission."""

    path: Path
    mission: int
    samples: int
    largest: float
    """[m/s] largest difference."""
    step_us: float
    """[us] per step in onnxruntime, one thread."""


def export_step(predictor: Predictor, path: Path, mission: Mission) -> Parity:
    """Write a step model and run a whole mission through it.

    Raises:
      StoreError: it cannot be written, or differs by more than TOLERANCE from the trained network;
        the file is then removed.
    """
    import time

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        onnx.save(step_model(predictor, mission.period), str(path))
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error.strerror or error}") from error
    model = StepModel(path)
    features = mission.features(model.features)
    start = time.perf_counter()
    stepped = model.run(features)
    seconds = time.perf_counter() - start
    (trained,) = predictor.predict([mission])
    largest = float(np.abs(stepped - trained).max())
    if not largest <= TOLERANCE:
        path.unlink()
        raise StoreError(
            f"the exported {predictor.target} model differs by {largest:.2g} m/s from the network "
            f"on mission {mission.index} (allowed {TOLERANCE:g}); it was not kept. A network whose "
            "state amplifies rounding does so: train it longer, or with another --seed"
        )
    return Parity(path, mission.index, mission.samples, largest, 1e6 * seconds / mission.samples)
