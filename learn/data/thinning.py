"""Thinning: a store with fewer samples, so that networks see logs as slow as real ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from learn.data.dataset import thinning_step
from twin.records.attributes import N_SAMPLES, SAMPLE_PERIOD
from twin.records.schema import TIME
from twin.records.store import open_store, write_store


def thin_store(store: Path, out: Path, period: float) -> Path:
    """Write every n-th sample of a store to another one.

    Raises:
      StoreError: see `learn.data.dataset.thinning_step`.
    """
    dataset = open_store(store).load()
    time = dataset[TIME].values.astype(float)
    step = thinning_step(float(np.median(np.diff(time))), period, store)
    thin = dataset.isel({TIME: slice(None, None, step)})
    lengths = (dataset[N_SAMPLES].values + step - 1) // step
    thin = thin.assign({N_SAMPLES: (dataset[N_SAMPLES].dims, lengths, dataset[N_SAMPLES].attrs)})
    thin.attrs[SAMPLE_PERIOD] = period
    for variable in thin.variables.values():
        variable.encoding.clear()
    write_store(thin, out, overwrite=True)
    return out
