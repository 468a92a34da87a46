"""Propelled networks: the paper's network on real runs, on simulation, and on one after the other.

Inputs are those that all runs of a training have: attitude and rates, depth rate, propeller.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import pickle
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.real_logs.propelled_combination import Parts
from benchmarks.real_logs.propelled_runs import PERIOD, Run, runs_of, scaled
from benchmarks.real_logs.propelled_speeds import depth_terms
from benchmarks.real_logs.samples import Samples
from benchmarks.real_logs.surge_networks import fit_network, predict
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from learn.networks.base import NetworkConfig
from learn.networks.predictor import Predictor
from learn.training.optimiser import TrainingConfig
from twin.navigation.dead_reckoning import Array
from twin.records.store import open_store

ELMAN = NetworkConfig(kind="elman", hidden=40, layers=3, delays=5)
"""The paper's network: three layers of 40 units, five past outputs of each layer"""
SCG = TrainingConfig(
    optimiser="scg", seconds=0.0, epochs=40, full_window=128, washin=16, validations=10
)
TUNED = dataclasses.replace(SCG, epochs=15)
"""Training on real runs after simulation"""
BASE = ("pitch", "roll", "p", "q", "r")
INPUTS = (BASE, (*BASE, "depth_rate"), (*BASE, "depth_rate", "propeller"))
"""Inputs of networks; a training takes the longest that all its runs have"""
VEHICLES, HOURS = ("remus", "tethys"), 4.0
"""Simulated vehicles, and hours of missions of both together"""
MISSIONS = {"mission.duration_h": "0.5", "mission.segment_duration_s": "uniform(200, 600)"}
"""Missions about as short as the logs; the first minutes are at the surface"""
TRAININGS = {
    "network, real only": SCG,
    "network, simulation only": None,
    "network, simulation then real": TUNED,
}
"""Training on real runs of each kind of network; None: without"""
NETWORKS = tuple(TRAININGS)
TARGETS = ("surge", "sway")
Pretrained = Mapping[tuple[str, ...], Mapping[str, Predictor]]
"""Networks trained on simulation, by inputs and target"""


def simulate(folder: Path, seed: int) -> list[Run]:
    """Simulate missions of both vehicles with sensor errors, or read them from an earlier call."""
    found = []
    for vehicle in VEHICLES:
        store = folder / f"propelled-{vehicle}-{seed}.zarr"
        if not store.exists():
            recipe = make_recipe(
                preset="field", hours=HOURS / len(VEHICLES), seed=seed, vehicle=vehicle,
                engine="lanes", changes=MISSIONS,
            )  # fmt: skip
            generate(recipe, store, workers=1, overwrite=True, history="benchmarks.real_logs")
        with open_store(store) as dataset:
            runs = runs_of(dataset.load(), "simulated", PERIOD, truth="true")
        found += [scaled(run, runs) for run in runs]
    return found


def pretrained_on(folder: Path, seed: int, run: Callable[..., list[Any]]) -> Pretrained:
    """Train networks on simulation, one for each kind of inputs and target, or read them."""
    path = folder / f"propelled-networks-{seed}.pickle"
    if not path.exists():
        runs = simulate(folder, seed)
        kinds = [(names, target) for names in INPUTS for target in TARGETS]
        found = run(functools.partial(pretrain, runs, *kind, seed) for kind in kinds)
        table: dict[tuple[str, ...], dict[str, Predictor]] = {names: {} for names in INPUTS}
        for (names, target), network in zip(kinds, found, strict=True):
            table[names][target] = network
        path.write_bytes(pickle.dumps(table))
    return pickle.loads(path.read_bytes())


def pretrain(runs: Sequence[Run], names: tuple[str, ...], target: str, seed: int) -> Predictor:
    """Train a network on simulated runs; every fourth one stops the training early."""
    every = [samples(run, names, target) for run in runs]
    train = [one for k, one in enumerate(every) if k % 4]
    return fit_network(train, every[::4], names, SCG, seed=seed, network=ELMAN)


def samples(run: Run, names: Sequence[str], target: str) -> Samples:
    """Inputs and velocity of a run, for a network."""
    inputs = dict(run.signals)
    if "depth" in inputs:
        inputs["depth_rate"] = np.nan_to_num(depth_terms(run, 3.0)[0])
    return Samples(0, {name: inputs[name] for name in names}, getattr(run, target))


def network_velocities(
    parts: Parts, tests: Sequence[Run], pretrained: Pretrained, seed: int
) -> list[dict[str, Array]]:
    """Surge and sway [m/s], (2, time), of held-out runs and of the tests, by each network.

    Held-out runs stop a training early; the tests have the mean over trainings.
    """
    every = [*tests, *(run for used, held in parts[:1] for run in (*used, *held))]
    have = set.intersection(*(set(run.signals) for run in every))
    have |= {"depth_rate"} if "depth" in have else set()
    names = next(some for some in reversed(INPUTS) if have.issuperset(some))

    def answers(name: str, target: str, used: Sequence[Run], held: Sequence[Run]) -> list[Array]:
        train, stop, asked = (
            [samples(run, names, target) for run in runs] for runs in (used, held, tests)
        )
        first, config = pretrained[names][target], TRAININGS[name]
        start = None if name == NETWORKS[0] else first
        fit = functools.partial(fit_network, train, stop, names, seed=seed, network=ELMAN)
        return predict(first if config is None else fit(config, start=start), [*stop, *asked])

    count = len(tests)
    found: list[dict[str, list[Array]]] = [{} for _ in range(count + sum(len(h) for _, h in parts))]
    for name, target in itertools.product(NETWORKS, TARGETS):
        each = [answers(name, target, *part) for part in parts]
        early = [one for some in each for one in some[:-count]]
        late = [np.mean(some, axis=0) for some in zip(*(s[-count:] for s in each), strict=True)]
        for one, velocity in zip(found, [*early, *late], strict=True):
            one.setdefault(name, []).append(velocity)
    return [{name: np.stack(pair) for name, pair in one.items()} for one in found]
