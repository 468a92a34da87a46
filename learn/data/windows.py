"""Windows: pieces of missions packed for training, and the order in which training sees them.

The order follows from the seed and the number of the epoch. Missions are taken into a buffer of
about so many samples, the buffer's windows are shuffled, and the next buffer follows. A store that
fits into one buffer is shuffled as a whole. Whether sequences are in memory or are read from the
store has no part in it, so that both ways train the same network.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from learn.data.sequences import Sequences

Floats = NDArray[np.float32]


@dataclasses.dataclass(frozen=True)
class Windows:
    """Pieces of missions, (mission, start, wash-in, length, mirrored), see `cut_windows`."""

    table: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.table)


def cut_windows(
    lengths: Iterable[int],
    *,
    length: int,
    washin: int,
    rng: np.random.Generator | None = None,
    mirror: bool = False,
) -> Windows:
    """Cut missions into pieces whose counted samples tile every mission exactly once.

    A piece counts `length` samples (the last of a mission fewer) and starts up to `washin` samples
    earlier, so that a network has found its state when counting begins. The first piece starts at
    the launch with no wash-in: the launch from rest counts. With `rng` the cuts are moved by a
    random amount, so that epochs differ. With `mirror` every other piece, at random, is the mirror
    image; without `rng` every piece comes both ways.
    """
    rows = []
    for mission, total in enumerate(lengths):
        first = length if rng is None else int(rng.integers(1, length + 1))
        begin = 0
        while begin < total:
            end = min(first if begin == 0 else begin + length, total)
            start = max(0, begin - washin)
            rows.append((mission, start, begin - start, end - begin, 0))
            begin = end
    table = np.array(rows, np.int64).reshape(-1, 5)
    if mirror and rng is not None:
        table[:, 4] = rng.integers(0, 2, len(table))
    elif mirror:
        table = np.concatenate([table, table + np.array([0, 0, 0, 0, 1])])
    return Windows(table)


def pack_windows(sequences: Sequences, windows: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
    """Windows side by side, padded at the end.

    Returns:
      inputs (time, batch, features), targets and weights (time, batch); wash-in and padding have
      weight 0.
    """
    longest = int((windows[:, 2] + windows[:, 3]).max())
    batch, features = len(windows), sequences.inputs[0].shape[1]
    x = np.zeros((longest, batch, features), np.float32)
    y = np.zeros((longest, batch), np.float32)
    w = np.zeros((longest, batch), np.float32)
    for column, (mission, start, skip, count, _) in enumerate(windows):
        end = start + skip + count
        x[: skip + count, column] = sequences.inputs[mission][start:end]
        y[: skip + count, column] = sequences.targets[mission][start:end]
        w[skip : skip + count, column] = sequences.weights[mission][start + skip : end]
    if sequences.mirror is not None:
        turned = windows[:, 4] == 1
        x[:, turned] *= sequences.mirror.inputs
        y[:, turned] *= np.float32(sequences.mirror.target)
    return x, y, w


def batches(
    windows: Windows, size: int, rng: np.random.Generator | None = None
) -> list[NDArray[np.int64]]:
    """Windows in groups of about `size`, similar lengths together, groups in random order.

    Sorting by length keeps the padding small; ties are broken at random.
    """
    table = windows.table
    if rng is not None:
        table = table[rng.permutation(len(table))]
    spans = table[:, 2] + table[:, 3]
    table = table[np.argsort(-spans, kind="stable")]
    groups = [table[k : k + size] for k in range(0, len(table), size)]
    if rng is not None:
        groups = [groups[k] for k in rng.permutation(len(groups))]
    return groups
