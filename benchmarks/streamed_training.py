"""Streamed training against training from memory: throughput, peak memory, weights.

    factory generate --hours 60 --out hours.zarr
    python -m benchmarks.streamed_training hours.zarr --epochs 3 --buffer 65536

Trains the same network in both modes, each in its own process and both at the same time. Prints for
each pair the samples trained per second, their ratio, and the peak resident memory above that of
imported libraries. The weights must be equal.
"""

from __future__ import annotations

import hashlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Literal

import zarr  # noqa: F401 - imported before the memory of the libraries is read

from benchmarks import command
from learn.data.preparation import training_lengths
from learn.data.stores import parts_of
from learn.networks.base import NetworkConfig
from learn.training.fit_config import FitConfig
from learn.training.optimiser import TrainingConfig
from learn.training.resources import train as train_job
from twin.navigation.features import select_features

WAYS = ("resident", "streamed")


def main(
    store: command.Positional[Path],
    *,
    epochs: int = 3,
    buffer: int = 2**16,
    optimiser: str = "soap",
    network: str = "elman",
    pairs: int = 3,
    way: Literal["resident", "streamed"] | None = None,
) -> int:
    """Print a line for each pair; exit code 1 if weights differ.

    Args:
      buffer: samples shuffled together.
      way: mode to train here, printing figures as JSON.
    """
    if way is not None:
        training = TrainingConfig(
            optimiser=optimiser, seconds=0.0, epochs=epochs, buffer=buffer, validations=2 * epochs
        )
        print(json.dumps(train(store, training, network, resident=way == "resident")))
        return 0
    ratios = []
    for pair in range(pairs):
        found = {}
        for one in WAYS if pair % 2 == 0 else reversed(WAYS):
            words = [sys.executable, "-m", "benchmarks.streamed_training", *sys.argv[1:]]
            words += ["--way", one]
            environment = {**os.environ, "OMP_NUM_THREADS": "1"}
            run = subprocess.run(words, env=environment, stdout=subprocess.PIPE, check=True)
            found[one] = json.loads(run.stdout)
        one, other = (found[way] for way in WAYS)
        ratios.append(other["samples_per_s"] / one["samples_per_s"])
        equal = one["weights"] == other["weights"]
        print(
            f"pair {pair}: resident {one['samples_per_s'] / 1e3:.1f}, streamed "
            f"{other['samples_per_s'] / 1e3:.1f} thousand samples/s of training, ratio "
            f"{ratios[-1]:.2f} (per second of computing "
            f"{other['samples_per_cpu_s'] / one['samples_per_cpu_s']:.2f}); memory "
            f"{one['memory_mb']:.0f} and {other['memory_mb']:.0f} MB; weights "
            f"{'equal' if equal else 'DIFFERENT'}",
            flush=True,
        )
        if not equal:
            return 1
    print(f"median ratio {statistics.median(ratios):.2f}")
    return 0


def train(
    store: Path, training: TrainingConfig, network: str, *, resident: bool
) -> dict[str, object]:
    """Train one network of surge; return its figures."""
    config = FitConfig(
        store=str(store),
        features=select_features(parts=tuple(parts_of(store))),
        network=NetworkConfig(kind=network),
        training=training,
    )
    lengths, _ = training_lengths(store)
    before = _peak()
    with tempfile.TemporaryDirectory() as folder:
        begun, spent = time.perf_counter(), time.process_time()
        train_job(config.jobs()[0], Path(folder), lambda _: None, resident=resident)
        seconds, computing = time.perf_counter() - begun, time.process_time() - spent
        weights = (Path(folder) / "surge-0.safetensors").read_bytes()
    samples = training.epochs * int(lengths.sum())
    return {
        "samples_per_s": samples / seconds,
        "samples_per_cpu_s": samples / computing,
        "memory_mb": (_peak() - before) / 1e6,
        "weights": hashlib.sha256(weights).hexdigest(),
    }


def _peak() -> float:
    """[bytes] Largest resident memory of this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


if __name__ == "__main__":
    sys.exit(command.run(main))
