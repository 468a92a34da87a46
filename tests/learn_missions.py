"""Synthetic missions: a kinematic glider, quasi-steady with lags, in the store's layout."""

import warnings

import numpy as np
import xarray as xr
from navigation import FLAGS, PERIOD, synthetic_mission

from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.schema import SCHEMA_VERSION, VARIABLES


def write_synthetic_store(path, lengths, splits=None, drop=(), edit=None):
    """A store with missions of these lengths; `splits` are numbers of FLAGS, None leaves them out.

    `drop` names variables to leave out; `edit(arrays)` may change the arrays before writing.
    """
    missions = [synthetic_mission(n, seed) for seed, n in enumerate(lengths)]
    longest = max(lengths, default=0)
    arrays = {}
    for name in missions[0] if missions else VARIABLES:
        if name in drop or name.startswith("estimated_"):  # no store holds these
            continue
        values = np.full((len(missions), longest), np.nan, np.float32)
        for row, signals in zip(values, missions, strict=True):
            row[: len(signals[name])] = signals[name]
        arrays[name] = values
    if edit is not None:
        edit(arrays)
    dataset = xr.Dataset(
        {
            name: (("mission", "time"), values, VARIABLES[name].attributes())
            for name, values in arrays.items()
        },
        {"mission": np.arange(len(missions)), "time": PERIOD * np.arange(longest)},
        {**SIMULATED_ATTRIBUTES, "schema_version": SCHEMA_VERSION},
    )
    dataset["n_samples"] = ("mission", np.array(lengths, np.int32))
    if splits is not None:
        dataset["split"] = ("mission", np.array(splits, np.int8), FLAGS)
    return write_dataset(dataset, path)


def write_dataset(dataset, path):
    """A store with its metadata gathered in one place, as the factory's have."""
    with warnings.catch_warnings():
        # zarr: neither gathered metadata nor text arrays are in the v3 specification yet.
        warnings.simplefilter("ignore")
        dataset.to_zarr(path, mode="w", zarr_format=3, consolidated=True)
    return path
