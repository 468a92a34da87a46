"""What an optimiser is: one step after another on few windows of missions, or on all at once."""

from __future__ import annotations

import abc
import math
from collections.abc import Callable, Iterable
from typing import Any, ClassVar, Protocol

import torch
from torch import Tensor, nn

from learn.training.schedule import TrainingConfig
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
