"""Make the networks that `learn.shipped` holds: fly missions, keep rows of inputs, train, write.

    python scripts/ship_networks.py [--cache data/shipped] [--only gliders]

Every vehicle flies missions of presets `field` (narrow) and `family` (wide), by the batched engine.
A mission gets one sample period of PERIODS. Rows of inputs and of their averages go to the cache,
file by file: a stopped run goes on where it was. A second network of each sort learns the same
missions with sensors missing (`learn.shipped.inputs`).

The networks of gliders learn the flight filter's error where the hull is not in a steady glide. In
steady glides that error belongs to the hull and its sensors, and a network would learn the training
hulls by heart: there the target is the filter's own surge.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from factory.generation.shard import fly_missions, together
from factory.sampling.recipe import make_recipe
from learn.data.preparation import TARGET_SIGNS
from learn.data.sequences import NormalisationFit
from learn.networks.base import NetworkConfig, build_network
from learn.networks.fixed_memory import ExponentialAverages
from learn.networks.plain import averages
from learn.networks.predictor import Predictor
from learn.run import FORMAT, SETTINGS, TARGETS, now, stem, write_description
from learn.run import versions as software
from learn.shipped import FOLDER
from learn.shipped.inputs import GROUPS, MISSING, SORTS, substituted
from learn.training.minibatch import Soap
from learn.training.optimiser import TrainingConfig, step_size
from twin.navigation.features import feature_matrix, mirror_signs, select_features
from twin.navigation.flight_filter import HULLS, USUAL
from twin.navigation.settings import ESTIMATED, estimate
from twin.records.storage.whole import whole_file
from twin.vehicle.vehicle import load_vehicle

PERIODS = {0.5: 0.4, 1.0: 0.15, 2.0: 0.1, 5.0: 0.15, 10.0: 0.1, 30.0: 0.1}
"""[s] Sample periods and their shares of the missions"""
STEADY_S, OTHER_S = 20.0, 5.0
"""[s] Mean time between rows in steady glides and elsewhere: nearer samples are nearly equal"""
HOURS = 100.0
SEEDS = {"field": (1, 3), "family": (2, 4)}
"""Seeds of the stores of HOURS that each vehicle flies, by preset"""
ABSENT = ((), ("imu",), ("ctd",), ("imu", "ctd"))
"""Sensors that missions of the second network lack, in turn; the first network's lack none"""
STEPS, ROWS = 5000, 2048
"""Updates of a training, and rows in each"""
TRAINING = TrainingConfig(seconds=0.0, epochs=1, weight_decay=0.01)
SHAPE: dict[str, Any] = {"kind": "ema", "hidden": 64, "layers": 2, "memories": (2.0, 8.0, 30.0)}
FILTERED = {"surge": "flight_surge", "sway": "flight_sway"}


@dataclasses.dataclass(frozen=True)
class Chunk:
    """Missions of one vehicle, preset and seed."""

    vehicle: str
    preset: str
    seed: int

    def missions(self) -> Iterator[dict[str, Any]]:
        """Signals of each mission, float64."""
        recipe = make_recipe(
            vehicle=self.vehicle, preset=self.preset, hours=HOURS, seed=self.seed, engine="lanes"
        )
        for group in together(recipe, range(len(recipe.plan))):
            for _, signals in fly_missions(recipe, group):
                kinds = {name: values.dtype.kind for name, values in signals.items()}
                yield {name: signals[name].astype(float) for name in kinds if kinds[name] == "f"}

    def rows(self, features: tuple[str, ...], lacking: bool) -> dict[str, Any]:
        """Inputs with averages (rows, recalled), errors (rows, 2) to learn, and steady rows."""
        vehicle, found = load_vehicle(self.vehicle), []
        flies = FILTERED["surge"] in features
        for number, signals in enumerate(self.missions()):
            rng = np.random.default_rng([self.seed, number, len(self.vehicle), lacking])
            period = float(rng.choice(list(PERIODS), p=list(PERIODS.values())))
            thinned = {n: v[:: round(period / 0.5)] for n, v in signals.items()}
            if lacking:
                absent = [c for one in ABSENT[number % len(ABSENT)] for c in MISSING[one]]
                thinned = substituted(thinned, period, absent)
            if flies:
                thinned |= estimate(thinned, vehicle, period, mission=number, spread=HULLS[USUAL])
            made = averages(feature_matrix(thinned, features, period, number), period,
                            SHAPE["memories"])  # fmt: skip
            steady = thinned[ESTIMATED[3]] > 0.0 if flies else np.zeros(len(made), bool)
            keep = rng.random(len(made)) < period / np.where(steady, STEADY_S, OTHER_S)
            wanted = np.stack([
                thinned[f"true_{t}"] - (thinned[f"estimated_{t}"] if flies else 0.0)
                for t in TARGETS
            ], 1)  # fmt: skip
            found.append((made[keep], wanted[keep].astype(np.float32), steady[keep]))
        x, y, steady = (np.concatenate(column) for column in zip(*found, strict=True))
        return {"x": x, "y": y, "steady": steady, "missions": len(found)}


