"""Network study of memory and optimisers, with equal data and equal computing time.

    python -m benchmarks.network_study TRAIN --test STORE [STORE ...] [--kinds mlp elman lstm]
        [--optimisers soap adam scg] [--inputs full glider] [--targets surge sway] [--seeds 3]
        [--memories 2,8,30 8] [--sizes 3x50 2x64] [--seconds 60] [--window 128] [--washin 48]
        [--without GROUP] [--json]

Trains one network for every type, optimiser, set of inputs, memories, size, velocity and seed on
TRAIN's training missions, `--seconds` of computing each, and runs it free over every mission of the
test stores. Printed are medians over the seeds with the lowest and highest in brackets. `VARIANTS`
are network types of this study alone: ema with one change.
"""

from __future__ import annotations

import itertools
import os
import statistics
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from json import dumps
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np
from torch import Tensor, nn

from benchmarks import command
from learn.data.dataset import TARGETS as CHANNELS
from learn.data.dataset import load_missions
from learn.data.preparation import prepare
from learn.data.stores import input_groups
from learn.networks.base import NetworkConfig
from learn.networks.fixed_memory import ExponentialAverages
from learn.networks.predictor import Predictor
from learn.seams import NETWORKS
from learn.training.optimiser import TrainingConfig
from learn.training.trainer import Trainer
from twin.navigation.features import channels_of, select_features

TRANSIENT_S = 30.0


class Tanh(ExponentialAverages):
    """Exponential averages with saturating units."""

    unit = nn.Tanh


class Curved(ExponentialAverages):
    """Exponential averages without the linear path."""

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        del self.straight

    def read(self, recalled: Tensor) -> Tensor:
        """See `FixedMemory.read`."""
        return self.body(recalled)


class TanhCurved(Curved):
    """Perceptron: saturating units without the linear path."""

    unit = nn.Tanh


class FromZero(ExponentialAverages):
    """Exponential averages that start at the training mean, not at the first sample."""

    def _before(self, x: Tensor, state: Tensor) -> Tensor:
        return state[:, :-1].unflatten(1, (len(self.keep), self.config.inputs))


VARIANTS = {
    "ema_tanh": Tanh,
    "ema_curved": Curved,
    "ema_tanh_curved": TanhCurved,
    "ema_from_zero": FromZero,
}
for name, variant in VARIANTS.items():
    NETWORKS.register(name, variant)


@dataclass(frozen=True)
class Case:
    """One network to train."""

    kind: str
    optimiser: str
    inputs: str
    memories: str
    size: str
    target: str
    seed: int

    def network(self, period: float) -> Any:
        """Description of the network."""
        layers, hidden = map(int, self.size.split("x"))
        memories = tuple(map(float, self.memories.split(",")))
        return NetworkConfig(
            kind=self.kind, period=period, layers=layers, hidden=hidden, memories=memories
        )


def run(
    case: Case, train: str, tests: Sequence[str], settings: dict[str, Any], without: Sequence[str]
) -> dict[str, float]:
    """Train the case; return its epochs and its mean squared errors [(m/s)^2] by store."""
    features = select_features(input_groups(case.inputs, train), tuple(without))
    data = prepare(train, target=case.target, features=features)
    trained = Trainer(
        case.network(data.period),
        TrainingConfig(optimiser=case.optimiser, seed=case.seed, **settings),
        data.train,
        data.validation,
        target_scale=data.normalisation.target_scale,
    ).run()
    predictor = Predictor(trained.network, data.normalisation)
    found: dict[str, float] = {"epochs": trained.history[-1].epoch}
    for test in tests:
        missions = load_missions(test, [*channels_of(features), CHANNELS[case.target]])
        errors = [
            np.square(np.asarray(speed, float) - mission.target(case.target))
            for speed, mission in zip(predictor.predict(missions), missions, strict=True)
        ]
        late = round(TRANSIENT_S / missions[0].period)
        name = Path(test).stem
        found[f"{name} MSE"] = float(np.concatenate(errors).mean())
        found[f"{name} after 30 s"] = float(np.concatenate([e[late:] for e in errors]).mean())
    return found


def main(
    train: command.Positional[str],
    *,
    test: tuple[str, ...],
    kinds: tuple[str, ...] = tuple(NETWORKS.shipped()),
    optimisers: tuple[str, ...] = ("soap",),
    inputs: tuple[str, ...] = ("full",),
    without: tuple[str, ...] = (),
    targets: tuple[Literal["surge", "sway"], ...] = ("surge", "sway"),
    memories: tuple[str, ...] = ("2,8,30",),
    sizes: tuple[str, ...] = ("3x50",),
    seeds: int = 3,
    seconds: float = 60.0,
    window: int | None = None,
    washin: int | None = None,
    workers: int = len(os.sched_getaffinity(0)),
    json: bool = False,
) -> None:
    """Train every case, and print its figures.

    Args:
      train: store with a split.
      test: stores of unseen missions.
      without: features or groups to leave out.
      memories: [s] time constants of ema.
      sizes: layers x units.
      seconds: computing time of each network.
      window: samples of a training window.
      washin: warm-up samples before it, which are not scored.
      json: print every network as one JSON line.
    """
    os.environ["OMP_NUM_THREADS"] = "1"  # inherited by the workers: one thread each
    every = itertools.product(kinds, optimisers, inputs, memories, sizes, targets, range(seeds))
    cases = [Case(*parts) for parts in every]
    given = {"seconds": seconds, "window": window, "washin": washin}
    settings = {name: value for name, value in given.items() if value is not None}
    results: dict[Case, dict[str, float]] = {}
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(run, one, train, test, settings, without): one for one in cases}
        for future in as_completed(futures):
            case = futures[future]
            results[case] = future.result()
            if json:
                print(dumps({**asdict(case), **results[case]}), flush=True)
            else:
                print(f"{len(results)} of {len(cases)} networks", file=sys.stderr)
    if not json:
        show(results)


def show(results: dict[Case, dict[str, float]]) -> None:
    """Print a row for each type, optimiser, inputs and velocity, with a column for each figure."""
    columns = list(next(iter(results.values())))
    for target in dict.fromkeys(case.target for case in results):
        print(f"\n{target}, MSE in (m/s)^2: median (lowest to highest) over the seeds")
        groups = dict.fromkeys(_group(case) for case in results)
        for group in groups:
            chosen = [r for c, r in results.items() if _group(c) == group and c.target == target]
            cells = []
            for column in columns:
                values = [r[column] for r in chosen]
                middle, low, high = statistics.median(values), min(values), max(values)
                cells.append(f"{column} {middle:.2g} ({low:.2g} to {high:.2g})")
            print(f"{' '.join(group):18s}", "; ".join(cells))


def _group(case: Case) -> tuple[str, ...]:
    return case.kind, case.optimiser, case.inputs, case.memories, case.size


if __name__ == "__main__":
    sys.exit(command.run(main))
