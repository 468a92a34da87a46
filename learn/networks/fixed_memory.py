"""Fixed memory: networks with an untrained memory of past inputs, read by a trained function.

    z_t, state = recall(x_t, state)     fixed: without trained weights
    y_t = read(z_t)                     trained: a function of one sample

Since z does not depend on the weights, a training computes z once for whole missions. The training
then uses single samples in any order: no windows, no warm-up, and no gradient through time.
"""

from __future__ import annotations

import abc
import math
from typing import ClassVar

import torch
from torch import Tensor, nn

from learn.networks.base import Network, NetworkConfig
from learn.networks.c_step import CStep, perceptron, transposed
from twin.errors import InputError

AT_A_TIME = 2**13
"""Samples that `FixedMemory.read_apart` reads together"""


class FixedMemory(Network):
    """Base class of networks with a fixed memory. A subclass writes `recall` and `read`."""

    @abc.abstractmethod
    def recall(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Memory (time, batch, recalled) for inputs (time, batch, inputs), and the final state."""

    @abc.abstractmethod
    def read(self, recalled: Tensor) -> Tensor:
        """Outputs (..., 1) from the memory (..., recalled)."""

    def read_apart(self, recalled: Tensor) -> Tensor:
        """Outputs as by `read`, from some samples at a time, so that layers stay in the cache."""
        rows = recalled.reshape(-1, recalled.shape[-1]).split(AT_A_TIME)
        return torch.cat([self.read(some) for some in rows]).reshape(*recalled.shape[:-1], 1)

    def mirrored(self, signs: Tensor) -> Tensor:
        """Signs (recalled,) of the memory in a mission's mirror image, from input signs (inputs,).

        `recall` must be linear, apart from its start."""
        recalled, _ = self.recall(signs[None, None], self.initial_state(1))
        return torch.sign(recalled[0, 0])

    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """See `Network.forward`."""
        state = self.initial_state(x.shape[1]) if state is None else state
        recalled, state = self.recall(x, state)
        read = self.read if torch.is_grad_enabled() else self.read_apart
        return read(recalled), state


def _perceptron(inputs: int, config: NetworkConfig, unit: type[nn.Module]) -> nn.Sequential:
    sizes = [inputs] + [config.hidden] * config.layers
    layers: list[nn.Module] = []
    for size in sizes[:-1]:
        layers += [nn.Linear(size, config.hidden), unit()]
    return nn.Sequential(*layers, nn.Linear(sizes[-1], 1))


def _body_arrays(body: nn.Sequential) -> tuple[dict[str, Tensor], list[int]]:
    """Weights and biases of a perceptron by their names in C, and the sizes of its layers."""
    layers = [layer for layer in body if isinstance(layer, nn.Linear)]
    arrays: dict[str, Tensor] = {}
    for k, layer in enumerate(layers):
        arrays |= {f"weight_{k}": transposed(layer.weight), f"bias_{k}": layer.bias}
    return arrays, [layers[0].in_features, *(layer.out_features for layer in layers)]


class Memoryless(FixedMemory):
    """Multilayer perceptron of one sample at a time: the baseline for networks with memory."""

    summary = "a multilayer perceptron without memory"
    state_size = 0

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.body = _perceptron(config.inputs, config, nn.Tanh)

    def recall(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Inputs unchanged; see `FixedMemory.recall`."""
        return x, state

    def read(self, recalled: Tensor) -> Tensor:
        """See `FixedMemory.read`."""
        return self.body(recalled)

    def c_step(self) -> CStep:
        """See `Network.c_step`."""
        arrays, sizes = _body_arrays(self.body)
        return CStep(
            arrays=arrays, body=f"(void)state;\n{perceptron(sizes, 'gt_tanhs')}\nreturn out[0];"
        )


BLOCK = 32
"""Number of samples whose averages are computed in one matrix product."""


class ExponentialAverages(FixedMemory):
    """Exponential moving averages of every input, read by a perceptron.

        m_t = m_{t-1} + (1 - exp(-T / tau)) (x_t - m_{t-1})

    for each input x and each memory tau [s], with sample period T [s]. The averages start at the
    first sample. This is the exponential trace memory of M. C. Mozer, "Neural net architectures for
    temporal sequence processing" (1993), with given decays instead of learned ones. A glider
    settles within half a minute; averages over 2, 8 and 30 s show its distance from steady state.
    State columns: the averages, memory by memory, then 1 after the first sample.

    The readout is a perceptron of SiLU units in parallel with a linear layer. The linear layer
    learns relations such as speed along a steady path at once, which also hold outside training.
    """

    summary = "exponential moving averages of every input, read by a perceptron without memory"
    sizes = ("hidden", "layers", "memories")
    unit: ClassVar[type[nn.Module]] = nn.SiLU
    keep: Tensor

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        if not config.period > 0.0:
            raise InputError(
                "network ema averages over seconds and must know the period of the samples: give "
                "NetworkConfig its period [s]; a training fills it in from the store"
            )
        keep = [math.exp(-config.period / memory) for memory in config.memories]
        self.register_buffer("keep", torch.tensor(keep)[:, None], persistent=False)
        width = config.inputs * (1 + len(config.memories))
        self.body = _perceptron(width, config, self.unit)
        self.straight = nn.Linear(width, 1, bias=False)
        self.state_size = config.inputs * len(config.memories) + 1

    def recall(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Inputs and then their averages, memory by memory; see `FixedMemory.recall`.

        Within a block the averages are one product with a triangular matrix. Only the step from
        block to block is a loop.
        """
        time, batch, inputs = x.shape
        keep, blocks = self.keep, -(-time // BLOCK)
        padded = nn.functional.pad(x, (0, 0, 0, 0, 0, blocks * BLOCK - time))
        own = self._of_a_block(keep) @ padded.view(blocks, BLOCK, batch * inputs)[:, None]
        carried = self._before(x[0], state).transpose(0, 1).reshape(len(keep), -1)
        starts = []
        for block in own:
            starts.append(carried)
            carried = block[:, -1] + keep**BLOCK * carried
        fading = keep ** torch.arange(1, BLOCK + 1).to(keep)
        averages = own + fading[:, :, None] * torch.stack(starts)[:, :, None]
        averages = averages.view(blocks, len(keep), BLOCK, batch, inputs).permute(0, 2, 3, 1, 4)
        averages = averages.reshape(blocks * BLOCK, batch, -1)[:time]
        state = torch.cat([averages[-1], torch.ones_like(state[:, -1:])], 1)
        return torch.cat([x, averages], -1), state

    def _of_a_block(self, keep: Tensor) -> Tensor:
        """Matrices (memories, BLOCK, BLOCK) from a block's samples to their share of averages."""
        places = torch.arange(BLOCK).to(keep)
        age = places[:, None] - places
        return torch.where(age < 0, 0.0, (1.0 - keep[..., None]) * keep[..., None] ** age.clamp(0))

    def _before(self, x: Tensor, state: Tensor) -> Tensor:
        """Averages (batch, memories, inputs) before the sample x (batch, inputs): from the state,
        or the sample itself if x is the first."""
        averages = state[:, :-1].unflatten(1, (len(self.keep), self.config.inputs))
        return torch.lerp(x[:, None].expand_as(averages), averages, state[:, -1:, None])

    def step(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """See `Network.step`."""
        now = x[:, None]
        averages = (now + self.keep * (self._before(x, state) - now)).flatten(1)
        state = torch.cat([averages, torch.ones_like(state[:, -1:])], 1)
        return self.read(torch.cat([x, averages], 1)), state

    def read(self, recalled: Tensor) -> Tensor:
        """See `FixedMemory.read`."""
        return self.body(recalled) + self.straight(recalled)

    def c_step(self) -> CStep:
        """See `Network.c_step`."""
        arrays, sizes = _body_arrays(self.body)
        arrays |= {"keep": self.keep, "straight": self.straight.weight}
        inputs, memories = self.config.inputs, len(self.keep)
        # the first layer reads inputs and averages in place: a copy would take 0.4 kB of stack
        made, rows = ("h0" if len(sizes) > 2 else "out"), sizes[1]
        averages = inputs * memories
        layers = perceptron(sizes, "gt_silu", "seen").replace(
            f"gt_dense({made}, weight_0, bias_0, seen, {sizes[0]}, {rows});",
            f"gt_dense({made}, weight_0, bias_0, x, {inputs}, {rows});\n"
            f"gt_add({made}, weight_0 + {inputs * rows}, state, {averages}, {rows});",
        )
        body = f"""
const int started = state[{averages}] != 0.0f;
for (int k = 0; k < {memories}; k++) {{
    for (int i = 0; i < {inputs}; i++) {{
        float *average = state + k * {inputs} + i;
        const float before = started ? *average : x[i];
        *average = x[i] + keep[k] * (before - x[i]);
    }}
}}
state[{averages}] = 1.0f;
{layers}
gt_add(out, straight, x, {inputs}, 1);
gt_add(out, straight + {inputs}, state, {averages}, 1);
return out[0];"""
        return CStep(arrays=arrays, body=body)
