"""Dataset: missions of a store as arrays, their split, and windows packed for training."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.data.logs import SPEED, filled, nearest
from twin.errors import StoreError, unknown_name
from twin.navigation.features import feature_matrix, leave_out
from twin.records.attributes import SPLIT, SPLITS
from twin.records.logs import LogRow, LogStore
from twin.records.reader import LEAST_SAMPLES, MissionStore
from twin.records.schema import TIME
from twin.records.store_path import StorePath

Floats = NDArray[np.float32]

TARGETS = {"surge": "true_surge", "sway": "true_sway"}
"""What the networks learn: velocities through the water [m/s], body FRD."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mission:
    """Signals of one mission."""

    index: int
    """Row in the store."""
    split: str
    period: float
    """[s] between samples."""
    signals: Mapping[str, NDArray[np.float64]]
    """By schema name, each (time,)."""
    row: LogRow | None = None
    """What a store of real logs says of it; None in a simulated one."""

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(next(iter(self.signals.values())))

    def features(self, names: Sequence[str]) -> Floats:
        """Inputs (time, features) in their own units."""
        return feature_matrix(self.signals, names, self.period, self.index)

    def target(self, name: str) -> Floats:
        """`surge` or `sway` [m/s], (time,); NaN where a real log has no truth.

        Where a log's only truth is the speed through the water, surge is that speed and sway zero:
        at a glider's angles of attack and sideslip, below 5 degrees, surge is less by 0.4 %.

        Raises:
          StoreError: the mission lacks it or, in a simulated store, it is not finite.
        """
        channel = TARGETS[name]
        if self.row is not None:
            values = self.signals.get(channel, np.full(self.samples, np.nan))
            if SPEED in self.signals and not np.isfinite(values).any():
                speed = self.signals[SPEED]
                values = speed if name == "surge" else np.where(np.isfinite(speed), 0.0, np.nan)
            return values.astype(np.float32)
        if channel not in self.signals:
            raise StoreError(f"mission {self.index} has no channel {channel}")
        values = self.signals[channel].astype(np.float32)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise StoreError(
                f"channel {channel} of mission {self.index} is not finite at {bad.size} samples, "
                f"first at {bad[0] * self.period:.1f} s"
            )
        return values


def load_missions(
    store: str | StorePath,
    channels: Iterable[str],
    *,
    split: str = "all",
    limit: int | None = None,
    period: float | None = None,
) -> list[Mission]:
    """Missions of one part of a store with the named channels.

    Args:
      store: path of a zarr store of the schema.
      channels: schema names to read.
      split: train, validation, test or all.
      limit: read at most so many missions.
      period: [s] between samples, a multiple of the store's; None takes all samples.

    Raises:
      StoreError: no store, an empty or damaged one, no split in it, an unknown part, a missing
        channel, a value that is not possible (`twin.records.limits`), samples that are not
        equally spaced, or too few for `period`.
    """
    if split not in (*SPLITS, "all"):
        raise StoreError(unknown_name("split", split, [*SPLITS, "all"]))
    with open_reader(store) as reader:
        return _load(reader, tuple(dict.fromkeys(channels)), split, limit, period)


def any_channel(store: str | StorePath) -> tuple[str, ...]:
    """A channel that a store has whatever its vehicle measured: to ask for its missions alone."""
    with MissionStore(store) as reader:
        return ("measured_depth",) if "measured_depth" in reader else ("measured_gap",)


def open_reader(store: str | StorePath) -> MissionStore:
    """A store as what it is, simulated or logged.

    Raises:
      StoreError: see `twin.records.reader.MissionStore`.
    """
    reader = MissionStore(store)
    if not reader.logged:
        return reader
    reader.close()
    return LogStore(store)


