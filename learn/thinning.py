"""Thinning: a store with fewer samples, so that networks see logs as slow as real ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.errors import InputError
from twin.schema import TIME
from twin.store import open_store, write_store

TOLERANCE = 1e-3
"""Part of a sample by which the wanted period may miss a multiple of the store's."""


def thinning_step(have: float, want: float) -> int:
    """Every which sample gives a period of `want` [s] from one of `have` [s].

    Raises:
      InputError: it is shorter, or no multiple.
    """
    step = round(want / have)
    if step < 1 or abs(step * have - want) > TOLERANCE * have:
        raise InputError(
            f"samples every {have:g} s cannot be thinned to every {want:g} s; "
            f"choose a multiple of {have:g}"
        )
    return step


def thin_store(store: Path, out: Path, period: float) -> Path:
    """Write every n-th sample of a store to another one.

    Raises:
      InputError: see `thinning_step`.
    """
    dataset = open_store(store).load()
    time = dataset[TIME].values.astype(float)
    step = thinning_step(float(np.median(np.diff(time))), period)
    thin = dataset.isel({TIME: slice(None, None, step)})
    lengths = (dataset["n_samples"].values + step - 1) // step
    thin = thin.assign(n_samples=(dataset["n_samples"].dims, lengths, dataset["n_samples"].attrs))
    thin.attrs["sample_period_s"] = period
    for variable in thin.variables.values():
        variable.encoding.clear()
    write_store(thin, out, overwrite=True)
    return out
