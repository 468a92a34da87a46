"""Plain networks: exponential averages and their perceptron in numpy, without torch.

`PlainAverages` computes what `learn.networks.fixed_memory.ExponentialAverages` computes, to
rounding of float32. `load_weights` reads a file of safetensors.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from twin.errors import StoreError

Floats = NDArray[np.float32]
AT_A_TIME = 2**15
"""Samples that the perceptron reads together, so that its layers stay in the cache"""


def averages(x: Floats, period: float, memories: Sequence[float]) -> Floats:
    """Inputs (time, inputs), then their exponential averages, memory by memory; [s] both times."""
    found = [x]
    for memory in memories:
        keep = math.exp(-period / memory)
        made, _ = lfilter([1.0 - keep], [1.0, -keep], x, axis=0, zi=keep * x[:1])
        found.append(made.astype(np.float32))
    return np.concatenate(found, 1)


def load_weights(path: Path) -> dict[str, Floats]:
    """Read arrays of float32 from a file of safetensors.

    Raises:
      StoreError: the file is damaged, or has another type of number.
    """
    data = path.read_bytes()
    try:
        size = int.from_bytes(data[:8], "little")
        head = json.loads(data[8 : 8 + size])
        head.pop("__metadata__", None)
        found = {}
        for name, entry in head.items():
            begin, end = entry["data_offsets"]
            if entry["dtype"] != "F32":
                raise ValueError(f"{name} is of {entry['dtype']}")
            values = np.frombuffer(data[8 + size + begin : 8 + size + end], "<f4")
            found[name] = values.reshape(entry["shape"])
        return found
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise StoreError(f"{path} is damaged: {error}") from error


class PlainAverages:
    """Network `ema` in numpy, over whole missions or sample by sample."""

    def __init__(self, config: Mapping[str, Any], weights: Mapping[str, Floats]) -> None:
        """Create the network.

        Args:
          config: fields of `NetworkConfig`.
          weights: arrays of `ExponentialAverages`, by name.

        Raises:
          KeyError: an array or a field is missing.
        """
        self.period = float(config["period"])
        self.memories = tuple(map(float, config["memories"]))
        layers = sorted({int(name.split(".")[1]) for name in weights if name.startswith("body.")})
        self._layers = [(weights[f"body.{k}.weight"].T, weights[f"body.{k}.bias"]) for k in layers]
        self._straight = weights["straight.weight"][0]
        self._keep = np.array([[math.exp(-self.period / m)] for m in self.memories], np.float32)

    def read(self, recalled: Floats) -> Floats:
        """Normalised outputs (samples,) from inputs and averages (samples, recalled)."""
        found = []
        for first in range(0, len(recalled), AT_A_TIME):
            rows = recalled[first : first + AT_A_TIME]
            values: NDArray[Any] = rows
            for matrix, bias in self._layers[:-1]:
                values = values @ matrix + bias
                with np.errstate(over="ignore"):  # exp of a large number: the unit is 0 then
                    values = values / (1.0 + np.exp(-values))
            matrix, bias = self._layers[-1]
            found.append((values @ matrix + bias)[:, 0] + rows @ self._straight)
        return np.concatenate(found)

    def run_missions(self, matrices: Sequence[Floats]) -> list[Floats]:
        """Normalised outputs (time,) of each mission from normalised inputs (time, inputs)."""
        return [self.read(averages(x, self.period, self.memories)) for x in matrices]

    def begin(self) -> Floats:
        """State before the first sample: NaN (memories, inputs)."""
        return np.full((len(self.memories), len(self._straight) // (1 + len(self.memories))),
                       np.nan, np.float32)  # fmt: skip

    def step_sample(self, x: Floats, state: Floats) -> tuple[float, Floats]:
        """Normalised output for one sample (inputs,), and the state after it."""
        before = np.where(np.isnan(state), x, state)
        state = (x + self._keep * (before - x)).astype(np.float32)
        return float(self.read(np.concatenate([x, state.ravel()])[None])[0]), state
