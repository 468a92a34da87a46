"""Dataset: missions of a store as arrays, all at once or a few at a time.

A row of a store of logs is one dive. The true velocity of a log is known only where a current
profiler or a Doppler log measured. Networks neither learn from other samples nor are scored on
them. In simulated stores a missing value is an error.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError, unknown_name
from twin.navigation.features import feature_matrix, leave_out
from twin.navigation.flight_filter import FlightSpread, FlightStart
from twin.navigation.settings import ESTIMATED, estimate, estimate_adapted, sources
from twin.records.attributes import SPLIT, SPLITS
from twin.records.logged import LogRow, LogStore
from twin.records.reader import LEAST_SAMPLES, MissionStore
from twin.records.schema import TIME
from twin.records.storage.sharded import fast_reading
from twin.records.storage.store_path import StorePath, store_path
from twin.records.store import check_filled

Floats = NDArray[np.float32]

Division = Literal["missions", "samples"]
"""Division into training, validation and test, by missions or by samples, see `prepare`."""
TARGETS = {"surge": "true_surge", "sway": "true_sway"}
"""[m/s] Velocities through the water that networks learn, body FRD, with their true channels."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MissionSequence:
    """Signals of one mission."""

    index: int
    """Row in the store."""
    split: str
    period: float
    """[s] between samples."""
    signals: Mapping[str, NDArray[np.float64]]
    """Signals by schema name, each (time,)."""
    row: LogRow | None = None
    """Attributes of the row in a store of real logs; None in a simulated store."""

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(next(iter(self.signals.values())))

    def features(self, names: Sequence[str]) -> Floats:
        """Inputs (time, features) in their own units."""
        return feature_matrix(self.signals, names, self.period, self.index)

    def target(self, name: str) -> Floats:
        """`surge` or `sway` [m/s], (time,); NaN where a real log has no truth.

        If a log has only the speed through the water, surge equals that speed and sway is zero: at
        angles of attack and sideslip below 5 degrees, true surge is less by at most 0.4 %.

        Raises:
          StoreError: the mission lacks the velocity, or a simulated one has a missing value.
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
    spread: FlightSpread | None = None,
) -> list[MissionSequence]:
    """Load all missions of a store's split at once; arguments and errors as in `Selection`."""
    with Selection(
        store, channels, split=split, limit=limit, period=period, spread=spread
    ) as selection:
        return selection.read(range(len(selection)))


