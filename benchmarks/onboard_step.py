"""On-board step: time of the exported C code with features, and of onnxruntime without.

    python -m benchmarks.onboard_step STORE [--kinds ema elman] [--members 1] [--missions 1]
                                      [--run RUN]

Networks have the default size and random weights, one surge and one sway for each member, over the
longest missions of the store. C99 computes both velocities from sensor samples (`cc -O3` for any
processor of the family); the ONNX models of the same networks get the features. Times are per
sample, on one thread, for both velocities. `--run` takes a trained run's networks, with the vehicle
that the run adapted to.
"""

from __future__ import annotations

import dataclasses
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import torch

from benchmarks import command
from learn.data.dataset import MissionSequence, Selection
from learn.data.preparation import prepare
from learn.data.stores import input_groups
from learn.networks.base import NetworkConfig, build_network
from learn.networks.c_export import export_c
from learn.networks.onnx_export import export_step
from learn.networks.predictor import Ensemble, Predictor
from learn.run import open_run
from learn.seams import NETWORKS
from twin.cli.text_table import counted
from twin.navigation.features import channels_of, select_features
from twin.records.reader import MissionStore
from twin.vehicle.vehicle import Vehicle


@dataclasses.dataclass(frozen=True)
class Asked:
    """Options of the benchmark."""

    store: command.Positional[str]
    """store of missions with full inputs"""
    kinds: tuple[str, ...] = tuple(NETWORKS.shipped())
    members: int = 1
    missions: int = 1
    """number of missions, the longest first"""
    run: str | None = None
    """trained networks in place of random ones"""


def candidates(
    options: Asked,
) -> Iterator[tuple[str, dict[str, Ensemble], list[MissionSequence], Vehicle | None]]:
    """Name and networks, with the store's longest missions and its vehicle."""
    torch.manual_seed(0)
    run = open_run(options.run) if options.run else None
    features = select_features(input_groups("full", options.store)) if run is None else run.features
    with MissionStore(options.store) as reader:
        trained = {} if run is None else run.networks(reader.vehicle)
    start = trained["surge"].start if run else None
    period = run.period if run else None
    with Selection(options.store, channels_of(features), period=period, start=start) as selection:
        longest = (-selection.lengths).argsort(kind="stable")[: options.missions]
        missions = selection.read(longest)
        vehicle = selection.vehicle
    if run is not None:
        yield f"run {run.name}{', adapted' * (start is not None)}", trained, missions, vehicle
        return
    scales = {
        target: prepare(options.store, target=target, features=features).normalisation
        for target in ("surge", "sway")
    }
    for kind in options.kinds:
        config = NetworkConfig(kind=kind, inputs=len(features), period=missions[0].period)
        networks = {
            target: Ensemble(
                tuple(Predictor(build_network(config), own) for _ in range(options.members))
            )
            for target, own in scales.items()
        }
        yield kind, networks, missions, vehicle


def main(asked: command.OmitArgPrefixes[Asked]) -> None:
    """Print the cost of a step for each network type."""
    os.environ["OMP_NUM_THREADS"] = "1"
    for name, networks, missions, vehicle in candidates(asked):
        members = [member for ensemble in networks.values() for member in ensemble.members]
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "velocity.h"
            c = [export_c(networks, place, mission, vehicle) for mission in missions]
            onnx = [
                export_step(m, Path(folder) / "step.onnx", missions[0]).step_us for m in members
            ]
        weights = sum(p.numel() for m in members for p in m.network.parameters())
        state = sum(m.network.state_size for m in members)
        print(
            f"{name:6s} {weights} weights, state of {state} numbers: C "
            f"{min(p.step_us for p in c):.1f} us, onnxruntime {sum(onnx):.1f} us; over "
            f"{counted(len(c), 'mission')} C differs by {max(p.largest for p in c):.1g} m/s at "
            f"most, {median(p.rms for p in c):.1g} m/s in root mean square, "
            f"{max(p.rms for p in c):.1g} in the worst",
            flush=True,
        )


if __name__ == "__main__":
    sys.exit(command.run(main))
