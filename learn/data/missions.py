"""Store: missions opened and read with the checks that learning needs, each error naming the store.

What `open_store` lets pass would be trained silently here: xarray counts samples where
there is no time, and reads an array whose files are gone as NaN.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from learn.data.bounds import bounds
from learn.data.features import leave_out
from twin.errors import StoreError
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.attributes import N_SAMPLES, SCHEMA, SIMULATED_ATTRIBUTES as GLOBAL_ATTRIBUTES
from twin.records.store import open_store, read_array

if TYPE_CHECKING:
    import xarray as xr

LEAST_SAMPLES = 2
"""Of a mission: a depth rate takes two."""
SPACING = 1e-3
"""Part of the period by which steps of time may differ: rounding of float32 after a day."""


def open_missions(store: str | Path) -> xr.Dataset:
    """A store of missions, opened lazily.

    Raises:
      StoreError: see `twin.records.store.open_store`; or its attribute `schema` is not ours.
    """
    dataset = open_store(store)
    found, ours = dataset.attrs.get(SCHEMA), GLOBAL_ATTRIBUTES[SCHEMA]
    if found != ours:
        dataset.close()
        raise StoreError(
            f"store {store} has {'no attribute' if found is None else 'the attribute'} {SCHEMA}"
            f"{'' if found is None else f' {found!r}'}, expected is {ours!r}: `factory generate`, "
            "`factory import` and `twin simulate --out` write such stores"
        )
    return dataset


def read(dataset: Any, name: str, store: str | Path, rows: Any = None) -> NDArray[Any]:
    """An array of a store; of some missions (rows, time) with `rows`.

    Raises:
      StoreError: its files are gone or cannot be decoded.
    """
    if rows is not None:
        dataset = dataset[[name]].isel({MISSION: rows}).transpose(MISSION, TIME)
    return read_array(dataset, name, store)


def period_of(dataset: Any, store: str | Path) -> float:
    """[s] between samples.

    Raises:
      StoreError: no coordinate `time`, fewer than two samples, or unequal steps.
    """
    if TIME not in dataset.coords:
        raise StoreError(
            f"store {store} has no coordinate {TIME!r}, so that the time between samples is not "
            "known; make it anew"
        )
    time = read(dataset, TIME, store).astype(float)
    if len(time) < LEAST_SAMPLES:
        raise StoreError(f"store {store} has {len(time)} sample per mission; networks need more")
    steps = np.diff(time)
    period = float(np.median(steps))
    if not (period > 0.0 and np.allclose(steps, period, rtol=SPACING, atol=0.0)):
        raise StoreError(f"store {store} is not equally spaced in {TIME!r}; resample it first")
    return period


def samples_of(
    dataset: Any, store: str | Path, rows: Sequence[int] | NDArray[np.intp]
) -> NDArray[np.int64]:
    """Samples of each of these missions; later ones are padding.

    Raises:
      StoreError: no variable `n_samples`, or one that is too small or longer than the arrays.
    """
    if N_SAMPLES not in dataset:
        raise StoreError(f"store {store} has no variable {N_SAMPLES!r}; generate it anew")
    longest = dataset.sizes[TIME]
    values = np.nan_to_num(read(dataset, N_SAMPLES, store).astype(float), nan=0.0)[rows]
    for row, samples in zip(rows, values, strict=True):
        if not LEAST_SAMPLES <= samples <= longest:
            raise StoreError(
                f"store {store}: {N_SAMPLES} of mission {row} is {samples:g}; its arrays allow "
                f"{LEAST_SAMPLES} to {longest}; make the store anew"
            )
    return values.astype(np.int64)


def check_possible(
    name: str, values: NDArray[Any], *, mission: int, period: float, store: str | Path
) -> None:
    """Refuse a value that no vehicle can have: a single one would ruin a network's scales.

    Args:
      values: (time,) at `period` [s]; NaN is left to others.

    Raises:
      StoreError: names channel, mission, sample and what is possible.
    """
    if name not in VARIABLES:
        return
    low, high = bounds(name)
    bad = np.flatnonzero((values < low) | (values > high))
    if bad.size:
        unit = VARIABLES[name].units
        raise StoreError(
            f"store {store}: channel {name} of mission {mission} is {values[bad[0]]:.3g} at sample "
            f"{bad[0]} ({bad[0] * period:.1f} s), possible are {low:g} to {high:g}"
            f"{'' if unit == '1' else ' ' + unit}; repair the store{leave_out([name])}"
        )


def content_hash(store: str | Path, names: Iterable[str]) -> str:
    """SHA-256 over names and bytes of the files of these arrays: what a training learned from.

    The store's own attributes are left out: they say when it was made, and the same recipe makes
    the same arrays again.
    """
    digest = hashlib.sha256()
    for name in sorted({TIME, N_SAMPLES, "split", *names}):
        folder = Path(store) / name
        for path in sorted(p for p in folder.rglob("*") if p.is_file()):
            digest.update(path.relative_to(store).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
