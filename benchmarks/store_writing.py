"""Shards of a store through zarr: the codec pipeline `zarrs` against zarr-python's own.

    python -m benchmarks.store_writing [MISSIONS] [REPEATS]

By default 64 missions (one shard) of every simulated signal, 2700 s each: 49 hours. The two take
turns; the files must have the same bytes.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.figures import measured
from twin.cli.text_table import format_table
from twin.records.schema import SIMULATED, VARIABLES
from twin.records.storage import sharded
from twin.records.storage.sharded import (
    PYTHON_PIPELINE,
    RUST_PIPELINE,
    ShardedStore,
    stored_values,
)
from twin.records.storage.stored_files import LocalFiles

SAMPLES = 5401


def made_signals(missions: int) -> dict[str, np.ndarray]:
    """Random walks, rounded as stores round; one signal that a mission lacks."""
    rng = np.random.default_rng(0)
    walk = np.cumsum(0.01 * rng.standard_normal((missions, SAMPLES)), axis=1)
    signals = {name: stored_values(walk, VARIABLES[name].decimals) for name in SIMULATED}
    signals["measured_gps_north"][0] = np.nan
    return signals


def write(folder: Path, signals: dict[str, np.ndarray], pipeline: str) -> tuple[float, list[bytes]]:
    """Seconds, and the files' bytes."""
    missions = len(next(iter(signals.values())))
    store = ShardedStore(
        LocalFiles(folder),
        missions=missions,
        samples=SAMPLES,
        shard_missions=missions,
        row_missions=missions,
        staging=folder / ".staging",
    )
    with mock.patch.object(sharded, "fast_pipeline", return_value=pipeline):
        store.prepare()
        begun = time.perf_counter()
        for name, values in signals.items():
            store.write_shard(0, name, values)
        seconds = time.perf_counter() - begun
    files = sorted(path for path in folder.glob("*/c/0/0") if path.is_file())
    return seconds, [path.read_bytes() for path in files]


def main(missions: int, repeats: int) -> int:
    """Print the table; 1 when the bytes differ."""
    signals = made_signals(missions)
    times: dict[str, list[float]] = {RUST_PIPELINE: [], PYTHON_PIPELINE: []}
    contents: list[list[bytes]] = []
    for _ in range(repeats):
        for pipeline, seconds in times.items():
            with tempfile.TemporaryDirectory() as folder:
                taken, files = write(Path(folder), signals, pipeline)
            seconds.append(taken)
            contents.append(files)
    same = all(files == contents[0] for files in contents)
    rows = [
        {"pipeline": name, "median s": statistics.median(taken), "worst s": max(taken)}
        for name, taken in times.items()
    ]
    print(format_table(rows, digits=3))
    rust, python = (statistics.median(times[name]) for name in (RUST_PIPELINE, PYTHON_PIPELINE))
    measured("store_writing", zarrs=rust, python=python)
    size = sum(map(len, contents[0])) / 1e6
    print(f"{len(signals)} signals of {missions} missions, {size:.1f} MB; ", end="")
    print("the same bytes" if same else "DIFFERENT BYTES")
    return int(not same)


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:]]
    sys.exit(main(*(numbers + [64, 3][len(numbers) :])))
