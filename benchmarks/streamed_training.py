"""Training from memory and training streamed from the store: throughput, peak memory, weights.

    factory generate --hours 60 --out hours.zarr
    python -m benchmarks.streamed_training hours.zarr --epochs 3 --buffer 65536

Trains the same network both ways, each in a process of its own and the two of a pair side by side
in time, and prints for each pair how many samples a second were trained on, the ratio, and the peak
of the resident memory above that of the imported libraries. The weights must be equal.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

WAYS = ("resident", "streamed")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("store", type=Path)
    parser.add_argument("--epochs", type=int, default=3)
    parser.add_argument("--buffer", type=int, default=2**16, help="samples shuffled together")
    parser.add_argument("--optimiser", default="soap")
    parser.add_argument("--network", default="elman")
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--way", choices=WAYS, help="train here, print figures as JSON")
    options = parser.parse_args()
    if options.way is not None:
        print(json.dumps(train(options)))
        return 0
    ratios = []
    for pair in range(options.pairs):
        found = {}
        for way in WAYS if pair % 2 == 0 else reversed(WAYS):
            command = [sys.executable, "-m", "benchmarks.streamed_training", *sys.argv[1:]]
            environment = {**os.environ, "OMP_NUM_THREADS": "1"}
            command += ["--way", way]
            run = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
            found[way] = json.loads(run.stdout)
        one, other = (found[way] for way in WAYS)
        ratios.append(other["samples_per_s"] / one["samples_per_s"])
        equal = "equal" if one["weights"] == other["weights"] else "DIFFERENT"
        print(
            f"pair {pair}: resident {one['samples_per_s'] / 1e3:.1f}, streamed "
            f"{other['samples_per_s'] / 1e3:.1f} thousand samples/s of training, ratio "
            f"{ratios[-1]:.2f} (per second of computing "
            f"{other['samples_per_cpu_s'] / one['samples_per_cpu_s']:.2f}); memory "
            f"{one['memory_mb']:.0f} and {other['memory_mb']:.0f} MB; weights {equal}",
            flush=True,
        )
        if equal != "equal":
            return 1
    print(f"median ratio {statistics.median(ratios):.2f}")
    return 0


def train(options: argparse.Namespace) -> dict[str, object]:
    """Train one network of surge; figures of it."""
    import zarr  # noqa: F401  imported before the memory of the libraries is read

    from learn.data.preparation import training_lengths
    from learn.data.stores import parts_of
    from learn.networks.base import NetworkConfig
    from learn.training.fit_config import FitConfig
    from learn.training.optimiser import TrainingConfig
    from learn.training.resources import train as train_job
    from twin.navigation.features import select_features

    training = TrainingConfig(
        optimiser=options.optimiser,
        seconds=0.0,
        epochs=options.epochs,
        buffer=options.buffer,
        validations=2 * options.epochs,
    )
    config = FitConfig(
        store=str(options.store),
        features=select_features(parts=tuple(parts_of(options.store))),
        network=NetworkConfig(kind=options.network),
        training=training,
    )
    lengths, _ = training_lengths(options.store)
    before = _peak()
    with tempfile.TemporaryDirectory() as folder:
        begun, spent = time.perf_counter(), time.process_time()
        train_job(
            config.jobs()[0], Path(folder), lambda _: None, resident=options.way == "resident"
        )
        seconds, computing = time.perf_counter() - begun, time.process_time() - spent
        weights = (Path(folder) / "surge-0.safetensors").read_bytes()
    return {
        "samples_per_s": options.epochs * int(lengths.sum()) / seconds,
        "samples_per_cpu_s": options.epochs * int(lengths.sum()) / computing,
        "memory_mb": (_peak() - before) / 1e6,
        "weights": hashlib.sha256(weights).hexdigest(),
    }


def _peak() -> float:
    """Bytes, the most that this process has had resident."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


if __name__ == "__main__":
    raise SystemExit(main())
