"""Optimisers: one step after another on few windows of missions, or on all at once.

The settings of a training, how much of its budget is spent, and the step size then.
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
"""From parameters (n,) to the error and its gradient (n,)."""


class Optimiser(abc.ABC):
    """Base of the two ways; a kind derives from `MinibatchOptimiser` or `FullBatchOptimiser`."""

    summary: ClassVar[str]
    """What it is, a few words for tables."""
    settings: ClassVar[tuple[str, ...]]
    """Which settings of `TrainingConfig` it uses, of those that not all optimisers do
    (`SETTINGS`); others are refused on the command line."""

    @classmethod
    def flaw(cls, name: str) -> str:
        """Name the fault of a kind, tried on a line through points; empty where it has none."""
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
    """Steps on batches of windows; the trainer sets the step size by its schedule."""

    settings: ClassVar[tuple[str, ...]] = ("rate", "warmup", "batch", "window", "clip")

    @abc.abstractmethod
    def build(self, parameters: Iterable[Tensor], config: TrainingConfig) -> torch.optim.Optimizer:
        """torch's optimiser of these parameters.

        Before every step the trainer writes `lr` into its `param_groups`; a checkpoint holds its
        `state_dict`.
        """


class Descent(Protocol):
    """The state of a full-batch method; `step` is one iteration."""

    parameters: Tensor
    """(n,) of the best point so far"""
    error: float
    """At `parameters`; it never rises."""
    scale: float
    """What the report shows as the step size."""
    iterations: int
    evaluations: int
    """Of the objective."""
    converged: bool

    def step(self) -> bool:
        """One iteration; whether a better point was found."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Everything that a resumed training needs."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from `state_dict`."""
        ...


class FullBatchOptimiser(Optimiser):
    """Steps on the error over all windows at once."""

    settings: ClassVar[tuple[str, ...]] = ("full_window",)

    @abc.abstractmethod
    def build(self, objective: Objective, start: Tensor, config: TrainingConfig) -> Descent:
        """The method, to begin at parameters `start` (n,)."""


SETTINGS = ("rate", "warmup", "batch", "window", "clip", "full_window", "weight_decay")
"""Settings of `TrainingConfig` that not every optimiser uses."""
STEPS = 8
"""Of the trial: SOAP's first one only looks."""


def _minibatch(kind: MinibatchOptimiser) -> str:
    """What is wrong with a minibatch optimiser; empty when all is well."""
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
    """What is wrong with a full-batch optimiser; empty when all is well."""
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
"""Settings that `learn fit` has options for, by the same name"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """How a network is trained. A budget is seconds or epochs; the schedule fits whichever ends
    first. With `seconds` 0 the result does not depend on the machine's speed."""

    optimiser: str = "soap"
    """A name of `learn.seams.OPTIMISERS`."""
    seconds: float = 120.0
    """[s] of computing for one network, whatever else the machine does; 0 leaves it to `epochs`."""
    epochs: int = 0
    """Budget in passes over the training missions (scg: iterations); 0 leaves it to `seconds`."""
    rate: float = 3e-3
    """minibatches: highest step size, reached after the warm-up."""
    warmup: float = 0.05
    """minibatches: share of the budget in which the step size rises from zero."""
    batch: int = 16
    """minibatches: windows per step."""
    window: int = 128
    """minibatches: counted samples of a window."""
    samples: int = 1024
    """minibatches of networks whose memory has no weights: samples per step, in place of windows
    and wash-in."""
    washin: int = 48
    """Samples before a window that let the network find its state."""
    clip: float = 1.0
    """minibatches: longest gradient, in units of the normalised loss."""
    full_window: int = 1024
    """scg and its like: counted samples of a window; the batch is always all windows."""
    weight_decay: float = 0.1
    """soap: share of the weights taken off per step and unit of the step size. Few missions are
    learned by heart without it."""
    patience: int = 0
    """Validations without improvement after which training stops; 0 uses the whole budget. The
    weights that were best on validation are kept in either case."""
    validations: int = 40
    """Validations over the budget."""
    buffer: int = 2**20
    """Samples of the missions whose windows are shuffled together; one buffer follows on another.
    What is not larger is shuffled as a whole. It has a part in the result, and is what must fit
    into memory at least."""
    seed: int = 0
    """Of the initial weights and of the order of the windows."""
    device: Literal["auto", "cpu", "cuda"] = "cpu"
    """auto takes a GPU when there is one."""
    threads: int = 1
    """CPU threads of this process; two networks in two processes beat two threads."""

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
    """Time and share of the budget spent."""

    def __init__(self, config: TrainingConfig, spent: float = 0.0) -> None:
        self.config = config
        self._start = time.thread_time() - spent

    def seconds(self) -> float:
        """[s] of computing since the start of the training, earlier runs included."""
        return time.thread_time() - self._start

    def share(self, epochs: float) -> float:
        """Share of the budget spent after `epochs`, at most 1."""
        shares = [0.0]
        if self.config.seconds:
            shares.append(self.seconds() / self.config.seconds)
        if self.config.epochs:
            shares.append(epochs / self.config.epochs)
        return min(1.0, max(shares))


def step_size(config: TrainingConfig, share: float) -> float:
    """Step size after `share` of the budget: linear warm-up, then half a cosine to zero."""
    if share < config.warmup:
        return config.rate * max(share / config.warmup, 1e-3)
    rest = (share - config.warmup) / (1.0 - config.warmup)
    return config.rate * 0.5 * (1.0 + math.cos(math.pi * rest))
