"""Optimiser: base classes of optimisers on minibatches or on all windows at once.

Also here: the settings of a training, its budget and its schedule of step sizes.
"""

from __future__ import annotations

import abc
import dataclasses
import math
import time
from collections.abc import Callable, Iterable
from typing import Any, ClassVar, Literal, Protocol

import torch
from torch import Tensor, nn

from learn.seams import OPTIMISERS
from twin.errors import InputError, unknown_name
from twin.extras import preload_triton

Objective = Callable[[Tensor], tuple[float, Tensor]]
"""Function from parameters (n,) to the error and its gradient (n,)."""


class Optimiser(abc.ABC):
    """Base of optimisers; derive yours from `MinibatchOptimiser` or `FullBatchOptimiser`."""

    summary: ClassVar[str]
    """Description of the optimiser in a few words, for tables."""
    settings: ClassVar[tuple[str, ...]]
    """Names in `SETTINGS` that the optimiser uses; the command line refuses the others."""

    @classmethod
    def flaw(cls, name: str) -> str:
        """Fault of the class, found by a trial on a small problem; empty if there is none."""
        if not issubclass(cls, MinibatchOptimiser | FullBatchOptimiser):
            return (
                "it must derive from MinibatchOptimiser or FullBatchOptimiser, which define how "
                "the trainer calls it"
            )
        if unknown := [word for word in cls.settings if word not in SETTINGS]:
            return f"it names setting {unknown[0]!r}; there are {', '.join(SETTINGS)}"
        preload_triton()  # torch.optim imports triton where it is installed
        with torch.random.fork_rng(devices=[]):
            trial = cls()
            return (
                _minibatch(trial) if isinstance(trial, MinibatchOptimiser) else _full_batch(trial)
            )


class MinibatchOptimiser(Optimiser):
    """Optimiser on batches of windows; the trainer sets the step size by its schedule."""

    settings: ClassVar[tuple[str, ...]] = ("rate", "warmup", "batch", "window", "clip")

    @abc.abstractmethod
    def build(self, parameters: Iterable[Tensor], config: TrainingConfig) -> torch.optim.Optimizer:
        """Build a torch optimiser of these parameters.

        Before every step the trainer writes `lr` into the optimiser's `param_groups`. Checkpoints
        hold its `state_dict`.
        """


class Descent(Protocol):
    """Protocol of a full-batch method; `step` is one iteration."""

    parameters: Tensor
    """Best parameters so far, (n,)"""
    error: float
    """Error at `parameters`, which never rises."""
    scale: float
    """Number that reports show as the step size."""
    iterations: int
    evaluations: int
    """Number of evaluations of the objective."""
    converged: bool

    def step(self) -> bool:
        """Make one iteration; returns True if a better point was found."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """State that a resumed training needs."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from a `state_dict`."""
        ...


class FullBatchOptimiser(Optimiser):
    """Optimiser of the error over all windows at once."""

    settings: ClassVar[tuple[str, ...]] = ("full_window",)

    @abc.abstractmethod
    def build(self, objective: Objective, start: Tensor, config: TrainingConfig) -> Descent:
        """Build the method, which starts from parameters `start` (n,)."""


SETTINGS = ("rate", "warmup", "batch", "window", "clip", "full_window", "weight_decay")
"""Settings of `TrainingConfig` that not every optimiser uses."""
STEPS = 8
"""Number of steps in a trial; SOAP's first step changes nothing."""


def _minibatch(kind: MinibatchOptimiser) -> str:
    """Fault of a minibatch optimiser, tried on a linear fit; empty if there is none."""
    line = nn.Linear(2, 1)
    with torch.no_grad():
        line.weight.copy_(torch.tensor([[0.5, -0.5]]))
        line.bias.zero_()
    x = torch.tensor([[0.0, 1.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 0.5]])
    wanted = x @ torch.tensor([[1.0], [2.0]]) + 0.5
    method = kind.build(line.parameters(), TrainingConfig())
    if not isinstance(method, torch.optim.Optimizer):
        return f"build gives {type(method).__name__}, not a torch.optim.Optimizer"
    errors = []
    for _ in range(STEPS):
        for group in method.param_groups:
            group["lr"] = 1e-2
        method.zero_grad()
        error = (line(x) - wanted).square().mean()
        error.backward()
        method.step()
        errors.append(float(error.detach()))
    if not (math.isfinite(errors[-1]) and errors[-1] < errors[0]):
        return f"{STEPS} steps do not lower the error of a line"
    method.load_state_dict(method.state_dict())
    return ""


def _full_batch(kind: Any) -> str:
    """Fault of a full-batch optimiser, tried on a parabola; empty if there is none."""
    goal = torch.tensor([1.0, -2.0, 0.5])

    def objective(p: Tensor) -> tuple[float, Tensor]:
        return float((p - goal).square().sum()), 2.0 * (p - goal)

    method = kind.build(objective, torch.zeros(3), TrainingConfig())
    names = ("parameters", "error", "scale", "iterations", "evaluations", "converged")
    methods = ("step", "state_dict", "load_state_dict")
    if lacking := [word for word in (*names, *methods) if not hasattr(method, word)]:
        return f"what build gives lacks {', '.join(lacking)}"
    first = method.error
    for _ in range(STEPS):
        if not method.converged:
            method.step()
    if not (math.isfinite(method.error) and method.error < first):
        return f"{STEPS} steps do not lower the error of a parabola"
    if method.iterations < 1:
        return "it does not count its iterations"
    method.load_state_dict(method.state_dict())
    return ""


