"""What a step on board costs: the exported C code, with features, beside onnxruntime without.

    python -m benchmarks.onboard_step STORE [--kinds ema elman] [--members 1]

Networks of the default size with random weights, one surge and one sway for each member, over the
longest mission of the store: C99 from sensor samples to both velocities, `cc -O3` for any
processor of the family, and the ONNX models of the same networks, features given. Times are per
sample, one thread, and are those of both velocities.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

import torch

from learn.data.dataset import Selection
from learn.data.preparation import prepare
from learn.data.store_checks import input_groups
from learn.networks.base import build_network
from learn.networks.c_export import export_c
from learn.networks.config import NetworkConfig
from learn.networks.onnx_export import export_step
from learn.networks.predictor import Ensemble, Predictor
from learn.seams import NETWORKS
from twin.navigation.features import channels_of, select_features


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("store", help="missions with full inputs")
    parser.add_argument("--kinds", nargs="+", default=list(NETWORKS.shipped()))
    parser.add_argument("--members", type=int, default=1)
    options = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    features = select_features(input_groups("full", options.store))
    with Selection(options.store, channels_of(features)) as selection:
        (mission,) = selection.read([int(selection.lengths.argmax())])
        vehicle = selection.vehicle
    scales = {
        target: prepare(options.store, target=target, features=features).normalisation
        for target in ("surge", "sway")
    }
    for kind in options.kinds:
        config = NetworkConfig(kind=kind, inputs=len(features), period=mission.period)
        networks = {
            target: Ensemble(
                tuple(Predictor(build_network(config), own) for _ in range(options.members))
            )
            for target, own in scales.items()
        }
        members = [member for ensemble in networks.values() for member in ensemble.members]
        with tempfile.TemporaryDirectory() as folder:
            c = export_c(networks, Path(folder) / "velocity.h", mission, vehicle)
            onnx = [export_step(m, Path(folder) / "step.onnx", mission).step_us for m in members]
        weights = sum(p.numel() for m in members for p in m.network.parameters())
        state = sum(m.network.state_size for m in members)
        print(
            f"{kind:6s} {weights} weights, state of {state} numbers: C {c.step_us:.1f} us, "
            f"onnxruntime {sum(onnx):.1f} us; C differs by {c.largest:.1g} m/s at most",
            flush=True,
        )


if __name__ == "__main__":
    torch.manual_seed(0)
    main()