class Selection:
    """Missions of a store's split: lengths are known at once, signals are read on request.

    A selection is a context manager. Only one thread may read at a time.
    """

    def __init__(
        self,
        store: str | StorePath,
        channels: Iterable[str],
        *,
        split: str = "all",
        limit: int | None = None,
        period: float | None = None,
        start: FlightStart | None = None,
        spread: FlightSpread | None = None,
        advise: Callable[[Iterable[str]], str] = leave_out,
    ) -> None:
        """Open the store; signals are read later.

        Args:
          store: path of a zarr store of the schema.
          channels: schema names to read, and estimated channels to compute; none to count samples.
          split: train, validation, test or all.
          limit: most missions, from the first on.
          period: [s] between samples, a multiple of the store's; None takes all samples.
          start: start of an adapted run's second flight filter, which adds the channels ADAPTED.
          spread: prior standard deviations of hulls about the vehicle file, for the flight filter.
          advise: function from missing or damaged channels to advice, for errors.

        Raises:
          StoreError: the store is missing, empty, damaged or without splits; the split is unknown;
            a channel is missing; samples are not equally spaced, or too few for `period`.
        """
        if split not in (*SPLITS, "all"):
            raise StoreError(unknown_name("split", split, [*SPLITS, "all"]))
        with fast_reading(store_path(store)):
            self._reader = open_reader(store)
        self._start, self._spread, self._advise = start, spread, advise
        try:
            self._open(tuple(dict.fromkeys(channels)), split, limit, period)
        except BaseException:
            self.close()
            raise

    def _open(
        self, names: tuple[str, ...], split: str, limit: int | None, period: float | None
    ) -> None:
        reader, store, count = self._reader, self._reader.path, len(self._reader)
        check_filled(min(count, reader.dataset.sizes.get(TIME, 0)), f"store {store}")
        self.vehicle = reader.vehicle if set(names) & set(ESTIMATED) else None
        """Vehicle from the store, if estimated channels are computed for it."""
        names = sources(names)
        self._log_rows = reader.log_rows if isinstance(reader, LogStore) else None
        if self._log_rows is not None:  # a log may lack any of the true channels
            names = tuple(name for name in names if name in reader or not name.startswith("true_"))
        missing = [name for name in names if name not in reader]
        if missing:
            raise StoreError(
                f"store {store} has no channel {missing[0]}"
                + (f" (nor {', '.join(missing[1:])})" if missing[1:] else "")
                + "; generate the store again or import it with the files that hold it"
                + self._advise(missing)
            )
        known = SPLIT in reader or split != "all"
        parts = np.array(reader.splits if known else ["all"] * count)
        self._names = names
        self._step = step = 1 if period is None else thinning_step(reader.period, period, store)
        rows = np.flatnonzero(np.ones(count, bool) if split == "all" else parts == split)[:limit]
        if rows.size == 0:
            counted = ", ".join(f"{part} {int((parts == part).sum())}" for part in SPLITS)
            raise StoreError(f"store {store} has no missions in split {split!r} ({counted})")
        reader.check_samples(rows, LEAST_SAMPLES)
        have, stored = reader.period, reader.samples[rows]
        if (short := np.flatnonzero(stored <= (LEAST_SAMPLES - 1) * step)).size:
            raise StoreError(
                f"store {store}: mission {rows[short[0]]} has {stored[short[0]]} samples, too few "
                f"with one every {have * step:g} s; leave --period out or drop the mission"
            )
        self._stored = stored
        self.store: str | StorePath = store
        """Path of the store."""
        self.rows = rows
        """Row in the store of each mission."""
        self.splits: list[str] = parts[rows].tolist()
        """Split of each mission; `all` if the store has no splits."""
        self.lengths: NDArray[np.int64] = -(-stored // step)
        """Samples of each mission."""
        self.period = have * step
        """[s] between samples."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def logged(self) -> bool:
        """True if the missions are logged dives of a real vehicle."""
        return self._log_rows is not None

    def close(self) -> None:
        """Close the store's files."""
        self._reader.close()

    def read(self, places: Sequence[int] | NDArray[np.int64]) -> list[MissionSequence]:
        """Read the missions at these indices of the selection, in the given order.

        Raises:
          StoreError: a file is damaged, or a value is outside `twin.records.schema.limits`.
        """
        places = np.asarray(places, np.int64)
        order = np.argsort(places, kind="stable")  # sequential reads: each shard is opened once
        rows, reader = self.rows[places[order]], self._reader
        signals: list[dict[str, NDArray[np.float64]]] = [{} for _ in places]
        for name in self._names:
            values, advice = reader.rows(name, rows), self._advise([name])
            for place, row, stored, padded in zip(
                order, rows, self._stored[places[order]], values, strict=True
            ):
                own = padded[:stored]
                reader.check_possible(name, own, mission=int(row), advice=advice)
                signals[place][name] = _signal(name, own, self._step, reader.logged)
        if self.vehicle is not None:
            for place, found in enumerate(signals):
                row = int(self.rows[places[place]])
                own = estimate(
                    found, self.vehicle, self.period, mission=row, spread=self._spread,
                    advise=self._advise,
                )  # fmt: skip
                if self._start is not None:
                    own |= estimate_adapted(
                        found, self.vehicle, self.period, self._start, self._spread
                    )
                found |= own
        return [
            MissionSequence(
                index=int(self.rows[place]),
                split=self.splits[place],
                period=self.period,
                signals=found,
                row=None if self._log_rows is None else self._log_rows[self.rows[place]],
            )
            for place, found in zip(places, signals, strict=True)
        ]

    def each(self, places: Iterable[int] | None = None) -> Iterator[MissionSequence]:
        """Iterate over the missions at these indices, or all, with few in memory at a time.

        Raises:
          StoreError: see `read`.
        """
        for group in pieces(range(len(self)) if places is None else places, self.lengths):
            yield from self.read(group)

    def groups(self, most: int) -> Iterator[list[MissionSequence]]:
        """Iterate over all missions in groups of at most `most`; one group is in memory at a time.

        Raises:
          StoreError: see `read`.
        """
        for first in range(0, len(self), most):
            yield self.read(range(first, min(first + most, len(self))))


AT_A_TIME = 2**17
"""Maximum number of samples per read: their channels take 30 MB before they become features."""


def pieces(places: Iterable[int], lengths: NDArray[np.int64]) -> Iterator[list[int]]:
    """Group indices of missions, at most AT_A_TIME samples or one longer mission per group."""
    group: list[int] = []
    samples = 0
    for place in places:
        if group and samples + lengths[place] > AT_A_TIME:
            yield group
            group, samples = [], 0
        group.append(int(place))
        samples += int(lengths[place])
    if group:
        yield group


def open_reader(store: str | StorePath) -> MissionStore:
    """Open a store with the reader for its type, simulated or logged.

    Raises:
      StoreError: see `twin.records.reader.MissionStore`.
    """
    reader = MissionStore(store)
    if not reader.logged:
        return reader
    reader.close()
    return LogStore(store)


def _signal(name: str, values: Any, step: int, real: bool) -> NDArray[np.float64]:
    """Every `step`-th sample of a channel; gaps of logs are filled, true values by `nearest`."""
    values = np.asarray(values, np.float64)
    if not real:
        return values[::step]
    return nearest(values, step) if name.startswith("true_") else filled(name, values)[::step]


def thinning_step(have: float, want: float, store: str | StorePath) -> int:
    """Step between samples that thins a store's period `have` [s] to `want` [s].

    Raises:
      StoreError: `want` is not a multiple of `have`.
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
"""[1] Fraction of the store's period by which a wanted period may miss a multiple of it."""


Array = NDArray[np.float64]

SPEED = "true_speed"
"""Channel of the speed through the water, which only logs with a Doppler log have."""
NO_BRIDGE = ("measured_gps", "measured_dvl", "measured_camera")
"""Prefixes of channels that are not interpolated: a gap means that nothing was measured."""


def filled(name: str, values: Array) -> Array:
    """Fill the gaps of a channel by linear interpolation.

    True channels, fixes, velocities by Doppler or camera, and empty channels stay unchanged.
    """
    if not name.startswith(("measured_", "commanded_")) or name.startswith(NO_BRIDGE):
        return values
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    index = np.arange(len(values))
    if name.endswith("heading"):
        turned = np.unwrap(np.deg2rad(values[known]))
        return np.mod(np.rad2deg(np.interp(index, index[known], turned)), 360.0)
    return np.interp(index, index[known], values[known])


def nearest(values: Array, step: int) -> Array:
    """Every `step`-th sample; a missing sample takes the nearest value within half a step, so that
    a true velocity that is given every ten seconds stays."""
    kept = values[::step].copy()
    places = np.arange(0, len(values), step)
    for offset in sorted(range(-((step - 1) // 2), step // 2 + 1), key=abs):
        there = places + offset
        inside = (there >= 0) & (there < len(values)) & ~np.isfinite(kept)
        kept[inside] = values[there[inside]]
    return kept
