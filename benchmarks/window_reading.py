"""Window reading for training: `factory.Windows`, against slices of the store and a bare copy.

    python -m benchmarks.window_reading [HOURS] [MEMORY_MB]

Makes a field store of HOURS (default 20). Reads random windows of 256 samples of ten signals; the
methods take turns. `streamed` has memory for a part of the store only (default 4 MB), so that every
mission is decoded again in every epoch; its comparison is decoding alone. The comparison of `in
memory` is a copy of as many bytes.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import factory
from benchmarks import command
from benchmarks.figures import measured, medians
from twin.cli.text_table import format_table

CHANNELS = (
    "measured_roll", "measured_pitch", "measured_heading", "measured_depth", "measured_roll_rate",
    "measured_pitch_rate", "measured_yaw_rate", "measured_pump", "true_surge", "true_sway",
)  # fmt: skip
LENGTH, STRIDE, BATCH, ROUNDS, SLICES = 256, 64, 256, 3, 10


def main(
    hours: command.Positional[float] = 20.0, memory_mb: command.Positional[float] = 4.0
) -> int:
    """Print the table; 1 when reading from memory is less than 100 times as fast as slices."""
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "missions.zarr"
        factory.generate(store, preset="field", hours=hours, seed=1)
        reader = factory.open(store)
        windows = factory.Windows(store, CHANNELS, length=LENGTH, stride=STRIDE).load()
        small = factory.Windows(
            store, CHANNELS, length=LENGTH, stride=STRIDE, memory=memory_mb * 1e6
        )
        numbers = windows.order(seed=0)
        flat = np.zeros((BATCH, LENGTH, len(CHANNELS)), np.float32)

        def slices() -> int:
            for k in numbers[:SLICES]:
                row, start = int(windows.missions[k]), int(windows.starts[k])
                np.stack([reader.dataset[name][row, start : start + LENGTH].values
                          for name in CHANNELS], axis=1)  # fmt: skip
            return SLICES

        def batches(read: factory.Windows) -> int:
            return sum(len(batch) for batch in read.batches(BATCH, seed=0))

        def one_by_one() -> int:
            return len([windows[k] for k in numbers[:BATCH]])

        def decoding() -> int:
            rows = range(len(reader))
            for name in CHANNELS:
                reader.rows(name, rows)
            return len(windows)

        def copying() -> int:
            copies = len(windows) // BATCH
            for _ in range(copies):
                flat.copy()
            return copies * BATCH

        ways = {
            "slices of the store": slices, "in memory, batches": partial(batches, windows),
            "in memory, one by one": one_by_one, "limit: a copy": copying,
            "streamed": partial(batches, small), "limit: decoding": decoding,
        }  # fmt: skip

        def rate(work: Callable[[], int]) -> float:
            begun = time.perf_counter()
            return work() / (time.perf_counter() - begun)

        found = medians({name: partial(rate, work) for name, work in ways.items()}, ROUNDS)
        slow = found["slices of the store"]
        megabytes = LENGTH * len(CHANNELS) * 4 / 1e6
        rows = [
            {"way": name, "windows/s": round(value), "MB/s": round(value * megabytes),
             "times slices": round(value / slow)}
            for name, value in found.items()
        ]  # fmt: skip
        print(format_table(rows, digits=7))
        copy, decoding_alone = found["limit: a copy"], found["limit: decoding"]
        if copy:  # the store's windows fit into this memory
            memory, streaming = found["in memory, batches"], found["streamed"]
            measured(
                "window_reading", memory=memory, memory_times=memory / slow,
                memory_share=memory / copy, streamed=streaming, streamed_times=streaming / slow,
                streamed_share=streaming / decoding_alone,
            )  # fmt: skip
        return int(found["in memory, batches"] < 100.0 * slow)


if __name__ == "__main__":
    sys.exit(command.run(main))