def cached(folder: Path, chunk: Chunk, features: tuple[str, ...], lacking: bool) -> Path:
    """Path of the rows of a chunk, which are made if they are missing."""
    path = folder / f"{chunk.vehicle}-{chunk.preset}-{chunk.seed}-{int(lacking)}.npz"
    if not path.is_file():
        begun = time.process_time()
        made = chunk.rows(features, lacking)
        with whole_file(path) as place, place.open("wb") as file:
            np.savez(file, **made)
        print(f"{path.name}: {time.process_time() - begun:.0f} s of processor", flush=True)
    return path


def load(paths: list[Path]) -> tuple[Any, Any, Any, Any, int]:
    """Inputs, errors, steady rows and weights of all chunks, and the number of missions.

    A row's weight is one over its vehicle's mean squared error outside steady glides, per velocity:
    fast vehicles would decide otherwise.
    """
    parts = [np.load(path) for path in paths]
    x, y, steady = (np.concatenate([one[name] for one in parts]) for name in ("x", "y", "steady"))
    vehicle = np.repeat([p.name.rsplit("-", 3)[0] for p in paths], [len(one["y"]) for one in parts])
    weights = np.zeros_like(y)
    for name in np.unique(vehicle):
        own = vehicle == name
        weights[own] = 1.0 / np.square(y[own & ~steady]).mean(0)
    missions = sum(int(one["missions"]) for one in parts)
    return x, np.where(steady[:, None], 0.0, y), steady, weights, missions


def train(target: str, features: tuple[str, ...], data: tuple[Any, ...], parts: Any) -> Predictor:
    """Train the network of one velocity on the rows; the filter's own output is added to it."""
    x, y, _, weights, _ = data
    place, torch_rng = TARGETS.index(target), torch.Generator().manual_seed(0)
    signs = mirror_signs(features, parts)
    centred = [n for n, s in zip(features, signs, strict=True) if s < 0]
    centred += [target] if TARGET_SIGNS[target] < 0 else []
    fitted = NormalisationFit(features, target, centred)
    width = len(features)
    wanted, weight = y[:, place], weights[:, place] / weights[:, place].mean()
    fitted.add(x[:, :width], wanted)
    scales = dataclasses.replace(
        fitted.result(),
        target_mean=0.0,
        target_scale=float(np.sqrt(1.0 / weights[:, place].mean())),
    )
    torch.manual_seed(TARGETS.index(target))
    network = build_network(NetworkConfig(**SHAPE, inputs=width, period=0.5))
    assert isinstance(network, ExponentialAverages)
    with torch.no_grad():
        for layer in (network.body[-1], network.straight):
            for values in layer.parameters():
                values.zero_()
    copies = 1 + len(SHAPE["memories"])
    mean, scale = (np.tile(np.float32(v), copies) for v in (scales.mean, scales.scale))
    inputs = torch.from_numpy((x - mean) / scale)
    outputs = torch.from_numpy(scales.wanted(wanted))
    counted = torch.from_numpy(weight.astype(np.float32))
    image = torch.from_numpy(np.tile(signs, copies).astype(np.float32))
    optimiser = Soap(network.parameters(), weight_decay=TRAINING.weight_decay)
    for step in range(STEPS):
        for group in optimiser.param_groups:
            group["lr"] = step_size(TRAINING, step / STEPS)
        rows = torch.randint(0, len(inputs), (ROWS,), generator=torch_rng)
        turned = bool(torch.randint(0, 2, (1,), generator=torch_rng))
        seen, sought = inputs[rows], outputs[rows]
        if turned:
            seen, sought = seen * image, sought * TARGET_SIGNS[target]
        loss = (counted[rows] * (network.read(seen)[:, 0] - sought).square()).mean()
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), TRAINING.clip)
        optimiser.step()
        if step % 1000 == 999:
            print(f"{target}: {step + 1} steps, loss {float(loss.detach()):.3f}", flush=True)
    if FILTERED[target] in features:
        column = features.index(FILTERED[target])
        with torch.no_grad():
            network.straight.weight[0, column] += scales.scale[column] / scales.target_scale
        scales = dataclasses.replace(scales, target_mean=scales.mean[column])
    return Predictor(network, scales)