def _load(
    reader: MissionStore,
    names: tuple[str, ...],
    split: str,
    limit: int | None,
    period: float | None,
) -> list[Mission]:
    store, count = reader.path, len(reader)
    if count == 0 or reader.dataset.sizes.get(TIME, 0) == 0:
        raise StoreError(f"store {store} holds no missions; make some with `factory generate`")
    log_rows = reader.log_rows if isinstance(reader, LogStore) else None
    if log_rows is not None:  # a log has the truth that it has
        names = tuple(name for name in names if name in reader or not name.startswith("true_"))
    missing = [name for name in names if name not in reader]
    if missing:
        raise StoreError(
            f"store {store} has no channel {missing[0]}"
            + (f" (nor {', '.join(missing[1:])})" if missing[1:] else "")
            + "; generate the store again or import it with the files that hold it"
            + leave_out(missing)
        )
    known = SPLIT in reader or split != "all"
    parts = np.array(reader.splits if known else ["all"] * count)
    step = 1 if period is None else thinning_step(reader.period, period, store)
    rows = np.flatnonzero(np.ones(count, bool) if split == "all" else parts == split)[:limit]
    if rows.size == 0:
        counted = ", ".join(f"{part} {int((parts == part).sum())}" for part in SPLITS)
        raise StoreError(f"store {store} has no missions in split {split!r} ({counted})")
    reader.check_samples(rows, LEAST_SAMPLES)
    have, lengths = reader.period, reader.samples[rows]
    if (short := np.flatnonzero(lengths <= (LEAST_SAMPLES - 1) * step)).size:
        raise StoreError(
            f"store {store}: mission {rows[short[0]]} has {lengths[short[0]]} samples, too few "
            f"with one every {have * step:g} s; leave --period out or drop the mission"
        )
    signals: list[dict[str, NDArray[np.float64]]] = [{} for _ in rows]
    for name in names:
        values = reader.rows(name, rows)
        for k, row in enumerate(rows):
            own = values[k, : lengths[k]]
            reader.check_possible(name, own, mission=int(row), advice=leave_out([name]))
            signals[k][name] = _signal(name, own, step, reader.logged)
    return [
        Mission(
            index=int(row),
            split=str(parts[row]),
            period=have * step,
            signals=signals[k],
            row=None if log_rows is None else log_rows[row],
        )
        for k, row in enumerate(rows)
    ]


def _signal(name: str, values: Any, step: int, real: bool) -> NDArray[np.float64]:
    """A channel with every `step`-th sample; of a log without holes, truth the nearest one."""
    values = np.asarray(values, np.float64)
    if not real:
        return values[::step]
    return nearest(values, step) if name.startswith("true_") else filled(name, values)[::step]


def thinning_step(have: float, want: float, store: str | StorePath) -> int:
    """Every which sample of a store gives one every `want` [s].

    Raises:
      StoreError: the store has too few samples, or `want` is not a multiple of its period.
    """
    step = round(want / have) if math.isfinite(want) else 0
    if step < 1 or abs(step * have - want) > TOLERANCE * have:
        raise StoreError(
            f"store {store} has a sample every {have:g} s and one every {want:g} s is wanted, no "
            f"multiple of it, and what networks see depends on it. Train with `learn fit --period "
            f"{have:g}` on a store that is at least as fine, or make the store with samples every "
            f"{want:g} s (`factory import --period {want:g}`)"
        )
    return step


TOLERANCE = 1e-3
"""Part of a sample by which a wanted period may miss a multiple of the store's."""


@dataclasses.dataclass(frozen=True)
class Mirror:
    """Port taken for starboard: a glider is as symmetric as its image is a glider."""

    inputs: Floats
    """Sign of each feature, (features,), 1 or -1; features of sign -1 are normalised about zero."""
    target: float
    """Sign of the target: 1 for surge, -1 for sway."""


@dataclasses.dataclass(frozen=True)
class Sequences:
    """Missions as a network of one target sees them: normalised inputs and target."""

    inputs: list[Floats]
    """(time, features) of each mission."""
    targets: list[Floats]
    """(time,) of each mission."""
    weights: list[Floats]
    """(time,) of each mission: 1 where the sample counts, else 0."""
    mirror: Mirror | None = None
    """How missions are mirrored; None where that is not wanted."""

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Samples of each mission."""
        return np.array([len(t) for t in self.targets])

    @property
    def samples(self) -> int:
        """Samples of all missions."""
        return int(self.lengths.sum())


def sample_split(lengths: Iterable[int], seed: int) -> list[list[Floats]]:
    """The paper's division: each SAMPLE is training, validation or test with 70, 15, 15 %.

    It leaks: samples half a second apart are nearly equal, so validation and test cannot judge
    unseen motion. It is here to reproduce the paper's figures, never to choose a network.

    Returns:
      For train, validation, test: weights (time,) of each mission, 0 or 1.
    """
    rng = np.random.default_rng(seed)
    draws = [rng.random(length) for length in lengths]
    edges = (0.0, 0.7, 0.85, 1.0)
    return [
        [((d >= low) & (d < high)).astype(np.float32) for d in draws]
        for low, high in itertools.pairwise(edges)
    ]


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
