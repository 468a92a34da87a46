"""Trainer: train one network for one velocity with any optimiser.

Training minimises the mean squared error over all samples of the training missions, including the
launch from rest; `learn.training.feed` chooses the samples of a step. Validation is the error over
whole validation missions, each run once from its start.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from learn.data.sequences import SequenceSource, ahead
from learn.networks.base import Network, NetworkConfig, build_network, groups_by_length
from learn.networks.fixed_memory import FixedMemory
from learn.seams import OPTIMISERS
from learn.training.checkpoint import read_checkpoint, write_checkpoint
from learn.training.feed import Feed, feed_for
from learn.training.held_back import Held, HeldBack, HeldRows
from learn.training.optimiser import (
    FullBatchOptimiser,
    MinibatchOptimiser,
    TrainingClock,
    TrainingConfig,
    step_size,
)
from twin.errors import InputError, StoreError
from twin.extras import preload_triton
from twin.records.windows import Places, buffers

TRAINING_PER_VALIDATION = 4.0
"""Smallest ratio of training to validation time: a large store is validated less often."""
CAREFUL, LEAST_CAREFUL = 0.25, 0.25 / 32
"""[1] Factor on the step size of a training that held-back missions decide. Each refused change
halves it; below the second number the training ends"""
BUFFER_ORDER = 1
"""Last entry of the seed for the order of buffers, distinct from the seed that shuffles windows."""


@dataclasses.dataclass(frozen=True)
class TrainingReport:
    """Progress of a training at a validation; the last report is also the result."""

    step: int
    """Number of updates, or of iterations over all samples."""
    epoch: float
    """Number of passes over the training missions."""
    seconds: float
    """[s] Spent CPU time, including earlier runs of a resumed training."""
    share: float
    """[1] Spent fraction of the budget."""
    rate: float
    """Step size, or the scale of a full-batch method."""
    train_mse: float
    """[(m/s)^2] Mean squared error over the windows since the last report."""
    validation_mse: float
    """[(m/s)^2] Mean squared error over whole validation missions; NaN without any."""
    best_mse: float
    """[(m/s)^2] Lowest validation error so far (training error without validation missions)."""


@dataclasses.dataclass(frozen=True)
class Trained:
    """Trained network, with the reports of its training."""

    network: Network
    history: tuple[TrainingReport, ...]
    stopped_early: bool


def pick_device(name: str) -> torch.device:
    """Choose the torch device for auto, cpu or cuda.

    Raises:
      InputError: cuda is asked for, and there is no CUDA device.
    """
    available = torch.cuda.is_available()
    if name == "cuda" and not available:
        raise InputError("no CUDA device is available; use device auto or cpu")
    return torch.device("cuda" if name != "cpu" and available else "cpu")


class Trainer:
    """Training of one network, with its budget, best weights and checkpoint.

    Sequences are normalised; `target_scale` converts normalised errors to m/s. `start` has initial
    weights instead of random ones. They stay the best until a validation error is lower.

    With `held`, rows of held-back missions decide in place of the validation missions: a change of
    the weights stays only if neither the error nor the missions' mean error grows. Else the best
    weights come back, and the steps become smaller, down to none. This needs a network with fixed
    memory.
    """

    def __init__(
        self,
        network: NetworkConfig,
        config: TrainingConfig,
        train: SequenceSource,
        validation: SequenceSource | None,
        *,
        target_scale: float,
        checkpoint: Path | None = None,
        report: Callable[[TrainingReport], None] | None = None,
        start: Mapping[str, Tensor] | None = None,
        held: HeldRows | None = None,
    ) -> None:
        if not len(train.lengths):
            raise StoreError("there are no training missions")
        self.config, self.train_data, self.validation = config, train, validation
        self.variance = target_scale**2
        self.checkpoint, self.on_report = checkpoint, report
        self.network_config = dataclasses.replace(network, inputs=train.width)
        torch.set_num_threads(config.threads)
        self.device = pick_device(config.device)
        torch.manual_seed(config.seed)
        self.network = build_network(self.network_config).to(self.device)
        if start is not None:
            self._load_start(start)
        self._only_feed: Feed | None = None
        self.history: list[TrainingReport] = []
        self.best = math.inf
        self._held: HeldBack | None = None
        self._best_held: Held | None = None
        self.factor, self.refused = 1.0, False
        if held is not None:
            assert isinstance(self.network, FixedMemory)
            self._held = HeldBack(self.network, held)
            self._best_held, self.factor = self._held.judge(), CAREFUL
            self.best = self.variance * self._best_held.mse
        elif start is not None and validation is not None and len(validation.lengths):
            self.best = self.variance * mean_squared_error(self.network, validation)
        self.best_state = _copy(self.network)
        self.bad = 0
        self.stopped = False
        self._seen: list[tuple[float, float]] = []

    def _load_start(self, start: Mapping[str, Tensor]) -> None:
        try:
            self.network.load_state_dict(dict(start))
        except RuntimeError as error:
            raise InputError(
                "the weights to start from belong to a network of another kind, size or inputs; "
                "give the same --network, --hidden, --layers, --delays, --memories and inputs"
            ) from error

    def run(self) -> Trained:
        """Train until the budget is spent or validation stops improving.

        If there is a checkpoint, training resumes from it. The file stays.

        Raises:
          StoreError: the checkpoint is damaged or has other settings.
          InputError: the loss is no longer finite.
        """
        saved = self._load()
        optimiser = OPTIMISERS[self.config.optimiser]()
        if isinstance(optimiser, FullBatchOptimiser):
            self._full_batch(optimiser, saved)
        else:
            assert isinstance(optimiser, MinibatchOptimiser)
            self._minibatches(optimiser, saved)
        self.network.load_state_dict(self.best_state)
        return Trained(self.network, tuple(self.history), self.stopped)

    # --- minibatches ----------------------------------------------------------------------------

    def _minibatches(self, kind: MinibatchOptimiser, saved: dict[str, Any] | None) -> None:
        config, network = self.config, self.network
        preload_triton()  # torch.optim imports triton where it is installed
        optimiser = kind.build(network.parameters(), config)
        epoch = first = position = step = 0
        passed = 0.0
        clock = TrainingClock(config)
        if saved:
            network.load_state_dict(saved["network"])
            optimiser.load_state_dict(saved["optimiser"])
            epoch, position, step = saved["epoch"], saved["position"], saved["step"]
            first, passed = saved.get("buffer", 0), saved["passed"]
            clock = TrainingClock(config, saved["seconds"])
        share = clock.share(passed)
        next_check = self._next_check(share)
        while share < 1.0 and not self.stopped:
            plan = self._plan(epoch)
            for number, feed in self._feeds(plan, first):
                groups = feed.epoch(np.random.default_rng([config.seed, epoch, number]))
                before, own = self._part(plan[:number]), self._part(plan[number : number + 1])
                while position < len(groups):
                    rate = self.factor * step_size(config, share)
                    for group in optimiser.param_groups:
                        group["lr"] = rate
                    self._update(optimiser, feed, groups[position])
                    position, step = position + 1, step + 1
                    passed = epoch + before + position / len(groups) * own
                    share = clock.share(passed)
                    if share >= min(next_check, 1.0):
                        next_check = self._check(step, passed, clock, share, rate)
                        if self.refused:
                            optimiser.state.clear()
                        self._save(
                            network=network.state_dict(),
                            optimiser=optimiser.state_dict(),
                            epoch=epoch,
                            buffer=number,
                            position=position,
                            passed=passed,
                            step=step,
                            seconds=clock.seconds(),
                        )
                    if share >= 1.0 or self.stopped:
                        return
                position = 0
                del feed  # frees its memory before the next feed is made
            epoch, first = epoch + 1, 0

    def _plan(self, epoch: int) -> list[Places]:
        """Missions of each buffer of an epoch, in the order of training."""
        rng = np.random.default_rng([self.config.seed, epoch, 0, BUFFER_ORDER])
        return buffers(self.train_data.lengths, self.config.buffer, rng)

    def _part(self, plan: list[Places]) -> float:
        """Fraction of the training samples in these buffers."""
        lengths = self.train_data.lengths
        return sum(int(lengths[places].sum()) for places in plan) / int(lengths.sum())

    def _feeds(self, plan: list[Places], first: int = 0) -> Iterator[tuple[int, Feed]]:
        """Number and feed of each buffer from number `first` on; a single buffer's feed is kept."""
        if len(plan) == 1:
            if self._only_feed is None:
                data = self.train_data.take(plan[0])
                self._only_feed = feed_for(self.network, data, self.config)
            yield 0, self._only_feed
            return
        for number, data in enumerate(ahead(self.train_data, plan[first:]), first):
            yield number, feed_for(self.network, data, self.config)

    def _update(self, optimiser: torch.optim.Optimizer, feed: Feed, group: Any) -> None:
        optimiser.zero_grad()
        error, weight = feed.squared_error(group)
        loss = error / max(weight, 1.0)
        loss.backward()
        length = torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.config.clip)
        if not torch.isfinite(length):
            raise InputError(
                f"training diverged (gradient {float(length)}); choose a smaller rate than "
                f"{self.config.rate:g}"
            )
        optimiser.step()
        self._seen.append((float(error.detach()), weight))

    # --- all samples at once --------------------------------------------------------------------

    def _full_batch(self, kind: FullBatchOptimiser, saved: dict[str, Any] | None) -> None:
        config, network = self.config, self.network
        plan = buffers(self.train_data.lengths, config.buffer)
        parameters = list(network.parameters())

        def objective(flat: Tensor) -> tuple[float, Tensor]:
            torch.nn.utils.vector_to_parameters(flat, parameters)
            network.zero_grad()
            errors, weights = [], 0.0
            for _, feed in self._feeds(plan):
                for group in feed.everything():
                    error, weight = feed.squared_error(group)
                    error.backward()
                    errors.append(float(error.detach()))
                    weights += weight
                del feed  # frees its memory before the next feed is made
            gradient = torch.cat([p.grad.view(-1) for p in parameters if p.grad is not None])
            return math.fsum(errors) / weights, gradient.detach() / weights

        clock = TrainingClock(config, saved["seconds"] if saved else 0.0)
        start = torch.nn.utils.parameters_to_vector(parameters).detach()
        optimiser = kind.build(objective, start, config)
        if saved:
            optimiser.load_state_dict(saved["optimiser"])
        share = clock.share(optimiser.iterations)
        next_check = self._next_check(share)
        while share < 1.0 and not self.stopped and not optimiser.converged:
            optimiser.step()
            share = clock.share(optimiser.iterations)
            self._seen = [(optimiser.error, 1.0)]
            if share >= min(next_check, 1.0) or optimiser.converged:
                torch.nn.utils.vector_to_parameters(optimiser.parameters, parameters)
                passes = optimiser.evaluations
                next_check = self._check(
                    optimiser.iterations, passes, clock, share, optimiser.scale
                )
                self._save(optimiser=optimiser.state_dict(), seconds=clock.seconds())

    # --- validation and checkpoints -------------------------------------------------------------

    def _next_check(self, share: float) -> float:
        every = 1.0 / self.config.validations
        return (math.floor(share / every + 1e-9) + 1) * every

    def _check(
        self, step: int, epoch: float, clock: TrainingClock, share: float, rate: float
    ) -> float:
        """Validate, keep the best weights, report; returns the budget share of the next check."""
        start = clock.seconds()
        error, weight = (math.fsum(column) for column in zip(*self._seen, strict=True))
        self._seen = []
        train_mse = self.variance * error / max(weight, 1.0)
        if not math.isfinite(train_mse):
            raise InputError("training diverged: the error is not finite; choose a smaller rate")
        validation_mse = math.nan
        held = None if self._held is None else self._held.judge()
        if held is not None:
            validation_mse = self.variance * held.mse
        elif self.validation is not None and len(self.validation.lengths):
            validation_mse = self.variance * mean_squared_error(self.network, self.validation)
        judged = train_mse if math.isnan(validation_mse) else validation_mse
        better = judged < self.best
        if held is not None:
            assert self._best_held is not None
            better = held.better(self._best_held)
        self.refused = held is not None and not better
        if better:
            self.best, self.bad, self._best_held = judged, 0, held
            self.best_state = _copy(self.network)
        else:
            self.bad += 1
        self.stopped = bool(self.config.patience) and self.bad >= self.config.patience
        if self.refused:
            self.network.load_state_dict(self.best_state)
            self.factor *= 0.5
            self.stopped = self.factor < LEAST_CAREFUL
        report = TrainingReport(
            step, epoch, clock.seconds(), share, rate, train_mse, validation_mse, self.best
        )
        self.history.append(report)
        if self.on_report is not None:
            self.on_report(report)
        again = self._next_check(share)
        if self.config.seconds:
            cost = (clock.seconds() - start) / self.config.seconds
            again = max(again, clock.share(epoch) + TRAINING_PER_VALIDATION * cost)
        return again

    def _identity(self) -> dict[str, Any]:
        """Settings and data that must be equal in a checkpoint and in the run that resumes it."""
        data = (int(self.train_data.lengths.sum()), len(self.train_data.lengths))
        ours = dataclasses.asdict(self.config)
        for name in ("device", "threads"):
            ours.pop(name)
        return {"network": dataclasses.asdict(self.network_config), "training": ours, "data": data}

    def _save(self, **state: Any) -> None:
        if self.checkpoint is None:
            return
        everything = {
            "identity": self._identity(),
            "history": [dataclasses.astuple(report) for report in self.history],
            "best": self.best,
            "best_state": self.best_state,
            "bad": self.bad,
            "factor": self.factor,
            "best_held": None if self._best_held is None else dataclasses.astuple(self._best_held),
            **state,
        }
        write_checkpoint(self.checkpoint, everything)

    def _load(self) -> dict[str, Any] | None:
        if self.checkpoint is None or not self.checkpoint.exists():
            return None
        saved = read_checkpoint(self.checkpoint, self.device, self._identity())
        self.history = [TrainingReport(*row) for row in saved["history"]]
        self.best, self.best_state = saved["best"], saved["best_state"]
        self.bad = saved["bad"]
        if self._held is not None:
            self.factor, self._best_held = saved["factor"], Held(*saved["best_held"])
        return saved


def mean_squared_error(network: Network, source: SequenceSource) -> float:
    """Mean squared error, normalised, over the counted samples of whole missions."""
    errors, weights = np.zeros((2, len(source.lengths)))
    groups = groups_by_length(source.lengths)
    for places, data in zip(groups, ahead(source, groups), strict=True):
        runs = network.run_missions(data.inputs)
        for k, output, wanted, counted in zip(
            places, runs, data.targets, data.weights, strict=True
        ):
            errors[k] = (counted * np.square(output - wanted)).sum(dtype=np.float64)
            weights[k] = counted.sum(dtype=np.float64)
    return math.fsum(errors) / max(math.fsum(weights), 1.0)


def _copy(network: Network) -> dict[str, Tensor]:
    return {name: value.detach().clone() for name, value in network.state_dict().items()}
