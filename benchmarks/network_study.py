"""Does memory help, and which optimiser? Networks of equal data and equal computing time.

    python benchmarks/network_study.py TRAIN --test STORE [STORE ...] [--kinds mlp elman lstm]
        [--optimisers soap adam scg] [--inputs full glider] [--seeds 3] [--seconds 60]
        [--window 128] [--washin 48] [--json]

Trains one network for every kind, optimiser, set of inputs, velocity and seed on the missions of
TRAIN that are for training, `--seconds` of computing each, and runs it free over every mission of
the test stores. Printed are medians over the seeds and, in brackets, the lowest and highest.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import statistics
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

TARGETS = ("surge", "sway")
TRANSIENT_S = 30.0


@dataclass(frozen=True)
class Case:
    """One network to train."""

    kind: str
    optimiser: str
    inputs: str
    target: str
    seed: int


def run(case: Case, train: str, tests: list[str], settings: dict[str, float]) -> dict[str, float]:
    """Train the case; its epochs and its mean squared errors [(m/s)^2] by store."""
    import numpy as np

    from learn.data.dataset import TARGETS as CHANNELS
    from learn.data.dataset import load_missions
    from learn.data.preparation import prepare
    from learn.networks.config import NetworkConfig
    from learn.networks.predictor import Predictor
    from learn.training.schedule import TrainingConfig
    from learn.training.trainer import Trainer
    from twin.navigation.features import INPUT_SETS, channels_of, select_features

    features = select_features(INPUT_SETS[case.inputs])
    data = prepare(train, target=case.target, features=features)
    trained = Trainer(
        NetworkConfig(kind=case.kind),
        TrainingConfig(optimiser=case.optimiser, seed=case.seed, **settings),
        data.train,
        data.validation,
        target_scale=data.normalisation.target_scale,
    ).run()
    predictor = Predictor(trained.network, data.normalisation)
    found = {"epochs": trained.history[-1].epoch}
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


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("train", help="store with a split")
    parser.add_argument("--test", nargs="+", required=True, help="stores of unseen missions")
    parser.add_argument("--kinds", nargs="+", default=["mlp", "elman", "lstm", "gru", "tcn"])
    parser.add_argument("--optimisers", nargs="+", default=["soap"])
    parser.add_argument("--inputs", nargs="+", default=["full"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="computing time of each network"
    )
    parser.add_argument("--window", type=int, help="samples of a training piece")
    parser.add_argument("--washin", type=int, help="samples before it that are not scored")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--json", action="store_true", help="every network as one JSON line")
    options = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"  # inherited by the workers: one thread each
    cases = [
        Case(*parts)
        for parts in itertools.product(
            options.kinds, options.optimisers, options.inputs, TARGETS, range(options.seeds)
        )
    ]
    settings = {
        name: value
        for name in ("seconds", "window", "washin")
        if (value := getattr(options, name)) is not None
    }
    results: dict[Case, dict[str, float]] = {}
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        futures = {
            pool.submit(run, case, options.train, options.test, settings): case for case in cases
        }
        for future in as_completed(futures):
            case = futures[future]
            results[case] = future.result()
            if options.json:
                print(json.dumps({**asdict(case), **results[case]}), flush=True)
            else:
                print(f"{len(results)} of {len(cases)} networks", file=sys.stderr)
    if not options.json:
        show(results)


def show(results: dict[Case, dict[str, float]]) -> None:
    """One line for each kind, optimiser, inputs and velocity, a column for each figure."""
    columns = list(next(iter(results.values())))
    for target in TARGETS:
        print(f"\n{target}, MSE in (m/s)^2: median (lowest to highest) over the seeds")
        groups = dict.fromkeys((c.kind, c.optimiser, c.inputs) for c in results)
        for group in groups:
            chosen = [
                r
                for c, r in results.items()
                if (c.kind, c.optimiser, c.inputs) == group and c.target == target
            ]
            cells = []
            for column in columns:
                values = [r[column] for r in chosen]
                middle, low, high = statistics.median(values), min(values), max(values)
                cells.append(f"{column} {middle:.2g} ({low:.2g} to {high:.2g})")
            print(f"{' '.join(group):18s}", "; ".join(cells))


if __name__ == "__main__":
    main()