DEVICES = ("auto", "cpu", "cuda")


OPTIONS = ("seconds", "epochs", "washin", "seed")
"""Settings with an option of the same name in `learn fit`"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """Settings of a network's training. The budget is in seconds, epochs or both; training ends
    when either is spent. With `seconds` 0 the result does not depend on the machine's speed."""

    optimiser: str = "soap"
    """Name in `learn.seams.OPTIMISERS`."""
    seconds: float = 120.0
    """[s] Budget of CPU time for one network; 0: only `epochs` counts."""
    epochs: int = 0
    """Budget in passes over the training missions (scg: iterations); 0: only `seconds` counts."""
    rate: float = 3e-3
    """minibatches: highest step size, reached after the warm-up."""
    warmup: float = 0.05
    """minibatches: fraction of the budget in which the step size rises from zero."""
    batch: int = 16
    """minibatches: windows per step."""
    window: int = 128
    """minibatches: counted samples of a window."""
    samples: int = 1024
    """minibatches, networks with fixed memory: samples per step, instead of windows with
    warm-up."""
    washin: int = 48
    """Samples before a window that warm up the network's state and do not count."""
    clip: float = 1.0
    """minibatches: largest norm of the normalised loss's gradient; longer ones are scaled down."""
    full_window: int = 1024
    """full-batch optimisers (scg): counted samples of a window; the batch is all windows."""
    weight_decay: float = 0.1
    """soap: fraction of the weights subtracted per step and unit of step size. Without it, networks
    overfit a small number of missions."""
    patience: int = 0
    """Validations without improvement after which training stops; 0 uses the whole budget. In both
    cases the weights with the best validation are kept."""
    validations: int = 40
    """Number of validations over the budget."""
    buffer: int = 2**20
    """Largest number of samples whose windows are shuffled together. A smaller data set is one
    buffer; a larger one is trained buffer by buffer. The size changes the result, and a buffer must
    fit into memory."""
    seed: int = 0
    """Seed of the initial weights and of the order of the windows."""
    device: Literal["auto", "cpu", "cuda"] = "cpu"
    """Device of the training; auto takes a GPU if there is one."""
    threads: int = 1
    """CPU threads of a process; two networks in two processes beat two threads."""

    def __post_init__(self) -> None:
        if self.optimiser not in OPTIMISERS:
            raise OPTIMISERS.unknown(self.optimiser)
        if self.device not in DEVICES:
            raise InputError(unknown_name("training device", self.device, DEVICES))
        for name in ("seconds", "rate", "warmup", "clip", "weight_decay"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(
                    f"training {name} must be a finite number, not {getattr(self, name)}"
                )
        counts = ("batch", "window", "samples", "full_window", "validations", "threads", "buffer")
        for name in counts:
            if getattr(self, name) < 1:
                raise InputError(f"training {name} must be at least 1, not {getattr(self, name)}")
        for name in ("seconds", "epochs", "washin", "patience", "seed", "weight_decay"):
            if not getattr(self, name) >= 0:
                option = f" (--{name})" if name in OPTIONS else ""
                raise InputError(
                    f"training {name}{option} must not be negative: {getattr(self, name)}"
                )
        for name in ("rate", "clip"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"training {name} must be positive, got {getattr(self, name)}")
        if not 0.0 <= self.warmup < 1.0:
            raise InputError(f"training warmup is a share from 0 to below 1, got {self.warmup}")
        if self.seconds == 0 and self.epochs == 0:
            raise InputError("training needs a budget: seconds or epochs above 0")


class TrainingClock:
    """Clock of a training: spent CPU time and spent fraction of the budget."""

    def __init__(self, config: TrainingConfig, spent: float = 0.0) -> None:
        self.config = config
        self._start = time.thread_time() - spent

    def seconds(self) -> float:
        """[s] CPU time since the start of the training, including earlier runs."""
        return time.thread_time() - self._start

    def share(self, epochs: float) -> float:
        """Fraction of the budget spent after `epochs`, at most 1."""
        shares = [0.0]
        if self.config.seconds:
            shares.append(self.seconds() / self.config.seconds)
        if self.config.epochs:
            shares.append(epochs / self.config.epochs)
        return min(1.0, max(shares))


def step_size(config: TrainingConfig, share: float) -> float:
    """Step size after a fraction `share` of the budget: linear rise, then half a cosine to zero."""
    if share < config.warmup:
        return config.rate * max(share / config.warmup, 1e-3)
    rest = (share - config.warmup) / (1.0 - config.warmup)
    return config.rate * 0.5 * (1.0 + math.cos(math.pi * rest))
