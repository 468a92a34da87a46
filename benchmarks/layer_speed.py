"""Layer speed: seconds per gradient of 80 000 samples, against the machine's matrix products.

    python -m benchmarks.layer_speed [--json] [--sequences 16] [--repeats 5] [--threads 1]

Every layer stack has three hidden layers of 50 units and a linear output, reads 12 inputs, and
computes the mean squared error and its gradient over all samples in float32. The limit is the
stack's number of operations, divided by the rate of torch's large matrix products in the same run
(best of both, repeated between the stacks because a shared machine's speed drifts). `share` is
limit / seconds.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import torch
from torch import Tensor, nn

from benchmarks import command
from benchmarks.figures import measured
from benchmarks.figures import seconds as taken
from learn.networks.elman import ContextDelay

SAMPLES = 80_000
INPUTS = 12
HIDDEN = 50
LAYERS = 3
DELAYS = 5


def naive_context_delay(
    x: Tensor, history: Tensor, weight: Tensor, recurrent: Tensor, bias: Tensor
) -> Tensor:
    """Compute the layer in plain torch, (time, batch, features): reference and comparison.

    `history` is (past, batch, hidden), oldest first; returns (time, batch, hidden).
    """
    past, _, hidden = history.shape
    states = list(history)
    blocks = recurrent.view(hidden, past, hidden)
    for sample in x:
        total = sample @ weight.T + bias
        for delay in range(past):
            total = total + states[len(states) - past + delay] @ blocks[:, delay].T
        states.append(torch.tanh(total))
    return torch.stack(states[past:])


class Stack(nn.Module):
    """Three context-delay layers and a linear output in the layer's own layout."""

    def __init__(self, naive: bool = False) -> None:
        super().__init__()
        self.naive = naive
        sizes = [INPUTS, *[HIDDEN] * LAYERS]
        self.layers = nn.ModuleList(ContextDelay(a, HIDDEN, DELAYS) for a in sizes[:-1])
        self.out = nn.Linear(HIDDEN, 1)

    def forward(self, x: Tensor) -> Tensor:
        if self.naive:
            for layer in self.layers:
                history = x.new_zeros(DELAYS, x.shape[1], HIDDEN)
                x = naive_context_delay(x, history, layer.weight, layer.recurrent, layer.bias)
            return self.out(x)
        for layer in self.layers:
            x = layer(x)
        return torch.matmul(self.out.weight, x) + self.out.bias


class Torch(nn.Module):
    """torch.nn.RNN, with one delay."""

    def __init__(self) -> None:
        super().__init__()
        self.cells = nn.RNN(INPUTS, HIDDEN, LAYERS)
        self.out = nn.Linear(HIDDEN, 1)

    def forward(self, x: Tensor) -> Tensor:
        return self.out(self.cells(x)[0])


def operations(delays: int) -> float:
    """Operations of one gradient: forward, backward through the data, weight sums.

    The gradient of the first layer's input is not computed.
    """
    recurrent = LAYERS * delays * HIDDEN * HIDDEN
    inputs = (LAYERS - 1) * HIDDEN * HIDDEN + HIDDEN
    first = INPUTS * HIDDEN
    return 2.0 * SAMPLES * (3 * (recurrent + inputs) + 2 * first)


def product_rate(seconds: float = 0.3) -> float:
    """Best matrix-product rate [operations/s] of square float32 products."""
    size, best = 512, 0.0
    a, b, c = torch.randn(size, size), torch.randn(size, size), torch.empty(size, size)
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        torch.mm(a, b, out=c)
        best = max(best, 2.0 * size**3 / (time.perf_counter() - start))
    return best


def best_seconds(model: nn.Module, x: Tensor, repeats: int) -> float:
    """[s] Shortest time of `repeats` gradients, after one for warm-up."""
    found = []
    for _ in range(repeats + 1):
        model.zero_grad()
        found.append(taken(lambda: model(x).square().mean().backward()))
    return min(found[1:])


def main(*, json: bool = False, sequences: int = 16, repeats: int = 5, threads: int = 1) -> None:
    """Print the seconds of each layer beside their limit.

    Args:
      sequences: number of sequences in parallel.
      repeats: number of gradients of the layer under test.
      threads: number of torch's threads.
    """
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    x = torch.randn(SAMPLES // sequences, sequences, INPUTS)
    contenders: dict[str, tuple[Callable[[], nn.Module], Tensor, float, int]] = {
        "naive autograd": (lambda: Stack(naive=True), x, operations(DELAYS), 1),
        "torch.nn.RNN (one delay)": (Torch, x, operations(1), 2),
        "context delay": (
            Stack, x.transpose(1, 2).contiguous(), operations(DELAYS), repeats
        ),
    }  # fmt: skip
    rate, seconds = product_rate(), {}
    for name, (build, data, _, times) in contenders.items():
        seconds[name] = best_seconds(build(), data, times)
        rate = max(rate, product_rate())
    limits = {name: count / rate for name, (_, _, count, _) in contenders.items()}
    rows = [
        {"layer": name, "seconds": s, "limit": limits[name], "share": limits[name] / s}
        for name, s in seconds.items()
    ]
    measured("layer_speed", context_delay=limits["context delay"] / seconds["context delay"])
    figures = {"samples": SAMPLES, "sequences": sequences, "threads": threads}
    command.say({**figures, "product_gflops": rate / 1e9, "rows": rows}, rows, json=json)
    if not json:
        print(f"{figures}, matrix products {rate / 1e9:.1f} GFLOP/s")


if __name__ == "__main__":
    sys.exit(command.run(main))