def ship(sort: str, lacking: bool, cache: Path) -> None:
    """Make the networks of one sort of vehicle, in the form of a run's folder."""
    vehicles = SORTS[sort]
    each = [{p.name: p.mirrored() for p in load_vehicle(name).parts} for name in vehicles]
    parts = {n: s for n, s in each[0].items() if all((n, s) in o.items() for o in each)}
    features = select_features(GROUPS[sort], parts=tuple(parts))
    chunks = [Chunk(v, p, s) for p in SEEDS for v in vehicles for s in SEEDS[p]]
    cache.mkdir(parents=True, exist_ok=True)
    paths = [cached(cache, chunk, features, lacking) for chunk in chunks]
    data = load(paths)
    name = sort + "-lacking" * lacking
    folder = FOLDER / name
    folder.mkdir(exist_ok=True)
    for target in TARGETS:
        train(target, features, data, parts).save(stem(folder, target, 0))
    flies = FILTERED["surge"] in features
    hulls = {"hulls": USUAL} if flies else {}
    card = {
        "made_by": f"scripts/ship_networks.py --only {sort}",
        "licence": "Apache-2.0",
        "vehicles": vehicles,
        "models": [load_vehicle(v).model for v in vehicles],
        "hours": HOURS * len(chunks),
        "missions": data[4],
        "presets": {preset: list(seeds) for preset, seeds in SEEDS.items()},
        "sensors": "of the presets" + ", without " * lacking + ", ".join(MISSING) * lacking,
        "periods_s": list(PERIODS),
        "steps": STEPS,
        "rows": len(data[0]),
        "rows_sha256": hashlib.sha256(data[0].tobytes()).hexdigest(),
        "learned": "the filter's error outside steady glides" if flies else "surge and sway",
    }
    settings = {
        "store": "none: missions of the recipe in the card", "features": features,
        "network": {**SHAPE, "period": 0.5, "inputs": len(features)},
        "training": dataclasses.asdict(TRAINING), "members": 1, "division": "missions", **hulls,
    }  # fmt: skip
    assert set(SETTINGS) <= set(settings)
    write_description(folder, {
        "format": FORMAT, "created": now(), "complete": True, "history": card["made_by"],
        "settings": settings, "store": {}, "versions": software(), "card": card,
    })  # fmt: skip
    print(f"{folder}: {len(data[0])} rows of {data[4]} missions", flush=True)


def main() -> None:
    """Make all networks, or those of one sort."""
    warnings.simplefilter("ignore")
    torch.set_num_threads(1)
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cache", type=Path, default=Path("data/shipped"))
    parser.add_argument("--only", choices=list(SORTS), action="append")
    given = parser.parse_args()
    for sort in given.only or SORTS:
        for lacking in (False, True):
            ship(sort, lacking, given.cache / sort)


if __name__ == "__main__":
    main()
