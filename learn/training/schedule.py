"""Schedule: the settings of a training, how much of its budget is spent, and the step size then."""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Literal

from learn.seams import OPTIMISERS
from twin.errors import InputError, unknown_name

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
